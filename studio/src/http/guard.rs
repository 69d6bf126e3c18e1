//! The refusal of requests, and the headers and fault texts of every answer.

use super::App;
use super::answer::{Answer, Fault, text_of};
use crate::Error;
use crate::security::headers::secure;
use axum::body::Body;
use axum::extract::rejection::QueryRejection;
use axum::extract::{Query, Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::json;
use std::sync::Arc;

/// A page that opens the page: a browser sends a `SameSite=Strict` cookie only with requests of our own page, and not
/// with those that follow a file's link.
const BOUNCE: &str = "<!doctype html><meta charset=\"utf-8\"><title>kinelm studio</title>\
                      <link rel=\"icon\" href=\"/assets/icon.svg\">\
                      <meta http-equiv=\"refresh\" content=\"0; url=/?in\">\n";

/// Lets a request through, or not, and completes its answer.
pub async fn guard(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let (method, headers) = (request.method().clone(), request.headers());
    let path = request.uri().path().to_owned();
    let is_page = path == "/";
    let is_bounced = request.uri().query() == Some("in");
    let mut response = match refusal(&app, &method, headers, &path) {
        // once: a browser without our cookie would bounce for ever
        Some(_) if is_page && method == Method::GET && !is_bounced && is_known_host(&app, headers) => {
            text_of(BOUNCE, "text/html; charset=utf-8")
        }
        Some(why) => super::answer::Failure(Error::Refused(why.into())).into_response(),
        None => next.run(request).await,
    };
    if response.status().is_client_error() || response.status().is_server_error() {
        write_fault(&app, &mut response, is_page);
    }
    secure(response.headers_mut());
    response
}

fn is_known_host(app: &App, headers: &HeaderMap) -> bool {
    let mut hosts = headers.get_all(header::HOST).iter();
    let host = hosts.next().and_then(|host| host.to_str().ok());
    hosts.next().is_none() && host.is_some_and(|host| app.hosts.has(host))
}

/// Why a request is refused, if it is.
fn refusal(app: &App, method: &Method, headers: &HeaderMap, path: &str) -> Option<&'static str> {
    if path == "/enter" {
        // its token is what counts; the browser comes from a file
        return (!is_known_host(app, headers)).then_some("the Host header names another server");
    }
    if let Some(why) = app.hosts.refusal(method, headers, path == "/") {
        return Some(why);
    }
    // other servers of this host may have set cookies of any bytes
    let mut cookies = headers.get_all(header::COOKIE).iter().map(|cookie| String::from_utf8_lossy(cookie.as_bytes()));
    let is_known = cookies.any(|cookie| app.entry.knows(&cookie));
    (!is_known).then_some("this browser wasn't let in; open the file again that kinelm named when it began")
}

/// Writes the fault without folders: as text for the page, which a person reads, else as JSON.
fn write_fault(app: &App, response: &mut Response, is_page: bool) {
    let fault = response.extensions_mut().remove::<Fault>().unwrap_or_else(|| {
        let text = response.status().canonical_reason().unwrap_or("refused").to_lowercase();
        Fault { kind: "call", text }
    });
    let text = app.studio.plain(&fault.text);
    let (text, kind) = match is_page {
        true => (format!("kinelm studio: {text}\n"), "text/plain; charset=utf-8"),
        false => (json!({ "error": { "kind": fault.kind, "text": text } }).to_string(), "application/json"),
    };
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
    // of the body that is replaced
    response.headers_mut().remove(header::CONTENT_LENGTH);
    *response.body_mut() = Body::from(text);
}

/// The token of the redirect file.
#[derive(Debug, Default, Deserialize)]
pub struct Token {
    #[serde(default)]
    token: String,
}

/// Exchanges the token for a cookie.
pub async fn enter(State(app): State<Arc<App>>, token: Result<Query<Token>, QueryRejection>) -> Answer {
    let token = token.map(|Query(token)| token.token).unwrap_or_default();
    let cookie = app.entry.enter(&token)?;
    let mut response = StatusCode::SEE_OTHER.into_response();
    let cookie = HeaderValue::from_str(&cookie).map_err(|e| Error::invalid("the cookie", e, "a header"))?;
    response.headers_mut().insert(header::SET_COOKIE, cookie);
    response.headers_mut().insert(header::LOCATION, HeaderValue::from_static("/"));
    Ok(response)
}
