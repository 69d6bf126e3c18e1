//! The dances as the page holds them: places of points, sixteen bits each, and where on the floor each figure stands.

use super::Figure;
use super::body::{Ball, Body, Bone, standing};
use crate::{Error, Result};
use kinelm_motion::{Clip, GlobalPose, Vec3};
use serde::Serialize;

/// One figure, ready for the page's script.
#[derive(Debug, Serialize)]
pub struct Drawn {
    title: String,
    note: String,
    fps: f64,
    frames: usize,
    points: usize,
    height: f64,
    bones: Vec<Bone>,
    balls: Vec<Ball>,
    tips: Vec<usize>,
    /// Shift (x, z) when the figures stand side by side, and when they stand on one spot.
    beside: [f64; 2],
    onto: [f64; 2],
    /// A place is `low + step * number`.
    low: [f64; 3],
    step: f64,
    /// (F, P, 3) numbers of 16 bits, little-endian, in base64.
    data: String,
}

/// Metres beyond which a clip is taken for broken rather than for a dance.
const LARGEST: f64 = 1e6;
/// Samples a second by which figures are kept apart.
const APART_FPS: f64 = 20.0;

/// All figures, placed beside each other from left to right.
pub fn drawn(figures: &[Figure]) -> Result<Vec<Drawn>> {
    let tracks = figures.iter().map(Track::new).collect::<Result<Vec<_>>>()?;
    let beside = beside(&tracks);
    tracks.iter().zip(figures).zip(beside).map(|((track, figure), x)| track.drawn(figure, x)).collect()
}

/// The ways of all points of a figure.
struct Track {
    body: Body,
    fps: f64,
    height: f64,
    /// (F, P), on a floor at y = 0.
    places: Vec<Vec3>,
}

impl Track {
    fn new(figure: &Figure) -> Result<Self> {
        let (clip, title) = (figure.clip, &figure.title);
        let fail = |what: String| Err(Error::Call(format!("the figure {title:?}: {what}")));
        if clip.frames() == 0 {
            return fail("no frames; expected at least one".into());
        }
        if !(figure.forced.is_empty() || figure.forced.len() == clip.joints()) {
            let (f, j) = (figure.forced.len(), clip.joints());
            return fail(format!("{f} marks of forced joints for {j} joints; expected as many, or none"));
        }
        if let Some(p) = clip.positions().iter().find(|p| !p.is_finite() || p.abs().max_element() >= LARGEST) {
            return fail(format!("a joint at {p} metres; expected a body within {LARGEST} m"));
        }
        let height = height(clip);
        let body = Body::new(clip.skeleton(), height, &figure.forced);
        let mut places = Vec::with_capacity(clip.frames() * body.points);
        let (mut pose, mut points) = (GlobalPose::default(), Vec::new());
        for f in 0..clip.frames() {
            body.places(clip, f, &mut pose, &mut points);
            places.extend_from_slice(&points);
        }
        let floor = floor(&places, body.points, height);
        places.iter_mut().for_each(|p| p.y -= floor);
        Ok(Track { body, fps: clip.fps(), height, places })
    }

    fn frames(&self) -> usize {
        self.places.len() / self.body.points
    }

    /// Leftmost and rightmost x of a moment; the last frame is held.
    fn width(&self, time_s: f64) -> (f64, f64) {
        let (p, f) = (self.body.points, ((time_s * self.fps) as usize).min(self.frames() - 1));
        let xs = self.places[f * p..(f + 1) * p].iter().map(|p| p.x);
        xs.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
    }

    fn duration_s(&self) -> f64 {
        self.frames() as f64 / self.fps
    }

    fn drawn(&self, figure: &Figure, beside: f64) -> Result<Drawn> {
        let low = self.places.iter().copied().reduce(Vec3::min).unwrap_or_default();
        let high = self.places.iter().copied().reduce(Vec3::max).unwrap_or_default();
        let step = ((high - low).max_element() / 65535.0).max(1e-9);
        let mut bytes = Vec::with_capacity(self.places.len() * 6);
        for p in &self.places {
            for number in ((*p - low) / step).to_array() {
                bytes.extend_from_slice(&(number.round() as u16).to_le_bytes());
            }
        }
        let start = self.places[0];
        let points = self.body.points;
        let middle_z = self.places.iter().step_by(points).map(|p| p.z).sum::<f64>() / self.frames() as f64;
        Ok(Drawn {
            title: figure.title.clone(),
            note: figure.note.clone(),
            fps: self.fps,
            frames: self.frames(),
            points,
            height: self.height,
            bones: self.body.bones.clone(),
            balls: self.body.balls.clone(),
            tips: self.body.tips.clone(),
            beside: [beside, -middle_z],
            onto: [-start.x, -start.z],
            low: low.to_array(),
            step,
            data: base64(&bytes),
        })
    }
}

/// Height of the body, metres; 1 if it has none. By its bones where there is a head: from head to pelvis and on along the
/// longest leg, whose foot makes up for the skull. Else the most it ever measures from lowest to highest joint.
fn height(clip: &Clip) -> f64 {
    let by_bones = standing(clip.skeleton());
    let measures = |p: &[Vec3]| {
        let ys = p.iter().map(|p| p.y);
        ys.clone().fold(f64::NEG_INFINITY, f64::max) - ys.fold(f64::INFINITY, f64::min)
    };
    let h = by_bones.unwrap_or_else(|| clip.positions().chunks(clip.joints()).map(measures).fold(0.0, f64::max));
    if h > 1e-6 { h } else { 1.0 }
}

/// Where the floor is: y = 0, unless the lowest point stays so far from it that the clip can't mean that floor.
fn floor(places: &[Vec3], points: usize, height: f64) -> f64 {
    let mut lowest: Vec<f64> =
        places.chunks(points).map(|p| p.iter().map(|p| p.y).fold(f64::INFINITY, f64::min)).collect();
    lowest.sort_unstable_by(f64::total_cmp);
    let usual = lowest[lowest.len() / 20];
    if usual.abs() < 0.15 * height { 0.0 } else { usual }
}

/// Shifts along x so that each figure stays right of the one before it at every moment, the whole centred.
fn beside(tracks: &[Track]) -> Vec<f64> {
    let longest = tracks.iter().map(Track::duration_s).fold(0.0, f64::max).min(24.0 * 3600.0);
    let moments = (longest * APART_FPS) as usize + 1;
    let mut shifts: Vec<f64> = Vec::new();
    for (n, track) in tracks.iter().enumerate() {
        let shift = match (n.checked_sub(1), shifts.last()) {
            (Some(before), Some(shift)) => {
                let before = &tracks[before];
                let overlap = (0..moments)
                    .map(|m| m as f64 / APART_FPS)
                    .map(|t| before.width(t).1 - track.width(t).0)
                    .fold(f64::NEG_INFINITY, f64::max);
                shift + overlap + 0.12 * track.height.max(before.height)
            }
            _ => 0.0,
        };
        shifts.push(shift);
    }
    let edge = |n: usize, side: fn((f64, f64)) -> f64| {
        let (track, frames) = (&tracks[n], tracks[n].frames());
        (0..frames).map(|f| side(track.width(f as f64 / track.fps))).sum::<f64>() / frames as f64 + shifts[n]
    };
    let Some(last) = tracks.len().checked_sub(1) else { return shifts };
    let middle = 0.5 * (edge(0, |w| w.0) + edge(last, |w| w.1));
    shifts.iter().map(|s| s - middle).collect()
}

fn base64(bytes: &[u8]) -> String {
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
        let shifts = beside(&tracks);
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
        let lowest = track.places.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        assert!(lowest.abs() < 0.01, "{lowest}");
    }
}
