//! Metrics of one rollout, and of many.

use crate::aclstm::loss::loss;
use crate::aclstm::run::Trained;
use crate::form::{Form, frames_of_steps, steps};
use crate::{FPS, Mean, PartWeights, Result};
use kinelm_evaluate::dance::freeze;
use kinelm_evaluate::dance::freeze::{Freezing, Summary};
use kinelm_evaluate::dance::positions::JointPositions;
use kinelm_motion::metric::{GeodesicError, Mpjpe};
use kinelm_motion::rotation::angle_between;
use kinelm_motion::{Clip, GlobalPose, Quat, Vec3};
use serde::Serialize;

use super::curves::Curves;
use super::{COMPARED, SHORT};

/// A joint flips that turns by more than this from frame to frame.
const FLIP: f64 = std::f64::consts::FRAC_PI_2;

/// The energy of a dance at every frame, cm/s: in the world, and with the hip fixed at 0.
pub struct Energy {
    pub world: Vec<f64>,
    pub pose: Vec<f64>,
}

impl Energy {
    fn of(at: Vec<Vec3>, joints: usize) -> Energy {
        let fixed = at.chunks_exact(joints).flat_map(|frame| frame.iter().map(|p| *p - frame[0])).collect();
        let energy = |at| freeze::energy(&JointPositions { positions: at, joints, fps: FPS });
        Energy { world: energy(at), pose: energy(fixed) }
    }

    pub fn of_clip(clip: &Clip) -> Result<Energy> {
        Ok(Energy::of(clip.positions(), clip.joints()))
    }
}

/// Speed and freezing of one dance.
#[derive(Debug, Clone)]
pub struct Movement {
    world: Freezing,
    pose: Freezing,
    /// Mean speed of the joints, cm/s.
    speed: f64,
    /// Per second: the frames, and those that are still with the hip fixed.
    per_s: Vec<[usize; 2]>,
}

impl Movement {
    fn of(energy: &Energy, frames: usize, [x, y]: [f64; 2]) -> Movement {
        let part = |all: &[f64]| all[..frames.min(all.len())].to_vec();
        let (world, pose) = (part(&energy.world), part(&energy.pose));
        // E is a moving mean of the speed, so that its mean is the speed's but for the ends
        let speed = world.iter().sum::<f64>() / world.len().max(1) as f64;
        let still = |frames: &[f64]| [frames.len(), Freezing::of(frames, FPS, y).still];
        let per_s = pose.chunks(FPS as usize).map(still).collect();
        Movement { world: Freezing::of(&world, FPS, x), pose: Freezing::of(&pose, FPS, y), speed, per_s }
    }
}

/// Movement and [`flips`] of a real clip.
pub fn of_real(clip: &Clip, thresholds: [f64; 2]) -> Result<(Movement, [usize; 2])> {
    Ok((Movement::of(&Energy::of_clip(clip)?, clip.frames(), thresholds), flips(clip)))
}

/// Steps in which some joint turns by more than 90 degrees in the world, and all steps.
fn flips(clip: &Clip) -> [usize; 2] {
    let mut before: Vec<Quat> = Vec::new();
    let mut pose = GlobalPose::default();
    let mut found = 0;
    for f in 0..clip.frames() {
        pose.set(clip.skeleton(), clip.root()[f], clip.pose(f));
        // no flip in the first frame, where `before` is empty
        found += usize::from(before.iter().zip(&pose.rotations).any(|(a, b)| angle_between(*a, *b) > FLIP));
        before.clone_from(&pose.rotations);
    }
    [found, clip.frames().saturating_sub(1)]
}

/// The rollout of one seed.
pub struct Rollout {
    loss: f64,
    still_loss: f64,
    root_cm: f64,
    still_root_cm: f64,
    degrees: f64,
    still_degrees: f64,
    short: Movement,
    long: Movement,
    flips: [usize; 2],
    curves: Curves,
}

impl Rollout {
    /// Of (F, C) `rollout` steps after the frame `last` (C); `truth` are the true frames after it, one more than are
    /// compared.
    pub fn of(
        trained: &Trained,
        last: &[f64],
        truth: &[f64],
        rollout: &[f64],
        clip: &Clip,
        thresholds: [f64; 2],
    ) -> Result<Rollout> {
        let (coder, c, skeleton) = (&trained.coder, trained.shape.channels, clip.skeleton());
        let narrow = |rows: &[f64]| rows.iter().map(|x| *x as f32).collect::<Vec<f32>>();
        let true_steps = narrow(&steps(truth, c));
        let error = |found: &[f64]| {
            loss(coder.form(), PartWeights::EVEN, c, &narrow(found), &true_steps, &mut vec![0.0; COMPARED * c]).loss
        };
        let mut still = last.repeat(COMPARED);
        // in steps, a hip at rest moves by 0
        still.chunks_exact_mut(c).for_each(|step| (step[0], step[2]) = (0.0, 0.0));
        let start = [truth[0], truth[2]];
        let predicted = frames_of_steps(&rollout[..COMPARED * c], c, start);
        let held = last.repeat(COMPARED);
        let compared = &truth[..COMPARED * c];
        let joints = coder.joints();
        let positions = |frames: &[f64]| {
            let all = coder.places(frames, skeleton);
            let points = all.len() / (frames.len() / c).max(1);
            // a frame's joints come first, its end sites after them
            all.chunks_exact(points).flat_map(|frame| frame[..joints].to_vec()).collect::<Vec<Vec3>>()
        };
        let true_positions = positions(compared);
        let root_cm = |frames: &[f64]| {
            let of = |(found, truth): (&[Vec3], &[Vec3])| {
                let mut error = Mpjpe::default();
                error.add_positions(found, truth, joints)?;
                Ok(error.root_mm() / 10.0)
            };
            positions(frames).chunks(joints).zip(true_positions.chunks(joints)).map(of).collect::<Result<Vec<f64>>>()
        };
        let true_clip = coder.clip(compared, skeleton, FPS)?;
        let degrees = |frames: &[f64]| {
            let clip = coder.clip(frames, skeleton, FPS)?;
            let of = |f: usize| {
                let mut error = GeodesicError::new((0..joints).collect());
                error.add(&clip.slice(f..f + 1), &true_clip.slice(f..f + 1))?;
                Ok(error.mean().to_degrees())
            };
            (0..COMPARED).map(of).collect::<Result<Vec<f64>>>()
        };
        let frames = frames_of_steps(rollout, c, start);
        let energy = Energy::of(positions(&frames), joints);
        let short = SHORT.min(frames.len() / c);
        let long = Movement::of(&energy, frames.len() / c, thresholds);
        let curves = Curves {
            root_cm: root_cm(&predicted)?,
            still_root_cm: root_cm(&held)?,
            degrees: degrees(&predicted)?,
            still_degrees: degrees(&held)?,
            still: long.per_s.iter().map(|[frames, still]| *still as f64 / (*frames).max(1) as f64).collect(),
        };
        let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len().max(1) as f64;
        Ok(Rollout {
            loss: error(&rollout[..COMPARED * c]),
            still_loss: error(&still),
            root_cm: mean(&curves.root_cm),
            still_root_cm: mean(&curves.still_root_cm),
            degrees: mean(&curves.degrees),
            still_degrees: mean(&curves.still_degrees),
            short: Movement::of(&energy, short, thresholds),
            long,
            flips: flips(&coder.clip(&frames[..short * c], skeleton, FPS)?),
            curves,
        })
    }
}

/// For how long dances move.
#[derive(Debug, Clone, Serialize)]
pub struct Duration {
    /// Largest number of frames.
    pub frames: usize,
    /// In the world.
    pub world: Summary,
    /// With the hip fixed at 0.
    pub pose: Summary,
    /// Share of frames that are still with the hip fixed at 0.
    pub still: Mean,
    /// Share of dances that never freeze with the hip fixed at 0.
    pub never: Mean,
    /// Mean speed of the joints, cm/s.
    pub speed_cm_s: f64,
}

impl Duration {
    /// Of dances with their takes.
    pub(crate) fn of(all: &[(&str, &Movement)], frames: usize) -> Duration {
        let of = |pick: fn(&Movement) -> &Freezing| {
            freeze::summary(&all.iter().map(|(_, m)| pick(m).clone()).collect::<Vec<_>>())
        };
        let never = |m: &Movement| f64::from(u8::from(m.pose.time_to_freeze_s.is_none()));
        Duration {
            frames,
            world: of(|m| &m.world),
            pose: of(|m| &m.pose),
            still: Mean::of(all.iter().map(|(take, m)| (*take, m.pose.still as f64, m.pose.frames as f64))),
            never: Mean::of(all.iter().map(|(take, m)| (*take, never(m), 1.0))),
            speed_cm_s: all.iter().map(|(_, m)| m.speed).sum::<f64>() / all.len().max(1) as f64,
        }
    }
}

/// Metrics of the rollouts of many seeds, each beside that of holding the last true frame.
#[derive(Debug, Clone, Serialize)]
pub struct Metrics {
    /// The form's own loss over the frames compared.
    pub loss: Mean,
    /// The same of holding the last frame.
    pub still_loss: Mean,
    /// Mean joint distance, hips aligned, cm.
    pub root_cm: Mean,
    /// The same of holding the last frame.
    pub still_root_cm: Mean,
    /// Mean angle between local rotations, degrees; for positions, those fitted to them.
    pub degrees: Mean,
    /// The same of holding the last frame.
    pub still_degrees: Mean,
    /// Over the first 400 frames.
    pub short: Duration,
    /// Over all.
    pub long: Duration,
    /// Share of steps with a flip, over the first 400 frames; for positions, of the rotations fitted to them.
    pub flips: Mean,
    /// The same over time.
    pub curves: Curves,
}

impl Metrics {
    /// Of rollouts with their takes.
    pub fn of(all: &[(&str, Rollout)]) -> Metrics {
        let mean = |pick: fn(&Rollout) -> f64| Mean::of(all.iter().map(|(take, one)| (*take, pick(one), 1.0)));
        let lasting = |pick: fn(&Rollout) -> &Movement| {
            let moves: Vec<(&str, &Movement)> = all.iter().map(|(take, one)| (*take, pick(one))).collect();
            Duration::of(&moves, moves.iter().map(|(_, m)| m.world.frames).max().unwrap_or(0))
        };
        Metrics {
            loss: mean(|one| one.loss),
            still_loss: mean(|one| one.still_loss),
            root_cm: mean(|one| one.root_cm),
            still_root_cm: mean(|one| one.still_root_cm),
            degrees: mean(|one| one.degrees),
            still_degrees: mean(|one| one.still_degrees),
            short: lasting(|one| &one.short),
            long: lasting(|one| &one.long),
            flips: Mean::of(all.iter().map(|(take, one)| (*take, one.flips[0] as f64, one.flips[1] as f64))),
            curves: Curves::mean(all.iter().map(|(_, one)| &one.curves)),
        }
    }
}

/// The name of a form's loss.
pub fn unit(form: Form) -> &'static str {
    match form {
        Form::Positional => "mean square",
        Form::Euler => "mean square of the hip + 1 - cos",
        Form::Quaternion => "mean square of the hip + angle, rad",
    }
}
