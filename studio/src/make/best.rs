//! The best of several dances, compared with real ones: those that the model was trained on, or the clips of the library.

use crate::library::{Library, Source};
use crate::project::CACHE;
use crate::{Error, Result};
use kinelm_corpus::build::{BuildEvent, BuildOptions, tokenize};
use kinelm_corpus::{CorpusOptions, Dataset, Item};
use kinelm_evaluate::dance::judge::Judge;
use kinelm_evaluate::dance::{Reference, real};
use kinelm_generate::OpenRequest;
use kinelm_generate::best::Best;
use kinelm_store::hash;
use kinelm_tokenizer::Words;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// What dances are compared with.
pub struct Real {
    corpus: kinelm_corpus::Corpus,
    /// In plain words.
    pub what: String,
}

impl Real {
    /// The corpus that the call named, that of the model's training, or one of the library's clips.
    ///
    /// # Errors
    /// A corpus that can't be opened; neither a corpus nor clips.
    pub fn open(named: Option<&Path>, open: &OpenRequest, library: &Library) -> Result<Real> {
        let of_run = real::corpus_of(&open.resolved.run);
        let (path, what) = match (named, of_run) {
            (Some(path), _) => (path.to_owned(), "the corpus that was named"),
            (None, Ok(path)) => (path, "the dances that the model was trained on"),
            (None, Err(_)) => (of_library(open, library)?, "the clips of the library"),
        };
        let corpus = real::open_for(&path, open, CorpusOptions::default())?;
        Ok(Real { corpus, what: format!("compared with {what}") })
    }

    /// The best `count` of the dances of a request, best first, each with its number among them.
    ///
    /// # Errors
    /// Those of [`Judge::best`].
    pub fn choose(&self, open: &OpenRequest, dances: &[Words], out: &Path, count: usize) -> Result<Vec<(usize, Best)>> {
        let reference = Reference::load(&self.corpus)?;
        let judge = Judge::new(&reference, open.free_spans())?;
        Ok(judge.best(open, dances, out, count)?)
    }
}

/// A corpus of the library's clips.
fn of_library(open: &OpenRequest, library: &Library) -> Result<PathBuf> {
    let sources: Vec<Source> = library.sources();
    if sources.is_empty() {
        let help = "drop some clips in, or start the studio with `real` CORPUS";
        return Err(Error::missing("real dances to compare with", help));
    }
    let of = |source: &Source| {
        let file = std::fs::metadata(&source.path).ok().map(|file| (file.len(), file.modified().ok()));
        format!("{} {file:?} {}", source.path.display(), serde_json::to_string(&source.read).unwrap_or_default())
    };
    let key = sources.iter().map(of).chain([open.tokenizer.hash()]).collect::<Vec<_>>().join("\n");
    let cache = library.project().folder().join(CACHE);
    let out = cache.join(format!("real-{}", &hash::of(key.as_bytes())[..16]));
    if out.join("corpus.json").exists() {
        return Ok(out);
    }
    for entry in std::fs::read_dir(&cache).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with("real-") {
            let _ = std::fs::remove_dir_all(entry.path());
        }
    }
    let item = |(key, source): (usize, &Source)| Item {
        path: source.path.clone(),
        name: source.id.clone(),
        take: source.id.clone(),
        // all of how it is read, whatever the options of the build
        sidecar: Some(source.read.clone()),
        fps: source.read.fps_source,
        skip: Some(source.read.skip),
        floor: source.read.floor,
        key,
        ..Item::default()
    };
    let items = sources.iter().enumerate().map(item).collect();
    let dataset = Dataset { items, sources: vec![String::new()], ..Dataset::default() };
    let mut watch = |_: BuildEvent<'_>| ControlFlow::Continue(());
    tokenize(&dataset, &open.tokenizer, &out, &BuildOptions::default(), &mut watch)?;
    Ok(out)
}
