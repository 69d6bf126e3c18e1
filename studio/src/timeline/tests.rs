use super::*;
use crate::fixture::{dance, library};
use edit::NewSegment;
use refit::{Length, Reread};
use serde_json::json;

/// A timeline with everything that a careful person puts into one.
const TEXT: &str = "# my dance\r\nrig = \"a\"   # the first\n\n[clips.a]\nfile='clips/a.bvh' # here\n\n[clips.\"b b\"]\n  file = \"clips/b.bvh\"\n\n\
                    # the beginning\n[[segment]]\nclip = \"a\"\nfrom = 0 # at once\nto   = 4\n\n# and then\n[[segment]]\n\
                    clip = \"b b\"\nfrom = \"6s\"\nto = 8.0\nlabels = { genre = \"salsa\" }\n";

fn timelines(folder: &std::path::Path, text: Option<&str>) -> Timelines {
    if let Some(text) = text {
        std::fs::create_dir_all(folder).unwrap();
        std::fs::write(folder.join(TIMELINE), text).unwrap();
    }
    let clips = [("a.bvh", dance(1, 6.0, 30.0)), ("b.bvh", dance(2, 6.0, 30.0))];
    let (project, library) = library(folder, &clips);
    Timelines::new(project, library)
}

fn edited(timelines: &Timelines, edits: &[Value]) -> Result<Value> {
    let edits: Vec<Edit> = edits.iter().map(|edit| serde_json::from_value(edit.clone()).unwrap()).collect();
    let (_, view) = timelines.edit(&edits, "test")?;
    Ok((*view).clone())
}

#[test]
fn an_edit_touches_its_own_bytes_alone() {
    let dir = tempfile::tempdir().unwrap();
    let timelines = timelines(dir.path(), Some(TEXT));
    let (view, _) = timelines.view().unwrap();
    assert_eq!((view["text"].as_str(), &view["trouble"]), (Some(TEXT), &json!([])));
    assert_eq!((view["seconds"].as_f64(), view["fps"].as_f64()), (Some(8.0), Some(30.0)));
    assert_eq!(view["clips"], json!({"a": {"clip": "c1", "file": "a.bvh"}, "b b": {"clip": "c2", "file": "b.bvh"}}));
    // the file is unchanged if nothing changes
    edited(&timelines, &[json!({"op": "set", "index": 0, "key": "to", "value": 4})]).unwrap();
    assert_eq!(std::fs::read_to_string(timelines.path()).unwrap(), TEXT);
    let view = edited(&timelines, &[json!({"op": "set", "index": 0, "key": "to", "value": 3.5})]).unwrap();
    assert_eq!(view["text"].as_str().unwrap(), TEXT.replace("to   = 4", "to   = 3.5"));
    let view = edited(&timelines, &[json!({"op": "set_top", "key": "seconds", "value": 9})]).unwrap();
    assert_eq!(view["seconds"].as_f64(), Some(9.0));
    assert!(
        view["text"].as_str().unwrap().contains("# the first") && view["text"].as_str().unwrap().starts_with("# my")
    );
    timelines.project().undo().unwrap();
    timelines.project().undo().unwrap();
    assert_eq!(std::fs::read_to_string(timelines.path()).unwrap(), TEXT);
}

#[test]
fn an_arm_that_is_freed_and_given_back_leaves_the_text_as_it_was() {
    let dir = tempfile::tempdir().unwrap();
    let timelines = timelines(dir.path(), Some(TEXT));
    let free = json!({"op": "free", "joints": "left_arm", "from": 1, "to": 2});
    let view = edited(&timelines, &[free]).unwrap();
    let segments = view["segments"].as_array().unwrap();
    assert_eq!(segments.len(), 4);
    assert_eq!(segments[1]["joints"], "root,legs,right_arm,spine,head");
    assert_eq!(segments[2]["at"].as_f64(), Some(2.0));
    let arm = view["rows"].as_array().unwrap().iter().find(|row| row["group"] == "left_arm").unwrap().clone();
    let spans: Vec<(f64, &str)> = arm["spans"]
        .as_array()
        .unwrap()
        .iter()
        .map(|s| (s["to"].as_f64().unwrap(), s["state"].as_str().unwrap()))
        .collect();
    assert_eq!(spans, [(1.0, "given"), (2.0, "generated"), (4.0, "given"), (6.0, "generated"), (8.0, "given")]);
    let text = view["text"].as_str().unwrap();
    assert!(text.contains("# the beginning\n[[segment]]\nclip = \"a\"\nfrom = 0 # at once\nto   = 1\n"), "{text}");
    let give = json!({"op": "give", "clip": "c1", "joints": "left_arm", "from": 1, "to": 2, "at": 1});
    let view = edited(&timelines, &[give]).unwrap();
    assert_eq!(view["text"].as_str(), Some(TEXT));
}

#[test]
fn an_empty_timeline_begins_with_all_of_a_clip() {
    let dir = tempfile::tempdir().unwrap();
    let timelines = timelines(dir.path(), None);
    let (view, _) = timelines.view().unwrap();
    assert_eq!((&view["segments"], &view["rows"], view["seconds"].as_f64()), (&json!([]), &json!([]), Some(0.0)));
    let view = edited(&timelines, &[json!({"op": "use_clip", "id": "c2"})]).unwrap();
    let text = view["text"].as_str().unwrap();
    let expected = "rig = \"b\"\n\n[clips.b]\nfile = \"clips/b.bvh\"\n\n[[segment]]\nclip = \"b\"\nfrom = 0\nto = 6\n";
    assert_eq!(text.split_once('\n').unwrap().1, expected);
    assert!(text.starts_with("# a timeline of kinelm"));
    // and taken out again it is empty, which is no trouble
    let view = edited(&timelines, &[json!({"op": "remove", "index": 0})]).unwrap();
    assert_eq!((&view["trouble"], &view["segments"]), (&json!([]), &json!([])));
    let view = edited(
        &timelines,
        &[
            json!({"op": "add", "segment": {"clip": "c1", "joints": "root,legs", "from": 0, "to": 5, "at": 0.5}}),
            json!({"op": "add", "segment": {"from": 1, "to": 2, "labels": {"genre": "salsa"}}}),
        ],
    );
    let view = view.unwrap();
    assert_eq!(view["segments"].as_array().unwrap().len(), 2);
    assert_eq!(timelines.project().history().0, (3, 0), "several edits are one step");
}

#[test]
fn edits_that_could_not_be_danced_are_refused_and_text_is_not() {
    let dir = tempfile::tempdir().unwrap();
    let timelines = timelines(dir.path(), Some(TEXT));
    for (edit, expected) in [
        (json!({"op": "set", "index": 0, "key": "to", "value": 60}), "at most, which the clip still has"),
        (json!({"op": "set", "index": 0, "key": "joints", "value": "wings"}), "wings"),
        (json!({"op": "set", "index": 7, "key": "to", "value": 1}), "one of the 2 segments"),
        (json!({"op": "set", "index": 0, "key": "file", "value": "/etc/passwd"}), "clip, joints, from"),
        (json!({"op": "set", "index": 0, "key": "to", "value": [1]}), "a number or a text"),
        (json!({"op": "set_top", "key": "clips", "value": "x"}), "rig, transition or seconds"),
        (json!({"op": "split", "index": 0, "at": 5}), "inside the segment"),
        (json!({"op": "free", "joints": "left_arm", "from": 2, "to": 1}), "an end after the beginning"),
        (json!({"op": "free", "joints": "left_arm", "from": 0, "to": 1e300}), "within an hour"),
        (json!({"op": "give", "clip": "../a.bvh", "from": 0, "to": 1}), "no clip abvh"),
        (json!({"op": "use_clip", "id": "c9"}), "no clip c9"),
    ] {
        let said = edited(&timelines, std::slice::from_ref(&edit)).unwrap_err().to_string();
        assert!(said.contains(expected), "{edit}: {said}");
    }
    assert_eq!(std::fs::read_to_string(timelines.path()).unwrap(), TEXT);
    let view = edited(&timelines, &[json!({"op": "text", "text": "rig = \n"})]).unwrap();
    assert_eq!((view["trouble"][0]["line"].as_u64(), view["text"].as_str()), (Some(1), Some("rig = \n")));
    assert!(edited(&timelines, &[json!({"op": "remove", "index": 0})]).is_err(), "no edit of what is no timeline");
    let long = "#".repeat(2 << 20);
    assert!(edited(&timelines, &[json!({"op": "text", "text": long})]).is_err());
    edited(&timelines, &[json!({"op": "text", "text": TEXT})]).unwrap();
}

#[test]
fn a_cut_in_two_generates_nothing_between() {
    let dir = tempfile::tempdir().unwrap();
    let timelines = timelines(dir.path(), Some(TEXT));
    let view = edited(&timelines, &[json!({"op": "split", "index": 0, "at": 1.51})]).unwrap();
    let segments = view["segments"].as_array().unwrap();
    assert_eq!((segments.len(), segments[1]["at"].as_f64()), (3, segments[1]["from"].as_f64()));
    let root = &view["rows"][0]["spans"];
    assert_eq!(
        (root[0]["to"].as_f64(), root[0]["state"].as_str()),
        segments[1]["from"].as_f64().map_or((None, None), |to| (Some(to), Some("given")))
    );
    assert_eq!(root[1]["to"].as_f64(), Some(4.0));
}

#[test]
fn segments_as_inline_tables_are_edited_too() {
    let dir = tempfile::tempdir().unwrap();
    let text = "rig = \"a\"\nsegment = [{ clip = \"a\", from = 0, to = 4 }]\n[clips]\na = { file = \"clips/a.bvh\" }\n";
    let timelines = timelines(dir.path(), Some(text));
    let view = edited(&timelines, &[json!({"op": "free", "joints": "arms", "from": 1, "to": 2})]).unwrap();
    assert_eq!((view["segments"].as_array().unwrap().len(), &view["trouble"]), (3, &json!([])));
    let added = NewSegment {
        clip: None,
        joints: None,
        from: 0.0,
        to: 1.0,
        at: None,
        labels: [("g".into(), "x".into())].into(),
    };
    let (_, view) = timelines.edit(&[Edit::Add { segment: added }], "label").unwrap();
    assert_eq!(view["segments"].as_array().unwrap().len(), 4);
}

/// The times of the segments: from, to, at.
fn times(view: &Value) -> Vec<[f64; 3]> {
    let of = |segment: &Value| ["from", "to", "at"].map(|key| (segment[key].as_f64().unwrap() * 1e3).round() / 1e3);
    view["segments"].as_array().unwrap().iter().map(of).collect()
}

/// The timeline after the reading of its first clip, 6 s at 30 frames per second, has changed.
fn reread(timelines: &Timelines, stated: Value, (fps, frames): (f64, usize)) -> Value {
    let reading: Reading = serde_json::from_value(stated).unwrap();
    let record = timelines.project().clip("c1").unwrap();
    let text = std::fs::read_to_string(timelines.path()).unwrap();
    let before = Length { fps: 30.0, frames: 180 };
    let reread = Reread { before, after: Length { fps, frames }, is_same_motion: true };
    let text = timelines.reread(&record, &text, &reading, Some(reread)).unwrap();
    edited(timelines, &[json!({"op": "text", "text": text})]).unwrap()
}

#[test]
fn segments_are_extended_with_their_clip_and_others_make_room() {
    let dir = tempfile::tempdir().unwrap();
    let timelines = timelines(dir.path(), Some(&format!("seconds = 9\n{TEXT}")));
    edited(&timelines, &[json!({"op": "split", "index": 0, "at": 1})]).unwrap();
    let view = reread(&timelines, json!({"fps_source": 15}), (15.0, 180));
    assert_eq!(view["trouble"], json!([]), "{}", view["text"]);
    assert_eq!(times(&view), [[0.0, 2.0, 0.0], [2.0, 8.0, 2.0], [10.0, 12.0, 0.0]]);
    assert_eq!((view["fps"].as_f64(), view["seconds"].as_f64()), (Some(15.0), Some(13.0)));
    let text = view["text"].as_str().unwrap();
    assert!(text.contains("fps_source = 15") && text.contains("from = 0 # at once\n"), "{text}");
    let spans = view["rows"][0]["spans"].as_array().unwrap();
    let spans: Vec<_> =
        spans.iter().map(|span| (span["to"].as_f64().unwrap(), span["state"].as_str().unwrap())).collect();
    // it continues where it was cut
    assert_eq!(spans, [(2.0, "given"), (8.0, "given"), (10.0, "generated"), (12.0, "given"), (13.0, "generated")]);
    // back at its own rate it is as it was
    let record = timelines.project().clip("c1").unwrap();
    let (before, after) = (Length { fps: 15.0, frames: 180 }, Length { fps: 30.0, frames: 180 });
    let back = Reread { before, after, is_same_motion: true };
    let text = timelines.reread(&record, text, &Reading::default(), Some(back)).unwrap();
    let view = edited(&timelines, &[json!({"op": "text", "text": text})]).unwrap();
    assert_eq!(times(&view), [[0.0, 1.0, 0.0], [1.0, 4.0, 1.0], [6.0, 8.0, 0.0]]);
    assert!(!text.contains("fps_source"), "{text}");
}

#[test]
fn segments_are_clipped_with_their_clip() {
    let dir = tempfile::tempdir().unwrap();
    let timelines = timelines(dir.path(), None);
    // all of it: to its new end, also where it was cut
    edited(&timelines, &[json!({"op": "use_clip", "id": "c1"})]).unwrap();
    let view = reread(&timelines, json!({"skip": 30}), (30.0, 150));
    assert_eq!((times(&view), &view["trouble"]), (vec![[0.0, 5.0, 0.0]], &json!([])));
    timelines.project().undo().unwrap();
    edited(&timelines, &[json!({"op": "split", "index": 0, "at": 2})]).unwrap();
    let view = reread(&timelines, json!({"skip": 30}), (30.0, 150));
    assert_eq!((times(&view), &view["trouble"]), (vec![[0.0, 1.0, 0.0], [2.0, 6.0, 1.0]], &json!([])));
}

#[test]
fn a_text_without_segments_that_is_wrong_says_so() {
    let dir = tempfile::tempdir().unwrap();
    let timelines = timelines(dir.path(), None);
    let trouble = |text: &str| {
        let view = edited(&timelines, &[json!({ "op": "text", "text": text })]).unwrap();
        view["trouble"].as_array().unwrap().iter().map(|one| one["text"].to_string()).collect::<Vec<_>>()
    };
    let begun = "rig = \"a\"\n[clips.a]\nfile = \"clips/a.bvh\"\n";
    for (more, what) in [
        ("[[segments]]\nclip = \"a\"\n", "unknown field `segments`"),
        ("[segment]\nclip = \"a\"\n", "sequence"),
        ("bogus = 1\n", "unknown field `bogus`"),
    ] {
        let found = trouble(&format!("{begun}{more}"));
        assert!(found.len() == 1 && found[0].contains(what), "{more}: {found:?}");
    }
    // a timeline that is only begun is fine, and so is an empty one
    for text in [begun, "", "# to come\n"] {
        assert_eq!(trouble(text), Vec::<String>::new(), "{text:?}");
    }
}

#[test]
fn a_text_with_trouble_has_whole_segments() {
    let dir = tempfile::tempdir().unwrap();
    let timelines = timelines(dir.path(), Some(TEXT));
    for (from, to, assumed) in [
        ("to   = 4", "to = 99", json!([])),
        ("to   = 4", "", json!(["to"])),
        ("from = 0", "from = \"soon\"", json!(["from"])),
        ("clip = \"a\"\n", "clip = \"none\"\n", json!([])),
        ("file='clips/a.bvh'", "file='clips/none.bvh'", json!([])),
    ] {
        let view = edited(&timelines, &[json!({"op": "text", "text": TEXT.replace(from, to)})]).unwrap();
        assert_eq!(view["trouble"].as_array().unwrap().len(), 1, "{to}");
        assert_eq!((times(&view).len(), &view["segments"][0]["assumed"]), (2, &assumed), "{to}");
        for segment in view["segments"].as_array().unwrap() {
            assert!(segment["labels"].is_object() && segment["joints"].is_string(), "{segment}");
        }
        assert_eq!(view["seconds"].as_f64(), Some(if to == "to = 99" { 99.0 } else { 8.0 }));
    }
}

#[test]
fn what_the_text_states_of_a_clip_holds_for_the_library() {
    let dir = tempfile::tempdir().unwrap();
    let timelines = timelines(dir.path(), Some(TEXT));
    let library = timelines.library();
    let reading = || library.reading(&timelines.project().clip("c1").unwrap());
    assert_eq!(reading(), Reading::default());
    let text = TEXT.replace(
        "clips/a.bvh' # here",
        "clips/a.bvh'\nfps_source = 60\nskip = 2\nup = \"sideways\"\nmap = \"/etc/passwd\"",
    );
    let changed: Vec<String> =
        library.read_otherwise(Some(TEXT), Some(&text)).into_iter().map(|clip| clip.id).collect();
    assert_eq!(changed, ["c1"]);
    edited(&timelines, &[json!({"op": "text", "text": text})]).unwrap();
    // faults of the text are reported by the timeline alone
    assert_eq!(reading(), Reading { fps_source: Some(60.0), skip: Some(2), ..Reading::default() });
    timelines.project().undo().unwrap();
    assert_eq!(reading(), Reading::default());
}

#[test]
fn a_timeline_takes_all_that_can_be_stated_of_a_clip() {
    let dir = tempfile::tempdir().unwrap();
    let timelines = timelines(dir.path(), Some(TEXT));
    let map = kinelm_motion::rig::SkeletonMap::builtin("smpl").unwrap().to_toml();
    let map = maps::keep(timelines.project(), "mine.toml", map.as_bytes()).unwrap();
    let stated = json!({
        "fps_source": 25, "skip": 1, "unit": "cm", "up": "y", "map": map, "floor": 0.1, "root": "pelvis",
        "mirror_axis": "x",
    });
    let reading: Reading = serde_json::from_value(stated).unwrap();
    let record = timelines.project().clip("c1").unwrap();
    let text = timelines.reread(&record, TEXT, &reading, None).unwrap();
    let view = edited(&timelines, &[json!({"op": "text", "text": text})]).unwrap();
    // the map is the timeline's, wherever the program runs
    assert_eq!((&view["trouble"], view["fps"].as_f64()), (&json!([]), Some(25.0)), "{text}");
    assert!(text.contains("map = \"maps/mine.toml\""), "{text}");
    assert_eq!(timelines.library().reading(&record), reading);
    let text = timelines.reread(&record, &text, &Reading::default(), None).unwrap();
    assert_eq!(text, TEXT);
}
