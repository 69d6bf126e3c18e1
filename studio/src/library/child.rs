//! The process that reads a file: `kinelm studio-read`, started by the studio for each file of the library, and for
//! each figure of one.
//!
//! Some parsers are C code, and any parser may take all memory or never end on a file that is made for it. In a process
//! of its own, with limits, that is an error of one file, and the memory of a long clip goes back to the system
//! afterwards. Only Linux limits its memory; on systems that aren't Unix, the clock is the only limit.

use super::derive::{self, Derived};
use super::doubts::{Outcome, outcome};
use super::figure::Wanted;
use crate::project::document::Reading;
use crate::{Error, Result};
use kinelm_store::files;
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::path::PathBuf;

/// Bytes of a job's text.
const MOST_BYTES: u64 = 1 << 20;

/// A job of the process, on its standard input.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Job {
    /// The file.
    pub file: PathBuf,
    /// What is made of it.
    pub work: Work,
    /// The file for the answer.
    pub out: PathBuf,
    /// The limits.
    pub limits: Limits,
}

/// The facts of a file, its figure, or another file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Work {
    /// The facts for the library: the answer is an [`Outcome`].
    Facts {
        /// The user's own statements about it.
        reading: Box<Reading>,
        /// The file for the BVH of a clip of another format.
        convert: PathBuf,
    },
    /// The figure for the stage: the answer is for [`figure_of`].
    Figure(Box<Wanted>),
    /// Another file: the answer is for [`derived_of`].
    Derived(Box<derive::Wanted>),
}

/// The first line of an answer that is there.
const MADE: &[u8] = b"made\n";
/// The first line of an answer with the reason why there is none.
const NONE: &[u8] = b"none\n";

/// What was made, or the reason why it wasn't.
fn made_of(answer: &[u8]) -> Option<Result<&[u8]>> {
    match (answer.strip_prefix(MADE), answer.strip_prefix(NONE)) {
        (Some(made), _) => Some(Ok(made)),
        (_, Some(why)) => Some(Err(Error::Conflict(str::from_utf8(why).ok()?.to_owned()))),
        _ => None,
    }
}

/// The text of a figure, or the reason why there is none, from an answer to [`Work::Figure`].
pub fn figure_of(answer: &[u8]) -> Option<Result<String>> {
    made_of(answer)?.map(|made| String::from_utf8(made.to_vec()).ok()).transpose()
}

/// A file, or the reason why there is none, from an answer to [`Work::Derived`].
pub fn derived_of(answer: &[u8]) -> Option<Result<Derived>> {
    let parsed = |made: &[u8]| {
        let line = made.iter().position(|byte| *byte == b'\n')?;
        let to_stage = serde_json::from_slice(&made[..line]).ok()?;
        Some(Derived { to_stage, bytes: made[line + 1..].to_vec() })
    };
    made_of(answer)?.map(parsed).transpose()
}

/// The limits of the process.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Bytes of address space.
    pub memory: u64,
    /// Seconds of a processor, and of the clock.
    pub seconds: u64,
    /// Bytes of a file that it writes.
    pub file: u64,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits { memory: 4 << 30, seconds: 120, file: 2 << 30 }
    }
}

/// Reads the file of the job on the standard input.
///
/// # Errors
/// A text that isn't a job; an answer that can't be written. Faults of the file are an answer.
pub fn read_file() -> Result<()> {
    let mut text = String::new();
    std::io::stdin().take(MOST_BYTES).read_to_string(&mut text).map_err(Error::io("standard input"))?;
    let wrong = |e: serde_json::Error| Error::invalid("the standard input", e, "a job that the studio wrote");
    let job: Job = serde_json::from_str(&text).map_err(wrong)?;
    // before the file is opened: the job's text is the studio's own
    limit(job.limits)?;
    // a panic is an error of this file too; its own text goes to a closed stderr
    let answer = match &job.work {
        Work::Facts { reading, convert } => {
            let found = Error::of_panics(|| Ok(outcome(&job.file, reading, convert)));
            serde_json::to_vec(&found.unwrap_or_else(|e| Outcome::failed(&e))).map_err(Error::failed)?
        }
        Work::Figure(wanted) => made(Error::of_panics(|| wanted.text(&job.file)).map(String::into_bytes)),
        Work::Derived(wanted) => made(Error::of_panics(|| {
            let Derived { bytes, to_stage } = wanted.made(&job.file)?;
            let line = serde_json::to_vec(&to_stage).map_err(Error::failed)?;
            Ok([&line[..], b"\n", &bytes].concat())
        })),
    };
    Ok(files::write_whole(&job.out, &answer)?)
}

/// The answer of work.
fn made(work: Result<Vec<u8>>) -> Vec<u8> {
    match work {
        Ok(made) => [MADE, &made].concat(),
        Err(e) => [NONE, e.to_string().as_bytes()].concat(),
    }
}

/// Holds this process to limits, where the system can.
#[cfg(unix)]
fn limit(limits: Limits) -> Result<()> {
    use nix::sys::resource::{Resource, getrlimit, setrlimit};
    let set = |resource: Resource, most: u64| {
        // never above the limit that is set already: raising it is refused
        let (_, hard) = getrlimit(resource).map_err(std::io::Error::from)?;
        let most = most.min(hard);
        setrlimit(resource, most, most).map_err(std::io::Error::from)
    };
    let all = || {
        // a crash is expected here, and a core dump could have 4 GB
        set(Resource::RLIMIT_CORE, 0)?;
        set(Resource::RLIMIT_CPU, limits.seconds)?;
        set(Resource::RLIMIT_FSIZE, limits.file)?;
        // a file, its sidecar and skeleton, the answer
        set(Resource::RLIMIT_NOFILE, 64)?;
        // macOS has the limit and ignores it
        if cfg!(target_os = "linux") { set(Resource::RLIMIT_AS, limits.memory) } else { Ok(()) }
    };
    all().map_err(Error::io("limits of the process"))
}

/// Other systems have no such limits; the clock's is the parent's.
#[cfg(not(unix))]
fn limit(_: Limits) -> Result<()> {
    Ok(())
}
