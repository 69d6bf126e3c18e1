use super::*;
use crate::format::{Format, ReadOptions, glb, parse, to_bytes as bytes_of};
use crate::rig::FoundBy;
use crate::{Skeleton, smpl, synth};
use std::sync::Arc;

/// As far as joints may be from where they were: what single precision leaves of a chain of rotations.
const NEAR_M: f64 = 5e-6;

fn dance() -> Motion {
    Motion::new("dance.json", synth::corpus(3, 1, 2.0, 30.0).unwrap().remove(0).clip)
}

fn read(name: &str, bytes: &[u8]) -> Motion {
    parse(Path::new(name), bytes, &ReadOptions::default()).unwrap()
}

fn message<T>(result: Result<T>) -> String {
    result.err().map(|e| e.to_string()).unwrap_or_default()
}

/// The document of a GLB, and its buffer.
fn parts(bytes: &[u8]) -> (Value, Vec<u8>) {
    let chunks = Chunks::parse(Path::new("a.glb"), bytes).unwrap();
    (serde_json::from_slice(chunks.json).unwrap(), chunks.binary.unwrap_or_default().to_vec())
}

fn glb_of(json: &Value, binary: &[u8]) -> Vec<u8> {
    Chunks { json: json.to_string().as_bytes(), binary: Some(binary), others: Vec::new() }.bytes("a test").unwrap()
}

/// Places of joints by name in the first clip, against the second, `floor` above it.
fn assert_same_places(a: &Clip, b: &Clip, floor: f64) {
    let (at, of) = (a.positions(), b.positions());
    let both: Vec<(usize, usize)> =
        (0..a.joints()).filter_map(|j| Some((j, b.skeleton().find(&a.skeleton().names()[j])?))).collect();
    assert!(both.len() > 14 && a.frames() == b.frames() && a.fps() == b.fps());
    for f in 0..a.frames() {
        for &(i, j) in &both {
            let far = at[f * a.joints() + i].distance(of[f * b.joints() + j] - floor * Vec3::Y);
            assert!(far < NEAR_M, "{} in frame {f}: {far}", a.skeleton().names()[i]);
        }
    }
}

#[test]
fn what_is_written_comes_back() {
    let motion = dance();
    let floor = format::floor_height(&motion).unwrap();
    let bytes = bytes_of(Path::new("salsa.vrma"), &motion).unwrap();
    let again = read("salsa.vrma", &bytes);
    assert_eq!(again.warnings, []);
    assert_eq!(again.clip.joints(), 22, "all of SMPL's joints but the hands");
    assert_same_places(&again.clip, &motion.clip, floor);
    // it says which joint is which, and where its floor is
    let found = again.found().unwrap();
    assert_eq!((found.by, found.map.name.as_str(), found.map.joint(13)), (FoundBy::File, "vrm", Some("left_collar")));
    let twice = read("b.vrma", &bytes_of(Path::new("b.vrma"), &again).unwrap());
    assert_same_places(&twice.clip, &again.clip, 0.0);
    // the same by its content under a GLB's name
    assert!(matches!(read("salsa.glb", &bytes).source, Source::Vrma(_)));
}

#[test]
fn its_rest_is_a_t_pose_on_the_floor() {
    // an A-pose: forearms 40 degrees down, knees ahead of the hips
    let mut offsets = smpl::neutral().offsets().to_vec();
    for (arm, side) in [(18, 1.0), (19, -1.0), (20, 1.0), (21, -1.0)] {
        offsets[arm] = Quat::from_rotation_z(-side * 0.7) * offsets[arm];
    }
    offsets[4].z += 0.05;
    offsets[5].z += 0.05;
    let own = smpl::neutral();
    let rig = Skeleton::new(own.names().to_vec(), own.parents().to_vec(), offsets, vec![]).unwrap();
    let clip = Clip::new(Arc::new(rig), 30.0, vec![Vec3::new(3.0, 0.9, 1.0)], vec![Quat::IDENTITY; 24]).unwrap();
    let motion = Motion::new("a.json", clip);
    let (document, binary) = parts(&bytes_of(Path::new("a.vrma"), &motion).unwrap());
    let nodes = document["nodes"].as_array().unwrap();
    assert!(nodes.iter().all(|node| node.get("rotation").is_none() && node.get("scale").is_none()));
    let place = |bone: &str| {
        let node = document["extensions"]["VRMC_vrm_animation"]["humanoid"]["humanBones"][bone]["node"].as_u64();
        let mut at = node.unwrap() as usize;
        let mut sum = Vec3::ZERO;
        loop {
            sum += Vec3::from_array(serde_json::from_value(nodes[at]["translation"].clone()).unwrap());
            let above = nodes.iter().position(|n| n["children"].as_array().is_some_and(|c| c.contains(&json!(at))));
            match above {
                Some(above) => at = above,
                None => return sum,
            }
        }
    };
    for side in ["left", "right"] {
        let at = |part: &str| place(&format!("{side}{part}"));
        let [shoulder, elbow, wrist] = ["UpperArm", "LowerArm", "Hand"].map(at);
        assert!((shoulder.y - wrist.y).abs() < 1e-6 && (elbow.z - wrist.z).abs() < 1e-6, "{shoulder} {wrist}");
        assert!((wrist.x - shoulder.x) * if side == "left" { 1.0 } else { -1.0 } > 0.5);
        let [hip, knee, ankle, toes] = ["UpperLeg", "LowerLeg", "Foot", "Toes"].map(at);
        assert!(hip.distance(Vec3::new(ankle.x, hip.y, ankle.z)) < 1e-6 && knee.y > ankle.y);
        assert!(toes.y.abs() < 1e-6, "the lowest of a rig without soles: {toes}");
    }
    let hips = place("hips");
    assert!(hips.x.abs() < 1e-6 && hips.z.abs() < 1e-6 && (0.9..1.0).contains(&hips.y), "{hips}");
    // keys move the hips alone, and there are no eyes
    let channels = document["animations"][0]["channels"].as_array().unwrap();
    let moved: Vec<_> = channels.iter().filter(|c| c["target"]["path"] != "rotation").collect();
    assert_eq!((moved.len(), &moved[0]["target"]), (1, &json!({"node": 0, "path": "translation"})));
    assert!(!document.to_string().contains("Eye"));
    assert!(!binary.is_empty() && document.get("skins").is_none() && document.get("meshes").is_none());
}

#[test]
fn a_rig_without_a_required_bone_is_refused() {
    let motion = dance();
    let own = motion.clip.skeleton();
    let kept: Vec<usize> = (0..24).filter(|&j| ![3, 6, 9, 15].contains(&j)).collect();
    let place = |j: usize| kept.iter().position(|&k| k == j);
    let parent = |j: usize| std::iter::successors(own.parents()[j], |&p| own.parents()[p]).find_map(place);
    let names = kept.iter().map(|&j| own.names()[j].clone()).collect();
    let offsets = kept.iter().map(|&j| if j == 12 { Vec3::new(0.0, 0.5, 0.0) } else { own.offsets()[j] }).collect();
    let rig = Skeleton::new(names, kept.iter().map(|&j| parent(j)).collect(), offsets, vec![]).unwrap();
    let clip = Clip::new(Arc::new(rig), 30.0, vec![Vec3::Y], vec![Quat::IDENTITY; kept.len()]).unwrap();
    let said = message(bytes_of(Path::new("a.vrma"), &Motion::new("a.json", clip)));
    assert!(said.contains("a as a VRM animation: its rig has no joint for spine, head"), "{said}");
    let empty = motion.clone().with_clip(motion.clip.slice(0..0)).with_source(Source::Retargeted { floor_m: 0.0 });
    assert!(message(bytes_of(Path::new("b.vrma"), &empty)).contains("0 frames"));
    let far = Clip::new(own.clone(), 30.0, vec![Vec3::splat(1e39)], vec![Quat::IDENTITY; 24]).unwrap();
    let far = motion.with_clip(far).with_source(Source::Retargeted { floor_m: 0.0 });
    assert!(message(bytes_of(Path::new("c.vrma"), &far)).contains("beyond what a GLB holds"));
}

/// An animation of the required bones with names that say nothing, of which the hips are turned at rest and the head nods; a
/// face and a gaze beside.
fn small() -> (Value, Vec<u8>) {
    let required = |(_, bone): &(usize, &crate::format::source::vrm::Bone)| bone.is_required;
    let own: Vec<_> = bones().iter().enumerate().filter(required).collect();
    let neutral = smpl::neutral();
    let rest = GlobalPose::new(&neutral, Vec3::new(0.0, 0.9, 0.0), &[Quat::IDENTITY; 24]);
    let at = |n: usize| rest.positions[bones()[n].smpl_id.unwrap()];
    let place = |n: usize| own.iter().position(|(own, _)| *own == n);
    let above = |n: usize| std::iter::successors(bones()[n].parent, |&p| bones()[p].parent).find_map(place);
    let about = Quat::from_rotation_y(1.0);
    let node = |&(n, _): &(usize, _)| {
        let by = above(n).map_or(at(n), |p| about.conjugate() * (at(n) - at(own[p].0)));
        let children: Vec<usize> = (0..own.len()).filter(|&c| above(own[c].0) == place(n)).collect();
        let mut node = json!({"name": format!("x{n}"), "translation": by.to_array()});
        if n == 0 {
            node["rotation"] = json!(about.to_array());
        }
        if !children.is_empty() && n > 0 || n == 0 {
            node["children"] = json!(children.iter().filter(|&&c| c > 0).collect::<Vec<_>>());
        }
        node
    };
    let mut nodes: Vec<Value> = own.iter().map(node).collect();
    nodes.extend([json!({"name": "happy"}), json!({"name": "gaze"})]);
    let numbers = |all: &[f64]| -> Vec<u8> { all.iter().flat_map(|&x| (x as f32).to_le_bytes()).collect() };
    let nod = Quat::from_rotation_x(0.5).to_array();
    let binary =
        [numbers(&[0.0, 0.5]), numbers(&Quat::IDENTITY.to_array()), numbers(&nod), numbers(&[0.0; 6])].concat();
    let human: Map<String, Value> =
        own.iter().enumerate().map(|(i, (_, bone))| (bone.name.clone(), json!({"node": i}))).collect();
    let head = own.iter().position(|(_, bone)| bone.name == "head").unwrap();
    let (happy, gaze) = (own.len(), own.len() + 1);
    let json = json!({
        "asset": {"version": "2.0"}, "nodes": nodes, "buffers": [{"byteLength": binary.len()}],
        "bufferViews": [{"buffer": 0, "byteLength": 8}, {"buffer": 0, "byteOffset": 8, "byteLength": 32},
                        {"buffer": 0, "byteOffset": 40, "byteLength": 24}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0.0], "max": [0.5]},
                      {"bufferView": 1, "componentType": 5126, "count": 2, "type": "VEC4"},
                      {"bufferView": 2, "componentType": 5126, "count": 2, "type": "VEC3"}],
        "animations": [{"samplers": [{"input": 0, "output": 1}, {"input": 0, "output": 2}], "channels": [
            {"sampler": 0, "target": {"node": head, "path": "rotation"}},
            {"sampler": 1, "target": {"node": happy, "path": "translation"}},
            {"sampler": 0, "target": {"node": gaze, "path": "rotation"}}]}],
        "extensionsUsed": [EXTENSION], "extensions": {EXTENSION: {"specVersion": "1.0",
            "humanoid": {"humanBones": human}, "expressions": {"preset": {"happy": {"node": happy}}},
            "lookAt": {"node": gaze}}},
    });
    (json, binary)
}

#[test]
fn bones_are_known_whatever_their_nodes_are_called() {
    let (json, binary) = small();
    let motion = read("a.vrma", &glb_of(&json, &binary));
    assert_eq!(motion.warnings.iter().map(|w| w.kind).collect::<Vec<_>>(), ["face_dropped"]);
    assert_eq!((motion.clip.joints(), motion.clip.frames(), motion.clip.fps()), (15, 2, 2.0));
    let of = |smpl_id: usize| motion.map().unwrap().joint(smpl_id).map(str::to_owned);
    let named = |name: &str| crate::format::source::vrm::bone(name).map(|n| format!("x{n}"));
    assert_eq!((of(0), of(3), of(15), of(19)), (named("hips"), named("spine"), named("head"), named("rightLowerArm")));
    assert_eq!((of(6), of(9), of(12)), (None, None, None));
    // hips that are turned at rest are at rest
    assert!(angle_between(motion.clip.pose(0)[0], Quat::IDENTITY) < 1e-7);
    let again = read("b.vrma", &bytes_of(Path::new("b.vrma"), &motion).unwrap());
    assert_same_places(&again.clip, &motion.clip, 0.0);
}

#[test]
fn what_is_no_vrm_animation_is_refused() {
    let read = |json: &Value, binary: &[u8]| {
        message(parse(Path::new("a.vrma"), &glb_of(json, binary), &ReadOptions::default()))
    };
    let (json, binary) = small();
    let with = |member: &str, value: Value| {
        let mut json = json.clone();
        json[member] = value;
        read(&json, &binary)
    };
    let said = with("extensions", json!({}));
    assert!(said.contains("a GLB without VRMC_vrm_animation") && said.contains("name it .glb"), "{said}");
    assert!(with("extensions", json!({"VRM": {}})).contains("name it .vrm"));
    assert!(with("extensions", json!({EXTENSION: {"specVersion": "1.0"}})).contains("without humanoid bones"));
    let bone =
        |node: i64| with("extensions", json!({EXTENSION: {"humanoid": {"humanBones": {"hips": {"node": node}}}}}));
    assert!(bone(99).contains("the bone hips at no node"), "{}", bone(99));
    // bones that are none leave none
    assert!(bone(-1).contains("without humanoid bones"));
    assert!(with("extensions", json!({EXTENSION: {"humanoid": {"humanBones": 5}}})).contains("a glTF document"));
}

/// A VRM of SMPL's body with a mesh; VRM 0 looks along -z.
fn avatar(version: u8) -> Vec<u8> {
    let (own, about) = (smpl::neutral(), Quat::from_rotation_y(std::f64::consts::PI));
    let turned = |p: &Vec3| if version == 0 { about * *p } else { *p };
    let offsets = own.offsets().iter().map(turned).collect();
    let rig = Skeleton::new(own.names().to_vec(), own.parents().to_vec(), offsets, vec![]).unwrap();
    let rest = Clip::new(Arc::new(rig), 30.0, vec![Vec3::new(0.0, 0.98, 0.0)], vec![Quat::IDENTITY; 24]).unwrap();
    let (mut json, binary) = parts(&glb::to_bytes(&[("body", &rest)]).unwrap());
    json["asset"]["generator"] = json!("another");
    let of = |id: usize| json!({"node": 1 + id});
    let named = bones().iter().filter_map(|bone| Some((bone.name.clone(), of(bone.smpl_id?))));
    json["extensions"] = match version {
        0 => {
            let mut listed: Vec<Value> = named.map(|(name, of)| json!({"bone": name, "node": of["node"]})).collect();
            listed.push(json!({"bone": "jaw", "node": -1}));
            json!({"VRM": {"specVersion": "0.0", "humanoid": {"humanBones": listed}}})
        }
        _ => json!({"VRMC_vrm": {"specVersion": "1.0", "humanoid": {"humanBones": named.collect::<Map<_, _>>()}}}),
    };
    glb_of(&json, &binary)
}

#[test]
fn an_avatar_is_animated_as_it_stands() {
    for version in [0, 1] {
        let like = read("hero.vrm", &avatar(version));
        assert_eq!(like.found().map(|found| found.by), Some(FoundBy::File));
        let rig = crate::convert::TargetRig::of_motion(like).unwrap();
        let options = crate::convert::ConvertOptions { rig: Some(rig), ..Default::default() };
        let motion = crate::convert::convert(dance(), &options).unwrap();
        let floor = format::floor_height(&motion).unwrap();
        let bytes = bytes_of(Path::new("x.vrma"), &motion).unwrap();
        let (document, _) = parts(&bytes);
        let hips: [f64; 3] = serde_json::from_value(document["nodes"][0]["translation"].clone()).unwrap();
        assert!(Vec3::from_array(hips).distance(Vec3::new(0.0, 0.98, 0.0)) < 1e-6, "{hips:?}");
        let again = read("x.vrma", &bytes);
        // the soles of its mesh are on the floor, and not at 0 as VRM has it
        let sole_m = 0.98 - motion.humanoid().unwrap().feet().unwrap().pelvis_m;
        assert!(sole_m < -0.005, "{sole_m}");
        assert_same_places(&again.clip, &motion.clip, floor - sole_m);
        // of its T-pose, left is +x, whichever way the avatar looks
        let left = again.clip.skeleton().find("left_shoulder").unwrap();
        assert!(again.clip.skeleton().offsets()[left].x > 0.05, "VRM {version}");
    }
}

#[test]
fn a_vrm_is_written_only_with_an_animation_that_is_embedded() {
    let rig = crate::convert::TargetRig::of_motion(read("hero.vrm", &avatar(1))).unwrap();
    let options = crate::convert::ConvertOptions { rig: Some(rig), ..Default::default() };
    let motion = crate::convert::convert(dance(), &options).unwrap();
    let out = Path::new("x.vrm");
    let said = message(bytes_of(out, &motion));
    assert!(said.contains("write a .vrma") && said.contains("embed"), "{said}");
    let embedded = bytes_of(out, &motion.clone().embedded().unwrap()).unwrap();
    assert_eq!(embedded, bytes_of(Path::new("x.glb"), &motion).unwrap());
    let (document, _) = parts(&embedded);
    assert_eq!(document["animations"][0]["name"], "x");
    let plain = dance();
    assert!(message(bytes_of(out, &plain)).contains("a .vrm is an avatar"));
    assert!(message(plain.embedded()).contains("one on that of a .vrm with a mesh"));
    assert!(Format::WRITTEN.iter().all(|name| *name != "vrm"));
}
