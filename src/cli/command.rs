//! The commands.

use super::*;
use crate::{bench, demo};
use clap::Parser;

/// Motion capture into text, a GPT on that text, new dances out of it.
#[derive(Debug, Parser)]
#[command(name = "kinelm", version, arg_required_else_help = true, propagate_version = true)]
pub struct Call {
    #[command(subcommand)]
    pub command: Command,
    /// Threads to use; all cores if not given
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Say only what went wrong, and nothing of how far a wait is
    #[arg(long, short, global = true)]
    pub quiet: bool,
}

#[derive(Debug, clap::Subcommand)]
pub enum Command {
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
    /// Timelines of several clips, for generate timeline
    #[command(subcommand)]
    Timeline(timeline::Command),
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

pub fn command(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Inspect(args) => inspect::run(args, say),
        Command::Convert(args) => convert::run(args, say),
        Command::Mirror(args) => mirror::run(args, say),
        Command::Timeline(command) => timeline::run(&command, say),
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
