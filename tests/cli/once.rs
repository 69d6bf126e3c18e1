//! The skeleton map of a file is searched once, whatever a command does with it.
//!
//! The count is of a process: each command runs in one of its own, which is this test binary started anew.

use super::support::save;
use kinelm_motion::retarget::Retarget;
use kinelm_motion::rig::{Humanoid, SkeletonMap, map_searches};
use kinelm_motion::{Clip, Skeleton, smpl, synth};
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;

/// The words of the command that a child runs.
const WORDS: &str = "KINELM_ONCE_WORDS";
/// What stands before the count in its output.
const COUNT: &str = "map searches: ";

#[test]
fn child() {
    let Ok(words) = std::env::var(WORDS) else { return };
    let code = kinelm::cli::run(std::iter::once("kinelm").chain(words.split_whitespace()).map(Into::into));
    println!("{COUNT}{}", map_searches());
    assert_eq!(code, 0, "{words}");
}

/// The map searches of a command in a folder, whose standard input is `input`.
fn searches(folder: &Path, words: &str, input: &str) -> u64 {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "once::child", "--nocapture"]).current_dir(folder);
    command.env(WORDS, words).env("XDG_CACHE_HOME", folder.join("cache"));
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    let count = out.lines().find_map(|line| line.split_once(COUNT)).unwrap_or_else(|| panic!("{words}: {out}{err}"));
    assert!(output.status.success(), "{words}: {out}{err}");
    count.1.parse().unwrap()
}

/// A dance of a larger body under Mixamo's names.
fn dance(seed: u64) -> Clip {
    let (map, body) = (SkeletonMap::builtin("mixamo").unwrap(), smpl::neutral());
    let names = (0..24).map(|id| map.joint(id).unwrap().to_owned()).collect();
    let offsets = body.offsets().iter().map(|offset| *offset * 1.15).collect();
    let rig = Arc::new(Skeleton::new(names, body.parents().to_vec(), offsets, vec![]).unwrap());
    let dance = synth::corpus(seed, 1, 4.0, 30.0).unwrap().remove(0).clip;
    Retarget::new(&Humanoid::with_map(&rig, &map), body).unwrap().to_rig(&dance).unwrap().raised(0.3)
}

#[test]
fn a_command_searches_a_file_s_map_once() {
    let dir = tempfile::tempdir().unwrap();
    for (name, seed) in [("a.bvh", 1), ("b.bvh", 2), ("c.json", 3)] {
        save(&dir.path().join(name), &dance(seed));
    }
    for (words, files) in [
        ("inspect a.bvh b.bvh c.json", 3),
        ("tokenize a.bvh --tokenizer ready --out corpus", 1),
        ("convert a.bvh smpl.bvh --onto smpl --joints all --fps 20", 1),
        ("convert a.bvh on-b.bvh --onto b.bvh", 2),
        ("convert c.json c.npz", 1),
        ("view a.bvh b.bvh --forced left_arm --out page.html", 2),
        ("filter a.bvh --feet --out filtered.bvh", 1),
        ("mirror a.bvh --out mirrored.bvh", 1),
        // and the dance, which is read back
        ("generate --prompt a.bvh --joints root,torso --rig prompt --seconds 2 --seed 1 --out dance.bvh", 2),
        ("generate --prompt a.bvh --free left_arm@1s:2s --seed 1 --out edit.bvh", 1),
    ] {
        assert_eq!(searches(dir.path(), words, ""), files, "{words}");
    }
}

#[cfg(feature = "studio")]
#[test]
fn the_studio_s_library_searches_a_file_s_map_once() {
    let dir = tempfile::tempdir().unwrap();
    save(&dir.path().join("a.bvh"), &dance(1));
    let limits = r#"{"memory": 4294967296, "seconds": 120, "file": 2147483648}"#;
    let job = |work: &str| format!(r#"{{"file": "a.bvh", "work": {work}, "out": "answer", "limits": {limits}}}"#);
    let facts = job(r#"{"Facts": {"reading": {}, "convert": "converted.bvh"}}"#);
    assert_eq!(searches(dir.path(), "studio-read", &facts), 1);
    let answer = std::fs::read_to_string(dir.path().join("answer")).unwrap();
    assert!(answer.contains("\"mixamo\""), "{answer}");
}
