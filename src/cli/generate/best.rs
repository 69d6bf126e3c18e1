//! `kinelm generate --best N`.

use crate::cli::{Say, TrustArgs};
use crate::corpus::{Corpus, Split};
use crate::evaluate::dance::judge::Judge;
use crate::evaluate::dance::{Reference, real};
use crate::generate::best::Best;
use crate::generate::open::OpenRequest;
use crate::model::run::MADE;
use anyhow::Result;
use kinelm_tokenizer::Words;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct BestArgs {
    /// Sample N dances, 2 to 16, and write the best --variations of them: those that slide, sink and shake least beyond what
    /// real dances do, and neither freeze nor copy
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(2..=16), conflicts_with = "greedy")]
    pub best: Option<u8>,
    /// The corpus of real dances to compare with [default: the run's corpus of the largest weight]
    #[arg(long, value_name = "CORPUS")]
    real: Option<PathBuf>,
    /// Write all N, the best first
    #[arg(long, conflicts_with = "variations")]
    keep_all: bool,
}

impl BestArgs {
    /// Dances to write.
    pub fn written(&self, variations: u8) -> u8 {
        self.best.filter(|_| self.keep_all).unwrap_or(variations)
    }

    /// Opens the corpus of real dances, where the best is requested.
    pub fn reference(&self, open: &OpenRequest, say: Say) -> Result<Option<Corpus>> {
        if self.best.is_none() {
            return Ok(None);
        }
        let path = self.real.clone().map_or_else(|| real::corpus_of(&open.resolved.run), Ok)?;
        let corpus = real::open_for(&path, open, TrustArgs::default().opening())?;
        if path.ends_with(MADE) {
            say.line(
                "compared with dances that the model made itself, chosen beside real ones; --real compares with yours",
            );
        } else {
            if corpus.split(Split::Valid).next().is_none() {
                say.line("no validation clips: whether a dance is a copy isn't known");
            }
            say.line(format_args!("compared with the train clips of {}", path.display()));
        }
        Ok(Some(corpus))
    }
}

/// The best dances, as many as `outs`, best first: the number of each and what was found of it, which is reported.
pub fn choose(
    corpus: &Corpus,
    open: &OpenRequest,
    dances: &[Words],
    outs: &[PathBuf],
    say: Say,
) -> Result<Vec<(usize, Best)>> {
    let real = Reference::load(corpus)?;
    let judge = Judge::new(&real, open.free_spans())?;
    let chosen = judge.best(open, dances, &outs[0], outs.len())?;
    let words: Vec<&Words> = chosen.iter().map(|(i, _)| &dances[*i]).collect();
    let bits = open.bits_per_frame(&words).unwrap_or_else(|e| {
        say.line(format_args!("their likelihood isn't known: {e}"));
        Vec::new()
    });
    let of = dances.len();
    for (n, (i, best)) in chosen.iter().enumerate() {
        let bits = bits.get(n).map(|bits| format!("; {bits:.1} bits/frame under its model")).unwrap_or_default();
        say.line(format_args!("number {} of {of}, {}{bits}", i + 1, best.verdict));
    }
    if let Some(doubt) = chosen.first().and_then(|(_, best)| best.verdict.doubt()) {
        say.line(format_args!("warning: none of {of} dances is free of faults; of the best one {doubt}"));
    }
    Ok(chosen)
}
