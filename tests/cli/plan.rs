//! Plans: several clips laid on a timeline, what none of them gives made anew.

use crate::support::{kinelm_in, read};
use assert_cmd::Command;
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::{Motion, format, synth};
use predicates::str::contains;
use std::fs;
use std::path::PathBuf;
use std::sync::OnceLock;

const CONFIG: &str = "[model]\narchitecture = \"two_level\"\nlayers = 1\nheads = 2\nwidth = 16\nwindow = 32\n\
                      [model.decoder]\nlayers = 1\nheads = 2\nwidth = 16\n\
                      [train]\nconditions = [\"genre\"]\nbatch = 2\nsteps = 4\nwarmup = 1\neval_every = 4\ncheckpoint_every = 4\n";

/// A run of a few steps on six short dances of 60 frames a second, and one of them at 30.
struct Set {
    dir: tempfile::TempDir,
}

impl Set {
    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn call(&self, words: &str) -> Command {
        kinelm_in(self.dir.path(), words)
    }

    /// The numbers of a BVH's rows as they are printed.
    fn rows(&self, name: &str) -> Vec<Vec<String>> {
        let text = fs::read_to_string(self.at(name)).unwrap();
        let (_, rows) = text.split_once("Frame Time").unwrap();
        rows.lines().skip(1).map(|row| row.split_whitespace().map(str::to_owned).collect()).collect()
    }
}

fn set() -> &'static Set {
    static SET: OnceLock<Set> = OnceLock::new();
    SET.get_or_init(|| {
        let set = Set { dir: tempfile::tempdir().unwrap() };
        fs::create_dir(set.at("data")).unwrap();
        let write = |name: &str, clip| {
            let path = set.at(name);
            let motion = Motion::new(&path, clip);
            format::write(&path, &motion).unwrap();
        };
        let mut labels = "clip,split,genre\n".to_string();
        for (i, dance) in synth::corpus(3, 6, 5.0, 60.0).unwrap().into_iter().enumerate() {
            if i == 5 {
                write("slow.bvh", resample(&dance.clip, 30.0, Method::Auto).unwrap());
            }
            let split = ["train", "train", "train", "train", "valid", "test"][i];
            labels += &format!("{i},{split},{}\n", dance.genre);
            write(&format!("data/{i}.bvh"), dance.clip);
        }
        fs::write(set.at("labels.csv"), labels).unwrap();
        fs::write(set.at("c.toml"), CONFIG).unwrap();
        set.call("tokenizer fit data --labels labels.csv --out t.json").assert().success();
        set.call("tokenize data --labels labels.csv --tokenizer t.json --out corpus").assert().success();
        set.call("pretrain --config c.toml --corpus corpus --run run").assert().success();
        fs::write(set.at("plan.toml"), PLAN).unwrap();
        set
    })
}

const PLAN: &str = r#"rig = "a"
transition = 0.5

[clips.a]
file = "data/0.bvh"
skip = 4
[clips.b]
file = "data/1.bvh"
[clips.slow]
file = "slow.bvh"

[[segment]]
clip = "a"
from = 0
to = 1.5
at = 0.5

[[segment]]
clip = "b"
from = 1.5
to = "210f"
at = "60f"

[[segment]]
clip = "slow"
joints = "right_arm"
from = "4.5s"
to = 6

[[segment]]
clip = "a"
joints = "legs,head"
from = 5
to = 6
at = 3
"#;

#[test]
fn clips_keep_their_numbers_and_what_is_between_is_made_anew() {
    let set = set();
    let said = set.call("generate timeline plan.toml --run run --tries 2 --seed 3 --out dance.bvh").assert().success();
    let said = String::from_utf8(said.get_output().stderr.clone()).unwrap();
    assert!(said.contains("slow (slow.bvh) has another rig or rate than the timeline's"), "{said}");
    assert!(said.contains("given all@0f:75f") && said.contains("given right_arm@270f:360f"), "{said}");
    let (dance, a, b) = (set.rows("dance.bvh"), set.rows("data/0.bvh"), set.rows("data/1.bvh"));
    assert_eq!(dance.len(), 360);
    // a's from its 34th row on: 4 are left out, and half a second; a quarter of a second before b is made anew
    assert_eq!(dance[..75], a[34..109]);
    // of b all but the root, which goes on where a has come to
    for frame in 105..210 {
        let own = &b[60 + frame - 90];
        assert_eq!(dance[frame][6..], own[6..], "frame {frame}");
        assert_ne!(dance[frame][..6], own[..6], "frame {frame}");
    }
    let step = |rows: &[Vec<String>], f: usize| {
        let at = |f: usize, axis: usize| rows[f][axis].parse::<f64>().unwrap();
        [0, 2].map(|axis| at(f + 1, axis) - at(f, axis)).iter().map(|x| x * x).sum::<f64>().sqrt()
    };
    for frame in 110..200 {
        assert!((step(&dance, frame) - step(&b, frame - 30)).abs() < 1e-3, "turned and moved as a whole");
    }
    let far = |f: usize, g: usize| {
        (0..3)
            .map(|i| (dance[f][i].parse::<f64>().unwrap() - dance[g][i].parse::<f64>().unwrap()).powi(2))
            .sum::<f64>()
            .sqrt()
    };
    assert!(far(74, 105) < 80.0, "centimetres: joined in place: {}", far(74, 105));
    // the legs and the head of a at the end, no more of it
    let same = (0..dance[0].len()).filter(|&i| (310..355).all(|f| dance[f][i] == a[4 + 180 + f - 300][i])).count();
    assert!((24..40).contains(&same), "{same} columns");

    let told = fs::read_to_string(set.at("dance.bvh.kinelm.json")).unwrap();
    assert!(told.contains("\"timeline\"") && told.contains("\"at\": \"60f\""), "{told}");
    set.call("again dance.bvh.kinelm.json --out twice.bvh").assert().success();
    assert_eq!(fs::read(set.at("twice.bvh")).unwrap(), fs::read(set.at("dance.bvh")).unwrap());
    // longer than its segments, and as a skeleton of another kind
    set.call("generate timeline plan.toml --run run --tries 1 --seconds 7 --rig model --out long.json")
        .assert()
        .success();
    let long = read(&set.at("long.json"));
    assert_eq!((long.fps(), long.frames()), (60.0, 420), "at the rate of the timeline");
}

#[test]
fn moments_of_a_clip_are_its_own_and_all_that_meet_it_wait_alike() {
    let set = set();
    let head = "rig = \"a\"\n[clips.a]\nfile = \"data/0.bvh\"\n[clips.slow]\nfile = \"slow.bvh\"\nskip = 15\n";
    let segment = |clip: &str, joints: &str, from: f64, to: f64, at: &str| {
        format!("[[segment]]\nclip = \"{clip}\"\njoints = \"{joints}\"\nfrom = {from}\nto = {to}\nat = {at}\n")
    };
    // frame 45 of a file at 30 frames a second, of which 15 are left out: its second second
    let plan = head.to_owned() + &segment("slow", "all", 0.0, 1.0, "\"45f\"");
    fs::write(set.at("own.toml"), plan).unwrap();
    set.call("generate timeline own.toml --check").assert().success().stdout(contains("all of slow from 1.00 s on"));
    let both = segment("a", "root,legs", 2.0, 3.5, "3") + &segment("a", "arms", 2.0, 3.5, "0");
    fs::write(set.at("own.toml"), head.to_owned() + &segment("a", "all", 0.0, 2.0, "0") + &both).unwrap();
    let drawn = set.call("generate timeline own.toml --check").assert().success();
    let drawn = String::from_utf8(drawn.get_output().stdout.clone()).unwrap();
    assert!(drawn.contains("0.00 to    1.50 s  all"), "{drawn}");
    assert!(drawn.contains("2.50 to    3.50 s  root,legs") && drawn.contains("2.50 to    3.50 s  arms"), "{drawn}");
    // a rig alone, as exporters write it
    let text = fs::read_to_string(set.at("data/0.bvh")).unwrap();
    let (head, rows) = text.split_once("Frames: ").unwrap();
    let rate = rows.lines().find(|line| line.starts_with("Frame Time")).unwrap();
    fs::write(set.at("bare.bvh"), format!("{head}Frames: 0\n{rate}\n")).unwrap();
    fs::write(set.at("own.toml"), PLAN.replace("file = \"data/0.bvh\"\nskip = 4", "file = \"bare.bvh\"")).unwrap();
    set.call("generate timeline own.toml --check").assert().failure().stderr(contains("own.toml:4:1: found no frames"));
}

#[test]
fn a_dance_of_a_plan_is_made_again_where_its_clips_are_now() {
    let set = set();
    set.call("generate timeline plan.toml --run run --tries 1 --seed 4 --out here.bvh").assert().success();
    fs::create_dir_all(set.at("there/data")).unwrap();
    for name in ["data/0.bvh", "data/1.bvh", "slow.bvh", "plan.toml"] {
        fs::copy(set.at(name), set.at(&format!("there/{name}"))).unwrap();
    }
    set.call("again here.bvh.kinelm.json --timeline there/plan.toml --out again.bvh").assert().success();
    assert_eq!(fs::read(set.at("again.bvh")).unwrap(), fs::read(set.at("here.bvh")).unwrap());
    fs::copy(set.at("data/2.bvh"), set.at("there/data/1.bvh")).unwrap();
    let changed = "again here.bvh.kinelm.json --timeline there/plan.toml --out other.bvh";
    set.call(changed).assert().failure().stderr(contains("the clip that the timeline is composed into is SHA-256 "));
    for (option, why) in
        [("--prompt data/0.bvh", "the dance has a timeline instead"), ("--music no.wav", "the dance has none")]
    {
        let call = format!("again here.bvh.kinelm.json {option} --out other.bvh");
        set.call(&call).assert().code(2).stderr(contains(why));
    }
    assert!(!set.at("other.bvh").exists());
}

/// A plan of a clip with a gap, and what else is to stand there.
fn with_gap(more: &str) -> String {
    let segment = |from: f64, to: f64| format!("[[segment]]\nclip = \"a\"\nfrom = {from}\nto = {to}\nat = {from}\n");
    let head = "rig = \"a\"\n[clips.a]\nfile = \"data/0.bvh\"\n";
    format!("{head}{}{}{more}", segment(0.0, 1.0), segment(2.5, 3.5))
}

#[test]
fn a_plan_tells_labels_of_its_times() {
    let set = set();
    let sway = "[[segment]]\nfrom = 1\nto = 2\nlabels = { genre = \"sway\" }\n";
    fs::write(set.at("sway.toml"), with_gap(sway)).unwrap();
    fs::write(set.at("stomp.toml"), with_gap(&sway.replace("sway", "stomp"))).unwrap();
    fs::write(set.at("none.toml"), with_gap("")).unwrap();
    set.call("generate timeline sway.toml --check").assert().success().stdout(contains("\nlabel genre=sway@1s:2s\n"));
    for name in ["sway", "stomp", "none"] {
        let guidance = if name == "none" { "" } else { "--guidance 3" };
        set.call(&format!("generate timeline {name}.toml --run run {guidance} --tries 1 --out {name}.bvh"))
            .assert()
            .success();
    }
    let [sway_rows, stomp, none] = ["sway.bvh", "stomp.bvh", "none.bvh"].map(|name| set.rows(name));
    assert!(sway_rows != stomp && sway_rows != none, "another word, another dance");
    assert_eq!((&sway_rows[..55], &sway_rows[150..]), (&none[..55], &none[150..]), "where it is given nothing changes");
    set.call("again sway.bvh.kinelm.json --out sway-2.bvh").assert().success();
    assert_eq!(fs::read(set.at("sway-2.bvh")).unwrap(), fs::read(set.at("sway.bvh")).unwrap());
    let call = "generate timeline sway.toml --run run --label genre=stomp --out mislabeled.bvh";
    set.call(call).assert().failure().stderr(contains("expected one value of genre at a time"));
    // all to the end, with a clip and its label in one
    let both = sway
        .replace("to = 2", "to = 4.01")
        .replace("from = 1\n", "clip = \"a\"\njoints = \"head\"\nat = 3.5\nfrom = 3.5\n");
    fs::write(set.at("both.toml"), with_gap(&both)).unwrap();
    set.call("generate timeline both.toml --check").assert().success().stdout(contains("\nlabel genre=sway@3.5s:\n"));
    set.call("generate timeline both.toml --run run --tries 1 --out both.bvh").assert().success();
    for (more, told) in [
        (sway.replace("labels", "# labels"), "mislabeled.toml:14:1: found neither a clip nor labels"),
        (sway.replace("to = 2", "to = 2\nat = 1"), "found joints or at without a clip"),
        (format!("{sway}{}", sway.replace("to = 2", "to = 3")), "while segment 3 says what genre is too"),
        (sway.replace("to = 2", "to = 0"), "expected an end after the beginning"),
    ] {
        fs::write(set.at("mislabeled.toml"), with_gap(&more)).unwrap();
        set.call("generate timeline mislabeled.toml --check").assert().failure().stderr(contains(told));
    }
    let head = with_gap("").split("[[segment]]").next().unwrap().to_owned();
    fs::write(set.at("mislabeled.toml"), head + sway).unwrap();
    set.call("generate timeline mislabeled.toml --check")
        .assert()
        .failure()
        .stderr(contains("segments with labels alone, expected at least one with a clip"));
    fs::write(set.at("waltz.toml"), with_gap(&sway.replace("sway", "waltz"))).unwrap();
    let waltz = set.call("generate timeline waltz.toml --run run --out mislabeled.bvh").assert().failure();
    waltz.stderr(contains("waltz"));
}

#[test]
fn a_plan_is_drawn_as_text() {
    let set = set();
    let drawn = set.call("generate timeline plan.toml --check").assert().success();
    let drawn = String::from_utf8(drawn.get_output().stdout.clone()).unwrap();
    assert!(
        drawn.starts_with("6.00 s, 360 frames at 60 fps\n1     0.00 to    1.25 s  all of a from 0.50 s on\n"),
        "{drawn}"
    );
    assert!(drawn.contains("right_arm of slow from 0.00 s on") && drawn.contains(", turned by "), "{drawn}");
    let line =
        |part: &str| drawn.lines().find(|line| line.starts_with(part)).unwrap().split_once(' ').unwrap().1.trim();
    assert_eq!(line("root"), format!("{}{}{}{}", "1".repeat(15), ".".repeat(6), "2".repeat(21), ".".repeat(30)));
    assert!(
        line("right_arm").ends_with(&"3".repeat(18)) && line("left_leg").ends_with(&format!(".{}", "4".repeat(12))),
        "{drawn}"
    );
}

#[test]
fn what_is_wrong_with_a_plan_is_told_with_its_line_and_nothing_is_written() {
    let set = set();
    let cases: [(&str, &str, &str); 11] = [
        ("rig = \"a\"", "rig = \"c\"", "wrong.toml:1:7: found `c`, expected the name of one of the clips: a, b, slow"),
        ("clip = \"b\"", "clip = \"bb\"", "found clip = \"bb\", expected one of the clips"),
        ("to = \"210f\"", "to = 1", "wrong.toml:18:1: found from 1.5s to 1s, expected an end after the beginning"),
        ("to = \"210f\"", "to = 99", "which the clip still has there"),
        ("at = \"60f\"", "at = 50", "found at = 50s, expected a moment of the clip, which has 5.00 s"),
        ("to = \"210f\"", "to = \"2m\"", "found to = 2m, expected seconds or frames (40f)"),
        ("joints = \"right_arm\"", "joints = \"wing\"", "joints = \"wing\""),
        (
            "joints = \"legs,head\"",
            "joints = \"legs,arms\"",
            "found right_collar from 5.00 to 6.00 s, which segment 3 gives too",
        ),
        ("skip = 4", "skips = 4", "wrong.toml:6:1: found unknown field `skips`"),
        ("from = 5", "from = \"soon\"", "is no time"),
        ("transition = 0.5", "transition = 5.0", "that transitions take (transition)"),
    ];
    for (from, to, told) in cases {
        assert!(PLAN.contains(from), "{from}");
        fs::write(set.at("wrong.toml"), PLAN.replace(from, to)).unwrap();
        set.call("generate timeline wrong.toml --check").assert().failure().stderr(contains(told));
        set.call("generate timeline wrong.toml --run run --out wrong.bvh").assert().failure().stderr(contains(told));
    }
    fs::write(set.at("wrong.toml"), PLAN.replace("data/1.bvh", "data/none.bvh")).unwrap();
    set.call("generate timeline wrong.toml --check")
        .assert()
        .failure()
        .stderr(contains("wrong.toml:7:1: found data/none.bvh"));
    assert!(!set.at("wrong.bvh").exists());
    for (call, told) in [
        ("--prompt data/0.bvh", "unexpected argument"),
        ("--free legs", "unexpected argument"),
        ("--seconds 2", "of the prompt"),
        ("--skip 3", "unexpected argument"),
        ("--floor 1", "unexpected argument"),
    ] {
        set.call(&format!("generate timeline plan.toml --run run {call} --out wrong.bvh"))
            .assert()
            .code(2)
            .stderr(contains(told));
    }
    // the clips are read, not written over
    let over = "generate timeline plan.toml --run run --force --out data/1.bvh";
    let before = fs::read(set.at("data/1.bvh")).unwrap();
    set.call(over).assert().failure();
    assert_eq!(fs::read(set.at("data/1.bvh")).unwrap(), before);
}

#[test]
fn a_dance_of_a_plan_and_its_clip_play_in_one_time() {
    let set = set();
    // a clip of 30 frames a second that says 60
    fs::copy(set.at("data/2.bvh"), set.at("hasty.bvh")).unwrap();
    let plan = "rig = \"w\"\n[clips.w]\nfile = \"hasty.bvh\"\nfps_source = 30\nskip = 6\n\
                [[segment]]\nclip = \"w\"\nfrom = 0\nto = 1\n[[segment]]\nclip = \"w\"\nfrom = 2\nto = 3\nat = 5\n";
    fs::write(set.at("hasty.toml"), plan).unwrap();
    set.call("generate timeline hasty.toml --run run --tries 1 --out right.bvh").assert().success();
    let dance = format::read(&set.at("right.bvh"), &Default::default()).unwrap().clip;
    assert_eq!((dance.fps(), dance.frames()), (30.0, 90));
    assert_eq!(set.rows("right.bvh")[..30], set.rows("hasty.bvh")[6..36]);
    let assert = set.call("view right.bvh hasty.bvh --out right.html").assert().success();
    let said = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
    assert!(said.contains("hasty.bvh: read as right.bvh followed it"), "{said}");
    assert!(said.contains("each plays in its own time: right 30 fps, 3.00 s; hasty 30 fps, 9.80 s"), "{said}");
    let page = fs::read_to_string(set.at("right.html")).unwrap();
    let (_, behind) = page.split_once("id=\"figures\"").unwrap();
    let json = behind.split_once('>').unwrap().1.split("</script>").next().unwrap();
    let figures: serde_json::Value = serde_json::from_str(json).unwrap();
    assert_eq!((&figures[0]["fps"], &figures[1]["fps"]), (&30.0.into(), &30.0.into()));
    // the gap, and nothing of the clip
    assert_eq!((&figures[0]["anew"], &figures[1]["anew"]), (&serde_json::json!([[1.0, 2.0]]), &serde_json::json!([])));
    // a dance that has a sidecar is a clip of a plan as that says
    let again =
        plan.replace("hasty.bvh", "right.bvh").replace("fps_source = 30\nskip = 6\n", "").replace("at = 5", "at = 1");
    fs::write(set.at("again.toml"), again).unwrap();
    set.call("generate timeline again.toml --run run --tries 1 --out in-time.bvh").assert().success();
    assert_eq!(set.rows("in-time.bvh")[..30], set.rows("right.bvh")[..30]);
}

#[test]
fn a_rig_whose_joints_have_places_is_written_too() {
    let Some(bandai) = kinelm_shared_data::set("bandai-1", "cli_plan") else { return };
    let Some(cmu) = kinelm_shared_data::set("cmu-dance", "cli_plan") else { return };
    let mut walks: Vec<PathBuf> = fs::read_dir(&bandai).unwrap().map(|entry| entry.unwrap().path()).collect();
    walks.retain(|path| path.extension().is_some_and(|extension| extension == "bvh"));
    walks.sort();
    let set = set();
    fs::copy(&walks[0], set.at("walk.bvh")).unwrap();
    let plan = format!(
        "rig = \"walk\"\n[clips.walk]\nfile = \"walk.bvh\"\n[clips.salsa]\nfile = {:?}\nfps_source = 60\nskip = 10\n\
         [[segment]]\nclip = \"walk\"\nfrom = 0\nto = 1\n[[segment]]\nclip = \"salsa\"\nfrom = 2\nto = 3\nat = 4\n",
        cmu.join("salsa/03.bvh")
    );
    fs::write(set.at("walk.toml"), plan).unwrap();
    set.call("generate timeline walk.toml --run run --tries 1 --out walked.bvh").assert().success();
    let (dance, walk) = (set.rows("walked.bvh"), set.rows("walk.bvh"));
    assert_eq!((dance.len(), &dance[..30]), (90, &walk[..30]));
    let read = |name: &str| format::read(&set.at(name), &Default::default()).unwrap().clip;
    let (dance, walk) = (read("walked.bvh"), read("walk.bvh"));
    // no bone has shrunk, and the other clip's body stands at the height of this one
    assert!(dance.skeleton().offsets().iter().zip(walk.skeleton().offsets()).all(|(a, b)| (*a - *b).length() < 1e-4));
    assert!((60..90).all(|f| (dance.root()[f].y - walk.root()[0].y).abs() < 0.1));
}
