//! The page's data: 16-bit positions of points, and each figure's place on the floor.

use super::Figure;
use crate::{Error, Result};
use kinelm_motion::capsules::{Capsule, CapsuleBody, JointSphere, standing_height_m};
use kinelm_motion::metric::beat::BeatHits;
use kinelm_motion::{Clip, GlobalPose, Vec3};
use kinelm_store::counted;
use serde::Serialize;

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
const LARGEST: f64 = 1e6;
/// Sampling rate for keeping figures at a distance, a second.
const SPACING_FPS: f64 = 20.0;

/// All figures, side by side from left to right: each figure separately if all are of one world, else each world.
pub fn drawn(figures: &[Figure]) -> Result<Vec<Drawn>> {
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
    let grouped = if worlds.len() == 1 { &alone } else { &worlds };
    let groups: Vec<Vec<&Track>> = grouped.iter().map(|group| group.iter().map(|&n| &tracks[n]).collect()).collect();
    let mut all: Vec<(usize, Drawn)> = Vec::new();
    for ((group, tracks_of), x) in grouped.iter().zip(&groups).zip(beside(&groups)) {
        let z = tracks_of.iter().map(|track| track.middle_z()).sum::<f64>() / group.len() as f64;
        for &n in group {
            let world = worlds.iter().position(|world| world.contains(&n)).unwrap_or(n);
            let start = tracks[worlds[world][0]].places[0];
            all.push((n, tracks[n].drawn(&figures[n], world, [x, -z], [-start.x, -start.z])?));
        }
    }
    all.sort_by_key(|(n, _)| *n);
    Ok(all.into_iter().map(|(_, drawn)| drawn).collect())
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
        Ok(Track { body, fps: clip.fps(), height, places })
    }

    /// The floor: y = 0, unless the lowest points are usually far from it.
    fn floor(&self) -> f64 {
        let low = |p: &[Vec3]| p.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        let mut lowest: Vec<f64> = self.places.chunks(self.body.point_count).map(low).collect();
        lowest.sort_unstable_by(f64::total_cmp);
        let usual = lowest[lowest.len() / 20];
        if usual.abs() < 0.15 * self.height { 0.0 } else { usual }
    }

    /// The root's mean z, metres.
    fn middle_z(&self) -> f64 {
        self.places.iter().step_by(self.body.point_count).map(|p| p.z).sum::<f64>() / self.frames() as f64
    }

    fn frames(&self) -> usize {
        self.places.len() / self.body.point_count
    }

    /// The least and the largest x at a time; the last frame is held.
    fn width(&self, time_s: f64) -> (f64, f64) {
        let (p, f) = (self.body.point_count, ((time_s * self.fps) as usize).min(self.frames() - 1));
        let xs = self.places[f * p..(f + 1) * p].iter().map(|p| p.x);
        xs.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
    }

    fn duration_s(&self) -> f64 {
        self.frames() as f64 / self.fps
    }

    fn drawn(&self, figure: &Figure, world: usize, beside: [f64; 2], onto: [f64; 2]) -> Result<Drawn> {
        let low = self.places.iter().copied().reduce(Vec3::min).unwrap_or_default();
        let high = self.places.iter().copied().reduce(Vec3::max).unwrap_or_default();
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
            beside,
            onto,
            low: low.to_array(),
            step,
            data: base64(&bytes),
            given_s: figure.given_s.as_ref().map(|seconds| [seconds.start, seconds.end]),
            anew: figure.regenerated_s.clone(),
            hits: figure.hits.as_ref().map(Lit::of),
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
    let h = by_bones.unwrap_or_else(|| clip.positions().chunks(clip.joints()).map(measures).fold(0.0, f64::max));
    if h > 1e-6 { h } else { 1.0 }
}

/// Shifts along x so that each group is always right of the previous one, and all are centred.
fn beside(groups: &[Vec<&Track>]) -> Vec<f64> {
    let all = || groups.iter().flatten();
    let longest = all().map(|track| track.duration_s()).fold(0.0, f64::max).min(24.0 * 3600.0);
    let moments = (longest * SPACING_FPS) as usize + 1;
    let width = |group: &[&Track], time_s: f64| {
        let widths = group.iter().map(|track| track.width(time_s));
        widths.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (l, h)| (low.min(l), high.max(h)))
    };
    let height = |group: &[&Track]| group.iter().map(|track| track.height).fold(0.0, f64::max);
    let mut shifts: Vec<f64> = Vec::new();
    for (n, group) in groups.iter().enumerate() {
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

pub fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let bits = three.iter().enumerate().fold(0u32, |b, (i, &x)| b | u32::from(x) << (16 - 8 * i));
        for i in 0..4 {
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
