//! The routes of the library.

use super::App;
use super::answer::{Answer, blocking, body, done, file, json, text_of};
use crate::library::compare::Pair;
use crate::library::derive::Change;
use crate::library::figure::Part;
use crate::library::maps;
use crate::library::search::Looked;
use crate::library::upload::{MOST_BYTES, Upload};
use crate::project::document::{Music, Reading};
use crate::{Error, Result};
use axum::body::{Body, Bytes, to_bytes};
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use futures_util::stream::unfold;
use kinelm_store::Subject;
use serde::Deserialize;
use serde_json::json as value;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::sync::Arc;
use std::time::Duration;

/// The longest time without a byte of an upload.
const PIECE_TIME: Duration = Duration::from_secs(30);
/// Bytes that are read of a sound at a time.
const PIECE: usize = 256 << 10;

/// The name of an upload.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Named {
    name: String,
}

/// Takes a file in.
pub async fn upload(
    State(app): State<Arc<App>>,
    name: std::result::Result<Query<Named>, axum::extract::rejection::QueryRejection>,
    headers: HeaderMap,
    body: Body,
) -> Answer {
    let Query(Named { name }) = name.map_err(|_| Error::missing("name of the file", "the page sends ?name=NAME"))?;
    let length = headers.get(header::CONTENT_LENGTH).and_then(|length| length.to_str().ok()?.parse::<u64>().ok());
    if let Some(length) = length.filter(|length| *length > MOST_BYTES) {
        let (needs, limit) = (format!("{} MB", length >> 20), format!("{} MB", MOST_BYTES >> 20));
        return Err(Error::limit("the file", needs, limit, "cut it into shorter ones").into());
    }
    // after the length was checked: a file that is refused doesn't wait
    let _turn = app.uploads.acquire().await.map_err(|_| Error::Conflict("the studio ends".into()))?;
    let studio = app.studio.clone();
    let mut upload = blocking(move || Upload::begin(studio.project(), &name)).await?;
    let mut pieces = body.into_data_stream();
    loop {
        let slow = |_| Error::Slow("no byte came for half a minute; upload it again".into());
        let Some(piece) = tokio::time::timeout(PIECE_TIME, pieces.next()).await.map_err(slow)? else { break };
        let piece = piece.map_err(|e| Error::Slow(format!("the upload broke off: {e}")))?;
        // one piece in memory at a time, however fast the browser is
        upload = blocking(move || upload.write(&piece).map(|()| upload)).await?;
    }
    let studio = app.studio.clone();
    let id = blocking(move || studio.uploaded(upload)).await?;
    Ok(json(&value!({ "id": id })))
}

/// Takes a skeleton map in.
pub async fn map(
    State(app): State<Arc<App>>,
    name: std::result::Result<Query<Named>, axum::extract::rejection::QueryRejection>,
    request: Body,
) -> Answer {
    let Query(Named { name }) = name.map_err(|_| Error::missing("name of the file", "the page sends ?name=NAME"))?;
    let slow = |_| Error::Slow("the map took too long; drop it in again".into());
    // one more than allowed, and the library says how large a map may be
    let whole = tokio::time::timeout(PIECE_TIME, to_bytes(request, maps::MOST_BYTES + 1)).await.map_err(slow)?;
    let limit = || format!("{} KB", maps::MOST_BYTES >> 10);
    let bytes = whole.map_err(|_| Error::limit("the map", format!("more than {}", limit()), limit(), ""))?;
    let name = blocking(move || app.studio.add_map(&name, &bytes)).await?;
    Ok(json(&value!({ "map": name })))
}

/// The figure of a clip or a dance.
pub async fn figure(
    State(app): State<Arc<App>>,
    Path(id): Path<String>,
    part: std::result::Result<Query<Part>, axum::extract::rejection::QueryRejection>,
) -> Answer {
    let Query(part) = part.map_err(|e| {
        Error::invalid(Subject::about("the `query`", "query"), e.body_text(), "fps and seconds as numbers")
    })?;
    let studio = app.studio.clone();
    let text = blocking(move || studio.library().figure(&id, part)).await?;
    Ok(text_of(text.to_string(), "application/json"))
}

/// A clip or a dance in the file of its character, and the matrix from that file's world to the stage's.
pub async fn character(State(app): State<Arc<App>>, Path(id): Path<String>) -> Answer {
    let made = blocking(move || app.studio.library().on_character(&id, "on the stage.glb")).await?;
    let mut response = Response::new(Body::from(made.bytes));
    set(&mut response, header::CONTENT_TYPE, "model/gltf-binary");
    let numbers: Vec<String> = made.to_stage.iter().map(f64::to_string).collect();
    set(&mut response, header::HeaderName::from_static("kinelm-to-stage"), &numbers.join(" "));
    Ok(response)
}

/// Makes a clip of another: mirrored, or at another speed.
pub async fn derive(State(app): State<Arc<App>>, Path(id): Path<String>, request: Body) -> Answer {
    let change: Change = body(request).await?;
    let id = blocking(move || app.studio.derive(&id, change)).await?;
    Ok(json(&value!({ "id": id })))
}

/// Changes the reading of a clip.
pub async fn reading(State(app): State<Arc<App>>, Path(id): Path<String>, request: Body) -> Answer {
    let reading: Reading = body(request).await?;
    blocking(move || app.studio.restate(&id, &reading)).await?;
    done()
}

/// Takes a clip out.
pub async fn remove(State(app): State<Arc<App>>, Path(id): Path<String>) -> Answer {
    blocking(move || app.studio.remove(&id)).await?;
    done()
}

/// Gives a clip or a dance another name.
pub async fn rename(State(app): State<Arc<App>>, Path(id): Path<String>, request: Body) -> Answer {
    let Named { name } = body(request).await?;
    blocking(move || app.studio.rename(&id, &name)).await?;
    done()
}

/// Clips that move alike.
pub async fn search(State(app): State<Arc<App>>, request: Body) -> Answer {
    let looked: Looked = body(request).await?;
    let matches = blocking(move || app.studio.library().search(&looked)).await?;
    Ok(json(&value!({ "matches": matches })))
}

/// A student compared with a teacher: the figures as one reads them, and the worst moments of the teacher's clip.
pub async fn compare(State(app): State<Arc<App>>, request: Body) -> Answer {
    let pair: Pair = body(request).await?;
    let (compared, _) = blocking(move || pair.compare(app.studio.library())).await?;
    let moments = compared.report.moments.iter().map(|moment| {
        let (joint, cm) = (moment.joint.joint.replace('_', " "), moment.distance_cm);
        value!({ "at_s": moment.at_s[0], "says": format!("{cm:.0} cm, {joint}") })
    });
    Ok(json(&value!({ "facts": compared.report.facts(), "moments": moments.collect::<Vec<_>>() })))
}

/// The same as a page, to be saved.
pub async fn comparison(State(app): State<Arc<App>>, Path((teacher, student)): Path<(String, String)>) -> Answer {
    let page = blocking(move || {
        let (compared, [first, second]) = Pair { teacher, student }.compare(app.studio.library())?;
        Ok((format!("{second} beside {first}.html"), compared.page([&first, &second])?))
    });
    let (name, page) = page.await?;
    Ok(file(&name, page))
}

/// The music of the stage.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MusicOf {
    clip: Option<String>,
    #[serde(default)]
    from_s: f64,
}

/// Sets the music of the stage.
pub async fn music(State(app): State<Arc<App>>, request: Body) -> Answer {
    let MusicOf { clip, from_s } = body(request).await?;
    let music = clip.map(|clip| Music { clip, from_s });
    blocking(move || app.studio.set_music(music)).await?;
    done()
}

/// A sound file, or a part of it.
pub async fn sound(State(app): State<Arc<App>>, Path(id): Path<String>, headers: HeaderMap) -> Answer {
    let studio = app.studio.clone();
    let (file, bytes, kind) = blocking(move || {
        let path = studio.library().sound(&id)?;
        let file = kinelm_store::input::peek(&path).map_err(Error::io(&path))?;
        let bytes = file.metadata().map_err(Error::io(&path))?.len();
        Ok((file, bytes, kinelm_view::music::media_type(&path)))
    })
    .await?;
    let requested = headers.get(header::RANGE).and_then(|range| range.to_str().ok());
    let range = match requested.map(|range| range_of(range, bytes)) {
        None | Some(Some(Range::All)) => None,
        Some(Some(Range::Part(from, to))) => Some((from, to)),
        Some(None) => {
            let mut response = StatusCode::RANGE_NOT_SATISFIABLE.into_response();
            set(&mut response, header::CONTENT_RANGE, &format!("bytes */{bytes}"));
            return Ok(response);
        }
    };
    let (from, to) = range.unwrap_or((0, bytes));
    let mut response = Response::new(Body::from_stream(pieces(file, from, to - from)));
    if range.is_some() {
        *response.status_mut() = StatusCode::PARTIAL_CONTENT;
        set(&mut response, header::CONTENT_RANGE, &format!("bytes {from}-{}/{bytes}", to - 1));
    }
    set(&mut response, header::CONTENT_LENGTH, &(to - from).to_string());
    set(&mut response, header::CONTENT_TYPE, kind);
    set(&mut response, header::ACCEPT_RANGES, "bytes");
    Ok(response)
}

fn set(response: &mut Response, name: header::HeaderName, text: &str) {
    if let Ok(text) = HeaderValue::from_str(text) {
        response.headers_mut().insert(name, text);
    }
}

/// The bytes that a `Range` header requests.
#[derive(Debug, PartialEq)]
enum Range {
    All,
    /// From a byte to another, exclusive.
    Part(u64, u64),
}

/// A header's range of a file; `None`: none of its bytes. Several ranges, or a header that can't be parsed, are all of
/// it.
fn range_of(header: &str, bytes: u64) -> Option<Range> {
    let Some((from, to)) = header.strip_prefix("bytes=").and_then(|range| range.split_once('-')) else {
        return Some(Range::All);
    };
    let (from, to) = match (from.parse::<u64>(), to.parse::<u64>()) {
        // the header's end is inclusive (RFC 9110, 14.1.2)
        (Ok(from), Ok(to)) if from <= to => (from, to.saturating_add(1).min(bytes)),
        (Ok(from), Err(_)) if to.is_empty() => (from, bytes),
        // `-500`: the last 500 bytes
        (Err(_), Ok(last)) if from.is_empty() => (bytes.saturating_sub(last), bytes),
        _ => return Some(Range::All),
    };
    (from < to).then_some(Range::Part(from, to))
}

/// The bytes of a file, piece by piece.
fn pieces(file: File, from: u64, length: u64) -> impl futures_util::Stream<Item = Result<Bytes>> {
    unfold((Some(file), from, length), |(file, from, left)| async move {
        let mut file = file.filter(|_| left > 0)?;
        let read = blocking(move || {
            let mut piece = vec![0; (left as usize).min(PIECE)];
            let read = file.seek(SeekFrom::Start(from)).and_then(|_| file.read(&mut piece));
            let read = read.map_err(Error::io("the sound"))?;
            piece.truncate(read);
            Ok((file, Bytes::from(piece)))
        });
        match read.await {
            // the file got shorter meanwhile
            Ok((_, piece)) if piece.is_empty() => None,
            Ok((file, piece)) => {
                let read = piece.len() as u64;
                Some((Ok(piece), (Some(file), from + read, left - read)))
            }
            Err(e) => Some((Err(e), (None, 0, 0))),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges() {
        for (header, expected) in [
            ("bytes=0-", Some(Range::Part(0, 100))),
            ("bytes=10-19", Some(Range::Part(10, 20))),
            ("bytes=90-1000", Some(Range::Part(90, 100))),
            ("bytes=0-18446744073709551615", Some(Range::Part(0, 100))),
            ("bytes=-10", Some(Range::Part(90, 100))),
            ("bytes=-1000", Some(Range::Part(0, 100))),
            ("bytes=100-", None),
            ("bytes=-0", None),
            ("bytes=5-2", Some(Range::All)),
            ("bytes=0-1,5-6", Some(Range::All)),
            ("lines=1-2", Some(Range::All)),
            ("bytes=a-b", Some(Range::All)),
        ] {
            assert_eq!(range_of(header, 100), expected, "{header}");
        }
    }
}
