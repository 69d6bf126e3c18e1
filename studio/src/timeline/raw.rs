//! Segments of a text that can't be laid out, as a page draws them: whole, with assumed values where the text has none.

use super::edit::is_same;
use super::file::TimelineFile;
use crate::library::Source;
use kinelm_motion::moment::Moment;
use serde_json::{Map, Value, json};
use std::path::Path;

/// The longest time that is drawn, seconds.
const LONGEST_S: f64 = 3600.0;
/// The drawn length of a segment without an end, seconds.
const SHORT_S: f64 = 1.0;
/// The rate of a dance whose rig has none, frames per second.
const USUAL_FPS: f64 = 30.0;

/// The segments, in the order of the text. Each has `index`, `clip`, `joints`, `labels`, `from`, `to` and `at` as a laid
/// out one has them, and names in `assumed` those that the text doesn't say.
pub(super) fn segments(file: &TimelineFile, sources: &[Source], folder: &Path) -> Vec<Value> {
    let clips = file.clips();
    let fps_of = |name: &str| {
        let (_, path) = clips.iter().find(|(own, _)| own == name)?;
        let path = folder.join(path);
        sources.iter().find(|source| source.path == path || is_same(&source.path, &path)).map(|source| source.fps)
    };
    let fps = file.top("rig").as_str().and_then(fps_of).unwrap_or(USUAL_FPS);
    let of = |index: usize| {
        let keys = file.segment(index);
        let clip_fps = keys["clip"].as_str().and_then(fps_of).unwrap_or(fps);
        segment(index, &keys, fps, clip_fps)
    };
    (0..file.segments()).map(of).collect()
}

fn segment(index: usize, keys: &Value, fps: f64, clip_fps: f64) -> Value {
    let mut assumed = Vec::new();
    let mut or = |key: &'static str, found: Option<Value>, else_: Value| {
        found.unwrap_or_else(|| {
            assumed.push(key);
            else_
        })
    };
    // an optional key that is missing has its default
    let optional = |key: &str, value: Value| if keys.get(key).is_none() { Some(value) } else { None };
    let text = |key: &str| keys[key].as_str().map(|text| json!(text));
    let clip = or("clip", text("clip").or(optional("clip", Value::Null)), Value::Null);
    let joints = or("joints", text("joints").or(optional("joints", json!("all"))), json!("all"));
    let at = or("at", time(&keys["at"], clip_fps).map(Value::from).or(optional("at", json!(0.0))), json!(0.0));
    let from_s = time(&keys["from"], fps);
    let from = or("from", from_s.map(Value::from), json!(0.0));
    let from_s = from_s.unwrap_or(0.0);
    // a segment that ends before it begins would have no width to grab
    let to = time(&keys["to"], fps).filter(|to| *to > from_s);
    let to = or("to", to.map(Value::from), json!(from_s + SHORT_S));
    let labels = or("labels", labels(keys.get("labels")), json!({}));
    json!({
        "index": index, "clip": clip, "joints": joints, "labels": labels, "from": from, "to": to, "at": at,
        "assumed": assumed,
    })
}

/// A time that can be drawn, seconds.
fn time(value: &Value, fps: f64) -> Option<f64> {
    let moment = match value {
        Value::Number(number) => Moment::Seconds(number.as_f64()?),
        Value::String(text) => text.parse().ok()?,
        _ => return None,
    };
    // NaN and negative times aren't in it
    Some(moment.seconds(fps)).filter(|s| (0.0..=LONGEST_S).contains(s))
}

/// Labels that are all texts.
fn labels(value: Option<&Value>) -> Option<Value> {
    match value {
        None => Some(json!({})),
        Some(Value::Object(all)) => {
            let texts = all.iter().map(|(field, value)| Some((field.clone(), json!(value.as_str()?))));
            texts.collect::<Option<Map<_, _>>>().map(Value::Object)
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_a_text_says_a_segment_is_whole() {
        let text = "rig = \"a\"\n\
            [[segment]]\nclip = \"a\"\nfrom = 1\nto = \"90f\"\nat = \"15f\"\nlabels = { genre = \"salsa\" }\n\
            [[segment]]\n\
            [[segment]]\nclip = 3\njoints = [1]\nfrom = \"soon\"\nto = inf\nat = nan\nlabels = { genre = 1 }\n\
            [[segment]]\nfrom = 5\nto = 4\nat = -1\nlabels = \"x\"\n\
            [[segment]]\nfrom = -1e300\nto = 1e300\nat = true\n";
        let file = TimelineFile::parse(Path::new("timeline.toml"), text).unwrap();
        let all = segments(&file, &[], Path::new(""));
        let times = |n: usize| ["from", "to", "at"].map(|key| all[n][key].as_f64().unwrap());
        assert_eq!(times(0), [1.0, 3.0, 0.5]);
        assert_eq!((&all[0]["assumed"], &all[0]["labels"]["genre"]), (&json!([]), &json!("salsa")));
        assert_eq!((times(1), &all[1]["assumed"]), ([0.0, 1.0, 0.0], &json!(["from", "to"])));
        assert_eq!((&all[1]["clip"], &all[1]["joints"], &all[1]["labels"]), (&Value::Null, &json!("all"), &json!({})));
        let expected = json!(["clip", "joints", "at", "from", "to", "labels"]);
        assert_eq!((times(2), &all[2]["assumed"]), ([0.0, 1.0, 0.0], &expected));
        assert_eq!((times(3), &all[3]["assumed"]), ([5.0, 6.0, 0.0], &json!(["at", "to", "labels"])));
        assert_eq!((times(4), &all[4]["assumed"]), ([0.0, 1.0, 0.0], &json!(["at", "from", "to"])));
        assert!(all.iter().enumerate().all(|(n, one)| one["index"] == n && one["labels"].is_object()));
    }
}
