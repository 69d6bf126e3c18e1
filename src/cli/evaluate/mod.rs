//! `kinelm evaluate`.

mod baselines;
mod blind;
mod compare;
mod dance;
mod floors;
mod gaps;
mod likelihood;
mod music;
mod prediction;

use super::{Say, TrustArgs, wrong_call};
use crate::corpus::Corpus;
use crate::evaluate::dance::Dance;
use crate::evaluate::dance::prompt::PromptMetrics;
use crate::generate::provenance::{self, Provenance};
use anyhow::Result;
use kinelm_store::output::Outputs;
use kinelm_tokenizer::Tokenizer;
use std::path::Path;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Bits a frame of static models, fitted on train and measured on test: what any model has to get below
    Baselines(baselines::Args),
    /// Bits per frame of a trained model, next to the static floors of the same tokens
    Likelihood(likelihood::Args),
    /// Whether dances freeze, repeat themselves, respond to their prompts or copy, compared with real ones
    Dance(dance::Args),
    /// Ask people: which dance is real, better, or more like another
    #[command(subcommand)]
    Blind(blind::Command),
    /// How well a model fills gaps, compared with linear interpolation
    Gaps(gaps::Args),
    /// How well a model predicts the next 400 ms, compared with zero and constant velocity
    Prediction(prediction::Args),
}

/// Opens the corpus that `--real` names.
pub fn real_corpus(real: &Path, trust: TrustArgs) -> Result<Corpus> {
    if !real.join("corpus.json").exists() {
        wrong_call!("--real {}: no corpus.json; expected a corpus, as kinelm tokenize makes it", real.display());
    }
    Ok(trust.open(real)?)
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Baselines(args) => baselines::run(&args),
        Command::Likelihood(args) => likelihood::run(&args, say),
        Command::Dance(args) => dance::run(&args, say),
        Command::Blind(command) => blind::run(command, say),
        Command::Gaps(args) => gaps::run(&args, say),
        Command::Prediction(args) => prediction::run(&args, say),
    }
}

/// Dances that a page has room for.
pub const ON_PAGE: usize = 6;

/// Writes a page of the first of some dances.
pub fn write_page(out: &Path, page: &str, dances: usize, outputs: &Outputs, say: Say) -> Result<()> {
    outputs.write(out, page.as_bytes())?;
    if dances > ON_PAGE {
        say.line(format_args!("{}: the first {ON_PAGE} of {dances} dances", out.display()));
    }
    say.line(format_args!("{}: {} KB; open it in a browser", out.display(), page.len() / 1000));
    Ok(())
}

/// The provenance of a dance, from its sidecar; a wrong sidecar is reported.
pub fn provenance_of(path: &Path, say: Say) -> Option<Provenance> {
    provenance::find(path).unwrap_or_else(|e| {
        say.line(e);
        None
    })
}

/// How a dance responds to its prompt, if it has one; a prompt that can't be read is reported.
pub fn prompt_metrics(
    dance: &Dance,
    path: &Path,
    provenance: &Provenance,
    tokenizer: &Tokenizer,
    say: Say,
) -> Option<PromptMetrics> {
    PromptMetrics::measure(dance, path, provenance, tokenizer).unwrap_or_else(|e| {
        say.line(format_args!("{}: its prompt is not compared: {e}", path.display()));
        None
    })
}
