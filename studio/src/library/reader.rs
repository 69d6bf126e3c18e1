//! The studio's side of the process that reads a file ([`super::child`]).

use super::child::{Job, Limits, Work, derived_of, figure_of};
use super::derive::{self, Derived};
use super::doubts::Outcome;
use super::figure::Wanted;
use crate::project::document::Reading;
use crate::{Error, Result};
use kinelm_store::owned;
use kinelm_store::part::folder_of;
use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Reads files, each in a process of its own.
#[derive(Debug, Clone)]
pub struct Reader {
    /// The program, which then calls [`super::child::read_file`].
    pub program: PathBuf,
    /// Its arguments.
    pub args: Vec<OsString>,
    /// Its environment, beside this process's.
    pub env: Vec<(OsString, OsString)>,
    /// The limits of the process.
    pub limits: Limits,
}

/// The most bytes of an answer: a figure of 8 million poses of a joint takes 8 bytes for each coordinate.
const MOST_BYTES: u64 = 256 << 20;

/// The bytes of a cached outcome; `None` if there is no such file.
pub(super) fn read_cached(path: &Path) -> Option<Vec<u8>> {
    owned::bytes(folder_of(path), path.file_name()?, MOST_BYTES).ok()?
}

/// Ends the process where it isn't waited for.
struct Guarded(Child);

impl Drop for Guarded {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Reader {
    /// Reads a file. `convert` is where a clip of another format goes as a BVH, `out` the file of its
    /// outcome, which is removed afterwards.
    ///
    /// # Errors
    /// A process that can't be started; [`kinelm_store::Error::Stopped`] where `stop` is set. A process that crashes or
    /// takes too long is an outcome.
    pub fn read(
        &self,
        file: &Path,
        reading: &Reading,
        convert: &Path,
        out: &Path,
        stop: &AtomicBool,
    ) -> Result<Outcome> {
        let work = Work::Facts { reading: Box::new(reading.clone()), convert: convert.into() };
        let (found, status) = self.answer(file, work, out, stop)?;
        let found = found.and_then(|bytes| serde_json::from_slice(&bytes).ok());
        if found.is_none() {
            // a BVH without its outcome would be half a clip
            let _ = std::fs::remove_file(convert);
        }
        Ok(found.unwrap_or_else(|| Outcome::Failed { text: self.why_none(file, status), doubts: Vec::new() }))
    }

    /// The figure of a clip as text; `out` is the file for it, which is removed afterwards.
    ///
    /// # Errors
    /// Those of [`Reader::read`], those of [`Wanted::text`], and a process that crashes or takes too long.
    pub fn figure(&self, file: &Path, wanted: Wanted, out: &Path, stop: &AtomicBool) -> Result<String> {
        self.made(file, Work::Figure(Box::new(wanted)), out, stop, figure_of)
    }

    /// A file that is made of others; `out` is the file for it, which is removed afterwards.
    ///
    /// # Errors
    /// Those of [`Reader::read`], those of [`derive::Wanted::made`], and a process that crashes or takes too long.
    pub fn derived(&self, file: &Path, wanted: derive::Wanted, out: &Path, stop: &AtomicBool) -> Result<Derived> {
        self.made(file, Work::Derived(Box::new(wanted)), out, stop, derived_of)
    }

    /// What a process makes, which `of` finds in its answer.
    fn made<T>(
        &self,
        file: &Path,
        work: Work,
        out: &Path,
        stop: &AtomicBool,
        of: fn(&[u8]) -> Option<Result<T>>,
    ) -> Result<T> {
        let (found, status) = self.answer(file, work, out, stop)?;
        found.as_deref().and_then(of).unwrap_or_else(|| Err(Error::Conflict(self.why_none(file, status))))
    }

    /// Runs a process and reads its answer. Returns its exit status too; `None` if it took too long.
    fn answer(
        &self,
        file: &Path,
        work: Work,
        out: &Path,
        stop: &AtomicBool,
    ) -> Result<(Option<Vec<u8>>, Option<ExitStatus>)> {
        let job = Job { file: file.into(), work, out: out.into(), limits: self.limits };
        // an earlier process that was killed may have left an answer to another job
        let _ = std::fs::remove_file(out);
        let status = self.run(&job, stop)?;
        let found = read_cached(out);
        let _ = std::fs::remove_file(out);
        Ok((found, status))
    }

    /// Why a process has left no answer.
    fn why_none(&self, file: &Path, status: Option<ExitStatus>) -> String {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let limits = format!("{} seconds and {} GB of memory", self.limits.seconds, self.limits.memory >> 30);
        match status {
            None => format!("{name} takes longer than {limits} to read; cut it into shorter ones"),
            Some(status) => format!(
                "{name} can't be read: its reader ended ({status}), as a damaged file may make it, or one that takes more \
                 than {limits}; export it again, or cut it into shorter ones"
            ),
        }
    }

    /// Runs the process to its end; `None` where it took too long and was ended.
    fn run(&self, job: &Job, stop: &AtomicBool) -> Result<Option<ExitStatus>> {
        let mut command = Command::new(&self.program);
        command.args(&self.args).envs(self.env.iter().map(|(name, value)| (name, value)));
        // one thread: the stacks of many would count as memory
        command.env("RAYON_NUM_THREADS", "1").env("RUST_BACKTRACE", "0");
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = Guarded(command.spawn().map_err(Error::io(&self.program))?);
        let text = serde_json::to_vec(job).map_err(Error::failed)?;
        if let Some(mut stdin) = child.0.stdin.take() {
            // on a thread of its own: a process that never reads would hold up the clock. It ends with the process, which
            // says below how that ended
            std::thread::spawn(move || drop(stdin.write_all(&text)));
        }
        let (begun, mut nap) = (Instant::now(), Duration::from_millis(2));
        loop {
            if let Some(status) = child.0.try_wait().map_err(Error::io(&self.program))? {
                return Ok(Some(status));
            }
            if stop.load(Ordering::Relaxed) {
                return Err(kinelm_store::Error::stopped("the studio ends").into());
            }
            // the limit of processor time doesn't end a process that sleeps
            if begun.elapsed() > Duration::from_secs(self.limits.seconds) {
                return Ok(None);
            }
            // most files take some milliseconds: short naps first
            std::thread::sleep(nap);
            nap = (nap * 2).min(Duration::from_millis(50));
        }
    }
}
