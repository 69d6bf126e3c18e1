//! The placement of a decoded dance: coding drops the first frame's position, and a free root starts with any heading.

use crate::Result;
use crate::edit::gap::angle_between_headings;
use crate::open::PreparedPrompt;
use crate::request::Placement;
use kinelm_motion::rotation::heading;
use kinelm_motion::{Clip, Quat, Vec3};

/// Which parts of a dance's root are the prompt's already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RootGiven {
    /// The path: its steps are the prompt's.
    pub path: bool,
    /// The heading of the pelvis.
    pub heading: bool,
}

impl RootGiven {
    /// Of a dance with this prompt.
    pub fn by(prompt: &PreparedPrompt) -> RootGiven {
        let is_continued = !prompt.beginning.is_empty();
        let path = is_continued || prompt.selection.as_ref().is_some_and(|s| s.path);
        RootGiven { path, heading: path || prompt.selection.as_ref().is_some_and(|s| s.joints.contains(&0)) }
    }
}

impl Placement {
    /// A decoded dance moved and turned to this placement. What is given of its root is only shifted by what coding dropped.
    ///
    /// # Errors
    /// None for a decoded clip.
    pub fn put(&self, dance: &Clip, given: RootGiven) -> Result<Clip> {
        let Some(first) = dance.root().first().map(|p| Vec3::new(p.x, 0.0, p.z)) else { return Ok(dance.clone()) };
        let turn = self.heading.zip(heading(dance.pose(0)[0])).map_or(0.0, |(wanted, found)| wanted - found);
        // a given heading is the prompt's already: turning it would leave the prompt's path
        let turn = if given.heading { Quat::IDENTITY } else { Quat::from_rotation_y(turn) };
        let (from, to) = (if given.path { Vec3::ZERO } else { first }, Vec3::new(self.x, 0.0, self.z));
        turned(dance, turn, (from, to))
    }
}

/// A dance turned about a place and brought to another.
fn turned(dance: &Clip, turn: Quat, (from, to): (Vec3, Vec3)) -> Result<Clip> {
    let root = dance.root().iter().map(|p| turn * (*p - from) + to).collect();
    let mut rotations = dance.rotations().to_vec();
    rotations.iter_mut().step_by(dance.joints()).for_each(|pelvis| *pelvis = turn * *pelvis);
    Ok(Clip::new(dance.skeleton().clone(), dance.fps(), root, rotations)?)
}

/// A dance whose x and z are those of a clip, as long as that lasts; then it goes on from there.
///
/// # Errors
/// None for a decoded clip.
pub(super) fn on_path(dance: &Clip, clip: &Clip) -> Result<Clip> {
    let known = clip.frames().min(dance.frames());
    let Some(last) = known.checked_sub(1) else { return Ok(dance.clone()) };
    let off = clip.root()[last] - dance.root()[last];
    let placed = |(frame, place): (usize, &Vec3)| match clip.root().get(frame) {
        Some(given) => Vec3::new(given.x, place.y, given.z),
        None => Vec3::new(place.x + off.x, place.y, place.z + off.z),
    };
    let root = dance.root().iter().enumerate().map(placed).collect();
    Ok(Clip::new(dance.skeleton().clone(), dance.fps(), root, dance.rotations().to_vec())?)
}

/// A dance turned and moved over the floor to where it is nearest to the way of a clip, in place and heading: by least squares
/// over their frames (Umeyama, "Least-squares estimation of transformation parameters between two point patterns", 1991,
/// without scale). A step that way counts as much as a radian.
///
/// # Errors
/// None for a decoded clip.
pub(super) fn along(dance: &Clip, way: &Clip) -> Result<Clip> {
    let frames = dance.frames().min(way.frames());
    let facing = |clip: &Clip, frame: usize| heading(clip.pose(frame)[0]).map(|h| Vec3::new(h.sin(), 0.0, h.cos()));
    let mean = |clip: &Clip| clip.root()[..frames].iter().fold(Vec3::ZERO, |sum, p| sum + *p) / frames.max(1) as f64;
    let (from, to) = (mean(dance), mean(way));
    let places = (0..frames).map(|f| (dance.root()[f] - from, way.root()[f] - to));
    let facings = (0..frames).filter_map(|f| facing(dance, f).zip(facing(way, f)));
    let (across, along) = places
        .chain(facings)
        .fold((0.0, 0.0), |(across, along), (a, b)| (across + a.z * b.x - a.x * b.z, along + a.x * b.x + a.z * b.z));
    let turn = Quat::from_rotation_y(across.atan2(along));
    turned(dance, turn, (from.with_y(0.0), to.with_y(0.0)))
}

/// How far a dance is from the way of a clip at the same rate: mean and largest distance, metres, and the same of headings,
/// degrees. `None` without frames.
pub(super) fn off_way(dance: &Clip, way: &Clip) -> Option<[f64; 4]> {
    let frames = dance.frames().min(way.frames());
    let off = (0..frames).map(|f| {
        let place = (dance.root()[f] - way.root()[f]).with_y(0.0).length();
        [place, angle_between_headings(way.pose(f)[0], dance.pose(f)[0]).abs().to_degrees()]
    });
    let off: Vec<[f64; 2]> = off.collect();
    let mean = |i: usize| off.iter().map(|both| both[i]).sum::<f64>() / frames as f64;
    let most = |i: usize| off.iter().map(|both| both[i]).fold(0.0, f64::max);
    (frames > 0).then(|| [mean(0), most(0), mean(1), most(1)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::synth;

    fn dance() -> Clip {
        synth::corpus(4, 1, 2.0, 20.0).unwrap().remove(0).clip
    }

    #[test]
    fn a_free_root_is_moved_to_the_placement_and_turned() {
        let (dance, there) = (dance(), Placement { x: 3.0, z: -2.0, heading: Some(2.5) });
        let put = there.put(&dance, RootGiven { path: false, heading: false }).unwrap();
        let found = Placement::of(&put).unwrap();
        assert!((found.x - 3.0).abs() < 1e-12 && (found.z + 2.0).abs() < 1e-12, "{found:?}");
        assert!((found.heading.unwrap() - 2.5).abs() < 1e-12, "{found:?}");
        // a turn and a shift of the whole: places among themselves, heights and all other rotations stay
        let (a, b) = (dance.positions(), put.positions());
        for (i, j) in [(0, 23), (5, a.len() - 1), (24, a.len() / 2)] {
            assert!(((a[i] - a[j]).length() - (b[i] - b[j]).length()).abs() < 1e-9);
            assert!((a[i].y - b[i].y).abs() < 1e-9);
        }
    }

    #[test]
    fn a_dance_is_moved_to_its_way_wherever_it_was_decoded() {
        let way = dance();
        let elsewhere = Placement { x: 3.0, z: -2.0, heading: Some(2.5) };
        let away = elsewhere.put(&way, RootGiven { path: false, heading: false }).unwrap();
        assert!(off_way(&away, &way).unwrap()[0] > 1.0);
        let [_, most_m, _, most] = off_way(&along(&away, &way).unwrap(), &way).unwrap();
        assert!(most_m < 1e-9 && most < 1e-6, "{most_m} {most}");
        // longer than its way, and with none of it
        let half = way.slice(0..way.frames() / 2);
        assert!(off_way(&along(&away, &half).unwrap(), &way).unwrap()[1] < 1e-9);
        assert_eq!(off_way(&away, &way.slice(0..0)), None);
        assert!(along(&away, &way.slice(0..0)).unwrap().root().iter().all(|place| place.is_finite()));
    }

    #[test]
    fn a_given_path_or_heading_stays() {
        let (dance, there) = (dance(), Placement { x: 3.0, z: -2.0, heading: Some(2.5) });
        let put = there.put(&dance, RootGiven { path: true, heading: true }).unwrap();
        assert_eq!(put.rotations(), dance.rotations());
        let off = |f: usize| put.root()[f] - dance.root()[f] - Vec3::new(3.0, 0.0, -2.0);
        assert!((0..dance.frames()).all(|f| off(f).length() < 1e-12));
        let turned = there.put(&dance, RootGiven { path: false, heading: true }).unwrap();
        assert_eq!((turned.rotations(), turned.root()[0].x), (dance.rotations(), 3.0));
        assert_eq!(there.put(&dance.slice(0..0), RootGiven { path: true, heading: true }).unwrap().frames(), 0);
    }
}
