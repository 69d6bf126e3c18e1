//! Frames of dances that are still sampled, as the stage shows them.
//!
//! A few words at a time are decoded, in a small share of the time that sampling takes, and sent as numbers of the
//! page's player. They are a sketch: no foot is locked, no end closed; the dance that is there in the end replaces them.

use crate::Result;
use crate::events::Hub;
use kinelm_generate::OpenRequest;
use kinelm_generate::make::{NewFrames, Progress};
use kinelm_motion::Clip;
use kinelm_motion::rig::SkeletonMap;
use kinelm_view::Figure;
use kinelm_view::data::{Drawn, LiveFigure};
use serde::Serialize;
use std::time::{Duration, Instant};

/// The least pause between two looks at a dance, and how many times longer than a look the pause after it is.
const EVERY: Duration = Duration::from_millis(40);
const SHARE: u32 = 20;

/// The streams of a job's dances.
pub struct Streams<'a> {
    hub: &'a Hub,
    job: &'a str,
    /// The ids of the dances, by variation.
    ids: &'a [String],
    name: &'a str,
    dances: Vec<Live>,
    floor_m: f64,
    map: Option<SkeletonMap>,
    next: Instant,
}

#[derive(Default)]
struct Live {
    /// The frames that were sent.
    parts: Vec<Clip>,
    figure: Option<LiveFigure>,
}

/// Newly sampled frames of a dance.
#[derive(Serialize)]
struct Frames<'a> {
    job: &'a str,
    variation: usize,
    dance: &'a str,
    from: usize,
    /// With the first frames, and where a dance leaves the box of its numbers.
    #[serde(skip_serializing_if = "Option::is_none")]
    figure_head: Option<Drawn>,
    data: String,
}

impl<'a> Streams<'a> {
    /// The streams of dances with these ids and a name.
    ///
    /// # Errors
    /// None for a request that was opened.
    pub fn new(
        open: &OpenRequest,
        hub: &'a Hub,
        job: &'a str,
        ids: &'a [String],
        name: &'a str,
    ) -> Result<Streams<'a>> {
        // only an edit keeps the floor of its file
        let edited = open.prompt.as_ref().filter(|prompt| prompt.edit.is_some());
        let floor_m = edited.map(|prompt| prompt.clip.ground_m()).transpose()?.unwrap_or(0.0);
        let dances = ids.iter().map(|_| Live::default()).collect();
        Ok(Streams { hub, job, ids, name, dances, floor_m, map: SkeletonMap::builtin("smpl"), next: Instant::now() })
    }

    /// Sends the frames that are new, if it is time to.
    ///
    /// # Errors
    /// Words that can't be decoded.
    pub fn look(&mut self, progress: &mut Progress<'_>) -> Result<()> {
        let begun = Instant::now();
        if begun >= self.next {
            progress.new_frames()?.into_iter().try_for_each(|new| self.send(new))?;
            self.next = Instant::now() + EVERY.max(begun.elapsed() * SHARE);
        }
        Ok(())
    }

    fn send(&mut self, NewFrames { dance, from, clip }: NewFrames) -> Result<()> {
        let live = &mut self.dances[dance];
        let data = live.figure.as_ref().and_then(|figure| figure.frames(&clip, 0..clip.frames()));
        live.parts.push(clip);
        let (from, figure_head, data) = match data {
            Some(data) => (from, None, data),
            // the first frames, or one that left the box: all again
            None => {
                let whole = joined(&live.parts)?;
                // a dance that left the box gets one around its newest frame
                let around = if live.figure.is_none() { 0 } else { whole.frames() - 1 };
                let figure = Figure::new(self.name, &whole);
                let (figure, head) = LiveFigure::new(&figure, self.floor_m, self.map.as_ref(), around)?;
                let data = figure.frames(&whole, 0..whole.frames());
                live.figure = data.is_some().then_some(figure);
                let Some(data) = data else { return Ok(()) };
                (0, Some(head), data)
            }
        };
        let (job, id) = (self.job, &*self.ids[dance]);
        self.hub.send("frames", &Frames { job, variation: dance + 1, dance: id, from, figure_head, data });
        Ok(())
    }
}

/// Parts of a dance as one clip.
fn joined(parts: &[Clip]) -> Result<Clip> {
    let root = parts.iter().flat_map(Clip::root).copied().collect();
    let rotations = parts.iter().flat_map(Clip::rotations).copied().collect();
    Ok(Clip::new(parts[0].skeleton().clone(), parts[0].fps(), root, rotations)?)
}
