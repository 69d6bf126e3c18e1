//! Whether dances keep to the beats of their music: docs/measures.md, "Beats".
//!
//! Twice: as published, over all joints and on the beat itself; and over knees and ankles with a lag, the fraction of a
//! beat after which those of the real clips come to rest, since bodies needn't rest where the drum is hit.

use super::Dance;
use crate::Result;
use crate::number::number;
use kinelm_corpus::record::BeatSource;
use kinelm_corpus::{ClipRecord, Corpus, Split};
use kinelm_motion::Clip;
use kinelm_motion::metric::beat::{BeatAlignment, BeatHits, BeatRule, ShiftTest, beats_s, pulse_bpm};
use rayon::prelude::*;
use serde::Serialize;
use std::fmt;

/// Knees and ankles.
const LEGS: [usize; 4] = [4, 5, 7, 8];
/// Lags that are tried, hundredths of a beat.
const LAGS: std::ops::Range<i32> = -50..50;
/// Where other music begins, seconds.
const ELSEWHERE_S: f64 = 7.3;
/// How near to the beat, half or double of it, the peak of a speed counts as its tempo.
const SAME: f64 = 0.05;

/// Beats of a clip, and of its music.
#[derive(Debug, Clone)]
pub struct BeatPair {
    /// Those of all coded joints, and of the legs, seconds.
    own_s: [Vec<f64>; 2],
    /// Where the legs' speed peaks, a minute.
    pulse_bpm: Option<f64>,
    music_s: Vec<f64>,
    seconds: f64,
}

impl BeatPair {
    /// Of a clip and the beats of its music, seconds from its first frame.
    ///
    /// # Errors
    /// Those of resampling.
    pub fn new(clip: &Clip, joints: &[usize], music_s: &[f64]) -> Result<BeatPair> {
        let legs: Vec<usize> = LEGS.into_iter().filter(|joint| joints.contains(joint)).collect();
        let legs = if legs.is_empty() { joints } else { &legs };
        let beats = |joints| beats_s(clip, joints, BeatRule::Fixed);
        Ok(BeatPair {
            own_s: [beats(joints)?, beats(legs)?],
            pulse_bpm: pulse_bpm(clip, legs)?,
            music_s: music_s.to_vec(),
            seconds: clip.frames() as f64 / clip.fps(),
        })
    }

    /// The same clip against other beats.
    pub(crate) fn against(&self, music_s: Vec<f64>) -> BeatPair {
        BeatPair { music_s, ..self.clone() }
    }

    /// Whether both have the same piece of music, from any start: then their beats differ by a constant.
    fn has_the_music_of(&self, other: &BeatPair) -> bool {
        let (a, b) = (&self.music_s, &other.music_s);
        let offset = |(a, b): (&f64, &f64)| a - b;
        let first = a.iter().zip(b).map(offset).next().unwrap_or(0.0);
        // beat times are stored to 0.1 ms
        a.len() == b.len() && a.iter().zip(b).map(offset).all(|x| (x - first).abs() < 1e-3)
    }

    /// The music's beats, each later by `lag` of its own length.
    fn later(&self, lag: f64) -> Vec<f64> {
        let steps = self.music_s.windows(2).map(|pair| pair[1] - pair[0]);
        let steps: Vec<f64> = steps.collect();
        // the last beat has no length of its own and takes the one before
        let step = |i: usize| steps.get(i).or(steps.last()).copied().unwrap_or(0.0);
        self.music_s.iter().enumerate().map(|(i, beat)| beat + lag * step(i)).collect()
    }

    /// All joints on the beat, and the legs at a lag.
    fn scores_at(&self, lag: f64) -> [ShiftTest; 2] {
        let [all, legs] = &self.own_s;
        [ShiftTest::of(all, &self.music_s, self.seconds), ShiftTest::of(legs, &self.later(lag), self.seconds)]
    }

    /// Which beats of the music are hit: by all joints, on the beat; or by the legs, `lag` of a beat after it.
    pub fn hits(&self, lag: Option<f64>) -> BeatHits {
        let [all, legs] = &self.own_s;
        match lag {
            None => BeatHits::of(all, &self.music_s, self.seconds),
            Some(lag) => BeatHits::of(legs, &self.later(lag), self.seconds),
        }
    }

    /// Whether the legs' speed peaks at the music's tempo, its half or double.
    fn is_in_tempo(&self) -> bool {
        let (Some(first), Some(last), n) = (self.music_s.first(), self.music_s.last(), self.music_s.len()) else {
            return false;
        };
        let bpm = 60.0 * (n as f64 - 1.0) / (last - first);
        // a single beat makes `bpm` NaN, which is near nothing
        let near = |times: f64| self.pulse_bpm.is_some_and(|pulse| (pulse / (times * bpm) - 1.0).abs() <= SAME);
        [0.5, 1.0, 2.0].into_iter().any(near)
    }
}

/// The lag, as a fraction of a beat, at which the legs of clips score best; `None` without clips.
pub(crate) fn lag(all: &[BeatPair]) -> Option<f64> {
    let score = |lag: f64| all.iter().map(|p| BeatAlignment::of(&p.own_s[1], &p.later(lag)).motion).sum::<f64>();
    let lags: Vec<f64> = LAGS.map(|lag| f64::from(lag) / 100.0).collect();
    let scores: Vec<f64> = lags.par_iter().map(|lag| score(*lag)).collect();
    let best = lags.into_iter().zip(scores).max_by(|a, b| a.1.total_cmp(&b.1));
    best.filter(|_| !all.is_empty()).map(|(lag, _)| lag)
}

/// How dances keep to beats, their means.
#[derive(Debug, Clone, Serialize)]
pub struct BeatMetrics {
    /// The group's name.
    pub name: String,
    /// How many.
    pub dances: usize,
    /// All joints, on the beat.
    pub all: BeatScores,
    /// The legs, with the lag.
    pub legs: BeatScores,
    /// The lag, fraction of a beat.
    pub lag: f64,
    /// Share of the dances whose legs' speed peaks at the music's tempo, its half or double, to 5 %.
    pub in_tempo: f64,
}

/// The figures of one way to measure.
#[derive(Debug, Clone, Serialize)]
pub struct BeatScores {
    /// Beats of the dances, and of the music.
    pub beats: [usize; 2],
    /// BA_motion, BA_music and their harmonic mean.
    pub scores: [f64; 3],
    /// BA_motion and BA_music with the music shifted.
    pub shifted: [f64; 2],
    /// What BA_motion is by chance, by the formula.
    pub chance: Option<f64>,
    /// Of one dance: the shares of shifts that score lower.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub percentile: Option<[f64; 2]>,
    /// By how many standard deviations of chance the means exceed it.
    pub z: Option<[f64; 2]>,
}

impl BeatScores {
    fn of(all: &[ShiftTest]) -> Option<BeatScores> {
        let n = all.len() as f64;
        let mean = |of: &dyn Fn(&ShiftTest) -> f64| all.iter().map(of).sum::<f64>() / n;
        let pair = |a: BeatAlignment| [a.motion, a.music];
        let [motion, music] = [mean(&|h| h.found.motion), mean(&|h| h.found.music)];
        let chances: Option<Vec<f64>> = all.iter().map(|held| held.chance).collect();
        let one = all.first()?;
        Some(BeatScores {
            beats: [0, 1].map(|i| all.iter().map(|held| held.beats[i]).sum()),
            scores: [motion, music, BeatAlignment { motion, music }.both()],
            shifted: [mean(&|h| h.mean.motion), mean(&|h| h.mean.music)],
            chance: chances.map(|chances| chances.iter().sum::<f64>() / n),
            percentile: (all.len() == 1).then(|| pair(one.percentile)),
            z: ShiftTest::z(all).map(pair),
        })
    }
}

impl BeatMetrics {
    /// The means over dances; nothing of none.
    pub fn of(name: &str, all: &[BeatPair], lag: f64) -> Option<BeatMetrics> {
        let held: Vec<[ShiftTest; 2]> = all.par_iter().map(|pair| pair.scores_at(lag)).collect();
        let of = |way: usize| BeatScores::of(&held.iter().map(|held| held[way]).collect::<Vec<_>>());
        let in_tempo = all.iter().filter(|pair| pair.is_in_tempo()).count() as f64 / all.len() as f64;
        Some(BeatMetrics { name: name.into(), dances: all.len(), all: of(0)?, legs: of(1)?, lag, in_tempo })
    }
}

/// The heads over [`BeatScores`].
pub(super) const HEADS: &str =
    "  beats  music BA_motion  shifted  formula      z  BA_music  shifted      z      F percentile";

impl fmt::Display for BeatScores {
    /// Cells for a table.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([motion, music, both], [shifted, shifted_music]) = (self.scores, self.shifted);
        let chance = number(self.chance, 3);
        let [z, z_music] = self.z.map_or(["n/a".into(), "n/a".into()], |z| z.map(|z| format!("{z:.1}")));
        let percent = |[a, b]: [f64; 2]| format!("{:.0}, {:.0}", 100.0 * a, 100.0 * b);
        let percentile = self.percentile.map_or(String::new(), percent);
        let [own, of_music] = self.beats;
        write!(f, " {own:>6} {of_music:>6} {motion:>9.3} {shifted:>8.3} {chance:>8} {z:>6} {music:>9.3}")?;
        write!(f, " {shifted_music:>8.3} {z_music:>6} {both:>6.3} {percentile:>10}")
    }
}

/// The clips of a corpus that have beats, split by split, and the lag of those of train.
///
/// # Errors
/// Words that can't be decoded.
pub fn of_corpus(corpus: &Corpus, joints: &[usize]) -> Result<(Vec<BeatMetrics>, f64)> {
    let of_clip = |clip: &&ClipRecord| -> Result<BeatPair> {
        BeatPair::new(&Dance::of_corpus(corpus, clip)?.clip, joints, clip.beats_s())
    };
    let of_split = |(split, of): (Split, BeatSource)| -> Result<(String, Vec<BeatPair>)> {
        let has = |clip: &&ClipRecord| clip.beats.as_ref().is_some_and(|beats| beats.source == of);
        let clips: Vec<_> = corpus.split(split).filter(has).collect();
        let name = if of == BeatSource::Music { split.to_string() } else { format!("{split}, motion-derived") };
        Ok((name, clips.par_iter().map(of_clip).collect::<Result<_>>()?))
    };
    let ways = [BeatSource::Music, BeatSource::Motion].into_iter().flat_map(|of| Split::ALL.map(|split| (split, of)));
    let all = ways.map(of_split).collect::<Result<Vec<_>>>()?;
    // the lag of train clips with music; of motion-derived beats only where there are none
    let lag = lag(&all[0].1).or(lag(&all[Split::ALL.len()].1)).unwrap_or(0.0);
    Ok((all.iter().filter_map(|(name, pairs)| BeatMetrics::of(name, pairs, lag)).collect(), lag))
}

/// Dances against the beats of their music, together, against other music, half a beat off, and one by one; those without music
/// are left out.
///
/// # Errors
/// Those of resampling.
pub(crate) fn of_dances(
    dances: &[Dance],
    music_s: &[Option<Vec<f64>>],
    joints: &[usize],
    lag: f64,
) -> Result<Vec<BeatMetrics>> {
    let with: Vec<_> = dances.iter().zip(music_s).filter_map(|(d, music)| Some((d, music.as_ref()?))).collect();
    let all =
        with.par_iter().map(|(d, music)| BeatPair::new(&d.clip, joints, music)).collect::<Result<Vec<BeatPair>>>()?;
    let each =
        with.iter().zip(&all).filter_map(|((d, _), pair)| BeatMetrics::of(&d.name, std::slice::from_ref(pair), lag));
    Ok(BeatMetrics::of("dances", &all, lag).into_iter().chain(controls("the same", &all, lag)).chain(each).collect())
}

/// Controls of whether dances keep to their own music: the same dances against that of the next one that has other
/// music, from another start, and half a beat off. Empty where all have the same.
pub fn controls(name: &str, all: &[BeatPair], lag: f64) -> Vec<BeatMetrics> {
    let other = |i: usize| -> Option<BeatPair> {
        let next = all[i + 1..].iter().chain(&all[..i]).find(|next| !next.has_the_music_of(&all[i]))?;
        Some(all[i].against(moved(&next.music_s, all[i].seconds)))
    };
    let Some(others) = (0..all.len()).map(other).collect::<Option<Vec<BeatPair>>>() else { return Vec::new() };
    let off =
        |pair: &BeatPair| pair.against(pair.music_s.windows(2).map(|beats| 0.5 * (beats[0] + beats[1])).collect());
    let off: Vec<BeatPair> = all.iter().map(off).collect();
    let rows = [
        BeatMetrics::of(&format!("{name} against other music"), &others, lag),
        BeatMetrics::of(&format!("{name}, half a beat off"), &off, lag),
    ];
    rows.into_iter().flatten().collect()
}

/// The beats of the first `seconds` of a piece, rotated by [`ELSEWHERE_S`]: pieces often begin alike.
fn moved(beats_s: &[f64], seconds: f64) -> Vec<f64> {
    let inside = beats_s.iter().filter(|beat| (0.0..seconds).contains(*beat));
    let mut moved: Vec<f64> = inside.map(|beat| (beat + ELSEWHERE_S) % seconds).collect();
    moved.sort_by(f64::total_cmp);
    moved.dedup();
    moved
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_corpus::samples;
    use kinelm_motion::synth;

    #[test]
    fn made_up_dances_keep_to_their_beats_and_to_no_others() {
        let dances = synth::corpus(4, 16, 24.0, 20.0).unwrap();
        let joints: Vec<usize> = (0..22).collect();
        let pairs: Vec<BeatPair> =
            dances.iter().map(|d| BeatPair::new(&d.clip, &joints, &d.beats_s).unwrap()).collect();
        let lag = lag(&pairs).unwrap();
        // feet land on the beat and rest a little later
        assert!((0.05..0.3).contains(&lag), "{lag}");
        let of = |pairs: &[BeatPair]| BeatMetrics::of("all", pairs, lag).unwrap();
        let right = of(&pairs);
        let [other, off] = controls("the same", &pairs, lag).try_into().unwrap();
        let z = |kept: &BeatMetrics| kept.legs.z.unwrap()[0];
        assert!(z(&right) > 5.0 && z(&other) < 2.0 && z(&off) < 2.0, "{right:?} {other:?} {off:?}");
        assert_eq!([&other.name, &off.name], ["the same against other music", "the same, half a beat off"]);
        let alike: Vec<BeatPair> = pairs.iter().map(|pair| pair.against(dances[0].beats_s.clone())).collect();
        assert!(controls("the same", &alike, lag).is_empty());
        // one piece, begun elsewhere
        let later = |(i, pair): (usize, &BeatPair)| {
            pair.against(dances[0].beats_s.iter().map(|t| t - 0.7 * i as f64).collect())
        };
        assert!(controls("the same", &pairs.iter().enumerate().map(later).collect::<Vec<_>>(), lag).is_empty());
        assert!(right.in_tempo > other.in_tempo && right.dances == 16, "{right:?} {other:?}");
    }

    #[test]
    fn one_dance_has_a_percentile_and_none_no_figures() {
        let pair = BeatPair::new(&samples::walk(40), &[0, 4, 5], &[0.5, 1.0, 1.5]).unwrap();
        let one = BeatMetrics::of("walk", &[pair], 0.0).unwrap();
        assert!(one.all.percentile.is_some() && one.all.to_string().len() <= HEADS.len() + 2, "{}", one.all);
        assert!(BeatMetrics::of("none", &[], 0.0).is_none() && super::lag(&[]).is_none());
    }
}
