//! The training loop.

use super::{Summary, saved};
use crate::corpus::{ClipRecord, Corpus, Split};
use crate::evaluate::likelihood::{Likelihood, likelihood};
use crate::model::Compute;
use crate::model::checkpoint::{Best, Checkpoints, State};
use crate::train::batches::Batches;
use crate::train::folder::RunFolder;
use crate::train::learner::{Learner, clip_share};
use crate::train::metrics::{Metrics, StepFigures};
use crate::train::progress::Progress;
use crate::train::run::RunFile;
use crate::train::schedule;
use crate::{Error, Result};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A run in memory.
pub struct Trainer<'a> {
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
    /// When this call began.
    started: Instant,
    /// Seconds of a step, smoothed.
    pace: Option<f64>,
    /// Of the training clips.
    tokens_per_frame: f64,
}

impl<'a> Trainer<'a> {
    /// The run in a folder, where it stands.
    ///
    /// # Errors
    /// A corpus without training clips, no checkpoint that is whole though there are some, what the system refuses.
    pub fn new(
        run: &RunFolder,
        file: RunFile,
        corpus: &'a Corpus,
        compute: Compute,
        progress: &'a mut dyn Progress,
    ) -> Result<Trainer<'a>> {
        let started = Instant::now();
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
        let checkpoints = Checkpoints::of(run.path());
        let (learner, state) = saved::load(&file, compute, &checkpoints, progress)?;
        checkpoints.sweep()?;
        let metrics = Metrics::open(run.path(), state.step)?;
        Ok(Trainer {
            corpus,
            valid,
            batches,
            learner,
            checkpoints,
            run: run.path().to_owned(),
            metrics,
            state,
            progress,
            started,
            pace: None,
            tokens_per_frame: corpus.tokens_per_frame(Split::Train),
            file,
        })
    }

    /// Trains up to the last step, or until `stop` becomes true.
    ///
    /// # Errors
    /// Numbers that are not finite, with the step, the clips and the last whole checkpoint; what the system refuses.
    pub fn train(mut self, stop: &AtomicBool) -> Result<Summary> {
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
            seconds: self.started.elapsed().as_secs_f64(),
        })
    }

    /// One update; its loss.
    fn step(&mut self) -> Result<f64> {
        let begun = Instant::now();
        let (step, train) = (self.state.step, &self.file.train);
        let batch = self.batches.batch(step);
        let here = |e| stopped_at(step + 1, e, &self.checkpoints);
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
        let (step, most) = (self.state.step, self.file.train.eval_windows);
        let found = likelihood(&mut *self.learner, self.corpus, &self.valid, most);
        let Some(found) = found.map_err(|e| stopped_at(step, e, &self.checkpoints))? else {
            return Ok((None, false));
        };
        let bits_per_frame = found.bits_per_frame;
        let best = self.state.best.is_none_or(|b| bits_per_frame < b.bits_per_frame);
        if best {
            self.state.best = Some(Best { step, bits_per_frame });
        }
        self.metrics.valid(step, &found)?;
        self.progress.valid(step, &found, best);
        Ok((Some(found), best))
    }

    fn save(&mut self) -> Result<PathBuf> {
        let step = self.state.step;
        let contents = saved::of(&*self.learner).map_err(|e| match e {
            Error::Call(_) => stopped_at(step, e, &self.checkpoints),
            other => other,
        })?;
        let path = self.checkpoints.write(self.state.clone(), &contents)?;
        self.checkpoints.prune(self.file.train.keep)?;
        Ok(path)
    }
}

/// The error of a step at which numbers ran away, with what to do.
fn stopped_at(step: u64, e: Error, checkpoints: &Checkpoints) -> Error {
    let way_on = match checkpoints.named("latest") {
        Some(step) => format!("the checkpoint of step {step} is whole; try a lower learning rate"),
        None => "try a lower learning rate".into(),
    };
    Error::Call(format!("step {step}: {e}; {way_on}"))
}
