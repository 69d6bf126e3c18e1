//! `kinelm studio`.

use super::values::run_folder;
use super::{CheckpointArg, Say, print};
use anyhow::{Context, Result};
use kinelm_motion::format::Format;
use kinelm_studio::{Error, Limits, Listen, Options, Reader, Server};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The project's folder, made if it isn't there [default: kinelm-studio]; then motion and music files, or folders
    /// of
    /// them, for its library. A file in the first place is one for the library
    #[arg(value_name = "PROJECT FILES")]
    paths: Vec<PathBuf>,
    /// The run folder of a trained model [default: ready, kinelm's own]
    #[arg(long, value_name = "RUN", value_parser = run_folder())]
    run: Option<PathBuf>,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    /// The corpus of real dances that the best of several are compared with [default: the run's, else the library's
    /// clips]
    #[arg(long, value_name = "CORPUS")]
    real: Option<PathBuf>,
    /// The port [default: a free one]
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    port: u16,
    /// Also answer under this name or address of the machine, to other machines too. Nothing is encrypted: a tunnel
    /// (ssh -L)
    /// is safer
    #[arg(long, value_name = "HOST")]
    bind: Vec<String>,
    /// Don't open a browser
    #[arg(long)]
    no_open: bool,
    /// A new project begins empty
    #[arg(long, hide = true)]
    empty: bool,
    /// Read the page's files from this folder
    #[arg(long, value_name = "DIR", hide = true)]
    assets: Option<PathBuf>,
}

/// The Python that runs this program, where one does: the package for Python sets it.
const PYTHON: &str = "KINELM_PYTHON";
/// Where a project is that isn't named.
const PROJECT: &str = "kinelm-studio";

pub fn run(args: Args, say: Say) -> Result<()> {
    let (project, files) = project(args.paths);
    let reader = reader()?;
    let checkpoint = args.checkpoint.get();
    let options = Options { project, run: args.run, checkpoint, files, real: args.real, reader, empty: args.empty };
    let listen = Listen { port: args.port, bind: args.bind, assets: args.assets };
    let server = Server::open(&options, &listen).map_err(of_library)?;
    if !listen.bind.is_empty() {
        let (hosts, port) =
            (listen.bind.join(", "), server.address().rsplit(':').next().unwrap_or_default().to_owned());
        say.line(format_args!(
            "warning: others can reach the studio under {hosts}, and nothing is encrypted: who listens on the network can take \
             part. Safer, without --bind: ssh -L {port}:127.0.0.1:{port} HOST"
        ));
    }
    print(&format!("kinelm studio: open {}\n", server.file().display()))?;
    let stopper = server.stopper();
    let stopped = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(false));
    let by_user = stopped.clone();
    // without it, Ctrl-C ends the process at once, which loses nothing either
    let _ = ctrlc::set_handler(move || {
        by_user.store(true, std::sync::atomic::Ordering::Relaxed);
        stopper.stop();
    });
    if !args.no_open && !open(server.file()) {
        say.line("no browser could be opened: open that file yourself");
    }
    server.run().map_err(of_library)?;
    match stopped.load(std::sync::atomic::Ordering::Relaxed) {
        true => Err(kinelm_store::Error::stopped("stopped; all that was kept is in the project's folder").into()),
        false => Ok(()),
    }
}

/// This program, as it reads files in a process of its own.
fn reader() -> Result<Reader> {
    let mut args: Vec<OsString> = Vec::new();
    let program = match std::env::var_os(PYTHON) {
        // the program is a module of Python's there
        Some(python) => {
            args.extend(["-m", "kinelm"].map(Into::into));
            python.into()
        }
        None => std::env::current_exe().context("this program isn't found, which reads files for the studio")?,
    };
    args.extend(["studio-read", "--threads", "1", "--quiet"].map(Into::into));
    Ok(Reader { program, args, env: Vec::new(), limits: Limits::default() })
}

/// Reads a file for the studio, in the process that it started.
pub fn read() -> Result<()> {
    kinelm_studio::read_file().map_err(of_library)
}

/// An error of the library, whose kind decides the exit code, as itself.
fn of_library(e: Error) -> anyhow::Error {
    match e {
        Error::Library(e) => e.into(),
        other => other.into(),
    }
}

/// The project and the files of a call.
fn project(mut paths: Vec<PathBuf>) -> (PathBuf, Vec<PathBuf>) {
    let is_file = |path: &PathBuf| path.is_file() || Format::of_name(path).is_some();
    match paths.first() {
        Some(first) if !is_file(first) => (paths.remove(0), paths),
        _ => (PROJECT.into(), paths),
    }
}

/// Opens a file in the user's browser; whether that could be begun.
fn open(file: &Path) -> bool {
    let mut command = if cfg!(windows) {
        let mut command = Command::new("cmd");
        command.args(["/C", "start", ""]);
        command
    } else {
        Command::new(if cfg!(target_os = "macos") { "open" } else { "xdg-open" })
    };
    command.arg(file).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    // it ends by itself, or with the browser
    command.spawn().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_in_the_first_place_is_no_project() {
        let of = |words: &[&str]| project(words.iter().map(PathBuf::from).collect());
        assert_eq!(of(&[]), (PROJECT.into(), vec![]));
        assert_eq!(of(&["mine", "a.bvh"]), ("mine".into(), vec!["a.bvh".into()]));
        assert_eq!(of(&["a.bvh", "b"]), (PROJECT.into(), vec!["a.bvh".into(), "b".into()]));
    }
}
