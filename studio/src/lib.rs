//! kinelm studio: a local web application for dances.
//!
//! A server for one user on one machine. It computes nothing about dances itself: every action is the library call that
//! the command line makes. docs/studio.md.
//!
//! The rooms, each using only those before it:
//!
//! - [`error`]: what can go wrong, and what of it a page may read.
//! - [`events`]: what all open pages hear.
//! - [`security`]: who may talk to the server.
//! - [`project`]: the folder, the journal, steps back and on.
//! - [`library`]: files, what is known of them, figures, search.
//! - [`timeline`]: the file, edits of it, its layout.
//! - [`make`]: requests, jobs and the dances that they make.
//! - [`studio`]: all of it together.
//! - [`http`]: requests and answers.
#![forbid(unsafe_code)]

pub mod error;
pub mod events;
#[cfg(test)]
mod fixture;
pub mod http;
pub mod library;
pub mod make;
pub mod project;
pub mod security;
pub mod studio;
pub mod timeline;

pub use error::{Error, Result};
pub use http::server::{Listen, Server, Stopper};
pub use library::child::{Limits, read_file};
pub use library::reader::Reader;
pub use studio::{Options, Studio};
