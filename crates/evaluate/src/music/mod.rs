//! Reports and charts of a piece of music.

pub mod picture;
pub mod report;
