//! The training loop.

use super::{Summary, saved};
use crate::data::Data;
use crate::folder::RunFolder;
use crate::learner::{Learner, clip_share, listed};
use crate::metrics::{Metrics, StepFigures};
use crate::progress::Progress;
use crate::run::RunFile;
use crate::sample::sample;
use crate::stages::Stages;
use crate::{Error, Result, schedule};
use kinelm_corpus::Split;
use kinelm_model::checkpoint::{Best, Checkpoints, State};
use kinelm_model::likelihood::Likelihood;
use kinelm_model::{Compute, ModelKind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A run in memory.
pub struct Trainer<'a> {
    file: RunFile,
    data: &'a Data,
    stages: Stages<'a>,
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
        data: &'a Data,
        compute: Compute,
        progress: &'a mut dyn Progress,
    ) -> Result<Trainer<'a>> {
        let started = Instant::now();
        let c = &file.model;
        let stages = Stages::of_run(&file, data)?;
        if !data.has(Split::Valid) {
            progress.note("the corpus has no validation clip: the run is not measured, its latest checkpoint counts");
        }
        if file.tokens.varying && file.tokens.word > c.context {
            let (word, context) = (file.tokens.word, c.context);
            progress.note(&format!("words have up to {word} tokens, a window {context}: longer words are cut"));
        }
        if c.kind == ModelKind::Masked && file.train.sample_every > 0 {
            progress.note("a masked model draws no dances: sample_every does nothing");
        }
        let checkpoints = Checkpoints::of(run.path());
        let (learner, state) = saved::load(&file, compute, &checkpoints, progress)?;
        checkpoints.sweep()?;
        let metrics = Metrics::open(run.path(), state.step)?;
        Ok(Trainer {
            data,
            stages,
            learner,
            checkpoints,
            run: run.path().to_owned(),
            metrics,
            state,
            progress,
            started,
            pace: None,
            tokens_per_frame: data.tokens_per_frame(),
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
        while self.state.step < steps && !self.is_patience_out() && !stop.load(Ordering::Relaxed) {
            loss = Some(self.step()?);
            let (step, last) = (self.state.step, self.state.step == steps);
            let mut best = false;
            if last || every(self.file.train.eval_every, step) {
                (valid, best) = self.measure()?;
                self.sample();
            }
            if best || last || every(self.file.train.checkpoint_every, step) {
                saved = Some((step, self.save()?));
            }
        }
        let (step, early) = (self.state.step, self.is_patience_out());
        let checkpoint = match saved {
            Some((at, path)) if at == step => path,
            _ => self.save()?,
        };
        Ok(Summary {
            run: self.run,
            checkpoint,
            step,
            stopped: step < steps && !early,
            early: step < steps && early,
            loss,
            valid: valid.filter(|_| step >= steps || early),
            best: self.state.best,
            tokens: self.state.tokens,
            seconds: self.started.elapsed().as_secs_f64(),
        })
    }

    /// Whether so many measurements were no better that the run ends. It follows from where the run stands, so a run that
    /// is gone on with ends there too.
    fn is_patience_out(&self) -> bool {
        self.file.train.is_patience_out(self.state.step, self.state.best.map(|b| b.step))
    }

    /// One update; its loss.
    fn step(&mut self) -> Result<f64> {
        let begun = Instant::now();
        let (step, train) = (self.state.step, &self.file.train);
        let batches = self.stages.of_step(step)?;
        let here = |e| stopped_at(step + 1, e, &self.checkpoints);
        let found = self.learner.gradients_of(&batches, step).map_err(here)?;
        if !found.norm.is_finite() {
            let clips: Vec<String> = batches.iter().flat_map(|b| b.clips.iter().cloned()).collect();
            let clips = listed(clips.iter());
            return Err(here(Error::NotFinite(format!("the gradient's norm is {} on {clips}", found.norm))));
        }
        let rate = schedule::rate(train, step);
        self.learner.update(clip_share(found.norm, train.clip_norm), rate)?;
        self.state.step += 1;
        self.state.windows += batches.iter().map(|b| b.clips.len() as u64).sum::<u64>();
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
        self.learner.exchange()?;
        let found = self.data.likelihood(&mut *self.learner, Split::Valid, most);
        self.learner.exchange()?;
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

    /// A dance into `samples/`, where one is due; a note if it can't be made.
    fn sample(&mut self) {
        let (step, train) = (self.state.step, &self.file.train);
        let due = train.sample_every.saturating_mul(train.eval_every);
        if due == 0 || !step.is_multiple_of(due) || self.file.model.kind == ModelKind::Masked {
            return;
        }
        let weights = self.learner.averages().and_then(|all| all.map_or_else(|| self.learner.weights(), Ok));
        match weights.and_then(|weights| sample(&self.run, step, &self.file, weights)) {
            Ok(page) => self.progress.note(&format!("{}: a dance of the model as it is now", page.display())),
            Err(e) => self.progress.note(&format!("no dance after step {step}: {e}")),
        }
    }

    fn save(&mut self) -> Result<PathBuf> {
        let step = self.state.step;
        let contents = saved::of(&*self.learner).map_err(|e| stopped_at(step, e, &self.checkpoints))?;
        self.metrics.sync()?;
        let path = self.checkpoints.write(self.state.clone(), &contents)?;
        self.checkpoints.prune(self.file.train.keep)?;
        Ok(path)
    }
}

/// The error of a step; where numbers ran away, with what to do.
fn stopped_at(step: u64, e: Error, checkpoints: &Checkpoints) -> Error {
    let Error::NotFinite(what) = e else { return e };
    let way_on = match checkpoints.named("latest") {
        Some(step) => format!("the checkpoint of step {step} is whole; try a lower learning rate"),
        None => "try a lower learning rate".into(),
    };
    Error::NotFinite(format!("step {step}: {what}; {way_on}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learner::learner;
    use crate::{Silent, TrainConfig, fixture};
    use candle_core::{Device, Tensor};
    use kinelm_engine::linear::Products;
    use kinelm_model::checkpoint::CheckpointChoice;
    use kinelm_model::run::load_run;
    use kinelm_model::{Form, ModelConfig, layout};

    /// The error of a run whose numbers are poisoned after `steps` steps, and the run.
    fn poisoned(
        config: TrainConfig,
        steps: u64,
        poison: &dyn Fn(&mut Trainer, Compute),
        form: Form,
    ) -> (String, tempfile::TempDir) {
        let dir = tempfile::tempdir().unwrap();
        let clips = [(40, Split::Train), (7, Split::Train), (12, Split::Valid)];
        let data = Data::one(fixture::corpus(dir.path(), &clips)).unwrap();
        let model = ModelConfig { layers: 2, heads: 2, width: 16, context: 24, dropout: 0.1, ..Default::default() };
        let file = RunFile::new(&model, &TrainConfig { batch: 3, steps: 9, warmup: 3, ..config }, &data).unwrap();
        let folder = super::super::begin(&dir.path().join("run"), &file, &data, None).unwrap();
        let (mut silent, compute) = (Silent, Compute { form, ..Default::default() });
        let mut trainer = Trainer::new(&folder, file, &data, compute, &mut silent).unwrap();
        for _ in 0..steps {
            trainer.step().unwrap();
        }
        if steps > 0 {
            trainer.save().unwrap();
        }
        poison(&mut trainer, compute);
        let message = trainer.train(&AtomicBool::new(false)).unwrap_err().to_string();
        if steps > 0 {
            let whole = load_run(&dir.path().join("run"), CheckpointChoice::Latest).unwrap();
            assert_eq!(whole.state.step, steps, "nothing was written after the poison");
        }
        (message, dir)
    }

    /// Puts `value` all over some of the weights.
    fn weights(trainer: &mut Trainer, compute: Compute, poison: &[(&str, f32)]) {
        let mut weights = trainer.learner.weights().unwrap();
        for &(name, value) in poison {
            let shape = weights[name].dims().to_vec();
            weights.insert(name.into(), Tensor::full(value, shape.as_slice(), &Device::Cpu).unwrap());
        }
        let file = &trainer.file;
        let compute = (compute, Products::F32);
        trainer.learner = learner(&file.model, &file.tokens, &file.train, weights, compute).unwrap();
    }

    const FORMS: [Form; 2] = [Form::Auto, Form::Plain];

    #[test]
    fn a_loss_that_is_not_finite_stops_with_step_clips_and_the_whole_checkpoint() {
        for form in FORMS {
            let nan = |t: &mut Trainer, c| weights(t, c, &[("norm.bias", f32::NAN)]);
            let (message, _dir) = poisoned(TrainConfig::default(), 0, &nan, form);
            assert!(message.starts_with("step 1: the loss is NaN on clip0 from frame"), "{form:?}: {message}");
            assert!(message.ends_with("; try a lower learning rate"), "{message}");
            let infinite = |t: &mut Trainer, c| weights(t, c, &[("token.weight", f32::INFINITY)]);
            for accumulate in [1, 3] {
                let (message, _dir) = poisoned(TrainConfig { accumulate, ..Default::default() }, 4, &infinite, form);
                assert!(message.starts_with("step 5: the loss is "), "{form:?}: {message}");
                assert!(message.contains("clip") && message.contains("the checkpoint of step 4 is whole"), "{message}");
            }
        }
    }

    #[test]
    fn a_gradient_that_is_not_finite_stops_with_all_clips_of_the_step() {
        // nothing comes out of the layer, but what goes back through it overflows
        let huge = [
            ("block.01.norm2.weight", 0.0),
            ("block.01.norm2.bias", 0.0),
            ("block.01.mlp.up.weight", 1e25),
            ("block.01.mlp.up.bias", 0.0),
            ("block.01.mlp.down.weight", 1e30),
        ];
        for (form, accumulate) in [(Form::Auto, 1), (Form::Auto, 2), (Form::Plain, 1), (Form::Plain, 2)] {
            let poison = |t: &mut Trainer, c| weights(t, c, &huge);
            let (message, _dir) = poisoned(TrainConfig { accumulate, ..Default::default() }, 2, &poison, form);
            assert!(message.starts_with("step 3: the gradient's norm is "), "{form:?}: {message}");
            assert_eq!(message.matches("from frame").count(), 3 * accumulate, "{message}");
            assert!(message.contains("the checkpoint of step 2 is whole"), "{message}");
        }
    }

    #[test]
    fn an_average_that_is_not_finite_is_found_where_it_is_measured_and_never_saved() {
        let nan = |t: &mut Trainer, _| {
            let parameters = layout::parameters(&t.file.model, &t.file.tokens);
            let tensor = |p: &layout::Parameter| Tensor::full(f32::NAN, p.shape.as_slice(), &Device::Cpu).unwrap();
            t.learner.restore_averages(parameters.iter().map(|p| (p.name.clone(), tensor(p))).collect()).unwrap();
        };
        for form in FORMS {
            let config = TrainConfig { ema: 0.9, eval_every: 3, checkpoint_every: 5, ..Default::default() };
            let (message, _dir) = poisoned(config.clone(), 2, &nan, form);
            assert!(message.starts_with("step 3: clip2 from token 0: NaN nats"), "{form:?}: {message}");
            assert!(message.contains("the checkpoint of step 2 is whole"), "{message}");
            let (message, _dir) = poisoned(TrainConfig { eval_every: 0, ..config }, 2, &nan, form);
            assert!(message.starts_with("step 5: ema.safetensors would hold NaN in block.00."), "{form:?}: {message}");
            assert!(message.contains("the checkpoint of step 2 is whole"), "{message}");
        }
    }
}
