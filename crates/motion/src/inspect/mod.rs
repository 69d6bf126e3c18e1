//! What a clip is, and what looks wrong in it: figures, doubts, and the report of both.

pub mod figures;
pub mod rate;
pub mod report;

pub use figures::{Figures, figures};
pub use rate::{FALL_LIMIT_G, RateDoubt, RateDoubts};
pub use report::{Report, report};
