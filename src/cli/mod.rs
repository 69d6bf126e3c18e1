//! The command line: one file a command. Arguments in, one library call, text out.
//!
//! Only here are there `anyhow`, printing and environment variables. Data go to stdout, everything else to stderr.

mod aclstm;
mod bench;
mod classify;
mod clean;
mod config;
mod convert;
mod corpus;
mod data;
mod demo;
mod draw;
mod evaluate;
mod export;
mod filter;
mod finetune;
mod fit;
mod generate;
mod import;
mod inspect;
mod interpolate;
mod lr_find;
mod many;
mod mirror;
mod music;
mod music_lstm;
mod ours;
mod plan;
mod pretrain;
mod progress;
mod query;
mod read;
mod runs;
mod spectrum;
mod study;
mod tokenize;
mod tokenizer;
mod updates;
mod view;
mod view_files;

use anyhow::{Error, Result};
use clap::Parser;
use kinelm::corpus::{Corpus, Opening};
use kinelm::model::{Compute, DeviceName, Form, Reading};
use kinelm::view::plot;
use kinelm_engine::arena::NoMemory;
use kinelm_engine::decode::{KvKind, WeightKind};
use kinelm_motion::convert::{Rig, Wanted, convert};
use kinelm_motion::inspect::{RateDoubt, RateDoubts};
use kinelm_motion::{Motion, smpl};
use kinelm_store::output::Outputs;
use std::borrow::Cow;
use std::cell::RefCell;
use std::io::{IsTerminal, Write};
use std::panic::{AssertUnwindSafe, resume_unwind};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Motion capture into text, a GPT on that text, new dances out of it.
#[derive(Debug, Parser)]
#[command(name = "kinelm", version, arg_required_else_help = true, propagate_version = true)]
pub struct Call {
    #[command(subcommand)]
    command: Command,
    /// Threads to use; all cores if not given
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Say only what went wrong, and nothing of how far a wait is
    #[arg(long, short, global = true)]
    quiet: bool,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// What motion files hold, and what looks wrong in them
    Inspect(inspect::Args),
    /// From one motion format, rate or rig to another, by the extensions: .bvh .npz .pkl .json in, .bvh .npz .json out
    Convert(convert::Args),
    /// A self-contained page to watch clips on, side by side
    View(view::Args),
    /// Fit a tokenizer; clips to words and back
    #[command(subcommand)]
    Tokenizer(tokenizer::Command),
    /// Motion files to a corpus of tokens
    Tokenize(tokenize::Args),
    /// What a corpus holds; pieces of one put together
    #[command(subcommand)]
    Corpus(corpus::Command),
    /// The settings that are built in
    #[command(subcommand)]
    Config(config::Command),
    /// Train a model on a corpus
    Pretrain(pretrain::Args),
    /// Training runs: which there are, and their curves
    #[command(subcommand)]
    Runs(runs::Command),
    /// Train on from another run's weights, with more labels if the clips have them
    Finetune(finetune::Args),
    /// A learning rate for a model: a few hundred steps at rates that grow until the loss blows up, as a plot
    LrFind(lr_find::Args),
    /// A new dance that follows chosen joints of a clip
    Generate(Box<generate::Args>),
    /// Plans of dances made of several clips
    #[command(subcommand)]
    Plan(plan::Command),
    /// Name dancer, genre or any other label of a dance
    #[command(subcommand)]
    Classify(classify::Command),
    /// A trained model as a folder that other programs read
    Export(export::Args),
    /// Such a folder as a run
    Import(import::Args),
    /// A dance drawn towards another: its rotations moved until their spectrum lies between
    Interpolate(interpolate::Args),
    /// Clips without their fast movements
    Filter(filter::Args),
    /// Clips as they are seen in a mirror, left for right
    Mirror(mirror::Args),
    /// Pictures of a clip's spectra
    Spectrum(spectrum::Args),
    /// Music: what a file holds, and its beats
    #[command(subcommand)]
    Music(music::Command),
    /// Measures
    #[command(subcommand)]
    Evaluate(evaluate::Command),
    /// Search in a collection of dances: what else moves like this
    #[command(subcommand)]
    Query(query::Command),
    /// The auto-conditioned LSTM, a baseline beside the GPT
    #[command(subcommand)]
    Aclstm(aclstm::Command),
    /// The music-to-dance dissertation's system, a baseline beside the GPT
    #[command(subcommand)]
    MusicLstm(music_lstm::Command),
    /// How fast this machine does what the program does
    #[command(subcommand)]
    Bench(bench::Command),
    /// The whole way on made-up dances: no data, no network, three minutes
    Demo(demo::Args),
}

/// Where and how a model computes.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct ComputeArgs {
    /// The processor, or the Nvidia card of this number (where kinelm was built with CUDA)
    #[arg(long, value_name = "cpu|cuda:N", default_value = "cpu")]
    device: DeviceName,
    /// The fastest form of the model that the device has, or the plain one that it is compared with
    #[arg(long, value_name = "auto|plain", default_value = "auto", hide_short_help = true)]
    form: Form,
}

impl ComputeArgs {
    /// As the library has it.
    pub fn get(self) -> Compute {
        Compute { device: self.device, form: self.form }
    }
}

/// How corpora are opened.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct TrustArgs {
    /// Neither hash a corpus's files nor look through its tokens when it is opened, which takes long for many hours: they
    /// are as they were written
    #[arg(long)]
    trust: bool,
}

impl TrustArgs {
    /// Of a corpus that is read again and again: in memory, where there is room.
    pub fn opening(self) -> Opening {
        Opening { trust: self.trust, streamed: false, tell: progress::stage }
    }

    /// A corpus that is read clip by clip.
    ///
    /// # Errors
    /// Those of [`Corpus::open_with`].
    pub fn open(self, dir: &Path) -> kinelm::Result<Corpus> {
        Ok(Corpus::open_with(dir, Opening { streamed: true, ..self.opening() })?)
    }
}

/// How a model is read, token after token.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct ReadingArgs {
    /// How the weights are held: as they are, or as bytes with a scale a column, which is faster where memory
    /// limits and has cost less than 0.01 % of the bits a frame
    #[arg(long, value_enum, default_value = "f32")]
    weights: WeightsArg,
    /// How keys and values of what was read are held: as they are, or as half floats,
    /// which has cost less than 0.01 % of the bits a frame
    #[arg(long, value_enum, default_value = "f32")]
    kv: KvArg,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum WeightsArg {
    F32,
    Int8,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum KvArg {
    F32,
    F16,
}

impl ReadingArgs {
    /// As the library has it, for so many sequences.
    pub fn get(self, streams: usize) -> Reading {
        let weights = match self.weights {
            WeightsArg::F32 => WeightKind::F32,
            WeightsArg::Int8 => WeightKind::Int8,
        };
        let kv = match self.kv {
            KvArg::F32 => KvKind::F32,
            KvArg::F16 => KvKind::F16,
        };
        Reading { streams, weights, kv }
    }
}

/// What a command that writes may write over.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct ForceArgs {
    /// Replace what stands at an output and isn't this program's own beyond doubt; never a file that the call reads
    #[arg(long)]
    pub force: bool,
}

impl ForceArgs {
    /// The outputs of a call that reads these files and folders.
    pub fn outputs(self, inputs: impl IntoIterator<Item = impl Into<PathBuf>>) -> Outputs {
        Outputs::new(ours::OURS, inputs, self.force)
    }
}

/// Bytes of stack of a thread that computes: what a program's first thread has.
const STACK: usize = 8 << 20;

/// Runs one call.
pub fn run(call: Call) -> Result<()> {
    kernels_asked_for()?;
    let mut pool = rayon::ThreadPoolBuilder::new().stack_size(STACK);
    if let Some(n) = call.threads {
        pool = pool.num_threads(n.into());
    }
    pool.build_global()?;
    let say = Say { quiet: call.quiet };
    progress::tell_of_waits(say);
    // on a thread of the pool: from outside, every parallel step would wake its threads anew and wait for them asleep
    let work = || rayon::scope(|_| command(call.command, say).and_then(|()| all_read()));
    std::panic::catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| match payload.downcast::<NoMemory>() {
        Ok(none) => Err(Error::new(*none).context("memory ran out; a smaller model, batch or context takes less")),
        Err(other) => resume_unwind(other),
    })
}

/// Refuses kernels that have no such name.
fn kernels_asked_for() -> Result<()> {
    use kinelm_engine::dispatch::{NAMES, VARIABLE};
    match std::env::var(VARIABLE) {
        Ok(name) if !NAMES.contains(&name.as_str()) => {
            let what = format!("{VARIABLE} is {name:?}; expected one of {}, or nothing", NAMES.join(", "));
            Err(WrongCall(what).into())
        }
        _ => Ok(()),
    }
}

fn command(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Inspect(args) => inspect::run(args, say),
        Command::Convert(args) => convert::run(args, say),
        Command::Mirror(args) => mirror::run(args, say),
        Command::Plan(command) => plan::run(&command, say),
        Command::View(args) => view::run(args, say),
        Command::Tokenizer(command) => tokenizer::run(command, say),
        Command::Tokenize(args) => tokenize::run(args, say),
        Command::Corpus(command) => corpus::run(command, say),
        Command::Config(command) => config::run(&command),
        Command::Pretrain(args) => pretrain::run(args, say),
        Command::Runs(command) => runs::run(command, say),
        Command::Finetune(args) => finetune::run(args, say),
        Command::Classify(command) => classify::run(command, say),
        Command::LrFind(args) => lr_find::run(args, say),
        Command::Generate(args) => generate::run(*args, say),
        Command::Export(args) => export::run(args, say),
        Command::Import(args) => import::run(args, say),
        Command::Interpolate(args) => interpolate::run(args, say),
        Command::Filter(args) => filter::run(args, say),
        Command::Spectrum(args) => spectrum::run(&args, say),
        Command::Music(command) => music::run(command, say),
        Command::Evaluate(command) => evaluate::run(command, say),
        Command::Query(command) => query::run(command, say),
        Command::Aclstm(command) => aclstm::run(command, say),
        Command::MusicLstm(command) => music_lstm::run(command, say),
        Command::Bench(command) => bench::run(command, say),
        Command::Demo(args) => demo::run(args, say),
    }
}

/// The call was wrong in a way that the parser can't see: exit code 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct WrongCall(pub String);

/// What the library refuses in the words of a call is a wrong call.
pub fn asked(e: impl Into<kinelm::Error>) -> Error {
    match e.into() {
        kinelm::Error::Store(kinelm_store::Error::Call(what))
        | kinelm::Error::Motion(kinelm_motion::Error::Call(what)) => WrongCall(what).into(),
        e => e.into(),
    }
}

/// The user stopped the work with Ctrl-C; what is done is saved: exit code 130, as a shell has it. Work that can't be saved
/// half done ends in [`kinelm::Error::Stopped`].
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Stopped(pub String);

/// Whether the user broke the work off.
pub fn is_stopped(e: &anyhow::Error) -> bool {
    e.is::<Stopped>() || matches!(of_store(e.as_ref()), Some(kinelm_store::Error::Stopped(_)))
}

/// The extension of a motion file to write; refuses, before any work, what no motion is written as.
pub fn writable(path: &Path) -> Result<String> {
    let extension = extension(path);
    if !["bvh", "npz", "json", "glb"].contains(&extension.as_str()) {
        let what = format!("{}: expected a name ending in .bvh, .npz, .json or .glb", path.display());
        return Err(WrongCall(what).into());
    }
    Ok(extension)
}

/// Does something with each file and its number; one that fails is told and doesn't keep the others from it, but a single
/// file's error is the call's.
pub fn each_file(
    files: &[PathBuf],
    failed_what: &str,
    say: Say,
    mut each: impl FnMut(usize, &Path) -> Result<()>,
) -> Result<()> {
    let mut failed = 0;
    for (i, file) in files.iter().enumerate() {
        if let Err(e) = each(i, file).map_err(|e| of_file(file, e)) {
            if files.len() == 1 {
                return Err(e);
            }
            failed += 1;
            say.error(chain(&e));
        }
    }
    anyhow::ensure!(failed == 0, "{failed} of {} {failed_what}", files.len());
    Ok(())
}

/// A motion on the rig that its format is written for: an .npz is on SMPL's.
pub fn written_as(out: &Path, motion: Motion, map: Option<&str>) -> Result<Motion> {
    if extension(out) != "npz" {
        return Ok(motion);
    }
    let wanted = Wanted { rig: Some(Rig::Smpl(smpl::neutral())), ..Wanted::default() };
    Ok(convert(motion, &wanted, map)?)
}

/// What came of each file that could be read, with its number; the others are named and left out. Where none could be, or the
/// only one couldn't, its error is the call's.
pub fn readable<T>(results: impl IntoIterator<Item = Result<T>>, say: Say) -> Result<Vec<(usize, T)>> {
    let (mut kept, mut errors) = (Vec::new(), Vec::new());
    for (i, result) in results.into_iter().enumerate() {
        match result {
            Ok(one) => kept.push((i, one)),
            Err(e) => errors.push(e),
        }
    }
    if kept.is_empty() && !errors.is_empty() {
        return Err(errors.remove(0));
    }
    errors.iter().for_each(|e| say.left_out(chain(e)));
    Ok(kept)
}

/// An error that names the file that it is about.
fn of_file(path: &Path, e: anyhow::Error) -> anyhow::Error {
    let path = path.display().to_string();
    match chain(&e).starts_with(&path) || e.is::<WrongCall>() {
        true => e,
        false => e.context(path),
    }
}

/// Refuses a page under another name than a page's, before any work.
pub fn page(path: &Path) -> Result<()> {
    if extension(path) != "html" {
        return Err(WrongCall(format!("{}: expected a name ending in .html for a page", path.display())).into());
    }
    Ok(())
}

/// Refuses a picture under another name than a picture's, and what must not be written over, before any work.
pub fn picture(path: &Path, outputs: &Outputs) -> Result<()> {
    plot::check(path).map_err(|e| WrongCall(e.to_string()))?;
    Ok(outputs.check([path])?)
}

/// Draws charts into a file; nothing where there is nothing to draw.
pub fn draw_charts(path: &Path, charts: &[plot::Chart], outputs: &Outputs) -> Result<()> {
    if let Some(bytes) = plot::to_bytes(path, charts)? {
        outputs.write(path, &bytes)?;
    }
    Ok(())
}

/// Files that were left out of what the call did with all others.
static LEFT_OUT: AtomicUsize = AtomicUsize::new(0);

/// The end of a call that has done what it could: a failure if files were left out.
fn all_read() -> Result<()> {
    let left_out = LEFT_OUT.load(Ordering::Relaxed);
    anyhow::ensure!(left_out == 0, "{} could not be read; the rest is done", kinelm_store::counted(left_out, "files"));
    Ok(())
}

/// Prints what is not data on stderr.
#[derive(Debug, Clone, Copy)]
pub struct Say {
    quiet: bool,
}

impl Say {
    /// One line, unless `--quiet`.
    pub fn line(self, text: impl std::fmt::Display) {
        if !self.quiet {
            self.error(text);
        }
    }

    /// One line, always.
    pub fn error(self, text: impl std::fmt::Display) {
        tell(text);
        progress::said();
    }

    /// Names a file that is left out of what is done with the others; in the end the call has failed.
    pub fn left_out(self, text: impl std::fmt::Display) {
        LEFT_OUT.fetch_add(1, Ordering::Relaxed);
        self.error(text);
    }

    /// Whether `--quiet` was given.
    pub fn quiet(self) -> bool {
        self.quiet
    }
}

/// A line on stderr, of a length that can be read.
pub fn tell(text: impl std::fmt::Display) {
    let text = text.to_string();
    // a closed stderr is no reason to stop
    let _ = writeln!(std::io::stderr(), "kinelm: {}", plain(&clipped(&text)));
}

/// The characters of a message at most: what a file or a call holds may be quoted in it, whatever its length.
const LONGEST: usize = 8000;

/// A message without its middle, where it is too long.
fn clipped(text: &str) -> Cow<'_, str> {
    let characters = text.chars().count();
    if characters <= LONGEST {
        return Cow::Borrowed(text);
    }
    let at = |n: usize| text.char_indices().nth(n).map_or(text.len(), |(at, _)| at);
    let (head, tail) = (&text[..at(LONGEST / 2)], &text[at(characters - LONGEST / 2)..]);
    Cow::Owned(format!("{head} .. ({} characters) .. {tail}", characters - LONGEST))
}

/// Says what the parser says, help among it: done where help was asked for and could be written, else a wrong call.
pub fn refused(e: clap::Error) -> ExitCode {
    match e.print() {
        _ if e.use_stderr() => ExitCode::from(2),
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            tell(format_args!("help can't be written: {e}"));
            ExitCode::FAILURE
        }
        _ => ExitCode::SUCCESS,
    }
}

/// A text without what a terminal would take as an order: control characters out of names and files.
pub fn plain(text: &str) -> Cow<'_, str> {
    let is_order = |c: char| c.is_control() && !matches!(c, '\n' | '\t');
    if !text.contains(is_order) {
        return Cow::Borrowed(text);
    }
    let one = |c: char| if is_order(c) { c.escape_default().to_string() } else { c.to_string() };
    Cow::Owned(text.chars().map(one).collect())
}

/// The error of a call that the parser refused, which shows words of the call: of the same call with its control
/// characters written out, as the error's own colours are control characters too.
pub fn told_plain(e: clap::Error) -> clap::Error {
    let words = std::env::args_os().map(|word| plain(&word.to_string_lossy()).into_owned());
    let is_odd = |word: std::ffi::OsString| matches!(plain(&word.to_string_lossy()), Cow::Owned(_));
    match std::env::args_os().any(is_odd) {
        true => Call::try_parse_from(words).err().unwrap_or(e),
        false => e,
    }
}

/// Says what was odd in a file that was read all the same.
pub fn warn(motion: &Motion, say: Say) {
    Odd::new(say).warn(motion);
}

/// What was odd in the files of a call: said file by file, but the doubts of their rates in one line at the end.
pub struct Odd {
    say: Say,
    doubts: RefCell<RateDoubts>,
}

impl Odd {
    /// Of no file yet.
    pub fn new(say: Say) -> Odd {
        Odd { say, doubts: RefCell::default() }
    }

    /// Says what was odd in a file as it was read.
    pub fn warn(&self, motion: &Motion) {
        let path = motion.path.display();
        for warning in motion.warnings.iter().filter(|warning| !RateDoubt::is_warning(warning)) {
            self.say.line(format_args!("{path}: {warning}"));
        }
        self.doubt(&path.to_string(), RateDoubt::in_reading(motion));
    }

    /// A file and the doubt of its rate.
    pub fn doubt(&self, name: &str, doubt: Option<RateDoubt>) {
        self.doubts.borrow_mut().add(name, doubt);
    }
}

impl Drop for Odd {
    fn drop(&mut self) {
        self.doubts.borrow().line().iter().for_each(|line| self.say.line(line));
    }
}

/// Writes data to stdout; a terminal gets it [`plain`].
pub fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    let text = if out.is_terminal() { plain(text) } else { Cow::Borrowed(text) };
    out.write_all(text.as_bytes())?;
    Ok(out.flush()?)
}

/// Whether the call was wrong, not the work: what it asks for, or where it would write.
pub fn is_wrong_call(e: &Error) -> bool {
    use kinelm_motion::Error as Motion;
    let is_option = |e: &(dyn std::error::Error + 'static)| match e.downcast_ref::<kinelm::Error>() {
        Some(kinelm::Error::Motion(e)) => matches!(e, Motion::Option { .. }),
        _ => {
            matches!(e.downcast_ref(), Some(kinelm::corpus::Error::Motion(Motion::Option { .. })))
                || matches!(e.downcast_ref(), Some(Motion::Option { .. }))
        }
    };
    let is_taken = |e| matches!(of_store(e), Some(kinelm_store::Error::Taken { .. }));
    e.is::<WrongCall>() || e.chain().any(|e| is_option(e) || is_taken(e))
}

/// The error of the files that an error of the library is.
fn of_store<'a>(e: &'a (dyn std::error::Error + 'static)) -> Option<&'a kinelm_store::Error> {
    match e.downcast_ref::<kinelm::Error>() {
        Some(kinelm::Error::Store(e)) => Some(e),
        _ => match e.downcast_ref() {
            Some(kinelm::corpus::Error::Store(e)) => Some(e),
            _ => e.downcast_ref(),
        },
    }
}

/// Whether the reader of stdout closed it.
pub fn is_broken_pipe(e: &Error) -> bool {
    e.downcast_ref::<std::io::Error>().is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
}

/// An error with its causes in one line, each said once.
pub fn chain(e: &Error) -> String {
    let mut text = String::new();
    for cause in e.chain().map(|c| c.to_string()) {
        if text.is_empty() {
            text = cause;
        } else if !text.ends_with(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

/// The extension of a path, lower case, empty if it has none.
pub fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}
