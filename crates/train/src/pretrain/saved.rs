//! What a checkpoint holds besides the state: the weights, the optimizer's moments, and the weights' average if there is
//! one.

use crate::learner::{Learner, learner};
use crate::progress::Progress;
use crate::run::RunFile;
use crate::{Error, Result};
use candle_core::{DType, Device, Tensor};
use kinelm_model::checkpoint::{CheckpointChoice, Checkpoints, State};
use kinelm_model::run::{AVERAGED, OPTIMIZER, WEIGHTS};
use kinelm_model::{Compute, layout, weights};
use std::collections::BTreeMap;

/// Files of a checkpoint and their bytes.
pub type Contents = Vec<(&'static str, Vec<u8>)>;

/// A run before its first step.
pub fn before(file: &RunFile) -> State {
    State::new(0, 0, 0, file.train.seed, None)
}

/// What is saved of a model that learns.
///
/// # Errors
/// What the device refuses; a number that is not finite: its tensor is named.
pub fn of(learner: &dyn Learner) -> Result<Contents> {
    contents(learner.weights()?, learner.moments()?, learner.averages()?)
}

/// What is saved of a model of these weights before its first step.
///
/// # Errors
/// Weights of another model than the run's, each named; numbers that are not finite.
pub fn first(file: &RunFile, weights: BTreeMap<String, Tensor>) -> Result<Contents> {
    let parameters = layout::parameters(&file.model, &file.tokens);
    let mut moments = BTreeMap::new();
    for p in &parameters {
        match weights.get(&p.name) {
            Some(tensor) if tensor.dims() == p.shape => (),
            Some(tensor) => {
                let (name, found, expected) = (&p.name, tensor.dims(), &p.shape);
                return Err(Error::call(format!("tensor {name} has the shape {found:?}; expected {expected:?}")));
            }
            None => return Err(Error::call(format!("no tensor {} among the weights to begin with", p.name))),
        }
        for prefix in crate::adamw::MOMENTS {
            let zeros = Tensor::zeros(p.shape.as_slice(), DType::F32, &Device::Cpu)?;
            moments.insert(format!("{prefix}.{}", p.name), zeros);
        }
    }
    match weights.keys().find(|name| parameters.iter().all(|p| p.name != **name)) {
        Some(name) => Err(Error::call(format!("the model has no place for the tensor {name}"))),
        None => {
            let averages = (file.train.ema > 0.0).then(|| weights.clone());
            contents(weights, moments, averages)
        }
    }
}

/// Tensors by name.
type Tensors = BTreeMap<String, Tensor>;

fn contents(weights: Tensors, moments: Tensors, averages: Option<Tensors>) -> Result<Contents> {
    let averages = averages.map(|all| (AVERAGED, all));
    let all = [(WEIGHTS, weights), (OPTIMIZER, moments)].into_iter().chain(averages);
    all.map(|(name, all)| Ok((name, weights::finite_bytes(name, &all)?))).collect()
}

/// Where the run stands: at its last whole checkpoint, or before its first step.
///
/// # Errors
/// No checkpoint that is whole though there are some; weights that don't fit; what the device refuses.
pub fn load(
    file: &RunFile,
    compute: Compute,
    checkpoints: &Checkpoints,
    progress: &mut dyn Progress,
) -> Result<(Box<dyn Learner>, State)> {
    let learner = |ran: Option<&str>, weights, progress: &mut dyn Progress| -> Result<_> {
        let chosen = file.train.precision.choose(ran, compute)?;
        chosen.notes.iter().for_each(|note| progress.note(note));
        let recorded = file.train.precision.recorded(chosen.products);
        Ok((learner(&file.model, &file.tokens, &file.train, weights, (compute, chosen.products))?, recorded))
    };
    if checkpoints.steps()?.is_empty() {
        if let Some(step) = checkpoints.named("latest") {
            let found = format!("no checkpoint, though `latest` names that of step {step}");
            let help = "put it back, or begin a new run";
            return Err(Error::file(checkpoints.run(), found, "the checkpoints that it wrote", help));
        }
        progress.note("no checkpoint yet: beginning at the first step");
        let weights = layout::initial(&file.model, &file.tokens, file.train.seed)?;
        let (mut learner, products) = learner(None, weights.clone(), progress)?;
        if file.train.ema > 0.0 {
            // a run that ends before its first update is its weights
            learner.restore_averages(weights)?;
        }
        return Ok((learner, State { products, ..before(file) }));
    }
    let averages = file.train.ema > 0.0;
    let wanted = [WEIGHTS, OPTIMIZER, AVERAGED];
    let wanted = if averages { &wanted[..] } else { &wanted[..2] };
    let found = checkpoints.find(CheckpointChoice::Latest, wanted, &[], &mut |n| progress.note(&n))?;
    let tensors = |name: &str| weights::from_bytes(&found.dir.join(name), &found.files[name]);
    // before its first step nothing ran, whatever the run began with
    let ran = found.state.products.as_deref().filter(|_| found.state.step > 0);
    let ran = ran.or((found.state.step > 0 && found.state.products.is_none()).then_some("f32"));
    let (mut learner, products) = learner(ran, tensors(WEIGHTS)?, progress)?;
    learner.restore(tensors(OPTIMIZER)?, found.state.step)?;
    if averages {
        learner.restore_averages(tensors(AVERAGED)?)?;
    }
    let mut state = found.state;
    state.files.clear();
    state.products = products;
    if state.step > 0 {
        progress.note(&format!("going on after step {}", state.step));
    }
    Ok((learner, state))
}
