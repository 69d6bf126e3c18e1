//! Parts that commands and demos share: arguments, messages, files, and the end of a call.

pub mod args;
pub mod files;
pub mod lines;
mod message;
pub mod ours;
pub mod outcome;
pub mod progress;
pub mod say;
pub mod training;
mod wait;

pub use args::{BranchArgs, CheckpointArg, ComputeArgs, ForceArgs, ReadingArgs, TrustArgs};
pub use files::{
    draw_charts, each_file, extension, motion_files, page, picture, reported, with_extensions, writable, writable_into,
    written_as,
};
pub(crate) use outcome::wrong_call;
pub use outcome::{WrongCall, chain};
pub use say::{Odd, Say, print, tell, warn};
