//! Dances that are made: a request of the page becomes the library's request, is sampled in a job, streamed while it is,
//! and written with its sidecar.
//!
//! - [`model`]: the model that dances.
//! - [`request`]: what a page may request.
//! - [`jobs`]: the list of jobs, which outlives a process.
//! - [`stream`]: frames of dances that are still sampled.
//! - [`best`]: the best of several.
//! - [`work`]: a job carried out.

pub mod best;
pub mod jobs;
pub mod model;
pub mod request;
pub mod stream;
pub mod work;
