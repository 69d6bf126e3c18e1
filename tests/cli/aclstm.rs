//! An auto-conditioned LSTM, as a user trains it, dances with it and measures it.

use crate::support::{kinelm_in, stdout};
use assert_cmd::Command;
use kinelm_motion::format::ReadOptions;
use kinelm_motion::{Clip, Motion, format, synth};
use predicates::prelude::*;
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
        kinelm_in(self.dir.path(), words)
    }

    fn done(&self, words: &str) -> String {
        stdout(&mut self.call(words))
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
            let motion = Motion::new(&path, dance.clip);
            format::write(&path, &motion).unwrap();
            labels += &format!("{i},{},salsa\n", ["train", "train", "valid", "test"][i]);
        }
        fs::write(place.at("c.toml"), CONFIG).unwrap();
        fs::write(place.at("labels.csv"), labels).unwrap();
        place.done(&format!("{TRAIN} --set form=quaternion --set condition=3 --run run"));
        place
    })
}

#[test]
fn a_run_goes_on_and_says_how_it_was_asked() {
    let place = place();
    place.call(&format!("{TRAIN} --run run")).assert().failure().stderr(contains("run exists; resume it"));
    place.done(&format!("{TRAIN} --set form=euler --set root_order=YXZ --set steps=2 --run euler"));
    place.call("aclstm resume euler --steps 4").assert().success().stderr(contains("resuming after step 2"));
    let config = fs::read_to_string(place.at("euler/config.toml")).unwrap();
    assert!(config.contains("form = \"euler\"") && config.contains("orders = [\"YXZ\", \"ZXY\""), "{config}");
    assert_eq!(fs::read_to_string(place.at("euler/metrics.jsonl")).unwrap().lines().count(), 4);
    let names = fs::read_dir(place.at("euler")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    assert!(names.collect::<Vec<_>>().iter().any(|name| name.starts_with("events.out.tfevents.")));
    place.call("aclstm resume euler --steps 1").assert().code(2).stderr(contains("the run has done 4"));
    place.done("aclstm resume euler --set steps=5 --set learning_rate=1e-5");
    let config = fs::read_to_string(place.at("euler/config.toml")).unwrap();
    assert!(config.contains("steps = 5\n") && config.contains("learning_rate = 0.00001\n"), "{config}");
    let refused = "--set width: weights, optimizer and sequences depend on it";
    place.call("aclstm resume euler --set width=8").assert().code(2).stderr(contains(refused));
    let listed = place.call("runs list").assert().success().stderr("");
    listed.stdout(contains("aclstm ").and(contains("5/5")));
    place.call("aclstm resume none").assert().failure().stderr(contains("no config.toml"));
    for call in ["generate --run euler --frames 9 --out x.bvh", "pretrain resume euler"] {
        place.call(call).assert().failure().stderr(contains("found a run of kind \"aclstm\", expected one of a GPT"));
    }
    let wrong = [
        (format!("{TRAIN} --only genre=waltz --run x"), "no clip with genre=waltz"),
        (
            format!("{TRAIN} --set wiring=old --run x"),
            "--set wiring=old: unknown variant old, expected fixed or compat",
        ),
        (format!("{TRAIN} --set form=euler --set root_order=ZZX --run x"), "the order of a joint's angles is \"ZZX\""),
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
    place.done("again a.bvh.kinelm.json --threads 2");
    let told = std::fs::read_to_string(place.at("a.bvh.kinelm.json")).unwrap();
    std::fs::write(place.at("long.json"), told.replace("\"frames\": ", "\"frames\": 1099511627")).unwrap();
    let long = place.call("again long.json --out no.bvh").assert().failure();
    long.stderr(contains("frames, the limit is 1048576"));
    assert!(fs::read(place.at("a.bvh")).unwrap() == bytes);
    // its own dance is replaced, a stranger's isn't
    place.done(&format!("{generate} --with-seed --feet off --out a.bvh"));
    assert_eq!(format::read(&place.at("a.bvh"), &ReadOptions::default()).unwrap().clip.frames(), 120);
    fs::write(place.at("mine.bvh"), "mine").unwrap();
    place.call(&format!("{generate} --out mine.bvh")).assert().code(2).stderr(contains("--force"));
    place.call(&format!("{generate} --out data/3.bvh --force")).assert().code(2).stderr(contains("this call reads it"));
    let other = place.call("again a.bvh.kinelm.json --music song.wav").assert().code(2);
    other.stderr(contains("--music: a dance of an auto-conditioned LSTM has none; leave it out"));
    place.done(&format!("{generate} --out b.json"));
    let short = "aclstm generate --run run --seed-clip data/3.bvh --seed-frames 900 --out c.bvh";
    place.call(short).assert().failure().stderr(contains("at both ends of the file left out, expected 901"));
    assert!(!place.at("c.bvh").exists());
}

#[test]
fn a_training_is_watched_and_gone_on_from() {
    let place = place();
    let watched = "--set eval_every=2 --set sample_every=2 --set keep=all";
    place.done(&format!("{TRAIN} --set form=quaternion {watched} --run watched"));
    place.done(&format!("{TRAIN} --set form=positional --run positional"));
    let bvh = place.at("watched/samples/step-00000002.bvh");
    assert_eq!(format::read(&bvh, &ReadOptions::default()).unwrap().clip.frames(), 150);
    assert!(place.at("watched/samples/step-00000004.html").is_file());
    let list = place.done("runs list watched");
    assert!(list.contains("loss ") && list.contains(" at "), "{list}");
    // a chart for each form
    place.done("runs plot watched positional --metric rotations --out loss.svg");
    let svg = fs::read_to_string(place.at("loss.svg")).unwrap();
    for part in
        ["aclstm quaternion: loss of the rotations", "aclstm positional: loss of the rotations", "watched valid"]
    {
        assert!(svg.contains(part), "{part}");
    }
    let none = place.call("runs plot watched --metric rate --out none.svg").assert().failure();
    none.stderr(contains("none of the runs has a figure to draw"));
    // a dance and a measurement of a checkpoint
    let generate = "aclstm generate --run watched --seed-clip data/3.bvh --seed-frames 50 --frames 20";
    place.done(&format!("{generate} --checkpoint 2 --out two.bvh"));
    let sidecar = fs::read_to_string(place.at("two.bvh.kinelm.json")).unwrap();
    assert!(sidecar.contains("\"step\": 2,"), "{sidecar}");
    let bytes = fs::read(place.at("two.bvh")).unwrap();
    fs::remove_file(place.at("two.bvh")).unwrap();
    place.done("again two.bvh.kinelm.json");
    assert!(fs::read(place.at("two.bvh")).unwrap() == bytes);
    let pruned = place.call(&format!("{generate} --checkpoint 1 --out no.bvh")).assert().failure();
    pruned.stderr(contains("no checkpoint of step 1, expected one of step 1; there are 2, 4"));
    let evaluate = "aclstm evaluate --seeds 3 --seed-frames 40,80 --frames 400 --json";
    for (i, which) in ["2", "latest"].iter().enumerate() {
        let report = place.done(&format!("{evaluate} --run watched --checkpoint {which}"));
        assert!(report.contains(&format!("\"step\":{},", 2 * (i + 1))), "{report}");
        fs::write(place.at(&format!("quaternion-{i}.json")), report).unwrap();
    }
    place.done("aclstm plot quaternion-0.json quaternion-1.json --over seed-frames --out seeds.svg");
    let svg = fs::read_to_string(place.at("seeds.svg")).unwrap();
    assert!(svg.contains("frames of the seed") && svg.contains("quaternion: the next 20 frames"));
    // from an earlier checkpoint on
    place.done("aclstm resume watched --from-step 2 --run branch --set learning_rate=1e-5");
    let config = fs::read_to_string(place.at("branch/config.toml")).unwrap();
    assert!(config.contains("path = \"../watched\"\nstep = 2\n") && config.contains("learning_rate = 0.00001\n"));
    place.call("aclstm resume watched --from-step 2").assert().code(2).stderr(contains("--run"));
    let gone = place.call("aclstm resume run --from-step 2 --run x").assert().failure();
    gone.stderr(contains("no checkpoint of step 2, expected one of step 2; there are 4"));
    assert!(!place.at("x").exists());
}

#[test]
fn measures_are_told_as_tables_and_as_json() {
    let place = place();
    let evaluate = "aclstm evaluate --run run --seeds 3 --seed-frames 40,80 --frames 400";
    let text = place.done(evaluate);
    assert!(text.contains("quaternion 3 after 4 updates: 3 seeds of 1 test takes"), "{text}");
    let json: serde_json::Value = serde_json::from_str(&place.done(&format!("{evaluate} --json"))).unwrap();
    assert_eq!((json["rows"].as_array().unwrap().len(), json["seeds"].as_u64()), (2, Some(3)));
    let figures = |i: usize| &json["rows"][i]["metrics"];
    // all lengths foretell the same frames
    assert_eq!(figures(0)["still_root_cm"], figures(1)["still_root_cm"]);
    assert_ne!(figures(0)["root_cm"], figures(1)["root_cm"]);
    assert!(figures(0)["short"]["still"]["mean"].as_f64().unwrap() <= 1.0);
    place
        .call("aclstm evaluate --run run --seed-frames 900")
        .assert()
        .code(1)
        .stderr(contains("no test clip of 921 frames"));
    place.call("aclstm evaluate --run data").assert().failure().stderr(contains("no config.toml"));
}

/// Frames of a seed, one after the other, as a dance of this name.
fn dance(place: &Place, seed: &Clip, name: &str, frames: impl Iterator<Item = usize>) {
    let (mut root, mut rotations) = (vec![], vec![]);
    for f in frames {
        root.push(seed.root()[f]);
        rotations.extend_from_slice(seed.pose(f));
    }
    let clip = Clip::new(seed.skeleton().clone(), seed.fps(), root, rotations).unwrap();
    let path = place.at(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    format::write(&path, &Motion::new(&path, clip)).unwrap();
}

#[test]
fn dances_of_something_else_are_measured_as_the_networks_own() {
    let place = place();
    let evaluate = "aclstm evaluate --run run --seeds 3 --seed-frames 40,80 --frames 450";
    place
        .call(&format!("{evaluate} --write-seeds seeds"))
        .assert()
        .success()
        .stderr(contains("seeds: 3 seeds of 80 frames"));
    let seed =
        |i: usize| format::read(&place.at(&format!("seeds/seed-0{i}.bvh")), &ReadOptions::default()).unwrap().clip;
    assert_eq!((seed(1).frames(), seed(1).fps()), (80, 30.0));
    // one stands still behind its seed, one dances to and fro
    dance(place, &seed(1), "held/seed-01.bvh", (0..80).chain([79; 430]));
    dance(
        place,
        &seed(3),
        "moving/seed-03.bvh",
        (0..80).chain((1..=430).map(|f| if f / 79 % 2 == 0 { 79 - f % 79 } else { f % 79 })),
    );
    let figures = |folder: &str| {
        let call = place.call(&format!("{evaluate} --dances {folder} --json")).assert().success();
        let call = call.stderr(contains("1 of 3 seeds have a dance"));
        fs::write(place.at(&format!("{folder}.json")), &call.get_output().stdout).unwrap();
        let json: serde_json::Value = serde_json::from_slice(&call.get_output().stdout).unwrap();
        assert_eq!((&json["dances"], json["rows"].as_array().unwrap().len()), (&folder.into(), 1));
        (json["rows"][0]["seed_frames"].clone(), json["rows"][0]["metrics"].clone())
    };
    let (length, held) = figures("held");
    assert_eq!((length, &held["long"]["frames"]), (80.into(), &430.into()));
    let mean = |figures: &serde_json::Value, key: &str| figures[key]["mean"].as_f64().unwrap();
    for key in ["root_cm", "degrees"] {
        let (found, still) = (mean(&held, key), mean(&held, &format!("still_{key}")));
        assert!((found - still).abs() < 1e-3 * still, "{key}: {found} {still}");
        assert_eq!(held["curves"][key].as_array().unwrap().len(), 20);
    }
    assert_eq!((mean(&held["short"], "never"), held["curves"]["still"][14].as_f64()), (0.0, Some(1.0)));
    assert!(held["short"]["pose"]["median_time_to_freeze_s"].as_f64().unwrap() < 0.3, "{held}");
    let (_, moving) = figures("moving");
    assert_eq!((mean(&moving["short"], "never"), mean(&moving["short"], "still") < 0.2), (1.0, true), "{moving}");
    assert!(
        place.done(&format!("{evaluate} --dances held")).starts_with("the dances of held as quaternion: 1 seeds of 1")
    );

    let refused = |folder: &str, message: &str| {
        place.call(&format!("{evaluate} --dances {folder}")).assert().failure().stderr(contains(message));
    };
    dance(place, &seed(1), "short/seed-01.bvh", 0..80);
    refused("short", "found 80 frames at 30 a second, expected 480 or more");
    dance(place, &seed(1), "other/seed-02.bvh", (0..80).rev().chain([0; 430]));
    refused("other", "cm from those of seed-02, expected the seed itself");
    refused("data", "expected dances that are named as their seeds: seed-01.bvh");
    refused("none", "none");

    place.done("aclstm plot held.json moving.json --out curves.svg");
    let curves = fs::read_to_string(place.at("curves.svg")).unwrap();
    assert!(["held", "moving", "last frame held", "seconds"].iter().all(|text| curves.contains(text)));
    place.call("aclstm plot held.json --out held.json").assert().code(2).stderr(contains(".png or .svg"));
    fs::write(place.at("odd.json"), "{}").unwrap();
    place.call("aclstm plot odd.json --out odd.svg").assert().failure().stderr(contains("missing field `rows`"));
}

#[test]
fn clips_that_have_changed_are_named() {
    let place = Place { dir: tempfile::tempdir().unwrap() };
    fs::create_dir(place.at("data")).unwrap();
    for (i, dance) in synth::corpus(3, 2, 6.0, 60.0).unwrap().into_iter().enumerate() {
        let path = place.at(&format!("data/{i}.bvh"));
        let motion = Motion::new(&path, dance.clip);
        format::write(&path, &motion).unwrap();
    }
    fs::write(place.at("c.toml"), CONFIG).unwrap();
    fs::write(place.at("labels.csv"), "clip,split\n0,train\n1,test\n").unwrap();
    place.done(&format!("{TRAIN} --run run"));
    let evaluate = "aclstm evaluate --run run --seeds 1 --seed-frames 20 --frames 400";
    place.done(evaluate);
    let other = fs::read(place.at("data/0.bvh")).unwrap();
    fs::write(place.at("data/1.bvh"), other).unwrap();
    for words in [evaluate, &format!("{evaluate} --write-seeds seeds"), "aclstm resume run --steps 9"] {
        let said = contains("data/1.bvh: found SHA-256 ").and(contains("put back the files and labels"));
        place.call(words).assert().failure().stderr(said);
    }
    fs::remove_file(place.at("data/1.bvh")).unwrap();
    place.call(evaluate).assert().failure().stderr(contains("data/1.bvh: found no such file among those of the run"));
}
