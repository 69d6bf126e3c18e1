//! Whether and when a dance freezes: docs/measures.md, "Freezing".
//!
//! e is the mean speed of the joints, E(t) its mean over the steps within 0.25 s of frame t. The threshold is the first
//! percentile of E over the real training frames of the same rig, rate and joints, so 1 % of them are not above it by
//! construction; more where as many are exactly at rest, which a threshold of 0 would miss with a strict comparison.

use super::positions::JointPositions;

/// Half the window of E, seconds.
const HALF_S: f64 = 0.25;
/// The share of real training frames below the threshold.
const PERCENTILE: f64 = 0.01;
/// The shortest standstill at the end of a dance that counts as frozen, seconds.
const FROZEN_S: f64 = 1.0;

/// Less is rounding, cm/s: the threshold may be 0.
pub(super) const ROUNDING_CM_S: f64 = 1e-6;

/// E, (F) cm/s: at every frame the mean of the joints' speed over the steps within a quarter of a second, as far as the
/// clip has them; 0 for a clip of one frame.
pub fn energy(places: &JointPositions) -> Vec<f64> {
    let steps = places.speeds();
    let half = ((HALF_S * places.fps).round() as usize).max(1);
    // differences of these sums leave rounding in the E of a body at rest, hence [`ROUNDING_CM_S`]
    let mut before = vec![0.0];
    for speed in &steps {
        before.push(before[before.len() - 1] + speed);
    }
    let mean = |f: usize| {
        let (first, end) = (f.saturating_sub(half), (f + half).min(steps.len()));
        if end > first { 100.0 * (before[end] - before[first]) / (end - first) as f64 } else { 0.0 }
    };
    (0..places.frames()).map(mean).collect()
}

/// The threshold x, cm/s: the first percentile of E over real training frames, linear between ranks. `None` of no frames.
pub fn threshold(mut energies: Vec<f64>) -> Option<f64> {
    energies.sort_by(f64::total_cmp);
    super::percentile(&energies, PERCENTILE)
}

/// The threshold of frames that come in pieces: only the lowest are stored, 1 to 2 % of all.
#[derive(Debug)]
pub(crate) struct Threshold {
    /// How many of the lowest are needed.
    needed: usize,
    all: usize,
    lowest: Vec<f64>,
}

impl Threshold {
    /// Of at most `frames` frames.
    pub(crate) fn of(frames: usize) -> Threshold {
        Threshold { needed: super::ranks(frames, PERCENTILE), all: 0, lowest: Vec::new() }
    }

    /// Some frames' E.
    pub(crate) fn add(&mut self, energies: &[f64]) {
        self.all += energies.len();
        self.lowest.extend(energies);
        // trimmed at twice the size, so that the linear selection costs each frame O(1)
        if self.lowest.len() > 2 * self.needed {
            self.lowest.select_nth_unstable_by(self.needed - 1, f64::total_cmp);
            self.lowest.truncate(self.needed);
        }
    }

    /// [`threshold`] of all of them.
    pub(crate) fn get(mut self) -> Option<f64> {
        self.lowest.sort_by(f64::total_cmp);
        super::percentile_of(&self.lowest, self.all, PERCENTILE)
    }
}

/// Frames of a dance that stand still.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Freezing {
    /// F.
    pub frames: usize,
    /// Of these the ones with E not above the threshold.
    pub still: usize,
    /// The same for every five seconds: frames, and still ones.
    pub per_5_s: Vec<[usize; 2]>,
    /// Seconds from the beginning to where it stands still up to the end, for at least a second; `None`: it never does.
    pub time_to_freeze_s: Option<f64>,
    /// How long it is, seconds.
    pub duration_s: f64,
}

impl Freezing {
    /// Of a dance's E at `fps`, with the threshold `x`.
    pub fn of(energy: &[f64], fps: f64, x: f64) -> Freezing {
        let still: Vec<bool> = energy.iter().map(|e| *e <= x + ROUNDING_CM_S).collect();
        let count = |frames: &[bool]| [frames.len(), frames.iter().filter(|s| **s).count()];
        let [frames, all_still] = count(&still);
        let moving = still.iter().rposition(|s| !s).map_or(0, |last| last + 1);
        let frozen = (frames - moving) as f64 / fps;
        Freezing {
            frames,
            still: all_still,
            per_5_s: still.chunks(((5.0 * fps).round() as usize).max(1)).map(count).collect(),
            // 20 frames at 20 fps are a second, whatever the quotient rounds to
            time_to_freeze_s: (frozen >= FROZEN_S - 1e-9).then_some(moving as f64 / fps),
            duration_s: frames as f64 / fps,
        }
    }
}

/// The freezing of several dances together.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Summary {
    /// Dances.
    pub dances: usize,
    /// Frames of all.
    pub frames: usize,
    /// Share of frames that stand still; `None` of no frames.
    pub freeze_rate: Option<f64>,
    /// Standard deviation over the dances of each one's share, dividing by their number.
    pub freeze_rate_sd: Option<f64>,
    /// The share for every five seconds, over the dances that are so long.
    pub per_5_s: Vec<f64>,
    /// Median over the dances of the time to freeze, seconds; `None`: the dance in the middle never freezes.
    pub median_time_to_freeze_s: Option<f64>,
    /// Share of dances that never freeze; `None` of no dances.
    pub never: Option<f64>,
    /// The shortest and the longest dance, seconds.
    pub duration_s: [f64; 2],
}

/// Puts the figures of several dances together.
pub fn summary(all: &[Freezing]) -> Summary {
    let share = |still: usize, frames: usize| (frames > 0).then(|| still as f64 / frames as f64);
    let (frames, still) = all.iter().fold((0, 0), |(f, s), one| (f + one.frames, s + one.still));
    let shares: Vec<f64> = all.iter().filter_map(|one| share(one.still, one.frames)).collect();
    let longest = all.iter().map(|one| one.per_5_s.len()).max().unwrap_or(0);
    let of_5_s = |i: usize| {
        let both = all.iter().filter_map(|one| one.per_5_s.get(i));
        let (frames, still) = both.fold((0, 0), |(f, s), &[frames, still]| (f + frames, s + still));
        still as f64 / frames.max(1) as f64
    };
    let mut times: Vec<f64> = all.iter().map(|one| one.time_to_freeze_s.unwrap_or(f64::INFINITY)).collect();
    times.sort_by(f64::total_cmp);
    // of an even number the later one: half of the dances freeze by then
    let median = times.get(times.len() / 2).copied().filter(|t| t.is_finite());
    let never = times.iter().filter(|t| t.is_infinite()).count();
    let durations = || all.iter().map(|one| one.duration_s);
    Summary {
        dances: all.len(),
        frames,
        freeze_rate: share(still, frames),
        freeze_rate_sd: super::sd(&shares),
        per_5_s: (0..longest).map(of_5_s).collect(),
        median_time_to_freeze_s: median,
        never: share(never, all.len()),
        duration_s: [durations().fold(f64::INFINITY, f64::min), durations().fold(0.0, f64::max)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::Vec3;

    /// A joint that moves along x at these speeds, m/s, from frame to frame, 20 frames a second.
    fn moving(speeds: &[f64]) -> JointPositions {
        let mut x = 0.0;
        let steps = speeds.iter().map(|speed| {
            x += speed / 20.0;
            Vec3::X * x
        });
        JointPositions { positions: std::iter::once(Vec3::ZERO).chain(steps).collect(), joints: 1, fps: 20.0 }
    }

    #[test]
    fn energy_is_the_mean_over_half_a_second() {
        let e = energy(&moving(&[2.0; 30]));
        assert!(e.len() == 31 && e.iter().all(|e| (e - 200.0).abs() < 1e-9));
        // ten steps at 1 m/s, then rest: at the border half of the ten steps around are of either kind
        let e = energy(&moving(&[[1.0; 10], [0.0; 10]].concat()));
        for (f, expected) in [(0, 100.0), (5, 100.0), (6, 90.0), (10, 50.0), (14, 10.0), (15, 0.0), (20, 0.0)] {
            assert!((e[f] - expected).abs() < 1e-9, "frame {f}: {}", e[f]);
        }
        assert_eq!(
            (energy(&moving(&[])), energy(&JointPositions { positions: vec![], joints: 1, fps: 20.0 })),
            (vec![0.0], vec![])
        );
    }

    #[test]
    fn one_percent_of_the_training_frames_are_below_the_threshold() {
        let x = threshold((0..1000).rev().map(f64::from).collect()).unwrap();
        // rank 0.01 * 999, between 9 and 10
        assert!((x - 9.99).abs() < 1e-9, "{x}");
        assert_eq!(threshold(vec![]), None);
        // in pieces, it is the same number
        for frames in [0, 1, 2, 99, 100, 101, 5_000] {
            let energies: Vec<f64> = (0..frames).map(|i| f64::from(i * 7_919 % 5_003).sqrt()).collect();
            let mut pieces = Threshold::of(energies.len());
            energies.chunks(37).for_each(|some| pieces.add(some));
            assert_eq!(pieces.get(), threshold(energies), "{frames}");
        }
    }

    #[test]
    fn the_time_to_freeze_is_where_the_last_standstill_begins() {
        let of = |e: &[f64]| Freezing::of(e, 20.0, 1.0);
        let frozen = of(&[[2.0; 30], [0.5; 30]].concat());
        assert_eq!((frozen.still, frozen.time_to_freeze_s, frozen.duration_s), (30, Some(1.5), 3.0));
        assert_eq!(of(&[[0.5; 30], [2.0; 30]].concat()).time_to_freeze_s, None);
        // a standstill of 0.95 s at the end doesn't count, one of 1 s does
        assert_eq!(of(&[vec![2.0; 30], vec![0.5; 19]].concat()).time_to_freeze_s, None);
        assert_eq!(of(&[vec![2.0; 30], vec![0.5; 20]].concat()).time_to_freeze_s, Some(1.5));
        assert_eq!(of(&[0.5; 200]).time_to_freeze_s, Some(0.0));
        assert_eq!(of(&[[2.0; 100], [0.5; 100]].concat()).per_5_s, [[100, 0], [100, 100]]);
        assert_eq!((of(&[]).time_to_freeze_s, of(&[1.0]).still), (None, 1));
    }

    #[test]
    fn several_dances_together() {
        let of = |moving: usize, still: usize| Freezing::of(&[vec![2.0; moving], vec![0.5; still]].concat(), 20.0, 1.0);
        let s = summary(&[of(100, 100), of(150, 50), of(200, 0)]);
        assert_eq!((s.dances, s.frames, s.freeze_rate), (3, 600, Some(0.25)));
        assert_eq!((s.median_time_to_freeze_s, s.never), (Some(7.5), Some(1.0 / 3.0)));
        assert_eq!((s.per_5_s, s.duration_s), (vec![0.0, 0.5], [10.0, 10.0]));
        // shares 1/2, 1/4, 0
        assert!((s.freeze_rate_sd.unwrap() - (1.0f64 / 24.0).sqrt()).abs() < 1e-12);
        assert_eq!(summary(&[of(200, 0), of(100, 100)]).median_time_to_freeze_s, None);
        assert_eq!((summary(&[]).freeze_rate, summary(&[]).never), (None, None));
    }
}
