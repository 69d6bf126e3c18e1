//! A two-level model, as a user trains it and dances with it.

use crate::support::{kinelm_in, stdout};
use assert_cmd::Command;
use kinelm_motion::{Motion, format, synth};
use predicates::str::contains;
use std::fs;
use std::path::PathBuf;
use std::sync::OnceLock;

const CONFIG: &str = "[model]\narchitecture = \"two_level\"\nlayers = 1\nheads = 2\nwidth = 24\nwindow = 6\n\
                      [model.decoder]\nlayers = 1\nheads = 2\nwidth = 16\ncharacter_width = 4\n\
                      [train]\nbatch = 2\nsteps = 6\nwarmup = 1\nlearning_rate = 3e-3\neval_every = 3\n\
                      checkpoint_every = 3\ntable_rate = 3.0\n\
                      stages = [{ until = 0.4, frames = 3, batch = 4 }]\n[augment]\nhistory_noise = 2.0\n";

/// Twelve short dances, a tokenizer, a corpus and a run.
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

fn place() -> &'static Place {
    static PLACE: OnceLock<Place> = OnceLock::new();
    PLACE.get_or_init(|| {
        let place = Place { dir: tempfile::tempdir().unwrap() };
        fs::create_dir(place.at("data")).unwrap();
        for (i, dance) in synth::corpus(3, 12, 3.0, 30.0).unwrap().into_iter().enumerate() {
            let path = place.at(&format!("data/{i:02}.bvh"));
            let motion = Motion::new(&path, dance.clip);
            format::write(&path, &motion).unwrap();
        }
        fs::write(place.at("c.toml"), CONFIG).unwrap();
        fs::write(place.at("labels.csv"), labels()).unwrap();
        place.done("tokenizer fit data --labels labels.csv --out t.json");
        place.done("tokenize data --labels labels.csv --tokenizer t.json --out corpus");
        place.done("pretrain --config c.toml --corpus corpus --run run");
        place
    })
}

fn labels() -> String {
    let split = |i| ["train", "train", "valid", "test"][i % 4];
    let rows = (0..12).map(|i| format!("{i:02},{},{}\n", split(i), ["salsa", "waltz"][i % 2]));
    format!("clip,split,genre\n{}", rows.collect::<String>())
}

#[test]
fn it_is_measured_alike_in_both_forms_and_by_the_reader() {
    let place = place();
    let bits = |more: &str| {
        let text = place.done(&format!("evaluate likelihood --run run --corpus corpus --json{more}"));
        let found: serde_json::Value = serde_json::from_str(&text).unwrap();
        found["bits_per_frame"].as_f64().unwrap()
    };
    let fast = bits("");
    assert!(fast > 10.0 && fast < 500.0, "{fast}");
    // half floats are read token by token, as dances are
    for (more, apart) in [(" --form plain", 1e-4), (" --kv f16", 1e-2)] {
        let other = bits(more);
        assert!((other / fast - 1.0).abs() < apart, "{more}: {other}, {fast}");
    }
}

#[test]
fn it_goes_on_bit_for_bit() {
    let place = place();
    place.done("pretrain --config c.toml --corpus corpus --run again --threads 1");
    let weights =
        |run: &str| fs::read(place.at(&format!("{run}/checkpoints/step-00000006/model.safetensors"))).unwrap();
    assert_eq!(weights("again"), weights("run"), "threads change no bit");
    fs::remove_dir_all(place.at("again/checkpoints/step-00000006")).unwrap();
    fs::write(place.at("again/latest"), "step-00000003\n").unwrap();
    fs::write(place.at("again/best"), "step-00000003\n").unwrap();
    place.done("pretrain resume again");
    assert_eq!(weights("again"), weights("run"), "neither does going on");
}

#[test]
fn it_dances_after_a_prompt_and_again() {
    let place = place();
    place.done("generate --run run --prompt data/03.bvh --joints root,right_arm --variations 2 --seed 5 --out d.bvh");
    let dance = fs::read(place.at("d-1.bvh")).unwrap();
    assert_ne!(dance, fs::read(place.at("d-2.bvh")).unwrap());
    // alone it is what it was beside another
    place.done("generate --run run --prompt data/03.bvh --joints root,right_arm --seed 5 --out alone.bvh");
    let on_rig = "generate --run run --prompt data/03.bvh --joints root,right_arm --rig prompt --fps 20 --out rig.bvh";
    place.call(on_rig).assert().success().stderr(contains("0.0000 % of the given characters differ"));
    let words = |name: &str| place.done(&format!("tokenizer text {name} --tokenizer t.json --floor 0 --up y"));
    assert_eq!(words("alone.bvh"), words("d-1.bvh"));
    place.done("again d-1.bvh.kinelm.json --out twice.bvh");
    assert_eq!(fs::read(place.at("twice.bvh")).unwrap(), dance);
    // longer than its window many times over, free and greedy
    place.done("generate --run run --frames 40 --greedy --out free.bvh");
    place.done(
        "generate --run run --prompt data/03.bvh --from-frame 9 --frames 30 --weights int8 --kv f16 --out on.bvh",
    );
}

#[test]
fn every_processor_dances_the_same() {
    let place = place();
    let dance = |kernels: &str, more: &str| {
        let call =
            format!("generate --run run --prompt data/03.bvh --joints root {more} --seed 5 --force --out same.bvh");
        place.call(&call).env("KINELM_KERNELS", kernels).assert().success();
        fs::read(place.at("same.bvh")).unwrap()
    };
    // what a processor lacks isn't used: there the names mean the same kernels
    for more in ["--variations 1", "--weights int8 --kv int8", "--weights int8 --kv f16 --look-ahead 2"] {
        let narrow = dance("avx2", more);
        assert!(narrow == dance("avx512", more) && narrow == dance("auto", more), "{more}");
    }
}

#[test]
fn the_best_of_several_is_kept_and_made_again() {
    let place = place();
    let told = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&fs::read(place.at(&format!("{name}.kinelm.json"))).unwrap()).unwrap()
    };
    let said =
        place.call("generate --run run --seconds 3 --best 4 --keep-all --seed 5 --out all.bvh").assert().success();
    let said = String::from_utf8(said.get_output().stderr.clone()).unwrap();
    assert!(said.contains("compared with the train clips of") && said.contains("of 4, score"), "{said}");
    let all: Vec<_> = (1..=4).map(|i| told(&format!("all-{i}.bvh"))).collect();
    let score = |i: usize| all[i]["best"]["verdict"]["score"].as_f64().unwrap();
    let is_out = |i: usize| {
        let verdict = &all[i]["best"]["verdict"];
        !verdict["freezes_s"].is_null() || verdict["copied"] == true
    };
    for i in 0..3 {
        assert!((is_out(i), score(i)) <= (is_out(i + 1), score(i + 1)), "{all:?}");
    }
    let mut drawn: Vec<u64> = all.iter().map(|told| told["variation"].as_u64().unwrap()).collect();
    drawn.sort_unstable();
    assert_eq!((drawn, &all[2]["best"]["of"], &all[2]["best"]["better"]), (vec![1, 2, 3, 4], &4.into(), &2.into()));
    // one alone is the best of them, and needs no corpus to be made again
    place.done("generate --run run --seconds 3 --best 4 --seed 5 --out one.bvh");
    let best = fs::read(place.at("all-1.bvh")).unwrap();
    assert_eq!(fs::read(place.at("one.bvh")).unwrap(), best);
    place.done("again one.bvh.kinelm.json --out twice.one.bvh");
    assert_eq!(fs::read(place.at("twice.one.bvh")).unwrap(), best);
    place.done("generate --run run --seconds 3 --best 2 --seed 5 --out body.glb");
    // under a prompt, and two of three
    let on = "generate --run run --prompt data/03.bvh --joints root,legs --best 3 --variations 2 --real corpus --out of3.bvh";
    place.done(on);
    assert!(place.at("of3-2.bvh").exists() && !place.at("of3-3.bvh").exists());
    assert!(told("of3-1.bvh")["best"]["verdict"]["skate_share"].is_null(), "legs are given");
    for (call, why) in [
        ("--best 3 --variations 4", "--variations 4 of --best 3; expected as many at most"),
        ("--best 3 --greedy", "cannot be used with"),
        ("--best 3 --real data", "no corpus.json"),
        ("--real corpus", "--real needs --best"),
        ("--best 1", "2..=16"),
    ] {
        let call = format!("generate --run run --seconds 3 {call} --out refused.bvh");
        place.call(&call).assert().code(2).stderr(contains(why));
    }
    assert!(!place.at("refused.bvh").exists());
}

#[test]
fn feet_are_held_where_no_leg_is_given_and_the_sidecar_says_so() {
    let place = place();
    let dance = |name: &str, more: &str| {
        let call =
            format!("generate --run run --prompt data/03.bvh --from-frame 12 --frames 60 --seed 5 {more} --out {name}");
        let said = place.call(&call).assert().success();
        let said = String::from_utf8(said.get_output().stderr.clone()).unwrap();
        (fs::read_to_string(place.at(name)).unwrap(), said)
    };
    let (held, said) = dance("held.bvh", "");
    assert!(said.contains("feet: ") && said.contains("contacts locked"), "{said}");
    let (raw, said) = dance("raw.bvh", "--feet off");
    assert!(!said.contains("feet: "), "{said}");
    let frames =
        |text: &str| text.split_once("Frame Time").unwrap().1.lines().skip(1).map(str::to_owned).collect::<Vec<_>>();
    let (held, raw) = (frames(&held), frames(&raw));
    assert_eq!((held.len(), &held[..17]), (90, &raw[..17]), "frames that are given stay");
    assert_ne!(held, raw);
    let sidecar = |name: &str| fs::read_to_string(place.at(&format!("{name}.kinelm.json"))).unwrap();
    assert!(sidecar("held.bvh").contains("\"feet\": \"lock\"") && !sidecar("raw.bvh").contains("\"feet\""));
    place.done("again held.bvh.kinelm.json --out twice.held.bvh");
    assert_eq!(frames(&fs::read_to_string(place.at("twice.held.bvh")).unwrap()), held);
    let (_, said) = dance("legs.bvh", "--joints root,legs");
    assert!(!said.contains("feet: "), "{said}");
    // what stands already stays about where it is, to within what is held
    let text = place.done("filter held.bvh --feet --out filtered.bvh --json");
    let found: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert!(found["feet"]["held"].as_u64().is_some() && found["kept"].is_null(), "{text}");
}

#[test]
fn it_learns_labels_at_once_or_later_and_dances_under_them() {
    let place = place();
    fs::write(place.at("labels.toml"), CONFIG.replace("[train]", "[train]\nconditions = [\"genre\"]")).unwrap();
    place.done("pretrain --config labels.toml --corpus corpus --run labelled");
    let bits = |more: &str| {
        let text = place.done(&format!("evaluate likelihood --corpus corpus --json {more}"));
        serde_json::from_str::<serde_json::Value>(&text).unwrap()["bits_per_frame"].as_f64().unwrap()
    };
    let (fast, plain) = (bits("--run labelled"), bits("--run labelled --form plain"));
    assert!((plain / fast - 1.0).abs() < 1e-4, "{fast} {plain}");
    assert_ne!(bits("--run labelled --conditions none"), fast);
    let dance = |name: &str, more: &str| {
        place.done(&format!("generate --run labelled --frames 20 --seed 5 {more} --out {name}"));
        fs::read(place.at(name)).unwrap()
    };
    let [salsa, waltz] = ["salsa", "waltz"].map(|g| dance(&format!("{g}.bvh"), &format!("--label genre={g}")));
    assert_ne!(salsa, waltz);
    assert_ne!(dance("guided.bvh", "--label genre=salsa --guidance 3"), salsa);
    place.done(
        "generate --run labelled --prompt data/03.bvh --joints root --label genre=salsa --variations 2 --out p.bvh",
    );
    // over a time: as the first label begins, and as neither goes on
    let timed = dance("timed.bvh", "--label genre=salsa@0s:0.5s --label genre=waltz@0.5s:");
    assert!(timed != salsa && timed != waltz);
    let sidecar = fs::read_to_string(place.at("timed.bvh.kinelm.json")).unwrap();
    assert!(sidecar.contains("\"genre=salsa@0s:0.5s\""), "{sidecar}");
    place.done("again timed.bvh.kinelm.json --out twice.timed.bvh");
    assert_eq!(fs::read(place.at("twice.timed.bvh")).unwrap(), timed);
    for (labels, said) in [
        ("--label genre=salsa@0s:0.5s --label genre=waltz", "one value of genre at a time"),
        ("--label genre=salsa@0s:90s", "90s lies outside the clip"),
        ("--label genre=salsa --label genre=waltz", "given twice"),
    ] {
        let call = format!("generate --run labelled --frames 20 {labels} --out no.bvh");
        place.call(&call).assert().code(2).stderr(contains(said));
    }
    // a model that knew none begins as it was
    fs::write(place.at("more.toml"), "[train]\nbatch = 2\nsteps = 0\nconditions = [\"genre\"]\n").unwrap();
    place.done("finetune --from run --config more.toml --corpus corpus --run later");
    let begun = bits("--run later");
    assert!((begun / bits("--run run") - 1.0).abs() < 1e-3, "{begun}");
}

#[test]
fn a_dance_from_nothing_goes_on_from_a_train_clip_with_its_labels() {
    let place = place();
    fs::write(place.at("led.toml"), CONFIG.replace("[train]", "[train]\nconditions = [\"genre\"]")).unwrap();
    place.done("pretrain --config led.toml --corpus corpus --run led");
    let make = |name: &str, more: &str| {
        place.call(&format!("generate --run led --frames 20 {more} --out {name}")).assert().success()
    };
    let from = |name: &str| {
        let told = fs::read(place.at(&format!("{name}.kinelm.json"))).unwrap();
        let told: serde_json::Value = serde_json::from_slice(&told).unwrap();
        (told["request"]["lead_in"].as_u64(), told["request"]["lead_in_from"]["clip"].as_str().map(str::to_owned))
    };
    let bytes = |name: &str| fs::read(place.at(name)).unwrap();
    let train = [
        ("", ["00", "01", "04", "05", "08", "09"].as_slice()),
        ("salsa", &["00", "04", "08"]),
        ("waltz", &["01", "05", "09"]),
    ];
    for (genre, clips) in train {
        let (name, label) = (format!("led{genre}.bvh"), format!("--label genre={genre}"));
        let label = if genre.is_empty() { "" } else { &label };
        make(&name, label).stderr(contains("(a lead-in of the run) at "));
        let (frames, clip) = from(&name);
        assert!(frames == Some(20) && clip.as_ref().is_some_and(|clip| clips.contains(&&**clip)), "{genre}: {clip:?}");
        place.done(&format!("again {name}.kinelm.json --out twice.{name}"));
        assert_eq!(bytes(&format!("twice.{name}")), bytes(&name));
    }
    make("none.bvh", "--lead-in none");
    assert_eq!(from("none.bvh"), (Some(20), None));
    assert_ne!(bytes("none.bvh"), bytes("led.bvh"));
    place.done("again none.bvh.kinelm.json --out twice.none.bvh");
    assert_eq!(bytes("twice.none.bvh"), bytes("none.bvh"));
    // each of several from its own
    make("many.bvh", "--variations 6");
    let all: Vec<_> = (1..=6).map(|i| from(&format!("many-{i}.bvh")).1).collect();
    assert!(all.iter().any(|clip| *clip != all[0]), "{all:?}");
    assert_eq!(bytes("many-1.bvh"), bytes("led.bvh"));
    place.done("again many-5.bvh.kinelm.json --out twice.many.bvh");
    assert_eq!(bytes("twice.many.bvh"), bytes("many-5.bvh"));
    // an edit that frees all of the first frame
    place.done("generate --run led --prompt data/03.bvh --free all@:1s --tries 2 --out freed.bvh");
    assert_eq!(from("freed.bvh").0, Some(20));
    assert!(from("freed.bvh").1.is_some());
    place.done("again freed.bvh.kinelm.json --out twice.freed.bvh");
    assert_eq!(bytes("twice.freed.bvh"), bytes("freed.bvh"));
    let call = "generate --run led --prompt data/03.bvh --joints root --lead-in train --out no.bvh";
    place.call(call).assert().code(2).stderr(contains("part of the first frame is given"));
    // a model from elsewhere has none
    place.done("export --run led --out led-model");
    place.done("import led-model --run led-back");
    let unled = "generate --run led-back --frames 20 --out";
    place
        .call(&format!("{unled} led-back.bvh"))
        .assert()
        .success()
        .stderr(contains("stores no second of a train clip"));
    assert_eq!(bytes("led-back.bvh"), bytes("none.bvh"));
    place
        .call(&format!("{unled} no.bvh --lead-in train"))
        .assert()
        .code(2)
        .stderr(contains("the run stores no second of a train clip"));
    // a sidecar that names what the run doesn't have, and a run whose file was lost
    let text = fs::read_to_string(place.at("led.bvh.kinelm.json")).unwrap();
    let clip = format!("\"clip\": \"{}\"", from("led.bvh").1.unwrap());
    fs::write(place.at("gone.json"), text.replace(&clip, "\"clip\": \"07\"")).unwrap();
    let again = |file: &str| place.call(&format!("again {file} --out no.bvh")).assert().code(1);
    again("gone.json").stderr(contains("lead_ins.json: found other lead-ins, expected the one of 07 from frame"));
    let kept = bytes("led/lead_ins.json");
    fs::remove_file(place.at("led/lead_ins.json")).unwrap();
    again("led.bvh.kinelm.json").stderr(contains("lead_ins.json: found no lead-ins"));
    place.done("pretrain resume led");
    assert_eq!(bytes("led/lead_ins.json"), kept);
}

#[test]
fn labels_of_a_time_are_learned_from_pieces() {
    let place = place();
    let timed = labels().replace("split,genre", "split,genre,from_s,to_s").replace(",salsa\n", ",salsa,,\n");
    let timed = timed.replace(",waltz\n", ",waltz,,1\n");
    fs::write(place.at("timed.csv"), format!("{timed}01,,salsa,1.5,\n")).unwrap();
    place.done("tokenize data --labels timed.csv --tokenizer t.json --out pieces");
    let clips = fs::read_to_string(place.at("pieces/clips.jsonl")).unwrap();
    let told = |name: &str| {
        let clips = clips.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
        let clip = clips.into_iter().find(|clip| clip["name"] == name).unwrap_or_else(|| panic!("no {name}"));
        (clip["frames"].as_u64().unwrap(), clip["labels"]["genre"].as_str().map(str::to_owned), clip["take"].clone())
    };
    assert_eq!(told("01@0s-1s"), (20, Some("waltz".into()), "01".into()));
    assert_eq!(told("01@1s-1.5s"), (10, None, "01".into()));
    assert_eq!((told("01@1.5s-end").1, told("00").1), (Some("salsa".into()), Some("salsa".into())));
    fs::write(place.at("pieces.toml"), CONFIG.replace("[train]", "[train]\nconditions = [\"genre\"]")).unwrap();
    place.done("pretrain --config pieces.toml --corpus pieces --run of-pieces");
    fs::write(place.at("late.csv"), "clip,genre,from_s,to_s\n00,salsa,1,60\n").unwrap();
    place
        .call("tokenize data --labels late.csv --tokenizer t.json --out late")
        .assert()
        .code(1)
        .stderr(contains("labels from 1 s to 60 s of a clip of 3.0"));
}

#[test]
fn it_learns_what_is_ahead_and_fills_gaps_that_way() {
    let place = place();
    let goal = "[model]\narchitecture = \"two_level\"\ngoal = true\n\
                 [train]\nconditions = [\"genre\"]\nbatch = 2\nsteps = 6\nwarmup = 1\nlearning_rate = 3e-3\ngaps = 0.8\ntable_rate = 3.0\n";
    fs::write(place.at("goal.toml"), goal).unwrap();
    place.done("finetune --from run --config goal.toml --corpus corpus --run goal");
    let bits = |more: &str| {
        let text = place.done(&format!("evaluate likelihood --corpus corpus --json {more}"));
        serde_json::from_str::<serde_json::Value>(&text).unwrap()["bits_per_frame"].as_f64().unwrap()
    };
    let (fast, plain) = (bits("--run goal"), bits("--run goal --form plain"));
    assert!((plain / fast - 1.0).abs() < 1e-4, "{fast} {plain}");
    let fill = |run: &str, more: &str, name: &str| {
        let call = format!("generate --run {run} --prompt data/03.bvh --free all@1s:1.7s --seed 5 {more} --out {name}");
        place.done(&call);
        fs::read_to_string(place.at(&format!("{name}.kinelm.json"))).unwrap()
    };
    let led = fill("goal", "", "goal.bvh");
    assert!(led.contains("\"goal_guidance\": 1.5") && led.contains("\"top_p\": 0.7"), "{led}");
    assert!(fill("run", "", "plain.bvh").contains("\"top_p\": 0.97"));
    let blind = fill("goal", "--goal-guidance 0", "blind.bvh");
    assert!(!blind.contains("\"goal_guidance\":") && blind.contains("\"top_p\": 0.97"), "{blind}");
    assert!(fill("goal", "--goal-guidance 1", "once.bvh").contains("\"goal_guidance\": 1.0"));
    let bytes = |name: &str| fs::read(place.at(name)).unwrap();
    assert_ne!(bytes("goal.bvh"), bytes("blind.bvh"));
    place.done("again goal.bvh.kinelm.json --out twice.goal.bvh");
    assert_eq!(bytes("twice.goal.bvh"), bytes("goal.bvh"));
    // led, and under labels that change within the gap
    let labels = "--label genre=salsa@:1.3s --label genre=waltz@1.3s: --guidance 2";
    assert!(fill("goal", labels, "both.bvh").contains("\"goal_guidance\": 1.5"));
    assert_ne!(bytes("both.bvh"), bytes("goal.bvh"));
    place.done("again both.bvh.kinelm.json --out twice.both.bvh");
    assert_eq!(bytes("twice.both.bvh"), bytes("both.bvh"));
    fill("goal", "--label genre=salsa --goal-guidance 0", "unled.bvh");
    assert_ne!(bytes("both.bvh"), bytes("unled.bvh"));
    // a model that can't be told
    assert!(!fill("run", "", "untold.bvh").contains("\"goal_guidance\":"));
    let call = "generate --run run --prompt data/03.bvh --free all@1s:1.7s --goal-guidance 2 --out no.goal.bvh";
    place.call(call).assert().failure().stderr(contains("this model isn't goal-conditioned"));
    place.done("export --run goal --out told");
    place.done("import told --run told-back");
    assert_eq!(bits("--run told-back"), fast);
    let text = place.done("evaluate likelihood --run goal --corpus corpus --json --gaps 2,3");
    let found: serde_json::Value = serde_json::from_str(&text).unwrap();
    let gaps: Vec<u64> = found["gaps"].as_array().unwrap().iter().map(|gap| gap["frames"].as_u64().unwrap()).collect();
    assert_eq!(gaps, [2, 3]);
    place
        .call("evaluate likelihood --run run --corpus corpus --gaps 2")
        .assert()
        .failure()
        .stderr(contains("this model has model.goal = false"));
}

#[test]
fn it_leaves_as_a_folder_of_our_own_and_comes_back() {
    let place = place();
    place.done("export --run run --out model");
    place.done("import model --run back");
    let bits = |run: &str| {
        let text = place.done(&format!("evaluate likelihood --run {run} --corpus corpus --json"));
        serde_json::from_str::<serde_json::Value>(&text).unwrap()["bits_per_frame"].as_f64().unwrap()
    };
    assert_eq!(bits("back"), bits("run"));
    place.call("export --run run --format hf --out hf").assert().failure().stderr(contains("it has two levels"));
}

#[test]
fn it_names_dances_and_finds_what_is_like_them() {
    let place = place();
    place.done("classify train --run run --corpus corpus --fields genre --steps 2 --batch 2 --out who");
    let told = place.done("classify eval --classifier who --corpus corpus --baselines --run run");
    assert!(told.contains("class tokens") && told.contains("LDA of the model's vectors"), "{told}");
    assert!(place.done("classify predict --classifier who data/03.bvh").contains("a letter a second"));
    place.done("query build data --transform model --run run --out index");
    let found = place.done("query find data/03.bvh --index index --at 0.5");
    assert!(found.contains("cosine") && found.contains("2.13"), "{found}");
}

#[test]
fn what_it_is_not_made_for_is_refused_before_anything_is_written() {
    let place = place();
    fs::write(place.at("context.toml"), CONFIG.replace("window = 6", "window = 6\nhead = \"absolute\"")).unwrap();
    place
        .call("pretrain --config context.toml --corpus corpus --run no")
        .assert()
        .failure()
        .stderr(contains("model.head = \"absolute\""));
    place.done("tokenizer fit data --labels labels.csv --config lapped --out lapped.json");
    place.done("tokenize data --labels labels.csv --tokenizer lapped.json --out tiles");
    place
        .call("pretrain --config c.toml --corpus tiles --run no")
        .assert()
        .failure()
        .stderr(contains("uniform or quantile"));
    assert!(!place.at("no").exists());
}
