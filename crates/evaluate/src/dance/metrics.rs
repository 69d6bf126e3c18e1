//! The figures of one dance, and of several.

use super::freeze::{Freezing, Summary, summary};
use kinelm_motion::metric::{Balance, Extremes, FootContact, Ground, Laban, Skate};
use serde::Serialize;

/// The figures of one dance.
#[derive(Debug, Clone)]
pub(super) struct DanceMetrics {
    pub(super) world: Freezing,
    pub(super) pose: Freezing,
    pub(super) repeats: [usize; 2],
    pub(super) ground: Ground,
    pub(super) skate: Skate,
    pub(super) balance: Balance,
    pub(super) most: Extremes,
    /// Sums over the frames that have one: m/s, m/s^3.
    pub(super) speed: Mean,
    pub(super) jitter: Mean,
    pub(super) contact: FootContact,
    pub(super) laban: Option<Laban>,
}

/// The figures of several dances.
#[derive(Debug, Clone, Serialize)]
pub struct GroupMetrics {
    /// The group's name.
    pub name: String,
    /// In the world.
    pub world: Summary,
    /// Of the pose alone: the pelvis at 0, the heading removed.
    pub pose: Summary,
    /// Share of frames whose next second of tokens came in the ten seconds before; `None` of dances under a second.
    pub repeat_rate: Option<f64>,
    /// Mean depth of the lowest foot in the floor beyond 2 cm, cm.
    pub penetration_cm: Option<f64>,
    /// Share of frames in which it is as deep.
    pub penetration_share: Option<f64>,
    /// Share of frames that float: off the floor and in no jump.
    pub floating_share: Option<f64>,
    /// Mean horizontal speed of foot joints in contact, cm/s.
    pub skate_cm_s: Option<f64>,
    /// Share of those steps that are faster than 10 cm/s.
    pub skate_share: Option<f64>,
    /// Physical foot contact, mean over the dances; see [`FootContact`].
    pub pfc: Option<f64>,
    /// Least and greatest value over the n phases in which every n-th frame is read, where the rate is n times 30.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pfc_spread: Option<[f64; 2]>,
    /// Mean speed of the coded joints, cm/s.
    pub speed_cm_s: Option<f64>,
    /// Mean jerk of the coded joints, m/s^3.
    pub jitter_m_s3: Option<f64>,
    /// Share of the frames with a foot in contact whose centre of mass is more than 15 cm outside the support.
    pub outside_share: Option<f64>,
    /// Mean distance of the centre of mass outside the support over those frames, cm.
    pub outside_cm: Option<f64>,
    /// Share of frames in which a foot is more than 35 cm up.
    pub kick_share: Option<f64>,
    /// Share of frames in which a wrist is above the shoulder of its side.
    pub raised_share: Option<f64>,
    /// Frames a minute into which a joint turns by more than 1,000 degrees a second.
    pub snaps_per_min: Option<f64>,
    /// The greatest speed of a joint, m/s.
    pub fastest_m_s: Option<f64>,
    /// The greatest bend of a knee and of an elbow, degrees.
    pub bends_deg: [f64; 2],
}

/// A mean over frames that adds up over clips.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Mean {
    pub(super) sum: f64,
    pub(super) frames: usize,
}

impl Mean {
    /// Of `frames` frames, or of nothing.
    pub fn of(mean: Option<f64>, frames: usize) -> Mean {
        mean.map_or(Mean::default(), |mean| Mean { sum: mean * frames as f64, frames })
    }

    pub fn over<'a>(all: impl Iterator<Item = &'a Mean>) -> Option<f64> {
        let (sum, frames) = all.fold((0.0, 0), |(sum, frames), m| (sum + m.sum, frames + m.frames));
        (frames > 0).then(|| sum / frames as f64)
    }
}

/// The figures of several dances put together.
pub(super) fn group(name: &str, all: &[DanceMetrics]) -> GroupMetrics {
    let of = |part: fn(&DanceMetrics) -> &Freezing| summary(&all.iter().map(|f| part(f).clone()).collect::<Vec<_>>());
    let (found, of_all) = all.iter().fold((0, 0), |(a, b), f| (a + f.repeats[0], b + f.repeats[1]));
    let mut ground = Ground::default();
    let mut skate = Skate::default();
    let mut balance = Balance::default();
    let mut most = Extremes::default();
    let mut contact = FootContact::default();
    all.iter().for_each(|f| {
        ground.add(&f.ground);
        skate.add(&f.skate);
        balance.add(&f.balance);
        most.add(&f.most);
        contact.add(&f.contact);
    });
    GroupMetrics {
        name: name.into(),
        world: of(|f| &f.world),
        pose: of(|f| &f.pose),
        repeat_rate: (of_all > 0).then(|| found as f64 / of_all as f64),
        penetration_cm: ground.penetration_cm(),
        penetration_share: ground.penetration_share(),
        floating_share: ground.floating_share(),
        skate_cm_s: skate.cm_s(),
        skate_share: skate.share(),
        pfc: contact.mean(),
        pfc_spread: contact.spread(),
        speed_cm_s: Mean::over(all.iter().map(|f| &f.speed)).map(|m_s| 100.0 * m_s),
        jitter_m_s3: Mean::over(all.iter().map(|f| &f.jitter)),
        outside_share: balance.outside_share(),
        outside_cm: balance.outside_cm(),
        kick_share: balance.kick_share(),
        raised_share: balance.raised_share(),
        snaps_per_min: most.snaps_per_min(),
        fastest_m_s: most.fastest(),
        bends_deg: most.bends(),
    }
}
