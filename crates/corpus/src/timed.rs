//! Labels that hold for a time: rows of a CSV with `from_s` and `to_s`, and the pieces into which they cut a clip.
//!
//! A window of a model has its labels in front and one value of each, so a clip whose labels change is cut where they do.
//! Every piece is a clip of its own, of the same take and split. Times are seconds of the clip as it is read, half-open: a
//! frame at second t has the labels of `from_s <= t < to_s`. What no row tells of is unknown.

use super::gather::Item;
use super::left_out::Range;
use crate::{Error, Result};
use kinelm_motion::{Clip, Warning};
use std::collections::{BTreeMap, HashMap};

/// Labels over a time.
#[derive(Debug, Clone, PartialEq)]
pub struct Timed {
    /// From when on, seconds, 0 or more.
    pub from_s: f64,
    /// Until when, seconds, more than `from_s`; infinite: to the clip's end.
    pub to_s: f64,
    /// Field to value.
    pub labels: BTreeMap<String, String>,
    /// The line of the CSV that says so.
    pub line: usize,
}

impl Timed {
    /// Whether both hold at some time.
    pub fn meets(&self, other: &Timed) -> bool {
        self.from_s < other.to_s && other.from_s < self.to_s
    }
}

/// A stretch of a clip between two changes of its labels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Its first second.
    pub from_s: f64,
    /// The second behind its last; infinite: the clip's end.
    pub to_s: f64,
    /// Whether a row tells of it: then the clip has to have it.
    pub stated: bool,
    /// The line of the CSV that says when it begins or ends.
    pub line: usize,
    /// Whether that CSV is the one of what is left out; else it is that of the labels.
    pub beside_left_out: bool,
}

impl Piece {
    /// Its first frame, of those of the whole clip at `fps`.
    pub fn first(&self, fps: f64) -> usize {
        frame_at(self.from_s, fps)
    }
}

/// The first frame that isn't before a second.
fn frame_at(s: f64, fps: f64) -> usize {
    (s * fps - 1e-6).ceil().max(0.0) as usize
}

/// The items with those cut that have labels over time or ranges that are left out, and keys anew.
pub fn in_pieces(items: &[Item]) -> Vec<Item> {
    let cut = |item: &Item| match item.timed.is_empty() && item.left_out.is_empty() {
        true => vec![item.clone()],
        false => pieces(item),
    };
    let all = items.iter().flat_map(cut).enumerate();
    all.map(|(key, item)| Item { key, ..item }).collect()
}

fn pieces(item: &Item) -> Vec<Item> {
    let of_labels = item.timed.iter().flat_map(|t| [t.from_s, t.to_s]);
    let of_ranges = item.left_out.iter().flat_map(|r| [r.from_s, r.to_s]);
    let mut borders: Vec<f64> = of_labels.chain(of_ranges).chain([0.0, f64::INFINITY]).collect();
    borders.sort_by(f64::total_cmp);
    borders.dedup();
    // a sweep over the borders: of what begins at or before a piece, what doesn't end before it holds in all of it
    let mut timed: Vec<&Timed> = item.timed.iter().collect();
    timed.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
    let mut left_out: Vec<&Range> = item.left_out.iter().collect();
    left_out.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
    let (mut timed, mut left_out) = (timed.into_iter().peekable(), left_out.into_iter().peekable());
    let (mut holding, mut left_out_to_s): (Vec<&Timed>, f64) = (Vec::new(), 0.0);
    let of_labels = first_lines(item.timed.iter().map(|t| (t.from_s, t.to_s, t.line)));
    let of_ranges = first_lines(item.left_out.iter().map(|r| (r.from_s, r.to_s, r.line)));
    // the item as every piece has it
    let bare = Item { timed: Vec::new(), left_out: Vec::new(), ..item.clone() };
    let mut found = Vec::new();
    for pair in borders.windows(2) {
        let (from_s, to_s) = (pair[0], pair[1]);
        holding.retain(|t| to_s <= t.to_s);
        holding.extend(std::iter::from_fn(|| timed.next_if(|t| t.from_s <= from_s)).filter(|t| to_s <= t.to_s));
        while let Some(range) = left_out.next_if(|r| r.from_s <= from_s) {
            left_out_to_s = left_out_to_s.max(range.to_s);
        }
        if to_s <= left_out_to_s {
            continue;
        }
        let labels = bare.labels.clone().into_iter().chain(holding.iter().flat_map(|t| t.labels.clone())).collect();
        let until = if to_s.is_finite() { format!("{to_s}s") } else { "end".into() };
        let name = format!("{}@{from_s}s-{until}", item.name);
        let line_in = |lines: &HashMap<u64, (usize, usize)>| {
            let at = [from_s, to_s].into_iter().filter_map(|s| lines.get(&key(s)));
            at.min().map(|(_, line)| *line)
        };
        let beside_left_out = line_in(&of_ranges);
        let line = beside_left_out.or_else(|| line_in(&of_labels)).unwrap_or(0);
        let (stated, beside_left_out) = (!holding.is_empty(), beside_left_out.is_some());
        let piece = Some(Piece { from_s, to_s, stated, line, beside_left_out });
        found.push(Item { name, labels, piece, ..bare.clone() });
    }
    found
}

/// A second as a key; -0 is 0.
fn key(s: f64) -> u64 {
    (s + 0.0).to_bits()
}

/// Of every second at which some row begins or ends the first such row: its number, and its line.
fn first_lines(rows: impl Iterator<Item = (f64, f64, usize)>) -> HashMap<u64, (usize, usize)> {
    let mut first = HashMap::new();
    for (number, (from_s, to_s, line)) in rows.enumerate() {
        for s in [from_s, to_s] {
            first.entry(key(s)).or_insert((number, line));
        }
    }
    first
}

/// What is said of a range to leave out that begins behind the clip's end, and so takes nothing away.
pub fn behind_its_end(item: &Item, clip: &Clip) -> Option<Warning> {
    let piece = item.piece.filter(|piece| piece.beside_left_out && piece.to_s.is_finite())?;
    let seconds = clip.frames() as f64 / clip.fps();
    let outside = piece.to_s * clip.fps() > clip.frames() as f64 + 1.0;
    let (line, from_s) = (piece.line, piece.to_s);
    let what = format!("line {line} of the ranges that are left out begins at {from_s} s of a clip of {seconds:.2} s");
    outside.then(|| Warning { kind: "left_out_behind_end", what: format!("{what}: nothing is left out by it") })
}

/// The frames of a clip that are an item's: all, or its piece's; none where nothing is left behind the last row.
///
/// # Errors
/// [`kinelm_store::Error::File`]: a row tells of seconds that the clip doesn't have; to the end means to within a frame of it.
pub fn piece_of(item: &Item, clip: &Clip) -> Result<Clip> {
    let Some(Piece { from_s, to_s, stated, line, beside_left_out }) = item.piece else { return Ok(clip.clone()) };
    let (frames, fps) = (clip.frames(), clip.fps());
    let frame = |s: f64| frame_at(s, fps).min(frames);
    let seconds = frames as f64 / fps;
    let outside = (stated && frame(from_s) >= frames) || (to_s.is_finite() && to_s * fps > frames as f64 + 1.0);
    // a range to leave out that lies behind the end takes nothing away
    if outside && !beside_left_out {
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

    fn timed(from_s: f64, to_s: f64, field: &str, value: &str) -> Timed {
        Timed { from_s, to_s, labels: BTreeMap::from([(field.into(), value.into())]), line: 2 }
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
    fn a_clip_is_cut_where_a_label_changes() {
        let all = in_pieces(&[Item { name: "x".into(), ..Item::default() }, item(), Item::default()]);
        let told = |item: &Item| {
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
        assert_eq!(all.iter().map(told).collect::<Vec<_>>(), expected.map(|(n, l)| (n.to_string(), l.to_string())));
        assert_eq!(all.iter().map(|i| i.key).collect::<Vec<_>>(), (0..7).collect::<Vec<_>>());
        assert!(all[1..6].iter().all(|i| i.labels["dancer"] == "61" && i.take == "t" && i.timed.is_empty()));
    }

    #[test]
    fn many_rows_cut_a_clip_as_few_do() {
        let timed: Vec<Timed> = (0..20_000).rev().map(|i| timed(i as f64, i as f64 + 1.0, "genre", "salsa")).collect();
        let left_out =
            (0..20_000).map(|i| Range { from_s: i as f64 + 0.5, to_s: i as f64 + 0.75, line: i + 2 }).collect();
        let started = std::time::Instant::now();
        let all = in_pieces(&[Item { name: "a".into(), timed, left_out, ..Item::default() }]);
        assert!(started.elapsed().as_secs() < 5, "{:?}", started.elapsed());
        let piece = all[3].piece.unwrap();
        assert_eq!((all.len(), &*all[3].name), (40_001, "a@1.75s-2s"));
        assert_eq!((piece.stated, piece.line, piece.beside_left_out), (true, 3, true));
        assert!(!all[40_000].piece.unwrap().stated && all[40_000].labels.is_empty());
        // ranges that overlap leave out what any of them does
        let range = |from_s, to_s| Range { from_s, to_s, line: 2 };
        let left_out = vec![range(3.0, 9.0), range(1.0, 8.0), range(2.0, 3.0)];
        let all = in_pieces(&[Item { name: "a".into(), left_out, ..Item::default() }]);
        assert_eq!(all.iter().map(|item| &*item.name).collect::<Vec<_>>(), ["a@0s-1s", "a@9s-end"]);
    }

    #[test]
    fn times_are_half_open_and_within_the_clip() {
        // 10 frames at 20 a second: half a second
        let clip = walk(10);
        let frames = |from_s: f64, to_s: f64, stated: bool| {
            let item = Item {
                piece: Some(Piece { from_s, to_s, stated, line: 2, beside_left_out: false }),
                ..Item::default()
            };
            piece_of(&item, &clip).map(|c| c.frames()).map_err(|e| e.to_string())
        };
        let end = f64::INFINITY;
        assert_eq!((frames(0.0, 0.1, true), frames(0.1, 0.15, true), frames(0.12, end, true)), (Ok(2), Ok(1), Ok(7)));
        // the first frame lies before what is left
        assert_eq!((frames(0.01, 0.04, true), frames(0.5, end, false), frames(0.1, 0.55, true)), (Ok(0), Ok(0), Ok(8)));
        let said = frames(0.5, end, true).unwrap_err();
        assert!(said.contains("found labels from 0.5 s to the end of a clip of 0.50 s"), "{said}");
        assert!(frames(0.1, 0.6, true).unwrap_err().contains("from 0.1 s to 0.6 s of a clip"));
        assert_eq!(piece_of(&Item::default(), &clip).unwrap(), clip);
    }
}
