//! `kinelm music`, as a user runs it.

use assert_cmd::Command;
use kinelm_motion::{Motion, format, synth};
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
    let found = kinelm::corpus::music::beats::parse(Path::new("b.txt"), &text).unwrap();
    let near = |t: f64| found.iter().any(|f| (f - t).abs() < 0.03);
    assert!((0..45).filter(|i| near(0.4 + 0.6 * f64::from(*i))).count() > 42, "{found:?}");
    kinelm(dir.path()).args(["music", "beats", "song.wav"]).assert().success().stdout(text.clone());
    // its own is replaced, and not what somebody has corrected
    fs::copy(dir.path().join("b.txt"), dir.path().join("c.txt")).unwrap();
    kinelm(dir.path()).args(["music", "render", "--out", "other.wav"]).assert().success();
    kinelm(dir.path()).args(["music", "beats", "other.wav", "--out", "c.txt"]).assert().success();
    fs::write(dir.path().join("c.txt"), text.replacen('\n', "\n0.001\n", 1)).unwrap();
    let corrected = kinelm(dir.path()).args(["music", "beats", "other.wav", "--out", "c.txt"]).assert().code(2);
    corrected.stderr(predicate::str::contains("c.txt is there already, with other contents"));

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
    said(&["music", "inspect", "song.wav", "--out", "s.png", "--at", "99"], 1, "song.wav: the stretch to draw is 99");
    said(&["music", "beats", "mine.txt"], 1, "mine.txt: unknown kind of file: found no sound");
    said(&["music", "inspect", "none.mp3"], 1, "none.mp3");
    assert_eq!(fs::read(dir.path().join("mine.txt")).unwrap(), b"dear\n");
    assert_eq!(fs::read(&song).unwrap(), before);
}

#[test]
fn a_piece_is_rendered_at_its_tempo_and_heard() {
    let dir = tempfile::tempdir().unwrap();
    let call = |words: &str| kinelm(dir.path()).args(words.split_whitespace()).assert();
    let words = "music render --bpm 104 --seconds 20 --style disco --out a.wav";
    call(words).success().stderr(predicate::str::contains("a.wav: disco, 35 beats, 104 a minute"));
    let before = fs::read(dir.path().join("a.wav")).unwrap();
    call(words).success();
    assert!(fs::read(dir.path().join("a.wav")).unwrap() == before);
    call("music beats a.wav").success().stdout(predicate::str::contains("# made by kinelm: beats of a.wav"));
    let heard = kinelm_music::beat::beats(&dir.path().join("a.wav")).unwrap().bpm().unwrap();
    assert!((heard - 104.0).abs() < 1.0, "{heard}");
    call("music render --seed 2 --out a.wav").code(2).stderr(predicate::str::contains("a.wav is there already"));
    call("music render --bpm 5 --out b.wav").code(2).stderr(predicate::str::contains("expected 20 to 400 beats"));
    call("music render --style polka --out b.wav")
        .code(2)
        .stderr(predicate::str::contains("pop, march, lounge, disco"));
    call("music render --out b.mp3").code(2).stderr(predicate::str::contains("expected a name ending in .wav"));
    for seconds in ["9999", "1e12", "0.1", "inf"] {
        let words = format!("music render --seconds {seconds} --out b.wav");
        call(&words).code(2).stderr(predicate::str::contains("expected 1 to 3600 seconds"));
    }
}

#[test]
fn both_tempi_are_said_and_a_range_chooses() {
    let dir = tempfile::tempdir().unwrap();
    let call = |words: &str| kinelm(dir.path()).args(words.split_whitespace()).assert();
    for (bpm, style, range) in [(160, "pop", "120:200"), (200, "march", "150:300"), (60, "pop", "45:80")] {
        call(&format!("music render --bpm {bpm} --seconds 20 --style {style} --out {bpm}.wav")).success();
        let inspected = call(&format!("music inspect {bpm}.wav --json")).success();
        let found: serde_json::Value = serde_json::from_slice(&inspected.get_output().stdout).unwrap();
        let tempi = found["tempi"].as_array().unwrap();
        let is_true = |x: &serde_json::Value| (x.as_f64().unwrap() / f64::from(bpm) - 1.0).abs() < 0.02;
        assert!(tempi.iter().any(|tempo| is_true(&tempo["bpm"])), "{bpm}: {found}");
        let text = String::from_utf8(call(&format!("music inspect {bpm}.wav")).success().get_output().stdout.clone());
        let text = text.unwrap();
        assert!(text.contains("  tempo ") && text.contains("%), or "), "{text}");
        let inspected = call(&format!("music inspect {bpm}.wav --json --bpm-range {range}")).success();
        let found: serde_json::Value = serde_json::from_slice(&inspected.get_output().stdout).unwrap();
        assert!(is_true(&found["bpm"]), "{bpm}: {found}");
        let beats = call(&format!("music beats {bpm}.wav --bpm-range {range}")).success();
        let lines = String::from_utf8(beats.get_output().stdout.clone()).unwrap().lines().count();
        assert!(lines.abs_diff(bpm as usize / 3) < 6, "{bpm}: {lines} lines");
    }
    for wrong in ["200:120", "120", "a:b", "5:90"] {
        call(&format!("music beats 60.wav --bpm-range {wrong}")).code(2).stderr(predicate::str::contains("120:200"));
    }
}

#[test]
fn a_page_has_its_music() {
    let dir = tempfile::tempdir().unwrap();
    song(dir.path());
    let dance = kinelm_motion::synth::corpus(1, 1, 4.0, 30.0).unwrap().remove(0);
    let path = dir.path().join("d.bvh");
    let motion = Motion::new(&path, dance.clip);
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
    let says = |page: &str| page.split("\"says\":\"").nth(1).unwrap().split('"').next().unwrap().to_owned();
    let all = says(&page);
    assert!(all.contains(" of 7 beats hit, by chance "), "{all}");
    view(&["--music-from", "2.5s", "--lag", "0.17"]).success();
    let legs = says(&fs::read_to_string(dir.path().join("p.html")).unwrap());
    assert!(legs.contains(" beats hit, by chance ") && legs != all, "{legs} and {all}");
    view(&["--lag", "0.7"]).code(2).stderr(predicate::str::contains("expected a part of a beat, -0.5 to 0.5"));
    let deaf = ["view", "d.bvh", "--out", "q.html", "--lag", "0"];
    kinelm(dir.path()).args(deaf).assert().code(2).stderr(predicate::str::contains("--lag without music"));
    view(&["--music-from", "28"]).code(2).stderr(predicate::str::contains("song.wav ends at 28.00 s; give less"));
    view(&["--music-from", "soon"])
        .code(2)
        .stderr(predicate::str::contains("`soon` is no time; expected 2.5s, 2.5 or 40f"));
    kinelm(dir.path()).args(["view", "d.bvh", "--out", "q.html"]).assert().success();
    assert!(!fs::read_to_string(dir.path().join("q.html")).unwrap().contains("class Player"));
}

const CONFIG: &str = "[model]\narchitecture = \"two_level\"\nlayers = 1\nheads = 2\nwidth = 24\nwindow = 12\n\
                      music = \"beats\"\n[model.decoder]\nlayers = 1\nheads = 2\nwidth = 16\ncharacter_width = 4\n\
                      [train]\nbatch = 2\nsteps = 8\nwarmup = 1\nlearning_rate = 3e-3\neval_every = 4\n\
                      checkpoint_every = 4\ntable_rate = 3.0\n";

const FLAT: &str = r#"
[model]
layers = 1
heads = 2
width = 16
context = 128

[train]
batch = 2
steps = 3
conditions = ["tempo"]
eval_every = 0
checkpoint_every = 0
"#;

/// A call ends with this code, and says this.
fn said(dir: &Path, words: &str, code: i32, what: &str) {
    let text = predicate::str::contains(what);
    kinelm(dir).args(words.split_whitespace()).assert().code(code).stderr(text);
}

/// Dances with music of their names in a folder, a corpus that has heard it, and a run.
fn heard(dir: &Path) {
    fs::create_dir_all(dir.join("data")).unwrap();
    fs::create_dir_all(dir.join("songs")).unwrap();
    let dances = synth::corpus_at(3, &[90.0, 120.0, 100.0, 110.0], 6.0, 30.0).unwrap();
    let mut labels = "clip,split,music,music_from\n".to_owned();
    for (i, dance) in dances.iter().enumerate() {
        let path = dir.join(format!("data/{i}.bvh"));
        let motion = Motion::new(&path, dance.clip.clone());
        format::write(&path, &motion).unwrap();
        let samples = kinelm::corpus::music::synth::music(dance, 3, 22_050).unwrap();
        let later = [vec![0.0; 22_050], samples.clone()].concat();
        // one is named by a label and begins a second later, one has no music
        let (name, samples) = if i == 1 { ("named".into(), &later) } else { (i.to_string(), &samples) };
        if i != 2 {
            fs::write(dir.join(format!("songs/{name}.wav")), wav::bytes(samples, 22_050)).unwrap();
        }
        let split = ["train", "train", "train", "valid"][i];
        labels += &format!("{i},{split},{}\n", if i == 1 { "named.wav,1" } else { "," });
    }
    fs::write(dir.join("labels.csv"), labels).unwrap();
    fs::write(dir.join("c.toml"), CONFIG).unwrap();
    let call = |words: &str| {
        kinelm(dir).args(words.split_whitespace()).assert().success();
    };
    call("tokenizer fit data --labels labels.csv --out t.json");
    call("tokenize data --labels labels.csv --tokenizer t.json --out deaf");
    kinelm(dir)
        .args("tokenize data --labels labels.csv --tokenizer t.json --music songs --out corpus".split_whitespace())
        .assert()
        .success()
        .stderr(predicate::str::contains("songs: 3 clips of 4 have music"));
    let corpus = kinelm::corpus::Corpus::open(dir.join("corpus")).unwrap();
    let beats: Vec<&[f64]> = corpus.clips().iter().map(|clip| clip.beats_s()).collect();
    assert!(beats[2].is_empty());
    let near = |clip: usize| {
        let is = |t: &&f64| beats[clip].iter().any(|beat| (beat - **t).abs() < 0.04);
        dances[clip].beats_s.iter().filter(is).count() * 5 >= dances[clip].beats_s.len() * 4
    };
    assert!(near(0) && near(1) && near(3), "{beats:?}");
    call("pretrain --config c.toml --corpus corpus --run run");
}

#[test]
fn a_model_hears_dances_as_long_as_the_music_and_again() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    heard(dir);
    let song = song(dir);
    let said = |words: &str, code: i32, what: &str| said(dir, words, code, what);
    let frames = |file: &str| format::read(&dir.join(file), &Default::default()).unwrap().clip.frames();
    said("generate --run run --music song.wav --music-from 25.5s --out a.bvh", 0, "100.");
    assert_eq!(frames("a.bvh"), 75);
    said("generate --run run --music song.wav --frames 30 --guidance 2 --out b.bvh", 0, "");
    assert_eq!(frames("b.bvh"), 45);
    said("generate --run run --frames 50 --out free.bvh", 0, "");
    let bytes = |file: &str| fs::read(dir.join(file)).unwrap();
    assert!(bytes("a.bvh") != bytes("free.bvh"));
    // again, and not with other music
    let before = bytes("a.bvh");
    fs::remove_file(dir.join("a.bvh")).unwrap();
    said("again a.bvh.kinelm.json", 0, "");
    assert!(bytes("a.bvh") == before);
    fs::write(dir.join("other.wav"), wav::bytes(&render(&score(28.0), 22_050).unwrap(), 22_050)).unwrap();
    said("again a.bvh.kinelm.json --music other.wav --out c.bvh", 1, "other.wav: the music is SHA-256");
    // the page plays it, and the beats are those that it was made to
    said("view a.bvh --out page.html", 0, "song.wav: 45 beats, sounds for 2.5 s of the dance");
    assert!(fs::read_to_string(dir.join("page.html")).unwrap().contains("data:audio/wav;base64,"));
    said(
        "evaluate dance a.bvh --real corpus --music song.wav --music song.wav",
        2,
        "--music names 2 files for 1 dances; give one for all, or one for each",
    );
    for beats in ["", " --music song.wav --music-from 25.5s"] {
        let call = format!("evaluate dance a.bvh --real corpus{beats}");
        let text = kinelm(dir).args(call.split_whitespace()).assert().success();
        let text = String::from_utf8(text.get_output().stdout.clone()).unwrap();
        assert!(text.contains("all joints, on the beat") && text.contains("formula"), "{text}");
        assert_eq!(text.matches("\na.bvh").count(), 5, "{text}");
    }
    said("evaluate likelihood --run run --corpus corpus --split valid --conditions none", 0, "");
    // what can't be
    said(
        "generate --run run --music song.wav --seconds 40 --out d.bvh",
        1,
        "28.00 s of music after 0 s, expected 40.00 s",
    );
    said(
        "generate --run run --music song.wav --music-from 28s --out d.bvh",
        1,
        "a beginning at 28 s, expected 0 up to",
    );
    fs::write(dir.join("silence.wav"), wav::bytes(&vec![0.0; 60_000], 22_050)).unwrap();
    said("generate --run run --music silence.wav --out d.bvh", 1, "0 beats in 2.72 s of music, expected two or more");
    said("generate --run run --music no.wav --out d.bvh", 1, "no.wav");
    fs::write(dir.join("deaf.toml"), CONFIG.replace("music = \"beats\"\n", "")).unwrap();
    said("pretrain --config c.toml --corpus deaf --run no", 1, "no training clip of the corpora has any");
    said("pretrain --config deaf.toml --corpus deaf --run deaf-run", 0, "");
    let refused = "this model is not conditioned on music (model.music) or on its tempo (train.conditions); train one on a corpus";
    said("generate --run deaf-run --music song.wav --out d.bvh", 2, refused);
    // which can be added, and not taken away
    said("finetune --from deaf-run --config c.toml --corpus corpus --run fine --steps 2", 0, "");
    said("generate --run fine --music song.wav --frames 20 --out e.bvh", 0, "");
    let none = fs::read_to_string(dir.join("c.toml")).unwrap().replace("\"beats\"", "\"none\"");
    fs::write(dir.join("none.toml"), none).unwrap();
    said(
        "finetune --from run --config none.toml --corpus corpus --run worse --steps 2",
        1,
        "model.music is \"none\"; expected \"beats\", as the source has",
    );
    // music that ends before its clip, and a label of a file that isn't there
    fs::write(dir.join("songs/0.wav"), wav::bytes(&render(&score(3.0), 22_050).unwrap(), 22_050)).unwrap();
    said(
        "tokenize data --labels labels.csv --tokenizer t.json --music songs --out x --strict",
        1,
        "0: songs/0.wav: found 3.00 s of music",
    );
    fs::remove_file(dir.join("songs/named.wav")).unwrap();
    said(
        "tokenize data --labels labels.csv --tokenizer t.json --music songs --out x",
        1,
        "no music file `named.wav` of clip 1 in ",
    );
    drop(song);
}

#[test]
fn a_model_is_told_what_music_sounds_like_and_a_flat_one_its_tempo() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    heard(dir);
    let song = song(dir);
    let said = |words: &str, code: i32, what: &str| said(dir, words, code, what);
    let bytes = |file: &str| fs::read(dir.join(file)).unwrap();
    // a row a frame and for a second more, as far as the music goes
    let corpus = kinelm::corpus::Corpus::open(dir.join("corpus")).unwrap();
    let rows: Vec<usize> = corpus.clips().iter().map(|clip| clip.music.map_or(0, |music| music.rows)).collect();
    assert!(rows[2] == 0 && [0, 1, 3].iter().all(|i| rows[*i] >= corpus.clips()[*i].frames), "{rows:?}");
    assert_eq!(bytes("corpus/music.f32").len(), 140 * rows.iter().sum::<usize>());
    let tempi: Vec<_> = corpus.clips().iter().map(|clip| clip.labels.get("tempo").map(String::as_str)).collect();
    assert_eq!(tempi, [Some("090"), Some("120"), None, Some("110")]);
    fs::write(dir.join("both.toml"), CONFIG.replace("\"beats\"", "\"both\"")).unwrap();
    said("pretrain --config both.toml --corpus deaf --run no", 1, "no training clip of the corpora has any");
    said("pretrain --config both.toml --corpus corpus --run both", 0, "");
    assert!(String::from_utf8(bytes("both/config.toml")).unwrap().contains("[model.music_scale]"));
    said("generate --run both --music song.wav --seconds 2 --out b.bvh", 0, " beats per minute");
    let before = bytes("b.bvh");
    fs::remove_file(dir.join("b.bvh")).unwrap();
    said("again b.bvh.kinelm.json", 0, "");
    assert!(bytes("b.bvh") == before);
    said("evaluate likelihood --run both --corpus corpus --split valid", 0, "");
    // a model that hears beats learns the rest with what it was standardised by when that began
    said("finetune --from both --config both.toml --corpus corpus --run fine --steps 2", 0, "");
    let scale = |run: &str| {
        let text = String::from_utf8(bytes(&format!("{run}/config.toml"))).unwrap();
        text.split("[model.music_scale]").nth(1).unwrap().split("\n[").next().unwrap().to_owned()
    };
    assert_eq!(scale("fine"), scale("both"));
    // a run that lost what it was standardised by
    let config = String::from_utf8(bytes("both/config.toml")).unwrap();
    let scale_at = config.find("[model.music_scale]").unwrap();
    let rest = config[scale_at + 5..].find("\n[").map_or("", |end| &config[scale_at + 5 + end..]);
    fs::create_dir(dir.join("kept")).unwrap();
    fs::rename(dir.join("both/config.toml"), dir.join("kept/config.toml")).unwrap();
    fs::write(dir.join("both/config.toml"), format!("{}{rest}", &config[..scale_at])).unwrap();
    said("generate --run both --music song.wav --seconds 2 --out n.bvh", 1, "found no model.music_scale");
    fs::rename(dir.join("kept/config.toml"), dir.join("both/config.toml")).unwrap();
    // tempo, which a flat model can be told
    fs::write(dir.join("flat.toml"), FLAT).unwrap();
    said("pretrain --config flat.toml --corpus corpus --run flat", 0, "");
    said("generate --run flat --music song.wav --seconds 2 --out f.bvh", 0, "conditioned on tempo=090");
    said(
        "generate --run flat --music song.wav --seconds 2 --label tempo=120 --out g.bvh",
        0,
        "conditioned on tempo=120",
    );
    said(
        "generate --run flat --music song.wav --seconds 2 --label tempo=95 --out h.bvh",
        2,
        "this model knows the tempo 090, 120",
    );
    let before = bytes("f.bvh");
    fs::remove_file(dir.join("f.bvh")).unwrap();
    said("again f.bvh.kinelm.json", 0, "");
    assert!(bytes("f.bvh") == before && bytes("g.bvh") != before);
    drop(song);
}

fn score(seconds: f64) -> Score {
    let beats_s = (0..).map(|i| 0.3 + 0.5 * f64::from(i)).take_while(|beat| *beat < seconds).collect();
    Score { style: Style::Pop, beats_s, downbeat: 0, seconds, seed: 2 }
}
