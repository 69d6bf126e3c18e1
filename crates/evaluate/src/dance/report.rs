//! Dances held to real ones.

use super::beats::{self, BeatMetrics};
use super::coded::Dance;
use super::copying::{Nearest, Track, longest_run};
use super::features::{Features, features};
use super::fidelity::Fidelity;
use super::freeze::{Freezing, Threshold, energy};
use super::metrics::{DanceMetrics, GroupMetrics, Mean, group};
use super::positions::JointPositions;
use super::prompt::PromptMetrics;
use super::repetition::repeats;
use crate::floors::codes::frames;
use crate::{Error, Result};
use kinelm_corpus::{ClipRecord, Corpus, Split};
use kinelm_motion::Clip;
use kinelm_motion::feet::leg::Leg;
use kinelm_motion::metric::{Balance, FootContact, Ground, Skate, jitter_of};
use kinelm_motion::rig::{Feet, Humanoid};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;

/// Real dances, and the thresholds measured from them. They are decoded clip by clip whenever they are looked at, unless
/// there are few.
pub struct Reference<'a> {
    corpus: &'a Corpus,
    /// Those of a small corpus, decoded.
    held: BTreeMap<Split, Vec<Dance>>,
    pub(super) joints: Vec<usize>,
    pub(super) feet: Feet,
    pub(super) legs: [Leg; 2],
    pub(super) fps: f64,
    frames_per_word: usize,
    /// In the world, and of the pose alone, cm/s.
    thresholds: [f64; 2],
}

/// Train and validation clips of so many frames are held decoded, some 25 MB.
const HELD_FRAMES: usize = 20_000;
/// Clips that are decoded before what was made of them is taken up.
const TOGETHER: usize = 64;
/// Copies are judged beside validation clips of about so many frames.
const REFERENCE_FRAMES: usize = 20_000;

/// Distances to the nearest training window.
#[derive(Debug, Clone, Serialize)]
pub struct Copied {
    /// Windows of the dances, and of the validation clips.
    pub windows: [usize; 2],
    /// Validation clips, where these are a sample of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sampled_of: Option<usize>,
    /// Median distance to the nearest training window of both, cm.
    pub median_cm: [Option<f64>; 2],
    /// First percentile of the validation clips' distances, cm.
    pub limit_cm: Option<f64>,
    /// Share of the dances' windows that are nearer than that.
    pub copy_rate: Option<f64>,
    /// The longest run of frames that a dance, and that a validation clip, has in common with a training clip, token by
    /// token.
    pub longest_run_frames: [usize; 2],
}

/// All figures.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// The layout's version.
    pub schema: u32,
    /// The joints that the tokenizer codes and that are measured, SMPL ids.
    pub joints: Vec<usize>,
    /// Frames per second.
    pub fps: f64,
    /// A frame with no more stands still, cm/s: the first percentile over the real training frames.
    pub threshold_cm_s: f64,
    /// The same of the pose alone.
    pub pose_threshold_cm_s: f64,
    /// The real training and validation clips, the dances together, each dance.
    pub groups: Vec<GroupMetrics>,
    /// What the dances made of their prompts, by name.
    pub prompted: Vec<(String, PromptMetrics)>,
    /// Copies, if requested.
    pub copied: Option<Copied>,
    /// Clouds of features beside those of the real train clips, if requested.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub features: Vec<Features>,
    /// How real clips and dances keep to the beats of their music, where there is any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub beats: Vec<BeatMetrics>,
    /// Whether the dances show their label, if requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fidelity: Option<Fidelity>,
}

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
        let feet = feet(&joints)?;
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
        // not one of no frames
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

    /// What `of` makes of every clip of a split and its number, taken up in their order. Of each thread one clip is decoded at a
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

    /// The figures of dances beside those of the real ones.
    ///
    /// # Errors
    /// Words that can't be decoded.
    pub fn report(&self, dances: &[Dance]) -> Result<Report> {
        let each: Vec<DanceMetrics> = dances.par_iter().map(|d| self.metrics(d)).collect();
        let [train, valid] = [Split::Train, Split::Valid].map(|split| self.all_metrics(split));
        let mut groups = vec![group("train", &train?), group("valid", &valid?), group("dances", &each)];
        groups.extend(dances.iter().zip(&each).map(|(d, f)| group(&d.name, std::slice::from_ref(f))));
        Ok(Report {
            schema: 1,
            joints: self.joints.clone(),
            fps: self.fps,
            threshold_cm_s: self.thresholds[0],
            pose_threshold_cm_s: self.thresholds[1],
            groups,
            prompted: Vec::new(),
            copied: None,
            features: Vec::new(),
            beats: Vec::new(),
            fidelity: None,
        })
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
            speed: {
                let speeds = JointPositions::of(&dance.clip, &self.joints).speeds();
                Mean { sum: speeds.iter().sum(), frames: speeds.len() }
            },
            jitter: Mean::of(jitter_of(&dance.clip, &self.joints), dance.clip.frames().saturating_sub(3)),
            contact: FootContact::of(&dance.clip).unwrap_or_default(),
        }
    }

    /// How a decoded dance stands on its floor, which coding has put to y = 0.
    fn ground(&self, clip: &Clip) -> Ground {
        let pelvis: Vec<f64> = clip.root().iter().map(|p| p.y).collect();
        Ground::of(&self.feet.clearance(clip), &pelvis, self.fps)
    }

    /// Features of sets of dances, and of the real clips that no dance was learned from, beside those of the real train clips.
    ///
    /// # Errors
    /// What coding, resampling and features fail with.
    pub fn features(&self, sets: &[(&str, &[Dance])]) -> Result<Vec<Features>> {
        features(self, sets)
    }

    /// How dances keep to the beats of their music (seconds from their first frame), beside the real clips of the corpus.
    ///
    /// # Errors
    /// What decoding and resampling fail with.
    pub fn beats(&self, dances: &[Dance], music_s: &[Option<Vec<f64>>]) -> Result<Vec<BeatMetrics>> {
        let (real, lag) = beats::of_corpus(self.corpus, &self.joints)?;
        Ok(real.into_iter().chain(beats::of_dances(dances, music_s, &self.joints, lag)?).collect())
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

    /// How near windows of dances, as some joints show them, come to the training clips and their mirror images, cm: for each
    /// dance those of its windows, half a second apart.
    ///
    /// # Errors
    /// Clips that can't be mirrored; as [`Reference::fold`].
    pub(super) fn nearest(&self, joints: &[usize], dances: &[Track]) -> Result<Vec<Vec<f64>>> {
        let mut nearest = Nearest::of(dances);
        self.fold(Split::Train, |_, d| Track::both(&d.clip, joints), |both| nearest.add_training(&both))?;
        Ok(nearest.distances())
    }

    /// Whether dances are copies of training clips; `given`: the places of a word that were given to all of them.
    ///
    /// # Errors
    /// Clips that can't be mirrored.
    pub fn copied(&self, dances: &[Dance], given: &[bool]) -> Result<Copied> {
        let reference = self.validation_sample()?;
        let all: Vec<&Dance> = dances.iter().chain(&reference).collect();
        let tracks: Vec<Track> = all.iter().map(|d| Track::of(&d.clip, &self.joints)).collect();
        let mut found = self.nearest(&self.joints, &tracks)?.into_iter();
        let mut distances = |dances: usize| {
            let mut all: Vec<f64> = found.by_ref().take(dances).flatten().collect();
            all.sort_by(f64::total_cmp);
            all
        };
        let (found, of_reference) = (distances(dances.len()), distances(reference.len()));
        let limit = super::percentile(&of_reference, 0.01);
        let copies = limit.map(|limit| found.iter().filter(|d| **d < limit).count());
        let words: Vec<Vec<&[u32]>> = all.iter().map(|dance| dance.word_ids()).collect();
        let mut runs = vec![0; words.len()];
        let of_clip = |_, clip: &Dance| {
            let clip = clip.word_ids();
            Ok(words.iter().map(|dance| longest_run(dance, &clip, given)).collect::<Vec<usize>>())
        };
        self.fold(Split::Train, of_clip, |found| runs.iter_mut().zip(found).for_each(|(run, n)| *run = n.max(*run)))?;
        let run = |runs: &[usize]| runs.iter().max().unwrap_or(&0) * self.frames_per_word;
        let valid = self.corpus.split(Split::Valid).count();
        Ok(Copied {
            windows: [found.len(), of_reference.len()],
            sampled_of: (reference.len() < valid).then_some(valid),
            median_cm: [super::percentile(&found, 0.5), super::percentile(&of_reference, 0.5)],
            limit_cm: limit,
            copy_rate: copies.filter(|_| !found.is_empty()).map(|n| n as f64 / found.len() as f64),
            longest_run_frames: [run(&runs[..dances.len()]), run(&runs[dances.len()..])],
        })
    }
}

/// The feet of the model's body as far as they are coded: of the thirteen joints the ankles. Where none is, the ankles.
pub(super) fn feet(joints: &[usize]) -> Result<Feet> {
    let mut feet = Humanoid::neutral().feet()?;
    let coded = feet.joints.iter().any(|(j, _)| joints.contains(j));
    feet.joints.retain(|(j, _)| if coded { joints.contains(j) } else { matches!(j, 7 | 8) });
    Ok(feet)
}
