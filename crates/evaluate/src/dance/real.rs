//! The corpus of real dances that the dances of a request are compared with.

use super::judge::Judge;
use super::reference::Reference;
use crate::{Error, Result};
use kinelm_corpus::{Corpus, CorpusOptions, Split};
use kinelm_generate::best::Best;
use kinelm_generate::make;
use kinelm_generate::open::OpenRequest;
use kinelm_model::run::MADE;
use kinelm_store::Subject;
use kinelm_tokenizer::Words;
use kinelm_train::run::RunFile;
use std::path::{Path, PathBuf};

/// The corpus of the largest weight in a run's training; [`MADE`], where a run names none and brings it.
///
/// # Errors
/// A run that can't be read; one that names no corpus, or whose corpus isn't there any more.
pub fn corpus_of(run: &Path) -> Result<PathBuf> {
    let parts = RunFile::read(run)?.corpora.into_iter();
    let made = run.join(MADE);
    if parts.len() == 0 && made.is_dir() {
        return Ok(made);
    }
    let run = run.display();
    let Some(most) = parts.reduce(|most, part| if part.weight > most.weight { part } else { most }) else {
        let why = format!("{run} was trained elsewhere and names no corpus; add `real` CORPUS");
        return Err(Error::unsupported_parameter("best", why));
    };
    if !most.path.join("corpus.json").exists() {
        let corpus = most.path.display();
        let why = format!("{corpus}, which {run} was trained on, isn't there any more; add `real` CORPUS");
        return Err(Error::unsupported_parameter("best", why));
    }
    Ok(most.path)
}

/// Real dances, among which the best of a request's dances are chosen.
pub struct RealDances(Corpus);

impl RealDances {
    /// Opens a corpus to compare dances of a request with.
    ///
    /// # Errors
    /// A folder that is no corpus; a corpus of another tokenizer than the model's, or without a training frame.
    pub fn open(path: &Path, open: &OpenRequest, options: CorpusOptions) -> Result<RealDances> {
        if !path.join("corpus.json").exists() {
            let why = "no corpus.json; expected a corpus, as kinelm tokenize makes it";
            return Err(Error::unsupported(Subject::of_parameter("real").with(path.display()), why));
        }
        let corpus = Corpus::open_with(path, CorpusOptions { streamed: true, ..options })?;
        let (found, expected) = (corpus.tokenizer().base_hash(), open.tokenizer.base_hash());
        if found != expected {
            let why = format!(
                "a corpus of another tokenizer ({found:.8}) than the model's ({expected:.8}); expected one that kinelm tokenize \
             made with it"
            );
            return Err(Error::unsupported(Subject::of_parameter("real").with(path.display()), why));
        }
        Reference::check(&corpus)?;
        Ok(RealDances(corpus))
    }

    /// Whether it can be found out that a dance is a copy: validation clips say how near one may come.
    pub fn shows_copies(&self) -> bool {
        self.0.split(Split::Valid).next().is_some()
    }
}

impl make::Judge for RealDances {
    fn best(&self, open: &OpenRequest, sampled: &[Words], out: &Path, count: usize) -> Result<Vec<(usize, Best)>> {
        let reference = Reference::load(&self.0)?;
        make::Judge::best(&Judge::new(&reference, open.free_spans())?, open, sampled, out, count)
    }
}
