//! Which numbers of an edited clip are new.

/// The parts of a clip that differ from the file it comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Changed {
    /// Frames at the start of the file that are not written.
    pub before: usize,
    /// Whether the root's position changed (F).
    pub root: Vec<bool>,
    /// Whether each rotation changed (F, J).
    pub joints: Vec<bool>,
}
