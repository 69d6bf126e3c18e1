//! Clips that move alike: the library's own index of the clips, built when a search needs it.

use super::{Library, dataset, fingerprint, remove_folders};
use crate::project::CACHE;
use crate::{Error, Result};
use kinelm_spectral::WindowSpec;
use kinelm_spectral::query::build::BuildOptions;
use kinelm_spectral::query::{Distance, Exclude, Index, IndexRequest, Models, Query};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::PoisonError;
use std::sync::atomic::Ordering;

/// The most matches.
const MOST: usize = 100;

/// A page's search.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Looked {
    /// A clip or a dance.
    pub clip: String,
    /// The time that was brushed, seconds. Its middle counts: windows have a length of their own.
    pub from_s: f64,
    /// Seconds.
    pub to_s: f64,
    /// Matches.
    #[serde(default = "ten")]
    pub k: usize,
}

fn ten() -> usize {
    10
}

/// A time of a clip that moves alike.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Match {
    /// The clip.
    pub clip: String,
    /// Seconds.
    pub from_s: f64,
    /// Seconds.
    pub to_s: f64,
    /// The cosine of both features.
    pub score: f64,
}

/// Seconds of a window.
pub fn window_s() -> f64 {
    WindowSpec::default().seconds()
}

impl Library {
    /// The times of other clips that are most like one of a clip, the best first.
    ///
    /// # Errors
    /// Those of [`Library::source`]; a clip shorter than a window, and a library without another; those of the index.
    pub fn search(&self, looked: &Looked) -> Result<Vec<Match>> {
        let source = self.source(&looked.clip)?;
        // NaN and infinities of either bound come through here, and are refused below
        let middle = (looked.from_s + looked.to_s) / 2.0;
        if !middle.is_finite() || looked.from_s > looked.to_s {
            return Err(Error::invalid_parameter("from_s", looked.from_s, "a time before `to_s`"));
        }
        if !(1..=MOST).contains(&looked.k) {
            return Err(Error::invalid_parameter("k", looked.k, format!("1 to {MOST} matches")));
        }
        let (window, seconds) = (window_s(), source.frames as f64 / source.fps);
        // at its rate the index may have a frame less
        let last = (seconds - window - 0.04).max(0.0);
        let sources = self.sources();
        let index = Index::open(&self.index(&sources)?)?;
        let query = Query {
            clip: source.path.clone(),
            read: source.read.clone(),
            as_indexed: false,
            at_s: Some((middle - window / 2.0).clamp(0.0, last)),
            lowest: 0,
            k: looked.k,
            distance: Distance::Cosine,
            exclude: Exclude::Overlap,
            one_per_clip: false,
            models: Models::default(),
        };
        let found = index.find(&query)?;
        let of = |found: &kinelm_spectral::query::Match| {
            let window = &found.window;
            let clip = sources.iter().find(|source| source.id == window.clip)?.id.clone();
            Some(Match { clip, from_s: window.start_s, to_s: window.end_s, score: found.value })
        };
        Ok(found.matches.iter().filter_map(of).collect())
    }

    /// The folder of an index of these clips.
    fn index(&self, sources: &[super::Source]) -> Result<PathBuf> {
        let _searching = self.searching.lock().unwrap_or_else(PoisonError::into_inner);
        let key = fingerprint(sources);
        let cache = self.project().folder().join(CACHE);
        let out = cache.join(format!("index-{}", &key[..16]));
        // only whole indices have their name (`PendingFolder`)
        if out.is_dir() {
            return Ok(out);
        }
        remove_folders(&cache, "index-");
        let dataset = dataset(sources);
        let mut watch = |_: kinelm_spectral::query::build::BuildEvent<'_>| match self.stop.load(Ordering::Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        Index::build(&dataset, &IndexRequest::default(), &BuildOptions::default(), &out, &mut watch)?;
        Ok(out)
    }
}
