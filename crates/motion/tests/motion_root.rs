//! What is above the body belongs to its path, in every format; what is beside it stays in the file.

use kinelm_motion::convert::{ConvertOptions, TargetRig, convert};
use kinelm_motion::format::{self, ReadOptions, Unit, glb, json};
use kinelm_motion::format::{Changed, bvh};
use kinelm_motion::rotation::angle_between;
use kinelm_motion::{Clip, FaultKind, Motion, Quat, Result, Skeleton, Source, Vec3, synth};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;

const FPS: f64 = 30.0;

fn dance() -> Clip {
    synth::corpus(7, 1, 3.0, FPS).unwrap().remove(0).clip
}

/// Where a root above the body goes: 3 m along z in the dance's 3 s, and a quarter turn.
fn carried(frame: usize) -> (Quat, Vec3) {
    let share = frame as f64 / (3.0 * FPS);
    (Quat::from_rotation_y(1.5 * share), Vec3::new(0.2 * share, 0.0, 3.0 * share))
}

/// World positions (F, 24) of the dance when the root carries it.
fn expected(dance: &Clip) -> Vec<Vec3> {
    let place = |(i, p): (usize, Vec3)| {
        let (turn, by) = carried(i / 24);
        by + turn * p
    };
    dance.positions().into_iter().enumerate().map(place).collect()
}

fn same_places(clip: &Clip, wanted: &[Vec3], tolerance: f64) {
    assert_eq!(clip.skeleton().names()[0], "pelvis");
    assert_eq!(clip.joints(), 24);
    let names = kinelm_motion::smpl::NAMES.map(|name| clip.skeleton().find(name).unwrap());
    let places = clip.positions();
    assert_eq!(places.len(), wanted.len());
    for (i, want) in wanted.iter().enumerate() {
        let place = places[i / 24 * 24 + names[i % 24]];
        assert!(place.distance(*want) < tolerance, "frame {} joint {}: {place} {want}", i / 24, i % 24);
    }
}

/// A BVH in centimetres whose ROOT carries the dance's pelvis; with two IK targets beside the pelvis if `beside`.
fn bvh_text(dance: &Clip, beside: bool) -> String {
    let motion = Motion::new("a.bvh", dance.clone());
    let text = String::from_utf8(bvh::to_bytes(&motion).unwrap()).unwrap();
    let (tree, rows) = text.split_once("MOTION\n").unwrap();
    let body = tree.replace("HIERARCHY\nROOT", "JOINT");
    let channels = "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation";
    let target = |name: &str| format!("JOINT {name}\n{{ OFFSET 10 0 0\n{channels}\nEnd Site {{ OFFSET 0 5 0 }} }}\n");
    let targets = if beside { target("ik_foot_l") + &target("ik_foot_r") } else { String::new() };
    let head = format!("HIERARCHY\nROOT root\n{{\nOFFSET 0 0 0\n{channels}\n{body}{targets}}}\nMOTION\n");
    let mut lines = rows.lines();
    let counts = format!("{}\n{}\n", lines.next().unwrap(), lines.next().unwrap());
    let row = |(f, row): (usize, &str)| {
        let (turn, by) = carried(f);
        let (_, angle) = turn.to_axis_angle();
        let root = format!("{} {} {} 0 0 {}", by.x * 100.0, by.y * 100.0, by.z * 100.0, angle.to_degrees());
        let targets = if beside { format!(" 1 2 3 4 5 {f}").repeat(2) } else { String::new() };
        format!("{root} {row}{targets}\n")
    };
    head + &counts + &lines.enumerate().map(row).collect::<String>()
}

fn read(name: &str, bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
    format::parse(Path::new(name), bytes, options)
}

fn source(motion: &Motion) -> &bvh::BvhSource {
    let Source::Bvh(source) = &motion.source else { panic!("a BVH") };
    source
}

#[test]
fn a_root_above_the_pelvis_of_a_bvh_carries_it() {
    let dance = dance();
    for beside in [false, true] {
        let text = bvh_text(&dance, beside);
        let motion = read("a.bvh", text.as_bytes(), &ReadOptions::default()).unwrap();
        same_places(&motion.clip, &expected(&dance), 1e-6);
        let said: Vec<_> =
            motion.warnings.iter().filter(|w| w.kind != "rate_doubted").map(|w| w.what.as_str()).collect();
        let targets = "ik_foot_l, ik_foot_r: beside the body, and no part of the clip; they move by up to 0.00 m at what \
                       they hang from";
        assert_eq!(said, if beside { vec![targets] } else { vec![] });
        assert_eq!(bvh::to_bytes(&motion).unwrap(), {
            let again = read("a.bvh", &bvh::to_bytes(&motion).unwrap(), &ReadOptions::default()).unwrap();
            bvh::to_bytes(&again).unwrap()
        });
    }
}

/// The numbers of a row, by the name of a node.
fn numbers(text: &str, frame: usize) -> Vec<f64> {
    let mut rows = text.lines().skip_while(|line| !line.starts_with("Frame Time")).skip(1 + frame);
    rows.next().unwrap().split_whitespace().map(|word| word.parse().unwrap()).collect()
}

#[test]
fn a_changed_clip_has_its_path_where_the_file_had_it() {
    let dance = dance();
    let text = bvh_text(&dance, true);
    let motion = read("a.bvh", text.as_bytes(), &ReadOptions::default()).unwrap();
    let root = motion.clip.root().iter().map(|p| *p + Vec3::new(0.5, 0.0, -0.25)).collect();
    let turned = motion.clip.rotations().iter().enumerate().map(|(i, q)| match i % 24 {
        0 => Quat::from_rotation_x(0.1) * *q,
        _ => *q,
    });
    let clip = Clip::new(motion.clip.skeleton().clone(), FPS, root, turned.collect()).unwrap();
    let bytes = source(&motion).to_bytes(&clip).unwrap();
    let again = read("b.bvh", &bytes, &ReadOptions::default()).unwrap().clip;
    for f in 0..clip.frames() {
        let (a, b) = (clip.global_pose(f), again.global_pose(f));
        for j in 0..24 {
            assert!(a.positions[j].distance(b.positions[j]) < 1e-6, "frame {f} joint {j}");
            assert!(angle_between(a.rotations[j], b.rotations[j]) < 1e-7, "frame {f} joint {j}");
        }
    }
    let written = String::from_utf8(bytes).unwrap();
    for f in [0, 40, 89] {
        let (was, is) = (numbers(&text, f), numbers(&written, f));
        // the pelvis stays at its place below the root, the root goes where the clip goes, the targets keep their numbers
        assert!((is[0] - was[0] - 50.0).abs() < 1e-3 && (is[2] - was[2] + 25.0).abs() < 1e-3, "{is:?} {was:?}");
        assert!(is[6..9].iter().zip(&was[6..9]).all(|(a, b)| (a - b).abs() < 1e-5), "frame {f}");
        assert_eq!(is[is.len() - 12..], was[was.len() - 12..]);
    }
}

#[test]
fn an_edit_leaves_all_other_numbers_to_the_file() {
    let dance = dance();
    let text = bvh_text(&dance, true);
    let motion = read("a.bvh", text.as_bytes(), &ReadOptions::default()).unwrap();
    let (frames, mut root) = (motion.clip.frames(), motion.clip.root().to_vec());
    root[50] += Vec3::new(0.1, 0.02, 0.3);
    let clip = Clip::new(motion.clip.skeleton().clone(), FPS, root, motion.clip.rotations().to_vec()).unwrap();
    let mut changed = Changed { before: 0, root: vec![false; frames], joints: vec![false; 24 * frames] };
    changed.root[50] = true;
    let bytes = source(&motion).spliced(text.as_bytes(), &clip, &changed).unwrap();
    let again = read("b.bvh", &bytes, &ReadOptions::default()).unwrap().clip;
    assert!(again.root()[50].distance(clip.root()[50]) < 1e-6);
    let written = String::from_utf8(bytes).unwrap();
    let differ: Vec<_> = text.lines().zip(written.lines()).filter(|(a, b)| a != b).collect();
    assert_eq!(differ.len(), 1, "one row changed");
    let (was, is) = (numbers(&text, 50), numbers(&written, 50));
    let columns: Vec<usize> = (0..is.len()).filter(|&c| is[c] != was[c]).collect();
    // x and z of the root, and the height, where the pelvis has it
    assert_eq!(columns, [0, 2, 7]);
}

#[test]
fn a_dance_goes_onto_a_rig_with_a_root_above() {
    let dance = dance();
    let rig = read("rig.bvh", bvh_text(&dance, true).as_bytes(), &ReadOptions::default()).unwrap();
    let other = synth::corpus(9, 1, 2.0, FPS).unwrap().remove(0).clip;
    let motion = Motion::new("o.json", other.clone());
    let options = ConvertOptions { rig: Some(TargetRig::of_motion(rig).unwrap()), ..Default::default() };
    let on_rig = convert(motion, &options).unwrap();
    let bytes = format::to_bytes(Path::new("o.bvh"), &on_rig).unwrap();
    let again = read("o.bvh", &bytes, &ReadOptions::default()).unwrap().clip;
    same_places(&again, &other.positions(), 1e-5);
    let row = numbers(std::str::from_utf8(&bytes).unwrap(), 10);
    // the root has the path, and does not turn as in the rig's own motion
    assert!((row[0] / 100.0 - again.root()[10].x).abs() < 1e-3 && row[3..6] == [0.0; 3], "{row:?}");
}

/// The dance below a root that carries it, as a clip of its own with a prop beside the pelvis.
fn carried_clip(dance: &Clip) -> Clip {
    let rig = dance.skeleton();
    let names = [&["root".to_owned(), "prop".to_owned()], rig.names()].concat();
    let parents = [None, Some(0)].into_iter().chain(rig.parents().iter().map(|p| Some(p.map_or(0, |p| p + 2))));
    let mut offsets = vec![Vec3::ZERO, Vec3::X];
    offsets.extend_from_slice(rig.offsets());
    offsets[2] = Vec3::Y;
    let skeleton = Skeleton::new(names, parents.collect(), offsets, vec![]).unwrap();
    // the pelvis stands 1 m above the root all the time
    let frames = 0..dance.frames();
    let rotations =
        frames.clone().flat_map(|f| [carried(f).0, Quat::IDENTITY].into_iter().chain(dance.pose(f).to_vec()));
    let root = frames.map(|f| carried(f).1).collect();
    Clip::new(Arc::new(skeleton), FPS, root, rotations.collect()).unwrap()
}

/// The JSON and the binary part of a GLB.
fn parts(bytes: &[u8]) -> (Value, Vec<u8>) {
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    (serde_json::from_slice(&bytes[20..20 + length]).unwrap(), bytes[28 + length..].to_vec())
}

fn glb_of(json: &Value, binary: &[u8]) -> Vec<u8> {
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let chunk = |kind: &[u8; 4], bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes()[..], kind, bytes].concat();
    let chunks = [chunk(b"JSON", &text), chunk(b"BIN\0", binary)].concat();
    [&b"glTF"[..], &2u32.to_le_bytes(), &(12 + chunks.len() as u32).to_le_bytes(), &chunks].concat()
}

#[test]
fn a_root_above_the_pelvis_of_a_glb_or_json_carries_it() {
    let clip = carried_clip(&dance());
    let wanted: Vec<Vec3> = clip.positions().chunks(26).flat_map(|frame| frame[2..].to_vec()).collect();
    for (name, bytes, tolerance) in
        [("a.glb", glb::to_bytes(&[("a", &clip)]).unwrap(), 1e-5), ("a.json", json::write(&clip), 1e-12)]
    {
        let motion = read(name, &bytes, &ReadOptions::default()).unwrap();
        same_places(&motion.clip, &wanted, tolerance);
        assert!(motion.warnings.iter().all(|w| w.kind != "stretch_dropped"), "{:?}", motion.warnings);
    }
}

#[test]
fn a_root_is_a_figure_or_a_joint() {
    let dance = dance();
    let clip = carried_clip(&dance);
    let files = [
        ("a.bvh", bvh_text(&dance, true).into_bytes()),
        ("a.glb", glb::to_bytes(&[("a", &clip)]).unwrap()),
        ("a.json", json::write(&clip)),
    ];
    for (name, bytes) in &files {
        let of = |root: &str| {
            read(name, bytes, &ReadOptions { root: Some(root.into()), unit: unit(name), ..Default::default() })
        };
        let knee = of("left_knee").unwrap().clip;
        assert_eq!(knee.skeleton().names()[0], "left_knee", "{name}");
        let whole = read(name, bytes, &ReadOptions::default()).unwrap().clip;
        let at = whole.skeleton().find("left_knee").unwrap();
        for f in [0, 30, 80] {
            assert!(knee.root()[f].distance(whole.global_pose(f).positions[at]) < 1e-5, "{name}");
        }
        let e = of("nobody").unwrap_err().to_string();
        assert!(e.contains("nobody") && e.contains("root"), "{e}");
    }
    assert_eq!(
        read("a.bvh", &files[0].1, &ReadOptions { root: Some("root".into()), ..Default::default() })
            .unwrap()
            .clip
            .joints(),
        24
    );
    // two ROOTs with the same joints
    let text = bvh_text(&dance, false);
    let (tree, rest) = text.split_once("MOTION\n").unwrap();
    let second = tree.replace("HIERARCHY\n", "").replace("ROOT root", "ROOT other");
    let row = |line: &str| format!("{line} {line}\n");
    let mut lines = rest.lines();
    let counts = format!("{}\n{}\n", lines.next().unwrap(), lines.next().unwrap());
    let pair = format!("{tree}{second}MOTION\n{counts}{}", lines.map(row).collect::<String>());
    let of =
        |root: &str| read("p.bvh", pair.as_bytes(), &ReadOptions { root: Some(root.into()), ..Default::default() });
    let e = of("pelvis").unwrap_err();
    assert_eq!(e.fault(), Some(FaultKind::RootUnknown));
    assert!(e.to_string().contains("ROOT \"root\" and \"pelvis.2\" below ROOT \"other\""), "{e}");
    assert_eq!(of("other").unwrap().clip.skeleton().names()[0], "pelvis.2");
}

/// A BVH's leg can't tell the unit where the knee is the root.
fn unit(name: &str) -> Unit {
    if name.ends_with("bvh") { Unit::CENTIMETRE } else { Unit::Auto }
}

#[test]
fn two_bodies_below_one_node_are_two_figures() {
    let (one, two) = (dance(), synth::corpus(9, 1, 2.0, FPS).unwrap().remove(0).clip);
    let (mut json, binary) = parts(&glb::to_bytes(&[("one", &one), ("two", &two)]).unwrap());
    let stage = json!({"name": "stage", "children": json["scenes"][0]["nodes"].clone()});
    json["nodes"].as_array_mut().unwrap().push(stage);
    let stage = json["nodes"].as_array().unwrap().len() - 1;
    json["scenes"][0]["nodes"] = json!([stage]);
    for skins in [true, false] {
        if !skins {
            // armatures alone, as programs export them without a mesh
            json.as_object_mut().unwrap().retain(|key, _| key != "skins" && key != "meshes");
            for node in json["nodes"].as_array_mut().unwrap() {
                node.as_object_mut().unwrap().retain(|key, _| key != "skin" && key != "mesh");
            }
        }
        let bytes = glb_of(&json, &binary);
        let of = |root: Option<&str>| {
            read("p.glb", &bytes, &ReadOptions { root: root.map(str::to_owned), ..Default::default() })
        };
        let motion = of(None).unwrap();
        assert_eq!(motion.clip.joints(), 24, "skins {skins}");
        assert!(motion.warnings.iter().any(|w| w.what.contains("2 figures, one, two")), "{:?}", motion.warnings);
        for (name, clip) in [("one", &one), ("two", &two)] {
            let found = of(Some(name)).unwrap().clip;
            assert_eq!(found.frames(), clip.frames(), "{name}");
            same_places(&found, &clip.positions(), 1e-5);
        }
        let e = of(Some("left_knee")).unwrap_err().to_string();
        assert!(e.contains("left_knee in 2 figures") && e.contains("one of one, two"), "{e}");
    }
}

#[test]
fn the_longest_take_that_moves_the_figure_is_read_and_take_chooses() {
    let (one, two) = (dance(), synth::corpus(9, 1, 2.0, FPS).unwrap().remove(0).clip);
    let (mut json, binary) = parts(&glb::to_bytes(&[("one", &one), ("two", &two)]).unwrap());
    // the one animation becomes one a figure, as programs write an action an armature
    let whole = json["animations"][0].clone();
    let of = |name: &str, nodes: std::ops::Range<u64>| {
        let own = |c: &&Value| nodes.contains(&c["target"]["node"].as_u64().unwrap());
        let channels: Vec<&Value> = whole["channels"].as_array().unwrap().iter().filter(own).collect();
        json!({"name": name, "samplers": whole["samplers"], "channels": channels})
    };
    json["animations"] = json!([of("first", 0..25), of("second", 25..1000)]);
    let bytes = glb_of(&json, &binary);
    let read = |root: &str, take: Option<&str>| {
        let (root, take) = (Some(root.into()), take.map(str::to_owned));
        read("t.glb", &bytes, &ReadOptions { root, take, ..Default::default() })
    };
    let frames = |root: &str, take: Option<&str>| read(root, take).unwrap().clip.frames();
    assert_eq!([frames("one", None), frames("two", None)], [one.frames(), two.frames()]);
    assert_eq!(frames("two", Some("second")), two.frames());
    assert_eq!(frames("two", Some("first")), 1, "nothing of it moves this figure");
    let e = read("two", Some("third")).unwrap_err().to_string();
    assert!(e.contains("no take third") && e.contains("one of first, second"), "{e}");
}

#[test]
fn joints_that_never_turn_are_read_without_a_skin() {
    let dance = dance();
    // head, hands and feet never turn
    let still = |(i, q): (usize, &Quat)| {
        if [7, 8, 10, 11, 15, 20, 21, 22, 23].contains(&(i % 24)) { Quat::IDENTITY } else { *q }
    };
    let rotations = dance.rotations().iter().enumerate().map(still).collect();
    let clip = Clip::new(dance.skeleton().clone(), FPS, dance.root().to_vec(), rotations).unwrap();
    let (mut json, binary) = parts(&glb::to_bytes(&[("one", &clip)]).unwrap());
    json.as_object_mut().unwrap().retain(|key, _| key != "skins");
    for node in json["nodes"].as_array_mut().unwrap() {
        node.as_object_mut().unwrap().retain(|key, _| key != "skin");
    }
    let motion = read("s.glb", &glb_of(&json, &binary), &ReadOptions::default()).unwrap();
    same_places(&motion.clip, &clip.positions(), 1e-5);
}

#[test]
fn a_unit_is_heard_for_every_format() {
    let dance = dance();
    let centimetres = dance.clone().scaled(100.0).unwrap();
    for (name, bytes) in
        [("a.glb", glb::to_bytes(&[("a", &centimetres)]).unwrap()), ("a.json", json::write(&centimetres))]
    {
        let motion = read(name, &bytes, &ReadOptions::default()).unwrap();
        let doubt = motion.warnings.iter().find(|w| w.kind == "size_doubted").unwrap_or_else(|| panic!("{name}"));
        assert!(doubt.what.contains("`unit` cm"), "{doubt}");
        assert!(motion.warnings.iter().all(|w| w.kind != "rate_doubted"), "{:?}", motion.warnings);
        let motion = read(name, &bytes, &ReadOptions { unit: Unit::CENTIMETRE, ..Default::default() }).unwrap();
        same_places(&motion.clip, &dance.positions(), 1e-4);
        assert!(motion.warnings.iter().all(|w| w.kind != "size_doubted"), "{:?}", motion.warnings);
    }
}

#[test]
fn what_is_beside_goes_on_between_the_rows_of_the_file() {
    let dance = dance();
    let text = bvh_text(&dance, true);
    let motion = read("a.bvh", text.as_bytes(), &ReadOptions::default()).unwrap();
    // twice the rate: every second row is the file's, the others lie between
    let twice = kinelm_motion::resample::resample(&motion.clip, 2.0 * FPS, kinelm_motion::resample::Method::Smooth);
    let written = String::from_utf8(source(&motion).to_bytes(&twice.unwrap()).unwrap()).unwrap();
    let last = |row: Vec<f64>| row[row.len() - 1];
    let turns: Vec<f64> = (0..6).map(|f| last(numbers(&written, f))).collect();
    assert_eq!(turns, [0.0, 0.5, 1.0, 1.5, 2.0, 2.5]);
    // a part of the clip begins with the rows of its first frame
    let part = motion.slice(30..60);
    let written = String::from_utf8(bvh::to_bytes(&part).unwrap()).unwrap();
    assert_eq!(last(numbers(&written, 0)), 30.0);
}

#[test]
fn a_joint_above_a_body_is_named_with_the_body_s_path() {
    let clip = carried_clip(&dance());
    let group = |name: &str| {
        Clip::new(
            Arc::new(
                Skeleton::new(
                    [&["world".to_owned(), "group".to_owned()], clip.skeleton().names()].concat(),
                    [None, Some(0)]
                        .into_iter()
                        .chain(clip.skeleton().parents().iter().map(|p| Some(p.map_or(1, |p| p + 2))))
                        .collect(),
                    [&[Vec3::ZERO, Vec3::X], clip.skeleton().offsets()].concat(),
                    vec![],
                )
                .unwrap_or_else(|e| panic!("{name}: {e}")),
            ),
            FPS,
            clip.root().to_vec(),
            (0..clip.frames()).flat_map(|f| [[Quat::IDENTITY; 2].to_vec(), clip.pose(f).to_vec()].concat()).collect(),
        )
        .unwrap()
    };
    let bytes = json::write(&group("group"));
    let of = |root: Option<&str>| {
        let options = ReadOptions { root: root.map(str::to_owned), ..Default::default() };
        read("a.json", &bytes, &options).unwrap().clip
    };
    assert_eq!(of(None), of(Some("group")));
    assert_eq!(of(Some("group")).skeleton().names()[0], "pelvis");
}

#[test]
fn a_body_that_faces_between_the_axes_at_rest_keeps_its_pose() {
    use kinelm_motion::retarget::to_smpl;
    let dance = dance();
    let expected = dance.positions();
    for degrees in [10.0f64, 37.0, 45.0, -60.0] {
        // as below a turned armature: all bones at rest, and what the root does, turned about y
        let turn = Quat::from_rotation_y(degrees.to_radians());
        let rig = dance.skeleton();
        let offsets = rig.offsets().iter().map(|o| turn * *o).collect();
        let names = rig.names().iter().map(|name| format!("b_{name}")).collect();
        let rig = Skeleton::new(names, rig.parents().to_vec(), offsets, vec![]).unwrap();
        let turned = |q: &Quat| turn * *q * turn.inverse();
        let root = dance.root().iter().map(|p| turn * *p).collect();
        let rotations = dance.rotations().iter().map(turned).collect();
        let clip = Clip::new(Arc::new(rig), FPS, root, rotations).unwrap();
        let motion = Motion::new("y.json", clip);
        let found = to_smpl(&motion.clone().with_map("smpl").unwrap()).or_else(|_| to_smpl(&motion)).unwrap();
        for (a, b) in found.positions().iter().zip(&expected) {
            // the path is turned with the world, the pose too
            assert!((turn.inverse() * *a).distance(*b) < 1e-3, "{degrees}: {a} {b}");
        }
    }
}
