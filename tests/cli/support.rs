//! What several modules of tests share: calls of the program, and motion files.

use assert_cmd::Command;
use kinelm_motion::{Clip, Motion, format};
use serde_json::Value;
use std::path::Path;

/// A call of the program.
pub fn kinelm() -> Command {
    let mut command = Command::cargo_bin("kinelm").unwrap();
    command.env("NO_COLOR", "1");
    command
}

/// A call in a folder, its words separated by spaces.
pub fn kinelm_in(folder: &Path, words: &str) -> Command {
    let mut command = kinelm();
    command.current_dir(folder).args(words.split_whitespace());
    command
}

/// What a call prints that succeeds.
pub fn stdout(command: &mut Command) -> String {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// The JSON that a call prints.
pub fn json(command: &mut Command) -> Value {
    serde_json::from_str(&stdout(command)).unwrap()
}

/// Writes a clip to a file, whose folder is made.
pub fn save(path: &Path, clip: &Clip) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let motion = Motion::new(path, clip.clone());
    format::write(path, &motion).unwrap();
}

/// The clip of a file.
pub fn read(path: &Path) -> Clip {
    format::read(path, &format::ReadOptions::default()).unwrap().clip
}
