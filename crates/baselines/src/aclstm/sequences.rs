//! Training clips as frames, from which sequences are taken.

use super::Config;
use crate::data::Recordings;
use crate::form::Coder;
use crate::{Error, FPS, Result};
use kinelm_corpus::Split;

/// Training clips that are long enough for a sequence, as frames.
pub struct Sequences {
    /// (F, C) of each, with its stride and its name.
    pub clips: Vec<(Vec<f32>, usize, String)>,
    /// Clips that are too short.
    pub short: Vec<String>,
}

impl Sequences {
    /// The training clips.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Missing`] when none is long enough.
    pub fn of(recordings: &Recordings, coder: &Coder, config: &Config) -> Result<Sequences> {
        let mut all = Sequences { clips: Vec::new(), short: Vec::new() };
        for one in recordings.split(Split::Train) {
            // T inputs, the target of the last, and the frame that the last step leads to
            match one.frames() >= config.length + 2 {
                true => {
                    let frames = coder.frames(&one.clip).into_iter().map(|x| x as f32).collect();
                    all.clips.push((frames, one.stride, one.name.clone()));
                }
                false => all.short.push(one.name.clone()),
            }
        }
        if all.clips.is_empty() {
            let what = format!("training clip of {} frames at {FPS} a second", config.length + 2);
            let help = format!("{} are shorter: take a shorter length, or other clips", all.short.len());
            return Err(Error::missing(what, help));
        }
        Ok(all)
    }
}
