//! New dances: part of every frame is given, or the first frames are, and a model samples the rest.
//!
//! ```no_run
//! use kinelm_generate::{Length, OpenRequest, Request};
//!
//! let request = Request { length: Some(Length::Seconds(10.0)), seed: Some(7), ..Request::of("run") };
//! OpenRequest::open(&request)?.write("dance.bvh")?; // and dance.bvh.kinelm.json, from which it can be made again
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A dance passes through these modules, from the last to the first and back:
//!
//! ```text
//! Request --open--> OpenRequest (Resolved, model, prompt) --sampler--> words --output--> Motion --provenance--> file
//!                       +------------------------------ make ------------------------------+
//! ```
//!
//! - [`sampling`]: which of the allowed tokens comes next, one file per rule.
//! - [`request`]: what decides a dance, as values that files can hold.
//! - [`sampler`]: words sampled from a model, as an iterator.
//! - [`score`]: how believable a stretch of a dance is.
//! - [`masked`]: the same from a masked model, window by window.
//! - [`run_model`]: the model of a run, of either kind.
//! - [`prompt`]: a clip as the model sees it, and the way back to its rig.
//! - [`edit`]: parts of a clip generated, and their ends closed.
//! - [`timeline`]: several clips arranged into one to be edited.
//! - [`open`]: a request with everything that it names read, and every option decided.
//! - [`make`]: the way from an open request to files, with progress, a preview and a choice of the best.
//! - [`output`]: words decoded to a motion on a rig.
//! - [`best`]: what is known of a dance chosen among several.
//! - [`feet`]: feet of a dance locked, as far as they were generated.
//! - [`provenance`]: the file beside a dance, from which it can be made again.
#![forbid(unsafe_code)]

pub mod best;
pub mod edit;
pub mod feet;
pub mod make;
pub mod masked;
pub mod open;
pub mod output;
pub mod prompt;
pub mod provenance;
pub mod related;
pub mod request;
pub mod run_model;
pub mod sampler;
pub mod sampling;
pub mod score;
pub mod timeline;

pub use kinelm_model::{Error, Result};
pub use open::OpenRequest;
pub use request::{Length, MusicRequest, PromptRequest, Request, Resolved, Rig};
pub use run_model::RunModel;
pub use sampler::{
    MOST_FRAMES, NextToken, Sampler, SamplingPlan, SamplingProgress, check_frames, reader, readers, sample, sample_one,
    sample_side_by_side, unwatched, variation_seed,
};
