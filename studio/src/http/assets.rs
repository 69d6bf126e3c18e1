//! The page's own files: compiled in, or read from a folder by those who write them.

use super::App;
use super::answer::{Answer, blocking, text_of};
use crate::{Error, Result};
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use kinelm_store::{files, hash};
use std::borrow::Cow;
use std::sync::Arc;

include!(concat!(env!("OUT_DIR"), "/web.rs"));

/// The page.
const INDEX: &str = "index.html";

/// The page.
pub async fn page(State(app): State<Arc<App>>, headers: HeaderMap) -> Answer {
    served(app, INDEX.into(), headers).await
}

/// A file of the page.
pub async fn asset(State(app): State<Arc<App>>, Path(name): Path<String>, headers: HeaderMap) -> Answer {
    served(app, name, headers).await
}

async fn served(app: Arc<App>, name: String, headers: HeaderMap) -> Answer {
    let (bytes, name) = blocking(move || Ok((find(&app, &name)?, name))).await?;
    let tag = format!("\"{}\"", &hash::of(&bytes)[..16]);
    let is_known = headers.get(header::IF_NONE_MATCH).is_some_and(|known| known.as_bytes() == tag.as_bytes());
    let mut response = match is_known {
        true => StatusCode::NOT_MODIFIED.into_response(),
        false => text_of(bytes.into_owned(), kind(&name)),
    };
    stamp(&mut response, &tag);
    Ok(response)
}

/// A browser may store it, if it checks the tag each time.
fn stamp(response: &mut Response, tag: &str) {
    response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    if let Ok(tag) = HeaderValue::from_str(tag) {
        response.headers_mut().insert(header::ETAG, tag);
    }
}

fn find(app: &App, name: &str) -> Result<Cow<'static, [u8]>> {
    let unknown = || Error::unknown("file", name);
    // axum decodes the name, so `..%2F..` arrives as `../..`
    if !files::is_plain(name) {
        return Err(unknown());
    }
    if let Some(folder) = &app.assets {
        // files that the folder lacks come from the program
        if let Ok(bytes) = std::fs::read(folder.join(name)) {
            return Ok(bytes.into());
        }
    }
    // the player's modules are the page's too
    let player = kinelm_view::MODULES.iter().map(|(own, text)| (*own, text.as_bytes()));
    let mut all = WEB.iter().copied().chain(player);
    all.find(|(own, _)| *own == name).map(|(_, bytes)| Cow::Borrowed(bytes)).ok_or_else(unknown)
}

fn kind(name: &str) -> &'static str {
    match name.rsplit('.').next() {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("svg") => "image/svg+xml",
        Some("png") => "image/png",
        Some("json") => "application/json",
        Some("woff2") => "font/woff2",
        _ => "text/plain; charset=utf-8",
    }
}
