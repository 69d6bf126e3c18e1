//! The routes of the timeline, and steps back and on.

use super::App;
use super::answer::{Answer, blocking, body, json};
use crate::Error;
use crate::timeline::edit::Edit;
use axum::body::Body;
use axum::extract::State;
use serde::Deserialize;
use std::sync::Arc;

/// The most edits of a step.
const MOST_EDITS: usize = 200;

/// The timeline.
pub async fn view(State(app): State<Arc<App>>) -> Answer {
    Ok(json(&blocking(move || app.studio.timeline()).await?))
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Edits {
    edits: Vec<Edit>,
}

/// Edits it; answers as [`view`].
pub async fn edit(State(app): State<Arc<App>>, request: Body) -> Answer {
    let Edits { edits } = body(request).await?;
    if edits.len() > MOST_EDITS {
        return Err(Error::limit("the step", edits.len(), format!("{MOST_EDITS} edits"), "").into());
    }
    Ok(json(&blocking(move || app.studio.edit(&edits)).await?))
}

/// Undoes the last step.
pub async fn undo(State(app): State<Arc<App>>) -> Answer {
    Ok(json(&blocking(move || app.studio.undo()).await?))
}

/// Carries out again the step that was undone last.
pub async fn redo(State(app): State<Arc<App>>) -> Answer {
    Ok(json(&blocking(move || app.studio.redo()).await?))
}
