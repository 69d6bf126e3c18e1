//! `generate --best N`.

use crate::cli::{Say, TrustArgs, WrongCall, evaluate::dance};
use crate::corpus::{Corpus, Split};
use crate::evaluate::dance::judge::Judge;
use crate::evaluate::dance::{Dance, Reference};
use crate::generate::best::Best;
use crate::generate::open::OpenRequest;
use crate::train::run::RunFile;
use anyhow::Result;
use kinelm_motion::format::Format;
use kinelm_tokenizer::Words;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct BestArgs {
    /// Draw so many dances and keep the best, or the best few (--variations): the one that slides, sinks and shakes least
    /// beyond what real dances do, and neither stands still for good nor copies
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(2..=16), conflicts_with = "greedy")]
    pub best: Option<u8>,
    /// The corpus of the real dances; the run's own of the most weight if not given
    #[arg(long, value_name = "CORPUS", requires = "best")]
    pub real: Option<PathBuf>,
    /// Keep all of them, the best first
    #[arg(long, requires = "best", conflicts_with = "variations")]
    pub keep_all: bool,
}

/// Real dances that others are held to.
pub struct Beside {
    corpus: Corpus,
}

impl BestArgs {
    /// Dances to write.
    pub fn written(&self, variations: u8) -> u8 {
        self.best.filter(|_| self.keep_all).unwrap_or(variations)
    }

    /// Reads the real dances, where there is to be a choice.
    pub fn beside(&self, ready: &OpenRequest, say: Say) -> Result<Option<Beside>> {
        if self.best.is_none() {
            return Ok(None);
        }
        let path = self.real.clone().map_or_else(|| of_run(&ready.recipe.run), Ok)?;
        let corpus = dance::corpus(&path, TrustArgs::default())?;
        let (found, expected) = (corpus.tokenizer().hash(), ready.tokenizer.hash());
        if found != expected {
            let what = format!(
                "{}: a corpus of another tokenizer ({:.8}) than the model's ({expected:.8}); expected one that kinelm tokenize \
                 made with it",
                path.display(),
                found
            );
            return Err(WrongCall(what).into());
        }
        Reference::check(&corpus)?;
        if corpus.split(Split::Valid).next().is_none() {
            say.line("no validation clips: whether a dance copies can't be told");
        }
        say.line(format_args!("held to the train clips of {}", path.display()));
        Ok(Some(Beside { corpus }))
    }
}

/// The corpus that a run learned most from.
fn of_run(run: &Path) -> Result<PathBuf> {
    let mut parts = RunFile::read(run)?.corpora.into_iter();
    let first = parts.next().ok_or_else(|| {
        WrongCall(format!("--best: {} was trained elsewhere and names no corpus; add --real CORPUS", run.display()))
    })?;
    let most = parts.fold(first, |most, part| if part.weight > most.weight { part } else { most });
    if !most.path.join("corpus.json").exists() {
        let what = format!(
            "--best: {}, which {} was trained on, is there no more; say where it is: --real CORPUS",
            most.path.display(),
            run.display()
        );
        return Err(WrongCall(what).into());
    }
    Ok(most.path)
}

impl Beside {
    /// The dances that are to be written to so many files, the best first: which they are, and what was found.
    pub fn choose(
        &self,
        ready: &OpenRequest,
        danced: &[Words],
        wanted: usize,
        out: &Path,
        say: Say,
    ) -> Result<Vec<(usize, Best)>> {
        let real = Reference::load(&self.corpus)?;
        let judge = Judge::new(&real, ready.invented())?;
        // what is written and never read is judged as .json
        let is_read = Format::of_name(out).is_some_and(|format| format != Format::Glb);
        let name = if is_read { out.to_owned() } else { out.with_extension("json") };
        let options = ready.read_back(&name);
        let dance = |words: &Words| {
            let bytes = ready.motion(words, &name)?.bytes(&name)?;
            Dance::of_bytes(&name, &bytes, &options, self.corpus.tokenizer())
        };
        let dances = danced.iter().map(dance).collect::<crate::Result<Vec<_>>>()?;
        let ranked = judge.ranked(&dances, wanted)?;
        let of = ranked.len();
        let best = ranked.into_iter().enumerate().map(|(better, (i, verdict))| (i, Best { of, better, verdict }));
        let chosen: Vec<(usize, Best)> = best.take(wanted).collect();
        let words: Vec<&Words> = chosen.iter().map(|(i, _)| &danced[*i]).collect();
        let bits = ready.bits_per_frame(&words).unwrap_or_else(|e| {
            say.line(format_args!("how likely they are isn't known: {e}"));
            Vec::new()
        });
        for (n, (i, best)) in chosen.iter().enumerate() {
            let bits = bits.get(n).map(|bits| format!("; {bits:.1} bits/frame to its model")).unwrap_or_default();
            say.line(format_args!("number {} of {of}, {}{bits}", i + 1, best.verdict));
        }
        if let Some(doubt) = chosen.first().and_then(|(_, best)| best.verdict.doubt()) {
            say.line(format_args!("warning: none of {of} dances is without doubt; of the least bad one {doubt}"));
        }
        Ok(chosen)
    }
}
