//! The training loop: updates, measurements and checkpoints in their cadence. It can stop after any update, and resumes to
//! the same bits.

use crate::{Error, Result};
use kinelm_model::checkpoint::{Checkpoint, CheckpointChoice, Checkpoints, Keep, State};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Files of a checkpoint by name, with their bytes.
pub type Files = Vec<(&'static str, Vec<u8>)>;

/// A network with its data, as a [`Trainer`] trains it.
pub trait Task {
    /// The report of an update.
    type Step;

    /// Makes the update after `state.step` others, and counts it in `state`.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for a loss or gradients that are no numbers; `state` is unchanged then.
    fn update(&mut self, state: &mut State) -> Result<Self::Step>;

    /// Measures the network on the validation clips. Returns whether it is the best so far, or `None` where the measurement
    /// was interrupted: it is made again before the next update.
    ///
    /// # Errors
    /// Errors of measuring.
    fn measure(&mut self, _state: &mut State) -> Result<Option<bool>> {
        Ok(Some(false))
    }

    /// Whether training ends before its last step.
    fn is_over(&self, _state: &State) -> bool {
        false
    }

    /// The files of a checkpoint; `due`: the measurement of this step is still to be made.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for weights that are no numbers; what the system refuses.
    fn files(&mut self, due: bool) -> Result<Files>;
}

/// How often the loop measures and saves.
#[derive(Debug, Clone, Copy)]
pub struct Cadence {
    /// Updates in all.
    pub steps: u64,
    /// Updates between measurements; 0: only after the last.
    pub eval_every: u64,
    /// Updates between checkpoints; 0: only after the last, and where the measurement is the best.
    pub checkpoint_every: u64,
    /// Checkpoints that stay beside the best.
    pub keep: Keep,
}

/// A training: an iterator of updates. Each item is one update, with the measurement and the checkpoint that are due after
/// it. It is silent; tasks report their progress.
///
/// ```
/// use kinelm_model::checkpoint::{Keep, State};
/// use kinelm_train::{Result, Task, Trainer, trainer::{Cadence, Files}};
///
/// /// Moves x to 0.
/// struct Descent(f64);
///
/// impl Task for Descent {
///     type Step = f64;
///
///     fn update(&mut self, state: &mut State) -> Result<f64> {
///         self.0 -= 0.5 * self.0;
///         state.step += 1;
///         Ok(self.0)
///     }
///
///     fn files(&mut self, _due: bool) -> Result<Files> {
///         Ok(vec![("x", self.0.to_le_bytes().into())])
///     }
/// }
///
/// let cadence = Cadence { steps: 3, eval_every: 0, checkpoint_every: 0, keep: Keep::All };
/// let trainer = Trainer::new(Descent(8.0), cadence, None, State::new(0, 0, 0, 1, None));
/// assert_eq!(trainer.collect::<Result<Vec<f64>>>()?, [4.0, 2.0, 1.0]);
/// # Result::Ok(())
/// ```
pub struct Trainer<T> {
    /// The network and its data.
    pub task: T,
    cadence: Cadence,
    checkpoints: Option<Checkpoints>,
    state: State,
    due: bool,
    /// The checkpoint of `state`.
    saved: Option<PathBuf>,
}

impl<T: Task> Trainer<T> {
    /// A training that continues from `state`. Without `checkpoints` nothing is saved.
    pub fn new(task: T, cadence: Cadence, checkpoints: Option<Checkpoints>, state: State) -> Trainer<T> {
        Trainer { task, cadence, checkpoints, state, due: false, saved: None }
    }

    /// The same, beginning with a measurement that was interrupted, if one is `due`.
    pub fn measuring(self, due: bool) -> Trainer<T> {
        Trainer { due, ..self }
    }

    /// Updates and windows so far.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Whether nothing is left to do.
    pub fn is_done(&self) -> bool {
        !self.due && (self.state.step >= self.cadence.steps || self.task.is_over(&self.state))
    }

    /// Trains until nothing is left to do or `stop` becomes true, and saves the last state.
    ///
    /// # Errors
    /// Those of the task, numbers that are not finite with the step and the last whole checkpoint; what the system refuses.
    pub fn train(&mut self, stop: &AtomicBool) -> Result<()> {
        while !stop.load(Ordering::Relaxed)
            && let Some(step) = self.next()
        {
            step?;
        }
        self.finish()
    }

    /// Saves the present state, unless its checkpoint exists.
    ///
    /// # Errors
    /// As [`Trainer::train`].
    pub fn finish(&mut self) -> Result<()> {
        if self.saved.is_some() { Ok(()) } else { self.save() }
    }

    /// The checkpoint of the present state, once it is saved.
    pub fn checkpoint(&self) -> Option<&Path> {
        self.saved.as_deref()
    }

    fn step(&mut self) -> Result<T::Step> {
        let next = self.state.step + 1;
        let step = self.task.update(&mut self.state).map_err(|e| located(next, e, &self.checkpoints))?;
        // the state has moved on: what was saved is an earlier one's
        self.saved = None;
        self.due = self.is_every(self.cadence.eval_every);
        self.settle()?;
        Ok(step)
    }

    /// Measures and saves, where that is due.
    fn settle(&mut self) -> Result<()> {
        let mut best = false;
        if self.due {
            self.saved = None;
            let measured = self.task.measure(&mut self.state);
            let measured = measured.map_err(|e| located(self.state.step, e, &self.checkpoints))?;
            (self.due, best) = (measured.is_none(), measured == Some(true));
        }
        if best || self.is_every(self.cadence.checkpoint_every) { self.save() } else { Ok(()) }
    }

    /// Whether the present step is the last, or one of every `n`.
    fn is_every(&self, n: u64) -> bool {
        let step = self.state.step;
        step == self.cadence.steps || (n > 0 && step.is_multiple_of(n))
    }

    fn save(&mut self) -> Result<()> {
        let Some(checkpoints) = &self.checkpoints else { return Ok(()) };
        let files = self.task.files(self.due).map_err(|e| located(self.state.step, e, &self.checkpoints))?;
        self.saved = Some(checkpoints.write(self.state.clone(), &files)?);
        // after the write: earlier checkpoints go only when this one is whole
        checkpoints.prune(self.cadence.keep, self.state.step)
    }
}

impl<T: Task> Iterator for Trainer<T> {
    type Item = Result<T::Step>;

    /// The next update; `None` when nothing is left to do, or a measurement is interrupted again.
    fn next(&mut self) -> Option<Result<T::Step>> {
        if self.due
            && let Err(e) = self.settle()
        {
            return Some(Err(e));
        }
        (!self.due && !self.is_done()).then(|| self.step())
    }
}

/// The error of a step; where numbers are not finite, with the step and what to do.
fn located(step: u64, e: Error, checkpoints: &Option<Checkpoints>) -> Error {
    let Error::NotFinite(what) = e else { return e };
    let whole = match checkpoints.as_ref().and_then(|checkpoints| checkpoints.named("latest")) {
        Some(step) => format!("the checkpoint of step {step} is whole; "),
        None => String::new(),
    };
    Error::NotFinite(format!("step {step}: {what}; {whole}try a lower learning rate"))
}

/// The last whole checkpoint of a run with the files `wanted`; `None` before the first.
///
/// # Errors
/// Checkpoints that are gone or of which none is whole.
pub fn last_checkpoint(
    checkpoints: &Checkpoints,
    wanted: &[&str],
    note: &mut dyn FnMut(String),
) -> Result<Option<Checkpoint>> {
    if !checkpoints.steps()?.is_empty() {
        let mut found = checkpoints.find(CheckpointChoice::Latest, wanted, &[], note)?;
        // a checkpoint's list of files is made anew when it is written
        found.state.files.clear();
        return Ok(Some(found));
    }
    match checkpoints.named("latest") {
        Some(step) => {
            let found = format!("no checkpoint, though `latest` names that of step {step}");
            Err(Error::file(
                checkpoints.run(),
                found,
                "the checkpoints that it wrote",
                "put it back, or begin a new run",
            ))
        }
        None => Ok(None),
    }
}

/// Refuses to end a run before its last checkpoint: `steps` are requested in all.
///
/// # Errors
/// [`kinelm_store::Error::Invalid`] with both numbers.
pub fn check_steps(run: &Path, steps: u64) -> Result<()> {
    // from the checkpoints that exist, whatever `latest` names
    let checkpoints = Checkpoints::of(run);
    let done = checkpoints.steps()?.into_iter().rev().find(|&step| checkpoints.state(step).is_ok());
    match done.filter(|done| steps < *done) {
        Some(done) => {
            let expected = format!("{done} or more: the run has done {done}; or begin a new run");
            Err(Error::invalid_parameter("steps", steps, expected))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factory::learner;
    use crate::pretrain::{Pretraining, begin};
    use crate::run::RunFile;
    use crate::{Data, NoProgress, TrainConfig, fixture};
    use kinelm_corpus::Split;
    use kinelm_engine::linear::Products;
    use kinelm_model::run::load_run;
    use kinelm_model::weights::Array;
    use kinelm_model::{Compute, Form, ModelConfig, layout};

    type Run<'a> = Trainer<Pretraining<'a>>;

    /// The error of a run whose numbers are poisoned after `steps` steps, and the run.
    fn poisoned(
        config: TrainConfig,
        steps: u64,
        poison: &dyn Fn(&mut Run, Compute),
        form: Form,
    ) -> (String, tempfile::TempDir) {
        let dir = tempfile::tempdir().unwrap();
        let clips = [(40, Split::Train), (7, Split::Train), (12, Split::Valid)];
        let data = Data::one(fixture::corpus(dir.path(), &clips)).unwrap();
        let model = ModelConfig { layers: 2, heads: 2, width: 16, context: 24, dropout: 0.1, ..Default::default() };
        let file = RunFile::new(&model, &TrainConfig { batch: 3, steps: 9, warmup: 3, ..config }, &data).unwrap();
        let folder = begin(&dir.path().join("run"), &file, &data, None).unwrap();
        let (mut silent, compute) = (NoProgress, Compute { form, ..Default::default() });
        let mut trainer = crate::pretrain::trainer(&folder, file, &data, compute, &mut silent).unwrap();
        for _ in 0..steps {
            trainer.next().unwrap().unwrap();
        }
        if steps > 0 {
            trainer.finish().unwrap();
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
    fn weights(trainer: &mut Run, compute: Compute, poison: &[(&str, f32)]) {
        let mut weights = trainer.task.fit.learner.weights().unwrap();
        for &(name, value) in poison {
            let array = weights.get_mut(name).unwrap();
            *array = Array::full(array.shape(), value);
        }
        let file = &trainer.task.file;
        trainer.task.fit.learner =
            learner(&file.model, &file.tokens, &file.train, &weights, compute, Products::F32).unwrap();
    }

    const FORMS: [Form; 2] = [Form::Auto, Form::Plain];

    #[test]
    fn a_loss_that_is_not_finite_stops_with_step_clips_and_the_whole_checkpoint() {
        for form in FORMS {
            let nan = |t: &mut Run, c| weights(t, c, &[("norm.bias", f32::NAN)]);
            let (message, _dir) = poisoned(TrainConfig::default(), 0, &nan, form);
            assert!(message.starts_with("step 1: the loss is NaN on clip0 from frame"), "{form:?}: {message}");
            assert!(message.ends_with("; try a lower learning rate"), "{message}");
            let infinite = |t: &mut Run, c| weights(t, c, &[("token.weight", f32::INFINITY)]);
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
            let poison = |t: &mut Run, c| weights(t, c, &huge);
            let (message, _dir) = poisoned(TrainConfig { accumulate, ..Default::default() }, 2, &poison, form);
            assert!(message.starts_with("step 3: the gradient's norm is "), "{form:?}: {message}");
            assert_eq!(message.matches("from frame").count(), 3 * accumulate, "{message}");
            assert!(message.contains("the checkpoint of step 2 is whole"), "{message}");
        }
    }

    #[test]
    fn an_average_that_is_not_finite_is_found_where_it_is_measured_and_never_saved() {
        let nan = |t: &mut Run, _| {
            let parameters = layout::parameters(&t.task.file.model, &t.task.file.tokens);
            let average = |p: &layout::Parameter| (p.name.clone(), Array::full(&p.shape, f32::NAN));
            t.task.fit.learner.restore_averages(&parameters.iter().map(average).collect()).unwrap();
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
