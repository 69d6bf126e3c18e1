//! Which axis of a file is up: given by the caller, stated by the format, or inferred from how the body stands.

use super::contact::{FRAMES, feet_stand};
use super::up::skeleton;
use super::{Axes, Motion, ReadOptions, Up, UpSource};
use crate::rig::{FoundMap, SkeletonMap};
use crate::{Clip, GlobalPose, Skeleton, Vec3, Warning};

/// A body stands along an axis if their cosine is at least this.
const STANDS: f64 = 0.7;

impl Axes {
    /// The axes of a clip in its file's own axes, given the requested `up`; reports an axis other than y that is inferred,
    /// and doubts ambiguous ones.
    pub(crate) fn of(clip: &Clip, up: Up, found: Option<&FoundMap>) -> (Axes, Option<Warning>) {
        let map = found.map(|found| &found.map);
        let rest = map.and_then(|map| rest(clip.skeleton(), map));
        if up != Up::Auto {
            return (Axes { up, rest_too: turns_rest(rest), ..Axes::OWN }, None);
        }
        let motion = map.and_then(|map| motion(clip, map));
        let (Some(rest), Some(motion), Some(map)) = (rest, motion, map) else {
            return (Axes { by: UpSource::Unknown, ..Axes::OWN }, None);
        };
        let found = |axes: Axes, why: &str| {
            let what = format!("{} is up, {why}; if it is not, give `up`", axes.up);
            (axes, (axes.up != Up::Y).then_some(Warning { kind: "up_axis", what }))
        };
        if motion.cosine >= STANDS && motion.up == rest.up {
            let axes = Axes { up: motion.up, by: UpSource::Inferred, ..Axes::OWN };
            return found(axes, "by the rest pose and the motion");
        }
        // a rest pose that doesn't stand doesn't contradict a motion along y
        if motion.cosine >= STANDS && motion.up == Up::Y && rest.cosine < STANDS {
            return (Axes { by: UpSource::Inferred, ..Axes::OWN }, None);
        }
        if motion.cosine >= STANDS && feet_stand(clip, map, motion.up, rest.up) {
            let axes = Axes { up: motion.up, rest_too: turns_rest(Some(rest)), by: UpSource::Feet, mirror: None };
            return found(axes, &format!("by the feet and the motion, though the rest pose stands along {}", rest.up));
        }
        let doubt = if motion.cosine < STANDS {
            format!("the body stands along no axis (nearest {}, cosine {:.2})", motion.up, motion.cosine)
        } else {
            format!("the body moves as if {} were up, its rest pose stands along {}", motion.up, rest.up)
        };
        let what = format!("{doubt}: read with y up; if another axis is, give `up`: x, -x, -y, z or -z");
        (Axes { by: UpSource::Ambiguous, ..Axes::OWN }, Some(Warning { kind: "up_unsure", what }))
    }

    /// The axes of a clip in its file's own axes, of a format with `own` up, given the requested axis; with a doubt if the
    /// feet stand along another one alone.
    pub(crate) fn of_format(
        clip: &Clip,
        own: Up,
        options: &ReadOptions,
        found: Option<&FoundMap>,
    ) -> (Axes, Option<Warning>) {
        let map = found.map(|found| &found.map);
        if options.up != Up::Auto {
            return Axes::of(clip, options.up, found);
        }
        let (axes, _) = Axes::of(clip, own, found);
        let stands = |map: &SkeletonMap| motion(clip, map).filter(|m| m.cosine >= STANDS && m.up != own).map(|m| m.up);
        let other = map.and_then(|map| stands(map).filter(|up| feet_stand(clip, map, *up, own)));
        let doubt = other.map(|up| {
            let what =
                format!("the format has {own} up, but the feet stand on a floor only if {up} is: give `up` {up}");
            Warning { kind: "up_unsure", what }
        });
        (axes, doubt)
    }

    /// [`Axes::of_format`] of a clip on SMPL's body, which stands along y at rest in every file.
    #[cfg(feature = "amass")]
    pub(crate) fn of_body(
        clip: &Clip,
        own: Up,
        options: &ReadOptions,
        found: Option<&FoundMap>,
    ) -> (Axes, Option<Warning>) {
        let (axes, doubt) = Axes::of_format(clip, own, options, found);
        (Axes { rest_too: false, ..axes }, doubt)
    }
}

/// The axis of a motion's file along which its body stands in most frames; `None` where no map shows the body, or without
/// frames.
pub fn standing_axis(read: &Motion, map: &SkeletonMap) -> Option<Up> {
    motion(&read.clip, map).map(|found| read.source.axes().up.in_file(found.up))
}

/// Whether a program that rotates a file rotates its rest pose too: unless that still stands along y.
fn turns_rest(rest: Option<Uprightness>) -> bool {
    !rest.is_some_and(|rest| rest.up == Up::Y && rest.cosine >= STANDS)
}

/// The axis along which a body stands, and how well.
#[derive(Debug, Clone, Copy)]
struct Uprightness {
    up: Up,
    /// The smaller of two cosines with the axis: ankles to pelvis, pelvis to head.
    cosine: f64,
}

/// The axis with the highest score.
fn best(how_well: impl Fn(Up) -> f64) -> Up {
    let mut best = (Up::Y, how_well(Up::Y));
    for up in Up::AXES {
        let it = how_well(up);
        // ties within rounding go to the earlier axis, y first
        if it > best.1 + 1e-9 {
            best = (up, it);
        }
    }
    best.0
}

/// The joints that show how a body stands.
struct Body {
    pelvis: usize,
    hips: [usize; 2],
    ankles: [usize; 2],
    /// The head, else the neck, else both shoulders.
    top: Vec<usize>,
}

impl Body {
    fn of(skeleton: &Skeleton, map: &SkeletonMap) -> Option<Body> {
        let joint = |id: usize| map.joint(id).and_then(|name| skeleton.find(name));
        let top = match joint(15).or_else(|| joint(12)) {
            Some(top) => vec![top],
            None => vec![joint(16)?, joint(17)?],
        };
        Some(Body { pelvis: joint(0)?, hips: [joint(1)?, joint(2)?], ankles: [joint(7)?, joint(8)?], top })
    }

    /// Directions from the ankles to the pelvis and from the pelvis to the head; zero for a body without length.
    fn bones(&self, positions: &[Vec3]) -> [Vec3; 2] {
        let mean = |joints: &[usize]| joints.iter().map(|&j| positions[j]).sum::<Vec3>() / joints.len() as f64;
        let pelvis = positions[self.pelvis];
        [pelvis - mean(&self.ankles), mean(&self.top) - pelvis].map(Vec3::normalize_or_zero)
    }
}

/// How the reference pose would stand if it were rotated for each axis.
fn rest(rig: &Skeleton, map: &SkeletonMap) -> Option<Uprightness> {
    let body = Body::of(rig, map)?;
    let local = map.local_reference(rig);
    let stands = |up: Up| {
        let turned = skeleton(rig, up.turn()).ok()?;
        let positions = GlobalPose::new(&turned, Vec3::ZERO, &local).positions;
        let cosine = body.bones(&positions).into_iter().map(|b| b.y).fold(1.0, f64::min);
        let left = (positions[body.hips[0]] - positions[body.hips[1]]).normalize_or_zero();
        Some((cosine, left.x))
    };
    let stands = Up::AXES.map(|up| (up, stands(up).unwrap_or((-1.0, 0.0))));
    let of = |up: Up| stands.iter().find(|(u, _)| *u == up).map_or((-1.0, 0.0), |s| s.1);
    // with all bones along one axis, every rotation about it stands equally well, but only one has the left at +x
    let up = best(|up| {
        let (cosine, left) = of(up);
        // 2 more, because `left` may be -1 and an axis along which it stands must win
        if cosine < STANDS { cosine } else { 2.0 + cosine + left }
    });
    Some(Uprightness { up, cosine: of(up).0 })
}

/// How a body stands in the median of a clip's frames; `None` for a clip without frames.
fn motion(clip: &Clip, map: &SkeletonMap) -> Option<Uprightness> {
    let body = Body::of(clip.skeleton(), map)?;
    let mut pose = GlobalPose::default();
    let step = clip.frames().div_ceil(FRAMES).max(1);
    let bones = |f: usize| {
        pose.set(clip.skeleton(), clip.root()[f], clip.pose(f));
        body.bones(&pose.positions)
    };
    let bones: Vec<[Vec3; 2]> = (0..clip.frames()).step_by(step).map(bones).collect();
    if bones.is_empty() {
        return None;
    }
    let median = |bone: usize, axis: Vec3| {
        let mut cosines: Vec<f64> = bones.iter().map(|b| b[bone].dot(axis)).collect();
        let middle = cosines.len() / 2;
        *cosines.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let cosine = |up: Up| median(0, up.axis()).min(median(1, up.axis()));
    let up = best(cosine);
    Some(Uprightness { up, cosine: cosine(up) })
}
