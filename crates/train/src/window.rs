//! A training window of a corpus.

/// A window's number over all corpora, and the round in which its corpus gives it. The random streams of a window come
/// from both.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WindowId {
    /// How many times its corpus gave all its windows before.
    pub round: u64,
    /// Its number among the windows of all corpora.
    pub number: usize,
}

/// The tokens of a clip that a window shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WindowSpan {
    /// Index into [`super::batches::Batches::clips`].
    pub clip: usize,
    /// The word of its first token. A window begins at a word, unless the word is longer than the window.
    pub word: usize,
    /// Its first token, counted from the clip's.
    pub start: usize,
    /// Tokens of the clip that it shows.
    pub tokens: usize,
}
