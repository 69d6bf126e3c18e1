//! Training on synthetic dances: it learns, it resumes to the same bits, and it refuses what can't be learned from.

use super::*;
use crate::Changes;
use crate::form::Form;
use crate::train::Event;
use kinelm_model::run::{OPTIMIZER, WEIGHTS};
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::{Clip, Motion, synth};
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
        keep: 2,
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
    let resume =
        |set: &[&str], steps| Start::Resume(Changes { set: set.iter().map(|pair| pair.to_string()).collect(), steps });
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
        ("seed=2", "what may change: steps, learning_rate, checkpoint_every, keep"),
        ("learning_rate=fast", "`set` learning_rate=fast: invalid type"),
        ("learning_rate=0", "`set` learning_rate is 0; expected a number above 0"),
        ("steps=3", "step"),
    ] {
        let e = go(&runs[1], &resume(&[pair], None), 1).unwrap_err();
        assert!(e.to_string().contains(says), "{e}");
    }
    assert_eq!(RunFile::read(&runs[1]).unwrap(), file);
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
