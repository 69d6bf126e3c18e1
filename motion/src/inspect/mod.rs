//! What a clip is, and what looks wrong in it: figures, doubts, and the report of both.

pub mod figures;
pub mod report;

pub use figures::{Figures, figures};
pub use report::{Report, report};
