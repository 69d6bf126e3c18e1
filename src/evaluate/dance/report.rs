//! Dances held to real ones.

use super::beats::{self, Kept};
use super::coded::Dance;
use super::copying::{Track, longest_run, nearest};
use super::features::{Features, features};
use super::figures::{Figures, Group, Mean, group};
use super::freeze::{Freezing, energy, threshold};
use super::named::Fidelity;
use super::places::Places;
use super::prompted::Prompted;
use super::repeat::repeats;
use crate::corpus::{ClipRecord, Corpus, Split};
use crate::{Error, Result};
use kinelm_motion::metric::{Feet, Ground, Skate, jitter_of, physical_foot_contact};
use kinelm_motion::retarget::SkeletonMap;
use kinelm_motion::{Clip, smpl};
use rayon::prelude::*;
use serde::Serialize;

/// Real dances, and the thresholds measured from them.
pub struct Real {
    pub(super) train: Vec<Dance>,
    pub(super) valid: Vec<Dance>,
    pub(super) joints: Vec<usize>,
    pub(super) feet: Feet,
    pub(super) fps: f64,
    frames_per_word: usize,
    /// In the world, and of the pose alone, cm/s.
    thresholds: [f64; 2],
}

/// Distances to the nearest training window.
#[derive(Debug, Clone, Serialize)]
pub struct Copied {
    /// Windows of the dances, and of the validation clips.
    pub windows: [usize; 2],
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
    pub groups: Vec<Group>,
    /// What the dances made of their prompts, by name.
    pub prompted: Vec<(String, Prompted)>,
    /// Whether they are copies, where that was asked for.
    pub copied: Option<Copied>,
    /// Clouds of features beside those of the real train clips, where that was asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub features: Vec<Features>,
    /// How real clips and dances keep to the beats of their music, where there is any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub beats: Vec<Kept>,
    /// Whether a label can be told by the dances, where that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fidelity: Option<Fidelity>,
}

impl Real {
    /// The training and the validation clips of a corpus.
    ///
    /// # Errors
    /// A corpus without a training frame; words that can't be decoded.
    pub fn load(corpus: &Corpus) -> Result<Real> {
        let records: Vec<_> = corpus.split(Split::Train).chain(corpus.split(Split::Valid)).collect();
        let load = |record: &&ClipRecord| Ok((record.split, Dance::of_corpus(corpus, record)?));
        let all: Vec<(Split, Dance)> = records.par_iter().map(load).collect::<Result<_>>()?;
        let (train, valid): (Vec<_>, Vec<_>) = all.into_iter().partition(|(split, _)| *split == Split::Train);
        let [train, valid] = [train, valid].map(|all| all.into_iter().map(|(_, dance)| dance).collect::<Vec<_>>());
        let joints = corpus.tokenizer().channels().joints().to_vec();
        let fit = |places: fn(&Clip, &[usize]) -> Places| {
            threshold(train.par_iter().flat_map_iter(|d| energy(&places(&d.clip, &joints))).collect())
        };
        let (Some(world), Some(pose)) = (fit(Places::of), fit(Places::of_pose)) else {
            return Err(Error::file(
                corpus.dir(),
                "no training frame",
                "some, for the thresholds",
                "see --labels of tokenize",
            ));
        };
        let (fps, frames_per_word) = (corpus.tokenizer().fps(), corpus.tokenizer().frames_per_word());
        let feet = feet(&joints)?;
        Ok(Real { train, valid, joints, feet, fps, frames_per_word, thresholds: [world, pose] })
    }

    /// The figures of dances beside those of the real ones.
    pub fn report(&self, dances: &[Dance]) -> Report {
        let each: Vec<Figures> = dances.par_iter().map(|d| self.figures(d)).collect();
        let all = |dances: &[Dance]| dances.par_iter().map(|d| self.figures(d)).collect::<Vec<_>>();
        let mut groups =
            vec![group("train", &all(&self.train)), group("valid", &all(&self.valid)), group("dances", &each)];
        groups.extend(dances.iter().zip(&each).map(|(d, f)| group(&d.name, std::slice::from_ref(f))));
        Report {
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
        }
    }

    pub(super) fn figures(&self, dance: &Dance) -> Figures {
        let freezing = |places: Places, x: f64| Freezing::of(&energy(&places), self.fps, x);
        Figures {
            world: freezing(Places::of(&dance.clip, &self.joints), self.thresholds[0]),
            pose: freezing(Places::of_pose(&dance.clip, &self.joints), self.thresholds[1]),
            repeats: repeats(&dance.word_ids(), self.frames_per_word, self.fps),
            ground: self.ground(&dance.clip),
            skate: Skate::of(&self.feet, &dance.clip),
            speed: {
                let speeds = Places::of(&dance.clip, &self.joints).speeds();
                Mean { sum: speeds.iter().sum(), frames: speeds.len() }
            },
            jitter: Mean::of(jitter_of(&dance.clip, &self.joints), dance.clip.frames().saturating_sub(3)),
            pfc: physical_foot_contact(&dance.clip).ok().flatten(),
        }
    }

    /// How a decoded dance stands on its floor, which coding has put to y = 0.
    fn ground(&self, clip: &Clip) -> Ground {
        let pelvis: Vec<f64> = clip.root().iter().map(|p| p.y).collect();
        Ground::of(&self.feet.least(clip), &pelvis, self.fps)
    }

    /// Features of sets of dances, and of the real clips that no dance was learned from, beside those of the real train clips.
    ///
    /// # Errors
    /// What coding, resampling and features fail with.
    pub fn features(&self, corpus: &Corpus, sets: &[(&str, &[Dance])]) -> Result<Vec<Features>> {
        let test: Vec<Dance> =
            corpus.split(Split::Test).map(|record| Dance::of_corpus(corpus, record)).collect::<Result<_>>()?;
        let real: [(&str, &[Dance]); 2] = [("valid", &self.valid), ("test", &test)];
        features(&self.train, &[&real, sets].concat())
    }

    /// How dances keep to the beats of their music (seconds from their first frame), beside the real clips of a corpus.
    ///
    /// # Errors
    /// What decoding and resampling fail with.
    pub fn beats(&self, corpus: &Corpus, dances: &[Dance], music_s: &[Option<Vec<f64>>]) -> Result<Vec<Kept>> {
        let (real, lag) = beats::of_corpus(corpus, &self.joints)?;
        Ok(real.into_iter().chain(beats::of_dances(dances, music_s, &self.joints, lag)?).collect())
    }

    /// Whether dances are copies of training clips; `given`: the places of a word that were given to all of them.
    ///
    /// # Errors
    /// Clips that can't be mirrored.
    pub fn copied(&self, dances: &[Dance], given: &[bool]) -> Result<Copied> {
        let both = |d: &Dance| Track::both(&d.clip, &self.joints);
        let training: Vec<Track> = self.train.par_iter().map(both).collect::<Result<Vec<_>>>()?.concat();
        let distances = |dances: &[Dance]| {
            let mut all: Vec<f64> =
                dances.iter().flat_map(|d| nearest(&Track::of(&d.clip, &self.joints), &training)).collect();
            all.sort_by(f64::total_cmp);
            all
        };
        let (found, reference) = (distances(dances), distances(&self.valid));
        let limit = super::percentile(&reference, 0.01);
        let copies = limit.map(|limit| found.iter().filter(|d| **d < limit).count());
        let words: Vec<Vec<&[u32]>> = self.train.iter().map(Dance::word_ids).collect();
        let run = |dances: &[Dance]| {
            let longest = dances.iter().map(|d| longest_run(&d.word_ids(), &words, given)).max();
            longest.unwrap_or(0) * self.frames_per_word
        };
        Ok(Copied {
            windows: [found.len(), reference.len()],
            median_cm: [super::percentile(&found, 0.5), super::percentile(&reference, 0.5)],
            limit_cm: limit,
            copy_rate: copies.filter(|_| !found.is_empty()).map(|n| n as f64 / found.len() as f64),
            longest_run_frames: [run(dances), run(&self.valid)],
        })
    }
}

/// The feet of the model's body as far as they are coded: of the thirteen joints the ankles. Where none is, the ankles.
pub(super) fn feet(joints: &[usize]) -> Result<Feet> {
    let map = SkeletonMap::builtin("smpl").ok_or_else(|| Error::Call("no skeleton map smpl".into()))?;
    let mut feet = Feet::new(&smpl::neutral(), &map)?;
    let coded = feet.joints.iter().any(|(j, _)| joints.contains(j));
    feet.joints.retain(|(j, _)| if coded { joints.contains(j) } else { matches!(j, 7 | 8) });
    Ok(feet)
}
