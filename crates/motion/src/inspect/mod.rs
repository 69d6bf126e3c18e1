//! Inspection of a motion: statistics, suspicious values, and a report.

pub mod report;
pub mod stats;

pub use report::{Report, report};
