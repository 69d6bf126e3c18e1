//! The stream of events to one page.

use super::App;
use super::answer::{Answer, text_of};
use crate::Error;
use crate::events::{Hub, framed};
use axum::body::{Body, Bytes};
use axum::extract::{Query, State};
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;
use futures_util::stream::unfold;
use kinelm_store::Subject;
use serde::Deserialize;
use serde_json::json;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;

/// Time between comments, by which both ends notice that the other is gone.
const ALIVE: Duration = Duration::from_secs(15);

/// A page that listens.
struct Page {
    hub: Arc<Hub>,
    changed: watch::Receiver<u64>,
    stop: watch::Receiver<bool>,
    /// The last event that it has.
    at: u64,
    /// The first event for it.
    first: Option<String>,
}

impl Page {
    /// Waits for something to send; `None` where the server ends.
    async fn next(&mut self) -> Option<String> {
        if let Some(first) = self.first.take() {
            return Some(first);
        }
        loop {
            if *self.stop.borrow() {
                return None;
            }
            // marked as seen before the events are read, so that none is missed in between
            self.changed.borrow_and_update();
            match self.hub.since(self.at) {
                Some((events, last)) if !events.is_empty() => {
                    self.at = last;
                    return Some(events.concat());
                }
                Some(_) => {}
                None => {
                    self.at = self.hub.last();
                    return Some(hello(self.at, false));
                }
            }
            let (changed, stop) = (self.changed.changed(), self.stop.changed());
            let waited = tokio::time::timeout(ALIVE, futures_util::future::select(Box::pin(changed), Box::pin(stop)));
            if waited.await.is_err() {
                return Some(": alive\n\n".into());
            }
        }
    }
}

/// The first event: whether those that the page missed follow, or it has to load the state again.
fn hello(at: u64, resumed: bool) -> String {
    let data = json!({ "version": env!("CARGO_PKG_VERSION"), "resumed": resumed });
    framed(at, "hello", &data.to_string())
}

/// The events from the last one that a page has.
pub async fn stream(State(app): State<Arc<App>>, headers: HeaderMap) -> Answer {
    let hub = app.studio.hub().clone();
    let known = headers.get("last-event-id").and_then(|id| id.to_str().ok()?.parse::<u64>().ok());
    // an id of an earlier server, or one that the ring has lost: the page loads the state again
    let known = known.filter(|id| hub.since(*id).is_some());
    let at = known.unwrap_or_else(|| hub.last());
    // a browser waits 1 s before it connects again, not its own few seconds
    let first = Some(format!("retry: 1000\n\n{}", hello(at, known.is_some())));
    let page = Page { changed: hub.watch(), hub, stop: app.stop.subscribe(), at, first };
    let chunks = unfold(page, |mut page| async {
        let text = page.next().await?;
        Some((Ok::<_, Infallible>(Bytes::from(text)), page))
    });
    let mut response = Response::new(Body::from_stream(chunks));
    let kind = HeaderValue::from_static("text/event-stream");
    response.headers_mut().insert(header::CONTENT_TYPE, kind);
    Ok(response)
}

/// The event after which a page catches up.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Since {
    /// An event: those after it, as far as they are still there.
    since: u64,
}

/// Frames that were sampled before a page came: the events with them, and no more.
pub async fn frames(
    State(app): State<Arc<App>>,
    since: Result<Query<Since>, axum::extract::rejection::QueryRejection>,
) -> Answer {
    let Query(Since { since }) = since
        .map_err(|e| Error::invalid(Subject::about("the `query`", "query"), e.body_text(), "since as a number"))?;
    let hub = app.studio.hub();
    let (events, last) = hub.since(hub.kept_since(since)).unwrap_or_default();
    let frames: Vec<String> = events.iter().filter_map(|event| as_json("frames", event)).collect();
    Ok(text_of(format!("{{\"last\":{last},\"events\":[{}]}}", frames.join(",")), "application/json"))
}

/// An event of a name as JSON.
fn as_json(name: &str, event: &str) -> Option<String> {
    let field = |name: &str| event.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(": "));
    (field("event") == Some(name)).then_some(())?;
    Some(format!("{{\"id\":{},\"data\":{}}}", field("id")?, field("data")?))
}
