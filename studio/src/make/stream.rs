//! Frames of dances that are still sampled, as the stage shows them.
//!
//! A few words at a time are decoded, in a small share of the time that sampling takes, and sent as numbers of the
//! page's player. They are a sketch: no foot is locked, no end closed; the dance that is there in the end replaces them.

use crate::Result;
use crate::events::Hub;
use kinelm_generate::OpenRequest;
use kinelm_motion::rig::SkeletonMap;
use kinelm_view::Figure;
use kinelm_view::data::{Drawn, LiveFigure};
use serde::Serialize;
use std::time::{Duration, Instant};

/// The least time between two looks at a dance, and the share of the time that looking may take.
const EVERY: Duration = Duration::from_millis(40);
const SHARE: u32 = 20;

/// The streams of a job's dances.
pub struct Streams<'a> {
    open: &'a OpenRequest,
    hub: &'a Hub,
    job: &'a str,
    /// By variation.
    dances: Vec<Live>,
    /// Dances that the sampler yields side by side are ways of one variation, of which the first is shown.
    is_tries: bool,
    /// The variation whose ways are sampled.
    variation: usize,
    words: usize,
    floor_m: f64,
    map: Option<SkeletonMap>,
    next: Instant,
}

struct Live {
    id: String,
    name: String,
    ids: Vec<u32>,
    sent: usize,
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
        open: &'a OpenRequest,
        (hub, job): (&'a Hub, &'a str),
        (ids, name): (&[String], &str),
    ) -> Result<Streams<'a>> {
        let live = |id: &String| Live { id: id.clone(), name: name.into(), ids: Vec::new(), sent: 0, figure: None };
        // only an edit keeps the floor of its file
        let edited = open.prompt.as_ref().filter(|prompt| prompt.edit.is_some());
        let floor_m = edited.map(|prompt| prompt.clip.ground_m()).transpose()?.unwrap_or(0.0);
        Ok(Streams {
            open,
            hub,
            job,
            dances: ids.iter().map(live).collect(),
            is_tries: open.samples_tries(),
            variation: 0,
            words: 0,
            floor_m,
            map: SkeletonMap::builtin("smpl"),
            next: Instant::now(),
        })
    }

    /// Takes up the last word of each dance that is sampled. Returns the frames that are there of how many, over all
    /// dances.
    ///
    /// # Errors
    /// Words that can't be decoded.
    pub fn push(&mut self, words: usize, last: &[Vec<u32>]) -> Result<[usize; 2]> {
        if self.is_tries && words <= self.words {
            self.look(self.variation..self.variation + 1)?;
            self.variation += 1;
        }
        self.words = words;
        match self.is_tries {
            true => {
                if let (Some(dance), Some(word)) = (self.dances.get_mut(self.variation), last.first()) {
                    dance.ids.extend(word);
                }
            }
            false => {
                // of those among which the best are chosen, as many are shown as will be there
                self.dances.iter_mut().zip(last).for_each(|(dance, word)| dance.ids.extend(word));
            }
        }
        if Instant::now() >= self.next {
            let begun = Instant::now();
            let shown = if self.is_tries { self.variation..self.variation + 1 } else { 0..self.dances.len() };
            self.look(shown)?;
            self.next = Instant::now() + EVERY.max(begun.elapsed() * SHARE);
        }
        let (frames, each) = (self.open.frames, self.open.tokenizer.frames_per_word());
        let here = (words * each).saturating_sub(self.open.resolved.lead_in).min(frames);
        let variations = if self.is_tries { self.dances.len() } else { 1 };
        Ok([self.variation * frames + here, variations * frames])
    }

    /// Sends the frames that are new.
    fn look(&mut self, dances: std::ops::Range<usize>) -> Result<()> {
        for variation in dances {
            let Some(dance) = self.dances.get_mut(variation) else { continue };
            let words = self.open.tokenizer.words_of_ids(&dance.ids).words;
            let clip = self.open.preview(&words)?;
            if clip.frames() <= dance.sent {
                continue;
            }
            let data = dance.figure.as_ref().and_then(|live| live.frames(&clip, dance.sent..clip.frames()));
            let (from, figure_head, data) = match data {
                Some(data) => (dance.sent, None, data),
                // the first frames, or one that left the box: all again
                None => {
                    let around = if dance.figure.is_none() { 0 } else { clip.frames() - 1 };
                    let figure = Figure::new(&*dance.name, &clip);
                    let (live, head) = LiveFigure::new(&figure, self.floor_m, self.map.as_ref(), around)?;
                    let Some(data) = live.frames(&clip, 0..clip.frames()) else { continue };
                    dance.figure = Some(live);
                    (0, Some(head), data)
                }
            };
            dance.sent = clip.frames();
            let (job, id) = (self.job, &*dance.id);
            self.hub.send("frames", &Frames { job, variation: variation + 1, dance: id, from, figure_head, data });
        }
        Ok(())
    }
}
