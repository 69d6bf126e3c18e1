//! The corpus of real dances that the dances of a request are compared with.

use super::reference::Reference;
use crate::{Error, Result};
use kinelm_corpus::{Corpus, CorpusOptions};
use kinelm_generate::open::OpenRequest;
use kinelm_model::run::MADE;
use kinelm_store::Subject;
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
        return Err(Error::unsupported("`best`", why));
    };
    if !most.path.join("corpus.json").exists() {
        let corpus = most.path.display();
        let why = format!("{corpus}, which {run} was trained on, isn't there any more; add `real` CORPUS");
        return Err(Error::unsupported("`best`", why));
    }
    Ok(most.path)
}

/// Opens a corpus to compare dances of a request with.
///
/// # Errors
/// A folder that is no corpus; a corpus of another tokenizer than the model's, or without a training frame.
pub fn open_for(path: &Path, open: &OpenRequest, options: CorpusOptions) -> Result<Corpus> {
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
    Ok(corpus)
}
