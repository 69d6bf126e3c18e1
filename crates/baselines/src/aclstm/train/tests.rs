//! Training on synthetic dances: it learns, it resumes to the same bits, and it refuses what can't be learned from.

use super::*;
use crate::Changes;
use crate::aclstm::run::Trained;
use crate::form::Form;
use crate::train::Event;
use kinelm_model::run::{OPTIMIZER, WEIGHTS};
use kinelm_model::{CheckpointChoice, Keep};
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::{Clip, Motion, synth};
use kinelm_train::Branch;
use std::fs;
use std::sync::atomic::Ordering;

/// Some dances in a folder, and what a small run takes of them.
fn place(dir: &Path, fps: f64) -> (Config, Sources) {
    let data = dir.join("data");
    fs::create_dir(&data).unwrap();
    for (i, dance) in synth::corpus(3, 4, 2.0, fps).unwrap().into_iter().enumerate() {
        let path = data.join(format!("{i}.json"));
        let motion = Motion::new(&path, dance.clip);
        format::write(&path, &motion).unwrap();
    }
    let config = Config {
        width: 20,
        layers: 2,
        length: 12,
        batch: 3,
        condition: 3,
        groundtruth: 2,
        margin: 2,
        steps: 7,
        learning_rate: 3e-3,
        checkpoint_every: 3,
        keep: Keep::Last(2),
        ..Config::default()
    };
    let sources = Sources { data: vec![data], labels: vec![], only: vec![], read: ReadOptions::default() };
    (config, sources)
}

fn go(run: &Path, start: &Start, stop_after: u64) -> Result<(Summary, Vec<f64>)> {
    let stop = AtomicBool::new(stop_after == 0);
    let mut losses = Vec::new();
    let summary = train(run, start, &stop, &mut |event| {
        if let Event::Step(metrics, _) = event {
            losses.push(metrics.loss);
            stop.store(losses.len() as u64 >= stop_after, Ordering::Relaxed);
        }
    })?;
    Ok((summary, losses))
}

#[test]
fn a_stopped_run_resumes_to_the_same_bits() {
    for form in [Form::Positional, Form::Euler, Form::Quaternion] {
        let dir = tempfile::tempdir().unwrap();
        let (config, sources) = place(dir.path(), 60.0);
        let new = Start::New(Config { form, ..config }, sources);
        let (whole, parts) = (dir.path().join("whole"), dir.path().join("parts"));
        let (done, losses) = go(&whole, &new, 99).unwrap();
        assert_eq!((done.step, done.stopped, losses.len()), (7, false, 7));
        let (first, found) = go(&parts, &new, 4).unwrap();
        assert_eq!((first.step, first.stopped), (4, true));
        assert!(go(&parts, &new, 1).unwrap_err().to_string().contains("exists; resume it"));
        // another number of threads, and updates after the last checkpoint are repeated
        fs::remove_dir_all(parts.join("checkpoints/step-00000004")).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        let (second, more) = pool.install(|| go(&parts, &Start::Resume(Changes::default()), 99)).unwrap();
        assert_eq!((found, second.step, &more[..]), (losses[..4].to_vec(), 7, &losses[3..]), "{form:?}");
        for name in [WEIGHTS, OPTIMIZER] {
            let read = |run: &Path| fs::read(run.join("checkpoints/step-00000007").join(name)).unwrap();
            assert!(read(&whole) == read(&parts), "{form:?}: {name}");
        }
        let lines = fs::read_to_string(parts.join("metrics.jsonl")).unwrap();
        assert_eq!(lines.lines().count(), 7);
        let runs = kinelm_train::runs::list(&[dir.path().into()], &mut |note| panic!("{note}")).unwrap();
        let found: Vec<_> = runs.iter().map(|run| (&*run.model, run.status.name(), run.step, run.loss)).collect();
        assert_eq!(found, [("aclstm 2x20", "done", 7, losses.last().copied()); 2]);
    }
}

#[test]
fn a_resumed_run_changes_what_it_may_and_keeps_it() {
    let dir = tempfile::tempdir().unwrap();
    let (config, sources) = place(dir.path(), 60.0);
    let new = Start::New(config, sources);
    let resume = |set: &[&str], steps| {
        Start::Resume(Changes { set: set.iter().map(|pair| pair.to_string()).collect(), steps, branch: None })
    };
    let slower = resume(&["learning_rate=1e-4", "checkpoint_every=2"], Some(8));
    let weights = |run: &Path| fs::read(run.join("checkpoints/step-00000008").join(WEIGHTS)).unwrap();
    let runs = ["whole", "parts"].map(|name| dir.path().join(name));
    runs.iter().for_each(|run| assert_eq!(go(run, &new, 4).unwrap().0.step, 4));
    go(&runs[0], &slower, 99).unwrap();
    // what changed is stored in the run, and applies when it is resumed again
    assert_eq!(go(&runs[1], &slower, 1).unwrap().0.step, 5);
    let file = RunFile::read(&runs[1]).unwrap();
    assert_eq!((file.config.learning_rate, file.config.checkpoint_every, file.config.steps), (1e-4, 2, 8));
    go(&runs[1], &resume(&[], None), 99).unwrap();
    assert!(weights(&runs[0]) == weights(&runs[1]));
    for (pair, says) in [
        ("width=8", "`set` width: weights, optimizer and sequences depend on it, so a resumed run keeps it"),
        ("seed=2", "what may change: steps, learning_rate, eval_every, sample_every, checkpoint_every, keep"),
        ("learning_rate=fast", "`set` learning_rate=fast: invalid type"),
        ("learning_rate=0", "`set` learning_rate is 0; expected a number above 0"),
        ("steps=3", "step"),
    ] {
        let e = go(&runs[1], &resume(&[pair], None), 1).unwrap_err();
        assert!(e.to_string().contains(says), "{e}");
    }
    assert_eq!(RunFile::read(&runs[1]).unwrap(), file);
}

/// The run that continues from an earlier checkpoint is the one that was never anything else.
#[test]
fn a_run_goes_on_from_an_earlier_checkpoint() {
    let dir = tempfile::tempdir().unwrap();
    let (config, sources) = place(dir.path(), 60.0);
    let new = Start::New(Config { keep: Keep::All, checkpoint_every: 2, ..config }, sources);
    let [whole, slower, branch] = ["whole", "slower", "branch"].map(|name| dir.path().join(name));
    go(&whole, &new, 99).unwrap();
    let set = vec!["learning_rate=1e-4".to_string()];
    let changes = |set: &[String], step| Changes {
        set: set.to_vec(),
        steps: None,
        branch: Some(Branch { step, run: branch.clone() }),
    };
    let from = |set: &[String], step| go(&whole, &Start::Resume(changes(set, step)), 99);
    // nothing is left of what is refused
    for (set, step, says) in [
        (vec!["width=8".to_string()], 4, "`set` width:"),
        (vec!["steps=3".to_string()], 4, "`steps` is 3; expected 4 or more"),
        (vec![], 3, "no checkpoint of step 3, expected one of step 3; there are 2, 4, 6, 7"),
    ] {
        let message = from(&set, step).unwrap_err().to_string();
        assert!(message.contains(says), "{message}");
        assert!(!branch.exists());
    }
    let before = fs::read(whole.join("config.toml")).unwrap();
    assert_eq!(from(&set, 4).unwrap().0.step, 7);
    assert_eq!(before, fs::read(whole.join("config.toml")).unwrap(), "the parent stays as it is");
    assert!(from(&set, 4).unwrap_err().to_string().contains("branch exists; resume it"));
    // the same by stopping and resuming
    go(&slower, &new, 4).unwrap();
    go(&slower, &Start::Resume(Changes { set, ..Changes::default() }), 99).unwrap();
    let weights =
        |run: &Path, step: u64| fs::read(run.join(format!("checkpoints/step-{step:08}")).join(WEIGHTS)).unwrap();
    assert!(weights(&branch, 7) == weights(&slower, 7) && weights(&branch, 7) != weights(&whole, 7));
    let lines = |run: &Path| fs::read_to_string(run.join("metrics.jsonl")).unwrap().lines().count();
    assert_eq!((lines(&branch), lines(&whole)), (7, 7));
    let file = RunFile::read(&branch).unwrap();
    let origin = file.from.unwrap();
    assert_eq!((origin.path, origin.step, file.config.learning_rate), (whole.clone(), 4, 1e-4));
    assert_eq!(origin.sha256, kinelm_store::FileRecord::of(&weights(&whole, 4)).sha256);
}

#[test]
fn a_run_is_measured_on_valid_clips_and_writes_dances() {
    let dir = tempfile::tempdir().unwrap();
    let (config, mut sources) = place(dir.path(), 60.0);
    let csv = dir.path().join("labels.csv");
    fs::write(&csv, "clip,split\n0,train\n1,train\n2,train\n3,valid\n").unwrap();
    sources.labels = vec![csv.to_string_lossy().into_owned()];
    let [plain, watched, parts] = ["plain", "watched", "parts"].map(|name| dir.path().join(name));
    go(&plain, &Start::New(config.clone(), sources.clone()), 99).unwrap();
    let config = Config { eval_every: 3, sample_every: 4, keep: Keep::All, ..config };
    let new = Start::New(config.clone(), sources.clone());
    let (mut valid, mut samples) = (Vec::new(), 0);
    let done = train(&watched, &new, &AtomicBool::new(false), &mut |event| match event {
        Event::Valid(step, found, is_best) => valid.push((step, found, is_best)),
        Event::Note(note) => samples += usize::from(note.contains("samples/step-00000004.html: a dance")),
        Event::Step(..) => {}
    });
    done.unwrap();
    assert_eq!(samples, 1);
    let weights = |run: &Path| fs::read(run.join("checkpoints/step-00000007").join(WEIGHTS)).unwrap();
    assert!(weights(&plain) == weights(&watched), "watching changes nothing");
    assert_eq!(valid.iter().map(|(step, ..)| *step).collect::<Vec<_>>(), [3, 6, 7]);
    let best = valid.iter().min_by(|a, b| a.1.loss.total_cmp(&b.1.loss)).unwrap().0;
    let trained = Trained::load(&watched, CheckpointChoice::Best).unwrap();
    assert_eq!((trained.step, Trained::load(&watched, CheckpointChoice::Latest).unwrap().step), (best, 7));
    let lines = fs::read_to_string(watched.join("metrics.jsonl")).unwrap();
    let lines: Vec<serde_json::Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 10);
    for line in &lines {
        let of = |line: &serde_json::Value| ["loss", "root", "rotations"].map(|key| line[key].as_f64().unwrap());
        let [loss, root, rotations] = of(if line["kind"] == "valid" { &line["valid"] } else { line });
        assert!((loss - root - rotations).abs() < 1e-9 && root > 0.0 && rotations > 0.0, "{line}");
    }
    // the validation loss is that of the last network on the valid clip alone
    let recordings = trained.file.recordings(&watched).unwrap();
    let of_valid = Sequences::of_split(&recordings, Split::Valid, &trained.coder, &config);
    let last = Trained::load(&watched, CheckpointChoice::Latest).unwrap();
    let mut learner =
        network::Learner::new(config.form, config.parts(), last.shape, config.batch, config.length, last.weights);
    let batch = held_out(&of_valid, &trained.coder, &config);
    assert_eq!(learner.loss(&batch.inputs, &batch.targets, &config.given()), valid[2].1);
    // a dance continues the valid clip, and a resumed run writes the same
    let sample = |run: &Path| fs::read(run.join("samples/step-00000004.bvh")).unwrap();
    assert!(
        watched.join("samples/step-00000004.html").is_file()
            && fs::read_dir(watched.join("samples")).unwrap().count() == 2
    );
    go(&parts, &new, 3).unwrap();
    go(&parts, &Start::Resume(Changes::default()), 99).unwrap();
    assert!(sample(&watched) == sample(&parts) && weights(&parts) == weights(&plain));
    let text = String::from_utf8(sample(&watched)).unwrap();
    assert!(text.contains("Frames: 150"), "5 s at 30 a second");
    // without a valid clip it is said, and the run trains
    let mut notes = Vec::new();
    fs::write(&csv, "clip,split\n0,train\n1,train\n2,train\n3,test\n").unwrap();
    let none = Start::New(config, sources);
    train(&dir.path().join("none"), &none, &AtomicBool::new(true), &mut |event| {
        if let Event::Note(note) = event {
            notes.push(note.to_string());
        }
    })
    .unwrap();
    assert!(notes.iter().any(|note| note.contains("no validation clip is long enough")), "{notes:?}");
    let message = Trained::load(&dir.path().join("none"), CheckpointChoice::Best).err().unwrap().to_string();
    assert!(message.contains("no best checkpoint, expected latest, or one of 0"), "{message}");
}

#[test]
fn losses_fall() {
    for form in [Form::Positional, Form::Euler, Form::Quaternion] {
        let dir = tempfile::tempdir().unwrap();
        let (config, sources) = place(dir.path(), 30.0);
        let config = Config { form, steps: 60, learning_rate: 1e-2, turn: false, ..config };
        let (_, losses) = go(&dir.path().join("run"), &Start::New(config, sources), 99).unwrap();
        let mean = |some: &[f64]| some.iter().sum::<f64>() / some.len() as f64;
        assert!(mean(&losses[50..]) < 0.5 * mean(&losses[..5]), "{form:?}: {losses:?}");
    }
}

#[test]
fn batches_are_true_steps_turned_as_a_whole() {
    let dir = tempfile::tempdir().unwrap();
    let (config, sources) = place(dir.path(), 60.0);
    let recordings = Recordings::load(&sources, config.margin, None).unwrap();
    let coder = Coder::new(config.form, &recordings.rig).unwrap();
    let sequences = Sequences::of(&recordings, &coder, &config).unwrap();
    let (c, row) = (coder.channels(), config.batch * coder.channels());
    let a = batch(&sequences, &coder, &config, 5);
    // the target of a step is the input of the next
    assert_eq!(a.inputs[row..], a.targets[..a.targets.len() - row]);
    assert!(
        a.inputs == batch(&sequences, &coder, &config, 5).inputs
            && a.inputs != batch(&sequences, &coder, &config, 6).inputs
    );
    // heights and angles but the root's are those of frames of the clip, a stride apart
    let (frames, stride, _) = &sequences.clips[a.clips[1]];
    let kept = |row: &[f32]| [vec![row[1]], row[7..].to_vec()].concat();
    let first = frames.chunks_exact(c).position(|frame| kept(frame) == kept(&a.inputs[c..2 * c])).unwrap();
    for t in 0..config.length {
        let frame = &frames[(first + t * stride) * c..][..c];
        assert_eq!(kept(frame), kept(&a.inputs[t * row + c..][..c]));
        let next = &frames[(first + (t + 1) * stride) * c..][..c];
        let moved = |x: f32, z: f32| (x as f64).hypot(z as f64);
        let (true_move, seen) = (moved(next[0] - frame[0], next[2] - frame[2]), &a.inputs[t * row + c..]);
        assert!((moved(seen[0], seen[2]) - true_move).abs() < 1e-6);
    }
}

#[test]
fn what_can_not_be_learned_from_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let (config, sources) = place(dir.path(), 50.0);
    let run = dir.path().join("run");
    let said = |config: &Config, sources: &Sources| {
        go(&run, &Start::New(config.clone(), sources.clone()), 1).unwrap_err().to_string()
    };
    let message = said(&config, &sources);
    assert!(message.contains("0.json: found 50 frames a second, expected a multiple of 30"), "{message}");
    let read = ReadOptions { fps_source: Some(60.0), ..Default::default() };
    let sources = Sources { read, ..sources };
    let message = said(&Config { length: 400, ..config.clone() }, &sources);
    assert!(message.contains("no training clip of 402 frames at 30 a second;"), "{message}");
    let message = said(&config, &Sources { only: vec!["genre=tango".parse().unwrap()], ..sources.clone() });
    assert_eq!(message, "no clip with genre=tango; see the labels' columns");
    assert!(!run.exists(), "nothing is left of a run that was refused");
    // a clip on another body
    let path = sources.data[0].join("9.json");
    let clip = synth::corpus(3, 1, 2.0, 50.0).unwrap().remove(0).clip;
    let s = clip.skeleton();
    let names = s.names().iter().map(|n| format!("my_{n}")).collect();
    let other = kinelm_motion::Skeleton::new(names, s.parents().to_vec(), s.offsets().to_vec(), vec![]).unwrap();
    let clip: Clip = clip.with_skeleton(other.into()).unwrap();
    format::write(&path, &Motion::new(&path, clip)).unwrap();
    let message = said(&config, &sources);
    assert!(message.contains("9.json: found joints my_pelvis, my_left_hip"), "{message}");
    fs::remove_file(path).unwrap();
    go(&run, &Start::New(config, sources.clone()), 1).unwrap();
    fs::remove_file(sources.data[0].join("2.json")).unwrap();
    let message = go(&run, &Start::Resume(Changes::default()), 1).unwrap_err().to_string();
    assert!(message.contains("2.json: found no such file among those of the run"), "{message}");
}
