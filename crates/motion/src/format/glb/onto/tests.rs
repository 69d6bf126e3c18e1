use super::*;
use crate::format::{ReadOptions, glb};
use crate::rotation::angle_between;
use crate::{Motion, Quat, Skeleton, Source, Vec3, smpl, synth};
use glam::DAffine3;
use std::sync::Arc;

/// A character on SMPL's rig: an armature, turned and in centimetres, above a still root above the hips; joints with turns of
/// their own at rest; a mesh, saved in a pose that isn't the bind pose; members that nothing here knows. A knee has a matrix.
struct Hero {
    json: Value,
    binary: Vec<u8>,
}

fn hero() -> Hero {
    let rig = smpl::neutral();
    let armature = DAffine3::from_scale_rotation_translation(
        Vec3::splat(0.01),
        Quat::from_rotation_x(-std::f64::consts::FRAC_PI_2),
        Vec3::new(0.3, 0.0, -0.2),
    );
    let root = armature * DAffine3::from_rotation_translation(Quat::from_rotation_z(0.4), Vec3::new(5.0, 2.0, 1.0));
    let mut world: Vec<DAffine3> = Vec::new();
    let mut places: Vec<Vec3> = Vec::new();
    for (j, parent) in rig.parents().iter().enumerate() {
        let place = parent.map_or(Vec3::Y, |p| places[p] + rig.offsets()[j]);
        let turn = Quat::from_axis_angle(Vec3::new(1.0, j as f64, 0.5).normalize(), 0.3 * j as f64);
        places.push(place);
        world.push(DAffine3::from_scale_rotation_translation(Vec3::splat(0.01), turn, place));
    }
    let trs = |m: DAffine3, name: &str, children: Vec<usize>| {
        let (scale, turn, place) = m.to_scale_rotation_translation();
        json!({"name": name, "translation": place.to_array(), "rotation": turn.to_array(), "scale": scale.to_array(),
            "children": children, "extras": {"kept": [1, 2.50]}})
    };
    // 0 the armature, 1 the root, 2.. the joints, then the body
    let body = 2 + rig.joints();
    let mut nodes = vec![trs(armature, "Armature", vec![1, body]), trs(armature.inverse() * root, "root", vec![2])];
    let (mut binary, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    let mut data = |numbers: &[f64], kind: &str, width: usize| {
        views.push(json!({"buffer": 0, "byteOffset": binary.len(), "byteLength": 4 * numbers.len()}));
        binary.extend(numbers.iter().flat_map(|&x| (x as f32).to_le_bytes()));
        let bounds = if width == 1 { json!([numbers[numbers.len() - 1]]) } else { Value::Null };
        let mut accessor =
            json!({"bufferView": views.len() - 1, "componentType": 5126, "count": numbers.len() / width, "type": kind});
        if width == 1 {
            (accessor["min"], accessor["max"]) = (json!([numbers[0]]), bounds);
        }
        accessors.push(accessor);
        accessors.len() - 1
    };
    for (j, parent) in rig.parents().iter().enumerate() {
        let above = parent.map_or(root, |p| world[p]);
        // the pose in which the file was saved
        let posed = DAffine3::from_quat(Quat::from_rotation_y(if j % 5 == 4 { 0.5 } else { 0.0 }));
        let local = above.inverse() * world[j] * posed;
        let mut node = trs(local, &rig.names()[j], rig.children(j).map(|child| 2 + child).collect());
        if rig.names()[j] == "left_knee" {
            let [t, r, s] = ["translation", "rotation", "scale"].map(|key| node.as_object_mut().unwrap().remove(key));
            assert!(t.is_some() && r.is_some() && s.is_some());
            let m = glam::DMat4::from(local);
            node["matrix"] = json!(m.to_cols_array());
        }
        nodes.push(node);
    }
    let binds: Vec<f64> =
        world.iter().flat_map(|m| glam::DMat4::from(m.inverse() * armature).to_cols_array()).collect();
    let binds = data(&binds, "MAT4", 16);
    let corners = data(&[0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.1, 0.0], "VEC3", 3);
    nodes.push(json!({"name": "body", "mesh": 0, "skin": 0}));
    // an animation of its own: half a second at 20 frames, cubic on a shoulder, the root moves, weights of morph targets
    let times = data(&(0..=10).map(|f| f as f64 / 20.0).collect::<Vec<_>>(), "SCALAR", 1);
    let walk: Vec<f64> = (0..=10).flat_map(|f| [5.0 + f as f64, 2.0, 1.0]).collect();
    let walk = data(&walk, "VEC3", 3);
    let turns = |j: usize, by: f64| -> Vec<Quat> {
        let own = Quat::from_array(serde_json::from_value(nodes[2 + j]["rotation"].clone()).unwrap());
        (0..=10).map(|f| own * Quat::from_rotation_z(by * (f as f64).sin())).collect()
    };
    let flat = |turns: Vec<Quat>| turns.iter().flat_map(|q| q.to_array()).collect::<Vec<f64>>();
    let (hip, shoulder) = (flat(turns(1, 0.3)), flat(turns(16, 0.4)));
    let cubic: Vec<f64> = shoulder.chunks(4).flat_map(|q| [&[0.1; 4], q, &[0.1; 4]].concat()).collect();
    let (hip, shoulder) = (data(&hip, "VEC4", 4), data(&cubic, "VEC4", 4));
    let weights = data(&(0..22).map(|n| n as f64 / 22.0).collect::<Vec<_>>(), "SCALAR", 1);
    let samplers = json!([{"input": times, "output": walk}, {"input": times, "output": hip, "interpolation": "LINEAR"},
        {"input": times, "output": shoulder, "interpolation": "CUBICSPLINE"}, {"input": times, "output": weights}]);
    let channel = |n: usize, node: usize, path: &str| json!({"sampler": n, "target": {"node": node, "path": path}});
    let channels = json!([
        channel(0, 1, "translation"),
        channel(1, 3, "rotation"),
        channel(2, 18, "rotation"),
        channel(3, body, "weights")
    ]);
    let joints: Vec<usize> = (2..body).collect();
    let length = binary.len();
    let json = json!({
        "zz_unknown": {"b": 1, "a": [1.50, 2]}, "asset": {"version": "2.0", "generator": "a test"},
        "nodes": nodes, "scenes": [{"nodes": [0]}], "scene": 0, "skins": [{"joints": joints, "inverseBindMatrices": binds}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": corners}}]}],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": length}],
        "animations": [{"name": "own", "samplers": samplers, "channels": channels}],
    });
    Hero { json, binary }
}

impl Hero {
    fn bytes(&self) -> Vec<u8> {
        Chunks { json: self.json.to_string().as_bytes(), binary: Some(&self.binary), others: vec![(7, b"more")] }
            .bytes("a hero")
            .unwrap()
    }
}

fn read(bytes: &[u8], take: Option<&str>) -> Motion {
    let options = ReadOptions { take: take.map(str::to_owned), ..Default::default() };
    glb::read(Path::new("hero.glb"), bytes, &options).unwrap()
}

/// A dance on a rig whose joints are SMPL's.
fn dance(rig: &Arc<Skeleton>) -> Clip {
    let dance = synth::corpus(3, 1, 2.0, 30.0).unwrap().remove(0).clip;
    Clip::new(rig.clone(), 30.0, dance.root().to_vec(), dance.rotations().to_vec()).unwrap()
}

/// The largest distance of a joint in a frame.
fn apart(a: &Clip, b: &Clip) -> f64 {
    assert_eq!((a.frames(), a.joints()), (b.frames(), b.joints()));
    a.positions().iter().zip(b.positions()).map(|(a, b)| a.distance(b)).fold(0.0, f64::max)
}

#[test]
fn a_dance_is_added_and_the_rest_stays() {
    let hero = hero();
    let bytes = hero.bytes();
    let motion = read(&bytes, None);
    let clip = dance(motion.clip.skeleton());
    let out = glb::motion_to_bytes(Path::new("new.glb"), &motion.clone().with_clip(clip.clone()), None).unwrap();
    let again = read(&out, Some("new"));
    assert!(again.clip.fps() == 30.0 && apart(&again.clip, &clip) < 2e-6, "{}", apart(&again.clip, &clip));
    for (a, b) in again.clip.rotations().iter().zip(clip.rotations()) {
        assert!(angle_between(*a, *b) < 1e-5);
    }
    assert!(apart(&read(&out, Some("own")).clip, &motion.clip) < 1e-9);
    let (old, new) = (Chunks::parse(Path::new("a"), &bytes).unwrap(), Chunks::parse(Path::new("a"), &out).unwrap());
    let [before, after] = [old.binary, new.binary].map(Option::unwrap);
    assert!(after.starts_with(before) && new.others == old.others && out.len().is_multiple_of(4));
    // without what was added, the document of before, but for the knee (`text` holds the bytes of the rest)
    let mut left: Value = serde_json::from_slice(new.json).unwrap();
    for (list, own) in [("accessors", 7), ("bufferViews", 7), ("animations", 1)] {
        let list = left[list].as_array_mut().unwrap();
        assert!(list.len() > own);
        list.truncate(own);
    }
    left["buffers"][0]["byteLength"] = before.len().into();
    let knee = |document: &mut Value| document["nodes"].as_array_mut().unwrap().remove(6);
    let mut hero = hero.json;
    let (was, is) = (knee(&mut hero), knee(&mut left));
    assert_eq!(left, hero);
    assert_eq!(
        (&was["name"], &was["extras"], was["matrix"].is_array()),
        (&is["name"], &is["extras"], is["matrix"].is_null())
    );
    assert!(is["translation"].is_array() && is["rotation"].is_array() && is["scale"].is_array());
}

#[test]
fn what_stands_as_the_file_was_saved_has_no_keys() {
    let motion = read(&hero().bytes(), None);
    let clip = dance(motion.clip.skeleton());
    // the pose in which the file was saved
    let mut still = hero();
    still.json["animations"] = json!([]);
    let saved = read(&still.bytes(), None).clip;
    let elbow = saved.skeleton().find("left_elbow").unwrap();
    let j = clip.joints();
    let rotations: Vec<Quat> = clip
        .rotations()
        .iter()
        .enumerate()
        .map(|(n, &q)| match n % j {
            n if n == elbow => saved.pose(0)[elbow],
            16 => Quat::from_rotation_x(0.2),
            _ => q,
        })
        .collect();
    let clip = Clip::new(clip.skeleton().clone(), 30.0, clip.root().to_vec(), rotations).unwrap();
    let out = glb::motion_to_bytes(Path::new("new.glb"), &motion.with_clip(clip.clone()), None).unwrap();
    assert!(apart(&read(&out, Some("new")).clip, &clip) < 2e-5);
    let document = Document::parse(Path::new("new.glb"), &out).unwrap();
    let new = &document.json.animations[1];
    let keys = |joint: usize| {
        let channel = new.channels.iter().find(|c| c.target.node == Some(2 + joint) && c.target.path == "rotation");
        channel.map(|c| document.numbers(new.samplers[c.sampler].input, 1).unwrap().len())
    };
    assert_eq!((keys(elbow), keys(16), keys(15)), (None, Some(2), Some(clip.frames())));
    let root = new.channels.iter().find(|c| c.target.node == Some(1)).map(|c| c.target.path.as_str());
    assert_eq!(root, Some("translation"), "the file's own animation moves the root above the hips: here it is held");
}

#[test]
fn an_edit_shares_what_it_leaves_alone() {
    let bytes = hero().bytes();
    let motion = read(&bytes, None);
    let (frames, j) = (motion.clip.frames(), motion.clip.joints());
    assert_eq!((frames, motion.clip.fps()), (11, 20.0));
    // new: the left hip and the left shoulder in frames 4 to 6, an ankle without keys at the end, the path at the beginning
    let mut changed = Changed { before: 0, root: vec![false; frames], joints: vec![false; frames * j] };
    let (mut root, mut rotations) = (motion.clip.root().to_vec(), motion.clip.rotations().to_vec());
    for (joint, span) in [(1, 4..7), (16, 4..7), (7, 9..11)] {
        for f in span {
            rotations[f * j + joint] = Quat::from_rotation_x(1.0 + 0.1 * f as f64) * rotations[f * j + joint];
            changed.joints[f * j + joint] = true;
        }
    }
    for (place, is_new) in root.iter_mut().zip(&mut changed.root).take(2) {
        *place += Vec3::Y * 0.2;
        *is_new = true;
    }
    let clip = Clip::new(motion.clip.skeleton().clone(), 20.0, root, rotations).unwrap();
    let edited = motion.clone().with_clip(clip.clone());
    let out = glb::motion_to_bytes(Path::new("new.glb"), &edited, Some(&changed)).unwrap();
    let again = read(&out, Some("new")).clip;
    assert!(apart(&again, &clip) < 2e-6, "{}", apart(&again, &clip));
    let document = Document::parse(Path::new("new.glb"), &out).unwrap();
    let [own, new] = [0, 1].map(|n| &document.json.animations[n]);
    let of = |animation: &super::super::file::document::Animation, node: usize, path: &str| {
        let channel = animation.channels.iter().find(|c| c.target.node == Some(node) && c.target.path == path);
        channel.map(|c| (animation.samplers[c.sampler].input, animation.samplers[c.sampler].output))
    };
    for (node, path) in [(1, "translation"), (26, "weights")] {
        assert_eq!(of(own, node, path), of(new, node, path), "{path}");
    }
    let values = |animation, node, path| document.numbers(of(animation, node, path).unwrap().1, 4).unwrap();
    let (a, b) = (values(own, 3, "rotation"), values(new, 3, "rotation"));
    let differ: BTreeSet<usize> = (0..a.len()).filter(|&n| a[n] != b[n]).map(|n| n / 4).collect();
    assert_eq!(differ, BTreeSet::from([4, 5, 6]));
    let (a, b) = (values(own, 18, "rotation"), values(new, 18, "rotation"));
    let keys = |n: usize| n / 12;
    let differ: BTreeSet<usize> = (0..a.len()).filter(|&n| a[n].abs() != b[n].abs()).map(keys).collect();
    assert_eq!(differ, BTreeSet::from([4, 5, 6]));
    // it holds its pose up to the frame before the new ones
    assert_eq!(document.numbers(of(new, 9, "rotation").unwrap().0, 1).unwrap().len(), 4);
    assert_eq!(document.numbers(of(new, 2, "translation").unwrap().0, 1).unwrap().len(), 3);
    assert!(of(own, 2, "translation").is_none() && of(new, 4, "rotation").is_none());
}

#[test]
fn a_part_of_an_animation_at_another_rate() {
    let bytes = hero().bytes();
    let options = ReadOptions { fps_source: Some(10.0), ..Default::default() };
    let motion = glb::read(Path::new("hero.glb"), &bytes, &options).unwrap();
    let part = motion.clip.slice(3..8);
    let j = part.joints();
    let changed = Changed { before: 3, root: vec![false; 5], joints: vec![false; 5 * j] };
    let edited = motion.clone().with_clip(part.clone());
    let out = glb::motion_to_bytes(Path::new("new.glb"), &edited, Some(&changed)).unwrap();
    let again = read(&out, Some("new")).clip;
    assert_eq!((again.frames(), again.fps()), (5, 10.0));
    assert!(apart(&again, &part) < 2e-6, "{}", apart(&again, &part));
}

#[test]
fn names_and_what_is_refused() {
    let bytes = hero().bytes();
    let motion = read(&bytes, None);
    let with = |motion: &Motion, name: &str, replace: Option<&str>| {
        let Source::Glb(source) = &motion.source else { panic!("a mesh") };
        let source = GlbSource { replace: replace.map(str::to_owned), ..(**source).clone() };
        let motion = motion.clone().with_clip(dance(motion.clip.skeleton())).with_source(Source::Glb(Box::new(source)));
        glb::motion_to_bytes(Path::new(name), &motion, None)
    };
    let e = with(&motion, "own.glb", None).unwrap_err().to_string();
    assert!(e.contains("animation own in hero.glb") && e.contains("replace it by name"), "{e}");
    let e = with(&motion, "new.glb", Some("none")).unwrap_err().to_string();
    assert!(e.contains("the file has: own"), "{e}");
    let out = with(&motion, "new.glb", Some("own")).unwrap();
    let document = Document::parse(Path::new("a"), &out).unwrap();
    assert_eq!((document.json.animations.len(), document.json.animations[0].name.as_deref()), (1, Some("own")));
    assert_eq!(read(&out, None).clip.frames(), 60);
    // nothing but nodes and a mesh without numbers
    let mut bare = hero();
    for member in ["animations", "accessors", "bufferViews", "buffers", "skins"] {
        bare.json.as_object_mut().unwrap().remove(member);
    }
    bare.json["animations"] = json!([{"name": "own", "channels": [{"sampler": 0, "target": {"node": 2, "path": "rotation"}}],
        "samplers": [{"input": 0, "output": 1}]}]);
    bare.json["accessors"] = json!([{"componentType": 5126, "count": 1, "type": "SCALAR"}, {"componentType": 5126, "count": 1,
        "type": "VEC4"}]);
    let bytes = Chunks { json: bare.json.to_string().as_bytes(), binary: None, others: vec![] }.bytes("bare").unwrap();
    let motion = read(&bytes, None);
    let out = with(&motion, "new.glb", None).unwrap();
    assert!(apart(&read(&out, Some("new")).clip, &dance(motion.clip.skeleton())) < 2e-6);
    // a buffer elsewhere
    bare.json["buffers"] = json!([{"byteLength": 4, "uri": "a.bin"}]);
    let bytes = Chunks { json: bare.json.to_string().as_bytes(), binary: None, others: vec![] }.bytes("bare").unwrap();
    let e = with(&read(&bytes, None), "new.glb", None).unwrap_err().to_string();
    assert!(e.contains("isn't its binary chunk"), "{e}");
    // a file of capsules is written anew
    let own = glb::to_bytes(&[("dance", &dance(motion.clip.skeleton()))]).unwrap();
    assert!(matches!(read(&own, None).source, Source::Plain));
}

#[test]
fn compressed_keys_are_refused_and_compressed_meshes_kept() {
    let mut hero = hero();
    hero.json["extensionsRequired"] = json!(["EXT_meshopt_compression"]);
    let view = |hero: &mut Hero, n: usize| {
        hero.json["bufferViews"][n]["extensions"] = json!({"EXT_meshopt_compression": {"buffer": 0}});
        glb::read(Path::new("hero.glb"), &hero.bytes(), &ReadOptions::default())
    };
    // the mesh's positions, then the keys of the hip
    assert!(view(&mut hero, 1).is_ok());
    let e = view(&mut hero, 4).unwrap_err().to_string();
    assert!(e.contains("accessor 4: compressed by EXT_meshopt_compression"), "{e}");
}

#[test]
fn weights_of_three_morph_targets_are_scalars_in_a_part_too() {
    let mut hero = hero();
    let weights = hero.json["animations"][0]["samplers"][3]["output"].as_u64().unwrap() as usize;
    let numbers: Vec<u8> = (0..33u8).flat_map(|n| (f32::from(n) / 33.0).to_le_bytes()).collect();
    let length = hero.binary.len();
    hero.json["bufferViews"][weights] = json!({"buffer": 0, "byteOffset": length, "byteLength": numbers.len()});
    hero.json["accessors"][weights]["count"] = 33.into();
    hero.binary.extend(numbers);
    hero.json["buffers"][0]["byteLength"] = hero.binary.len().into();
    let motion = read(&hero.bytes(), None);
    let part = motion.clip.slice(3..8);
    let changed = Changed { before: 3, root: vec![false; 5], joints: vec![false; 5 * part.joints()] };
    let out = glb::motion_to_bytes(Path::new("new.glb"), &motion.with_clip(part), Some(&changed)).unwrap();
    let document = Document::parse(Path::new("new.glb"), &out).unwrap();
    let new = &document.json.animations[1];
    let channel = new.channels.iter().find(|c| c.target.path == "weights").unwrap();
    let found = document.numbers(new.samplers[channel.sampler].output, 1).unwrap();
    let expected: Vec<f64> = (9..24u8).map(|n| f64::from(f32::from(n) / 33.0)).collect();
    assert_eq!(found, expected);
}

#[test]
fn broken_files_and_flags_are_errors() {
    let edited = |hero: &Hero| {
        let motion = glb::read(Path::new("hero.glb"), &hero.bytes(), &ReadOptions::default())?;
        let (frames, j) = (motion.clip.frames(), motion.clip.joints());
        let changed = Changed { before: 0, root: vec![true; frames], joints: vec![false; frames * j] };
        glb::motion_to_bytes(Path::new("new.glb"), &motion, Some(&changed))
    };
    assert!(edited(&hero()).is_ok());
    let mut other = hero();
    other.json["animations"][0]["channels"][3]["sampler"] = 9.into();
    assert!(edited(&other).unwrap_err().to_string().contains("sampler 9: not there"));
    let mut other = hero();
    other.json["animations"][0]["channels"][3]["target"]["node"] = 99.into();
    assert!(edited(&other).unwrap_err().to_string().contains("node 99"));
    let motion = read(&hero().bytes(), None);
    let changed = Changed { before: 0, root: vec![true], joints: Vec::new() };
    let e = glb::motion_to_bytes(Path::new("new.glb"), &motion, Some(&changed)).unwrap_err().to_string();
    assert!(e.contains("a flag for each of 11 frames"), "{e}");
    // whatever stands in the document
    let whole = hero().bytes();
    for at in (20..whole.len() - hero().binary.len()).step_by(7) {
        let mut spoilt = whole.clone();
        spoilt[at] ^= 0x15;
        if let Ok(motion) = glb::read(Path::new("hero.glb"), &spoilt, &ReadOptions::default()) {
            let (frames, j) = (motion.clip.frames(), motion.clip.joints());
            let changed = Changed { before: 0, root: vec![true; frames], joints: vec![true; frames * j] };
            let _ = glb::motion_to_bytes(Path::new("new.glb"), &motion, None);
            let _ = glb::motion_to_bytes(Path::new("new.glb"), &motion, Some(&changed));
        }
    }
}

#[test]
fn soles_are_where_the_mesh_is_lowest_below_a_foot() {
    let mut hero = hero();
    let rig = smpl::neutral();
    let (armature, turned): (DAffine3, Quat) = {
        let own = &hero.json["nodes"][0];
        let of = |key: &str| serde_json::from_value::<Vec<f64>>(own[key].clone()).unwrap();
        let (place, turn) = (of("translation"), of("rotation"));
        let turn = Quat::from_xyzw(turn[0], turn[1], turn[2], turn[3]);
        let armature = DAffine3::from_scale_rotation_translation(Vec3::splat(0.01), turn, Vec3::from_slice(&place));
        // the bind pose is in the armature's axes
        (armature, turn.inverse())
    };
    let mut places: Vec<Vec3> = Vec::new();
    for (j, parent) in rig.parents().iter().enumerate() {
        places.push(parent.map_or(Vec3::Y, |p| places[p] + rig.offsets()[j]));
    }
    // below each ball its sole and the tip of the toes; a knee and the top of the head
    let (sole, tip) = (Vec3::new(0.0, -0.03, 0.01), Vec3::new(0.01, -0.025, 0.08));
    let vertices = [(10, sole), (10, tip), (11, sole), (11, tip), (4, Vec3::Z * 0.1), (15, Vec3::Y * 0.2)];
    let mut add = |bytes: Vec<u8>, kind: &str, component: u32| {
        let (offset, length) = (hero.binary.len(), bytes.len());
        hero.binary.extend(bytes);
        let [views, accessors] = ["bufferViews", "accessors"].map(|key| hero.json[key].as_array().unwrap().len());
        let view = json!({"buffer": 0, "byteOffset": offset, "byteLength": length});
        hero.json["bufferViews"].as_array_mut().unwrap().push(view);
        let accessor = json!({"bufferView": views, "componentType": component, "count": vertices.len(), "type": kind});
        hero.json["accessors"].as_array_mut().unwrap().push(accessor);
        accessors
    };
    let floats = |numbers: Vec<f64>| numbers.iter().flat_map(|&x| (x as f32).to_le_bytes()).collect::<Vec<u8>>();
    let of_armature = |(j, from): &(usize, Vec3)| armature.inverse().transform_point3(places[*j] + *from).to_array();
    let positions = add(floats(vertices.iter().flat_map(of_armature).collect()), "VEC3", 5126);
    let moved_by = add(vertices.iter().flat_map(|(j, _)| [0, *j as u8, 0, 0]).collect(), "VEC4", 5121);
    let weights = add(floats(vertices.iter().flat_map(|_| [0.2, 0.8, 0.0, 0.0]).collect()), "VEC4", 5126);
    let body = hero.json["nodes"].as_array().unwrap().len() - 1;
    hero.json["nodes"][body]["skin"] = json!(0);
    hero.json["buffers"][0]["byteLength"] = json!(hero.binary.len());
    hero.json["meshes"][0]["primitives"][0]["attributes"] =
        json!({"POSITION": positions, "JOINTS_0": moved_by, "WEIGHTS_0": weights});
    let motion = read(&hero.bytes(), None);
    let names = |parent: usize| motion.clip.skeleton().names()[parent].clone();
    let ends: Vec<(String, Vec3)> =
        motion.clip.skeleton().ends().iter().map(|end| (names(end.parent), end.offset)).collect();
    let expected = ["left_foot", "right_foot"].iter().flat_map(|name| [(*name, turned * sole), (*name, turned * tip)]);
    assert_eq!(ends.len(), 4, "{ends:?}");
    for ((name, offset), (of, at)) in ends.iter().zip(expected) {
        assert!(name == of && offset.distance(at) < 1e-5, "{ends:?}");
    }
    // a dance stands on its soles
    let stand = motion.humanoid().unwrap().feet().unwrap();
    assert!(stand.joints.iter().all(|(_, height)| *height > 0.0299), "{stand:?}");
    hero.json["meshes"][0]["primitives"][0]["extensions"] = json!({"KHR_draco_mesh_compression": {"bufferView": 0}});
    assert!(read(&hero.bytes(), None).clip.skeleton().ends().is_empty());
}

#[test]
fn uneven_scales_and_sheared_matrices_are_refused() {
    let fresh = hero();
    let written = |change: &dyn Fn(&mut Value)| {
        let mut hero = Hero { json: fresh.json.clone(), binary: fresh.binary.clone() };
        change(&mut hero.json);
        let motion = read(&hero.bytes(), None);
        let doubted = motion.warnings.iter().any(|warning| warning.kind == "uneven_scale");
        let motion = motion.clone().with_clip(dance(motion.clip.skeleton()));
        let place = crate::format::check_place(Path::new("new.glb"), &motion).map_err(|e| e.to_string());
        (doubted, place, glb::motion_to_bytes(Path::new("new.glb"), &motion, None).map_err(|e| e.to_string()))
    };
    let (doubted, place, bytes) = written(&|_| {});
    assert!(!doubted && place.is_ok() && bytes.is_ok());
    let (doubted, place, bytes) = written(&|json| json["nodes"][1]["scale"] = json!([1.0, 1.2, 1.0]));
    let (place, bytes) = (place.unwrap_err(), bytes.unwrap_err());
    assert!(doubted && place == bytes && place.contains("root of hero.glb") && place.contains("uneven"), "{place}");
    // a leaf's matrix bends nothing that hangs from it, but no scale, turn and place are it
    let head = fresh.json["nodes"].as_array().unwrap().iter().position(|node| node["name"] == "left_hand").unwrap();
    let (_, _, bytes) = written(&|json| {
        let node = json["nodes"][head].as_object_mut().unwrap();
        ["translation", "rotation", "scale"].iter().for_each(|key| drop(node.remove(*key)));
        node.insert("matrix".into(), json!([1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, 3, 4, 5, 1]));
    });
    assert!(bytes.is_err_and(|e| e.contains("sheared")));
}
