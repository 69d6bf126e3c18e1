//! The training loop.

use super::batches::Batches;
use super::config::TrainFile;
use super::learner::{Learner, clip_share, learner};
use super::metrics::{Metrics, StepFigures};
use super::progress::Progress;
use super::room;
use super::run::RunFile;
use super::schedule;
use crate::corpus::{ClipRecord, Corpus, Split};
use crate::evaluate::likelihood::{Likelihood, likelihood};
use crate::model::checkpoint::{Best, Checkpoints, State, Which};
use crate::model::run::WEIGHTS;
use crate::model::{Compute, layout, weights};
use crate::{Error, Result};
use candle_core::Tensor;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The optimizer's file in a checkpoint.
const OPTIMIZER: &str = "optimizer.safetensors";

/// What to train, on what, and where to.
#[derive(Debug, Clone, Default)]
pub struct PretrainOptions {
    /// The training file. A run that is resumed has its own; one given then must say the same.
    pub file: Option<TrainFile>,
    /// The corpus folder, over the one in the file (or the run's).
    pub corpus: Option<PathBuf>,
    /// The run folder, over the one in the file.
    pub run: Option<PathBuf>,
    /// Steps in all, over the file's (or the run's).
    pub steps: Option<u64>,
    /// The seed, over the file's.
    pub seed: Option<u64>,
    /// Go on with the run where its last whole checkpoint stands.
    pub resume: bool,
    /// Where and how to compute. A run can go on elsewhere than where it was begun.
    pub compute: Compute,
}

/// How a run ended.
#[derive(Debug, Clone)]
pub struct Summary {
    /// The run folder.
    pub run: PathBuf,
    /// The last checkpoint's folder.
    pub checkpoint: PathBuf,
    /// Updates done in all.
    pub step: u64,
    /// Whether it was stopped before its last step.
    pub stopped: bool,
    /// The last step's loss, nats a token; `None` if no step was left to do.
    pub loss: Option<f64>,
    /// The measurement at the end, if there are validation clips and it wasn't stopped.
    pub valid: Option<Likelihood>,
    /// The best measurement of the run.
    pub best: Option<Best>,
    /// Tokens trained on in all, padding left out.
    pub tokens: u64,
    /// Seconds of this call.
    pub seconds: f64,
}

/// Trains a model from scratch, or goes on with a run.
///
/// A checkpoint is written as often as the file says, where validation is best, at the last step, and when `stop`
/// becomes true. A resumed run has the same bits as one that was never stopped, on the same kind of CPU and in the same
/// form. It works on the rayon pool that it is called in; the number of threads changes nothing.
///
/// # Errors
/// Options that don't hold together; a run folder that exists (without `resume`); a corpus without training clips or
/// another than the run's; a loss or gradient that is not finite (step and clips are named); what the system refuses.
pub fn pretrain(options: &PretrainOptions, stop: &AtomicBool, progress: &mut dyn Progress) -> Result<Summary> {
    let started = Instant::now();
    let of_file = |pick: fn(&TrainFile) -> &Option<PathBuf>| options.file.as_ref().and_then(|f| pick(f).clone());
    let run = options.run.clone().or_else(|| of_file(|f| &f.run));
    let run = run.ok_or_else(|| Error::Call("no run folder; give one by --run or in the training file".into()))?;
    let corpus = options.corpus.clone().or_else(|| of_file(|f| &f.corpus));
    // a device that isn't there must not leave an empty run behind
    options.compute.device.open()?;
    let (file, corpus) = if options.resume { resume(options, &run, corpus)? } else { begin(options, &run, corpus)? };
    Trainer::new(&run, file, &corpus, options, progress)?.train(stop, started)
}

/// A new run folder.
fn begin(options: &PretrainOptions, run: &Path, corpus: Option<PathBuf>) -> Result<(RunFile, Corpus)> {
    let file = options.file.as_ref();
    let file = file.ok_or_else(|| Error::Call("no training file; give one by --config".into()))?;
    let corpus = corpus.ok_or_else(|| Error::Call("no corpus; give one by --corpus or in the training file".into()))?;
    let corpus = Corpus::open(corpus)?;
    let mut train = file.train.clone();
    train.steps = options.steps.unwrap_or(train.steps);
    train.seed = options.seed.unwrap_or(train.seed);
    let run_file = RunFile::new(&file.model, &train, &corpus)?;
    // nor must a corpus without training clips, or a model that this machine can't hold
    Batches::new(&corpus, file.model.context, train.batch, train.seed)?;
    room::check(&file.model, &run_file.tokens, train.batch)?;
    run_file.create(run, &corpus)?;
    Ok((run_file, corpus))
}

/// A run folder that is there.
fn resume(options: &PretrainOptions, run: &Path, corpus: Option<PathBuf>) -> Result<(RunFile, Corpus)> {
    let mut file = RunFile::read(run)?;
    let corpus = Corpus::open(corpus.unwrap_or_else(|| file.corpus.clone()))?;
    file.check_corpus(&corpus)?;
    if let Some(given) = &options.file {
        let mut train = given.train.clone();
        (train.steps, train.seed) = (file.train.steps, options.seed.unwrap_or(train.seed));
        if given.model != file.model || train != file.train {
            let what = "was begun with another configuration; leave --config out to go on with the run's own";
            return Err(Error::Call(format!("{} {what}", run.display())));
        }
    }
    if let Some(seed) = options.seed.filter(|s| *s != file.train.seed) {
        return Err(Error::Call(format!("seed {seed}; the run was begun with {}", file.train.seed)));
    }
    if let Some(steps) = options.steps.filter(|s| *s != file.train.steps) {
        file.train.steps = steps;
        file.write(run)?;
    }
    Ok((file, corpus))
}

/// A run in memory.
struct Trainer<'a> {
    file: RunFile,
    corpus: &'a Corpus,
    valid: Vec<&'a ClipRecord>,
    batches: Batches<'a>,
    learner: Box<dyn Learner>,
    checkpoints: Checkpoints,
    run: PathBuf,
    metrics: Metrics,
    state: State,
    progress: &'a mut dyn Progress,
    /// Seconds of a step, smoothed.
    pace: Option<f64>,
    /// Of the training clips.
    tokens_per_frame: f64,
}

impl<'a> Trainer<'a> {
    fn new(
        run: &Path,
        file: RunFile,
        corpus: &'a Corpus,
        options: &PretrainOptions,
        progress: &'a mut dyn Progress,
    ) -> Result<Trainer<'a>> {
        let (c, t) = (&file.model, &file.train);
        let batches = Batches::new(corpus, c.context, t.batch, t.seed)?;
        let valid: Vec<_> = corpus.split(Split::Valid).filter(|c| c.frames > 0).collect();
        if valid.is_empty() {
            progress.note("the corpus has no validation clip: the run is not measured, its latest checkpoint counts");
        }
        if file.tokens.varying && file.tokens.word > c.context {
            let (word, context) = (file.tokens.word, c.context);
            progress.note(&format!("words have up to {word} tokens, a window {context}: longer words are cut"));
        }
        let checkpoints = Checkpoints::of(run);
        let (learner, state) = start(&file, options.compute, &checkpoints, progress)?;
        checkpoints.sweep()?;
        let metrics = Metrics::open(run, state.step)?;
        Ok(Trainer {
            corpus,
            valid,
            batches,
            learner,
            checkpoints,
            run: run.to_owned(),
            metrics,
            state,
            progress,
            pace: None,
            tokens_per_frame: corpus.tokens_per_frame(Split::Train),
            file,
        })
    }

    fn train(mut self, stop: &AtomicBool, started: Instant) -> Result<Summary> {
        let steps = self.file.train.steps;
        let every = |n: u64, step: u64| n > 0 && step.is_multiple_of(n);
        let (mut loss, mut valid, mut saved) = (None, None, None);
        while self.state.step < steps && !stop.load(Ordering::Relaxed) {
            loss = Some(self.step()?);
            let (step, last) = (self.state.step, self.state.step == steps);
            let mut best = false;
            if last || every(self.file.train.eval_every, step) {
                (valid, best) = self.measure()?;
            }
            if best || last || every(self.file.train.checkpoint_every, step) {
                saved = Some((step, self.save()?));
            }
        }
        let step = self.state.step;
        let checkpoint = match saved {
            Some((at, path)) if at == step => path,
            _ => self.save()?,
        };
        Ok(Summary {
            run: self.run,
            checkpoint,
            step,
            stopped: step < steps,
            loss,
            valid: valid.filter(|_| step >= steps),
            best: self.state.best,
            tokens: self.state.tokens,
            seconds: started.elapsed().as_secs_f64(),
        })
    }

    /// One update; its loss.
    fn step(&mut self) -> Result<f64> {
        let begun = Instant::now();
        let (step, train) = (self.state.step, &self.file.train);
        let batch = self.batches.batch(step);
        let here = |e| Error::Call(format!("step {}: {e}; {}", step + 1, way_on(&self.checkpoints)));
        let found = self.learner.gradients(&batch, step).map_err(here)?;
        if !found.norm.is_finite() {
            let clips = batch.clips.join(", ");
            return Err(here(Error::Call(format!("the gradient's norm is {} on {clips}", found.norm))));
        }
        let rate = schedule::rate(train, step);
        self.learner.update(clip_share(found.norm, train.clip_norm), rate)?;
        self.state.step += 1;
        self.state.windows += train.batch as u64;
        self.state.tokens += found.counted as u64;
        let seconds = begun.elapsed().as_secs_f64();
        let pace = self.pace.map_or(seconds, |p| 0.95 * p + 0.05 * seconds);
        self.pace = Some(pace);
        let figures = StepFigures {
            step: self.state.step,
            loss: found.loss,
            bits_per_frame: found.loss / std::f64::consts::LN_2 * self.tokens_per_frame,
            rate,
            gradient_norm: found.norm,
            tokens: self.state.tokens,
            tokens_per_second: found.counted as f64 / seconds,
        };
        self.metrics.step(&figures)?;
        let left = Duration::from_secs_f64(pace * (train.steps - self.state.step) as f64);
        self.progress.step(&figures, train.steps, left);
        Ok(found.loss)
    }

    /// Measures the validation clips, and whether it was never better.
    fn measure(&mut self) -> Result<(Option<Likelihood>, bool)> {
        let most = self.file.train.eval_windows;
        let Some(found) = likelihood(&mut *self.learner, self.corpus, &self.valid, most)? else {
            return Ok((None, false));
        };
        let (step, bits_per_frame) = (self.state.step, found.bits_per_frame);
        let best = self.state.best.is_none_or(|b| bits_per_frame < b.bits_per_frame);
        if best {
            self.state.best = Some(Best { step, bits_per_frame });
        }
        self.metrics.valid(step, &found)?;
        self.progress.valid(step, &found, best);
        Ok((Some(found), best))
    }

    fn save(&mut self) -> Result<PathBuf> {
        let bytes = |tensors: BTreeMap<String, Tensor>| weights::to_bytes(tensors.iter().map(|(n, t)| (n.as_str(), t)));
        let contents = [(WEIGHTS, bytes(self.learner.weights()?)?), (OPTIMIZER, bytes(self.learner.moments()?)?)];
        let path = self.checkpoints.write(self.state.clone(), &contents)?;
        self.checkpoints.prune(self.file.train.keep)?;
        Ok(path)
    }
}

/// What to do where the loss ran away.
fn way_on(checkpoints: &Checkpoints) -> String {
    match checkpoints.named("latest") {
        Some(step) => format!("the checkpoint of step {step} is whole; try a lower learning rate"),
        None => "try a lower learning rate".into(),
    }
}

/// Where the run stands: at its last whole checkpoint, or before its first step.
fn start(
    file: &RunFile,
    compute: Compute,
    checkpoints: &Checkpoints,
    progress: &mut dyn Progress,
) -> Result<(Box<dyn Learner>, State)> {
    let learner = |weights| learner(&file.model, &file.tokens, &file.train, weights, compute);
    if checkpoints.steps()?.is_empty() {
        let weights = layout::initial(&file.model, &file.tokens, file.train.seed)?;
        return Ok((learner(weights)?, State::new(0, 0, 0, file.train.seed, None)));
    }
    let found = checkpoints.find(Which::Latest, &[WEIGHTS, OPTIMIZER], &mut |n| progress.note(&n))?;
    let tensors = |name: &str| weights::from_bytes(&found.dir.join(name), &found.files[name]);
    let mut learner = learner(tensors(WEIGHTS)?)?;
    learner.restore(tensors(OPTIMIZER)?, found.state.step)?;
    let mut state = found.state;
    state.files.clear();
    progress.note(&format!("going on after step {}", state.step));
    Ok((learner, state))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::run::load_run;
    use crate::model::{Form, ModelConfig};
    use crate::train::{Schedule, Silent, TrainConfig, fixture};
    use std::fs;

    /// Sets a flag after some step.
    struct StopAt<'a>(u64, &'a AtomicBool, Vec<String>);

    impl Progress for StopAt<'_> {
        fn step(&mut self, f: &StepFigures, _: u64, _: Duration) {
            self.1.store(f.step == self.0, Ordering::Relaxed);
        }
        fn valid(&mut self, _: u64, _: &Likelihood, _: bool) {}
        fn note(&mut self, text: &str) {
            self.2.push(text.into());
        }
    }

    fn file() -> TrainFile {
        let model = ModelConfig { layers: 2, heads: 2, width: 16, context: 24, dropout: 0.1, ..Default::default() };
        let train = TrainConfig {
            batch: 3,
            steps: 10,
            warmup: 3,
            learning_rate: 1e-2,
            eval_every: 4,
            checkpoint_every: 0,
            keep: 5,
            ..Default::default()
        };
        TrainFile { model, train, ..Default::default() }
    }

    const CLIPS: [(usize, Split); 3] = [(40, Split::Train), (7, Split::Train), (12, Split::Valid)];

    fn options(dir: &Path, run: &str, file: Option<TrainFile>) -> PretrainOptions {
        let (corpus, run) = (Some(dir.join("corpus")), Some(dir.join(run)));
        PretrainOptions { file, corpus, run, ..Default::default() }
    }

    fn go(options: &PretrainOptions) -> Result<Summary> {
        pretrain(options, &AtomicBool::new(false), &mut Silent)
    }

    #[test]
    fn five_steps_and_five_more_are_ten() {
        let dir = tempfile::tempdir().unwrap();
        fixture::corpus(dir.path(), &CLIPS);
        let straight = go(&options(dir.path(), "straight", Some(file()))).unwrap();
        let stop = AtomicBool::new(false);
        let mut halves = options(dir.path(), "halves", Some(file()));
        let first = pretrain(&halves, &stop, &mut StopAt(5, &stop, Vec::new())).unwrap();
        assert_eq!((first.step, first.stopped, straight.stopped), (5, true, false));
        let message = go(&halves).unwrap_err().to_string();
        assert!(message.contains("halves exists; go on with it by --resume"), "{message}");
        halves.resume = true;
        let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let second = one_thread.install(|| go(&halves)).unwrap();
        assert_eq!((second.step, second.tokens, second.best), (10, straight.tokens, straight.best));
        for name in [WEIGHTS, OPTIMIZER, "state.json"] {
            let bytes = |s: &Summary| fs::read(s.checkpoint.join(name)).unwrap();
            assert!(bytes(&straight) == bytes(&second), "{name} differs");
        }
        let losses = |run: &str| {
            let text = fs::read_to_string(dir.path().join(run).join("metrics.jsonl")).unwrap();
            let loss = |l: &str| serde_json::from_str::<serde_json::Value>(l).unwrap()["loss"].as_f64();
            text.lines().map(loss).collect::<Vec<_>>()
        };
        assert_eq!(losses("straight"), losses("halves"));
    }

    #[test]
    fn a_run_goes_on_in_another_form() {
        let dir = tempfile::tempdir().unwrap();
        fixture::corpus(dir.path(), &CLIPS);
        let loss = |run: &str, first: Form, second: Form| {
            let mut options = options(dir.path(), run, Some(file()));
            options.compute.form = first;
            let stop = AtomicBool::new(false);
            pretrain(&options, &stop, &mut StopAt(5, &stop, Vec::new())).unwrap();
            (options.resume, options.compute.form) = (true, second);
            let summary = go(&options).unwrap();
            (summary.loss.unwrap(), summary.valid.unwrap().bits_per_frame)
        };
        // with dropout: both forms drop the same numbers
        let (plain, bits) = loss("plain", Form::Plain, Form::Plain);
        for (run, first, second) in [("there", Form::Plain, Form::Auto), ("back", Form::Auto, Form::Plain)] {
            let (found, found_bits) = loss(run, first, second);
            assert!((found - plain).abs() < 1e-4, "{run}: {found}, in one form {plain}");
            assert!((found_bits - bits).abs() < 1e-2, "{run}: {found_bits} bits a frame, in one form {bits}");
        }
    }

    #[test]
    fn a_damaged_checkpoint_is_passed_over_and_loading_takes_the_best() {
        let dir = tempfile::tempdir().unwrap();
        fixture::corpus(dir.path(), &CLIPS);
        let mut options = options(dir.path(), "run", Some(file()));
        let straight = go(&options).unwrap();
        let run = dir.path().join("run");
        let whole = fs::read(straight.checkpoint.join(WEIGHTS)).unwrap();
        fs::write(straight.checkpoint.join(WEIGHTS), &whole[..whole.len() / 2]).unwrap();
        options.resume = true;
        let stop = AtomicBool::new(false);
        let mut progress = StopAt(99, &stop, Vec::new());
        let again = pretrain(&options, &stop, &mut progress).unwrap();
        assert!(
            progress.2.iter().any(|n| n.contains("model.safetensors: found") && n.contains("step 8")),
            "{:?}",
            progress.2
        );
        assert!(fs::read(again.checkpoint.join(WEIGHTS)).unwrap() == whole);
        let best = load_run(&run, Which::Auto).unwrap();
        assert_eq!(best.state.step, again.best.unwrap().step);
        assert_eq!(load_run(&run, Which::Latest).unwrap().state.step, 10);
        assert!(load_run(&run, Which::Step(3)).is_err());
        assert!(load_run(dir.path(), Which::Auto).err().unwrap().to_string().contains("no config.toml"));
        for name in ["tokenizer.json", "corpus.json", "config.toml", "samples", "latest", "best"] {
            assert!(run.join(name).exists(), "{name}");
        }
    }

    #[test]
    fn a_corpus_without_validation_clips_trains_and_says_so() {
        let dir = tempfile::tempdir().unwrap();
        fixture::corpus(dir.path(), &CLIPS[..2]);
        let stop = AtomicBool::new(false);
        let mut progress = StopAt(99, &stop, Vec::new());
        let mut file = file();
        file.train.checkpoint_every = 3;
        file.train.keep = 1;
        let summary = pretrain(&options(dir.path(), "run", Some(file)), &stop, &mut progress).unwrap();
        assert!(progress.2[0].contains("no validation clip"));
        assert_eq!((summary.step, summary.valid, summary.best), (10, None, None));
        assert_eq!(load_run(&dir.path().join("run"), Which::Auto).unwrap().state.step, 10);
        assert_eq!(Checkpoints::of(&dir.path().join("run")).steps().unwrap(), [10]);
    }

    #[test]
    fn another_corpus_seed_or_configuration_is_no_resume() {
        let dir = tempfile::tempdir().unwrap();
        fixture::corpus(dir.path(), &CLIPS);
        let mut options = options(dir.path(), "run", Some(file()));
        (options.steps, options.seed) = (Some(1), Some(4));
        go(&options).unwrap();
        options.resume = true;
        let said = |change: &dyn Fn(&mut PretrainOptions)| {
            let mut options = options.clone();
            change(&mut options);
            go(&options).map(|s| s.step).map_err(|e| e.to_string())
        };
        assert!(said(&|o| o.seed = Some(5)).unwrap_err().contains("another configuration"));
        assert!(
            said(&|o| (o.seed, o.file) = (Some(5), None)).unwrap_err().contains("seed 5; the run was begun with 4")
        );
        assert!(said(&|o| o.file.as_mut().unwrap().model.width = 8).unwrap_err().contains("another configuration"));
        assert!(said(&|o| o.run = Some(dir.path().join("none"))).unwrap_err().contains("no config.toml"));
        assert_eq!(said(&|_| ()), Ok(1));
        assert_eq!(said(&|o| (o.file, o.steps) = (None, Some(2))), Ok(2));
        let elsewhere = dir.path().join("other");
        fs::create_dir(&elsewhere).unwrap();
        let other = fixture::corpus(&elsewhere, &CLIPS[..2]);
        assert!(said(&|o| o.corpus = Some(other.dir().into())).unwrap_err().contains("begin a new run"));
    }

    #[test]
    fn a_rate_that_blows_up_stops_with_step_and_clips() {
        let dir = tempfile::tempdir().unwrap();
        fixture::corpus(dir.path(), &CLIPS);
        let mut file = file();
        file.train.learning_rate = 1e30;
        (file.train.warmup, file.train.schedule, file.train.eval_every) = (0, Schedule::Constant, 0);
        let message = go(&options(dir.path(), "run", Some(file))).unwrap_err().to_string();
        assert!(message.starts_with("step 2: the ") && message.contains("clip0 from frame"), "{message}");
    }
}
