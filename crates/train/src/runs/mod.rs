//! Reading training runs, while they are written or after: lists, logs and curves.

pub mod curves;
pub mod list;
pub mod log;
mod table;

pub use curves::{Metric, XAxis, chart};
pub use list::{Listed, Status, list};
pub use log::Log;
pub use table::{names, table};
