//! kinelm's own model: what a user has who gives no run.

use super::support::{kinelm_in, read, save};
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::{Motion, synth};
use predicates::prelude::*;
use predicates::str::contains;
use std::fs;
use std::path::Path;

/// A call in a folder whose cache is its own.
fn call(folder: &Path, words: &str) -> assert_cmd::Command {
    let mut command = kinelm_in(folder, words);
    command.env("XDG_CACHE_HOME", folder.join("cache"));
    command
}

fn with_a_dance() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    save(&dir.path().join("mine.bvh"), &synth::corpus(3, 1, 4.0, 30.0).unwrap()[0].clip);
    dir
}

#[test]
fn it_dances_to_a_clip_without_a_run() {
    let dir = with_a_dance();
    let words = "generate --prompt mine.bvh --joints root,torso,right_arm --seconds 2";
    let said = call(dir.path(), &format!("{words} --out a.bvh")).assert().success();
    said.stderr(contains("no --run: the ready model dances").and(contains("CARD.md")));
    assert_eq!(read(&dir.path().join("a.bvh")).frames(), 60);
    let named = call(dir.path(), &format!("{words} --run ready --out b.bvh")).assert().success();
    named.stderr(contains("no --run").not());
    assert_eq!(fs::read(dir.path().join("a.bvh")).unwrap(), fs::read(dir.path().join("b.bvh")).unwrap());
    call(dir.path(), "again a.bvh.kinelm.json --out c.bvh").assert().success();
    assert_eq!(fs::read(dir.path().join("a.bvh")).unwrap(), fs::read(dir.path().join("c.bvh")).unwrap());
    // without a corpus of real dances the best is chosen by what the run knows of them
    let best = call(dir.path(), &format!("{words} --best 2 --out e.bvh")).assert().success();
    best.stderr(contains("what the run knows of its train clips").and(contains("of 2, score")));
    // a folder of that name is a run as any other
    fs::create_dir(dir.path().join("ready")).unwrap();
    let own = call(dir.path(), &format!("{words} --run ready --out d.bvh")).assert().failure();
    own.stderr(contains("no config.toml"));
}

#[test]
fn it_dances_along_a_path() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("walk.csv"), "seconds,x,z\n0,1,0\n1,1,1\n2,2,1\n").unwrap();
    let along = call(dir.path(), "generate --path walk.csv --fps 20 --out a.bvh").assert().success();
    along.stderr(contains("floor").not().and(contains("off its path by")));
    let clip = read(&dir.path().join("a.bvh"));
    for (frame, [x, z]) in [(0, [1.0, 0.0]), (20, [1.0, 1.0]), (40, [2.0, 1.0])] {
        let at = clip.root()[frame];
        assert!((at.x - x).hypot(at.z - z) < 0.15, "{frame}: {at}");
    }
    assert_eq!(clip.frames(), 41);
    call(dir.path(), "again a.bvh.kinelm.json --out b.bvh").assert().success();
    assert_eq!(fs::read(dir.path().join("a.bvh")).unwrap(), fs::read(dir.path().join("b.bvh")).unwrap());
    // what a path doesn't give, and a part of the root for a time
    let more = call(dir.path(), "generate --path walk.csv --prompt a.bvh --joints root --out c.bvh").assert().failure();
    more.stderr(contains("leave it to the path"));
    let for_a_time = call(dir.path(), "generate --prompt a.bvh --given path@0s:1s --out c.bvh").assert().failure();
    for_a_time.stderr(contains("path, height and tilt are given throughout"));
}

#[test]
fn a_dance_goes_into_the_file_of_a_character() {
    let dir = tempfile::tempdir().unwrap();
    let clip = synth::corpus(3, 1, 2.0, 30.0).unwrap().remove(0).clip;
    let bytes = format::to_bytes(Path::new("hero.glb"), &Motion::new("hero.glb", clip)).unwrap();
    // made by another program, a mesh is a character's
    let at = bytes.windows(7).position(|w| w == b"kinelm ").unwrap();
    let bytes = [&bytes[..at], b"a tool ", &bytes[at + 7..]].concat();
    fs::write(dir.path().join("hero.glb"), &bytes).unwrap();
    let said = call(dir.path(), "generate --onto hero.glb --seconds 1 --label genre=salsa --out salsa.glb").assert();
    said.success().stderr(contains("salsa.glb: 30 frames"));
    let taken = |take: &str| {
        let options = ReadOptions { take: Some(take.into()), ..ReadOptions::default() };
        format::read(&dir.path().join("salsa.glb"), &options).unwrap().clip.frames()
    };
    assert_eq!((taken("dance"), taken("salsa")), (60, 30));
    let made = fs::read(dir.path().join("salsa.glb")).unwrap();
    let buffer = |bytes: &[u8]| {
        let json = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        bytes[28 + json..].to_vec()
    };
    assert!(buffer(&made).starts_with(&buffer(&bytes)) && made.len() > bytes.len());
    // a name that is taken is said before anything is sampled
    fs::create_dir(dir.path().join("new")).unwrap();
    let taken = call(dir.path(), "generate --onto hero.glb --seconds 1 --out new/dance.glb").assert().failure();
    taken.stderr(contains("an animation of that name is there").and(contains("continues from").not()));
    call(dir.path(), "generate --onto hero.glb --seconds 1 --out new/dance.glb --replace-animation dance")
        .assert()
        .success();
    let other = call(dir.path(), "convert salsa.glb salsa.glb new/two.glb --onto hero.glb").assert().failure();
    other.stderr(contains("its mesh would be left out"));
}

#[test]
fn its_tokenizer_is_taken_by_name() {
    let dir = with_a_dance();
    let words = call(dir.path(), "tokenizer text mine.bvh --tokenizer ready").assert().success();
    fs::write(dir.path().join("words.txt"), &words.get_output().stdout).unwrap();
    call(dir.path(), "tokenizer decode words.txt back.bvh --tokenizer ready").assert().success();
    assert!(read(&dir.path().join("back.bvh")).frames() >= 80);
    call(dir.path(), "tokenize mine.bvh --tokenizer ready --out corpus").assert().success();
    // a file of that name is a tokenizer as any other
    fs::write(dir.path().join("ready"), "{}").unwrap();
    call(dir.path(), "tokenizer text mine.bvh --tokenizer ready").assert().failure();
}

#[test]
fn without_a_folder_for_it_the_call_says_what_to_do() {
    let dir = with_a_dance();
    fs::write(dir.path().join("cache"), "a file").unwrap();
    let said = call(dir.path(), "generate --seconds 1 --out a.bvh").assert().failure();
    said.stderr(contains("cache"));
    assert!(!dir.path().join("a.bvh").exists());
}

#[test]
fn the_demo_dances_at_once() {
    let dir = tempfile::tempdir().unwrap();
    call(dir.path(), "demo").assert().success().stdout(contains("# kinelm demo, seed 1"));
    for name in ["free.bvh", "follows.bvh", "gap.bvh", "loop.bvh", "page.html", "report.md"] {
        assert!(dir.path().join("demo").join(name).exists(), "{name}");
    }
    let page = fs::read_to_string(dir.path().join("demo/page.html")).unwrap();
    assert!(page.contains("by itself; orange is what the next one follows"));
    let (free, gap) = (read(&dir.path().join("demo/free.bvh")), read(&dir.path().join("demo/gap.bvh")));
    assert_eq!((free.frames(), free.fps()), (600, 30.0));
    assert_eq!(gap.slice(0..225), free.slice(0..225), "before the gap nothing changes");
    assert_ne!(gap.slice(248..292), free.slice(248..292));
    call(dir.path(), "demo").assert().code(2).stderr(contains("--force"));
}

#[test]
fn it_learns_a_users_dances() {
    let dir = tempfile::tempdir().unwrap();
    for (i, dance) in synth::corpus(5, 8, 4.0, 20.0).unwrap().into_iter().enumerate() {
        save(&dir.path().join(format!("dances/{i}.bvh")), &dance.clip);
    }
    let said = call(dir.path(), "tune dances --run mine --steps 3").assert().success();
    said.stdout(contains("before   after   real").and(contains("steps that slide")));
    assert!(dir.path().join("mine-corpus/corpus.json").exists());
    call(dir.path(), "generate --run mine --seconds 1 --out a.bvh").assert().success();
    call(dir.path(), "tune dances --run mine --steps 3").assert().failure();
}
