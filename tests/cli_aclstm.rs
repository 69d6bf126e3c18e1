//! An auto-conditioned LSTM, as a user trains it, dances with it and measures it.

use assert_cmd::Command;
use kinelm_motion::format::ReadOptions;
use kinelm_motion::{Motion, Source, format, synth};
use predicates::str::contains;
use std::fs;
use std::path::PathBuf;
use std::sync::OnceLock;

const TRAIN: &str = "aclstm train data --labels labels.csv --config c.toml";
const CONFIG: &str = "width = 24\nlayers = 2\nlength = 20\nbatch = 2\nsteps = 4\nmargin = 3\ncheckpoint_every = 2\n";

struct Place {
    dir: tempfile::TempDir,
}

impl Place {
    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// A call in the folder, its words parted by spaces.
    fn call(&self, words: &str) -> Command {
        let mut c = Command::cargo_bin("kinelm").unwrap();
        c.env("NO_COLOR", "1").current_dir(self.dir.path()).args(words.split_whitespace());
        c
    }

    fn done(&self, words: &str) -> String {
        let done = self.call(words).assert().success();
        String::from_utf8(done.get_output().stdout.clone()).unwrap()
    }
}

/// Four dances of six seconds at 60 frames a second, two of them to learn from, and a run.
fn place() -> &'static Place {
    static PLACE: OnceLock<Place> = OnceLock::new();
    PLACE.get_or_init(|| {
        let place = Place { dir: tempfile::tempdir().unwrap() };
        fs::create_dir(place.at("data")).unwrap();
        let mut labels = "clip,split,genre\n".to_string();
        for (i, dance) in synth::corpus(3, 4, 6.0, 60.0).unwrap().into_iter().enumerate() {
            let path = place.at(&format!("data/{i}.bvh"));
            let motion = Motion { path: path.clone(), clip: dance.clip, source: Source::Plain, warnings: vec![] };
            format::write(&path, &motion).unwrap();
            labels += &format!("{i},{},salsa\n", ["train", "train", "valid", "test"][i]);
        }
        fs::write(place.at("c.toml"), CONFIG).unwrap();
        fs::write(place.at("labels.csv"), labels).unwrap();
        place.done(&format!("{TRAIN} --representation quaternion --condition 3 --run run"));
        place
    })
}

#[test]
fn a_run_goes_on_and_says_how_it_was_asked() {
    let place = place();
    place
        .call(&format!("{TRAIN} --run run"))
        .assert()
        .failure()
        .stderr(contains("run exists; go on with it by --resume"));
    place.done(&format!("{TRAIN} --representation euler --root-order YXZ --steps 2 --run euler"));
    place
        .call("aclstm train --run euler --resume --steps 4")
        .assert()
        .success()
        .stderr(contains("going on after step 2"));
    let config = fs::read_to_string(place.at("euler/config.toml")).unwrap();
    assert!(config.contains("form = \"euler\"") && config.contains("orders = [\"YXZ\", \"ZXY\""), "{config}");
    assert_eq!(fs::read_to_string(place.at("euler/metrics.jsonl")).unwrap().lines().count(), 4);
    let names = fs::read_dir(place.at("euler")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    assert!(names.collect::<Vec<_>>().iter().any(|name| name.starts_with("events.out.tfevents.")));
    place.call("aclstm train --run euler --resume --steps 1").assert().code(2).stderr(contains("the run has done 4"));
    place.call("aclstm train --run none --resume").assert().failure().stderr(contains("no config.toml"));
    for call in ["generate --run euler --frames 9 --out x.bvh", "pretrain --run euler --resume"] {
        place.call(call).assert().failure().stderr(contains("found a run of kind \"aclstm\", expected one of a GPT"));
    }
    let wrong = [
        (format!("{TRAIN} --only genre=waltz --run x"), "no clip with genre=waltz"),
        (format!("{TRAIN} --wiring old --run x"), "expected fixed or compat"),
        (format!("{TRAIN} --root-order ZZX --run x"), "an order of angles \"ZZX\""),
        (format!("{TRAIN} --fps-source 50 --run x"), "found 50 frames a second, expected a multiple of 30"),
    ];
    for (words, message) in wrong {
        place.call(&words).assert().failure().stderr(contains(message));
        assert!(!place.at("x").exists());
    }
}

#[test]
fn a_dance_goes_on_from_a_clip_on_its_rig_and_is_made_again() {
    let place = place();
    let generate = "aclstm generate --run run --seed-clip data/3.bvh --seed-frames 50 --frames 70";
    place
        .call(&format!("{generate} --out a.bvh"))
        .assert()
        .success()
        .stderr(contains("70 frames at 30 fps, 24 joints"));
    let dance = format::read(&place.at("a.bvh"), &ReadOptions::default()).unwrap();
    let seed = format::read(&place.at("data/3.bvh"), &ReadOptions::default()).unwrap();
    assert_eq!(dance.clip.skeleton().names(), seed.clip.skeleton().names());
    // where the seed ends: three frames are left out, then every second one is taken
    let (first, there) = (dance.clip.root()[0], seed.clip.root()[3 + 2 * 50]);
    assert!((first.x - there.x).hypot(first.z - there.z) < 0.3, "{first} {there}");
    let bytes = fs::read(place.at("a.bvh")).unwrap();
    fs::remove_file(place.at("a.bvh")).unwrap();
    place.done("aclstm generate --again a.bvh.kinelm.json --threads 2");
    assert!(fs::read(place.at("a.bvh")).unwrap() == bytes);
    // its own dance is replaced, a stranger's isn't
    place.done(&format!("{generate} --with-seed --feet off --out a.bvh"));
    assert_eq!(format::read(&place.at("a.bvh"), &ReadOptions::default()).unwrap().clip.frames(), 120);
    fs::write(place.at("mine.bvh"), "mine").unwrap();
    place.call(&format!("{generate} --out mine.bvh")).assert().code(2).stderr(contains("--force"));
    place.call(&format!("{generate} --out data/3.bvh --force")).assert().code(2).stderr(contains("this call reads it"));
    place.call("generate --again a.bvh.kinelm.json").assert().failure().stderr(contains("kinelm aclstm generate"));
    place.done(&format!("{generate} --out b.json"));
    let short = "aclstm generate --run run --seed-clip data/3.bvh --seed-frames 900 --out c.bvh";
    place.call(short).assert().failure().stderr(contains("at both ends of the file left out, expected 901"));
    assert!(!place.at("c.bvh").exists());
}

#[test]
fn measures_are_told_as_tables_and_as_json() {
    let place = place();
    let evaluate = "aclstm evaluate --run run --seeds 3 --seed-frames 40,80 --frames 400";
    let text = place.done(evaluate);
    assert!(text.contains("quaternion 3 after 4 updates: 3 seeds of 1 test takes"), "{text}");
    let json: serde_json::Value = serde_json::from_str(&place.done(&format!("{evaluate} --json"))).unwrap();
    assert_eq!((json["rows"].as_array().unwrap().len(), json["seeds"].as_u64()), (2, Some(3)));
    let figures = |i: usize| &json["rows"][i]["figures"];
    // all lengths foretell the same frames
    assert_eq!(figures(0)["still_root_cm"], figures(1)["still_root_cm"]);
    assert_ne!(figures(0)["root_cm"], figures(1)["root_cm"]);
    assert!(figures(0)["short"]["still"]["mean"].as_f64().unwrap() <= 1.0);
    place
        .call("aclstm evaluate --run run --seed-frames 900")
        .assert()
        .code(2)
        .stderr(contains("no test clip of 921 frames"));
    place.call("aclstm evaluate --run data").assert().failure().stderr(contains("no config.toml"));
}
