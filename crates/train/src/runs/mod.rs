//! Reading training runs, while they are written or after: lists, logs and curves.

mod curves;
pub mod list;
mod log;
mod table;

pub use curves::{Metric, XAxis, charts};
pub use list::{Listed, Status, list};
pub use log::Log;
pub use table::{names, table};
