//! Windows that can be searched.

use super::part::Part;
use super::record::ClipEntry;
use crate::Result;
use std::borrow::Cow;

/// A window of a clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Number of its clip in the database.
    pub clip: usize,
    /// Its first frame.
    pub start: usize,
}

/// N windows of clips with their features of D numbers.
pub struct Database {
    numbers: usize,
    parts: Vec<Part>,
    /// Per part the number of its first window.
    firsts: Vec<usize>,
    clips: Vec<ClipEntry>,
    windows: Vec<Window>,
}

impl Database {
    /// Parts with their clips, one after the other; features have D = `numbers`.
    ///
    /// # Panics
    /// When a part has not a feature for every window of its clips.
    pub(crate) fn new(numbers: usize, found: Vec<(Part, Vec<ClipEntry>)>) -> Database {
        let mut all = Database { numbers, parts: vec![], firsts: vec![], clips: vec![], windows: vec![] };
        for (part, clips) in found {
            all.firsts.push(all.windows.len());
            let first = all.clips.len();
            let windows = clips.iter().enumerate();
            let windows =
                windows.flat_map(|(i, c)| c.starts.iter().map(move |&start| Window { clip: first + i, start }));
            all.windows.extend(windows);
            assert_eq!(all.windows.len() - all.firsts[all.parts.len()], part.sizes.len(), "a feature a window");
            assert_eq!(part.numbers(), part.sizes.len() * numbers, "features of {numbers}");
            all.parts.push(part);
            all.clips.extend(clips);
        }
        all
    }

    /// D.
    pub fn numbers(&self) -> usize {
        self.numbers
    }

    /// N.
    pub fn windows(&self) -> usize {
        self.windows.len()
    }

    /// The clips, in the order of their windows.
    pub fn clips(&self) -> &[ClipEntry] {
        &self.clips
    }

    /// A window by its number.
    ///
    /// # Panics
    /// When there is no such window.
    pub fn window(&self, number: usize) -> Window {
        self.windows[number]
    }

    /// (D) the feature of a window.
    ///
    /// # Errors
    /// An index whose files were cut while it was in use.
    ///
    /// # Panics
    /// When there is no such window.
    pub fn feature(&self, number: usize) -> Result<Cow<'_, [f32]>> {
        let part = self.firsts.partition_point(|&first| first <= number) - 1;
        let inside = number - self.firsts[part];
        self.parts[part].features(inside * self.numbers..(inside + 1) * self.numbers)
    }

    /// The number of the first window of each part.
    pub(super) fn firsts(&self) -> &[usize] {
        &self.firsts
    }

    pub(super) fn parts(&self) -> &[Part] {
        &self.parts
    }
}
