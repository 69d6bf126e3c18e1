//! The data of the page's player: 16-bit positions of points, and each figure's place on the floor. `drawn` makes the
//! figures of a page, [`figure`] one by itself, [`LiveFigure`] one that is still sampled.

use super::Figure;
use crate::{Error, Result};
use kinelm_motion::capsules::{Capsule, CapsuleBody, JointSphere, standing_height_m};
use kinelm_motion::feet::contact::contacts;
use kinelm_motion::feet::leg::Leg;
use kinelm_motion::feet::track::FootTrack;
use kinelm_motion::metric::beat::BeatHits;
use kinelm_motion::rig::{Humanoid, SkeletonMap};
use kinelm_motion::{Clip, GlobalPose, Vec3, joints};
use kinelm_store::counted;
use serde::Serialize;
use std::ops::Range;

/// One figure for the page's script.
#[derive(Debug, Serialize)]
pub struct Drawn {
    title: String,
    note: String,
    fps: f64,
    frames: usize,
    points: usize,
    height: f64,
    /// Figures of one world keep the relative positions of their clips.
    world: usize,
    bones: Vec<Capsule>,
    balls: Vec<JointSphere>,
    tips: Vec<usize>,
    /// Points whose whole path is drawn.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    paths: Vec<usize>,
    /// Shift (x, z) side by side, and overlaid.
    beside: [f64; 2],
    onto: [f64; 2],
    /// A position is `low + step * number`.
    low: [f64; 3],
    step: f64,
    /// (F, P, 3) numbers of 16 bits, little-endian, in base64.
    data: String,
    /// The seconds, from and to, in which joints are given; absent: throughout.
    #[serde(skip_serializing_if = "Option::is_none")]
    given_s: Option<[f64; 2]>,
    /// Regenerated spans, seconds, from and to.
    anew: Vec<[f64; 2]>,
    /// The beats that it hits, if measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    hits: Option<Lit>,
    /// (P) the joint that each point shows, where that was requested.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    joints: Vec<Option<PointJoint>>,
    /// When feet are in contact with the floor, where that was requested.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    contacts: Vec<PointContacts>,
}

/// The joint that a point shows: itself, or the parent of its end site.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct PointJoint {
    /// The rig's name.
    label: String,
    /// As lists of joints name it.
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    /// Its SMPL id.
    #[serde(skip_serializing_if = "Option::is_none")]
    smpl: Option<usize>,
    /// Its group among [`joints::PARTS`].
    #[serde(skip_serializing_if = "Option::is_none")]
    group: Option<&'static str>,
}

/// When a point is in contact with the floor.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct PointContacts {
    point: usize,
    /// Seconds, from and to.
    spans: Vec<[f64; 2]>,
}

impl Drawn {
    /// The points whose joints are, or move with, these SMPL joints; none where points don't know their joints.
    pub fn points_of(&self, joints: &[usize]) -> Vec<usize> {
        let is_one = |point: &Option<PointJoint>| {
            point.as_ref().and_then(|point| point.smpl).is_some_and(|id| joints.contains(&id))
        };
        (0..self.joints.len()).filter(|&point| is_one(&self.joints[point])).collect()
    }
}

/// Highlighted beats.
#[derive(Debug, Serialize)]
struct Lit {
    /// Indices of the music's beats.
    beats: Vec<usize>,
    /// Shown below the title.
    says: String,
}

impl Lit {
    fn of(hits: &BeatHits) -> Lit {
        let beats = (0..hits.each.len()).filter(|&i| hits.each[i] == Some(true)).collect();
        let says = format!("{} of {} hit, by chance {:.0}", hits.hit(), counted(hits.beats(), "beats"), hits.chance);
        Lit { beats, says }
    }
}

/// Clips with positions beyond this are refused, metres.
const LARGEST: f64 = 1e6; // 1,000 km: a step of 16 bits is 15 m then, and any unit or scale that went wrong is beyond
/// Limits of no numbers.
const NOWHERE: (f64, f64) = (f64::INFINITY, f64::NEG_INFINITY);
/// Moments a second at which figures are kept from overlapping.
const SPACING_FPS: f64 = 20.0;

/// All figures, side by side from left to right: each figure separately if all are of one world, else each world.
pub(crate) fn drawn(figures: &[Figure]) -> Result<Vec<Drawn>> {
    let mut tracks = figures.iter().map(Track::new).collect::<Result<Vec<_>>>()?;
    let worlds = worlds(figures);
    let in_world = |w: usize| worlds[w].iter().copied();
    let floors: Vec<f64> = tracks.iter().map(Track::floor).collect();
    for w in 0..worlds.len() {
        // one floor for all, the lowest
        let floor = in_world(w).map(|n| floors[n]).fold(f64::INFINITY, f64::min);
        in_world(w).for_each(|n| tracks[n].places.iter_mut().for_each(|p| p.y -= floor));
    }
    let alone: Vec<Vec<usize>> = (0..tracks.len()).map(|n| vec![n]).collect();
    // of one world, a single group would leave them overlaid
    let grouped = if worlds.len() == 1 { &alone } else { &worlds };
    let groups: Vec<Vec<&Track>> = grouped.iter().map(|group| group.iter().map(|&n| &tracks[n]).collect()).collect();
    let mut all: Vec<(usize, Drawn)> = Vec::new();
    for ((group, tracks_of), x) in grouped.iter().zip(&groups).zip(beside(&groups)) {
        let z = tracks_of.iter().map(|track| track.middle_z()).sum::<f64>() / group.len() as f64;
        for &n in group {
            let world = worlds.iter().position(|world| world.contains(&n)).unwrap_or(n);
            // one start for a world, its first figure's: relative positions stay
            let start = tracks[worlds[world][0]].places[0];
            all.push((n, tracks[n].drawn(&figures[n], world, [x, -z], [-start.x, -start.z])?));
        }
    }
    // the groups are by world, the caller's order is that of the legend
    all.sort_by_key(|(n, _)| *n);
    Ok(all.into_iter().map(|(_, drawn)| drawn).collect())
}

/// One figure where its clip puts it, over a floor at `floor_m`. With the skeleton map of its rig, points know their joints
/// and feet their contacts.
///
/// # Errors
/// As [`super::page`].
pub fn figure(figure: &Figure, floor_m: f64, map: Option<&SkeletonMap>) -> Result<Drawn> {
    let mut track = Track::new(figure)?;
    track.places.iter_mut().for_each(|p| p.y -= floor_m);
    let mut drawn = track.drawn(figure, 0, [0.0; 2], [0.0; 2])?;
    if let Some(map) = map {
        drawn.joints = point_joints(figure.clip, &track.body, map);
        drawn.contacts = point_contacts(figure.clip, floor_m, map);
    }
    Ok(drawn)
}

/// (P) the joints of points: joints, end sites, and the top of the head if there is a head.
fn point_joints(clip: &Clip, body: &CapsuleBody, map: &SkeletonMap) -> Vec<Option<PointJoint>> {
    let (skeleton, ids) = (clip.skeleton(), joints::smpl_ids(clip.skeleton(), map));
    let (points, head) = (body.point_count, body.head_joint());
    let of_point = |point: usize| match point.checked_sub(skeleton.joints()) {
        // points: joints, then end sites, then the top of the head (`CapsuleBody`)
        None => Some(point),
        Some(end) => skeleton.ends().get(end).map_or(head, |end| Some(end.parent)),
    };
    // fingers and twist bones move with the nearest joint above them that SMPL has
    let owner = |joint: usize| {
        let mut at = Some(joint);
        while let Some(joint) = at.filter(|joint| ids[*joint].is_none()) {
            at = skeleton.parents()[joint];
        }
        at.and_then(|joint| ids[joint])
    };
    let shown = |joint: usize| {
        let smpl = owner(joint);
        let name = smpl.map(|id| joints::list_of(&[id]));
        PointJoint { label: skeleton.names()[joint].clone(), name, smpl, group: smpl.and_then(joints::part_of) }
    };
    (0..points).map(|point| of_point(point).map(shown)).collect()
}

/// The contacts of both legs; none on a rig without legs.
fn point_contacts(clip: &Clip, floor_m: f64, map: &SkeletonMap) -> Vec<PointContacts> {
    let mut all: Vec<PointContacts> = Vec::new();
    let Ok(legs) = Leg::of(&Humanoid::with_map(clip.skeleton(), map)) else { return all };
    for (side, leg) in legs.iter().enumerate() {
        for contact in contacts(&FootTrack::new(clip, leg), side, floor_m) {
            let span = [contact.from, contact.to].map(|frame| frame as f64 / clip.fps());
            match all.iter_mut().find(|of| of.point == contact.point) {
                Some(of) => of.spans.push(span),
                None => all.push(PointContacts { point: contact.point, spans: vec![span] }),
            }
        }
    }
    all
}

/// Sides of the box that a live figure is in, metres: a step of its 16 bits is half a millimetre.
const LIVE_BOX: f64 = 32.0;
/// The part of it below the floor, metres.
const LIVE_BELOW: f64 = 8.0;

/// A figure whose frames are still sampled: its positions are in a box around one of its frames, as its extent isn't
/// known yet.
#[derive(Debug)]
pub struct LiveFigure {
    body: CapsuleBody,
    floor_m: f64,
    low: Vec3,
    step: f64,
}

impl LiveFigure {
    /// The figure, and all of its data but the numbers. The box is around the frame `around`.
    ///
    /// # Errors
    /// As [`figure()`].
    pub fn new(figure: &Figure, floor_m: f64, map: Option<&SkeletonMap>, around: usize) -> Result<(LiveFigure, Drawn)> {
        let mut track = Track::new(figure)?;
        let at = track.places.get(around * track.body.point_count).copied().unwrap_or_default();
        let low = Vec3::new(at.x - LIVE_BOX / 2.0, -LIVE_BELOW, at.z - LIVE_BOX / 2.0);
        let step = LIVE_BOX / 65535.0;
        let body = track.body.clone();
        // one frame is enough for a head without data, and its range of positions is replaced
        track.places.truncate(body.point_count);
        let mut head = track.drawn(figure, 0, [0.0; 2], [0.0; 2])?;
        (head.low, head.step, head.frames, head.data) = (low.to_array(), step, figure.clip.frames(), String::new());
        head.joints = map.map_or(Vec::new(), |map| point_joints(figure.clip, &body, map));
        Ok((LiveFigure { body, floor_m, low, step }, head))
    }

    /// The numbers of some frames in base64; `None` where a frame leaves the box: a new figure begins there.
    pub fn frames(&self, clip: &Clip, frames: Range<usize>) -> Option<String> {
        let (mut pose, mut points, mut bytes) = (GlobalPose::default(), Vec::new(), Vec::new());
        for frame in frames {
            self.body.points(clip, frame, &mut pose, &mut points);
            for number in points.iter().flat_map(|p| ((*p - Vec3::Y * self.floor_m - self.low) / self.step).to_array())
            {
                // NaN is in no range: it leaves the box too
                if !(0.0..=65535.0).contains(&number) {
                    return None;
                }
                bytes.extend_from_slice(&(number.round() as u16).to_le_bytes());
            }
        }
        Some(base64(&bytes))
    }
}

/// The figures of each world, in their order.
fn worlds(figures: &[Figure]) -> Vec<Vec<usize>> {
    let mut worlds: Vec<Vec<usize>> = Vec::new();
    for (n, figure) in figures.iter().enumerate() {
        let known = worlds.iter_mut().find(|w| figure.world.is_some() && figures[w[0]].world == figure.world);
        match known {
            Some(world) => world.push(n),
            None => worlds.push(vec![n]),
        }
    }
    worlds
}

/// The paths of all points of a figure.
struct Track {
    body: CapsuleBody,
    fps: f64,
    height: f64,
    /// (F, P).
    places: Vec<Vec3>,
    /// The least and the largest x of the paths that are drawn, which are there all the time.
    paths: (f64, f64),
}

impl Track {
    fn new(figure: &Figure) -> Result<Self> {
        let (clip, title) = (figure.clip, &figure.title);
        let fail = |what: String| Err(Error::unsupported(format!("the figure {title:?}"), what));
        if clip.frames() == 0 {
            return fail("no frames; expected at least one".into());
        }
        if !(figure.given.is_empty() || figure.given.len() == clip.joints()) {
            let (f, j) = (figure.given.len(), clip.joints());
            return fail(format!("{f} marks of given joints for {j} joints; expected as many, or none"));
        }
        if let Some(p) = clip.positions().iter().find(|p| !p.is_finite() || p.abs().max_element() >= LARGEST) {
            return fail(format!("a joint at {p} metres; expected a body within {LARGEST} m"));
        }
        let height = height(clip);
        let body = CapsuleBody::new(clip.skeleton(), height, &figure.given);
        let mut places = Vec::with_capacity(clip.frames() * body.point_count);
        let (mut pose, mut points) = (GlobalPose::default(), Vec::new());
        for f in 0..clip.frames() {
            body.points(clip, f, &mut pose, &mut points);
            places.extend_from_slice(&points);
        }
        let drawn = |f: usize| figure.paths.iter().map(move |joint| f * body.point_count + joint);
        let xs = (0..clip.frames()).flat_map(drawn).map(|at| places[at].x);
        let paths = xs.fold(NOWHERE, |(low, high), x| (low.min(x), high.max(x)));
        Ok(Track { body, fps: clip.fps(), height, places, paths })
    }

    /// The floor: y = 0, unless the lowest points are usually far from it.
    fn floor(&self) -> f64 {
        let low = |p: &[Vec3]| p.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        let mut lowest: Vec<f64> = self.places.chunks(self.body.point_count).map(low).collect();
        lowest.sort_unstable_by(f64::total_cmp);
        // the 5 % quantile: a single frame below the floor, or a jump, decides nothing
        let usual = lowest[lowest.len() / 20];
        // a floor that is meant to be 0 is left there, though feet sink in or a joint floats a little
        if usual.abs() < 0.15 * self.height { 0.0 } else { usual }
    }

    /// The root's mean z, metres.
    fn middle_z(&self) -> f64 {
        self.places.iter().step_by(self.body.point_count).map(|p| p.z).sum::<f64>() / self.frames() as f64
    }

    fn frames(&self) -> usize {
        self.places.len() / self.body.point_count
    }

    /// The least and the largest x at a time, of drawn paths too; the last frame is held.
    fn width(&self, time_s: f64) -> (f64, f64) {
        let (p, f) = (self.body.point_count, ((time_s * self.fps) as usize).min(self.frames() - 1));
        let xs = self.places[f * p..(f + 1) * p].iter().map(|p| p.x);
        xs.fold(self.paths, |(low, high), x| (low.min(x), high.max(x)))
    }

    fn duration_s(&self) -> f64 {
        self.frames() as f64 / self.fps
    }

    fn drawn(&self, figure: &Figure, world: usize, beside: [f64; 2], onto: [f64; 2]) -> Result<Drawn> {
        let low = self.places.iter().copied().reduce(Vec3::min).unwrap_or_default();
        let high = self.places.iter().copied().reduce(Vec3::max).unwrap_or_default();
        // one step for all axes, so that the body isn't distorted by rounding; above 0 for a body that stands still
        let step = ((high - low).max_element() / 65535.0).max(1e-9);
        let mut bytes = Vec::with_capacity(self.places.len() * 6);
        for p in &self.places {
            for number in ((*p - low) / step).to_array() {
                bytes.extend_from_slice(&(number.round() as u16).to_le_bytes());
            }
        }
        Ok(Drawn {
            title: figure.title.clone(),
            note: figure.note.clone(),
            fps: self.fps,
            frames: self.frames(),
            points: self.body.point_count,
            height: self.height,
            world,
            bones: self.body.bones.clone(),
            balls: self.body.balls.clone(),
            tips: self.body.tips.clone(),
            // points begin with the joints (`CapsuleBody`)
            paths: figure.paths.clone(),
            beside,
            onto,
            low: low.to_array(),
            step,
            data: base64(&bytes),
            given_s: figure.given_s.as_ref().map(|seconds| [seconds.start, seconds.end]),
            anew: figure.regenerated_s.clone(),
            hits: figure.hits.as_ref().map(Lit::of),
            joints: Vec::new(),
            contacts: Vec::new(),
        })
    }
}

/// Height of the body, metres; 1 without one. With a head, the length of its bones from head to pelvis and along the longest
/// leg, whose foot compensates for the skull. Else the largest vertical extent of its joints.
fn height(clip: &Clip) -> f64 {
    let by_bones = standing_height_m(clip.skeleton());
    let measures = |p: &[Vec3]| {
        let ys = p.iter().map(|p| p.y);
        ys.clone().fold(f64::NEG_INFINITY, f64::max) - ys.fold(f64::INFINITY, f64::min)
    };
    // a body that never stands up straight is still as tall as its bones
    let h = by_bones.unwrap_or_else(|| clip.positions().chunks(clip.joints()).map(measures).fold(0.0, f64::max));
    if h > 1e-6 { h } else { 1.0 }
}

/// Shifts along x so that each group is always right of the previous one, and all are centred.
fn beside(groups: &[Vec<&Track>]) -> Vec<f64> {
    let all = || groups.iter().flatten();
    // a day at most: a wrong rate would make hours of moments
    let longest = all().map(|track| track.duration_s()).fold(0.0, f64::max).min(24.0 * 3600.0);
    let moments = (longest * SPACING_FPS) as usize + 1;
    let width = |group: &[&Track], time_s: f64| {
        let widths = group.iter().map(|track| track.width(time_s));
        widths.fold(NOWHERE, |(low, high), (l, h)| (low.min(l), high.max(h)))
    };
    let height = |group: &[&Track]| group.iter().map(|track| track.height).fold(0.0, f64::max);
    let mut shifts: Vec<f64> = Vec::new();
    for (n, group) in groups.iter().enumerate() {
        // each is moved by how far the one before reaches into it at any moment, not by its whole width
        let shift = match (n.checked_sub(1), shifts.last()) {
            (Some(before), Some(shift)) => {
                let before = &groups[before];
                let overlap = (0..moments)
                    .map(|m| m as f64 / SPACING_FPS)
                    .map(|t| width(before, t).1 - width(group, t).0)
                    .fold(f64::NEG_INFINITY, f64::max);
                shift + overlap + 0.12 * height(group).max(height(before))
            }
            _ => 0.0,
        };
        shifts.push(shift);
    }
    let edge = |n: usize, side: fn((f64, f64)) -> f64| {
        let (track, frames) = (groups[n][0], groups[n][0].frames());
        (0..frames).map(|f| side(width(&groups[n], f as f64 / track.fps))).sum::<f64>() / frames as f64 + shifts[n]
    };
    let Some(last) = groups.len().checked_sub(1) else { return shifts };
    let middle = 0.5 * (edge(0, |w| w.0) + edge(last, |w| w.1));
    shifts.iter().map(|s| s - middle).collect()
}

/// Bytes as RFC 4648 has them.
pub(crate) fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let bits = three.iter().enumerate().fold(0u32, |b, (i, &x)| b | u32::from(x) << (16 - 8 * i));
        for i in 0..4 {
            // n bytes are n + 1 letters, and `=` up to four
            let letter = LETTERS[(bits >> (18 - 6 * i)) as usize & 63];
            text.push(if i <= three.len() { letter as char } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::synth;

    #[test]
    fn raised_arms_make_nobody_taller() {
        let d = &synth::corpus(5, 4, 9.0, 60.0).unwrap()[3].clip;
        assert!((height(d) - 1.7).abs() < 0.05, "{}", height(d));
    }

    #[test]
    fn base64_by_the_book() {
        // RFC 4648, section 10
        for (plain, coded) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")] {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }

    #[test]
    fn dancers_stay_apart_at_every_moment() {
        let dances = synth::corpus(5, 6, 9.0, 60.0).unwrap();
        let figures: Vec<_> = dances.iter().map(|d| Figure::new(d.name(), &d.clip)).collect();
        let tracks: Vec<_> = figures.iter().map(|f| Track::new(f).unwrap()).collect();
        let shifts = beside(&tracks.iter().map(|track| vec![track]).collect::<Vec<_>>());
        for n in 1..6 {
            for f in 0..540 {
                let t = f as f64 / 60.0;
                let gap = tracks[n].width(t).0 + shifts[n] - tracks[n - 1].width(t).1 - shifts[n - 1];
                assert!(gap > 0.1, "{n} at {t}: {gap}");
            }
        }
    }

    #[test]
    fn a_clip_far_from_the_floor_is_put_on_it() {
        let d = &synth::corpus(5, 1, 3.0, 60.0).unwrap()[0].clip;
        let root = d.root().iter().map(|p| *p + Vec3::Y * 20.0).collect();
        let high = Clip::new(d.skeleton().clone(), 60.0, root, d.rotations().to_vec()).unwrap();
        let track = Track::new(&Figure::new("high", &high)).unwrap();
        let lowest = track.places.iter().map(|p| p.y).fold(f64::INFINITY, f64::min) - track.floor();
        assert!(lowest.abs() < 0.01, "{lowest}");
        let drawn = drawn(&[Figure::new("high", &high)]).unwrap();
        assert!(drawn[0].low[1].abs() < 0.01, "{}", drawn[0].low[1]);
    }

    #[test]
    fn one_figure_stays_where_its_clip_puts_it_and_knows_its_joints() {
        let d = &synth::corpus(5, 1, 3.0, 60.0).unwrap()[0].clip;
        let map = SkeletonMap::builtin("smpl").unwrap();
        let drawn = figure(&Figure::new("a", d), 0.25, Some(&map)).unwrap();
        let lowest = d.positions().iter().map(|p| p.x).fold(f64::INFINITY, f64::min);
        assert!((drawn.low[0] - lowest).abs() < 0.2 && drawn.low[1] < -0.2, "{:?}", drawn.low);
        let of = |point: usize| drawn.joints[point].clone().unwrap();
        assert_eq!((of(0).name.as_deref(), of(17).group, of(24).smpl), (Some("root"), Some("right_arm"), Some(15)));
        assert_eq!((drawn.joints.len(), drawn.points_of(&[15, 17])), (drawn.points, vec![15, 17, 24]));
        let feet: Vec<usize> = drawn.contacts.iter().map(|c| c.point).collect();
        assert!(!feet.is_empty() && feet.iter().all(|p| [7, 8, 10, 11].contains(p)), "{feet:?}");
        let last = drawn.contacts[0].spans.last().unwrap();
        assert!(last[0] < last[1] && last[1] <= 3.0);
    }

    #[test]
    fn frames_of_a_live_figure_are_the_numbers_of_its_box() {
        let d = &synth::corpus(5, 1, 2.0, 20.0).unwrap()[0].clip;
        let (live, head) = LiveFigure::new(&Figure::new("a", &d.slice(0..3)), 0.0, None, 0).unwrap();
        assert_eq!((head.frames, head.points, head.data.as_str()), (3, 25, ""));
        let (first, rest) = (live.frames(d, 0..3).unwrap(), live.frames(d, 3..40).unwrap());
        // three frames of 25 points are 450 bytes, which base64 divides
        assert_eq!(format!("{first}{rest}"), live.frames(d, 0..40).unwrap());
        assert_eq!(first.len(), 600);
        let low = Vec3::from_array(head.low);
        let pelvis = ((d.root()[0] - low) / head.step).round();
        assert!((pelvis.x - 32767.5).abs() <= 1.0 && pelvis.y > 16000.0, "{pelvis}");
        let root = d.root().iter().map(|p| *p + Vec3::X * 17.0).collect();
        let far = Clip::new(d.skeleton().clone(), 20.0, root, d.rotations().to_vec()).unwrap();
        assert_eq!(live.frames(&far, 0..1), None);
    }

    #[test]
    fn figures_of_one_world_stand_to_each_other_as_their_clips_put_them() {
        let d = &synth::corpus(5, 1, 3.0, 60.0).unwrap()[0].clip;
        let moved = |by: Vec3| {
            let root = d.root().iter().map(|p| *p + by).collect();
            Clip::new(d.skeleton().clone(), 60.0, root, d.rotations().to_vec()).unwrap()
        };
        let by = Vec3::new(0.7, -4.0, 1.5);
        let there = moved(by);
        let figure = |name, clip, world| Figure::new(name, clip).in_world(world);
        let both = [figure("here", d, Some(3)), figure("there", &there, Some(3))];
        let off = |drawn: &[Drawn], shift: fn(&Drawn) -> [f64; 2]| {
            let at = |d: &Drawn| Vec3::new(d.low[0] + shift(d)[0], d.low[1], d.low[2] + shift(d)[1]);
            at(&drawn[1]) - at(&drawn[0])
        };
        let alone = drawn(&both).unwrap();
        assert!((off(&alone, |d| d.onto) - by).length() < 1e-9 && alone[0].world == alone[1].world);
        assert!(off(&alone, |d| d.beside).x > 0.3, "side by side they stand apart as ever");
        // beside a stranger they stay together
        let three = [both[0].clone(), figure("stranger", d, None), both[1].clone()];
        let drawn = drawn(&three).unwrap();
        let pair = [&drawn[0], &drawn[2]];
        for shift in [|d: &Drawn| d.beside, |d: &Drawn| d.onto] {
            assert_eq!(shift(pair[0]), shift(pair[1]));
        }
        assert_eq!([drawn[0].world, drawn[1].world, drawn[2].world], [0, 1, 0]);
        assert!(drawn[1].beside[0] > drawn[0].beside[0] + 0.5);
    }
}
