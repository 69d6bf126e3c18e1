//! The commands.

use super::*;
use crate::demo;
use clap::Parser;

/// Motion capture into text, a GPT on that text, new dances out of it.
#[derive(Debug, Parser)]
#[command(name = "kinelm", version, arg_required_else_help = true, propagate_version = true)]
pub struct Call {
    #[command(subcommand)]
    pub command: Command,
    /// Threads to use [default: all cores]
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Print errors only: no progress, no notes
    #[arg(long, short, global = true)]
    pub quiet: bool,
}

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Report what motion files contain and what looks wrong in them
    Inspect(inspect::Args),
    /// Convert motion files to another format, rate or rig
    Convert(convert::Args),
    /// Write a self-contained page that plays clips side by side
    View(view::Args),
    /// Fit a tokenizer; encode clips as words and decode words
    #[command(subcommand)]
    Tokenizer(tokenizer::Command),
    /// Encode motion files as a corpus of tokens
    Tokenize(tokenize::Args),
    /// Report, clean, merge and order corpora
    #[command(subcommand)]
    Corpus(corpus::Command),
    /// Print built-in settings
    #[command(subcommand)]
    Config(config::Command),
    /// Train a model on a corpus
    Pretrain(pretrain::Args),
    /// List training runs and plot their curves
    #[command(subcommand)]
    Runs(runs::Command),
    /// Fine-tune the model of another run, with more conditions if the clips have labels for them
    Finetune(finetune::Args),
    /// Teach kinelm's own model your dances: tokenize and finetune in one call
    Tune(tune::Args),
    /// Find a learning rate: train for a few hundred steps at growing rates until the loss diverges, and plot it
    LrFind(lr_find::Args),
    /// Generate dances, from nothing or from parts of a clip
    Generate(Box<generate::Args>),
    /// Make a dance again, to the same bytes, from the sidecar beside it
    Again(again::Args),
    /// Make dances in the browser: a library, a stage, a timeline, variations to choose from
    #[cfg(feature = "studio")]
    Studio(studio::Args),
    /// Read a file for the studio, with limits; what to read is on the standard input
    #[cfg(feature = "studio")]
    #[command(hide = true)]
    StudioRead,
    /// Name the dancer, the genre or another label of a dance
    #[command(subcommand)]
    Classify(classify::Command),
    /// Write a trained model as a folder for other programs
    Export(export::Args),
    /// Make a run of such a folder
    Import(import::Args),
    /// Compare a student with a teacher: how far apart, how late, how fast, and where they differ most
    Compare(compare::Args),
    /// Blend two dances: move the rotations of one until its spectrum lies between both
    Interpolate(interpolate::Args),
    /// Remove fast movements from clips
    Filter(filter::Args),
    /// Mirror clips, left for right
    Mirror(mirror::Args),
    /// Plot the spectra of a clip
    Spectrum(spectrum::Args),
    /// Inspect music files, find their beats, render a piece
    #[command(subcommand)]
    Music(music::Command),
    /// Measure corpora, models and dances
    #[command(subcommand)]
    Evaluate(evaluate::Command),
    /// Search a collection of dances for similar movement
    #[command(subcommand)]
    Query(query::Command),
    /// The auto-conditioned LSTM, a baseline for the GPT
    #[command(subcommand)]
    Aclstm(aclstm::Command),
    /// The music-to-dance LSTM, a baseline for the GPT
    #[command(subcommand)]
    MusicLstm(music_lstm::Command),
    /// Dance with kinelm's own model; or, with --train, run the whole pipeline on synthetic dances
    Demo(demo::Args),
    /// Print a script that completes commands and flags in a shell
    Completions(completions::Args),
}

pub fn command(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Inspect(args) => inspect::run(args, say),
        Command::Convert(args) => convert::run(args, say),
        Command::Mirror(args) => mirror::run(args, say),
        Command::Again(args) => again::run(&args, say),
        #[cfg(feature = "studio")]
        Command::Studio(args) => studio::run(args, say),
        #[cfg(feature = "studio")]
        Command::StudioRead => studio::read(),
        Command::View(args) => view::run(args, say),
        Command::Tokenizer(command) => tokenizer::run(command, say),
        Command::Tokenize(args) => tokenize::run(args, say),
        Command::Corpus(command) => corpus::run(command, say),
        Command::Config(command) => config::run(&command),
        Command::Pretrain(args) => pretrain::run(args, say),
        Command::Runs(command) => runs::run(command, say),
        Command::Finetune(args) => finetune::run(args, say),
        Command::Tune(args) => tune::run(args, say),
        Command::Classify(command) => classify::run(command, say),
        Command::LrFind(args) => lr_find::run(args, say),
        Command::Generate(args) => generate::run(*args, say),
        Command::Export(args) => export::run(args, say),
        Command::Import(args) => import::run(args, say),
        Command::Compare(args) => compare::run(args, say),
        Command::Interpolate(args) => interpolate::run(args, say),
        Command::Filter(args) => filter::run(args, say),
        Command::Spectrum(args) => spectrum::run(&args, say),
        Command::Music(command) => music::run(command, say),
        Command::Evaluate(command) => evaluate::run(command, say),
        Command::Query(command) => query::run(command, say),
        Command::Aclstm(command) => aclstm::run(command, say),
        Command::MusicLstm(command) => music_lstm::run(command, say),
        Command::Demo(args) => demo::run(args, say),
        Command::Completions(args) => completions::run(&args),
    }
}
