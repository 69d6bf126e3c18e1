//! Looking at training runs from outside, while they are written or after: what there is, and how it went.

pub mod curves;
pub mod list;
pub mod log;
mod table;

pub use curves::{Metric, Over, chart};
pub use list::{Listed, Status, list};
pub use log::Log;
pub use table::{names, table};
