//! Which window of a corpus a step trains on, and where it stands.

/// A window of a pass: its number over all corpora, and the round in which its corpus gives it. Random numbers that
/// belong to a window come from both.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WindowId {
    /// Which time it comes.
    pub round: u64,
    /// Its number among the windows of all corpora.
    pub number: usize,
}

/// Where a window stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stand {
    /// Index into [`super::batches::Batches::clips`].
    pub clip: usize,
    /// The word it starts in, which it starts at but for words that are longer than a window.
    pub word: usize,
    /// Its first token, counted from the clip's.
    pub start: usize,
    /// Tokens of the clip that it shows.
    pub tokens: usize,
}
