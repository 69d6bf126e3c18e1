//! What is left of a run that was killed, whose disk was full, or whose checkpoint was damaged.

use super::{Place, assert_same, kinelm, latest, metrics, place};
use kinelm_store::random;
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// All that could depend on where a run was cut: dropout, the average, sums over batches, measurements and the best of
/// them; with [`AUGMENT`], what is drawn for every window.
const KEYS: &str = "accumulate = 2\nema = 0.9\neval_every = 20\neval_windows = 4\ncheckpoint_every = 5\nkeep = 2\n";

/// Behind the steps.
const AUGMENT: &str = "[augment]\nmirror = 0.5\nspeed = 0.1\ndrop_joints = 0.3\n";

/// How often a run is killed.
const KILLS: u64 = 12;

/// The command as one that can be killed.
fn spawn(command: &assert_cmd::Command) -> std::process::Child {
    let mut plain = Command::new(command.get_program());
    plain.args(command.get_args()).env("NO_COLOR", "1").stdout(Stdio::null()).stderr(Stdio::null());
    plain.spawn().unwrap()
}

/// A run of `steps` steps without interruption.
fn straight(place: &Place, name: &str, keys: &str, steps: u64) -> (PathBuf, PathBuf, Duration) {
    let config = place.config(&format!("{name}.toml"), &format!("{keys}steps = {steps}\n{AUGMENT}"));
    let run = place.at(name);
    let begun = Instant::now();
    place.pretrain(&config, &run).assert().success();
    (config, run, begun.elapsed())
}

#[test]
fn a_run_that_is_killed_again_and_again_has_the_bytes_of_one_that_was_not() {
    let place = place();
    let (config, straight, took) = straight(place, "straight", KEYS, 300);
    let run = place.at("killed");
    let mut delays = random::stream(11, "kill", 0, 0);
    let (mut kills, mut steps) = (0, Vec::new());
    // all of them together take less than the run
    let mut most = took.div_f64(7.0);
    while kills < KILLS {
        let begun = run.join("config.toml").exists();
        let mut child = spawn(&if begun { place.resume(&run) } else { place.pretrain(&config, &run) });
        std::thread::sleep(most.mul_f64(random::unit(&mut delays)));
        if let Some(status) = child.try_wait().unwrap() {
            assert!(status.success(), "{status} after {kills} kills");
            if kills >= 6 {
                break;
            }
            // the first run was on a busier machine: once more, with shorter delays
            fs::remove_dir_all(&run).unwrap();
            (kills, steps, most) = (0, Vec::new(), most.div_f64(3.0));
            assert!(most > Duration::from_millis(1), "the run is always done after few kills; give it more steps");
            continue;
        }
        child.kill().unwrap();
        child.wait().unwrap();
        kills += 1;
        let latest = fs::read_to_string(run.join("latest")).unwrap_or_default();
        steps.push(latest.trim().to_string());
    }
    println!("{kills} kills, after the checkpoints {steps:?}");
    steps.dedup();
    assert!(steps.len() >= 3, "the kills came at other checkpoints: {steps:?}");
    place.resume(&run).assert().success();
    assert_same(&run, &straight);
    let left: Vec<PathBuf> = [run.clone(), run.join("checkpoints")]
        .iter()
        .flat_map(|dir| fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()))
        .filter(|p| {
            let name = p.file_name().unwrap().to_string_lossy().into_owned();
            name.ends_with(".part") || name.starts_with(".step-")
        })
        .collect();
    assert!(left.is_empty(), "left half written: {left:?}");
}

#[test]
fn a_run_killed_at_its_very_beginning_is_begun_again() {
    let place = place();
    let (config, straight, _) = straight(place, "short", KEYS, 10);
    let run = place.at("early");
    for delay in [1, 3, 8, 15, 25] {
        let mut child = spawn(&place.pretrain(&config, &run));
        std::thread::sleep(Duration::from_millis(delay));
        child.kill().unwrap();
        child.wait().unwrap();
        if run.join("config.toml").exists() {
            break;
        }
    }
    let last = if run.join("config.toml").exists() { place.resume(&run) } else { place.pretrain(&config, &run) };
    spawn(&last).wait().unwrap();
    assert_same(&run, &straight);
}

/// A shell with this script, whose `$0` is the program and whose further arguments are the call's.
fn shell(script: &str, call: &assert_cmd::Command) -> Command {
    let mut shell = Command::new("sh");
    shell.arg("-c").arg(script).arg(call.get_program()).args(call.get_args()).env("NO_COLOR", "1");
    shell
}

#[test]
fn a_full_disk_stops_the_run_and_leaves_what_was_written_before() {
    let place = place();
    let keys = KEYS.replace("keep = 2", "keep = 1000");
    let (config, straight, _) = straight(place, "roomy", &keys, 60);
    let size: u64 = latest(&straight).iter().map(|(_, bytes)| bytes.len() as u64).sum();
    let (mounted, saved) = (place.at("mounted"), place.at("full"));
    fs::create_dir(&mounted).unwrap();
    // room for four checkpoints of twelve; the folder is seen by this shell alone and copied before it ends
    let kb = size * 9 / 2 / 1024;
    let paths = format!("m={} s={}", mounted.display(), saved.display());
    let mount = format!("mount -t tmpfs -o size={kb}k none $m || exit 77");
    let script = format!("{paths}; {mount}; \"$0\" \"$@\"; rc=$?; cp -r $m/run $s; exit $rc");
    let call = place.pretrain(&config, &mounted.join("run"));
    let inner = shell(&script, &call);
    let mut outer = Command::new("unshare");
    outer.args(["-rm"]).arg(inner.get_program()).args(inner.get_args());
    let output = match outer.output() {
        Ok(output)
            if output.status.code() != Some(77) && !String::from_utf8_lossy(&output.stderr).contains("unshare") =>
        {
            output
        }
        other => {
            kinelm_shared_data::skipped("a full disk", &format!("this system lets no test mount a folder ({other:?})"));
            return;
        }
    };
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("mounted/run/") && said.contains("No space left on device"), "{said}");
    let steps: Vec<_> = fs::read_dir(saved.join("checkpoints")).unwrap().collect();
    assert!((2..=4).contains(&steps.len()), "{steps:?}");
    // as on a disk with room again
    kinelm()
        .args(["evaluate", "likelihood", "--corpus"])
        .arg(place.at("corpus"))
        .arg("--run")
        .arg(&saved)
        .assert()
        .success();
    // the corpus lies elsewhere, seen from where the run lies now
    let mut resumed = place.resume(&saved);
    resumed.arg("--corpus").arg(place.at("corpus")).assert().success().stderr(contains("resuming after step"));
    assert_same(&saved, &straight);
}

#[test]
fn a_file_that_may_not_grow_stops_the_run_and_leaves_what_was_written_before() {
    let place = place();
    let (_, straight, _) = straight(place, "free", KEYS, 30);
    let (_, run, _) = self::straight(place, "limited", KEYS, 20);
    // files of 2 KB at most; without the trap the signal would kill the process before it could say anything
    let script = "trap '' XFSZ; ulimit -f 4 || exit 77; exec \"$0\" \"$@\"";
    let mut call = place.resume(&run);
    call.args(["--steps", "30"]);
    let output = shell(script, &call).output().unwrap();
    if output.status.code() == Some(77) {
        kinelm_shared_data::skipped("a file that may not grow", "this shell has no limits of size");
        return;
    }
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("limited/") && said.contains("File too large"), "{said}");
    let before = latest(&run);
    assert!(before.iter().any(|(name, _)| name == "ema.safetensors"));
    let mut again = place.resume(&run);
    again.args(["--steps", "30"]).assert().success();
    // the cosine of the shorter run had another length, so that only what belongs to no rate is the same
    assert_eq!(metrics(&run).len(), metrics(&straight).len());
}

#[test]
fn a_checkpoint_cut_short_is_refused_and_the_one_before_it_taken() {
    let place = place();
    let (_, run, _) = straight(place, "cut", KEYS, 20);
    let whole = place.at("cut-whole");
    copy(&run, &whole);
    let last = run.join("checkpoints").join(fs::read_to_string(run.join("latest")).unwrap().trim());
    cut(&last.join("optimizer.safetensors"));
    let refused = contains("optimizer.safetensors: found").and(contains("going back to the checkpoint of step 15"));
    place.resume(&run).assert().success().stderr(refused);
    assert_same(&run, &whole);
    let likelihood = |run: &Path| {
        let mut c = kinelm();
        c.args(["evaluate", "likelihood", "--corpus"]).arg(place.at("corpus")).arg("--run").arg(run);
        c
    };
    cut(&last.join("ema.safetensors"));
    likelihood(&run).assert().success().stderr(contains("ema.safetensors: found").and(contains("of step 15")));
    let other = run.join("checkpoints/step-00000015/model.safetensors");
    cut(&other);
    likelihood(&run).assert().code(1).stderr(contains("model.safetensors: found"));
    place.resume(&run).assert().code(1).stderr(contains("step-00000015/model.safetensors: found"));
}

fn cut(path: &Path) {
    let bytes = fs::read(path).unwrap();
    fs::write(path, &bytes[..bytes.len() * 2 / 3]).unwrap();
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        match entry.file_type().unwrap().is_dir() {
            true => copy(&entry.path(), &to.join(entry.file_name())),
            false => drop(fs::copy(entry.path(), to.join(entry.file_name())).unwrap()),
        }
    }
}

#[test]
fn two_processes_do_not_write_one_run() {
    let place = place();
    let config = place.config("two.toml", &format!("{KEYS}steps = 100000\n"));
    let run = place.at("two");
    let mut first = spawn(&place.pretrain(&config, &run));
    let deadline = Instant::now() + Duration::from_secs(20);
    while !run.join("latest").exists() && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(20));
    }
    place.resume(&run).assert().code(1).stderr(contains("is writing it"));
    kinelm().args(["runs", "list"]).arg(&run).assert().success().stdout(contains("running"));
    first.kill().unwrap();
    first.wait().unwrap();
    kinelm().args(["runs", "list"]).arg(&run).assert().success().stdout(contains("stopped"));
    place.resume(&run).args(["--steps", "1"]).assert().code(2).stderr(contains("expected").and(contains("or more")));
}
