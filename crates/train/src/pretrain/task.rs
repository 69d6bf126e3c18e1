//! A GPT as the training loop trains it.

use super::{Summary, saved};
use crate::data::Data;
use crate::folder::RunFolder;
use crate::learner::{Fit, Learner};
use crate::metrics::{Metrics, StepMetrics};
use crate::progress::Progress;
use crate::run::RunFile;
use crate::sample::sample;
use crate::stages::Stages;
use crate::trainer::{Files, Task, Trainer};
use crate::{Result, schedule};
use kinelm_corpus::Split;
use kinelm_model::Compute;
use kinelm_model::checkpoint::{Checkpoints, Measured, State};
use kinelm_model::scored_windows::Likelihood;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// A run of a GPT in memory.
pub struct Pretraining<'a> {
    pub(crate) file: RunFile,
    data: &'a Data,
    pub(crate) fit: Fit<'a>,
    run: PathBuf,
    metrics: Metrics,
    progress: &'a mut dyn Progress,
    /// Seconds of a step, smoothed.
    pace: Option<f64>,
    /// Of the training clips.
    tokens_per_frame: f64,
    /// The last step's loss.
    loss: Option<f64>,
    /// The last measurement.
    valid: Option<Likelihood>,
}

impl<'a> Pretraining<'a> {
    /// The run in a folder, at its last whole checkpoint.
    pub(super) fn open(
        run: &RunFolder,
        file: RunFile,
        data: &'a Data,
        compute: Compute,
        checkpoints: &Checkpoints,
        progress: &'a mut dyn Progress,
    ) -> Result<(Pretraining<'a>, State)> {
        let stages = Stages::of_run(&file, data)?;
        if !data.has(Split::Valid) {
            progress.note("the corpus has no validation clip: the run is not measured, its latest checkpoint counts");
        }
        let (word, context) = (file.tokens.word, file.model.context);
        if file.tokens.varying && word > context {
            progress.note(&format!("words have up to {word} tokens, a window {context}: longer words are truncated"));
        }
        let (learner, state) = saved::load(&file, compute, checkpoints, progress)?;
        // only once a checkpoint has been read: a folder that fails stays as it is
        checkpoints.sweep()?;
        let metrics = Metrics::open(run.path(), state.step)?;
        let task = Pretraining {
            data,
            fit: Fit::new(stages, learner, &file.train),
            run: run.path().to_owned(),
            metrics,
            progress,
            pace: None,
            tokens_per_frame: data.tokens_per_frame(),
            loss: None,
            valid: None,
            file,
        };
        Ok((task, state))
    }

    /// How the run ended, for which this call started at `started`.
    pub(super) fn summary(&self, trainer: &Trainer<Self>, started: Instant) -> Summary {
        let (state, steps) = (trainer.state(), self.file.train.steps);
        let early = self.is_over(state);
        Summary {
            run: self.run.clone(),
            checkpoint: trainer.checkpoint().unwrap_or(&self.run).to_owned(),
            step: state.step,
            stopped: state.step < steps && !early,
            early: state.step < steps && early,
            loss: self.loss,
            valid: self.valid.filter(|_| state.step >= steps || early),
            best: state.best,
            tokens: state.tokens,
            seconds: started.elapsed().as_secs_f64(),
        }
    }

    fn learner(&mut self) -> &mut dyn Learner {
        &mut *self.fit.learner
    }

    /// Writes a dance into `samples/`, where one is due; notes if it can't be made.
    fn sample(&mut self, step: u64) {
        let train = &self.file.train;
        if !is_sampled(step, train.eval_every, train.sample_every) {
            return;
        }
        let weights = self.fit.learner.averages().and_then(|all| all.map_or_else(|| self.fit.learner.weights(), Ok));
        match weights.and_then(|weights| sample(&self.run, step, &self.file, &weights)) {
            Ok(page) => self.progress.note(&format!("{}: a dance of the model after step {step}", page.display())),
            Err(e) => self.progress.note(&format!("no dance after step {step}: {e}")),
        }
    }
}

/// Whether a dance is due with the measurement after `step`: with every `sample_every`-th one. The last step is measured
/// too, though it may be no multiple of `eval_every`.
fn is_sampled(step: u64, eval_every: u64, sample_every: u64) -> bool {
    // without others it is the only measurement
    let measurement = if eval_every > 0 { step.div_ceil(eval_every) } else { 1 };
    sample_every > 0 && measurement.is_multiple_of(sample_every)
}

impl Task for Pretraining<'_> {
    type Step = StepMetrics;

    fn update(&mut self, state: &mut State) -> Result<StepMetrics> {
        let begun = Instant::now();
        let (found, windows) = self.fit.gradients(state.step)?;
        let rate = schedule::rate(&self.file.train, state.step);
        self.fit.update(found.norm, rate)?;
        state.step += 1;
        state.windows += windows as u64;
        state.tokens += found.counted as u64;
        let seconds = begun.elapsed().as_secs_f64();
        // over about the last 20 steps
        let pace = self.pace.map_or(seconds, |p| 0.95 * p + 0.05 * seconds);
        (self.pace, self.loss) = (Some(pace), Some(found.loss));
        let metrics = StepMetrics {
            step: state.step,
            loss: found.loss,
            bits_per_frame: found.loss / std::f64::consts::LN_2 * self.tokens_per_frame,
            rate,
            gradient_norm: found.norm,
            tokens: state.tokens,
            tokens_per_second: found.counted as f64 / seconds,
        };
        self.metrics.step(&metrics)?;
        let steps = self.file.train.steps;
        self.progress.step(&metrics, steps, Duration::from_secs_f64(pace * (steps - state.step) as f64));
        Ok(metrics)
    }

    fn measure(&mut self, state: &mut State) -> Result<Option<bool>> {
        let (step, data, most) = (state.step, self.data, self.file.train.eval_windows);
        self.learner().swap_averages()?;
        let found = data.likelihood(self.learner().scores(), Split::Valid, most);
        // back before the error below: training must go on from the weights
        self.learner().swap_averages()?;
        self.valid = found?;
        let mut best = false;
        if let Some(found) = &self.valid {
            best = state.measured(Measured::BitsPerFrame(found.bits_per_frame));
            self.metrics.valid(step, found)?;
            self.progress.valid(step, found, best);
        }
        self.sample(step);
        Ok(Some(best))
    }

    /// Follows from the state alone, so that a resumed run ends at the same step.
    fn is_over(&self, state: &State) -> bool {
        self.file.train.is_patience_out(state.step, state.best.map(|b| b.step))
    }

    fn files(&mut self, _due: bool) -> Result<Files> {
        let files = saved::files(&*self.fit.learner)?;
        self.metrics.sync()?;
        Ok(files)
    }
}

#[cfg(test)]
mod tests {
    use super::is_sampled;

    #[test]
    fn the_last_measurement_counts_as_one() {
        let steps = |eval_every, sample_every| -> Vec<u64> {
            // measured every `eval_every` steps and after the last
            let measured = (1..=250).filter(|step| *step == 250 || step % eval_every == 0);
            measured.filter(|step| is_sampled(*step, eval_every, sample_every)).collect()
        };
        assert_eq!((steps(100, 1), steps(100, 2), steps(1000, 1)), (vec![100, 200, 250], vec![200], vec![250]));
        assert!(steps(100, 0).is_empty() && is_sampled(250, 0, 1) && !is_sampled(250, 0, 2));
    }
}
