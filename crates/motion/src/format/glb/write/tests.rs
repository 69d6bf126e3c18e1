//! Tests that parse the written bytes by hand.

use super::*;
use crate::synth;

/// The JSON document and the binary part.
fn parts(bytes: &[u8]) -> (Value, Vec<u8>) {
    let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((&bytes[..4], number(4), number(8)), (&b"glTF"[..], 2, bytes.len()));
    let text = number(12);
    assert_eq!((&bytes[16..20], &bytes[24 + text..28 + text], text % 4), (&b"JSON"[..], &b"BIN\0"[..], 0));
    assert_eq!(28 + text + number(20 + text), bytes.len());
    (serde_json::from_slice(&bytes[20..20 + text]).unwrap(), bytes[28 + text..].to_vec())
}

/// The floats of an accessor.
fn floats(document: &Value, binary: &[u8], accessor: &Value) -> Vec<f32> {
    let accessor = &document["accessors"][accessor.as_u64().unwrap() as usize];
    let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let [from, length] = ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap() as usize);
    binary[from..from + length].chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
}

#[test]
fn nodes_and_keys_are_the_clip() {
    let clip = synth::corpus(4, 1, 2.0, 20.0).unwrap().remove(0).clip;
    let (document, binary) = parts(&to_bytes(&[("one", &clip), ("two", &clip)]).unwrap());
    assert_eq!(document["nodes"].as_array().unwrap().len(), 2 * 26);
    assert_eq!(document["scenes"][0]["nodes"], json!([0, 25, 26, 51]));
    let animation = &document["animations"][0];
    let mut turned = 0;
    for channel in animation["channels"].as_array().unwrap() {
        let sampler = &animation["samplers"][channel["sampler"].as_u64().unwrap() as usize];
        let times = floats(&document, &binary, &sampler["input"]);
        assert_eq!((times.len(), times[7]), (clip.frames(), 0.35));
        let numbers = floats(&document, &binary, &sampler["output"]);
        let joint = channel["target"]["node"].as_u64().unwrap() as usize % 26 - 1;
        for f in 0..clip.frames() {
            if channel["target"]["path"] == "translation" {
                assert_eq!(numbers[3 * f..3 * f + 3], place(clip.root()[f]));
            } else {
                let [x, y, z, w] = [0, 1, 2, 3].map(|i| f64::from(numbers[4 * f + i]));
                let distance = crate::rotation::angle_between(Quat::from_xyzw(x, y, z, w), clip.pose(f)[joint]);
                assert!(distance < 1e-6, "joint {joint}, frame {f}: {distance}");
                turned += 1;
            }
        }
    }
    assert!(turned > 20 * clip.frames());
    let skin = &document["skins"][1];
    assert_eq!((skin["joints"][0].as_u64(), skin["joints"].as_array().unwrap().len()), (Some(27), 24));
    // inverse bind matrices take each joint of the rest pose to the origin
    let matrices = floats(&document, &binary, &skin["inverseBindMatrices"]);
    let rest = GlobalPose::new(clip.skeleton(), Vec3::ZERO, &[Quat::IDENTITY; 24]);
    for (matrix, at) in matrices.chunks(16).zip(&rest.positions) {
        assert_eq!(matrix[12..15], place(-*at));
    }
}

#[test]
fn what_stands_still_has_no_keys_and_what_is_empty_is_refused() {
    let clip = synth::corpus(4, 1, 1.0, 20.0).unwrap().remove(0).clip;
    let (document, _) = parts(&to_bytes(&[("still", &clip.slice(3..4))]).unwrap());
    assert!(document.get("animations").is_none());
    assert!(to_bytes(&[]).unwrap_err().to_string().contains("no clips"));
    assert!(to_bytes(&[("none", &clip.slice(0..0))]).unwrap_err().to_string().contains("none: 0 frames"));
}
