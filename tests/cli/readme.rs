//! The first block of README.md as a stranger runs it: eight loose files, no labels.

use assert_cmd::Command;
use kinelm_motion::{Motion, format, synth};
use predicates::str::contains;
use std::fs;
use std::path::Path;

const README: &str = include_str!("../../README.md");
const MARK: &str = "<!-- tests/cli/readme.rs runs this block -->\n```sh\n";

/// The block's calls, without comments.
fn calls() -> Vec<Vec<&'static str>> {
    let block = README.split_once(MARK).expect("README has its marked block").1.split("```").next().unwrap();
    let words = |line: &'static str| line.split('#').next().unwrap_or_default().split_whitespace().collect();
    block.lines().map(words).filter(|call: &Vec<&str>| !call.is_empty()).collect()
}

/// Eight dances in one folder, under names that say nothing.
fn loose_files(folder: &Path) {
    fs::create_dir(folder).unwrap();
    for (i, dance) in synth::corpus(5, 8, 4.0, 30.0).unwrap().into_iter().enumerate() {
        let path = folder.join(format!("{:02}.bvh", i + 1));
        let motion = Motion::new(&path, dance.clip);
        format::write(&path, &motion).unwrap();
    }
}

#[test]
fn the_first_block_runs_on_eight_loose_files() {
    let dir = tempfile::tempdir().unwrap();
    loose_files(&dir.path().join("dances"));
    let calls = calls();
    assert_eq!(calls.len(), 5, "{calls:?}");
    for call in calls {
        let (program, args) = call.split_first().unwrap();
        assert_eq!(*program, "kinelm", "{call:?}");
        let mut command = Command::cargo_bin("kinelm").unwrap();
        command.current_dir(dir.path()).env("NO_COLOR", "1").args(args);
        if args[0] == "pretrain" {
            command.args(["--steps", "20"]);
        }
        let done = command.assert().success();
        match args[0] {
            // by their hashes all are for training
            "tokenize" => done.stderr(contains("left a part empty: 05 is test, 06 is valid")),
            "pretrain" => done.stderr(contains("validation: ")),
            _ => done,
        };
    }
    let dance = format::read(&dir.path().join("dance.bvh"), &Default::default()).unwrap();
    let prompt = format::read(&dir.path().join("dances/03.bvh"), &Default::default()).unwrap();
    assert_eq!(dance.clip.skeleton().names(), prompt.clip.skeleton().names());
    assert!(fs::read_to_string(dir.path().join("page.html")).unwrap().contains("03"));
}
