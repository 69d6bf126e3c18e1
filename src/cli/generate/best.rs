//! `kinelm generate --best N`.

use crate::cli::{Say, TrustArgs, evaluate, wrong_call};
use crate::corpus::{Corpus, Split};
use crate::evaluate::dance::Reference;
use crate::evaluate::dance::judge::Judge;
use crate::generate::best::Best;
use crate::generate::open::OpenRequest;
use crate::train::run::RunFile;
use anyhow::Result;
use kinelm_tokenizer::Words;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct BestArgs {
    /// Sample N dances, 2 to 16, and write the best --variations of them: those that slide, sink and shake least beyond what
    /// real dances do, and neither freeze nor copy
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(2..=16), conflicts_with = "greedy")]
    pub best: Option<u8>,
    /// The corpus of real dances to compare with [default: the run's corpus of the largest weight]
    #[arg(long, value_name = "CORPUS", requires = "best")]
    real: Option<PathBuf>,
    /// Write all N, the best first
    #[arg(long, requires = "best", conflicts_with = "variations")]
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
        let path = self.real.clone().map_or_else(|| of_run(&open.resolved.run), Ok)?;
        let corpus = evaluate::real_corpus(&path, TrustArgs::default())?;
        let (found, expected) = (corpus.tokenizer().hash(), open.tokenizer.hash());
        if found != expected {
            wrong_call!(
                "{}: a corpus of another tokenizer ({found:.8}) than the model's ({expected:.8}); expected one that kinelm \
                 tokenize made with it",
                path.display()
            );
        }
        Reference::check(&corpus)?;
        if path.ends_with(kinelm_ready::MADE) {
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

/// The corpus of the largest weight in a run's training.
fn of_run(run: &Path) -> Result<PathBuf> {
    let parts = RunFile::read(run)?.corpora.into_iter();
    let made = run.join(kinelm_ready::MADE);
    if parts.len() == 0 && made.is_dir() {
        return Ok(made);
    }
    let run = run.display();
    let Some(most) = parts.reduce(|most, part| if part.weight > most.weight { part } else { most }) else {
        wrong_call!("--best: {run} was trained elsewhere and names no corpus; add --real CORPUS");
    };
    if !most.path.join("corpus.json").exists() {
        let corpus = most.path.display();
        wrong_call!("--best: {corpus}, which {run} was trained on, isn't there any more; add --real CORPUS");
    }
    Ok(most.path)
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
