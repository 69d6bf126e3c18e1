//! Whether a dance is a copy of what the model was trained on: docs/measures.md, "Copying".
//!
//! Windows of two seconds, the pelvis at 0, the heading of the first frame removed. For each window of a dance, half a
//! second apart, the nearest of all training windows: every offset, mirrored too. The same of real validation clips is
//! the reference: a window is a copy if it is nearer than 99 % of those.
//!
//! Limits: every window is compared with every training window, so that time grows with the product of their numbers.

use crate::Result;
use kinelm_motion::mirror::mirror;
use kinelm_motion::smpl::heading_of;
use kinelm_motion::{Clip, Vec3};
use rayon::prelude::*;

/// Length of a window and the hop between windows of a dance, seconds.
pub(super) const WINDOW_S: f64 = 2.0;
pub(super) const HOP_S: f64 = 0.5;

/// A clip as windows are taken from it.
#[derive(Debug, Clone)]
pub struct Track {
    /// (F, J) positions of joints from the pelvis, metres.
    at: Vec<Vec3>,
    /// (F) cosine and sine of the heading.
    heading: Vec<(f64, f64)>,
    joints: usize,
    fps: f64,
}

impl Track {
    /// Of these joints of a clip on SMPL-24.
    ///
    /// # Panics
    /// If the clip lacks one of the joints.
    pub fn of(clip: &Clip, joints: &[usize]) -> Track {
        let all = clip.positions();
        let (mut at, mut heading, mut last) = (Vec::new(), Vec::new(), 0.0);
        for frame in all.chunks(clip.joints()) {
            // a frame without a heading takes the last one
            last = heading_of(frame).unwrap_or(last);
            heading.push((last.cos(), last.sin()));
            at.extend(joints.iter().map(|&j| frame[j] - frame[0]));
        }
        Track { at, heading, joints: joints.len(), fps: clip.fps() }
    }

    /// The clip and its mirror image.
    ///
    /// # Errors
    /// A clip that is not on SMPL-24.
    pub fn both(clip: &Clip, joints: &[usize]) -> Result<[Track; 2]> {
        Ok([Track::of(clip, joints), Track::of(&mirror(clip)?, joints)])
    }

    /// Frames of a window.
    fn window(&self) -> usize {
        (WINDOW_S * self.fps).round() as usize
    }

    /// Windows at a hop of one frame.
    fn windows(&self) -> usize {
        (self.heading.len() + 1).saturating_sub(self.window())
    }

    /// Positions in a frame, turned by the heading of frame `first`, where its window begins.
    fn turned(&self, first: usize, frame: usize) -> impl Iterator<Item = Vec3> + '_ {
        let (cos, sin) = self.heading[first];
        let places = &self.at[frame * self.joints..(frame + 1) * self.joints];
        places.iter().map(move |p| Vec3::new(cos * p.x - sin * p.z, p.y, sin * p.x + cos * p.z))
    }
}

/// The nearest training window of every window of dances; training clips are added one by one.
pub struct Nearest<'a> {
    dances: &'a [Track],
    windows: Vec<Window>,
}

/// A window of a dance.
struct Window {
    dance: usize,
    first: usize,
    /// The least sum of distances so far, metres.
    best: f64,
}

impl Nearest<'_> {
    /// Of these dances; one that is shorter than a window has none.
    pub fn of(dances: &[Track]) -> Nearest<'_> {
        let of_dance = |(dance, track): (usize, &Track)| {
            let hop = ((HOP_S * track.fps).round() as usize).max(1);
            (0..track.windows()).step_by(hop).map(move |first| Window { dance, first, best: f64::INFINITY })
        };
        Nearest { dances, windows: dances.iter().enumerate().flat_map(of_dance).collect() }
    }

    /// Shows a training clip, with its mirror image.
    pub fn add_training(&mut self, training: &[Track]) {
        let dances = self.dances;
        self.windows.par_iter_mut().for_each(|Window { dance, first, best }| {
            let dance = &dances[*dance];
            let window: Vec<Vec3> = (*first..*first + dance.window()).flat_map(|f| dance.turned(*first, f)).collect();
            let all = training.iter().flat_map(|t| (0..t.windows()).map(move |first| (t, first)));
            // the best so far bounds the next sum, so that most windows are given up after a few frames
            *best = all.fold(*best, |best, (t, first)| best.min(bounded_distance(&window, t, first, best)));
        });
    }

    /// For every dance, and every window of it, the distance to the nearest training window, cm: the mean over frames and
    /// joints. Nothing without training windows.
    pub fn distances(self) -> Vec<Vec<f64>> {
        let mut found = vec![Vec::new(); self.dances.len()];
        for Window { dance, best, .. } in self.windows {
            let track = &self.dances[dance];
            let cm = 100.0 * best / (track.window() * track.joints) as f64;
            found[dance].extend(Some(cm).filter(|cm| cm.is_finite()));
        }
        found
    }
}

/// Sum of the distances of a window's joints from those of the training window that begins at `first`; given up, with
/// something larger, where it passes `most`.
fn bounded_distance(window: &[Vec3], training: &Track, first: usize, most: f64) -> f64 {
    let mut sum = 0.0;
    for (f, frame) in window.chunks(training.joints).enumerate() {
        sum += training.turned(first, first + f).zip(frame).map(|(p, q)| (p - *q).length()).sum::<f64>();
        if sum >= most {
            break;
        }
    }
    sum
}

/// Words of the longest run that a training clip has too, word by word; given slots are not
/// compared.
pub fn longest_run(dance: &[&[u32]], clip: &[&[u32]], given: &[bool]) -> usize {
    let same = |a: &[u32], b: &[u32]| {
        let free = |i: usize| !given.get(i).copied().unwrap_or(false);
        a.len() == b.len() && a.iter().zip(b).enumerate().all(|(i, (a, b))| a == b || !free(i))
    };
    let (mut runs, mut most) = (vec![0usize; clip.len() + 1], 0);
    for word in dance {
        // from the end: `runs[i]` must still be that of the word before
        for i in (0..clip.len()).rev() {
            runs[i + 1] = if same(word, clip[i]) { runs[i] + 1 } else { 0 };
            most = most.max(runs[i + 1]);
        }
    }
    most
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::{Quat, synth};

    fn nearest(dance: &Track, training: &[Track]) -> Vec<f64> {
        let mut nearest = Nearest::of(std::slice::from_ref(dance));
        training.chunks(2).for_each(|clip| nearest.add_training(clip));
        nearest.distances().remove(0)
    }

    fn dances() -> Vec<Clip> {
        synth::corpus(4, 3, 6.0, 20.0).unwrap().into_iter().map(|d| d.clip).collect()
    }

    #[test]
    fn a_copy_is_found_wherever_it_stands_and_however_it_is_turned() {
        let clips = dances();
        let joints = [0, 4, 5, 18, 19];
        let training: Vec<Track> = clips[..2].iter().flat_map(|c| Track::both(c, &joints).unwrap()).collect();
        // a stretch of the second, mirrored, turned, and moved
        let stretch = mirror(&clips[1].slice(13..93)).unwrap();
        let turn = Quat::from_rotation_y(2.0);
        let root = stretch.root().iter().map(|p| turn * *p + Vec3::new(3.0, 0.0, -1.0)).collect();
        let mut rotations = stretch.rotations().to_vec();
        rotations.iter_mut().step_by(24).for_each(|q| *q = turn * *q);
        let copy = Clip::new(stretch.skeleton().clone(), 20.0, root, rotations).unwrap();
        let found = nearest(&Track::of(&copy, &joints), &training);
        // 80 frames: windows of 40 begin at 0, 10, .. 40
        assert_eq!(found.len(), 5);
        assert!(found.iter().all(|d| *d < 1e-6), "{found:?}");
        let other = nearest(&Track::of(&clips[2], &joints), &training);
        assert!(other.len() == 9 && other.iter().all(|d| *d > 0.5), "{other:?}");
        assert!(nearest(&Track::of(&clips[2].slice(0..39), &joints), &training).is_empty());
        assert!(nearest(&Track::of(&clips[2], &joints), &[]).is_empty());
    }

    #[test]
    fn the_longest_run_is_counted_in_words() {
        let words = |ids: &'static [u32]| ids.chunks(2).collect::<Vec<_>>();
        let training = [words(&[1, 2, 3, 4, 5, 6]), words(&[3, 4, 9, 9, 1, 2])];
        let run = |dance: &'static [u32], given: &[bool]| {
            training.iter().map(|clip| longest_run(&words(dance), clip, given)).max().unwrap()
        };
        assert_eq!(run(&[7, 7, 1, 2, 3, 4, 7, 7], &[]), 2);
        assert_eq!(run(&[3, 4, 1, 2, 3, 4, 5, 6], &[]), 3);
        assert_eq!(run(&[0, 2, 0, 4, 0, 6], &[]), 0);
        assert_eq!(run(&[0, 2, 0, 4, 0, 6], &[true, false]), 3);
        assert_eq!(run(&[], &[]), 0);
    }
}
