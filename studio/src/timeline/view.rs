//! The view of a timeline for a page.

use super::edit::{frames_of, is_same, rate};
use super::file::TimelineFile;
use super::{Laid, Timelines, raw};
use crate::Error;
use crate::library::Source;
use kinelm_generate::request::Segment;
use kinelm_generate::timeline::{GivenSpan, NO_SEGMENT};
use kinelm_motion::joints::{self, PARTS};
use kinelm_motion::moment::Moment;
use serde_json::{Map, Value, json};
use std::path::Path;

/// The view of a timeline: its layout if it can be laid out, else its fault, unless that is only a clip that is being
/// read. `parsed`: it is laid out already.
pub(super) fn of(
    timelines: &Timelines,
    text: Option<&str>,
    parsed: Option<Laid>,
    sources: &[Source],
    being_read: &[String],
) -> Value {
    let path = timelines.path();
    let mut view = json!({
        "text": text.unwrap_or_default(), "seconds": 0, "fps": null, "rig": null, "transition": 1, "clips": {},
        "segments": [], "rows": [], "trouble": [], "notes": [],
    });
    let Some(text) = text else { return view };
    let file = match TimelineFile::parse(&path, text) {
        Ok(file) => file,
        Err(e) => {
            view["trouble"] = json!([trouble(&e)]);
            return view;
        }
    };
    view["rig"] = file.top("rig");
    view["clips"] = clips(&file, sources, path.parent().unwrap_or(Path::new("")));
    if file.is_empty() {
        // without segments it is only begun; all else that is wrong with it is said
        let wrong = if file.says_nothing() { None } else { timelines.lay_out(text).err() };
        let wrong = wrong.map(|e| trouble(&e)).filter(|wrong| !wrong["text"].as_str().is_some_and(is_only_begun));
        view["trouble"] = json!(wrong.as_slice());
        return view;
    }
    match parsed.map_or_else(|| timelines.lay_out(text), Ok) {
        Ok(parsed) => {
            let layout = &parsed.layout;
            view["fps"] = json!(layout.fps);
            view["seconds"] = json!(layout.frames as f64 / layout.fps);
            view["transition"] = json!(parsed.timeline.transition.0.seconds(layout.fps));
            let segments = parsed.timeline.segments.iter().enumerate();
            view["segments"] = segments.map(|(index, segment)| placed(&parsed, sources, index, segment)).collect();
            view["rows"] = PARTS.iter().map(|part| row(&parsed, part)).collect();
            view["notes"] = json!(layout.notes);
        }
        Err(e) => {
            // a clip that is being read is no fault of the text
            if !timelines.waits(&file, being_read) {
                view["trouble"] = json!([trouble(&e)]);
            }
            let segments = raw::segments(&file, sources, path.parent().unwrap_or(Path::new("")));
            let end = |segment: &Value| segment["to"].as_f64().unwrap_or(0.0);
            view["seconds"] = json!(segments.iter().map(end).fold(0.0, f64::max));
            view["segments"] = json!(segments);
        }
    }
    view
}

/// Whether this is the trouble of a timeline that has no segments yet.
fn is_only_begun(text: &str) -> bool {
    text.strip_prefix("found ").is_some_and(|text| text.starts_with(NO_SEGMENT))
}

/// A fault with its place.
fn trouble(e: &Error) -> Value {
    let file = match e {
        Error::Library(kinelm_model::Error::Store(kinelm_store::Error::File(fault))) => Some(fault),
        _ => None,
    };
    match file {
        Some(fault) => {
            let text = format!("found {}, expected {}", fault.found, fault.expected);
            json!({ "line": fault.at.line, "column": fault.at.column, "text": text })
        }
        None => json!({ "line": 0, "column": 0, "text": e.to_string() }),
    }
}

/// The clips by name, each with the id that it has in the library.
fn clips(file: &TimelineFile, sources: &[Source], folder: &Path) -> Value {
    let of = |(name, file): (String, std::path::PathBuf)| {
        let path = folder.join(&file);
        let found = sources.iter().find(|source| source.path == path || is_same(&source.path, &path));
        let last = file.file_name().map(|name| name.to_string_lossy().into_owned());
        (name, json!({ "clip": found.map(|source| &source.id), "file": last }))
    };
    Value::Object(file.clips().into_iter().map(of).collect::<Map<_, _>>())
}

fn placed(parsed: &Laid, sources: &[Source], index: usize, segment: &Segment) -> Value {
    let layout = &parsed.layout;
    let placed = layout.segments.iter().find(|placed| placed.index == index);
    let frames = frames_of(segment, layout.fps);
    let clip_fps = segment.clip.as_ref().and_then(|name| rate(&parsed.timeline, sources, name));
    let at = match segment.at.0 {
        Moment::Seconds(s) => s,
        moment => moment.seconds(clip_fps.unwrap_or(layout.fps)),
    };
    let seconds = |frame: usize| frame as f64 / layout.fps;
    let mut view = json!({
        "index": index, "clip": segment.clip, "joints": segment.joints, "from": seconds(frames.start),
        "to": seconds(frames.end), "at": at, "labels": segment.labels, "assumed": [],
    });
    if let Some(placed) = placed {
        // the frames that transitions leave of it; it is turned about the vertical first, then moved
        view["given"] = json!([seconds(placed.frames.start), seconds(placed.frames.end)]);
        view["place"] = json!({
            "turn_rad": placed.turn, "x": placed.shift.x, "y": placed.shift.y, "z": placed.shift.z,
        });
    }
    view
}

/// A group of joints and each of its joints.
fn row(parsed: &Laid, part: &str) -> Value {
    let ids = joints::group(part);
    let one = |id: &usize| json!({ "name": joints::list_of(&[*id]), "spans": spans(parsed, &[*id]) });
    json!({ "group": part, "joints": ids.iter().map(one).collect::<Vec<_>>(), "spans": spans(parsed, ids) })
}

fn spans(parsed: &Laid, ids: &[usize]) -> Vec<Value> {
    let fps = parsed.layout.fps;
    let of = |span: GivenSpan| {
        let [from, to] = [span.frames.start, span.frames.end].map(|frame| frame as f64 / fps);
        json!({ "from": from, "to": to, "state": span.state, "segment": span.segment })
    };
    parsed.layout.spans(ids).into_iter().map(of).collect()
}
