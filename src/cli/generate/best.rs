//! `kinelm generate --best N`.

use crate::cli::{Say, TrustArgs};
use crate::evaluate::dance::real::{RealDances, corpus_of};
use crate::generate::best::Best;
use crate::generate::make::Chosen;
use crate::generate::open::OpenRequest;
use anyhow::Result;
use kinelm_tokenizer::Words;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct BestArgs {
    /// Sample N dances, 2 to 16, and write the best --variations of them: those that lose their balance, slide, sink, kick,
    /// shake and snap least beyond what real dances do, and, where real ones are at hand, neither freeze nor copy
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
    pub fn real(&self, open: &OpenRequest, say: Say) -> Result<Option<RealDances>> {
        if self.best.is_none() {
            return Ok(None);
        }
        let run = &open.resolved.run;
        let Some(path) = self.real.clone().map_or_else(|| corpus_of(run), |path| Ok(Some(path)))? else {
            say.line(
                "compared with what the run knows of its train clips; whether a dance freezes or is a copy isn't known. \
                 --real compares with yours",
            );
            return Ok(Some(RealDances::of_run(run)?));
        };
        let dances = RealDances::open(&path, open, TrustArgs::default().opening())?;
        if !dances.shows_copies() {
            say.line("no validation clips: whether a dance is a copy isn't known");
        }
        say.line(format_args!("compared with the train clips of {}", path.display()));
        Ok(Some(dances))
    }
}

/// Prints what was found of the best dances.
pub fn report(open: &OpenRequest, chosen: &[Chosen], say: Say) {
    let words: Vec<&Words> = chosen.iter().map(|dance| &dance.words).collect();
    let bits = open.bits_per_frame(&words).unwrap_or_else(|e| {
        say.line(format_args!("their likelihood isn't known: {e}"));
        Vec::new()
    });
    for (n, (dance, best)) in chosen.iter().filter_map(|dance| Some((dance, dance.best?))).enumerate() {
        let bits = bits.get(n).map(|bits| format!("; {bits:.1} bits/frame under its model")).unwrap_or_default();
        let Best { of, verdict, .. } = best;
        say.line(format_args!("number {} of {of}, {verdict}{bits}", dance.number + 1));
    }
    let best = chosen.first().and_then(|dance| dance.best);
    if let Some((of, doubt)) = best.and_then(|best| Some((best.of, best.verdict.doubt()?))) {
        say.line(format_args!("warning: none of {of} dances is free of faults; of the best one {doubt}"));
    }
}
