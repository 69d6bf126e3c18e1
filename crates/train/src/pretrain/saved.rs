//! The files of a checkpoint: the weights, the optimizer's moments, and the weights' average if there is one.

use crate::factory::learner;
use crate::learner::Learner;
use crate::optimizer::MOMENTS;
use crate::progress::Progress;
use crate::run::RunFile;
use crate::trainer::{Files, last_checkpoint};
use crate::{Error, Result};
use kinelm_model::checkpoint::{Checkpoints, State};
use kinelm_model::run::{AVERAGED, OPTIMIZER, WEIGHTS};
use kinelm_model::weights::{self, Array, Weights, in_order};
use kinelm_model::{Compute, forecast, layout};

/// The state of a run before its first step.
pub fn before(file: &RunFile) -> State {
    State::new(0, 0, 0, file.train.seed, None)
}

/// The files of a model that learns.
///
/// # Errors
/// Errors of the device; a number that is not finite, with its tensor.
pub fn files(learner: &dyn Learner) -> Result<Files> {
    to_bytes(learner.weights()?, learner.moments()?, learner.averages()?)
}

/// The files of a model with these weights before its first step.
///
/// # Errors
/// Weights of another model than the run's, each named; numbers that are not finite.
pub fn first(file: &RunFile, weights: Weights) -> Result<Files> {
    let parameters = layout::parameters(&file.model, &file.tokens);
    let is_own = |name: &str| forecast::is_tensor(name) || parameters.iter().any(|p| p.name == name);
    if let Some(name) = weights.keys().find(|name| !is_own(name)) {
        return Err(Error::Weights(format!("the model has no place for the tensor {name}")));
    }
    // before anything is written, as `load` would refuse them only in the folder of a run
    in_order("first weights", &parameters, &weights, |p| p.name.clone())?;
    let named = |prefix| parameters.iter().map(move |p| (format!("{prefix}.{}", p.name), Array::full(&p.shape, 0.0)));
    let moments = MOMENTS.into_iter().flat_map(named).collect();
    let averages = (file.train.ema > 0.0).then(|| weights.clone());
    to_bytes(weights, moments, averages)
}

fn to_bytes(weights: Weights, moments: Weights, averages: Option<Weights>) -> Result<Files> {
    let averages = averages.map(|all| (AVERAGED, all));
    let all = [(WEIGHTS, weights), (OPTIMIZER, moments)].into_iter().chain(averages);
    all.map(|(name, all)| Ok((name, weights::finite_bytes(name, &all)?))).collect()
}

/// The learner of a run and its state: at its last whole checkpoint, or before its first step.
///
/// # Errors
/// No checkpoint that is whole though there are some; weights that don't fit; what the device refuses.
pub fn load(
    file: &RunFile,
    compute: Compute,
    checkpoints: &Checkpoints,
    progress: &mut dyn Progress,
) -> Result<(Box<dyn Learner>, State)> {
    let averages = file.train.ema > 0.0;
    let wanted = [WEIGHTS, OPTIMIZER, AVERAGED];
    let found = last_checkpoint(checkpoints, &wanted[..2 + usize::from(averages)], &mut |n| progress.note(&n))?;
    // before its first step nothing has computed, whatever the run began with
    let ran = found.as_ref().filter(|found| found.state.step > 0);
    let ran = ran.map(|found| found.state.products.clone().unwrap_or("f32".into()));
    if found.is_none() {
        progress.note("no checkpoint yet: beginning at the first step");
    }
    let precision = file.train.precision.resolve(ran.as_deref(), compute)?;
    precision.notes.iter().for_each(|note| progress.note(note));
    let learner =
        |weights: &Weights| learner(&file.model, &file.tokens, &file.train, weights, compute, precision.products);
    let (learner, mut state) = match found {
        None => {
            let weights = weights::initial(&file.model, &file.tokens, file.train.seed);
            let mut learner = learner(&weights)?;
            if averages {
                // a run that ends before its first update is its weights
                learner.restore_averages(&weights)?;
            }
            (learner, before(file))
        }
        Some(found) => {
            let tensors = |name: &str| weights::from_bytes(&found.dir.join(name), &found.files[name]);
            let mut learner = learner(&tensors(WEIGHTS)?)?;
            learner.restore(&tensors(OPTIMIZER)?, found.state.step)?;
            if averages {
                learner.restore_averages(&tensors(AVERAGED)?)?;
            }
            if found.state.step > 0 {
                progress.note(&format!("resuming after step {}", found.state.step));
            }
            (learner, found.state)
        }
    };
    state.products = file.train.precision.recorded(precision.products);
    Ok((learner, state))
}
