//! What is said and drawn of a piece of music.

pub mod picture;
pub mod report;
