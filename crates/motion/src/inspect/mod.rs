//! What a clip is, and what looks wrong in it: figures, and the report of them.

pub mod report;
pub mod stats;

pub use report::{Report, report};
pub use stats::{ClipStats, clip_stats};
