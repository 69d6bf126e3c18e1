//! Files with another up axis: read with y up, and written back in their own axes.

use kinelm_motion::format::bvh::{self, Channel};
use kinelm_motion::format::{self, ReadOptions, Unit, Up, UpSource};
use kinelm_motion::rotation::{Axis, angle_between};
use kinelm_motion::{Clip, Motion, Quat, Source, Vec3, inspect, smpl, synth};
use std::path::{Path, PathBuf};

/// The axes other than y: a position (x, y, z) with y up in a file with that up axis, as axes and signs.
const TURNS: [(Up, [(Axis, f64); 3]); 5] = [
    (Up::Z, [(Axis::X, 1.0), (Axis::Z, -1.0), (Axis::Y, 1.0)]),
    (Up::NegZ, [(Axis::X, 1.0), (Axis::Z, 1.0), (Axis::Y, -1.0)]),
    (Up::X, [(Axis::Y, 1.0), (Axis::X, -1.0), (Axis::Z, 1.0)]),
    (Up::NegX, [(Axis::Y, -1.0), (Axis::X, 1.0), (Axis::Z, 1.0)]),
    (Up::NegY, [(Axis::X, 1.0), (Axis::Y, -1.0), (Axis::Z, -1.0)]),
];

fn options(up: Up) -> ReadOptions {
    ReadOptions { up, ..Default::default() }
}

fn read(bytes: &[u8], options: &ReadOptions) -> Motion {
    bvh::read(Path::new("x.bvh"), bytes, options).unwrap()
}

fn source(m: &Motion) -> &bvh::BvhSource {
    let Source::Bvh(source) = &m.source else { panic!("a BVH") };
    source
}

fn kinds(m: &Motion) -> Vec<&'static str> {
    m.warnings.iter().map(|w| w.kind).filter(|k| k.starts_with("up_")).collect()
}

/// Rotates the text of a y-up file: offsets, channel names and signs, without computing any rotation.
fn whole(m: &Motion, turn: &[(Axis, f64); 3]) -> Vec<u8> {
    let (head, numbers) = (&source(m).head, &source(m).numbers);
    // own axis a is an axis of the file, up to its sign
    let goes = |a: Axis| {
        let i = turn.iter().position(|(from, _)| *from == a).unwrap();
        ([Axis::X, Axis::Y, Axis::Z][i], turn[i].1)
    };
    let mut text = String::from("HIERARCHY\n");
    let mut open = Vec::new();
    let mut signs = Vec::new();
    for (i, n) in head.nodes.iter().enumerate() {
        while open.last().copied() != n.parent && open.pop().is_some() {
            text += "}\n";
        }
        let o = turn.map(|(from, sign)| sign * n.offset[from.index()]);
        let name = match n.kind {
            bvh::NodeKind::Root => format!("ROOT {}", n.name),
            bvh::NodeKind::Joint => format!("JOINT {}", n.name),
            bvh::NodeKind::End => "End Site".into(),
        };
        text += &format!("{name}\n{{\nOFFSET {} {} {}\n", o[0], o[1], o[2]);
        if n.kind != bvh::NodeKind::End {
            text += &format!("CHANNELS {}", n.channels.len());
            for c in &n.channels {
                let (c, sign) = match c {
                    Channel::Position(a) => (Channel::Position(goes(*a).0), goes(*a).1),
                    Channel::Rotation(a) => (Channel::Rotation(goes(*a).0), goes(*a).1),
                };
                signs.push(sign);
                text += &format!(" {}", c.name());
            }
            text.push('\n');
        }
        open.push(i);
    }
    text += &"}\n".repeat(open.len());
    text += &format!("MOTION\nFrames: {}\nFrame Time: {}\n", m.clip.frames(), head.frame_time);
    for row in numbers.chunks(head.width) {
        let row: Vec<String> = row.iter().zip(&signs).map(|(v, s)| (v * s).to_string()).collect();
        text += &(row.join(" ") + "\n");
    }
    text.into_bytes()
}

/// The rotation of positions.
fn rotation(turn: &[(Axis, f64); 3]) -> Quat {
    let to = |p: Vec3| Vec3::from_array(turn.map(|(from, sign)| sign * p[from.index()]));
    Quat::from_mat3(&kinelm_motion::rotation::Mat3::from_cols(to(Vec3::X), to(Vec3::Y), to(Vec3::Z)))
}

/// A clip with rotated motion and unrotated bones.
fn turned(clip: &Clip, by: Quat) -> Clip {
    let root = clip.root().iter().map(|&p| by * p).collect();
    let at_root = |(i, &q): (usize, &Quat)| if i % clip.joints() == 0 { by * q } else { q };
    let rotations = clip.rotations().iter().enumerate().map(at_root).collect();
    Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations).unwrap()
}

/// Largest differences of positions in metres and of rotations in radians.
fn distance(a: &Clip, b: &Clip) -> (f64, f64) {
    assert_eq!((a.frames(), a.joints()), (b.frames(), b.joints()));
    let positions = a.positions().iter().zip(b.positions()).map(|(a, b)| a.distance(b)).fold(0.0, f64::max);
    let turns = a.rotations().iter().zip(b.rotations()).map(|(a, b)| angle_between(*a, *b)).fold(0.0, f64::max);
    (positions, turns)
}

fn assert_same(a: &Clip, b: &Clip, metres: f64, radians: f64, what: &str) {
    let (positions, turns) = distance(a, b);
    assert!(positions < metres && turns < radians, "{what}: {positions} m, {turns} rad");
}

/// Every `nth` clip of a set.
fn clips(set: &str, test: &str, nth: usize) -> Vec<PathBuf> {
    let Some(folder) = kinelm_shared_data::set(set, test) else { return Vec::new() };
    let (mut found, mut folders) = (Vec::new(), vec![folder]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            match path.extension().is_some_and(|e| e == "bvh") {
                true => found.push(path),
                false if path.is_dir() => folders.push(path),
                false => {}
            }
        }
    }
    found.sort();
    let all = std::env::var_os("KINELM_ALL_SHARED_FILES").is_some();
    found.into_iter().step_by(if all { 1 } else { nth }).collect()
}

#[test]
fn every_shared_file_stands_however_it_is_turned() {
    let test = "every_shared_file_stands_however_it_is_turned";
    let some = [("cmu-dance", 25), ("bandai-1", 60), ("bandai-2", 500)];
    let mut stood_up = Vec::new();
    for path in some.into_iter().flat_map(|(set, nth)| clips(set, test, nth)) {
        let name = path.display().to_string();
        let own = format::read(&path, &options(Up::Auto)).unwrap();
        assert_eq!((source(&own).rig.axes.up, source(&own).rig.axes.by), (Up::Y, UpSource::Inferred), "{name}");
        assert!(kinds(&own).is_empty(), "{name}: {:?}", own.warnings);
        for (up, turn) in &TURNS {
            let what = format!("{name}, {up} up");
            let file = whole(&own, turn);
            let m = read(&file, &options(Up::Auto));
            assert_eq!((source(&m).rig.axes.up, kinds(&m)), (*up, vec!["up_axis"]), "{what}");
            assert_same(&own.clip, &m.clip, 1e-9, 1e-9, &what);
            assert_eq!(read(&file, &options(*up)).clip, m.clip, "{what}");

            let lies = own.clone().with_clip(turned(&own.clip, rotation(turn)));
            let lies = bvh::to_bytes(&lies).unwrap();
            // by the feet, or, in a clip that hardly leaves its place, not for sure
            let m = read(&lies, &options(Up::Auto));
            let found = (source(&m).rig.axes.up, source(&m).rig.axes.by, kinds(&m));
            let is_stood_up = found == (*up, UpSource::Feet, vec!["up_axis"]);
            let is_left = found == (Up::Y, UpSource::Ambiguous, vec!["up_unsure"]);
            assert!(is_stood_up || is_left, "{what}, motion alone: {found:?}");
            assert!(m.warnings.iter().any(|w| w.what.contains("`up`")), "{what}");
            stood_up.push(is_stood_up);
            let m = read(&lies, &options(*up));
            assert_same(&own.clip, &m.clip, 1e-5, 1e-6, &format!("{what}, motion alone"));
        }
    }
    let share = stood_up.iter().filter(|is| **is).count() as f64 / stood_up.len().max(1) as f64;
    assert!(share > 0.6 || stood_up.is_empty(), "{share}");
}

/// A synthetic dance as a y-up BVH on SMPL's rig.
fn dance() -> Motion {
    let clip = synth::corpus(3, 1, 2.0, 30.0).unwrap().remove(0).clip;
    let plain = Motion::new("x", clip);
    read(&bvh::to_bytes(&plain).unwrap(), &options(Up::Auto))
}

#[test]
fn what_was_read_is_written_in_its_own_axes() {
    let own = dance();
    for (up, turn) in &TURNS {
        let m = read(&whole(&own, turn), &options(Up::Auto));
        let bytes = bvh::to_bytes(&m).unwrap();
        // unchanged: the file's own numbers
        assert_eq!(source(&read(&bytes, &options(Up::Auto))).numbers, source(&m).numbers, "{up}");
        // changed: other numbers, the same axes
        let moved = m.clip.root().iter().map(|p| *p + Vec3::new(0.5, 0.01, -0.25)).collect();
        let clip = Clip::new(m.clip.skeleton().clone(), 30.0, moved, m.clip.rotations().to_vec()).unwrap();
        let bytes = bvh::to_bytes(&m.clone().with_clip(clip.clone())).unwrap();
        let back = read(&bytes, &options(Up::Auto));
        assert_eq!(source(&back).rig.axes.up, *up);
        assert_eq!(source(&back).head.nodes, source(&m).head.nodes);
        assert_same(&clip, &back.clip, 1e-6, 1e-6, &format!("{up}"));
        // positions too
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bvh");
        std::fs::write(&path, &bytes).unwrap();
        let points = format::positions(&path, &options(Up::Auto)).unwrap();
        let hips = points.joints.iter().position(|j| *j == clip.skeleton().names()[0]).unwrap();
        assert!(points.positions[hips].distance(clip.root()[0]) < 1e-6, "{up}");

        // the motion alone, with the axis given
        let lies = own.clone().with_clip(turned(&own.clip, rotation(turn)));
        let m = read(&bvh::to_bytes(&lies).unwrap(), &options(*up));
        let clip = turned(&m.clip, Quat::from_rotation_y(0.3));
        let back = read(&bvh::to_bytes(&m.with_clip(clip.clone())).unwrap(), &options(*up));
        assert_same(&clip, &back.clip, 1e-5, 1e-6, &format!("{up}, motion alone"));
    }
}

/// A dance that goes over the floor.
fn path() -> Clip {
    let clip = dance().clip;
    let away = |f: usize| Vec3::new(0.4 * (0.1 * f as f64).sin(), 0.0, 0.02 * f as f64);
    let root = clip.root().iter().enumerate().map(|(f, p)| *p + away(f)).collect();
    Clip::new(clip.skeleton().clone(), 30.0, root, clip.rotations().to_vec()).unwrap()
}

/// Somebody who rolls over the floor, waving with arms and legs.
fn lying() -> Clip {
    let frame = |f: usize| {
        let t = f as f64 / 30.0;
        let mut pose = vec![Quat::IDENTITY; 24];
        pose[0] = Quat::from_rotation_x(-std::f64::consts::FRAC_PI_2) * Quat::from_rotation_y(0.8 * t);
        for (joint, phase) in [(1, 0.0), (2, 1.0), (16, 2.0), (17, 3.0)] {
            pose[joint] = Quat::from_rotation_x(0.3 * (2.0 * t + phase).sin());
        }
        pose
    };
    let rotations: Vec<Quat> = (0..120).flat_map(frame).collect();
    let place = |f: usize| Vec3::new(0.01 * f as f64, 0.0, 0.0);
    let clip = Clip::new(smpl::neutral(), 30.0, (0..120).map(place).collect(), rotations.clone()).unwrap();
    // whatever is lowest is on the floor
    let lowest = |f: usize| clip.global_pose(f).positions.iter().map(|p| p.y).fold(f64::MAX, f64::min);
    let root = (0..120).map(|f| place(f) - Vec3::Y * lowest(f)).collect();
    Clip::new(smpl::neutral(), 30.0, root, rotations).unwrap()
}

fn as_bvh(clip: Clip) -> Vec<u8> {
    bvh::to_bytes(&Motion::new("x", clip)).unwrap()
}

#[test]
fn feet_on_a_floor_tell_how_a_motion_is_turned() {
    let own = read(&as_bvh(path()), &options(Up::Y)).clip;
    for (up, turn) in &TURNS {
        let m = read(&as_bvh(turned(&own, rotation(turn))), &options(Up::Auto));
        let axes = source(&m).rig.axes;
        if *up == Up::NegY {
            assert_eq!((axes.up, kinds(&m)), (Up::Y, vec!["up_unsure"]), "one can stand on the head");
            continue;
        }
        assert_eq!((axes.up, axes.by, axes.rest_too, kinds(&m)), (*up, UpSource::Feet, false, vec!["up_axis"]), "{up}");
        assert_same(&own, &m.clip, 1e-5, 1e-6, &format!("{up}"));
    }
}

#[test]
fn who_lies_or_crawls_is_left_so() {
    let quarter = std::f64::consts::FRAC_PI_2;
    let mut crawl = vec![Quat::IDENTITY; 24];
    crawl[0] = Quat::from_rotation_x(quarter);
    for (thigh, shin, arm) in [(1, 4, 16), (2, 5, 17)] {
        crawl[thigh] = Quat::from_rotation_x(-quarter);
        crawl[shin] = Quat::from_rotation_x(quarter);
        crawl[arm] = Quat::from_rotation_y(if arm == 16 { -quarter } else { quarter });
    }
    let frames = 40;
    let crawling = Clip::new(smpl::neutral(), 30.0, vec![Vec3::Y * 0.45; frames], crawl.repeat(frames)).unwrap();
    for (what, clip) in [("lying", lying()), ("crawling", crawling)] {
        let bytes = as_bvh(clip);
        let m = read(&bytes, &options(Up::Auto));
        assert_eq!((source(&m).rig.axes.up, kinds(&m)), (Up::Y, vec!["up_unsure"]), "{what}");
        assert_eq!(m.clip, read(&bytes, &options(Up::Y)).clip, "{what}");
        assert!(kinds(&read(&bytes, &options(Up::Y))).is_empty(), "{what}: who says so is not doubted");
    }
}

#[test]
fn the_axis_of_a_format_is_doubted_by_the_feet_and_replaced_on_demand() {
    let folder = tempfile::tempdir().unwrap();
    let saved = |name: &str, clip: &Clip| {
        let path = folder.path().join(name);
        let plain = Motion::new("x", clip.clone());
        format::write(&path, &plain).unwrap();
        path
    };
    let own = read(&as_bvh(path()), &options(Up::Y)).clip;
    let own = Clip::new(smpl::neutral(), 30.0, own.root().to_vec(), own.rotations().to_vec()).unwrap();
    // an .npz with y up is one with z up whose clip was turned from z up to y up once too often
    let (z, y) = (rotation(&TURNS[0].1), rotation(&TURNS[0].1).conjugate());
    for (name, lies, right, axis) in
        [("a.npz", y, Up::Z, Up::Y), ("a.glb", z, Up::Y, Up::Z), ("a.json", z, Up::Y, Up::Z)]
    {
        let stands = saved(name, &own);
        let m = format::read(&stands, &options(Up::Auto)).unwrap();
        assert_eq!((m.warnings.as_slice(), m.source.axes().up), (&[][..], right), "{name}");
        assert_eq!(format::read(&stands, &options(right)).unwrap().clip, m.clip, "{name}");
        let lies = saved(name, &turned(&own, lies));
        let m = format::read(&lies, &options(Up::Auto)).unwrap();
        assert_eq!((kinds(&m), m.source.axes().up), (vec!["up_unsure"], right), "{name}");
        assert!(m.warnings[0].what.contains(&format!("give `up` {axis}")), "{name}: {:?}", m.warnings);
        assert_eq!(format::standing_axis(&m, &kinelm_motion::rig::SkeletonMap::builtin("smpl").unwrap()), Some(axis));
        let m = format::read(&lies, &options(axis)).unwrap();
        assert_eq!((kinds(&m).len(), m.source.axes().up), (0, axis), "{name}");
        // an .npz adds its own rest pelvis, which differs between the axes
        let moved = m.clip.root()[0] - own.root()[0];
        assert!(moved.length() < if name == "a.npz" { 0.4 } else { 1e-5 }, "{name}: {moved}");
        for f in [0, 20] {
            let (a, b) = (m.clip.pose(f)[0], own.pose(f)[0]);
            assert!(angle_between(a, b) < 1e-6 && (m.clip.root()[f] - own.root()[f]).distance(moved) < 1e-5, "{name}");
        }
        // who lies is left so, without a doubt
        assert_eq!(kinds(&format::read(&saved(name, &lying()), &options(Up::Auto)).unwrap()).len(), 0, "{name}");
    }
}

#[test]
fn joints_that_no_map_knows_are_left_as_they_are() {
    let text = "HIERARCHY\nROOT a { OFFSET 0 0 0 CHANNELS 1 Xrotation JOINT b\n{ OFFSET 0 0 1 CHANNELS 1 Xrotation \
                End Site { OFFSET 0 0 1 } } }\nMOTION\nFrames: 1\nFrame Time: 0.05\n0 0\n";
    let with = |up| ReadOptions { unit: Unit::METRE, up, ..Default::default() };
    let m = read(text.as_bytes(), &with(Up::Auto));
    assert_eq!((source(&m).rig.axes.by, kinds(&m).len()), (UpSource::Unknown, 0));
    let m = read(text.as_bytes(), &with(Up::Z));
    assert!(m.clip.positions()[1].distance(Vec3::Y) < 1e-12);
}

#[test]
fn a_json_is_turned_on_demand() {
    let folder = tempfile::tempdir().unwrap();
    let (clip, path) = (dance().clip, folder.path().join("a.json"));
    let plain = |clip| Motion::new("x", clip);
    format::write(&path, &plain(turned(&clip, rotation(&TURNS[0].1)))).unwrap();
    let lies = format::read(&path, &options(Up::Auto)).unwrap();
    assert!(lies.clip != clip, "unasked a JSON has y up");
    let m = format::read(&path, &options(Up::Z)).unwrap();
    assert_same(&clip, &m.clip, 1e-12, 1e-12, "a JSON");
    let back = folder.path().join("b.json");
    format::write(&back, &m).unwrap();
    assert_same(&lies.clip, &format::read(&back, &options(Up::Y)).unwrap().clip, 1e-12, 1e-12, "a JSON's own axes");
}

#[test]
fn options_of_before_have_no_up() {
    let old: ReadOptions = serde_json::from_str(r#"{"unit": "m", "skip": 3}"#).unwrap();
    assert_eq!((old.up, old.skip), (Up::Auto, 3));
    for up in [Up::Auto, Up::X, Up::NegX, Up::Y, Up::NegY, Up::Z, Up::NegZ] {
        let text = serde_json::to_string(&options(up)).unwrap();
        assert!(text.contains(&format!("\"up\":\"{up}\"")), "{text}");
        assert_eq!(serde_json::from_str::<ReadOptions>(&text).unwrap().up, up);
    }
}

/// A movement of scripts/reference/blender.py, and Blender's export of its import, read as `up` says. They are the same
/// movement at `fps`, and Blender's file is written back unchanged.
fn through_blender(name: &str, up: Up, fps: f64) -> [Motion; 2] {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    let own = format::read(&golden.join(format!("{name}_y_up.bvh")), &options(Up::Auto)).unwrap();
    let m = format::read(&golden.join(format!("{name}_z_up.bvh")), &options(up)).unwrap();
    assert_eq!((source(&own).rig.axes.up, source(&m).rig.axes.up), (Up::Y, Up::Z), "{name}");
    assert_eq!((own.clip.fps(), m.clip.fps()), (fps, fps), "{name}");
    assert_eq!(own.clip.skeleton().names(), m.clip.skeleton().names(), "{name}");
    assert_same(&own.clip, &m.clip, 1e-4, 0.01f64.to_radians(), name);
    let again = read(&bvh::to_bytes(&m).unwrap(), &options(up));
    assert_eq!((&source(&again).numbers, &source(&again).head.nodes), (&source(&m).numbers, &source(&m).head.nodes));
    [own, m]
}

#[test]
fn a_dance_through_blender_and_back_is_the_same() {
    // an upright dance needs no option and leaves no doubt about axis or floor
    let floors = through_blender("blender_dance", Up::Auto, 20.0).map(|mut m| {
        assert_eq!(source(&m).rig.axes.by, UpSource::Inferred);
        let message = if source(&m).rig.axes.up == Up::Y { vec![] } else { vec!["up_axis"] };
        let floor = format::resolve_floor(&mut m, &options(Up::Auto)).unwrap();
        assert_eq!(m.warnings.iter().map(|w| w.kind).collect::<Vec<_>>(), message, "{:?}", m.warnings);
        let report = inspect::report(&m, None).text();
        assert!(report.contains("no doubts"), "{report}");
        floor
    });
    assert!(floors.iter().all(|floor| floor.abs() < 1e-4), "the feet stand on y = 0: {floors:?}");
}

#[test]
fn a_tumble_through_blender_and_back_is_the_same() {
    // with all joints rotated arbitrarily no body stands, and the caller must give the axis
    through_blender("blender", Up::Z, 60.0);
}
