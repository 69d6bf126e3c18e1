//! Figures of what a network makes of one seed, and of many.

use crate::Result;
use crate::aclstm::FPS;
use crate::aclstm::form::{Form, frames_of_steps, steps};
use crate::aclstm::loss::loss;
use crate::aclstm::run::Trained;
use kinelm_evaluate::bootstrap::interval;
use kinelm_evaluate::dance::freeze;
use kinelm_evaluate::dance::freeze::{Freezing, Summary};
use kinelm_evaluate::dance::positions::JointPositions;
use kinelm_motion::metric::{GeodesicError, Mpjpe};
use kinelm_motion::rotation::angle_between;
use kinelm_motion::{Clip, GlobalPose, Quat, Vec3};
use serde::Serialize;

use super::curves::Curves;
use super::{COMPARED, SHORT};

/// A joint that turns by more from frame to frame flips.
const FLIP: f64 = std::f64::consts::FRAC_PI_2;

/// How fast a dance is at every frame, cm/s: in the world, and with the hip held at 0.
pub struct Energy {
    pub world: Vec<f64>,
    pub pose: Vec<f64>,
}

impl Energy {
    fn of(at: Vec<Vec3>, joints: usize) -> Energy {
        let held = at.chunks_exact(joints).flat_map(|frame| frame.iter().map(|p| *p - frame[0])).collect();
        let energy = |at| freeze::energy(&JointPositions { positions: at, joints, fps: FPS });
        Energy { world: energy(at), pose: energy(held) }
    }

    pub fn of_clip(clip: &Clip) -> Result<Energy> {
        Ok(Energy::of(clip.positions(), clip.joints()))
    }
}

/// Whether and when one dance freezes, and how often it flips.
#[derive(Debug, Clone)]
pub struct Moves {
    world: Freezing,
    pose: Freezing,
    /// Mean speed of the joints, cm/s.
    speed: f64,
    /// Of every second the frames, and those that stand still with the hip held.
    per_s: Vec<[usize; 2]>,
}

impl Moves {
    fn of(energy: &Energy, frames: usize, [x, y]: [f64; 2]) -> Moves {
        let part = |all: &[f64]| all[..frames.min(all.len())].to_vec();
        let (world, pose) = (part(&energy.world), part(&energy.pose));
        let speed = world.iter().sum::<f64>() / world.len().max(1) as f64;
        let still = |frames: &[f64]| [frames.len(), Freezing::of(frames, FPS, y).still];
        let per_s = pose.chunks(FPS as usize).map(still).collect();
        Moves { world: Freezing::of(&world, FPS, x), pose: Freezing::of(&pose, FPS, y), speed, per_s }
    }
}

/// A real clip: how it moves, and its steps with a flip, of all.
pub fn of_real(clip: &Clip, thresholds: [f64; 2]) -> Result<(Moves, [usize; 2])> {
    Ok((Moves::of(&Energy::of_clip(clip)?, clip.frames(), thresholds), flips(clip)))
}

/// Steps in which some joint turns in the world by more than a quarter turn, and all steps.
fn flips(clip: &Clip) -> [usize; 2] {
    let mut before: Vec<Quat> = Vec::new();
    let mut pose = GlobalPose::default();
    let mut found = 0;
    for f in 0..clip.frames() {
        pose.set(clip.skeleton(), clip.root()[f], clip.pose(f));
        found += usize::from(before.iter().zip(&pose.rotations).any(|(a, b)| angle_between(*a, *b) > FLIP));
        before.clone_from(&pose.rotations);
    }
    [found, clip.frames().saturating_sub(1)]
}

/// What a network makes of one seed.
pub struct Continued {
    loss: f64,
    still_loss: f64,
    root_cm: f64,
    still_root_cm: f64,
    degrees: f64,
    still_degrees: f64,
    short: Moves,
    long: Moves,
    flips: [usize; 2],
    curves: Curves,
}

impl Continued {
    /// Of `made` (F, C) steps, behind the frame `last` (C); `truth` are the frames from the first that is foretold on, one
    /// more than are compared.
    pub fn of(
        trained: &Trained,
        last: &[f64],
        truth: &[f64],
        made: &[f64],
        clip: &Clip,
        thresholds: [f64; 2],
    ) -> Result<Continued> {
        let (coder, c, skeleton) = (&trained.coder, trained.shape.channels, clip.skeleton());
        let narrow = |rows: &[f64]| rows.iter().map(|x| *x as f32).collect::<Vec<f32>>();
        let true_steps = narrow(&steps(truth, c));
        let apart = |found: &[f64]| loss(coder.form(), c, &narrow(found), &true_steps, &mut vec![0.0; COMPARED * c]);
        let mut still = last.repeat(COMPARED);
        still.chunks_exact_mut(c).for_each(|step| (step[0], step[2]) = (0.0, 0.0));
        let start = [truth[0], truth[2]];
        let foretold = frames_of_steps(&made[..COMPARED * c], c, start);
        let held = last.repeat(COMPARED);
        let compared = &truth[..COMPARED * c];
        let joints = coder.joints();
        let places = |frames: &[f64]| {
            let all = coder.places(frames, skeleton);
            let points = all.len() / (frames.len() / c).max(1);
            all.chunks_exact(points).flat_map(|frame| frame[..joints].to_vec()).collect::<Vec<Vec3>>()
        };
        let true_places = places(compared);
        // of each frame
        let root_cm = |frames: &[f64]| {
            let of = |(found, truth): (&[Vec3], &[Vec3])| {
                let mut error = Mpjpe::default();
                error.add_positions(found, truth, joints)?;
                Ok(error.root_mm() / 10.0)
            };
            places(frames).chunks(joints).zip(true_places.chunks(joints)).map(of).collect::<Result<Vec<f64>>>()
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
        let frames = frames_of_steps(made, c, start);
        let energy = Energy::of(places(&frames), joints);
        let short = SHORT.min(frames.len() / c);
        let long = Moves::of(&energy, frames.len() / c, thresholds);
        let curves = Curves {
            root_cm: root_cm(&foretold)?,
            still_root_cm: root_cm(&held)?,
            degrees: degrees(&foretold)?,
            still_degrees: degrees(&held)?,
            still: long.per_s.iter().map(|[frames, still]| *still as f64 / (*frames).max(1) as f64).collect(),
        };
        let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len().max(1) as f64;
        Ok(Continued {
            loss: apart(&made[..COMPARED * c]),
            still_loss: apart(&still),
            root_cm: mean(&curves.root_cm),
            still_root_cm: mean(&curves.still_root_cm),
            degrees: mean(&curves.degrees),
            still_degrees: mean(&curves.still_degrees),
            short: Moves::of(&energy, short, thresholds),
            long,
            flips: flips(&coder.clip(&frames[..short * c], skeleton, FPS)?),
            curves,
        })
    }
}

/// A mean over seeds, with the middle 95 % of it when takes are drawn with replacement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Mean {
    /// The mean.
    pub mean: f64,
    /// Its interval over takes.
    pub over_takes: [f64; 2],
}

impl Mean {
    /// Of parts (take, sum, count).
    pub fn of<'a>(all: impl Iterator<Item = (&'a str, f64, f64)> + Clone) -> Mean {
        let (sum, count) = all.clone().fold((0.0, 0.0), |(s, n), (_, sum, count)| (s + sum, n + count));
        Mean { mean: sum / count, over_takes: interval(all) }
    }
}

/// How dances last.
#[derive(Debug, Clone, Serialize)]
pub struct Lasting {
    /// Frames of each, at most.
    pub frames: usize,
    /// In the world.
    pub world: Summary,
    /// With the hip held at 0.
    pub pose: Summary,
    /// Share of frames that stand still with the hip held at 0.
    pub still: Mean,
    /// Share of dances that never freeze with the hip held at 0.
    pub never: Mean,
    /// Mean speed of the joints, cm/s.
    pub speed_cm_s: f64,
}

impl Lasting {
    /// Of dances with the takes that they are from.
    pub fn of(all: &[(&str, &Moves)], frames: usize) -> Lasting {
        let of = |pick: fn(&Moves) -> &Freezing| {
            freeze::summary(&all.iter().map(|(_, m)| pick(m).clone()).collect::<Vec<_>>())
        };
        let never = |m: &Moves| f64::from(u8::from(m.pose.time_to_freeze_s.is_none()));
        Lasting {
            frames,
            world: of(|m| &m.world),
            pose: of(|m| &m.pose),
            still: Mean::of(all.iter().map(|(take, m)| (*take, m.pose.still as f64, m.pose.frames as f64))),
            never: Mean::of(all.iter().map(|(take, m)| (*take, never(m), 1.0))),
            speed_cm_s: all.iter().map(|(_, m)| m.speed).sum::<f64>() / all.len().max(1) as f64,
        }
    }
}

/// What a network makes of many seeds. Each figure stands beside that of the last true frame held.
#[derive(Debug, Clone, Serialize)]
pub struct Figures {
    /// The form's own loss over the frames compared.
    pub loss: Mean,
    /// The same of the last frame held.
    pub still_loss: Mean,
    /// Mean distance of joints, hips in one place, cm.
    pub root_cm: Mean,
    /// The same of the last frame held.
    pub still_root_cm: Mean,
    /// Mean angle between local rotations, degrees; of positions those fitted to them.
    pub degrees: Mean,
    /// The same of the last frame held.
    pub still_degrees: Mean,
    /// Over the first 400 frames.
    pub short: Lasting,
    /// Over all.
    pub long: Lasting,
    /// Share of steps with a flip, over the first 400 frames; of positions by the rotations fitted to them.
    pub flips: Mean,
    /// The same over time.
    pub curves: Curves,
}

impl Figures {
    /// Of seeds with the takes that they are from.
    pub fn of(all: &[(&str, Continued)]) -> Figures {
        let mean = |pick: fn(&Continued) -> f64| Mean::of(all.iter().map(|(take, one)| (*take, pick(one), 1.0)));
        let lasting = |pick: fn(&Continued) -> &Moves| {
            let moves: Vec<(&str, &Moves)> = all.iter().map(|(take, one)| (*take, pick(one))).collect();
            Lasting::of(&moves, moves.iter().map(|(_, m)| m.world.frames).max().unwrap_or(0))
        };
        Figures {
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
