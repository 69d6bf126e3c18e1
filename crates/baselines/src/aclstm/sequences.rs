//! Clips as frames, from which sequences are taken.

use super::Config;
use crate::data::Recordings;
use crate::form::Coder;
use crate::{Error, FPS, Result};
use kinelm_corpus::Split;

/// Clips that are long enough for a sequence, as frames.
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
        let all = Sequences::of_split(recordings, Split::Train, coder, config);
        if all.clips.is_empty() {
            let what = format!("training clip of {} frames at {FPS} a second", config.length + 2);
            let help = format!("{} are shorter: take a shorter length, or other clips", all.short.len());
            return Err(Error::missing(what, help));
        }
        Ok(all)
    }

    /// Frames of a clip at which a sequence of `length` steps can begin.
    pub fn room(&self, clip: usize, channels: usize, length: usize) -> usize {
        let (frames, stride, _) = &self.clips[clip];
        frames.len() / channels - span(length, *stride) + 1
    }

    /// The frames (T + 2, C) of a sequence of `length` steps from the frame `first` of a clip on.
    pub fn frames(&self, clip: usize, channels: usize, length: usize, first: usize) -> Vec<f64> {
        let (frames, stride, _) = &self.clips[clip];
        let all = &frames[first * channels..(first + span(length, *stride)) * channels];
        all.chunks_exact(channels).step_by(*stride).flatten().map(|x| f64::from(*x)).collect()
    }

    /// The clips of a split.
    pub fn of_split(recordings: &Recordings, split: Split, coder: &Coder, config: &Config) -> Sequences {
        let mut all = Sequences { clips: Vec::new(), short: Vec::new() };
        for one in recordings.split(split) {
            // T inputs, the target of the last, and the frame that the last step leads to
            match one.frames() >= config.length + 2 {
                true => {
                    let frames = coder.frames(&one.clip).into_iter().map(|x| x as f32).collect();
                    all.clips.push((frames, one.stride, one.name.clone()));
                }
                false => all.short.push(one.name.clone()),
            }
        }
        all
    }
}

/// Frames of a clip that a sequence takes.
fn span(length: usize, stride: usize) -> usize {
    // T inputs, the target of the last, and the frame that the last step leads to
    (length + 1) * stride + 1
}
