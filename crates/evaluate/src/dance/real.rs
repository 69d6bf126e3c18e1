//! The corpus of real dances that the dances of a request are compared with.

use super::judge::{Judge, best_by};
use super::reference::Reference;
use crate::{Error, Result};
use kinelm_corpus::{Corpus, CorpusOptions, Split};
use kinelm_generate::best::Best;
use kinelm_generate::make;
use kinelm_generate::open::OpenRequest;
use kinelm_generate::score::Limits;
use kinelm_model::run::LIMITS;
use kinelm_store::Subject;
use kinelm_tokenizer::Words;
use kinelm_train::run::RunFile;
use std::path::{Path, PathBuf};

/// The corpus of the largest weight in a run's training; `None` where the run names none and brings its limits.
///
/// # Errors
/// A run that can't be read; one that names no corpus and brings no limits, or whose corpus isn't there any more.
pub fn corpus_of(run: &Path) -> Result<Option<PathBuf>> {
    let parts = RunFile::read(run)?.corpora.into_iter();
    let place = run.display();
    let Some(most) = parts.reduce(|most, part| if part.weight > most.weight { part } else { most }) else {
        if run.join(LIMITS).exists() {
            return Ok(None);
        }
        let why = format!("{place} was trained elsewhere and names no corpus; add `real` CORPUS");
        return Err(Error::unsupported_parameter("best", why));
    };
    if !most.path.join("corpus.json").exists() {
        let corpus = most.path.display();
        let why = format!("{corpus}, which {place} was trained on, isn't there any more; add `real` CORPUS");
        return Err(Error::unsupported_parameter("best", why));
    }
    Ok(Some(most.path))
}

/// What the best of a request's dances are chosen by.
pub enum RealDances {
    /// Real dances.
    Corpus(Box<Corpus>),
    /// What a run knows of those that it was trained on.
    Limits(Box<Limits>),
}

impl RealDances {
    /// The limits of a run.
    ///
    /// # Errors
    /// Those of [`Limits::load`].
    pub fn of_run(run: &Path) -> Result<RealDances> {
        Ok(RealDances::Limits(Box::new(Limits::load(run)?)))
    }

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
        Ok(RealDances::Corpus(Box::new(corpus)))
    }

    /// Whether it can be found out that a dance is a copy: validation clips say how near one may come.
    pub fn shows_copies(&self) -> bool {
        matches!(self, RealDances::Corpus(corpus) if corpus.split(Split::Valid).next().is_some())
    }
}

impl make::Judge for RealDances {
    fn best(&self, open: &OpenRequest, sampled: &[Words], out: &Path, count: usize) -> Result<Vec<(usize, Best)>> {
        let corpus = match self {
            RealDances::Corpus(corpus) => corpus,
            RealDances::Limits(limits) => return best_by(limits, open, sampled, out, count),
        };
        let reference = Reference::load(corpus)?;
        make::Judge::best(&Judge::new(&reference, open.free_spans())?, open, sampled, out, count)
    }
}
