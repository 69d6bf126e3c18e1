//! Stretches of training clips that another clip has too, by the search of [`crate::query`].
//!
//! The nearest window by the Euclidean distance of cosine transforms is looked up at every second of a clip, among the
//! windows that begin at any frame of another one; it is a copy if the joints' rotations are nearly the same all along.
//!
//! Copies that are mirrored, played at another speed or shorter than a window are not found.

use super::{Fault, Finding, LoadedClip};
use crate::query::record::ClipEntry;
use crate::query::{Database, Distance, FeatureKind, IndexOptions, Models, SearchOptions};
use crate::{Result, WindowSpec};
use kinelm_corpus::Split;
use kinelm_motion::rotation::exp_map;
use kinelm_motion::{Clip, Quat, Vec3};

/// Length of a window, seconds.
pub const WINDOW_S: f64 = 2.0;
/// Seconds between the windows that are looked up.
const HOP_S: f64 = 1.0;
/// The mean angle between the local rotations of a copy and its original is below this, degrees.
pub const COPY_DEG: f64 = 1.0;
/// And below this share of the window's difference from itself half a second later: a body at rest is like any
/// other. At 2 degrees and a half, gestures that one dancer repeats pass for copies: 280 ranges of bandai-2.
const MAX_SELF_SHARE: f64 = 0.2;
/// The most that a copy can be off the frames of the search, frames: its file may be cut between two of them.
const MAX_SHIFT: f64 = 0.5;
/// Coefficients of a channel: up to 2 Hz, enough to distinguish windows of 2 s.
const KEEP: usize = 8;

/// Adds the copies to the finds of training clips.
pub fn find(held: &mut [LoadedClip], fps: f64) -> Result<()> {
    let frames = (WINDOW_S * fps).round() as usize;
    // every frame: a copy may begin anywhere in the other clip
    let windows = WindowSpec { frames, hop: 1, fps };
    let options = IndexOptions { windows, ..IndexOptions::new(FeatureKind::Dct { keep: KEEP }) };
    options.validate()?;
    let database = database(held, &options)?;
    if database.windows() == 0 {
        return Ok(());
    }
    // clips without a window are in the database too, so that numbers agree
    let hop = ((HOP_S * fps).round() as usize).max(1);
    let mut first = 0;
    for number in 0..held.len() {
        let starts = database.clips()[number].starts.len();
        // the last one too, or a copy's end would be left
        let last = (first + starts).checked_sub(1).filter(|_| starts > 0 && (starts - 1) % hop != 0);
        let starts_at = (first..first + starts).step_by(hop).chain(last);
        first += starts;
        // clips of other splits are only looked up: what they share with training is taken out of training
        if held[number].split != Split::Train {
            continue;
        }
        let mut found = Vec::new();
        for window in starts_at {
            if let Some((start, other)) = copy(held, &database, number, window, frames)? {
                let description = format!("as in {}", held[other].name);
                found.push(Finding { first: start, end: start + frames, why: Fault::Copy, description });
            }
        }
        held[number].finds.extend(found);
    }
    Ok(())
}

/// The place of a window, and the clip that it is a copy of, if it is one.
fn copy(
    held: &[LoadedClip],
    database: &Database,
    own: usize,
    window: usize,
    frames: usize,
) -> Result<Option<(usize, usize)>> {
    let start = database.window(window).start;
    let one = &held[own];
    let allowed = |other: usize| {
        let clip = database.window(other).clip;
        // of two training clips only the later one, or both would be left out
        let earlier = clip < own || held[clip].split != Split::Train;
        clip != own && earlier
    };
    let wanted = SearchOptions { k: 1, distance: Distance::Euclid, one_per_clip: false, farthest: false };
    let feature = database.feature(window)?;
    let Some(hit) = database.nearest(&feature, wanted, &allowed)?.hits.first().copied() else { return Ok(None) };
    let there = database.window(hit.window);
    let here = one.clip.slice(start..start + frames);
    let apart = mean_angle_deg(&here, &held[there.clip].clip.slice(there.start..there.start + frames), MAX_SHIFT);
    // half a second of the two: long enough for a body that moves, and most of the window is left to compare
    let later = frames / 4;
    let itself = mean_angle_deg(&here.slice(0..frames - later), &here.slice(later..frames), 0.0);
    let is_copy = apart < COPY_DEG && apart < MAX_SELF_SHARE * itself;
    Ok(is_copy.then_some((start, there.clip)))
}

/// The mean angle between the local rotations of two windows of one length, degrees, where the second may be taken up to
/// `shift` frames sooner or later: by as much as brings them nearest, along its velocity.
fn mean_angle_deg(a: &Clip, b: &Clip, shift: f64) -> f64 {
    let last = a.frames().saturating_sub(1);
    let between = |p: &[Quat], q: &[Quat], j: usize| exp_map::to_vector(p[j].conjugate() * q[j]);
    // rotation vectors: from b to a, and b's in a frame
    let of = |(f, j): (usize, usize)| {
        let (before, after) = (f.saturating_sub(1), (f + 1).min(last));
        let step = between(b.pose(before), b.pose(after), j) / (after - before).max(1) as f64;
        (between(b.pose(f), a.pose(f), j), step)
    };
    let places = (0..a.frames()).flat_map(|f| (0..a.joints()).map(move |j| (f, j)));
    let pairs: Vec<(Vec3, Vec3)> = places.map(of).collect();
    let along: f64 = pairs.iter().map(|(off, step)| off.dot(*step)).sum();
    let speed: f64 = pairs.iter().map(|(_, step)| step.length_squared()).sum();
    // least squares: the shift that leaves the smallest sum of squared rotations
    let by = if speed > 0.0 { (along / speed).clamp(-shift, shift) } else { 0.0 };
    let sum: f64 = pairs.iter().map(|(off, step)| (*off - *step * by).length()).sum();
    (sum / pairs.len().max(1) as f64).to_degrees()
}

/// The windows of all clips, at every frame.
fn database(held: &[LoadedClip], options: &IndexOptions) -> Result<Database> {
    let entry = |one: &LoadedClip| ClipEntry::in_memory(&one.name, one.clip.frames(), &options.windows);
    Database::of_clips(options, held.iter().map(|one| (&one.clip, entry(one))).collect(), Models::default())
}
