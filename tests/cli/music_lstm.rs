//! A music LSTM, as a user trains it, dances with it and measures it.

use crate::support::{kinelm_in, stdout};
use assert_cmd::Command;
use kinelm::corpus::music::synth::music;
use kinelm_motion::format::ReadOptions;
use kinelm_motion::{Motion, format, synth};
use kinelm_music::wav;
use predicates::prelude::*;
use predicates::str::contains;
use std::fs;
use std::path::PathBuf;
use std::sync::OnceLock;

const TRAIN: &str = "music-lstm train data --labels labels.csv --music songs --config c.toml";
const CONFIG: &str = "encoder = [8]\nwidth = 12\nlayers = 2\nlength = 20\nbatch = 2\nsteps = 4\nmargin = 3\n\
                      checkpoint_every = 2\n";

struct Place {
    dir: tempfile::TempDir,
}

impl Place {
    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// A call in the folder, its words parted by spaces.
    fn call(&self, words: &str) -> Command {
        kinelm_in(self.dir.path(), words)
    }

    fn done(&self, words: &str) -> String {
        stdout(&mut self.call(words))
    }

    fn refused(&self, words: &str, message: &str) {
        self.call(words).assert().failure().stderr(contains(message));
    }
}

/// Four dances of four seconds at 60 frames a second with music of their own, two of them to learn from, and a run.
fn place() -> &'static Place {
    static PLACE: OnceLock<Place> = OnceLock::new();
    PLACE.get_or_init(own_place)
}

/// The same for a test that changes it.
fn own_place() -> Place {
    let place = Place { dir: tempfile::tempdir().unwrap() };
    ["data", "songs"].into_iter().for_each(|name| fs::create_dir(place.at(name)).unwrap());
    let mut labels = "clip,split,genre,music,music_from\n".to_owned();
    for (i, dance) in synth::corpus(3, 4, 4.0, 60.0).unwrap().into_iter().enumerate() {
        let path = place.at(&format!("data/{i}.bvh"));
        let sound = music(&dance, 3, 16_000).unwrap();
        fs::write(place.at(&format!("songs/song{i}.wav")), wav::bytes(&sound, 16_000)).unwrap();
        let motion = Motion::new(&path, dance.clip);
        format::write(&path, &motion).unwrap();
        labels += &format!("{i},{},{},song{i},0\n", ["train", "train", "test", "test"][i], dance.genre);
    }
    fs::write(place.at("c.toml"), CONFIG).unwrap();
    fs::write(place.at("labels.csv"), labels).unwrap();
    place.done(&format!("{TRAIN} --run run"));
    place
}

#[test]
fn a_run_goes_on_and_says_how_it_was_asked() {
    let place = place();
    place.refused(&format!("{TRAIN} --run run"), "run exists; resume it");
    place.done(&format!(
        "{TRAIN} --set pose=none --set effort=compat --set effort_every=1 --set audio=compat --set steps=2 --run other"
    ));
    place.call("music-lstm resume other --steps 4").assert().success().stderr(contains("resuming after step 2"));
    let config = fs::read_to_string(place.at("other/config.toml")).unwrap();
    assert!(config.contains("effort = \"compat\"") && config.contains("audio = \"compat\""), "{config}");
    assert_eq!(fs::read_to_string(place.at("other/metrics.jsonl")).unwrap().lines().count(), 4);
    let names = fs::read_dir(place.at("other")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    assert!(names.collect::<Vec<_>>().iter().any(|name| name.starts_with("events.out.tfevents.")));
    place.refused("music-lstm resume other --steps 1", "the run has done 4");
    place.refused("aclstm resume other", "found a run of kind \"music-lstm\"");
    place.refused("music-lstm generate --run data --music songs/song0.wav --out x.bvh", "no config.toml");
    let wrong = [
        (format!("{TRAIN} --set pose=none --run x"), "--set pose is \"none\""),
        (format!("{TRAIN} --set teacher=2 --run x"), "teacher is 2; expected 0 to 1"),
        (format!("{TRAIN} --only genre=waltz --run x"), "no clip with genre=waltz"),
        (format!("{TRAIN} --fps-source 50 --run x"), "found 50 frames a second, expected a multiple of 30"),
        ("music-lstm train data --run x".into(), "--music"),
        ("music-lstm train data --music data --run x".into(), "no clip with music in "),
    ];
    for (words, message) in wrong {
        place.refused(&words, message);
        assert!(!place.at("x").exists());
    }
}

#[test]
fn a_dance_to_music_is_made_again() {
    let place = place();
    let generate = "music-lstm generate --run run --music songs/song3.wav";
    place
        .call(&format!("{generate} --out a.bvh"))
        .assert()
        .success()
        .stderr(contains("120 frames at 30 fps, 24 joints"));
    let dance = format::read(&place.at("a.bvh"), &ReadOptions::default()).unwrap();
    assert!(dance.clip.root().iter().all(|p| (*p - dance.clip.root()[0]).length() < 1e-6), "on the spot");
    let bytes = fs::read(place.at("a.bvh")).unwrap();
    fs::remove_file(place.at("a.bvh")).unwrap();
    place.done("again a.bvh.kinelm.json --threads 2");
    let told = std::fs::read_to_string(place.at("a.bvh.kinelm.json")).unwrap();
    std::fs::write(place.at("long.json"), told.replace("\"from_s\": ", "\"frames\": 1099511627796, \"from_s\": "))
        .unwrap();
    place.refused("again long.json --out no.bvh", "frames, the limit is 1048576");
    assert!(fs::read(place.at("a.bvh")).unwrap() == bytes);
    place.refused("again a.bvh.kinelm.json --prompt x.bvh", "--prompt: a dance of a music LSTM has none");
    // its own dance is replaced, a stranger's isn't
    place.done(&format!("{generate} --music-from 1s --frames 40 --out a.bvh"));
    assert_eq!(format::read(&place.at("a.bvh"), &ReadOptions::default()).unwrap().clip.frames(), 40);
    fs::write(place.at("mine.bvh"), "mine").unwrap();
    place.call(&format!("{generate} --out mine.bvh")).assert().code(2).stderr(contains("--force"));
    let over = format!("{generate} --out songs/song3.wav --force");
    place.call(&over).assert().code(2);
    place.done(&format!("{generate} --out b.json"));

    fs::write(place.at("silence.wav"), wav::bytes(&vec![0.0; 32_000], 16_000)).unwrap();
    fs::write(place.at("words.wav"), "no sound").unwrap();
    let wrong = [
        (
            format!("{generate} --frames 400 --out c.bvh"),
            "song3.wav: found 4.00 s of music after 0.00 s, expected 13.33 s",
        ),
        (format!("{generate} --music-from 9s --out c.bvh"), "found 0.00 s of music after 9.00 s"),
        (
            "music-lstm generate --run run --music silence.wav --out c.bvh".into(),
            "silence.wav: found silence from 0.00 s",
        ),
        ("music-lstm generate --run run --music words.wav --out c.bvh".into(), "words.wav"),
        ("music-lstm generate --run run --music none.wav --out c.bvh".into(), "none.wav"),
    ];
    for (words, message) in wrong {
        place.refused(&words, message);
        assert!(!place.at("c.bvh").exists());
    }
    // other music under the same name
    fs::copy(place.at("songs/song3.wav"), place.at("d.wav")).unwrap();
    place.done("music-lstm generate --run run --music d.wav --frames 30 --out d.bvh");
    fs::copy(place.at("songs/song1.wav"), place.at("d.wav")).unwrap();
    place.refused("again d.bvh.kinelm.json", "run: the music is of SHA-256");
}

#[test]
fn measures_are_told_as_tables_and_as_json() {
    let place = place();
    let evaluate = "music-lstm evaluate --run run --frames 300";
    let text = place.done(evaluate);
    assert!(text.contains("audio fixed, pose aligned, effort none every 4, after 4 updates"), "{text}");
    assert!(text.contains("300 frames (10 s) to unseen music: "), "{text}");
    let json: serde_json::Value = serde_json::from_str(&place.done(&format!("{evaluate} --json"))).unwrap();
    let rows = json["rows"].as_array().unwrap();
    let named: Vec<[&str; 2]> = rows.iter().map(|r| ["split", "music"].map(|key| r[key].as_str().unwrap())).collect();
    let music = ["none: the true dances", "the clips' own", "other clips'"];
    let expected: Vec<[&str; 2]> = ["train", "test"].iter().flat_map(|s| music.map(|m| [*s, m])).collect();
    assert_eq!(named, expected);
    let ratio = |i: usize| rows[i]["metrics"]["speed_ratio"]["mean"].as_f64().unwrap();
    assert!(ratio(0) == 1.0 && ratio(1) != 1.0);
    place.refused("music-lstm evaluate --run run --split valid", "no valid clip with music");
    place.refused("music-lstm evaluate --run data", "no config.toml");
}

#[test]
fn a_dance_brings_its_music_along() {
    let place = own_place();
    place.done("tokenizer fit data --labels labels.csv --out t.json");
    place.done("tokenize data --labels labels.csv --tokenizer t.json --out corpus");
    // as a frame of the network has it, a thirtieth of a second
    place.done("music-lstm generate --run run --music songs/song3.wav --music-from 0.51s --frames 80 --out e.bvh");
    let view = "view e.bvh --out e.html --force";
    place.call(view).assert().success().stderr(contains("songs/song3.wav: ").and(contains("sounds for 2.7 s")));
    let page = fs::read_to_string(place.at("e.html")).unwrap();
    assert!(
        page.contains("data:audio/wav;base64,") && page.contains("\"from\":0.5,") && page.contains(" beats hit, by")
    );
    let evaluate = "evaluate dance e.bvh --real corpus";
    let text = place.done(evaluate);
    assert!(text.contains("all joints, on the beat"), "{text}");
    // the same as where it is named
    let row = |text: &str| text.lines().filter(|line| line.starts_with("e.bvh")).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(row(&text), row(&place.done(&format!("{evaluate} --music songs/song3.wav --music-from 0.5s"))));
    // other music under the same name, and none
    fs::copy(place.at("songs/song1.wav"), place.at("songs/song3.wav")).unwrap();
    let changed = "it has changed since the dance was made; --music plays it all the same";
    place.call(view).assert().success().stderr(contains(changed));
    assert!(!fs::read_to_string(place.at("e.html")).unwrap().contains("data:audio"));
    place.call(evaluate).assert().success().stderr(
        contains("e.bvh: its music is not compared: ").and(contains("it has changed since the dance was made")),
    );
    fs::remove_file(place.at("songs/song3.wav")).unwrap();
    place.call(view).assert().success().stderr(contains("the music of the dance isn't there"));
    place.call(evaluate).assert().success().stderr(contains("e.bvh: its music is not compared: "));
}

#[test]
fn files_that_have_changed_are_named() {
    let place = own_place();
    let both = ["music-lstm evaluate --run run --frames 300", "music-lstm resume run --steps 6"];
    let refused = |message: &str| both.iter().for_each(|words| place.refused(words, message));
    let (clip, song) = (place.at("data/1.bvh"), place.at("songs/song2.wav"));
    let [bvh, wav] = [&clip, &song].map(|path| fs::read(path).unwrap());
    fs::copy(place.at("data/0.bvh"), &clip).unwrap();
    refused("data/1.bvh: found SHA-256 ");
    fs::write(&clip, bvh).unwrap();
    fs::copy(place.at("songs/song1.wav"), &song).unwrap();
    refused("songs/song2.wav: found SHA-256 ");
    fs::write(&song, wav).unwrap();
    fs::copy(place.at("data/0.bvh"), place.at("data/9.bvh")).unwrap();
    refused("data/9.bvh: found a file, expected none");
    fs::remove_file(place.at("data/9.bvh")).unwrap();
    let labels = fs::read_to_string(place.at("labels.csv")).unwrap();
    fs::write(place.at("labels.csv"), labels.replace("song3,0", "song3,0.1")).unwrap();
    refused("found files, rates, splits or times with the hash ");
    fs::write(place.at("labels.csv"), labels).unwrap();
    both.iter().for_each(|words| drop(place.done(words)));
}
