//! Foot locking: foot-skate cleanup of a generated dance.
//!
//! Three steps: the body is [settled](settle) on the floor, [contacts](contact) are detected, and the [legs](leg) are bent
//! so that feet in contact stay in place. Definitions: docs/generation.md, "Feet".

pub(crate) mod aloft;
pub mod anchor;
pub mod contact;
pub mod flatten;
pub mod leg;
pub mod settle;
pub mod track;

use crate::rig::{Feet, Humanoid};
use crate::{Clip, GlobalPose, Quat, Result, Vec3};
use contact::{Contact, Moves, contacts};
use kinelm_store::counted;
use leg::Leg;
use track::FootTrack;

/// The parts of a motion that were given and must not be changed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FixedParts {
    /// The root's position.
    pub root: bool,
    /// The root's horizontal path: the body may be raised and lowered, but not moved along the ground.
    pub path: bool,
    /// The left and the right leg.
    pub legs: [bool; 2],
    /// This many frames from the start, entirely.
    pub frames: usize,
}

/// What foot locking did to a clip.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FootLock {
    /// Contacts that were locked, left and right.
    pub locked: Vec<Contact>,
    /// Contacts that were skipped, because the leg can't reach within 5 cm of the locked position.
    pub out_of_reach: Vec<Contact>,
    /// Mean displacement of feet in contact, centimetres.
    pub moved_cm: f64,
    /// The largest vertical displacement of the body, centimetres.
    pub settled_cm: f64,
    /// The largest horizontal displacement of the body, centimetres.
    pub carried_cm: f64,
}

impl FootLock {
    /// Lines to print about locked feet; frames are `fps` per second.
    pub fn notes(&self, fps: f64) -> Vec<String> {
        let FootLock { locked, out_of_reach, moved_cm, settled_cm, carried_cm } = self;
        let mut notes = vec![format!(
            "feet: {} locked, moved {moved_cm:.1} cm on average; the body moved up or down by at most {settled_cm:.0} cm, \
             sideways by {carried_cm:.0} cm",
            counted(locked.len(), "contacts")
        )];
        notes.extend(out_of_reach.iter().map(|contact| {
            let side = ["left", "right"][contact.side.min(1)];
            let [from, to] = [contact.from, contact.to].map(|f| f as f64 / fps);
            format!("feet: the {side} leg can't reach its locked foot from {from:.2} to {to:.2} s: left as it is")
        }));
        notes
    }
}

/// Displacements of a contact are blended in and out over this time, seconds.
pub const BLEND_S: f64 = 0.1;
/// After given frames the body settles over this time, seconds.
const BEGIN_S: f64 = 0.5;
/// A foot that would stay further from its locked position is not locked, metres.
const REACH_M: f64 = 0.05;
/// Legs are stretched up to this fraction of their length; beyond it the body is lowered.
const STRETCH: f64 = 0.998;
/// The body is lowered by at most this for a leg, metres.
const LOWER_M: f64 = 0.05;

/// Settles the body on a floor at y = `floor_m` and locks the feet in contact. Joints above the hips keep their local
/// rotations, feet their world rotations.
///
/// With a fixed root only the legs are bent. Fixed legs and fixed frames stay as they are; the frames after them continue
/// from where they end.
///
/// # Errors
/// Those of [`Humanoid::pose`].
pub fn lock(clip: &Clip, humanoid: &Humanoid, floor_m: f64, fixed: FixedParts) -> Result<(Clip, FootLock)> {
    let (feet, legs) = (humanoid.feet()?, Leg::of(humanoid)?);
    let mut locked = FootLock::default();
    let mut root = clip.root().to_vec();
    let ups = floating_m(clip, &feet, floor_m, fixed);
    if !fixed.root {
        for (root, up) in root.iter_mut().zip(&ups) {
            root.y -= up;
            locked.settled_cm = locked.settled_cm.max(100.0 * up.abs());
        }
    }
    let at = |root: Vec<Vec3>| Clip::new(clip.skeleton().clone(), clip.fps(), root, clip.rotations().to_vec());
    let mut settled = at(root)?;
    if !fixed.root && !fixed.path {
        let offsets = anchor::offsets(&tracks(&settled, &legs), floor_m, fixed.frames);
        settled = at(settled.root().iter().zip(&offsets).map(|(p, by)| *p + *by).collect())?;
        locked.carried_cm = offsets.iter().map(|by| 100.0 * by.length()).fold(0.0, f64::max);
    }
    if fixed.root && fixed.legs == [false; 2] {
        // with a fixed root the legs alone take up the height that the body would have settled by
        let down = Moves { by: ups.iter().map(|up| Vec3::Y * -up).collect(), turn: vec![0.0; clip.frames()] };
        settled = bent(&settled, legs.each_ref(), &[(0, down.clone()), (1, down)])?.0;
    }
    let tracks = tracks(&settled, &legs);
    let mut found: [Vec<Contact>; 2] = Default::default();
    for (side, track) in tracks.iter().enumerate().filter(|(side, _)| !fixed.legs[*side]) {
        found[side] = contacts(track, side, floor_m);
        found[side].iter_mut().for_each(|contact| contact.begin_at(fixed.frames, track));
        found[side].retain(|contact| !contact.frames().is_empty());
        let whole = found[side].iter_mut().filter(|contact| contact.from > fixed.frames || fixed.frames == 0);
        whole.for_each(|contact| contact.turn = flatten::turn(track, contact.frames()));
    }
    // reach is known only after the body was lowered: drop the contacts that are out of reach and repeat
    loop {
        let (done, far) = hold(&settled, &tracks, &found, floor_m, fixed)?;
        if far.is_empty() {
            locked.moved_cm = moved_cm(&settled, &done, &legs, &found);
            locked.locked = found.concat();
            return Ok((done, locked));
        }
        for contact in far {
            let same = |c: &Contact| *c == contact;
            if let Some(c) = found[contact.side].iter_mut().find(|c| same(c) && c.turn != 0.0) {
                c.turn = 0.0;
                continue;
            }
            found[contact.side].retain(|c| !same(c));
            locked.out_of_reach.push(contact);
        }
    }
}

fn tracks<'a>(clip: &Clip, legs: &'a [Leg; 2]) -> [FootTrack<'a>; 2] {
    [0, 1].map(|side| FootTrack::new(clip, &legs[side]))
}

/// How far the body floats above the floor (F), metres.
fn floating_m(clip: &Clip, feet: &Feet, floor_m: f64, fixed: FixedParts) -> Vec<f64> {
    let (least, others) = (feet.clearance(clip), feet.other_heights(clip));
    let least: Vec<f64> =
        least.iter().zip(&others).map(|(y, other)| settle::height(y - floor_m, other - floor_m)).collect();
    let pelvis: Vec<f64> = clip.root().iter().map(|p| p.y).collect();
    let begins = Begins { frames: fixed.frames, fps: clip.fps() };
    settle::offsets(&least, &pelvis, clip.fps()).into_iter().enumerate().map(|(f, up)| up * begins.share(f)).collect()
}

/// Bends the legs by these moves. Also returns how far (F) each ankle remains from its target, metres.
fn bent(clip: &Clip, legs: [&Leg; 2], moves: &[(usize, Moves)]) -> Result<(Clip, [Vec<f64>; 2])> {
    let frames = clip.frames();
    let mut rotations = clip.rotations().to_vec();
    let mut error: [Vec<f64>; 2] = [vec![0.0; frames], vec![0.0; frames]];
    let mut pose = GlobalPose::default();
    for f in 0..frames {
        let local: &mut [Quat] = &mut rotations[f * clip.joints()..][..clip.joints()];
        for (side, Moves { by, turn }) in moves {
            if by[f].length() > 0.0 || turn[f] != 0.0 {
                let leg = legs[*side];
                pose.set(clip.skeleton(), clip.root()[f], local);
                let sole = leg.sole(clip.skeleton(), &pose);
                let turn = sole.map_or(Quat::IDENTITY, |sole| flatten::toes_up(sole, turn[f]));
                error[*side][f] = leg.bend(clip.skeleton(), &pose, by[f], turn, local);
            }
        }
    }
    Ok((Clip::new(clip.skeleton().clone(), clip.fps(), clip.root().to_vec(), rotations)?, error))
}

/// The blend from given frames to corrected ones.
#[derive(Debug, Clone, Copy)]
struct Begins {
    frames: usize,
    fps: f64,
}

impl Begins {
    /// The weight of the correction: 0 in the given frames, rising to 1 over [`BEGIN_S`].
    fn share(self, frame: usize) -> f64 {
        if self.frames == 0 {
            return 1.0;
        }
        let t = (frame + 1).saturating_sub(self.frames) as f64 / (BEGIN_S * self.fps).max(1.0);
        contact::smooth(t.min(1.0))
    }
}

/// Locks these contacts; also returns those that are out of reach.
fn hold(
    clip: &Clip,
    tracks: &[FootTrack; 2],
    found: &[Vec<Contact>; 2],
    floor_m: f64,
    fixed: FixedParts,
) -> Result<(Clip, Vec<Contact>)> {
    let (frames, fps) = (clip.frames(), clip.fps());
    let begins = Begins { frames: fixed.frames, fps };
    let free = (0..2).filter(|side| !fixed.legs[*side]);
    let mut moves: Vec<(usize, Moves)> =
        free.map(|side| (side, contact::moves(&tracks[side], &found[side], floor_m, begins))).collect();
    let mut lower = vec![0.0f64; frames];
    if !fixed.root {
        let mut pose = GlobalPose::default();
        for (f, lower) in lower.iter_mut().enumerate() {
            pose.set(clip.skeleton(), clip.root()[f], clip.pose(f));
            for (side, Moves { by, .. }) in &moves {
                let needed = tracks[*side].leg.lowering(&pose, by[f], STRETCH) * begins.share(f);
                // one foot out of reach must not pull the body into a crouch: its contact is dropped instead
                *lower = lower.max(needed.min(LOWER_M));
            }
        }
        lower = settle::widened(&lower, fps);
        lower.iter_mut().enumerate().for_each(|(f, lower)| *lower *= begins.share(f));
    }
    let root: Vec<Vec3> = clip.root().iter().zip(&lower).map(|(p, down)| *p - Vec3::Y * *down).collect();
    let lowered = Clip::new(clip.skeleton().clone(), fps, root, clip.rotations().to_vec())?;
    // the foot's target doesn't move with the lowered body
    moves.iter_mut().for_each(|(_, moves)| moves.by.iter_mut().zip(&lower).for_each(|(by, down)| by.y += down));
    let (done, error) = bent(&lowered, tracks.each_ref().map(|track| track.leg), &moves)?;
    let far = found.iter().flatten().filter(|c| error[c.side][c.frames()].iter().any(|error| *error > REACH_M));
    Ok((done, far.cloned().collect()))
}

/// Mean displacement of the ankles over the frames of contacts, centimetres.
fn moved_cm(before: &Clip, after: &Clip, legs: &[Leg; 2], found: &[Vec<Contact>; 2]) -> f64 {
    let (a, b, j) = (before.positions(), after.positions(), before.joints());
    let frames = found.iter().flatten().flat_map(|c| c.frames().map(|f| f * j + legs[c.side].ankle));
    let (sum, n) = frames.fold((0.0, 0), |(sum, n), i| (sum + (b[i] - a[i]).length(), n + 1));
    100.0 * sum / f64::from(n.max(1))
}

#[cfg(test)]
mod tests;
