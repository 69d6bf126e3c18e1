//! The conditions of a dance beside its own words: goals, the tempo of its music, and the unconditioned reading.

use crate::masked::MOST_PASSES;
use crate::request::{Request, Resolved};
use crate::{Error, Result};
use kinelm_corpus::Conditions;
use kinelm_corpus::music::tempo;
use kinelm_model::{LoadedRun, ModelKind};
use kinelm_store::Subject;

/// Refuses goal guidance that the model can't take.
///
/// # Errors
/// A model that isn't goal-conditioned, a scale that isn't finite.
pub fn check_goal_guidance(scale: f64, run: &LoadedRun) -> Result<()> {
    if !scale.is_finite() {
        return Err(Error::invalid_parameter("goal_guidance", scale, "a finite number"));
    }
    if scale != 0.0 && !run.config.goal {
        let why = "this model isn't goal-conditioned; expected 0, or a model trained with model.goal";
        return Err(Error::unsupported(Subject::of_parameter("goal_guidance").with(scale), why));
    }
    Ok(())
}

/// Refuses passes of a causal model, none, and more than [`MOST_PASSES`].
///
/// # Errors
/// [`kinelm_store::Error::Unsupported`] and [`kinelm_store::Error::Invalid`].
pub fn check_passes(passes: Option<usize>, run: &LoadedRun) -> Result<()> {
    let Some(passes) = passes else { return Ok(()) };
    if run.config.kind != ModelKind::Masked {
        let why = "a causal model reads its tokens once; leave it out, or take a masked model";
        return Err(Error::unsupported(Subject::of_parameter("passes").with(passes), why));
    }
    match (1..=MOST_PASSES).contains(&passes) {
        true => Ok(()),
        false => Err(Error::invalid_parameter("passes", passes, format!("1 to {MOST_PASSES}"))),
    }
}

/// Adds the music's tempo, the nearest that the model knows, to the labels of a dance, unless a label states it.
///
/// # Errors
/// A model that is conditioned on music by its tempo alone, and knows no tempo that is a number.
pub(super) fn add_tempo(
    request: &mut Request,
    nearest: Option<String>,
    run: &LoadedRun,
    conditions: &Conditions,
) -> Result<()> {
    let mut fields = request.labels.keys().chain(request.timed_labels.iter().map(|label| &label.field));
    // what the user states wins over what was detected
    if fields.any(|field| field == tempo::FIELD) {
        return Ok(());
    }
    match nearest {
        Some(tempo) => {
            request.labels.insert(tempo::FIELD.into(), tempo);
        }
        None if run.config.music.is_none() => {
            let known = conditions.values(tempo::FIELD).join(", ");
            let why =
                format!("this model knows of music its tempo alone, and no tempo that is a number ({known}); label it");
            return Err(Error::unsupported_parameter("music", why));
        }
        None => {}
    }
    Ok(())
}

/// The tokens in front of the windows of the unconditioned reading, if the dance is guided.
pub(super) fn unconditioned(request: &Resolved, run: &LoadedRun, conditions: &Conditions) -> Result<Option<Vec<u32>>> {
    let scale = request.guidance;
    // the model as trained, for which one reading is enough
    if scale == 1.0 {
        return Ok(None);
    }
    if !scale.is_finite() {
        return Err(Error::invalid_parameter("guidance", scale, "a finite number"));
    }
    let unsupported = |why: &str| Err(Error::unsupported(Subject::of_parameter("guidance").with(scale), why));
    if request.music.is_none() && conditions.fields().is_empty() && run.config.music.is_none() {
        return unsupported(
            "this model knows no labels, so there is nothing to follow; train one with train.conditions",
        );
    }
    if request.music.is_none() && request.labels.is_empty() && request.timed_labels.is_empty() {
        return unsupported("there are neither labels nor music to follow");
    }
    Ok(Some(conditions.unknown().requested(&[])?))
}
