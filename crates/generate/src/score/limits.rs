//! What is usual of train clips, and what none of them does.

use super::Measures;
use crate::{Error, Result};
use kinelm_model::run::LIMITS;
use kinelm_motion::metric::Extremes;
use kinelm_motion::smpl;
use kinelm_store::input;
use serde::{Deserialize, Serialize};
use std::path::Path;

const VERSION: u32 = 1;
/// Nothing is beyond a train clip's most by less than this share of it: coding rounds, and a block isn't one of its windows.
const MARGIN: f64 = 0.02;
/// The least spreads: a tiny excess over nearly equal windows would decide the score. In the units of the measures; of
/// the logarithm of the speed, and of shaking as a share of its median.
const LEAST: [f64; SOFT] = [1.0, 0.05, 0.05, 0.05, 0.2, 0.2, 0.2, 0.02];
const SOFT: usize = 8;
/// The places of some among them: shares of frames that most windows have none of, the speed, and shaking.
const RARE: [usize; 3] = [1, 2, 7];
const SPEED: usize = 5;
const SHAKE: usize = 6;
/// Up to this quantile over train windows a rare measure is usual; of the others the quartiles are.
const RARELY: f64 = 0.9;

/// How train clips move.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    version: u32,
    /// Of [`Measures::outside_cm`], [`Measures::outside_share`], [`Measures::kick_share`], [`Measures::slide_share`],
    /// [`Measures::penetration_cm`].
    feet: [Usual; 5],
    /// Of ln [`Measures::speed_cm_s`], of [`Measures::shake`] and of [`Measures::snap_share`]; `None` where no clip says what is usual.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pace: Option<[Usual; 3]>,
    /// What no train clip does; `None` where there was none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    most: Option<Most>,
}

/// What is usual of a measure.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Usual {
    /// Below this it counts too, in the same spreads; `None`: less is never worse.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<f64>,
    /// Up to this it doesn't count.
    pub to: f64,
    /// The distance between the first and the third quartile.
    pub spread: f64,
}

/// The most that a train clip does.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Most {
    /// (24) m/s, by joint.
    fastest_m_s: Vec<f64>,
    /// (24) degrees from frame to frame.
    turn_deg: Vec<f64>,
    /// Degrees, of [`HINGES`](kinelm_motion::metric::HINGES).
    bend_deg: [f64; 4],
    /// The lowest pelvis, metres.
    lowest_m: f64,
    /// The slowest window, cm/s.
    slowest_cm_s: f64,
}

impl Usual {
    /// How far `x` is beyond, in spreads.
    pub fn beyond(self, x: f64) -> f64 {
        let below = self.from.map_or(0.0, |from| from - x);
        ((x - self.to).max(below) / self.spread).max(0.0)
    }
}

impl Default for Limits {
    /// Of a run without train clips: balance, kicks and feet, as 29 dances of the CMU set have them.
    fn default() -> Limits {
        let usual = |to, spread| Usual { from: None, to, spread };
        let feet = [usual(2.8, 2.5), usual(0.15, 0.05), usual(0.05, 0.05), usual(0.94, 0.09), usual(0.0, 0.2)];
        Limits { version: VERSION, feet, pace: None, most: None }
    }
}

impl Limits {
    /// Of windows of train clips, see [`super::Scorer::windows`], each with the weight of its corpus; without one they are
    /// [`Limits::default`].
    pub fn of(windows: &[(Measures, f64)]) -> Limits {
        let mut soft: [Vec<(f64, f64)>; SOFT] = Default::default();
        let (mut most, mut lowest_m, mut slowest_cm_s) = (Extremes::default(), f64::INFINITY, f64::INFINITY);
        for (found, weight) in windows {
            soft.iter_mut().zip(values(found)).for_each(|(all, x)| all.push((x, *weight)));
            most.add(&found.most);
            lowest_m = lowest_m.min(found.lowest_m);
            slowest_cm_s = slowest_cm_s.min(found.speed_cm_s);
        }
        if windows.is_empty() {
            return Limits::default();
        }
        soft.iter_mut().for_each(|all| all.sort_by(|a, b| a.0.total_cmp(&b.0)));
        let usual = |i: usize| {
            let all = &soft[i];
            let [low, median, high] = [0.25, 0.5, 0.75].map(|share| at_share(all, share));
            // most windows of real dances have no kick and no snap, and those that have are no worse for it
            let to = if RARE.contains(&i) { at_share(all, RARELY) } else { high };
            // shaking has no unit of its own
            let least = if i == SHAKE { LEAST[i] * median } else { LEAST[i] };
            Usual { from: (i == SPEED).then_some(median), to, spread: (high - low).max(least) }
        };
        let feet = [0, 1, 2, 3, 4].map(usual);
        let Extremes { fastest_m_s, turn_deg, bend_deg, .. } = most;
        let most = Most { fastest_m_s, turn_deg, bend_deg, lowest_m, slowest_cm_s };
        Limits { version: VERSION, feet, pace: Some([SPEED, SHAKE, 7].map(usual)), most: Some(most) }
    }

    /// The file's text.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("limits are plain data") + "\n"
    }

    /// Those of a run; the default ones where it has none.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] for text that is none, or of another version.
    pub fn load(run: &Path) -> Result<Limits> {
        let path = run.join(LIMITS);
        let Some(text) = input::text_if_there(&path).map_err(Error::io(&path))? else { return Ok(Limits::default()) };
        let help = "delete it, and `kinelm pretrain resume` writes it anew";
        let wrong = |found: String, expected: &str| Error::file(&path, found, expected, help);
        let found: Limits = serde_json::from_str(&text).map_err(|e| wrong(e.to_string(), "limits of a run"))?;
        if found.version != VERSION {
            return Err(wrong(format!("version {}", found.version), "version 1"));
        }
        let mut all = found.feet.iter().chain(found.pace.iter().flatten());
        if let Some(usual) = all.find(|usual| !(usual.spread > 0.0 && usual.to.is_finite())) {
            return Err(wrong(format!("{usual:?}"), "spreads above 0"));
        }
        let lengths = |most: &Most| [most.fastest_m_s.len(), most.turn_deg.len()];
        if let Some(found) = found.most.as_ref().map(lengths).filter(|lengths| *lengths != [24; 2]) {
            return Err(wrong(format!("{found:?} joints"), "24"));
        }
        Ok(found)
    }

    /// The measures of which something is usual, each with it.
    pub(super) fn usual(&self, found: &Measures) -> [(f64, Option<Usual>); SOFT] {
        let mut all = self.feet.into_iter().chain(self.pace.into_iter().flatten());
        values(found).map(|x| (x, all.next()))
    }

    /// What no train clip does, each by the share that it goes beyond: joints too fast, snaps, bends, a fall, a stand-still.
    pub(super) fn never(&self, found: &Measures) -> [Option<f64>; 5] {
        let Some(most) = &self.most else { return [None; 5] };
        let beyond = |found: &[f64], most: &[f64]| {
            let by = found.iter().zip(most).filter(|(_, most)| **most > 0.0).map(|(x, most)| x / most - 1.0);
            by.fold(0.0, f64::max)
        };
        let low = most.lowest_m - found.lowest_m;
        [
            beyond(&found.most.fastest_m_s, &most.fastest_m_s),
            beyond(&found.most.turn_deg, &most.turn_deg),
            beyond(&found.most.bend_deg, &most.bend_deg),
            low / smpl::STANDING_PELVIS_M,
            1.0 - found.speed_cm_s / most.slowest_cm_s,
        ]
        .map(|by| Some(by).filter(|by| *by > MARGIN))
    }
}

/// The measures of which something is usual; of the speed its logarithm.
fn values(found: &Measures) -> [f64; SOFT] {
    let Measures { outside_cm, outside_share, kick_share, slide_share, penetration_cm, shake, snap_share, .. } = *found;
    // a tenth of a millimetre per second stands still
    let speed = found.speed_cm_s.max(0.01).ln();
    [outside_cm, outside_share, kick_share, slide_share, penetration_cm, speed, shake, snap_share]
}

/// The value below which a share of the weights is, of sorted values that aren't empty.
fn at_share(all: &[(f64, f64)], share: f64) -> f64 {
    let mut left = share * all.iter().map(|(_, weight)| weight).sum::<f64>();
    let at = all.iter().position(|(_, weight)| {
        left -= weight;
        left <= 0.0
    });
    all[at.unwrap_or(all.len() - 1)].0
}
