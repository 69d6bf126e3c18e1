//! Real dances that others are compared with.

use super::coded::Dance;
use super::copying::{Nearest, Track};
use super::freeze::{Freezing, Threshold, energy};
use super::metrics::{DanceMetrics, Mean};
use super::positions::JointPositions;
use super::repetition::repeats;
use crate::floors::codes::frames;
use crate::{Error, Result};
use kinelm_corpus::{ClipRecord, Corpus, Split};
use kinelm_generate::score::coded_feet;
use kinelm_motion::Clip;
use kinelm_motion::feet::leg::Leg;
use kinelm_motion::metric::{Balance, Extremes, FootContact, Ground, Laban, Skate, jitter_of};
use kinelm_motion::rig::{Feet, Humanoid};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Real dances, and the thresholds measured from them. Clips are decoded one by one at each use, unless
/// there are few.
pub struct Reference<'a> {
    pub(super) corpus: &'a Corpus,
    /// Those of a small corpus, decoded.
    held: BTreeMap<Split, Vec<Dance>>,
    pub(super) joints: Vec<usize>,
    pub(super) feet: Feet,
    pub(super) legs: [Leg; 2],
    pub(super) fps: f64,
    pub(super) frames_per_word: usize,
    /// In the world, and of the pose alone, cm/s.
    pub(super) thresholds: [f64; 2],
}

/// Up to this many frames, train and validation clips are held decoded, some 25 MB.
const HELD_FRAMES: usize = 20_000;
/// Clips that are decoded in parallel before their results are folded.
const TOGETHER: usize = 64;
/// Frames of the validation clips that copies are judged beside, about.
const REFERENCE_FRAMES: usize = 20_000;

impl<'a> Reference<'a> {
    /// The training and the validation clips of a corpus.
    ///
    /// # Errors
    /// A corpus without a training frame; words that can't be decoded.
    pub fn load(corpus: &'a Corpus) -> Result<Reference<'a>> {
        Reference::check(corpus)?;
        let joints = corpus.tokenizer().channels().joints().to_vec();
        let (fps, frames_per_word) = (corpus.tokenizer().fps(), corpus.tokenizer().frames_per_word());
        let (held, thresholds) = (BTreeMap::new(), [0.0; 2]);
        let feet = coded_feet(&joints)?;
        let legs = Leg::of(Humanoid::neutral())?;
        let mut real = Reference { corpus, held, feet, legs, joints, fps, frames_per_word, thresholds };
        if frames(corpus, Split::Train) + frames(corpus, Split::Valid) <= HELD_FRAMES {
            let held = |split| Ok((split, real.each(split, |_, dance| Ok(dance.clone()))?));
            real.held = [Split::Train, Split::Valid].into_iter().map(held).collect::<Result<_>>()?;
        }
        let mut thresholds = [0; 2].map(|_| Threshold::of(frames(corpus, Split::Train)));
        let of_both = |_, dance: &Dance| {
            let places: [fn(&Clip, &[usize]) -> JointPositions; 2] = [JointPositions::of, JointPositions::of_pose];
            Ok(places.map(|places| energy(&places(&dance.clip, &real.joints))))
        };
        real.fold(Split::Train, of_both, |energies| {
            thresholds.iter_mut().zip(energies).for_each(|(threshold, e)| threshold.add(&e));
        })?;
        // `check` has refused a corpus without a training frame
        real.thresholds = thresholds.map(|threshold| threshold.get().unwrap_or(0.0));
        Ok(real)
    }

    /// Refuses a corpus without a training frame.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] that says so.
    pub fn check(corpus: &Corpus) -> Result<()> {
        match frames(corpus, Split::Train) {
            0 => {
                let help = "give clips the split train when the corpus is tokenized";
                Err(Error::file(corpus.dir(), "no training frame", "some, for the thresholds", help))
            }
            _ => Ok(()),
        }
    }

    /// The corpus.
    pub fn corpus(&self) -> &'a Corpus {
        self.corpus
    }

    /// Folds what `of` makes of every clip of a split and its number, in their order. Each thread decodes one clip at a
    /// time.
    ///
    /// # Errors
    /// Words that can't be decoded; those of `of`.
    pub(super) fn fold<T: Send>(
        &self,
        split: Split,
        of: impl Fn(usize, &Dance) -> Result<T> + Sync,
        mut take: impl FnMut(T),
    ) -> Result<()> {
        let held = self.held.get(&split);
        let records: Vec<(usize, &ClipRecord)> = self.corpus.split(split).enumerate().collect();
        let one = |&(i, record): &(usize, &ClipRecord)| match held {
            Some(held) => of(i, &held[i]),
            None => of(i, &Dance::of_corpus(self.corpus, record)?),
        };
        for some in records.chunks(TOGETHER) {
            some.par_iter().map(one).collect::<Result<Vec<T>>>()?.into_iter().for_each(&mut take);
        }
        Ok(())
    }

    /// What `of` makes of every clip of a split and its number.
    ///
    /// # Errors
    /// As [`Reference::fold`].
    pub(super) fn each<T: Send>(&self, split: Split, of: impl Fn(usize, &Dance) -> Result<T> + Sync) -> Result<Vec<T>> {
        let mut all = Vec::new();
        self.fold(split, of, |found| all.push(found))?;
        Ok(all)
    }

    /// The figures of the clips of a split.
    ///
    /// # Errors
    /// As [`Reference::fold`].
    pub(super) fn all_metrics(&self, split: Split) -> Result<Vec<DanceMetrics>> {
        self.each(split, |_, dance| Ok(self.metrics(dance)))
    }

    pub(super) fn metrics(&self, dance: &Dance) -> DanceMetrics {
        let freezing = |places: JointPositions, x: f64| Freezing::of(&energy(&places), self.fps, x);
        DanceMetrics {
            world: freezing(JointPositions::of(&dance.clip, &self.joints), self.thresholds[0]),
            pose: freezing(JointPositions::of_pose(&dance.clip, &self.joints), self.thresholds[1]),
            repeats: repeats(&dance.word_ids(), self.frames_per_word, self.fps),
            ground: self.ground(&dance.clip),
            skate: Skate::of(&self.feet, &dance.clip),
            balance: Balance::of(&self.legs, &dance.clip),
            most: Extremes::of(&dance.clip, &self.joints, 0..dance.clip.frames()),
            speed: {
                let speeds = JointPositions::of(&dance.clip, &self.joints).speeds();
                Mean { sum: speeds.iter().sum(), frames: speeds.len() }
            },
            jitter: Mean::of(jitter_of(&dance.clip, &self.joints), dance.clip.frames().saturating_sub(3)),
            contact: FootContact::of(&dance.clip).unwrap_or_default(),
            // only the memory of a clip of hours would fail here
            laban: Laban::of(&dance.clip).unwrap_or_default(),
        }
    }

    /// How a decoded dance stands on its floor, which coding has put to y = 0.
    fn ground(&self, clip: &Clip) -> Ground {
        let pelvis: Vec<f64> = clip.root().iter().map(|p| p.y).collect();
        Ground::of(&self.feet.clearance(clip), &pelvis, self.fps)
    }

    /// The validation clips that copies are judged beside: all, or some that are spread evenly.
    ///
    /// # Errors
    /// As [`Reference::fold`].
    pub(super) fn validation_sample(&self) -> Result<Vec<Dance>> {
        let records: Vec<&ClipRecord> = self.corpus.split(Split::Valid).collect();
        let (clips, all) = (records.len(), frames(self.corpus, Split::Valid));
        let taken = if all <= REFERENCE_FRAMES { clips } else { (clips * REFERENCE_FRAMES / all).max(1) };
        let dance = |i: usize| {
            let dance = Dance::of_corpus(self.corpus, records[i * clips / taken])?;
            Ok(dance.first(REFERENCE_FRAMES, self.frames_per_word))
        };
        (0..taken).into_par_iter().map(dance).collect()
    }

    /// Distances of windows of dances, as some joints show them, to the nearest of the training clips and their mirror
    /// images, cm: for each dance those of its windows, half a second apart.
    ///
    /// # Errors
    /// Clips that can't be mirrored; as [`Reference::fold`].
    pub(super) fn nearest(&self, joints: &[usize], dances: &[Track]) -> Result<Vec<Vec<f64>>> {
        let mut nearest = Nearest::of(dances);
        self.fold(Split::Train, |_, d| Track::both(&d.clip, joints), |both| nearest.add_training(&both))?;
        Ok(nearest.distances())
    }
}
