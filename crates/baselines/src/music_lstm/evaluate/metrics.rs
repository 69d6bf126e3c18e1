//! Metrics of one dance beside a true one, and of many.

use crate::{FPS, Mean, Result};
use kinelm_evaluate::dance::freeze;
use kinelm_evaluate::dance::freeze::Freezing;
use kinelm_evaluate::dance::positions::JointPositions;
use kinelm_motion::metric::{angular_effort, jitter};
use kinelm_motion::rotation::angle_between;
use kinelm_motion::{Clip, Quat};
use kinelm_spectral::filter::Filter;
use serde::Serialize;

/// The hip flips if it turns by more than this from frame to frame.
const FLIP: f64 = std::f64::consts::FRAC_PI_2;
/// Order of the low-pass filter.
const ORDER: usize = 2;

/// The energy of a dance at every frame, cm/s.
pub fn energy(clip: &Clip) -> Vec<f64> {
    freeze::energy(&JointPositions { positions: clip.positions(), joints: clip.joints(), fps: clip.fps() })
}

/// One dance beside the true one of its clip.
pub struct One {
    take: String,
    seconds: f64,
    frames: f64,
    /// Mean angle of local rotations to the true ones, degrees: of all joints, of the root, of the mean pose.
    degrees: [f64; 3],
    /// Mean angle to the dance to the clip's own music.
    from_own: Option<f64>,
    /// Mean angle to the true dance of the dance to the clip's own music, over the same frames.
    own: Option<f64>,
    /// Mean angular speed of a joint, rad/s, and the true dance's.
    speed: [f64; 2],
    /// m/s³: as it is, filtered, the true dance's.
    jitter: [f64; 3],
    flips: f64,
    freezing: Freezing,
}

/// Mean angle between the rotations of two dances, over the frames that both have and the joints that `of` selects,
/// degrees.
fn degrees(a: &Clip, b: &Clip, of: impl Fn(usize) -> bool) -> f64 {
    let j = a.joints();
    let pairs = a.rotations().iter().zip(b.rotations()).enumerate().filter(|(i, _)| of(i % j));
    let (sum, n) = pairs.fold((0.0, 0.0), |(sum, n), (_, (a, b))| (sum + angle_between(*a, *b), n + 1.0));
    (sum / f64::max(n, 1.0)).to_degrees()
}

/// Mean angular speed of a joint, rad/s.
fn speed(clip: &Clip) -> f64 {
    let all = angular_effort(clip.rotations(), &vec![1.0; clip.joints()], clip.fps());
    all.iter().sum::<f64>() / (all.len() * clip.joints()).max(1) as f64
}

/// Steps in which the root turns by more than 90 degrees.
fn flips(clip: &Clip) -> usize {
    let root = |f: usize| clip.pose(f)[0];
    (1..clip.frames()).filter(|f| angle_between(root(f - 1), root(*f)) > FLIP).count()
}

impl One {
    /// Of a dance and its take. `own`: the dance to the clip's own music, if this is to other music.
    pub fn of(
        take: &str,
        dance: &Clip,
        truth: &Clip,
        own: Option<&Clip>,
        mean: &[Quat],
        threshold: f64,
        cutoff_hz: f64,
    ) -> Result<One> {
        let frames = dance.frames().min(truth.frames());
        let (dance, truth) = (dance.slice(0..frames), truth.slice(0..frames));
        let still = Clip::new(truth.skeleton().clone(), FPS, truth.root().to_vec(), mean.repeat(frames))?;
        let smooth = Filter::Butterworth { order: ORDER, cutoff_hz }.apply(&dance)?.clip;
        let jerk = |clip: &Clip| jitter(clip).unwrap_or(0.0);
        Ok(One {
            take: take.to_owned(),
            seconds: frames as f64 / FPS,
            frames: frames as f64,
            degrees: [
                degrees(&dance, &truth, |_| true),
                degrees(&dance, &truth, |j| j == 0),
                degrees(&still, &truth, |_| true),
            ],
            from_own: own.map(|own| degrees(&dance, own, |_| true)),
            own: own.map(|own| degrees(&own.slice(0..frames.min(own.frames())), &truth, |_| true)),
            speed: [speed(&dance), speed(&truth)],
            jitter: [jerk(&dance), jerk(&smooth), jerk(&truth)],
            flips: flips(&dance) as f64,
            freezing: Freezing::of(&energy(&dance), FPS, threshold),
        })
    }
}

/// Metrics of dances to some music. Means are over frames.
#[derive(Debug, Clone, Serialize)]
pub struct Metrics {
    /// Dances.
    pub dances: usize,
    /// Their total length.
    pub seconds: f64,
    /// Angle to the true rotations, degrees.
    pub degrees: Mean,
    /// The same for the root alone.
    pub hip_degrees: Mean,
    /// The same for the training clips' mean pose.
    pub mean_pose_degrees: Mean,
    /// Difference to the angle of the dance to the clip's own music, if this is to other music.
    pub worse_degrees: Option<Mean>,
    /// Angle to the dance to the clip's own music.
    pub from_own_degrees: Option<Mean>,
    /// Mean angular speed of a joint, rad/s.
    pub speed_rad_s: f64,
    /// The same over that of the true dances.
    pub speed_ratio: Mean,
    /// Jitter over that of the true dances.
    pub jitter_ratio: Mean,
    /// The same after the low-pass filter.
    pub filtered_jitter_ratio: Mean,
    /// Steps a minute in which the root turns by more than 90 degrees.
    pub hip_flips_per_minute: Mean,
    /// Share of still frames.
    pub still: Mean,
}

impl Metrics {
    /// Of dances.
    pub(crate) fn of(all: &[One]) -> Metrics {
        let mean = |pick: &dyn Fn(&One) -> [f64; 2]| {
            let parts: Vec<(&str, f64, f64)> = all.iter().map(|one| (&*one.take, pick(one)[0], pick(one)[1])).collect();
            Mean::of(parts.iter().copied())
        };
        let over = |pick: fn(&One) -> f64| mean(&|one| [pick(one) * one.frames, one.frames]);
        // rows to the clips' own music have neither
        let maybe = |pick: fn(&One) -> Option<f64>| {
            all.iter()
                .all(|one| pick(one).is_some())
                .then(|| mean(&|one| [pick(one).unwrap_or(0.0) * one.frames, one.frames]))
        };
        // a ratio of sums: a mean of ratios would be that of the dances that hardly move
        let ratio = |pick: fn(&One) -> [f64; 2]| mean(&|one| pick(one).map(|x| x * one.frames));
        Metrics {
            dances: all.len(),
            seconds: all.iter().map(|one| one.seconds).sum(),
            degrees: over(|one| one.degrees[0]),
            hip_degrees: over(|one| one.degrees[1]),
            mean_pose_degrees: over(|one| one.degrees[2]),
            worse_degrees: maybe(|one| one.own.map(|own| one.degrees[0] - own)),
            from_own_degrees: maybe(|one| one.from_own),
            speed_rad_s: over(|one| one.speed[0]).mean,
            speed_ratio: ratio(|one| one.speed),
            jitter_ratio: ratio(|one| [one.jitter[0], one.jitter[2]]),
            filtered_jitter_ratio: ratio(|one| [one.jitter[1], one.jitter[2]]),
            hip_flips_per_minute: mean(&|one| [one.flips, one.seconds / 60.0]),
            still: mean(&|one| [one.freezing.still as f64, one.freezing.frames as f64]),
        }
    }
}

/// Metrics of a long dance.
#[derive(Debug, Clone, Serialize)]
pub struct LongDance {
    /// Its frames.
    pub frames: usize,
    /// The time at which it freezes, seconds; `None`: it doesn't.
    pub freezes_at_s: Option<f64>,
    /// Share of still frames.
    pub still: f64,
    /// Mean angular speed of a joint, rad/s.
    pub speed_rad_s: f64,
    /// Steps a minute in which the root turns by more than 90 degrees.
    pub hip_flips_per_minute: f64,
    /// Generation speed, without reading the music.
    pub frames_per_second: f64,
}

impl LongDance {
    /// Of a dance that was generated in `seconds`.
    pub(crate) fn of(clip: &Clip, threshold: f64, seconds: f64) -> LongDance {
        let freezing = Freezing::of(&energy(clip), FPS, threshold);
        LongDance {
            frames: clip.frames(),
            freezes_at_s: freezing.time_to_freeze_s,
            still: freezing.still as f64 / freezing.frames.max(1) as f64,
            speed_rad_s: speed(clip),
            hip_flips_per_minute: flips(clip) as f64 / (clip.frames() as f64 / FPS / 60.0),
            frames_per_second: clip.frames() as f64 / seconds,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::{Skeleton, Vec3};

    /// Two joints; the root turns about y by these angles.
    fn clip(turns: impl IntoIterator<Item = f64>) -> Clip {
        let names = ["hip", "hand"].map(String::from).to_vec();
        let body = Skeleton::new(names, vec![None, Some(0)], vec![Vec3::ZERO, Vec3::X], vec![]).unwrap();
        let rotations: Vec<Quat> = turns.into_iter().flat_map(|a| [Quat::from_rotation_y(a), Quat::IDENTITY]).collect();
        Clip::new(body.into(), FPS, vec![Vec3::ZERO; rotations.len() / 2], rotations).unwrap()
    }

    #[test]
    fn by_hand() {
        let truth = clip((0..60).map(|f| f as f64 / FPS));
        let twice = clip((0..60).map(|f| 2.0 * f as f64 / FPS));
        let of = |dance: &Clip| {
            let mean = [Quat::IDENTITY; 2];
            Metrics::of(&[One::of("a", dance, &truth, Some(&truth), &mean, 1.0, 6.0).unwrap()])
        };
        let own = of(&truth);
        assert!(own.degrees.mean < 1e-6 && own.hip_flips_per_minute.mean == 0.0);
        assert_eq!((own.speed_ratio.mean, own.jitter_ratio.mean, own.still.mean), (1.0, 1.0, 0.0));
        // one radian a second of one of two joints, for two seconds: on average the root is 59/60 rad from the mean
        // pose, the other joint 0
        assert!((own.speed_rad_s - 0.5).abs() < 1e-9 && (own.mean_pose_degrees.mean - 28.17).abs() < 0.1);
        let fast = of(&twice);
        // jerk grows with the cube of the speed
        assert!((fast.speed_ratio.mean - 2.0).abs() < 1e-9 && (fast.jitter_ratio.mean - 8.0).abs() < 0.1);
        assert!((fast.degrees.mean - 28.17).abs() < 0.1 && (fast.hip_degrees.mean - 56.3).abs() < 0.2);
        assert_eq!(fast.worse_degrees.unwrap().mean, fast.degrees.mean);
        // half a turn every tenth frame: five in two seconds
        let flips = of(&clip((0..60).map(|f| if f / 10 % 2 == 0 { 0.0 } else { 3.0 })));
        assert!((flips.hip_flips_per_minute.mean - 150.0).abs() < 1e-9);
        assert_eq!(of(&clip([0.3; 60])).still.mean, 1.0);
        let frozen = LongDance::of(&clip((0..600).map(|f| f.min(300) as f64 / FPS)), 1.0, 2.0);
        assert!((frozen.freezes_at_s.unwrap() - 10.0).abs() < 0.5 && frozen.frames_per_second == 300.0);
    }
}
