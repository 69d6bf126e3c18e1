//! What goes wrong at a user's: each ends with a line that helps and an exit code, never in a panic, a signal or silence.

use assert_cmd::Command;
use kinelm_motion::format::npz::{Values, Writer};
use kinelm_motion::{Motion, format, synth};
use predicates::str::contains;
use std::fs;
use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::Duration;

/// Four short dances, their tokenizers and corpus, a run of two steps.
struct Data(tempfile::TempDir);

const TRAIN: &str = "[model]\nlayers = 1\nheads = 2\nwidth = 16\ncontext = 90\n\
                     [train]\nbatch = 2\nsteps = 4\nwarmup = 1\neval_every = 2\ncheckpoint_every = 2\nkeep = 9\n";

impl Data {
    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        fs::write(self.at(name), bytes).unwrap();
    }

    /// A call in the folder, its arguments parted by spaces; one that hangs is ended.
    fn call(&self, args: &str) -> Command {
        let mut c = Command::cargo_bin("kinelm").unwrap();
        c.current_dir(self.0.path()).args(args.split(' ')).env("NO_COLOR", "1").timeout(Duration::from_secs(60));
        c
    }

    /// What a call says that exits with `code`.
    fn said(&self, args: &str, code: i32) -> String {
        let found = self.call(args).assert().code(code);
        let said = String::from_utf8_lossy(&found.get_output().stderr).into_owned();
        assert!(!said.contains("panicked"), "{said}");
        said
    }

    /// Sees a call exit with 1 and say all of these.
    fn refused(&self, args: &str, all: &[&str]) {
        let said = self.said(args, 1);
        all.iter().for_each(|what| assert!(said.contains(what), "{args}: no {what:?} in {said}"));
    }
}

fn data() -> &'static Data {
    static DATA: OnceLock<Data> = OnceLock::new();
    DATA.get_or_init(|| {
        let data = Data(tempfile::tempdir().unwrap());
        fs::create_dir(data.at("data")).unwrap();
        for (i, dance) in synth::corpus(3, 4, 3.0, 20.0).unwrap().into_iter().enumerate() {
            let path = data.at(&format!("data/d{i}.bvh"));
            let motion = Motion::new(&path, dance.clip);
            format::write(&path, &motion).unwrap();
        }
        data.write("labels.csv", "clip,split\nd0,train\nd1,train\nd2,valid\nd3,test\n");
        data.write("train.toml", TRAIN);
        let tiles = include_str!("../../configs/tokenizer/dct-pca.toml");
        data.write("tiles.toml", tiles);
        for call in [
            "tokenizer fit data --labels labels.csv --joints 13 --out t.json",
            "tokenize data --labels labels.csv --tokenizer t.json --out corpus",
            "pretrain --config train.toml --corpus corpus --run run",
        ] {
            data.call(call).assert().success();
        }
        data
    })
}

#[cfg(unix)]
#[test]
fn names_that_are_no_utf_8_are_told_before_any_work() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let data = data();
    let name = OsStr::from_bytes(b"odd\xff");
    let run = data.0.path().join(name);
    if std::os::unix::fs::symlink(data.at("run"), &run).is_err() {
        kinelm_shared_data::skipped("odd names", "this file system has UTF-8 names alone");
        return;
    }
    let mut c = data.call("generate --frames 20 --out odd.bvh --run");
    c.arg(&run).assert().code(2).stderr(contains("which is no UTF-8; expected a name that the sidecar can store"));
    assert!(!data.at("odd.bvh").exists());
    let clip = data.0.path().join(OsStr::from_bytes(b"clip\xff.bvh"));
    fs::copy(data.at("data/d0.bvh"), &clip).unwrap();
    let mut c = data.call("query build --out odd-index");
    c.arg(&clip).assert().code(1).stderr(contains("which an index can't name"));
}

#[test]
fn rates_that_no_movement_needs_are_refused() {
    let data = data();
    let rate = "the new rate is 1000000 frames per second; expected at most 10000";
    data.refused("spectrum data/d0.bvh --out s.png --fps 1000000", &[rate]);
    // of the file as of the call
    let mut npz = Writer::new();
    npz.add("poses", &[1, 156], Values::F64(&[0.0; 156])).unwrap();
    npz.add("trans", &[1, 3], Values::F64(&[0.0; 3])).unwrap();
    npz.add("mocap_framerate", &[], Values::F64(&[1e308])).unwrap();
    data.write("rate.npz", npz.finish().unwrap());
    data.refused("convert rate.npz rate.bvh", &["mocap_framerate: 1e308, expected", "at most 10000"]);
    let slow = data.said("convert data/d0.bvh slow.bvh --fps 0.0001", 1);
    assert!(slow.contains("from 20 to 0.0001 frames per second; expected") && !slow.contains("no capture"), "{slow}");
    data.write("fast.toml", "fps = 1000000.0\n");
    let fit = "tokenizer fit data --labels labels.csv --config fast.toml --out fast.json";
    data.refused(fit, &["fast.toml: found fps = 1000000", "at most 10000 frames"]);
}

/// Wrong calls, and what names the flag.
#[test]
fn numbers_outside_their_range_are_wrong_calls() {
    let data = data();
    for (call, named) in [
        ("convert data/d0.bvh fast.bvh --fps 1e308", "--fps <FPS>'"),
        ("convert data/d0.bvh fast.bvh --fps-source 1e9", "--fps-source <FPS>'"),
        ("interpolate data/d0.bvh data/d1.bvh --window 1 --out w.bvh", "--window"),
        ("filter data/d0.bvh f.bvh --butterworth 100 --cutoff 5", "--butterworth"),
        ("query build data --window 1 --out w", "--window"),
        ("generate --run run --frames 5 --fps 0.5 --out slow.bvh", "--fps 0.5 with a .bvh"),
        (
            "tokenizer fit data --config lapped --set hop=999 --out l.json",
            "--set hop=999 over lapped: `settings`: tokenizer setting hop: found 999",
        ),
    ] {
        let said = data.said(call, 2);
        assert!(said.contains(named) && said.matches("expected").count() <= 1, "{call}: {said}");
    }
    data.write("a.gltf", "{}");
    assert!(data.said("inspect a.gltf", 1).contains("export it as glTF Binary, one .glb"));
}

/// A fault of a file is failed work and a wrong option a wrong call, whatever the file is called.
#[test]
fn quotes_in_a_name_change_no_exit_code() {
    let data = data();
    for name in ["plain", "q`x`", "`no`", "a`b", "it's\"one\""] {
        let [toml, bvh] = ["toml", "bvh"].map(|extension| format!("{name}.{extension}"));
        data.write(&toml, "[train]\nbatch = 0\n");
        let said = data.said(&format!("pretrain --config {toml} --corpus corpus --run never"), 1);
        assert!(said.contains(&format!("{toml}: train.batch is 0; expected 1 to 65536")), "{said}");
        data.write(&bvh, "HIERARCHY\nROOT");
        assert!(data.said(&format!("inspect {bvh}"), 1).contains(&bvh));
        let said = data.said(&format!("generate --run run --music {bvh} --frames 5 --out m.bvh"), 2);
        assert!(said.contains(&format!("--music {bvh}: this model is not conditioned on music")), "{said}");
    }
}

#[test]
fn heights_above_the_floor_are_told_as_heights() {
    let data = data();
    let said = data.said("tokenizer text data/d0.bvh --tokenizer t.json --floor 5", 0);
    assert!(said.contains("60 heights of the root above the floor") && !said.contains("caught up"), "{said}");
    let call = "generate --run run --prompt data/d0.bvh --joints root --floor 5 --frames 5 --out high.bvh";
    let said = data.said(call, 0);
    assert!(said.contains("height_off_range") && !said.contains("is late"), "{said}");
}

#[cfg(unix)]
#[test]
fn pipes_devices_and_links_to_nowhere_are_told() {
    let data = data();
    for name in ["pipe.bvh", "pipe.json", "pipe.csv", "pipe.toml"] {
        assert!(std::process::Command::new("mkfifo").arg(data.at(name)).status().unwrap().success());
    }
    std::os::unix::fs::symlink("/dev/zero", data.at("zero.bvh")).unwrap();
    let no_file = "found a pipe or a device, expected a file";
    for call in [
        "inspect pipe.bvh",
        "inspect zero.bvh",
        "convert zero.bvh zero.npz",
        "tokenize data --tokenizer pipe.json --out pipe",
        "tokenize data --labels pipe.csv --tokenizer t.json --out pipe",
        "tokenizer fit data --config pipe.toml --out pipe.json",
        "pretrain --config pipe.toml --corpus corpus --run pipe",
    ] {
        data.refused(call, &[no_file]);
    }
    fs::create_dir(data.at("links")).unwrap();
    fs::copy(data.at("data/d0.bvh"), data.at("links/d0.bvh")).unwrap();
    std::os::unix::fs::symlink("nowhere", data.at("links/gone.bvh")).unwrap();
    let call = "tokenize links --labels labels.csv --tokenizer t.json --out links-corpus";
    data.refused(&format!("{call} --strict"), &["gone.bvh"]);
    let said = data.said(call, 1);
    assert!(said.contains("gone.bvh") && said.contains("1 file could not be taken"), "{said}");
}

#[test]
fn numbers_that_a_file_cannot_hold_are_refused() {
    let data = data();
    data.call("convert data/d0.bvh far.json").assert().success();
    let mut clip: serde_json::Value = serde_json::from_slice(&fs::read(data.at("far.json")).unwrap()).unwrap();
    for place in clip["root"].as_array_mut().unwrap() {
        place[0] = 1e307.into();
    }
    data.write("far.json", clip.to_string());
    data.refused("convert far.json far.bvh", &["a number of frame 0 is inf in the unit of the BVH"]);
    assert!(!data.at("far.bvh").exists());
}

#[test]
fn a_text_of_spaces_has_no_words() {
    let data = data();
    data.write("spaces.txt", " ".repeat(2_000));
    data.call("tokenizer fit data --labels labels.csv --config tiles.toml --out tiles.json").assert().success();
    data.refused("tokenizer decode --tokenizer tiles.json spaces.txt spaces.bvh", &["no words, nothing to decode"]);
    data.write("spaces.txt", " ".repeat(20_000));
    let most = "20000 words are 1200000 frames; expected at most 131072";
    data.refused("tokenizer decode --tokenizer tiles.json spaces.txt spaces.bvh", &[most]);
}

#[test]
fn settings_and_texts_are_told_with_their_file() {
    let data = data();
    data.write("short.toml", "[model]\ncontext = 3\n");
    data.write("mood.toml", "[train]\nconditions = [\"mood\"]\n");
    data.refused("pretrain --config short.toml --corpus corpus --run other", &["short.toml: model.context is 3"]);
    data.refused(
        "pretrain --config mood.toml --corpus corpus --run other",
        &["no training clip has the label `mood` of train.conditions"],
    );
    data.write("odd.toml", b"\xff\xfe\x00");
    data.refused("tokenizer fit data --config odd.toml --out o.json", &["odd.toml: found bytes that are no UTF-8"]);
    data.refused("tokenize data --tokenizer odd.toml --out o", &["odd.toml: bytes that are no UTF-8"]);
}

#[test]
fn orders_to_a_terminal_in_names_are_written_out() {
    let data = data();
    for call in ["inspect a\u{1b}[31mb.bvh", "tokenize data --tokenizer a\u{1b}[31m\u{7}.json --out x"] {
        let said = data.said(call, 1);
        assert!(said.contains("a\\u{1b}[31m") && !said.contains('\u{1b}') && !said.contains('\u{7}'), "{said:?}");
    }
    // in words that the parser itself refuses too
    let odd = ["inspect data/d0.bvh --a\u{1b}[31mb", "a\u{1b}[31mb", "inspect data/d0.bvh --unit a\u{1b}[31mb"];
    for call in odd {
        let said = data.said(call, 2);
        assert!(said.contains("a\\u{1b}[31mb") && !said.contains('\u{1b}'), "{said:?}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn the_memory_that_a_shell_allows_counts_before_training() {
    let data = data();
    data.write("wide.toml", TRAIN.replace("width = 16", "width = 2048"));
    let program = Command::cargo_bin("kinelm").unwrap().get_program().to_owned();
    let script = "ulimit -v 900000 || exit 77; exec \"$0\" pretrain --config wide.toml --corpus corpus --run wide";
    let mut c = std::process::Command::new("sh");
    let found = c.current_dir(data.0.path()).arg("-c").arg(script).arg(program).output().unwrap();
    let said = String::from_utf8_lossy(&found.stderr);
    if found.status.code() == Some(77) {
        kinelm_shared_data::skipped("little memory", "this shell has no limits of memory");
        return;
    }
    assert_eq!(found.status.code(), Some(1), "{said}");
    assert!(said.contains(" of memory, the limit is ") && said.contains("lower model.width"), "{said}");
    assert!(!data.at("wide").exists());
}

#[cfg(unix)]
#[test]
fn one_build_at_a_time_adds_to_an_index() {
    let data = data();
    data.call("query build data/d0.bvh --out index --window 20 --hop 10").assert().success();
    let held = fs::File::open(data.at("index")).unwrap();
    held.lock().unwrap();
    data.refused(
        "query build data/d1.bvh --out index",
        &["index: another build adds to it; build again when that is done"],
    );
    drop(held);
    data.call("query build data/d1.bvh --out index").assert().success();
}

#[test]
fn a_bad_file_among_others_is_named_the_rest_is_done_and_the_call_fails() {
    let d = data();
    fs::create_dir(d.at("some")).unwrap();
    for name in ["d0.bvh", "d1.bvh", "d2.bvh", "d3.bvh"] {
        fs::copy(d.at("data").join(name), d.at("some").join(name)).unwrap();
    }
    let text = fs::read(d.at("data/d0.bvh")).unwrap();
    d.write("some/bad.bvh", &text[..text.len() / 2]);
    d.write("some.csv", "clip,split\nd0,train\nd1,train\nd2,valid\nd3,test\nbad,train\n");
    for (call, made) in [
        ("inspect some/bad.bvh some/d0.bvh", ""),
        ("convert some some-out --format json", "some-out/d3.json"),
        ("filter some --out some-calm", "some-calm/d3.bvh"),
        ("mirror some --out some-mirror", "some-mirror/d3.bvh"),
        ("view some --out some.html", "some.html"),
        ("tokenizer fit some --labels some.csv --joints 13 --out some.json", "some.json"),
        ("tokenize some --labels some.csv --tokenizer t.json --out some-corpus", "some-corpus/corpus.json"),
        ("query build some --labels some.csv --window 32 --out some-index", "some-index/index.json"),
        ("corpus clean some --labels some.csv --out some-clean.csv", "some-clean.csv"),
        ("evaluate dance some/bad.bvh some/d0.bvh some/d1.bvh --real corpus", ""),
        ("evaluate dance some --real corpus", ""),
        ("evaluate dance --compare some some --real corpus", ""),
        ("evaluate prediction some --labels some.csv --split train --fps 20", ""),
    ] {
        let said = d.said(call, 1);
        assert!(said.contains("bad") && said.contains("could not be "), "{call}: {said}");
        assert!(made.is_empty() || d.at(made).exists(), "{call}: no {made}; {said}");
    }
    // --lenient keeps what is whole of it
    let said = d.said("tokenize some --labels some.csv --lenient --tokenizer t.json --out some-lenient", 0);
    assert!(said.contains("5 clips"), "{said}");
}

/// What waits for ever, where a file is expected: every kind of input is opened by one function.
#[cfg(unix)]
#[test]
fn no_input_of_any_kind_may_be_a_pipe() {
    let data = data();
    fs::create_dir_all(data.at("p/run")).unwrap();
    for name in ["a.wav", "a.npz", "a.json", "a.toml", "a.csv", "a.bvh", "run/metrics.jsonl"] {
        assert!(std::process::Command::new("mkfifo").arg(data.at("p").join(name)).status().unwrap().success());
    }
    for call in [
        "music inspect p/a.wav",
        "music beats p/a.wav --out o.txt",
        "view data/d0.bvh --music p/a.wav --out o.html",
        "convert data/d0.bvh o.bvh --onto p/a.bvh",
        "convert data/d0.bvh o.bvh --onto p/a.npz",
        "inspect data/d0.bvh --map p/a.toml",
        "runs plot p/run --out o.svg",
        "tokenize data --exclude p/a.csv --tokenizer t.json --out o",
        "generate timeline p/a.toml --run run --out o.bvh",
        "again p/a.json",
        "aclstm plot p/a.json --out o.svg",
    ] {
        let said = data.said(call, 1);
        assert!(said.contains("found a pipe or a device, expected a file"), "{call}: {said}");
    }
    // beside a dance, too
    fs::copy(data.at("data/d0.bvh"), data.at("p/d.bvh")).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(data.at("p/d.bvh.kinelm.json")).status().unwrap().success());
    data.said("convert data/d1.bvh p/d.bvh", 2);
}

#[test]
fn no_writer_writes_what_is_not_finite_in_its_width() {
    let data = data();
    data.call("convert data/d0.bvh wide.json").assert().success();
    let clip: serde_json::Value = serde_json::from_slice(&fs::read(data.at("wide.json")).unwrap()).unwrap();
    let write = |name: &str, change: &dyn Fn(&mut serde_json::Value)| {
        let mut clip = clip.clone();
        change(&mut clip);
        data.write(name, clip.to_string());
    };
    write("bones.json", &|clip| clip["offsets"][1] = serde_json::json!([0.0, 1e308, 0.0]));
    write("root.json", &|clip| clip["root"][3] = serde_json::json!([1e300, 0.9, 0.0]));
    data.refused("convert bones.json bones.bvh", &["OFFSET of", "inf in the unit of the BVH"]);
    data.refused("convert bones.json bones.glb", &["beyond what a GLB holds"]);
    data.refused("convert root.json root.glb", &["the root in frame 3: beyond what a GLB holds"]);
    for name in ["bones.bvh", "bones.glb", "root.glb"] {
        assert!(!data.at(name).exists(), "{name}");
    }
    // and no reader takes a rate that no writer may write
    for (name, fps) in [("fast.json", 1e9), ("slow.json", 1e-9)] {
        write(name, &|clip| clip["fps"] = fps.into());
        data.refused(&format!("convert {name} rate.bvh"), &["rate_bad", "at least 0.001, at most 10000"]);
    }
    let text = fs::read_to_string(data.at("data/d0.bvh")).unwrap();
    let at = text.find("Frame Time").unwrap();
    let rest = text[at..].split_once('\n').unwrap().1;
    data.write("fast.bvh", format!("{}Frame Time: 0.000000001\n{rest}", &text[..at]));
    data.refused("convert fast.bvh fast.json", &["frame_time_bad", "seconds from 0.0001 to 1"]);
}

/// A run, a corpus, an index or a classifier among clips is none of them.
#[test]
fn folders_of_ours_are_not_searched_for_clips() {
    let data = data();
    fs::create_dir(data.at("mixed")).unwrap();
    fs::copy(data.at("data/d0.bvh"), data.at("mixed/d0.bvh")).unwrap();
    data.call("pretrain --config train.toml --corpus corpus --run mixed/run").assert().success();
    fs::copy(data.at("data/d1.bvh"), data.at("mixed/run/samples/d1.bvh")).unwrap();
    let call = data.call("tokenize mixed --tokenizer t.json --out mixed-corpus").assert().success();
    let said = String::from_utf8_lossy(&call.get_output().stderr).into_owned();
    assert!(said.contains("mixed/run: a run, where no clip is looked for") && said.contains("1 clip,"), "{said}");
}

#[test]
fn outputs_in_the_way_are_wrong_calls() {
    let data = data();
    let run = "run exists; resume it, or give another run folder";
    for (call, what) in [
        ("pretrain --config train.toml --corpus corpus --run run", run),
        ("finetune --from run --config train.toml --corpus corpus --run run", run),
        ("query build data --out run", "run exists and is no index; give another folder"),
        ("tokenize data --tokenizer t.json --out run --force", "run exists and is a run; give another output"),
    ] {
        let said = data.said(call, 2);
        assert!(said.contains(what), "{call}: {said}");
    }
}

#[test]
fn what_is_said_is_short_and_true() {
    let data = data();
    data.write("long.csv", format!("clip,split\nd0,{}\n", "x".repeat(10_000_000)));
    let said = data.said("tokenize data --labels long.csv --tokenizer t.json --out long", 1);
    assert!(said.len() < 20_000 && said.contains(" characters) .. "), "{} bytes", said.len());
    data.write(
        "at.toml",
        "rig = \"a\"\n[clips.a]\nfile = \"data/d0.bvh\"\n[[segment]]\nclip = \"a\"\nfrom = true\nto = 1\n",
    );
    let said = data.said("generate timeline at.toml --check", 1);
    assert!(said.contains("at.toml:6:8: found a value that is no time (seconds, as 2.5"), "{said}");
    // of another kind of run
    fs::create_dir(data.at("other-run")).unwrap();
    data.write("other-run/config.toml", "kind = \"aclstm\"\nversion = 1\n");
    data.write("other-run/metrics.jsonl", "{\"kind\":\"aclstm\"}\n".repeat(20));
    data.refused("runs plot other-run --out o.svg", &["other-run: 20 lines of metrics.jsonl can't be read"]);
}

#[cfg(target_os = "linux")]
#[test]
fn limits_of_a_shell_are_told() {
    let data = data();
    let program = Command::cargo_bin("kinelm").unwrap().get_program().to_owned();
    let shell = |script: &str| {
        let mut c = std::process::Command::new("sh");
        let found = c.current_dir(data.0.path()).arg("-c").arg(script).arg(&program).output().unwrap();
        (found.status.code(), String::from_utf8_lossy(&found.stderr).into_owned())
    };
    let (code, said) = shell("ulimit -f 8 || exit 77; exec \"$0\" convert data/d0.bvh limited.json");
    assert!(code == Some(77) || (code == Some(1) && said.contains("File too large")), "{code:?} {said}");
    assert!(!data.at("limited.json").exists());
    let (code, said) = shell("exec \"$0\" --help > /dev/full");
    assert!(code == Some(1) && said.contains("help can't be written"), "{code:?} {said}");
    // none of these ends by a signal, whatever there is
    let large = TRAIN.replace("layers = 1", "layers = 4").replace("width = 16", "width = 384");
    data.write("large.toml", large.replace("steps = 4", "steps = 1").replace("every = 2", "every = 1"));
    data.call("pretrain --config large.toml --corpus corpus --run large").assert().success();
    // the program itself is 61 MB
    for megabytes in [100, 130, 160] {
        let limit = format!("ulimit -v {} || exit 77; ulimit -c 0", megabytes * 1024);
        for call in [
            "generate --run large --prompt data/d0.bvh --free left_arm@1s:2s --out tight.bvh --force",
            "export --run large --out tight",
            "corpus clean data --out tight.csv --force",
            "evaluate likelihood --run large --corpus corpus",
        ] {
            let (code, said) = shell(&format!("{limit}; exec \"$0\" --threads 2 {call}"));
            assert!(matches!(code, Some(0 | 1 | 77)), "{megabytes} MB, {call}: {code:?} {said}");
            assert!(!said.contains("panicked"), "{megabytes} MB, {call}: {said}");
        }
    }
}

/// A link of two clips whose hierarchies are one, of two systems' line ends.
#[test]
fn line_ends_are_no_rig() {
    let data = data();
    let text = fs::read_to_string(data.at("data/d1.bvh")).unwrap();
    data.write("crlf.bvh", text.replace('\n', "\r\n"));
    data.write(
        "ends.toml",
        "rig = \"a\"\n[clips.a]\nfile = \"data/d0.bvh\"\n[clips.b]\nfile = \"crlf.bvh\"\n\
         [[segment]]\nclip = \"a\"\nfrom = 0\nto = 1\n[[segment]]\nclip = \"b\"\nfrom = 1.5\nto = 2\n",
    );
    let said = data.said("generate timeline ends.toml --check", 0);
    assert!(!said.contains("another rig"), "{said}");
}
