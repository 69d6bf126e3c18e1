//! Segments of clips, between changes of labels over time and around excluded ranges.
//!
//! A window has one value of each label, so a clip whose labels change is split where they do. Every segment is a clip of its
//! own, of the same take and split. Times are seconds of the clip as it is read, half-open: a frame at second t has the
//! labels with `from_s <= t < to_s`. Where no row states a label, it is unknown.

use super::item::{Item, Segment, TimeRange, TimedLabels};
use crate::{Error, Result};
use kinelm_motion::{Clip, Warning};
use std::collections::HashMap;

impl Segment {
    /// The first frame, counted in the whole clip at `fps`.
    pub fn first(&self, fps: f64) -> usize {
        frame_at(self.from_s, fps)
    }
}

/// The first frame at or after a second.
fn frame_at(s: f64, fps: f64) -> usize {
    // 1e-6 of a frame, so that a time written with few decimals doesn't miss its own frame
    (s * fps - 1e-6).ceil().max(0.0) as usize
}

/// Splits items with labels over time or excluded ranges into segments, and numbers all items anew.
pub fn split_items(items: &[Item]) -> Vec<Item> {
    let split = |item: &Item| match item.timed.is_empty() && item.excluded.is_empty() {
        true => vec![item.clone()],
        false => segments(item),
    };
    let all = items.iter().flat_map(split).enumerate();
    all.map(|(key, item)| Item { key, ..item }).collect()
}

fn segments(item: &Item) -> Vec<Item> {
    let of_labels = item.timed.iter().flat_map(|t| [t.from_s, t.to_s]);
    let of_ranges = item.excluded.iter().flat_map(|r| [r.from_s, r.to_s]);
    let mut borders: Vec<f64> = of_labels.chain(of_ranges).chain([0.0, f64::INFINITY]).collect();
    borders.sort_by(f64::total_cmp);
    borders.dedup();
    // a sweep over the borders: what begins at or before a segment and doesn't end inside it holds in all of it
    let mut timed: Vec<&TimedLabels> = item.timed.iter().collect();
    timed.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
    let mut excluded: Vec<&TimeRange> = item.excluded.iter().collect();
    excluded.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
    let (mut timed, mut excluded) = (timed.into_iter().peekable(), excluded.into_iter().peekable());
    let (mut holding, mut excluded_to_s): (Vec<&TimedLabels>, f64) = (Vec::new(), 0.0);
    let of_labels = first_lines(item.timed.iter().map(|t| (t.from_s, t.to_s, t.line)));
    let of_ranges = first_lines(item.excluded.iter().map(|r| (r.from_s, r.to_s, r.line)));
    let bare = Item { timed: Vec::new(), excluded: Vec::new(), ..item.clone() };
    let mut found = Vec::new();
    for pair in borders.windows(2) {
        let (from_s, to_s) = (pair[0], pair[1]);
        holding.retain(|t| to_s <= t.to_s);
        holding.extend(std::iter::from_fn(|| timed.next_if(|t| t.from_s <= from_s)).filter(|t| to_s <= t.to_s));
        while let Some(range) = excluded.next_if(|r| r.from_s <= from_s) {
            excluded_to_s = excluded_to_s.max(range.to_s);
        }
        if to_s <= excluded_to_s {
            continue;
        }
        let labels = bare.labels.clone().into_iter().chain(holding.iter().flat_map(|t| t.labels.clone())).collect();
        let until = if to_s.is_finite() { format!("{to_s}s") } else { "end".into() };
        let name = format!("{}@{from_s}s-{until}", item.name);
        let line_in = |lines: &HashMap<u64, (usize, usize)>| {
            let at = [from_s, to_s].into_iter().filter_map(|s| lines.get(&key(s)));
            at.min().map(|(_, line)| *line)
        };
        let beside_excluded = line_in(&of_ranges);
        let line = beside_excluded.or_else(|| line_in(&of_labels)).unwrap_or(0);
        let (labelled, beside_excluded) = (!holding.is_empty(), beside_excluded.is_some());
        let segment = Some(Segment { from_s, to_s, labelled, line, beside_excluded });
        found.push(Item { name, labels, segment, ..bare.clone() });
    }
    found
}

/// A second as a key; -0 is 0.
fn key(s: f64) -> u64 {
    (s + 0.0).to_bits()
}

/// For every second at which a row begins or ends, the number of the first such row and its line.
fn first_lines(rows: impl Iterator<Item = (f64, f64, usize)>) -> HashMap<u64, (usize, usize)> {
    let mut first = HashMap::new();
    for (number, (from_s, to_s, line)) in rows.enumerate() {
        for s in [from_s, to_s] {
            first.entry(key(s)).or_insert((number, line));
        }
    }
    first
}

/// A warning if the excluded range after an item's segment begins after the clip's end, and so excludes nothing.
pub(super) fn past_end_warning(item: &Item, clip: &Clip) -> Option<Warning> {
    let segment = item.segment.filter(|segment| segment.beside_excluded && segment.to_s.is_finite())?;
    let seconds = clip.frames() as f64 / clip.fps();
    let outside = segment.to_s * clip.fps() > clip.frames() as f64 + 1.0;
    let (line, from_s) = (segment.line, segment.to_s);
    let what = format!("line {line} of the excluded ranges begins at {from_s} s of a clip of {seconds:.2} s");
    outside.then(|| Warning { kind: "excluded_past_end", what: format!("{what}: it excludes nothing") })
}

/// The frames of a whole clip that an item is: all, or its segment; none if the clip ends where the segment begins.
///
/// # Errors
/// [`kinelm_store::Error::File`] for labels of seconds that the clip doesn't have, with a tolerance of a frame.
pub(super) fn segment_of(item: &Item, clip: &Clip) -> Result<Clip> {
    let Some(Segment { from_s, to_s, labelled, line, beside_excluded }) = item.segment else { return Ok(clip.clone()) };
    let (frames, fps) = (clip.frames(), clip.fps());
    let frame = |s: f64| frame_at(s, fps).min(frames);
    let seconds = frames as f64 / fps;
    let outside = (labelled && frame(from_s) >= frames) || (to_s.is_finite() && to_s * fps > frames as f64 + 1.0);
    // an excluded range may be past the clip's end, where it excludes nothing
    if outside && !beside_excluded {
        let until = if to_s.is_finite() { format!("{to_s} s") } else { "the end".into() };
        let found = format!("labels from {from_s} s to {until} of a clip of {seconds:.2} s");
        let help = "times are seconds of the clip as it is read: without the frames that are skipped, at its true rate";
        let help = format!("line {line} of the labels says so; {help}");
        return Err(Error::file(&item.path, found, "times within the clip", help));
    }
    Ok(clip.slice(frame(from_s)..frame(to_s)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::walk;
    use std::collections::BTreeMap;

    fn timed(from_s: f64, to_s: f64, field: &str, value: &str) -> TimedLabels {
        TimedLabels { from_s, to_s, labels: BTreeMap::from([(field.into(), value.into())]), line: 2 }
    }

    fn item() -> Item {
        let labels = BTreeMap::from([("dancer".to_string(), "61".to_string())]);
        let timed = vec![
            timed(0.1, 0.2, "genre", "salsa"),
            timed(0.3, f64::INFINITY, "genre", "waltz"),
            timed(0.15, 0.3, "mood", "glad"),
        ];
        Item { name: "a".into(), take: "t".into(), key: 4, labels, timed, ..Item::default() }
    }

    #[test]
    fn a_clip_is_split_where_a_label_changes() {
        let all = split_items(&[Item { name: "x".into(), ..Item::default() }, item(), Item::default()]);
        let shown = |item: &Item| {
            let labels: Vec<String> =
                item.labels.iter().filter(|(f, _)| *f != "dancer").map(|(f, v)| format!("{f}={v}")).collect();
            (item.name.clone(), labels.join(" "))
        };
        let expected = [
            ("x", ""),
            ("a@0s-0.1s", ""),
            ("a@0.1s-0.15s", "genre=salsa"),
            ("a@0.15s-0.2s", "genre=salsa mood=glad"),
            ("a@0.2s-0.3s", "mood=glad"),
            ("a@0.3s-end", "genre=waltz"),
            ("", ""),
        ];
        assert_eq!(all.iter().map(shown).collect::<Vec<_>>(), expected.map(|(n, l)| (n.to_string(), l.to_string())));
        assert_eq!(all.iter().map(|i| i.key).collect::<Vec<_>>(), (0..7).collect::<Vec<_>>());
        assert!(all[1..6].iter().all(|i| i.labels["dancer"] == "61" && i.take == "t" && i.timed.is_empty()));
    }

    #[test]
    fn many_rows_take_linear_time() {
        let timed: Vec<TimedLabels> =
            (0..20_000).rev().map(|i| timed(i as f64, i as f64 + 1.0, "genre", "salsa")).collect();
        let excluded =
            (0..20_000).map(|i| TimeRange { from_s: i as f64 + 0.5, to_s: i as f64 + 0.75, line: i + 2 }).collect();
        let started = std::time::Instant::now();
        let all = split_items(&[Item { name: "a".into(), timed, excluded, ..Item::default() }]);
        assert!(started.elapsed().as_secs() < 5, "{:?}", started.elapsed());
        let segment = all[3].segment.unwrap();
        assert_eq!((all.len(), &*all[3].name), (40_001, "a@1.75s-2s"));
        assert_eq!((segment.labelled, segment.line, segment.beside_excluded), (true, 3, true));
        assert!(!all[40_000].segment.unwrap().labelled && all[40_000].labels.is_empty());
        // overlapping ranges exclude their union
        let range = |from_s, to_s| TimeRange { from_s, to_s, line: 2 };
        let excluded = vec![range(3.0, 9.0), range(1.0, 8.0), range(2.0, 3.0)];
        let all = split_items(&[Item { name: "a".into(), excluded, ..Item::default() }]);
        assert_eq!(all.iter().map(|item| &*item.name).collect::<Vec<_>>(), ["a@0s-1s", "a@9s-end"]);
    }

    #[test]
    fn times_are_half_open_and_within_the_clip() {
        // 10 frames at 20 a second: half a second
        let clip = walk(10);
        let frames = |from_s: f64, to_s: f64, stated: bool| {
            let item = Item {
                segment: Some(Segment { from_s, to_s, labelled: stated, line: 2, beside_excluded: false }),
                ..Item::default()
            };
            segment_of(&item, &clip).map(|c| c.frames()).map_err(|e| e.to_string())
        };
        let end = f64::INFINITY;
        assert_eq!((frames(0.0, 0.1, true), frames(0.1, 0.15, true), frames(0.12, end, true)), (Ok(2), Ok(1), Ok(7)));
        // no frame begins in the range
        assert_eq!((frames(0.01, 0.04, true), frames(0.5, end, false), frames(0.1, 0.55, true)), (Ok(0), Ok(0), Ok(8)));
        let said = frames(0.5, end, true).unwrap_err();
        assert!(said.contains("found labels from 0.5 s to the end of a clip of 0.50 s"), "{said}");
        assert!(frames(0.1, 0.6, true).unwrap_err().contains("from 0.1 s to 0.6 s of a clip"));
        assert_eq!(segment_of(&Item::default(), &clip).unwrap(), clip);
    }
}
