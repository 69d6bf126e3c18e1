//! A dance stands where its prompt stands, and what it was given lies where the prompt has it.

use crate::support::{kinelm, save};
use assert_cmd::Command;
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::retarget::{self, Retarget};
use kinelm_motion::rig::{Humanoid, SkeletonMap, map_for};
use kinelm_motion::rotation::{angle_between, heading};
use kinelm_motion::{Clip, EndSite, Quat, Skeleton, Vec3, smpl, synth};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

const CONFIG: &str = "[model]\nlayers = 1\nheads = 2\nwidth = 16\ncontext = 160\n\
                      [train]\nbatch = 2\nsteps = 2\nwarmup = 1\neval_every = 2\ncheckpoint_every = 2\n";

/// A run for each set of joints and way to code the pelvis, on twelve short dances that hold the prompt.
struct Way {
    dir: tempfile::TempDir,
}

impl Way {
    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn generate(&self, run: &str, prompt: &str, joints: Option<&str>, out: &str) -> Command {
        let mut c = kinelm();
        c.arg("generate").arg("--run").arg(self.at(run)).arg("--prompt").arg(self.at(prompt));
        c.args(joints.map(|list| ["--joints", list]).into_iter().flatten()).arg("--out").arg(self.at(out));
        // the frames that were sampled
        c.args(["--fps", "20"]);
        c
    }
}

/// Far from the middle, facing away.
fn elsewhere(clip: &Clip) -> Clip {
    let turn = Quat::from_rotation_y(1.9);
    let root = clip.root().iter().map(|p| turn * *p + Vec3::new(3.1, 0.0, -2.3)).collect();
    let mut rotations = clip.rotations().to_vec();
    rotations.iter_mut().step_by(24).for_each(|pelvis| *pelvis = turn * *pelvis);
    Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations).unwrap()
}

/// A larger body under Mixamo's names, with a twist bone in the right arm and a thumb that move by themselves.
fn on_another_rig(clip: &Clip) -> Clip {
    let name = |id: usize| {
        let map = SkeletonMap::builtin("mixamo").unwrap();
        map.joint(id).unwrap().to_string()
    };
    let body = smpl::neutral();
    let mut names: Vec<String> = (0..24).map(name).collect();
    let (mut parents, mut offsets) =
        (body.parents().to_vec(), body.offsets().iter().map(|o| *o * 1.15).collect::<Vec<_>>());
    // joints 17 19 21 are the right arm: shoulder, elbow, wrist; a joint goes in before the elbow
    names.insert(18, "Twist".into());
    offsets.insert(18, 0.5 * offsets[19]);
    parents.insert(18, Some(17));
    parents.iter_mut().skip(19).for_each(|p| *p = p.map(|p| p + usize::from(p >= 18)));
    (parents[20], offsets[20]) = (Some(18), 0.5 * offsets[20]);
    names.push("Thumb".into());
    parents.push(Some(22));
    offsets.push(Vec3::new(-0.03, 0.0, 0.03));
    let rig = Arc::new(Skeleton::new(names, parents, offsets, vec![]).unwrap());
    let way = Retarget::new(&Humanoid::with_map(&rig, &map_for(&rig, None).unwrap()), body).unwrap();
    let clip = way.to_rig(clip).unwrap();
    let mut rotations = clip.rotations().to_vec();
    for (f, pose) in rotations.chunks_mut(26).enumerate() {
        pose[18] = Quat::from_rotation_x(0.5 + 0.3 * (0.1 * f as f64).sin());
        pose[25] = Quat::from_rotation_y(0.8 * (0.05 * f as f64).sin());
    }
    Clip::new(rig, clip.fps(), clip.root().to_vec(), rotations).unwrap()
}

fn made(dir: &Path, name: &str, data: &[&Path], labels: &Path, more: &[&str]) {
    let [tokenizer, corpus] = ["json", "corpus"].map(|end| dir.join(name).with_extension(end));
    let mut c = kinelm();
    c.args(["tokenizer", "fit"]).args(data).arg("--labels").arg(labels).args(more).arg("--out").arg(&tokenizer);
    if !more.contains(&"--joints") {
        c.args(["--joints", "13"]);
    }
    c.assert().success();
    let mut c = kinelm();
    c.arg("tokenize").args(data).arg("--labels").arg(labels).arg("--tokenizer").arg(&tokenizer);
    c.arg("--out").arg(&corpus).assert().success();
    fs::write(dir.join("c.toml"), CONFIG).unwrap();
    let mut c = kinelm();
    c.arg("pretrain").arg("--config").arg(dir.join("c.toml")).arg("--corpus").arg(&corpus);
    c.arg("--run").arg(dir.join(name)).assert().success();
}

fn way() -> &'static Way {
    static WAY: OnceLock<Way> = OnceLock::new();
    WAY.get_or_init(|| {
        let way = Way { dir: tempfile::tempdir().unwrap() };
        let mut labels = "clip,split\n".to_string();
        for (i, d) in synth::corpus(3, 6, 3.0, 60.0).unwrap().iter().enumerate() {
            let clip = elsewhere(&d.clip);
            save(&way.at(&format!("data/{i}.bvh")), &clip);
            save(&way.at(&format!("{i}.bvh")), &on_another_rig(&clip));
            labels += &format!("{i},{}\n", ["train", "train", "train", "train", "valid", "test"][i]);
        }
        fs::write(way.at("labels.csv"), labels).unwrap();
        let (data, labels) = (way.at("data"), way.at("labels.csv"));
        let heading = ["--root-rotation", "heading_delta"];
        made(way.dir.path(), "13", &[&data], &labels, &["--root-rotation", "absolute"]);
        made(way.dir.path(), "13-heading", &[&data], &labels, &heading);
        made(way.dir.path(), "24-heading", &[&data], &labels, &[heading.as_slice(), &["--joints", "24"]].concat());
        way
    })
}

/// A file on SMPL-24 and on its own rig, at 20 fps.
fn read(path: &Path, options: &ReadOptions) -> [Clip; 2] {
    let motion = format::read(path, options).unwrap();
    let at_rate = |clip: &Clip| resample(clip, 20.0, Method::Auto).unwrap();
    [at_rate(&retarget::to_smpl(&motion).unwrap()), at_rate(&motion.clip)]
}

/// What a rotation turns about the vertical, radians.
fn turn_of(q: Quat) -> f64 {
    2.0 * q.y.atan2(q.w)
}

/// The most that the pelvis is apart: metres on the ground, degrees of its turn, degrees of its whole rotation.
fn pelvis_apart(a: &Clip, b: &Clip) -> [f64; 3] {
    let frames = a.frames().min(b.frames());
    assert!(frames > 20, "{frames} frames");
    let mut most = [0.0f64; 3];
    for f in 0..frames {
        let (p, q) = (a.pose(f)[0], b.pose(f)[0]);
        let turn = turn_of(p) - turn_of(q);
        let off = a.root()[f] - b.root()[f];
        let apart =
            [off.x.hypot(off.z), turn.sin().atan2(turn.cos()).abs().to_degrees(), angle_between(p, q).to_degrees()];
        most = std::array::from_fn(|i| most[i].max(apart[i]));
    }
    most
}

/// Mean and most of the distance of joints by name, cm, each frame's places against a joint's, in the world or its frame.
fn apart(a: &Clip, b: &Clip, joints: &[&str], against: &str, in_its_frame: bool) -> [f64; 2] {
    let at = |name: &str| a.skeleton().find(name).unwrap();
    let (mut all, root) = (Vec::new(), at(against));
    for f in 0..a.frames().min(b.frames()) {
        let poses = [a.global_pose(f), b.global_pose(f)];
        for joint in joints {
            let [p, q] = poses.each_ref().map(|pose| {
                let off = pose.positions[at(joint)] - pose.positions[root];
                if in_its_frame { pose.rotations[root].conjugate() * off } else { off }
            });
            all.push(100.0 * (p - q).length());
        }
    }
    [all.iter().sum::<f64>() / all.len() as f64, all.iter().copied().fold(0.0, f64::max)]
}

const RIGHT: [&str; 2] = ["mixamorig:RightForeArm", "mixamorig:RightHand"];

#[test]
fn a_followed_root_is_where_the_prompt_is_on_either_rig() {
    let way = way();
    for run in ["13", "13-heading", "24-heading"] {
        for rig in ["prompt", "model"] {
            let out = format!("at-{run}-{rig}.bvh");
            let mut c = way.generate(run, "0.bvh", Some("root,right_arm"), &out);
            c.args(["--rig", rig]).assert().success().stderr(contains("outside what").not());
            let [prompt, dance] = ["0.bvh", &out].map(|name| read(&way.at(name), &ReadOptions::default()));
            let i = usize::from(rig == "prompt");
            let [place, turn, whole] = pelvis_apart(&prompt[i], &dance[i]);
            assert!(place < 0.01 && whole < 1.25, "{run} on the {rig}'s rig: {place} m, {whole} degrees");
            assert!(turn < 0.55 || run == "13", "{run} on the {rig}'s rig: {turn} degrees of turn");
            // the height is among what is followed
            let high = |i: usize, f: usize| (prompt[i].root()[f].y - dance[i].root()[f].y).abs();
            assert!((0..20).all(|f| high(i, f) < 0.01), "{run} on the {rig}'s rig");
        }
    }
}

#[test]
fn a_dance_that_goes_on_stands_where_its_beginning_stood() {
    let way = way();
    for run in ["13", "13-heading"] {
        way.generate(run, "1.bvh", None, "on.bvh").args(["--from-frame", "25", "--rig", "prompt"]).assert().success();
        let [prompt, dance] = ["1.bvh", "on.bvh"].map(|name| read(&way.at(name), &ReadOptions::default()));
        let [place, turn, whole] = pelvis_apart(&prompt[1].slice(0..25), &dance[1].slice(0..25));
        assert!(place < 0.01 && turn < 1.25 && whole < 1.25, "{run}: {place} m, {turn} and {whole} degrees");
    }
}

#[test]
fn a_dance_with_a_free_root_begins_where_and_as_the_prompt_stands() {
    let way = way();
    for (run, list) in [("13", "right_arm"), ("13-heading", "legs"), ("24-heading", "pelvis")] {
        way.generate(run, "0.bvh", Some(list), "free.bvh").assert().success();
        let [prompt, dance] = ["0.bvh", "free.bvh"].map(|name| read(&way.at(name), &ReadOptions::default())[0].clone());
        let (p, d) = (prompt.root()[0], dance.root()[0]);
        assert!((p.x - d.x).hypot(p.z - d.z) < 1e-4, "{run}, {list}: {p} and {d}");
        let turn = heading(prompt.pose(0)[0]).unwrap() - heading(dance.pose(0)[0]).unwrap();
        let most = if list == "pelvis" { 0.55 } else { 0.01 };
        assert!(turn.sin().atan2(turn.cos()).abs().to_degrees() < most, "{run}, {list}: {turn}");
    }
}

#[test]
fn a_given_arm_lies_where_the_prompt_has_it() {
    let way = way();
    for run in ["13", "13-heading"] {
        let mut c = way.generate(run, "0.bvh", Some("root,right_arm"), "arm.bvh");
        let said = contains("0.0000 % of the given characters differ; the given joints are ");
        c.args(["--rig", "prompt"]).assert().success().stderr(said.and(contains("free, and they move").not()));
        let [prompt, dance] = ["0.bvh", "arm.bvh"].map(|name| read(&way.at(name), &ReadOptions::default())[1].clone());
        let [mean, most] = apart(&prompt, &dance, &RIGHT, "mixamorig:Hips", false);
        assert!(mean < 1.0 && most < 3.0, "{run}: {mean} cm, {most} at most");
        // what no SMPL joint stands for moves along
        let j = dance.skeleton().find("Thumb").unwrap();
        let thumb = |f: usize| angle_between(prompt.pose(f)[j], dance.pose(f)[j]).to_degrees();
        assert!((0..dance.frames()).all(|f| thumb(f) < 0.01));
    }
    // with identity it is elsewhere, and the line says so
    let mut c = way.generate("13", "0.bvh", Some("root,right_arm"), "arm-0.bvh");
    c.args(["--rig", "prompt", "--uncoded-joints", "identity"]).assert().success();
    let [prompt, dance] = ["0.bvh", "arm-0.bvh"].map(|name| read(&way.at(name), &ReadOptions::default())[1].clone());
    assert!(apart(&prompt, &dance, &RIGHT, "mixamorig:Hips", false)[1] > 3.0);
}

#[test]
fn free_joints_above_a_given_arm_are_named_and_can_be_given_too() {
    let way = way();
    let offer = || contains("spine1, spine2, spine3: free").and(contains("--joints root,torso,right_arm\n"));
    way.generate("24-heading", "0.bvh", Some("root,right_arm"), "spine.bvh")
        .args(["--rig", "prompt"])
        .assert()
        .success()
        .stderr(offer());
    way.generate("24-heading", "0.bvh", Some("right_arm"), "spine-2.bvh").assert().success().stderr(offer());
    let prompt = read(&way.at("0.bvh"), &ReadOptions::default())[1].clone();
    let dance = |name: &str| read(&way.at(name), &ReadOptions::default())[1].clone();
    let [mean, most] = apart(&prompt, &dance("spine.bvh"), &RIGHT, "mixamorig:RightShoulder", true);
    assert!(mean < 1.0 && most < 3.0, "{mean} cm, {most} at most");
    way.generate("24-heading", "0.bvh", Some("root,torso,right_arm"), "torso.bvh")
        .args(["--rig", "prompt"])
        .assert()
        .success()
        .stderr(contains("free, and they move").not());
    let [mean, most] = apart(&prompt, &dance("torso.bvh"), &RIGHT, "mixamorig:Hips", false);
    assert!(mean < 1.0 && most < 3.0, "{mean} cm, {most} at most");
}

#[test]
fn uncoded_joints_go_to_their_mean_when_the_prompt_ends() {
    let way = way();
    let mut c = way.generate("13", "0.bvh", Some("root"), "ends.bvh");
    c.args(["--frames", "90", "--rig", "prompt"]).assert().success();
    let [prompt, dance] = ["0.bvh", "ends.bvh"].map(|name| read(&way.at(name), &ReadOptions::default())[1].clone());
    for name in ["mixamorig:Spine", "Thumb"] {
        let j = dance.skeleton().find(name).unwrap();
        let apart = |f: usize, g: usize| angle_between(prompt.pose(f)[j], dance.pose(g)[j]).to_degrees();
        let most = (0..prompt.frames()).map(|f| apart(f, f)).fold(0.0, f64::max);
        assert!(most < 0.01, "{name}: {most} degrees");
        let last = prompt.frames() - 1;
        let steps = (last..89).map(|f| angle_between(dance.pose(f)[j], dance.pose(f + 1)[j]).to_degrees());
        let steps: Vec<f64> = steps.collect();
        assert!(steps[10..].iter().all(|s| *s < 0.01) && steps[..10].iter().sum::<f64>() > 0.5, "{name}: {steps:?}");
        assert!(steps.iter().all(|s| *s < 10.0), "{name}: {steps:?}");
    }
    // where only a beginning is followed, it is its end that counts
    let mut c = way.generate("13", "0.bvh", None, "begins.bvh");
    c.args(["--from-frame", "30", "--rig", "prompt"]).assert().success();
    let dance = read(&way.at("begins.bvh"), &ReadOptions::default())[1].clone();
    let thumb = dance.skeleton().find("Thumb").unwrap();
    let still = |f: usize| angle_between(dance.pose(f)[thumb], dance.pose(f + 1)[thumb]).to_degrees() < 0.01;
    assert!(!still(10) && !still(34) && (40..dance.frames() - 1).all(still));
}

#[test]
fn without_a_prompt_uncoded_joints_stand_as_in_training() {
    let way = way();
    let make = |out: &str, more: &[&str]| {
        let mut c = kinelm();
        c.arg("generate").arg("--run").arg(way.at("13")).args(["--frames", "5", "--out"]).arg(way.at(out)).args(more);
        c.assert().success();
        format::read(&way.at(out), &ReadOptions::default()).unwrap().clip
    };
    let tokenizer = kinelm_tokenizer::Tokenizer::load(way.at("13.json")).unwrap();
    let mean = tokenizer.mean_pose();
    let (dance, still) = (make("alone.json", &[]), make("still.json", &["--uncoded-joints", "identity"]));
    for j in [3, 6, 9, 12, 15] {
        assert!(angle_between(dance.pose(4)[j], mean[j]) < 1e-9 && still.pose(4)[j] == Quat::IDENTITY, "joint {j}");
    }
    assert!(angle_between(mean[3], Quat::IDENTITY) > 0.001);
}

#[test]
fn the_placement_is_in_the_sidecar_and_a_request_without_an_option_has_its_default() {
    let way = way();
    let make = |out: &str, more: &[&str]| {
        let mut c = way.generate("13", "0.bvh", Some("root"), out);
        c.args(["--rig", "prompt"]).args(more).assert().success();
    };
    make("told.bvh", &[]);
    let sidecar = |name: &str| {
        let path = [format!("{name}.bvh.kinelm.json"), format!("{name}.kinelm.json")].map(|n| way.at(&n));
        path.into_iter().find(|p| p.exists()).unwrap()
    };
    let told = |name: &str| -> serde_json::Value { serde_json::from_slice(&fs::read(sidecar(name)).unwrap()).unwrap() };
    let request = told("told")["request"].clone();
    let prompt = read(&way.at("0.bvh"), &ReadOptions::default())[0].clone();
    let near = |field: &str, x: f64| (request["placement"][field].as_f64().unwrap() - x).abs() < 1e-9;
    assert!(near("x", prompt.root()[0].x) && near("z", prompt.root()[0].z), "{request}");
    assert!(near("heading", heading(prompt.pose(0)[0]).unwrap()) && request["uncoded_joints"] == "follow", "{request}");
    let again = |name: &str| kinelm().args(["again"]).arg(sidecar(name)).assert();
    again("told").success();

    // without a placement a dance begins at x = z = 0
    make("old.bvh", &["--uncoded-joints", "identity"]);
    let mut old = told("old");
    old["request"].as_object_mut().unwrap().remove("placement");
    fs::write(sidecar("old"), serde_json::to_vec(&old).unwrap()).unwrap();
    let assert = again("old").code(1).stderr(contains("came out different"));
    let said = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    let hash = said.split_once("SHA-256 ").unwrap().1.split(',').next().unwrap();
    old["output"]["sha256"] = hash.into();
    fs::write(sidecar("old"), serde_json::to_vec(&old).unwrap()).unwrap();
    let out = way.at("then.bvh");
    let mut c = kinelm();
    c.args(["again"]).arg(sidecar("old")).arg("--out").arg(&out).assert().success();
    let begins = read(&out, &ReadOptions::default())[0].root()[0];
    assert!(begins.x.hypot(begins.z) < 0.003, "{begins}");

    // random numbers of the seed alone make another dance
    make("sampled.bvh", &[]);
    let mut old = told("sampled");
    assert_eq!(old["request"]["seeding"], "inputs");
    old["request"]["seeding"] = "seed".into();
    fs::write(sidecar("sampled"), serde_json::to_vec(&old).unwrap()).unwrap();
    again("sampled").code(1).stderr(contains("came out different"));

    // the first frame is chosen among candidates
    let make = |out: &str, more: &[&str]| {
        let mut c = way.generate("13", "0.bvh", Some("root,right_arm"), out);
        c.args(more).assert().success();
    };
    make("chosen.bvh", &[]);
    assert_eq!(told("chosen")["request"]["first_frames"], 64);
    make("first.bvh", &["--first-frames", "1"]);
    let bytes = |name: &str| fs::read(way.at(name)).unwrap();
    assert_eq!(told("first")["request"].get("first_frames"), None);
    assert!(bytes("first.bvh") != bytes("chosen.bvh"));
    for name in ["chosen", "first"] {
        again(name).success();
    }
    assert_eq!(told("told")["request"].get("first_frames"), None, "root comes before all that is sampled");

    // what is given in part keeps a dance going, so that less is left to chance
    let top_p = |name: &str| told(name)["request"]["sampling"]["top_p"].clone();
    make("asked.bvh", &["--top-p", "0.9"]);
    make("few.bvh", &["--top-k", "9"]);
    make("short.bvh", &["--from-frame", "2"]);
    make("longer.bvh", &["--frames", "120"]);
    let found = ["chosen", "told", "asked", "few", "short", "longer"].map(top_p);
    assert_eq!(found, [json!(0.8), json!(0.95), json!(0.9), json!(null), json!(0.8), json!(0.95)]);
    let mut none = way.generate("13", "0.bvh", Some("root"), "none.bvh");
    none.args(["--first-frames", "4"]).assert().code(2).stderr(contains("nothing to choose a first frame by"));
}

/// The figures of a page.
fn figures(page: &Path) -> Vec<serde_json::Value> {
    let text = fs::read_to_string(page).unwrap();
    let (_, behind) = text.split_once("id=\"figures\"").unwrap();
    let json = behind.split_once('>').unwrap().1.split("</script>").next().unwrap();
    serde_json::from_str(json).unwrap()
}

#[test]
fn a_dance_beside_its_prompt_plays_at_its_own_rate_and_stands_with_it() {
    let way = way();
    // a prompt that states a rate three times too slow, with ten frames to be left out
    let prompt = format::read(&way.at("0.bvh"), &ReadOptions::default()).unwrap();
    save(&way.at("slow.bvh"), &prompt.clip.with_fps(20.0).unwrap());
    let mut c = way.generate("13", "slow.bvh", Some("root"), "seen.bvh");
    c.args(["--rig", "prompt", "--fps-source", "60", "--skip", "10"]).assert().success();
    fs::copy(way.at("slow.bvh"), way.at("elsewhere.bvh")).unwrap();
    let page = way.at("page.html");
    let view = |files: &[&str], more: &[&str]| {
        let mut c = kinelm();
        c.arg("view").args(files.iter().map(|f| way.at(f))).args(more).arg("--out").arg(&page);
        let said = String::from_utf8_lossy(&c.assert().success().get_output().stderr).into_owned();
        (figures(&page), said)
    };
    let of = |f: &serde_json::Value| (f["fps"].as_f64().unwrap().round(), f["frames"].as_u64().unwrap());
    let frames = read(&way.at("seen.bvh"), &ReadOptions::default())[1].frames() as u64;
    for more in [&[][..], &["--fps-source", "30", "--skip", "4"]] {
        let (found, said) = view(&["seen.bvh", "elsewhere.bvh"], more);
        assert_eq!((of(&found[0]), of(&found[1])), ((20.0, frames), (60.0, 170)), "{more:?}");
        assert!(said.contains("elsewhere.bvh: read as seen.bvh followed it"), "{said}");
        assert_eq!((&found[0]["onto"], &found[0]["world"]), (&found[1]["onto"], &found[1]["world"]));
    }
    // options of a file win, and concern it alone
    let (found, _) = view(&["seen.bvh", "elsewhere.bvh:fps=30,skip=0", "1.bvh:skip=5"], &[]);
    assert_eq!((of(&found[0]), of(&found[1])), ((20.0, frames), (30.0, 180)));
    assert_eq!((of(&found[2]), &found[2]["world"]), ((60.0, 175), &1.into()));
    let (found, _) = view(&["0.bvh", "1.bvh"], &[]);
    assert_ne!(found[0]["world"], found[1]["world"]);
    let (found, _) = view(&["0.bvh", "1.bvh"], &["--together"]);
    assert_eq!((&found[0]["onto"], &found[0]["world"]), (&found[1]["onto"], &found[1]["world"]));
    let mut c = kinelm();
    c.arg("view").arg(format!("{}:speed=2", way.at("0.bvh").display())).arg("--out").arg(way.at("no.html"));
    c.assert().code(2).stderr(contains("one of fps, skip, up, unit"));
}

/// The clip of a program that has z up.
fn with_z_up(clip: &Clip) -> Clip {
    let lay = |v: Vec3| Vec3::new(v.x, -v.z, v.y);
    let rig = clip.skeleton();
    let ends = rig.ends().iter().map(|e| EndSite { parent: e.parent, offset: lay(e.offset) }).collect();
    let offsets = rig.offsets().iter().map(|o| lay(*o)).collect();
    let rig = Skeleton::new(rig.names().to_vec(), rig.parents().to_vec(), offsets, ends).unwrap();
    let rotations = clip.rotations().iter().map(|q| Quat::from_xyzw(q.x, -q.z, q.y, q.w)).collect();
    Clip::new(Arc::new(rig), clip.fps(), clip.root().iter().map(|p| lay(*p)).collect(), rotations).unwrap()
}

#[test]
fn a_dance_on_its_prompts_rig_is_read_as_its_prompt_was() {
    let way = way();
    let prompt = format::read(&way.at("0.bvh"), &ReadOptions::default()).unwrap();
    save(&way.at("z.bvh"), &with_z_up(&prompt.clip));
    for (i, (prompt, more)) in [("0.bvh", &[][..]), ("z.bvh", &[]), ("z.bvh", &["--up", "z"])].into_iter().enumerate() {
        let out = format!("rig{i}.bvh");
        let mut c = way.generate("13", prompt, Some("root,right_arm"), &out);
        let assert = c.args(["--rig", "prompt"]).args(more).assert().success();
        let said = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
        let percent = said.split(" % of the given characters differ").next().unwrap().rsplit(' ').next().unwrap();
        assert!(percent.parse::<f64>().unwrap() < 1.0, "{said}");
        // measuring says what generating said
        let mut c = kinelm();
        c.args(["evaluate", "dance", "--json", "--real"]).arg(way.at("13.corpus")).arg(way.at(&out));
        let found: serde_json::Value = serde_json::from_slice(&c.output().unwrap().stdout).unwrap();
        let mismatch = found["prompted"][0][1]["mismatch"].as_f64().unwrap();
        assert_eq!(format!("{:.4}", 100.0 * mismatch), percent, "{prompt}");
        // and it is made again, by a record of before too, which has the axis as it was asked for
        let record = way.at(&format!("{out}.kinelm.json"));
        let text = fs::read_to_string(&record).unwrap();
        let up = if prompt == "z.bvh" { "\"up\": \"z\"" } else { "\"up\": \"y\"" };
        assert!(text.contains(up), "{text}");
        for text in [text.clone(), text.replace(up, "\"up\": \"auto\"")] {
            fs::write(&record, text).unwrap();
            kinelm().args(["again"]).arg(&record).assert().success();
        }
    }
}

#[test]
fn a_salsa_is_followed_where_it_stands() {
    let Some(dir) = kinelm_shared_data::set("cmu-dance", "a_salsa_is_followed_where_it_stands") else { return };
    let tmp = tempfile::tempdir().unwrap();
    fs::create_dir(tmp.path().join("data")).unwrap();
    let mut labels = "clip,split,fps,skip\n".to_string();
    for (i, split) in [("01", "train"), ("03", "train"), ("05", "valid")] {
        fs::copy(dir.join(format!("salsa/{i}.bvh")), tmp.path().join(format!("data/{i}.bvh"))).unwrap();
        labels += &format!("{i},{split},60,10\n");
    }
    fs::write(tmp.path().join("labels.csv"), labels).unwrap();
    let (data, labels) = (tmp.path().join("data"), tmp.path().join("labels.csv"));
    let options = ReadOptions { fps_source: Some(60.0), skip: 10, ..ReadOptions::default() };
    let prompt = read(&data.join("03.bvh"), &options);
    for form in ["absolute", "heading_delta"] {
        made(tmp.path(), form, &[&data], &labels, &["--root-rotation", form]);
        for (rig, i) in [("prompt", 1), ("model", 0)] {
            let out = tmp.path().join(format!("{form}-{rig}.bvh"));
            let mut c = kinelm();
            c.arg("generate").arg("--run").arg(tmp.path().join(form)).arg("--prompt").arg(data.join("03.bvh"));
            c.args([
                "--fps-source",
                "60",
                "--skip",
                "10",
                "--joints",
                "root,right_arm",
                "--frames",
                "120",
                "--fps",
                "20",
                "--rig",
                rig,
            ]);
            c.arg("--out").arg(&out).assert().success();
            let dance = read(&out, &ReadOptions::default());
            let [place, turn, whole] = pelvis_apart(&prompt[i], &dance[i]);
            assert!(place < 0.01 && whole < 1.25, "{form}, {rig}: {place} m, {turn} and {whole} degrees");
            assert!(turn < 0.55 || form == "absolute", "{form}, {rig}: {turn} degrees");
            let (joints, pelvis) =
                if i == 1 { (["rForeArm", "rHand"], "hip") } else { (["right_elbow", "right_wrist"], "pelvis") };
            let [mean, most] = apart(&prompt[i], &dance[i], &joints, pelvis, false);
            assert!(mean < 1.0 && most < 3.0, "{form}, {rig}: {mean} cm, {most} at most");
        }
    }
}

#[test]
fn a_path_needs_a_slot_for_the_turn() {
    let way = way();
    way.generate("13-heading", "data/0.bvh", Some("path"), "path.bvh").assert().success();
    let told = way.generate("13", "data/0.bvh", Some("path"), "no.bvh").assert().failure();
    told.stderr(contains("no slot for the turn").and(contains("heading_delta")));
}
