//! The best of several dances, compared with real ones: those that the model was trained on, or the clips of the
//! library.

use crate::library::{Library, dataset, fingerprint, remove_folders};
use crate::project::CACHE;
use crate::{Error, Result};
use kinelm_corpus::CorpusOptions;
use kinelm_corpus::build::{BuildEvent, BuildOptions, tokenize};
use kinelm_evaluate::dance::real::{RealDances, corpus_of};
use kinelm_generate::OpenRequest;
use kinelm_store::hash;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// What dances are compared with, and its name: the corpus that the call named, that of the model's training, or one of the
/// library's clips.
///
/// # Errors
/// A corpus that can't be opened; neither a corpus nor clips.
pub fn real(named: Option<&Path>, open: &OpenRequest, library: &Library) -> Result<(RealDances, &'static str)> {
    let (path, what) = match (named, corpus_of(&open.resolved.run)) {
        (Some(path), _) => (path.to_owned(), "the corpus that was named"),
        (None, Ok(Some(path))) => (path, "the dances that the model was trained on"),
        (None, Ok(None)) => {
            return Ok((
                RealDances::of_run(&open.resolved.run)?,
                "what the model knows of the dances that it was trained on",
            ));
        }
        (None, Err(_)) => (of_library(open, library)?, "the clips of the library"),
    };
    Ok((RealDances::open(&path, open, CorpusOptions::default())?, what))
}

/// A corpus of the library's clips.
fn of_library(open: &OpenRequest, library: &Library) -> Result<PathBuf> {
    let sources = library.sources();
    if sources.is_empty() {
        let help = "drop some clips in, or start the studio with `real` CORPUS";
        return Err(Error::missing("real dances to compare with", help));
    }
    // of these clips in the words of this model: others make another corpus
    let key = hash::of(format!("{} {}", fingerprint(&sources), open.tokenizer.hash()).as_bytes());
    let cache = library.project().folder().join(CACHE);
    let out = cache.join(format!("real-{}", &key[..16]));
    if out.join("corpus.json").exists() {
        return Ok(out);
    }
    remove_folders(&cache, "real-");
    let mut watch = |_: BuildEvent<'_>| ControlFlow::Continue(());
    tokenize(&dataset(&sources), &open.tokenizer, &out, &BuildOptions::default(), &mut watch)?;
    Ok(out)
}
