use super::*;
use crate::{Clip, Quat, Skeleton, Vec3, smpl, synth};
use std::sync::Arc;

fn dance() -> Clip {
    synth::corpus(3, 1, 2.0, 30.0).unwrap().remove(0).clip
}

fn read_back(bytes: &[u8]) -> Motion {
    read(Path::new("a.glb"), bytes, &ReadOptions::default()).unwrap()
}

#[test]
fn what_we_write_comes_back() {
    let clip = dance();
    let again = read_back(&crate::format::glb::to_bytes(&[("dance", &clip)]).unwrap());
    assert_eq!(again.warnings, []);
    assert_eq!((again.clip.frames(), again.clip.fps()), (clip.frames(), 30.0));
    assert_eq!(again.clip.skeleton().names(), clip.skeleton().names());
    for (a, b) in again.clip.positions().iter().zip(clip.positions()) {
        assert!(a.distance(b) < 1e-5, "{a} {b}");
    }
}

#[test]
fn of_several_figures_one_is_read() {
    let (long, short) = (dance(), dance().slice(0..20));
    let bytes = crate::format::glb::to_bytes(&[("one", &short), ("two", &long)]).unwrap();
    let kinds: Vec<_> = read_back(&bytes).warnings.iter().map(|w| w.kind).collect();
    assert_eq!(kinds, ["several_roots"]);
    let options = ReadOptions { root: Some("nobody".into()), ..Default::default() };
    let e = read(Path::new("a.glb"), &bytes, &options).unwrap_err().to_string();
    assert!(e.contains("no figure nobody") && e.contains("one of one, two"), "{e}");
    let options = ReadOptions { root: Some("one".into()), ..Default::default() };
    assert_eq!(read(Path::new("a.glb"), &bytes, &options).unwrap().clip.frames(), short.frames());
}

/// `(json, binary)` as a GLB.
fn glb(json: &serde_json::Value, binary: &[u8]) -> Vec<u8> {
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let chunk = |kind: &[u8; 4], bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes()[..], kind, bytes].concat();
    let chunks = [chunk(b"JSON", &json), chunk(b"BIN\0", binary)].concat();
    [&b"glTF"[..], &2u32.to_le_bytes(), &(12 + chunks.len() as u32).to_le_bytes(), &chunks].concat()
}

/// A figure of two joints below a node of scale 0.01, bound in centimetres, with keys that are left out where nothing turns.
fn reduced() -> (serde_json::Value, Vec<u8>) {
    let times: Vec<f32> = [0.0, 1.0, 2.0, 6.0, 12.0].iter().map(|f| f / 24.0).collect();
    let turns: Vec<f32> =
        [0.0f32, 0.1, 0.2, 0.6, 1.2].iter().flat_map(|a| [0.0, 0.0, (a / 2.0).sin(), (a / 2.0).cos()]).collect();
    let bind = |y: f32| [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., -y, 0., 1.];
    let binds: Vec<f32> = [bind(0.0), bind(40.0)].concat();
    let binary = [times, turns, binds].concat().iter().flat_map(|x| x.to_le_bytes()).collect();
    let json = serde_json::json!({
        "asset": {"version": "2.0"}, "buffers": [{"byteLength": 228}],
        "nodes": [{"name": "armature", "scale": [0.01, 0.01, 0.01], "children": [1]},
                  {"name": "hip", "children": [2]}, {"name": "knee", "translation": [0.0, 40.0, 0.0]}],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": 2}],
        "bufferViews": [{"buffer": 0, "byteLength": 20}, {"buffer": 0, "byteOffset": 20, "byteLength": 80},
                        {"buffer": 0, "byteOffset": 100, "byteLength": 128}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 5, "type": "SCALAR"},
                      {"bufferView": 1, "componentType": 5126, "count": 5, "type": "VEC4"},
                      {"bufferView": 2, "componentType": 5126, "count": 2, "type": "MAT4"}],
        "animations": [{"samplers": [{"input": 0, "output": 1}], "channels": [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}]}],
    });
    (json, binary)
}

#[test]
fn left_out_keys_and_scaled_armatures() {
    let (json, binary) = reduced();
    let clip = read_back(&glb(&json, &binary)).clip;
    assert_eq!((clip.frames(), clip.fps(), clip.joints()), (13, 24.0, 2));
    assert!(clip.skeleton().offsets()[1].distance(Vec3::Y * 0.4) < 1e-6, "{:?}", clip.skeleton().offsets());
    for f in 0..13 {
        let turned = Quat::from_rotation_z(0.1 * f as f64);
        assert!(clip.global_pose(f).positions[1].distance(turned * (Vec3::Y * 0.4)) < 1e-6, "{f}");
    }
}

#[test]
fn what_we_write_keeps_its_rate() {
    for fps in [23.976, 29.97, 59.94, 119.88, 30.0, 239.0] {
        let clip = dance().with_fps(fps).unwrap();
        let again = read_back(&crate::format::glb::to_bytes(&[("dance", &clip)]).unwrap());
        assert_eq!((again.clip.frames(), again.warnings), (clip.frames(), vec![]), "{fps}");
        assert!((again.clip.fps() / fps - 1.0).abs() < 2e-6, "{fps}: {}", again.clip.fps());
    }
}

#[test]
fn uneven_keys_are_sampled_in_their_seconds() {
    let (json, mut binary) = reduced();
    for (bytes, time) in binary.chunks_mut(4).zip([0.0f32, 0.31, 0.5, 1.37, 2.0]) {
        bytes.copy_from_slice(&time.to_le_bytes());
    }
    let at = |fps_source| {
        let options = ReadOptions { fps_source, ..Default::default() };
        read(Path::new("a.glb"), &glb(&json, &binary), &options).unwrap()
    };
    let (own, given) = (at(None), at(Some(60.0)));
    assert_eq!((own.clip.frames(), own.clip.fps(), own.warnings[0].kind), (61, 30.0, "rate_assumed"));
    assert_eq!((given.clip.frames(), given.clip.fps(), given.warnings), (121, 60.0, vec![]));
    assert_eq!(own.clip.pose(30), given.clip.pose(60));
    // even keys are frames, whose rate may be a wrong one
    let (json, binary) = reduced();
    let options = ReadOptions { fps_source: Some(12.0), ..Default::default() };
    let slow = read(Path::new("a.glb"), &glb(&json, &binary), &options).unwrap().clip;
    assert_eq!((slow.frames(), slow.fps()), (13, 12.0));
}

#[test]
fn faults_say_what_is_wrong() {
    let said = |change: &dyn Fn(&mut serde_json::Value)| {
        let (mut json, binary) = reduced();
        change(&mut json);
        read(Path::new("a.glb"), &glb(&json, &binary), &ReadOptions::default()).unwrap_err().to_string()
    };
    type Change<'a> = &'a dyn Fn(&mut serde_json::Value);
    let changes: [(Change, &str); 10] = [
        (&|j| j["nodes"][2]["children"] = vec![1].into(), "one parent a node"),
        (&|j| j["nodes"][2]["children"] = vec![9].into(), "node 9"),
        (&|j| j["skins"][0]["joints"] = vec![7].into(), "node 7"),
        (&|j| j["accessors"][1]["count"] = 6.into(), "beyond its view"),
        (&|j| j["accessors"][1]["type"] = "VEC3".into(), "4 components"),
        (&|j| j["bufferViews"][0]["byteLength"] = 1_000_000.into(), "beyond its buffer"),
        (&|j| j["bufferViews"][1]["byteStride"] = 4.into(), "a stride of 4 bytes"),
        (
            &|j| j["accessors"][1] = serde_json::json!({"componentType": 5126, "count": 2_000_000, "type": "VEC4"}),
            "2000000 elements",
        ),
        (&|j| j["extensionsRequired"] = vec!["EXT_unheard_of"].into(), "EXT_unheard_of"),
        (&|j| j["asset"]["version"] = "1.0".into(), "version 2"),
    ];
    for (change, expected) in changes {
        let message = said(change);
        assert!(message.contains(expected) && message.contains("a.glb"), "{expected}: {message}");
    }
    for bytes in [&b""[..], b"glTF", b"glTF\x01\0\0\0", b"HIERARCHY"] {
        assert!(read(Path::new("a.glb"), bytes, &ReadOptions::default()).is_err());
    }
}

#[test]
fn cut_and_spoilt_files_do_not_panic() {
    let (json, binary) = reduced();
    let whole = glb(&json, &binary);
    for cut in 0..whole.len() {
        let _ = read(Path::new("a.glb"), &whole[..cut], &ReadOptions::default());
        let mut spoilt = whole.clone();
        spoilt[cut] ^= 0x15;
        let _ = read(Path::new("a.glb"), &spoilt, &ReadOptions::default());
    }
}

#[test]
fn a_figure_without_animation_is_one_frame() {
    let still = Clip::new(smpl::neutral(), 30.0, vec![Vec3::Y], vec![Quat::IDENTITY; 24]).unwrap();
    let motion = read_back(&crate::format::glb::to_bytes(&[("still", &still)]).unwrap());
    assert_eq!((motion.clip.frames(), motion.warnings[0].kind), (1, "no_animation"));
    let _: &Arc<Skeleton> = motion.clip.skeleton();
}
