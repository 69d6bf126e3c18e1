//! What the stage shows of a clip or a dance: the data of the page's player.

use super::{Library, Source};
use crate::project::document::DanceRecord;
use crate::{Error, Result};
use kinelm_motion::format;
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::rig::map_of;
use kinelm_view::Figure;
use kinelm_view::data::{self, Drawn};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes of figures that are kept in memory.
const MOST_BYTES: usize = 48 << 20;

/// How much of a figure is wanted; a list shows small ones.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
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
        recent.texts.push_back(found.clone());
        Some(found.1)
    }

    fn keep(&self, key: String, text: &Arc<str>) {
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

/// A figure and what of it is generated.
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
    /// Those of [`Library::source`] and of reading; a rate or a length that is none.
    pub fn figure(&self, id: &str, part: Part) -> Result<Arc<str>> {
        for (name, number) in [("`fps`", part.fps), ("`seconds`", part.seconds)] {
            if let Some(number) = number.filter(|number| !(*number > 0.0 && number.is_finite())) {
                return Err(Error::invalid(name, number, "a number above 0"));
            }
        }
        let source = self.source(id)?;
        let dance = self.project().dance(id).ok();
        let file = std::fs::metadata(&source.path).map_err(Error::io(&source.path))?;
        let read = serde_json::to_string(&source.read).unwrap_or_default();
        let key = format!("{id} {part:?} {} {:?} {read} {}", file.len(), file.modified().ok(), source.name);
        if let Some(text) = self.figures().find(&key) {
            return Ok(text);
        }
        let text: Arc<str> = text(&source, dance.as_ref(), part)?.into();
        self.figures().keep(key, &text);
        Ok(text)
    }
}

fn text(source: &Source, dance: Option<&DanceRecord>, part: Part) -> Result<String> {
    let motion = format::read(&source.path, &source.read)?;
    let map = map_of(&motion.clip, source.read.map.as_deref()).ok();
    let mut clip = motion.clip;
    if let Some(seconds) = part.seconds {
        let frames = (seconds * clip.fps()).ceil().max(1.0) as usize;
        clip = clip.slice(0..frames.min(clip.frames()));
    }
    if let Some(fps) = part.fps.filter(|fps| *fps < clip.fps()) {
        clip = resample(&clip, fps, Method::Auto)?;
    }
    let mut figure = Figure::new(&*source.name, &clip);
    if let Some(dance) = dance {
        figure = figure.regenerated(&dance.generated_s);
    }
    let drawn = data::figure(&figure, source.floor_m, map.as_ref())?;
    let spans = dance.map_or(&[][..], |dance| &dance.made_spans);
    let made = spans.iter().map(|span| Made { points: drawn.points_of(&span.joints), from: span.from, to: span.to });
    let made = made.collect();
    serde_json::to_string(&Shown { drawn, made }).map_err(Error::failed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_in_memory_are_bounded_and_the_oldest_go() {
        let figures = Figures::default();
        let text: Arc<str> = "x".repeat(MOST_BYTES / 5).into();
        for n in 0..20 {
            figures.keep(n.to_string(), &text);
            assert!(figures.bytes() <= MOST_BYTES);
            assert!(figures.find("0").is_some(), "it was looked at lately");
        }
        assert!(figures.find("1").is_none() && figures.find("19").is_some());
        figures.keep("large".into(), &"x".repeat(MOST_BYTES / 2).into());
        assert!(figures.find("large").is_none() && figures.find("19").is_some());
    }
}
