//! The figure of a clip or a dance on the stage: the data of the page's player.

use super::{Library, Source};
use crate::project::document::{DanceRecord, MadeSpan};
use crate::{Error, Result};
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::resample::{Method, resample};
use kinelm_view::Figure;
use kinelm_view::data::{self, Drawn};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes of figures in memory.
const MOST_BYTES: usize = 48 << 20;

/// The part of a figure that a page requests; a list shows small ones.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Part {
    /// The rate, at most.
    pub fps: Option<f64>,
    /// The first seconds alone.
    pub seconds: Option<f64>,
}

/// Figures that were made lately, as text.
#[derive(Debug, Default)]
pub struct Figures {
    recent: Mutex<Recent>,
}

#[derive(Debug, Default)]
struct Recent {
    texts: VecDeque<(String, Arc<str>)>,
    bytes: usize,
}

impl Figures {
    fn find(&self, key: &str) -> Option<Arc<str>> {
        let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        let at = recent.texts.iter().position(|(other, _)| other == key)?;
        let found = recent.texts.remove(at)?;
        // to the end: the front is the one used longest ago
        recent.texts.push_back(found.clone());
        Some(found.1)
    }

    fn insert(&self, key: String, text: &Arc<str>) {
        let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        // one that takes all the room would drive out all others
        if text.len() > MOST_BYTES / 4 {
            return;
        }
        recent.bytes += text.len();
        recent.texts.push_back((key, text.clone()));
        while recent.bytes > MOST_BYTES {
            let Some((_, gone)) = recent.texts.pop_front() else { break };
            recent.bytes -= gone.len();
        }
    }

    /// Bytes of all texts.
    pub fn bytes(&self) -> usize {
        self.recent.lock().unwrap_or_else(PoisonError::into_inner).bytes
    }
}

/// A figure and its generated parts.
#[derive(Serialize)]
struct Shown {
    #[serde(flatten)]
    drawn: Drawn,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    made: Vec<Made>,
}

/// Points whose joints are generated for a time, seconds.
#[derive(Serialize)]
struct Made {
    points: Vec<usize>,
    from: f64,
    to: f64,
}

impl Library {
    /// The figure of a clip or a dance, as JSON.
    ///
    /// # Errors
    /// Those of [`Library::source`] and of reading; a rate or a length that isn't a number above 0.
    pub fn figure(&self, id: &str, part: Part) -> Result<Arc<str>> {
        for (name, number) in [("fps", part.fps), ("seconds", part.seconds)] {
            if let Some(number) = number.filter(|number| !(*number > 0.0 && number.is_finite())) {
                return Err(Error::invalid_parameter(name, number, "a number above 0"));
            }
        }
        let source = self.source(id)?;
        let dance = self.project().dance(id).ok();
        let file = std::fs::metadata(&source.path).map_err(Error::io(&source.path))?;
        let read = serde_json::to_string(&source.read).unwrap_or_default();
        // all that the figure depends on: a changed file or reading has another key, and the old one falls out in time
        let key = format!("{id} {part:?} {} {:?} {read} {}", file.len(), file.modified().ok(), source.name);
        if let Some(text) = self.figures().find(&key) {
            return Ok(text);
        }
        let request = Wanted::of(&source, dance.as_ref(), part);
        let text: Arc<str> =
            self.reader.figure(&source.path, request, &self.answer_file("figure")?, &self.stop)?.into();
        self.figures().insert(key, &text);
        Ok(text)
    }
}

/// The request for a figure of a file, as the process that reads it gets it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Wanted {
    name: String,
    read: ReadOptions,
    floor_m: f64,
    part: Part,
    generated_s: Vec<[f64; 2]>,
    made: Vec<MadeSpan>,
}

impl Wanted {
    fn of(source: &Source, dance: Option<&DanceRecord>, part: Part) -> Wanted {
        Wanted {
            name: source.name.clone(),
            read: source.read.clone(),
            floor_m: source.floor_m,
            part,
            generated_s: dance.map_or_else(Vec::new, |dance| dance.generated_s.clone()),
            made: dance.map_or_else(Vec::new, |dance| dance.made_spans.clone()),
        }
    }

    /// Reads the file and draws its figure, as JSON.
    ///
    /// # Errors
    /// Those of reading; a clip that isn't a body's.
    pub fn text(&self, file: &Path) -> Result<String> {
        let motion = format::read(file, &self.read)?;
        // the clip is moved out: of one at the limit a copy is hundreds of MB
        let map = motion.map().cloned();
        let mut clip = motion.clip;
        if let Some(seconds) = self.part.seconds {
            let frames = (seconds * clip.fps()).ceil().max(1.0) as usize;
            clip = clip.slice(0..frames.min(clip.frames()));
        }
        if let Some(fps) = self.part.fps.filter(|fps| *fps < clip.fps()) {
            clip = resample(&clip, fps, Method::Auto)?;
        }
        let figure = Figure::new(&*self.name, &clip).regenerated(&self.generated_s);
        let drawn = data::figure(&figure, self.floor_m, map.as_ref())?;
        let made =
            self.made.iter().map(|span| Made { points: drawn.points_of(&span.joints), from: span.from, to: span.to });
        let made = made.collect();
        serde_json::to_string(&Shown { drawn, made }).map_err(Error::failed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn a_figure_is_drawn_by_a_process_of_its_own() {
        let dir = tempfile::tempdir().unwrap();
        let (_project, library) = fixture::library(dir.path(), &[("a.bvh", fixture::dance(1, 2.0, 30.0))]);
        let text = library.figure("c1", Part::default()).unwrap();
        assert!(text.contains("\"frames\":60") && text.contains("\"contacts\""), "{text}");
        let small = library.figure("c1", Part { fps: Some(15.0), seconds: Some(1.0) }).unwrap();
        assert!(small.contains("\"frames\":15") || small.contains("\"frames\":16"), "{small}");
        // one that ends without an answer is an error of the file
        let mut library = Arc::try_unwrap(library).unwrap();
        library.reader.args = vec!["--list".into()];
        let said = library.figure("c1", Part { fps: Some(10.0), seconds: None }).unwrap_err();
        assert!(said.status() == 409 && said.to_string().contains("a.bvh can't be read: its reader ended"), "{said}");
        let left = std::fs::read_dir(dir.path().join(crate::project::CACHE)).unwrap().flatten();
        assert!(left.into_iter().all(|entry| entry.path().extension().is_none_or(|end| end != "read")));
    }

    #[test]
    fn texts_in_memory_are_bounded_and_the_oldest_go() {
        let figures = Figures::default();
        let text: Arc<str> = "x".repeat(MOST_BYTES / 5).into();
        for n in 0..20 {
            figures.insert(n.to_string(), &text);
            assert!(figures.bytes() <= MOST_BYTES);
            assert!(figures.find("0").is_some(), "it was looked at lately");
        }
        assert!(figures.find("1").is_none() && figures.find("19").is_some());
        figures.insert("large".into(), &"x".repeat(MOST_BYTES / 2).into());
        assert!(figures.find("large").is_none() && figures.find("19").is_some());
    }
}
