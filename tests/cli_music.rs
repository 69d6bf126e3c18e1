//! `kinelm music`, as a user runs it.

use assert_cmd::Command;
use kinelm_music::synth::{Score, Style, render};
use kinelm_music::wav;
use predicates::prelude::*;
use std::fs;
use std::path::{Path, PathBuf};

fn kinelm(dir: &Path) -> Command {
    let mut command = Command::cargo_bin("kinelm").unwrap();
    command.current_dir(dir);
    command
}

/// A piece of 100 beats a minute.
fn song(dir: &Path) -> PathBuf {
    let beats_s = (0..45).map(|i| 0.4 + 0.6 * f64::from(i)).collect();
    let score = Score { style: Style::Pop, beats_s, downbeat: 0, seconds: 28.0, seed: 1 };
    let path = dir.join("song.wav");
    fs::write(&path, wav::bytes(&render(&score, 22_050).unwrap(), 22_050)).unwrap();
    path
}

#[test]
fn a_song_is_told_tapped_and_drawn() {
    let dir = tempfile::tempdir().unwrap();
    song(dir.path());
    let told = kinelm(dir.path()).args(["music", "inspect", "song.wav"]).assert().success();
    let text = String::from_utf8(told.get_output().stdout.clone()).unwrap();
    assert!(text.contains("0:28.00, 22050 Hz, 1 channel, wave") && text.contains(", 100."), "{text}");
    let line = kinelm(dir.path()).args(["music", "inspect", "song.wav", "--json"]).assert().success();
    let told: serde_json::Value = serde_json::from_slice(&line.get_output().stdout).unwrap();
    assert!((told["bpm"].as_f64().unwrap() - 100.0).abs() < 0.2 && told["rate"] == 22_050, "{told}");

    kinelm(dir.path()).args(["music", "beats", "song.wav", "--out", "b.txt"]).assert().success().stdout("");
    let text = fs::read_to_string(dir.path().join("b.txt")).unwrap();
    let found = kinelm::music::beats::parse(Path::new("b.txt"), &text).unwrap();
    let near = |t: f64| found.iter().any(|f| (f - t).abs() < 0.03);
    assert!((0..45).filter(|i| near(0.4 + 0.6 * f64::from(*i))).count() > 42, "{found:?}");
    kinelm(dir.path()).args(["music", "beats", "song.wav"]).assert().success().stdout(text);
    // its own is replaced
    kinelm(dir.path()).args(["music", "beats", "song.wav", "--out", "b.txt"]).assert().success();

    kinelm(dir.path()).args(["music", "inspect", "song.wav", "--out", "s.svg", "--at", "5"]).assert().success();
    let svg = fs::read_to_string(dir.path().join("s.svg")).unwrap();
    for title in ["Onset strength, and the beats", "Pitch classes", "Tempo"] {
        assert!(svg.contains(title), "{title}");
    }
}

#[test]
fn nothing_of_the_users_is_written_over_and_what_is_wrong_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let song = song(dir.path());
    let before = fs::read(&song).unwrap();
    fs::write(dir.path().join("mine.txt"), "dear\n").unwrap();
    let said = |args: &[&str], code: i32, what: &str| {
        kinelm(dir.path()).args(args).assert().code(code).stdout("").stderr(predicate::str::contains(what));
    };
    said(&["music", "beats", "song.wav", "--out", "mine.txt"], 2, "mine.txt is there already, with other contents");
    said(&["music", "beats", "song.wav", "--out", "song.wav"], 2, "expected a name ending in .txt");
    said(&["music", "inspect", "song.wav", "--out", "s.gif"], 2, "expected a name ending in .png or .svg");
    said(&["music", "inspect", "song.wav", "--out", "s.png", "--at", "99"], 1, "song.wav: nothing to draw from 99");
    said(&["music", "beats", "mine.txt"], 1, "mine.txt: unknown kind of file: found no sound");
    said(&["music", "inspect", "none.mp3"], 1, "none.mp3");
    assert_eq!(fs::read(dir.path().join("mine.txt")).unwrap(), b"dear\n");
    assert_eq!(fs::read(&song).unwrap(), before);
}

#[test]
fn a_page_has_its_music() {
    let dir = tempfile::tempdir().unwrap();
    song(dir.path());
    let dance = kinelm_motion::synth::corpus(1, 1, 4.0, 30.0).unwrap().remove(0);
    let path = dir.path().join("d.bvh");
    let motion = kinelm::generate::prompt::on_model_rig(&path, dance.clip);
    kinelm_motion::format::write(&path, &motion).unwrap();
    let view = |more: &[&str]| {
        let mut call = kinelm(dir.path());
        call.args(["view", "d.bvh", "--out", "p.html", "--music", "song.wav"]).args(more);
        call.assert()
    };
    view(&["--music-from", "2.5s"]).success().stderr(predicate::str::contains("song.wav: 45 beats"));
    let page = fs::read_to_string(dir.path().join("p.html")).unwrap();
    assert!(
        page.contains("data:audio/wav;base64,UklGR") && page.contains("\"from\":2.5") && page.contains("class Player")
    );
    view(&["--music-from", "28"]).code(2).stderr(predicate::str::contains("song.wav ends at 28.00 s; give less"));
    view(&["--music-from", "soon"]).code(2).stderr(predicate::str::contains("expected seconds, such as 12.5s"));
    kinelm(dir.path()).args(["view", "d.bvh", "--out", "q.html"]).assert().success();
    assert!(!fs::read_to_string(dir.path().join("q.html")).unwrap().contains("class Player"));
}
