//! The routes of jobs and dances.

use super::App;
use super::answer::{Answer, blocking, body, done, file, json};
use crate::Error;
use crate::make::request::Make;
use axum::body::Body;
use axum::extract::{Path, Query, State};
use serde::Deserialize;
use serde_json::json as value;
use std::sync::Arc;

/// Puts a request into the queue.
pub async fn make(State(app): State<Arc<App>>, request: Body) -> Answer {
    let make: Make = body(request).await?;
    let job = blocking(move || app.studio.make(make)).await?;
    Ok(json(&value!({ "job": job })))
}

/// Stops a job.
pub async fn cancel(State(app): State<Arc<App>>, Path(id): Path<String>) -> Answer {
    blocking(move || app.studio.cancel(&id)).await?;
    done()
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keep {
    #[serde(default)]
    name: Option<String>,
}

/// Keeps a dance.
pub async fn keep(State(app): State<Arc<App>>, Path(id): Path<String>, request: Body) -> Answer {
    let Keep { name } = body(request).await?;
    Ok(json(&blocking(move || app.studio.keep(&id, name.as_deref())).await?))
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Reject {
    #[serde(default)]
    back: bool,
}

/// Turns a dance down.
pub async fn reject(State(app): State<Arc<App>>, Path(id): Path<String>, request: Body) -> Answer {
    let Reject { back } = body(request).await?;
    blocking(move || app.studio.reject(&id, back)).await?;
    done()
}

/// The options of an export.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Export {
    format: String,
    /// The program that imports it.
    #[serde(default, rename = "for")]
    importer: Option<String>,
}

/// A dance as a file.
pub async fn export(
    State(app): State<Arc<App>>,
    Path(id): Path<String>,
    export: std::result::Result<Query<Export>, axum::extract::rejection::QueryRejection>,
) -> Answer {
    let help = "?format=bvh, glb, vrma, npz or json; &for=blender for what Blender imports with its defaults";
    let Query(Export { format, importer }) = export.map_err(|_| Error::missing("format", help))?;
    let (name, bytes) = blocking(move || app.studio.export(&id, &format, importer.as_deref())).await?;
    Ok(file(&name, bytes))
}
