//! Turns requests into library calls, and their results into answers.
//!
//! - [`answer`]: bodies in, errors out.
//! - [`guard`]: refusals, and what every answer carries.
//! - [`assets`]: the page's own files.
//! - [`events`]: the stream of events.
//! - [`clips`], [`timeline`], [`dances`]: the routes.
//! - [`socket`], [`server`]: connections with their limits.
//!
//! The runtime has one thread, which nothing blocks: slow work runs on others.

pub mod answer;
pub mod assets;
pub mod clips;
pub mod dances;
pub mod events;
pub mod guard;
pub mod server;
pub mod socket;
pub mod timeline;

use crate::security::entry::Entry;
use crate::security::hosts::Hosts;
use crate::studio::Studio;
use answer::{Answer, blocking, json};
use axum::Router;
use axum::extract::State;
use axum::middleware::from_fn_with_state;
use axum::routing::{get, post};
use std::path::PathBuf;
use std::sync::Arc;
use tokio::sync::{Semaphore, watch};
use tower_http::catch_panic::CatchPanicLayer;

/// The state that requests share.
#[derive(Debug)]
pub struct App {
    /// The studio.
    pub studio: Arc<Studio>,
    /// The way in.
    pub entry: Entry,
    /// The names of the server.
    pub hosts: Hosts,
    /// A folder with the page's files, for those who write them; `None`: the program's own.
    pub assets: Option<PathBuf>,
    /// Uploads at a time.
    pub uploads: Semaphore,
    /// Ends the server.
    pub stop: watch::Sender<bool>,
}

/// All routes, inside the guard.
pub fn router(app: Arc<App>) -> Router {
    Router::new()
        .route("/", get(assets::page))
        .route("/enter", get(guard::enter))
        .route("/assets/{name}", get(assets::asset))
        .route("/api/state", get(state))
        .route("/api/events", get(events::stream))
        .route("/api/frames", get(events::frames))
        .route("/api/clips", post(clips::upload))
        .route("/api/maps", post(clips::map))
        .route("/api/clips/{id}/figure", get(clips::figure))
        .route("/api/clips/{id}/character", get(clips::character))
        .route("/api/clips/{id}/derive", post(clips::derive))
        .route("/api/clips/{id}/sound", get(clips::sound))
        .route("/api/clips/{id}/reading", post(clips::reading))
        .route("/api/clips/{id}/remove", post(clips::remove))
        .route("/api/clips/{id}/rename", post(clips::rename))
        .route("/api/search", post(clips::search))
        .route("/api/compare", post(clips::compare))
        .route("/api/compare/{teacher}/{student}", get(clips::comparison))
        .route("/api/music", post(clips::music))
        .route("/api/timeline", get(timeline::view).post(timeline::edit))
        .route("/api/undo", post(timeline::undo))
        .route("/api/redo", post(timeline::redo))
        .route("/api/make", post(dances::make))
        .route("/api/jobs/{id}/cancel", post(dances::cancel))
        .route("/api/dances/{id}/figure", get(clips::figure))
        .route("/api/dances/{id}/keep", post(dances::keep))
        .route("/api/dances/{id}/reject", post(dances::reject))
        .route("/api/dances/{id}/export", get(dances::export))
        .route("/api/stop", post(stop))
        .fallback(answer::nothing)
        // layers run from the last: the guard is outermost, so it completes the answers of panics too
        .layer(CatchPanicLayer::custom(answer::panicked))
        .layer(from_fn_with_state(app.clone(), guard::guard))
        .with_state(app)
}

async fn state(State(app): State<Arc<App>>) -> Answer {
    let studio = app.studio.clone();
    Ok(json(&blocking(move || Ok(studio.state())).await?))
}

async fn stop(State(app): State<Arc<App>>) -> Answer {
    app.stop.send_replace(true);
    Ok(json(&serde_json::json!({ "stopped": true })))
}
