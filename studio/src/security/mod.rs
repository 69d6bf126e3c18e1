//! The studio answers the browser of the user who started it alone. docs/studio.md, "Threats".
//!
//! - [`secret`]: random numbers that nobody can guess, compared in constant time.
//! - [`entry`]: the single-use token in a file that only the user can read, and the cookie that it is exchanged for.
//! - [`hosts`]: the names under which the server answers.
//! - [`headers`]: what every answer carries.

pub mod entry;
pub mod headers;
pub mod hosts;
pub mod secret;
