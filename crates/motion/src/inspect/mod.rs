//! What a clip is, and what looks wrong in it: figures, and the report of them.

pub mod figures;
pub mod report;

pub use figures::{Figures, figures};
pub use report::{Report, report};
