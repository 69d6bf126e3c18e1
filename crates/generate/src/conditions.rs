//! What a recipe tells a model beside the dance's own words: what is given ahead, the tempo of its music, and the reading that
//! is told nothing.

use super::music::Music;
use super::request::Resolved;
use crate::{Error, Result};
use kinelm_corpus::Conditions;
use kinelm_corpus::music::tempo;
use kinelm_model::LoadedRun;

/// Refuses to tell a model ahead that can't be told.
///
/// # Errors
/// [`kinelm_store::Error::Call`]: such a model, a number that isn't finite.
pub fn check_ahead(ahead: f64, run: &LoadedRun) -> Result<()> {
    let wrong = |what: &str| Err(Error::call(format!("ahead {ahead}: {what}")));
    if !ahead.is_finite() {
        return wrong("expected a finite number");
    }
    if ahead != 0.0 && !run.config.goal {
        return wrong("this model can't be told what is given ahead; expected 0, or a model trained with model.goal");
    }
    Ok(())
}

/// Tells a model that knows tempi that of a dance of so many seconds to its music, unless a label does.
///
/// # Errors
/// A model that is told of music by its tempo alone, and knows none that is a number.
pub(super) fn tell_tempo(
    recipe: &mut Resolved,
    music: &Music,
    (run, conditions): (&LoadedRun, &Conditions),
    seconds: f64,
) -> Result<()> {
    let mut asked = recipe.labels.keys().chain(recipe.timed_labels.iter().map(|label| &label.field));
    if asked.any(|field| field == tempo::FIELD) {
        return Ok(());
    }
    match music.tempo(conditions, seconds) {
        Some(tempo) => {
            recipe.labels.insert(tempo::FIELD.into(), tempo);
        }
        None if run.config.music.is_none() => {
            let known = conditions.values(tempo::FIELD).join(", ");
            let what = "this model hears of music its tempo alone, and none that it knows is a number";
            return Err(Error::call(format!("--music: {what} ({known}); give --label tempo=..")));
        }
        None => {}
    }
    Ok(())
}

/// The tokens in front of the windows of the reading without conditions, if there is to be one.
pub(super) fn without(recipe: &Resolved, run: &LoadedRun, conditions: &Conditions) -> Result<Option<Vec<u32>>> {
    let scale = recipe.guidance;
    if scale == 1.0 {
        return Ok(None);
    }
    let wrong = |what: &str| Err(Error::call(format!("guidance {scale}: {what}")));
    if !scale.is_finite() {
        return wrong("expected a finite number");
    }
    if recipe.music.is_none() && conditions.fields().is_empty() && run.config.music.is_none() {
        return wrong("this model knows no labels, so there is nothing to follow; train one with train.conditions");
    }
    if recipe.music.is_none() && recipe.labels.is_empty() && recipe.timed_labels.is_empty() {
        return wrong(
            "no label is given that could be followed, nor music; give some with --label FIELD=VALUE or --music",
        );
    }
    Ok(Some(conditions.unknown().asked(&[])?))
}
