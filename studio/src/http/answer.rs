//! Bodies in, answers and errors out.

use crate::error::kind_name;
use crate::{Error, Result};
use axum::body::{Body, to_bytes};
use axum::http::{HeaderValue, Response as HttpResponse, StatusCode, header};
use axum::response::{IntoResponse, Response};
use kinelm_store::Subject;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::any::Any;
use std::time::Duration;

/// Bytes of a request's JSON.
const MOST_JSON: usize = 1 << 20;
/// Time for a request's JSON.
const JSON_TIME: Duration = Duration::from_secs(15);

/// The result of a route.
pub type Answer = std::result::Result<Response, Failure>;

/// An error on its way out. [`super::guard`] writes its text, which names no folders.
#[derive(Debug)]
pub struct Failure(pub Error);

impl<E: Into<Error>> From<E> for Failure {
    fn from(e: E) -> Failure {
        Failure(e.into())
    }
}

/// An error that an answer carries until its text is written.
#[derive(Debug, Clone)]
pub struct Fault {
    /// The name of its kind.
    pub kind: &'static str,
    /// Its text.
    pub text: String,
}

impl IntoResponse for Failure {
    fn into_response(self) -> Response {
        let fault = Fault { kind: kind_name(self.0.kind()), text: self.0.to_string() };
        let mut response = Response::new(Body::empty());
        *response.status_mut() = StatusCode::from_u16(self.0.status()).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        // not written here: only the guard knows the project, whose folders the text must not name
        response.extensions_mut().insert(fault);
        response
    }
}

/// An answer in JSON.
pub fn json(value: &impl Serialize) -> Response {
    let text = serde_json::to_string(value).unwrap_or_else(|_| "null".into());
    text_of(text, "application/json")
}

/// A text of a kind.
pub fn text_of(text: impl Into<Body>, kind: &'static str) -> Response {
    ([(header::CONTENT_TYPE, kind)], text.into()).into_response()
}

/// Bytes to be saved as a file of this name.
pub fn file(name: &str, bytes: impl Into<Body>) -> Response {
    let mut response = text_of(bytes, "application/octet-stream");
    // RFC 8187: any letter as bytes of UTF-8
    let coded: String = name
        .bytes()
        .map(|b| {
            if b.is_ascii_alphanumeric() || b"-_.".contains(&b) {
                char::from(b).to_string()
            } else {
                format!("%{b:02X}")
            }
        })
        .collect();
    if let Ok(saved) = HeaderValue::from_str(&format!("attachment; filename*=UTF-8''{coded}")) {
        response.headers_mut().insert(header::CONTENT_DISPOSITION, saved);
    }
    response
}

/// Nothing more to say.
pub fn done() -> Answer {
    Ok(json(&serde_json::json!({})))
}

/// A route that isn't there.
pub async fn nothing() -> Answer {
    Err(Error::Unknown("there is nothing at this address".into()).into())
}

/// A fault of ours is an answer too.
pub fn panicked(payload: Box<dyn Any + Send>) -> HttpResponse<Body> {
    Failure(Error::of_panic(&*payload)).into_response()
}

/// The JSON of a request; an empty body is `{}`.
///
/// # Errors
/// A body that is too large, too slow, or no such JSON.
pub async fn body<T: DeserializeOwned>(body: Body) -> Result<T> {
    let slow = |_| Error::Slow("the request took too long; send it again".into());
    let bytes = tokio::time::timeout(JSON_TIME, to_bytes(body, MOST_JSON)).await.map_err(slow)?;
    let bytes = bytes.map_err(|_| {
        Error::limit("the request", format!("more than {MOST_JSON} bytes"), format!("{MOST_JSON} bytes"), "")
    })?;
    let bytes = if bytes.is_empty() { &b"{}"[..] } else { &bytes };
    serde_json::from_slice(bytes)
        .map_err(|e| Error::invalid(Subject::about("the request's `body`", "body"), e, "JSON as the page sends it"))
}

/// Runs slow work off the runtime's thread.
///
/// # Errors
/// Those of the work; a panic.
pub async fn blocking<T: Send + 'static>(work: impl FnOnce() -> Result<T> + Send + 'static) -> Result<T> {
    match tokio::task::spawn_blocking(work).await {
        Ok(done) => done,
        Err(e) if e.is_panic() => Err(Error::of_panic(&*e.into_panic())),
        Err(_) => Err(kinelm_store::Error::stopped("the studio ends").into()),
    }
}
