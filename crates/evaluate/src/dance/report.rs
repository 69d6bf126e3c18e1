//! Dances compared with real ones.

use super::beats::{self, BeatMetrics};
use super::coded::Dance;
use super::copying::{Track, longest_run};
use super::features::{Features, features};
use super::fidelity::Fidelity;
use super::metrics::{DanceMetrics, GroupMetrics, group};
use super::prompt::PromptMetrics;
use super::reference::Reference;
use crate::Result;
use kinelm_corpus::Split;
use rayon::prelude::*;
use serde::Serialize;

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
    /// Of each dance the distances of its windows to the nearest training window, cm.
    #[serde(skip)]
    pub nearest_cm: Vec<Vec<f64>>,
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
    /// How the dances follow their prompts, by name.
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

impl Reference<'_> {
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

    /// Whether dances are copies of training clips; `given`: the slots of a word that were given to all of them.
    ///
    /// # Errors
    /// Clips that can't be mirrored.
    pub fn copied(&self, dances: &[Dance], given: &[bool]) -> Result<Copied> {
        let reference = self.validation_sample()?;
        let all: Vec<&Dance> = dances.iter().chain(&reference).collect();
        let tracks: Vec<Track> = all.iter().map(|d| Track::of(&d.clip, &self.joints)).collect();
        let mut nearest_cm = self.nearest(&self.joints, &tracks)?;
        let distances = |of: &[Vec<f64>]| {
            let mut all = of.concat();
            all.sort_by(f64::total_cmp);
            all
        };
        let (found, of_reference) = (distances(&nearest_cm[..dances.len()]), distances(&nearest_cm[dances.len()..]));
        nearest_cm.truncate(dances.len());
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
            nearest_cm,
        })
    }
}
