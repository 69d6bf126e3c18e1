//! Balance: whether the feet are under the body's weight, and how often a foot is kicked up or a hand raised.

use crate::feet::contact::contacts;
use crate::feet::leg::Leg;
use crate::feet::track::FootTrack;
use crate::smpl::MIRROR;
use crate::{Clip, Vec3};

/// Limbs of SMPL's left side: mass in percent of the whole body's, proximal and distal joint, and the position of the segment's
/// centre of mass as a fraction of the way between them. Those of the right side are alike.
///
/// Source: de Leva, "Adjustments to Zatsiorsky-Seluyanov's segment inertia parameters" (1996), table 4, the mean of its
/// women and men; trunk from the seventh cervical vertebra (our neck) to between the hips, shank to the ankle's centre. The
/// head's centre is our head joint, which is between vertex and neck; the foot's is taken from ankle to ball.
const LIMBS: [(f64, usize, usize, f64); 6] = [
    (2.63, 16, 18, 0.5763),
    (1.5, 18, 20, 0.4567),
    (0.585, 20, 22, 0.7687),
    (14.47, 1, 4, 0.3854),
    (4.57, 4, 7, 0.4374),
    (1.33, 7, 10, 0.4215),
];
/// The head's mass, at its joint.
const HEAD: (f64, usize) = (6.81, 15);
/// The trunk's mass, and its centre between the neck and the middle of the hips.
const TRUNK: (f64, f64) = (43.015, 0.5051);
/// A point of a foot in contact bears weight up to this height above its standing height, metres.
const BEARS_M: f64 = 0.07;
/// The support extends this far beyond the joints of the feet, metres: heels, toes and sides have none.
const AROUND_M: f64 = 0.1;
/// Further outside the support than this is out of balance, metres.
const FAR_M: f64 = 0.15;
/// A foot higher above its standing height than this is kicked up, metres.
const KICK_M: f64 = 0.35;

/// Shoulder and wrist of each side.
const ARMS: [[usize; 2]; 2] = [[16, 20], [17, 21]];

/// Balance of a body on its feet. Sums over frames, which can be merged over clips.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Balance {
    frames: usize,
    kicks: usize,
    raised: usize,
    supported: usize,
    outside: usize,
    outside_m: f64,
}

/// Balance in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BalanceFrame {
    /// Whether the left and the right foot are in contact.
    pub contacts: [bool; 2],
    /// How far the centre of mass is outside the support, metres; `None` without a support.
    pub outside_m: Option<f64>,
    /// Whether a foot is kicked up.
    pub kick: bool,
    /// Whether a wrist is above the shoulder of its side.
    pub raised: bool,
}

impl BalanceFrame {
    /// The frames (F) of a clip; see [`Balance::of`].
    ///
    /// # Panics
    /// As [`Balance::of`].
    pub fn of(legs: &[Leg; 2], clip: &Clip) -> Vec<BalanceFrame> {
        let positions = clip.positions();
        let tracks = [0, 1].map(|side| FootTrack::new(clip, &legs[side]));
        let mut bears = vec![[false; 2]; clip.frames()];
        for (side, track) in tracks.iter().enumerate() {
            for contact in contacts(track, side, 0.0) {
                bears[contact.frames()].iter_mut().for_each(|bears| bears[side] = true);
            }
        }
        let frame = |(f, contacts): (usize, [bool; 2])| {
            let places = &positions[f * clip.joints()..(f + 1) * clip.joints()];
            let points = |track| FootTrack::heights(track, f).collect::<Vec<(Vec3, f64)>>();
            let feet = tracks.each_ref().map(points);
            let is_up = |foot: &Vec<(Vec3, f64)>| foot.iter().all(|(_, height)| *height > KICK_M);
            let support = feet.iter().zip(contacts).filter(|(_, bears)| *bears).flat_map(|(foot, _)| foot);
            let support: Vec<[f64; 2]> =
                support.filter(|(_, height)| *height < BEARS_M).map(|(place, _)| on_floor(*place)).collect();
            let outside_m = || (distance(on_floor(centre_of_mass(places)), &support) - AROUND_M).max(0.0);
            BalanceFrame {
                contacts,
                outside_m: (!support.is_empty()).then(outside_m),
                kick: feet.iter().any(is_up),
                raised: ARMS.iter().any(|&[shoulder, wrist]| places[wrist].y > places[shoulder].y),
            }
        };
        bears.into_iter().enumerate().map(frame).collect()
    }
}

impl Balance {
    /// Measures a clip on SMPL-24, whose `legs` are [`Leg::of`]'s, with its floor at y = 0.
    ///
    /// The support of a frame is the convex hull, on the floor, of the points (ankle, ball, ends of toes) of feet in contact,
    /// as the [foot lock](crate::feet) finds contacts, grown by 10 cm; frames without a contact have none and are left out.
    /// Source: docs/measures.md, "Floor and feet".
    ///
    /// # Panics
    /// If the clip is on a rig with fewer joints.
    pub fn of(legs: &[Leg; 2], clip: &Clip) -> Balance {
        Balance::of_frames(&BalanceFrame::of(legs, clip))
    }

    /// Of some frames of a clip.
    pub fn of_frames(frames: &[BalanceFrame]) -> Balance {
        let mut balance = Balance { frames: frames.len(), ..Balance::default() };
        for frame in frames {
            balance.kicks += usize::from(frame.kick);
            balance.raised += usize::from(frame.raised);
            if let Some(outside_m) = frame.outside_m {
                balance.supported += 1;
                balance.outside += usize::from(outside_m > FAR_M);
                balance.outside_m += outside_m;
            }
        }
        balance
    }

    /// Adds another clip.
    pub fn add(&mut self, other: &Balance) {
        self.frames += other.frames;
        self.kicks += other.kicks;
        self.raised += other.raised;
        self.supported += other.supported;
        self.outside += other.outside;
        self.outside_m += other.outside_m;
    }

    /// The fraction of the frames with a contact whose centre of mass is more than 15 cm outside the support.
    pub fn outside_share(&self) -> Option<f64> {
        (self.supported > 0).then(|| self.outside as f64 / self.supported as f64)
    }

    /// Mean distance of the centre of mass outside the support over the frames with a contact, cm.
    pub fn outside_cm(&self) -> Option<f64> {
        (self.supported > 0).then(|| 100.0 * self.outside_m / self.supported as f64)
    }

    /// The fraction of all frames in which a foot, ankle and ball, is more than 35 cm up.
    pub fn kick_share(&self) -> Option<f64> {
        (self.frames > 0).then(|| self.kicks as f64 / self.frames as f64)
    }

    /// The fraction of all frames in which a wrist is above the shoulder of its side.
    pub fn raised_share(&self) -> Option<f64> {
        (self.frames > 0).then(|| self.raised as f64 / self.frames as f64)
    }
}

/// The centre of mass of a body whose SMPL joints (24) are at these places.
///
/// # Panics
/// With fewer joints.
pub(crate) fn centre_of_mass(places: &[Vec3]) -> Vec3 {
    let (trunk_mass, share) = TRUNK;
    let trunk = places[12].lerp((places[1] + places[2]) / 2.0, share);
    let (head_mass, head) = HEAD;
    let limbs = LIMBS.iter().flat_map(|&(mass, a, b, share)| {
        [(a, b), (MIRROR[a], MIRROR[b])].map(|(a, b)| (mass, places[a].lerp(places[b], share)))
    });
    let segments = [(trunk_mass, trunk), (head_mass, places[head])].into_iter().chain(limbs);
    let (total, sum) =
        segments.fold((0.0, Vec3::ZERO), |(total, sum), (mass, centre)| (total + mass, sum + centre * mass));
    sum / total
}

fn on_floor(place: Vec3) -> [f64; 2] {
    [place.x, place.z]
}

/// The distance of a point from the convex hull of others, at least one, in the plane.
fn distance(point: [f64; 2], of: &[[f64; 2]]) -> f64 {
    // a hull is the union of all triangles of its points and their sides
    let corners = || (0..of.len()).flat_map(|a| (a..of.len()).map(move |b| (a, b)));
    let triangles = corners().flat_map(|(a, b)| (b..of.len()).map(move |c| [a, b, c]));
    if triangles.into_iter().any(|corners| is_in(point, corners.map(|corner| of[corner]))) {
        return 0.0;
    }
    corners().map(|(a, b)| from_line(point, of[a], of[b])).fold(f64::MAX, f64::min)
}

/// The cross product of the ways from `a` to `b` and to `c`.
fn cross(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Whether a point is in a triangle that has an area.
fn is_in(p: [f64; 2], [a, b, c]: [[f64; 2]; 3]) -> bool {
    let sides = [cross(a, b, p), cross(b, c, p), cross(c, a, p)];
    // in a triangle without area every point of its line would have crosses of 0 and be inside
    cross(a, b, c) != 0.0 && (sides.iter().all(|x| *x >= 0.0) || sides.iter().all(|x| *x <= 0.0))
}

/// The distance of a point from a line between two others.
fn from_line(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let (along, to) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let length = along[0].powi(2) + along[1].powi(2);
    let share = if length > 0.0 { ((along[0] * to[0] + along[1] * to[1]) / length).clamp(0.0, 1.0) } else { 0.0 };
    (to[0] - share * along[0]).hypot(to[1] - share * along[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::{Humanoid, map_for};
    use crate::{Quat, smpl};

    fn balance(clip: &Clip) -> Balance {
        let rig = smpl::neutral();
        Balance::of(&Leg::of(&Humanoid::with_map(&rig, &map_for(&rig, None).unwrap())).unwrap(), clip)
    }

    /// A body that stands for a second, its root turned by `turn`, its left thigh raised by `kick` radians.
    fn standing(turn: Quat, kick: f64) -> Clip {
        let rig = smpl::neutral();
        let feet = Humanoid::with_map(&rig, &map_for(&rig, None).unwrap()).feet().unwrap();
        let mut rotations = vec![Quat::IDENTITY; 24];
        (rotations[0], rotations[1]) = (turn, Quat::from_rotation_x(-kick));
        let clip = Clip::new(rig, 20.0, vec![Vec3::Y; 20], rotations.repeat(20)).unwrap();
        // down until the lower foot stands
        let up = feet.clearance(&clip)[0];
        clip.raised(-up)
    }

    #[test]
    fn a_body_at_rest_is_balanced_and_its_centre_is_in_the_pelvis() {
        let clip = standing(Quat::IDENTITY, 0.0);
        let centre = centre_of_mass(&clip.positions()[..24]);
        let pelvis = clip.root()[0];
        assert!(centre.x.abs() < 1e-9 && (centre.y - pelvis.y).abs() < 0.1, "{centre:?} by {pelvis:?}");
        let found = balance(&clip);
        assert_eq!((found.frames, found.supported), (20, 20));
        assert_eq!((found.outside_share(), found.outside_cm(), found.kick_share()), (Some(0.0), Some(0.0), Some(0.0)));
    }

    #[test]
    fn a_body_that_leans_like_a_plank_is_out_of_balance() {
        let leaning = standing(Quat::from_rotation_x(0.5), 0.0);
        let found = balance(&leaning);
        let places = &leaning.positions()[..24];
        // the balls are the nearest to a body that leans forward: the lower joints of its feet
        let centre = centre_of_mass(places);
        let nearest = [10, 11].map(|j| places[j].z).into_iter().fold(f64::MIN, f64::max);
        let expected = 100.0 * (centre.z - nearest - AROUND_M);
        assert!((found.outside_cm().unwrap() - expected).abs() < 1e-6, "{found:?}, {expected} cm");
        assert_eq!(found.outside_share(), Some(if expected > 15.0 { 1.0 } else { 0.0 }));
        assert!(expected > 15.0, "{expected}");
    }

    #[test]
    fn a_raised_leg_is_a_kick_and_takes_its_foot_out_of_the_support() {
        let found = balance(&standing(Quat::IDENTITY, 1.4));
        assert_eq!((found.kick_share(), found.supported), (Some(1.0), 20));
        assert_eq!(balance(&standing(Quat::IDENTITY, 0.5)).kick_share(), Some(0.0));
    }

    #[test]
    fn a_hand_above_its_shoulder_is_raised() {
        let clip = standing(Quat::IDENTITY, 0.0);
        let with = |joint: usize, turn: f64| {
            let mut rotations = clip.rotations().to_vec();
            // in half of the frames
            rotations[..240].iter_mut().skip(joint).step_by(24).for_each(|q| *q = Quat::from_rotation_z(turn));
            balance(&Clip::new(clip.skeleton().clone(), 20.0, clip.root().to_vec(), rotations).unwrap()).raised_share()
        };
        // arms out at rest: the left one up and down, the right one up
        assert_eq!([with(16, 0.3), with(16, -0.3), with(17, -0.3)], [Some(0.5), Some(0.0), Some(0.5)]);
    }

    #[test]
    fn in_the_air_there_is_no_support() {
        let mut up = balance(&standing(Quat::IDENTITY, 0.0).raised(0.5));
        assert_eq!((up.outside_share(), up.outside_cm(), up.kick_share()), (None, None, Some(1.0)));
        up.add(&balance(&standing(Quat::IDENTITY, 0.0)));
        assert_eq!((up.outside_share(), up.kick_share()), (Some(0.0), Some(0.5)));
        assert_eq!(Balance::default().kick_share(), None);
    }

    #[test]
    fn distances_from_hulls_by_hand() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        for (point, of, expected) in [
            ([3.0, 4.0], &square[..1], 5.0),
            ([0.5, 2.0], &square[..2], 2.0),
            ([-3.0, -4.0], &square[..2], 5.0),
            ([0.9, 0.5], &square[..3], 0.0),
            ([0.0, 1.0], &square[..3], 0.5f64.sqrt()),
            ([0.2, 0.9], &square[..], 0.0),
            ([0.5, 1.25], &square[..], 0.25),
        ] {
            assert!((distance(point, of) - expected).abs() < 1e-12, "{point:?} from {of:?}");
        }
        // corners on one line have no inside
        assert!((distance([0.5, 1.0], &[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]) - 1.0).abs() < 1e-12);
    }
}
