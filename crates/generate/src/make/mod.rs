//! Dances made: sampled, the best of several chosen, decoded with their feet locked, and the bytes and the sidecar of each.
//!
//! The program, the studio, the package for Python and the demos open a request and call [`OpenRequest::make`]; they
//! report the result and write it to its place.

mod preview;

pub use preview::Preview;

use crate::Result;
use crate::best::Best;
use crate::open::OpenRequest;
use crate::output::Generated;
use crate::provenance::Provenance;
use kinelm_motion::{Clip, format};
use kinelm_store::output::{Ours, Outputs};
use kinelm_store::sidecar;
use kinelm_tokenizer::Words;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// How dances of a request are made.
pub struct Making<'a> {
    /// The file that each is to be written to, whose extension says the format.
    pub outs: &'a [PathBuf],
    /// Of how many they are the best, and by what.
    pub best: Option<BestOf<'a>>,
    /// As [`crate::sampler::SamplingPlan::guesses`]; it changes the time, no dance.
    pub guesses: Option<usize>,
}

impl<'a> Making<'a> {
    /// A dance for each file.
    pub fn of(outs: &'a [PathBuf]) -> Making<'a> {
        Making { outs, best: None, guesses: None }
    }
}

/// A choice among sampled dances.
pub struct BestOf<'a> {
    /// Dances that are sampled.
    pub samples: usize,
    /// The judge that compares them.
    pub judge: &'a dyn Judge,
}

/// Chooses among sampled dances: `kinelm_evaluate::dance::judge`.
pub trait Judge {
    /// The best `count`, best first, each with its number among them, from 0. They are measured as if they were read back from
    /// a file named `out`.
    ///
    /// # Errors
    /// Errors of writing, reading and coding the dances.
    fn best(&self, open: &OpenRequest, sampled: &[Words], out: &Path, count: usize) -> Result<Vec<(usize, Best)>>;
}

/// How far the sampling is, after each word.
pub struct Progress<'a> {
    /// Frames that are sampled, over the dances that are sampled one after the other.
    pub frames: usize,
    /// Frames that will be.
    pub of: usize,
    open: &'a OpenRequest,
    previews: &'a mut [Preview],
}

/// Frames of a dance that are new.
pub struct NewFrames {
    /// The dance's number among the sampled ones, from 0.
    pub dance: usize,
    /// The number of the first of them.
    pub from: usize,
    /// On SMPL-24 at the model's rate; a sketch, in which no foot is locked and no end closed.
    pub clip: Clip,
}

impl Progress<'_> {
    /// The frames that are new since the last call, of as many dances as will be there; of several ways through a gap the
    /// first is shown.
    ///
    /// # Errors
    /// None for sampled words.
    pub fn new_frames(&mut self) -> Result<Vec<NewFrames>> {
        let mut all = Vec::new();
        for (dance, preview) in self.previews.iter_mut().enumerate() {
            let from = preview.shown();
            all.extend(preview.next(self.open)?.map(|clip| NewFrames { dance, from, clip }));
        }
        Ok(all)
    }
}

/// Watches the making of dances. `Break` stops it.
pub type Watch<'a> = dyn FnMut(&mut Progress<'_>) -> ControlFlow<()> + 'a;

/// The [`Watch`] of dances that nobody waits for.
pub fn unwatched(_: &mut Progress<'_>) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// Dances that are sampled and chosen, the best first, to be decoded one after the other.
pub struct Dances {
    /// Each in words, and its rank.
    pub chosen: Vec<Chosen>,
    /// Tokens that were guessed ahead.
    pub guessed: u64,
    /// The number of right guesses.
    pub right: u64,
}

/// A dance in words.
pub struct Chosen {
    /// The file that it is to be written to.
    pub out: PathBuf,
    /// Its number among those that were sampled, from 0.
    pub number: usize,
    /// Its words.
    pub words: Words,
    /// Its rank among them, where the best were chosen.
    pub best: Option<Best>,
}

/// A dance that is made.
pub struct Dance<'a> {
    open: &'a OpenRequest,
    /// Its words and its rank.
    pub chosen: Chosen,
    /// Its motion.
    pub generated: Generated,
}

impl OpenRequest {
    /// Makes dances: samples them, chooses the best where that is requested, and returns them to be decoded.
    ///
    /// # Errors
    /// Errors of sampling and of the judge; [`kinelm_store::Error::Stopped`] when `watch` stopped it.
    pub fn make(&self, making: &Making<'_>, watch: &mut Watch<'_>) -> Result<Dances> {
        let outs = making.outs;
        if let Some((prompt, _)) = self.on_own_rig() {
            // before the first frame
            outs.iter().try_for_each(|out| format::check_place(out, &prompt.clip.motion))?;
        }
        let samples = making.best.as_ref().map_or(outs.len(), |best| best.samples);
        let mut previews: Vec<Preview> = outs.iter().map(|_| Preview::new(self)).collect();
        // ways through gaps are sampled side by side, and their dances one after the other
        let of = self.frames * if self.tries() > 1 { samples } else { 1 };
        let sampled = self.sample(samples, making.guesses, &mut |first, words, last| {
            // of several ways the first is shown: which one is chosen is not known yet
            let shown = last.iter().take(if self.tries() > 1 { 1 } else { samples });
            for (preview, word) in previews.iter_mut().skip(first).zip(shown) {
                preview.push(&self.tokenizer, word);
            }
            let sampled = (words * self.tokenizer.frames_per_word()).saturating_sub(self.resolved.lead_in);
            let frames = first * self.frames + sampled.min(self.frames);
            watch(&mut Progress { frames, of, open: self, previews: &mut previews })
        })?;
        let mut words: Vec<Words> = (0..samples).map(|dance| self.words(&sampled, dance)).collect();
        let ranked: Vec<(usize, Option<Best>)> = match (&making.best, outs.first()) {
            (Some(best), Some(out)) => {
                let ranked = best.judge.best(self, &words, out, outs.len())?.into_iter();
                ranked.map(|(number, best)| (number, Some(best))).collect()
            }
            _ => (0..samples).map(|number| (number, None)).collect(),
        };
        let chosen = ranked.into_iter().zip(outs).map(|((number, best), out)| {
            // a judge names each dance once
            let words = std::mem::take(&mut words[number]);
            Chosen { out: out.clone(), number, words, best }
        });
        Ok(Dances { chosen: chosen.collect(), guessed: sampled.guessed, right: sampled.right })
    }

    /// One dance, to be written to `out`, that nobody watches.
    ///
    /// # Errors
    /// Errors of sampling and decoding.
    pub fn make_one(&self, out: &Path) -> Result<Dance<'_>> {
        let outs = [out.to_owned()];
        self.make(&Making::of(&outs), &mut unwatched)?.chosen.remove(0).decode(self)
    }

    /// Makes one dance and writes it with its sidecar. The extension says the format.
    ///
    /// # Errors
    /// Errors of sampling and decoding; a file in the way that is no dance with its sidecar, see [`Outputs::write`].
    pub fn write(&self, out: impl AsRef<Path>) -> Result<()> {
        let is_file = |path: &Path| Ok(sidecar::is_beside_its_file(path) || sidecar::has_hash_of(path)?);
        let dances = Ours { is_marked: |_| false, is_file, owner: |_| None };
        let outputs = Outputs::new(dances, self.resolved.request().files(), false);
        self.make_one(out.as_ref())?.write(&outputs)
    }
}

impl Chosen {
    /// Decodes the dance, on the requested rig and with its feet locked.
    ///
    /// # Errors
    /// Those of [`OpenRequest::motion`].
    pub fn decode(self, open: &OpenRequest) -> Result<Dance<'_>> {
        let generated = open.motion(&self.words, &self.out)?;
        Ok(Dance { open, chosen: self, generated })
    }
}

impl Dance<'_> {
    /// The bytes of its file, and its sidecar.
    ///
    /// # Errors
    /// Those of [`Generated::bytes`].
    pub fn file(&self) -> Result<(Vec<u8>, Provenance)> {
        let Chosen { out, number, best, .. } = &self.chosen;
        let bytes = self.generated.bytes(out)?;
        let fps = self.generated.motion.clip.fps();
        let provenance = Provenance::of(self.open, number + 1, out, fps, &bytes);
        Ok((bytes, Provenance { best: *best, ..provenance }))
    }

    /// Writes it with its sidecar.
    ///
    /// # Errors
    /// Those of [`Dance::file`] and [`Provenance::write`].
    pub fn write(&self, outputs: &Outputs) -> Result<()> {
        let (bytes, provenance) = self.file()?;
        provenance.write(&self.chosen.out, &bytes, outputs)
    }
}
