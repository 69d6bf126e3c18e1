//! Dances decoded: words become a motion on a rig, at a rate, with feet locked, and a file with its sidecar.

mod distance;
mod free_spans;
mod likelihood;
mod notes;
mod placement;
mod request_notes;
pub mod surprise;

pub use free_spans::FreeSpan;
pub use placement::RootGiven;

use crate::Result;
use crate::edit::{ClosedGaps, ClosingError, PreparedEdit};
use crate::feet::{fixed, lock_feet};
use crate::open::{OpenRequest, PreparedPrompt};
use crate::prompt::uncoded;
use crate::request::{FootMode, Placement, Rig, UncodedJoints};
use kinelm_motion::feet::FootLock;
use kinelm_motion::format::{self, Changed, ReadOptions, RestFrame};
use kinelm_motion::resample::{Method, resample_held};
use kinelm_motion::{Clip, Motion};
use kinelm_tokenizer::{UncodedPose, Words};
use std::path::Path;
use std::sync::Arc;

/// A dance as it is written.
pub struct Generated {
    /// On its rig, at its rate.
    pub motion: Motion,
    /// The changes by foot locking, gap by gap where a clip is edited. Frames are [`Generated::locked_fps`] per second.
    pub locked: Vec<FootLock>,
    /// The rate at which feet were locked.
    pub locked_fps: f64,
    /// Of an edited clip: the errors at the ends of gaps, frames at the model's rate.
    pub errors: Vec<ClosingError>,
    /// Of an edited clip on its own rig and at its own rate: what is new, and the bytes of its file.
    changed: Option<(Changed, Arc<[u8]>)>,
}

impl Generated {
    /// The bytes of a file of this name, whose extension says the format.
    ///
    /// # Errors
    /// Those of [`format::edited_to_bytes`].
    pub fn bytes(&self, out: &Path) -> Result<Vec<u8>> {
        Ok(match &self.changed {
            Some((changed, file)) => format::edited_to_bytes(out, &self.motion, changed, file)?,
            None => format::to_bytes(out, &self.motion)?,
        })
    }
}

impl OpenRequest {
    /// Words as a motion on the requested rig, at the requested rate, to be written to `out`. A clip that is edited keeps its
    /// floor; the floor of every other dance is y = 0.
    ///
    /// # Errors
    /// Words that are not this tokenizer's; a rig that no skeleton map knows; a rate that is none.
    pub fn motion(&self, words: &Words, out: &Path) -> Result<Generated> {
        if let Some((prompt, edit)) = self.edit() {
            return self.edited(words, prompt, edit, out);
        }
        let motion = self.decoded(words, out)?;
        // before the feet are locked: a curve through locked frames would slide between them
        let clip = resample_held(&motion.clip, self.resolved.fps, Method::Smooth)?;
        let motion = motion.with_clip(clip);
        let generated = |motion: Motion, locked: Vec<FootLock>| {
            let locked_fps = motion.clip.fps();
            Generated { motion, locked, locked_fps, errors: Vec::new(), changed: None }
        };
        if self.resolved.feet == FootMode::Off {
            return Ok(generated(motion, Vec::new()));
        }
        let floor_m = Some(0.0).filter(|_| self.tokenizer.config().above_floor());
        let continued = self.resolved.prompt.as_ref().and_then(|p| p.from_frame).unwrap_or(0);
        // the frames up to the prompt's last, at the rate that is written
        let at_rate = |last: usize| (last as f64 * motion.clip.fps() / self.tokenizer.fps()) as usize + 1;
        let continued = continued.checked_sub(1).map_or(0, at_rate);
        let selection = self.prompt.as_ref().and_then(|prompt| prompt.selection.as_ref());
        let fixed = fixed(selection, self.way.is_some(), continued);
        let (motion, locked) = lock_feet(motion, floor_m, fixed)?;
        Ok(generated(motion, vec![locked]))
    }

    /// Decoded frames from the first on, lead-in included, moved to the dance's place: a preview during sampling.
    pub(crate) fn standing(&self, clip: Clip) -> Result<Clip> {
        let clip = self.placed(clip)?;
        let Some((prompt, edit)) = self.edit() else { return Ok(clip) };
        let clip = clip.raised(prompt.clip.under_m);
        let Some(placement) = Placement::of(&prompt.clip.clip) else { return Ok(clip) };
        let is_given = edit.mask().is_given(0, 0);
        placement.put(&clip, RootGiven { path: is_given, heading: is_given })
    }

    /// An edited clip.
    fn edited(&self, words: &Words, prompt: &PreparedPrompt, edit: &PreparedEdit, out: &Path) -> Result<Generated> {
        let lock = self.resolved.feet == FootMode::Lock;
        let lead_in = self.resolved.lead_in;
        let ClosedGaps { clip, errors, locked } = edit.close(words, &prompt.clip, lead_in, &self.tokenizer, lock)?;
        let (motion, changed) = match self.on_own_rig() {
            Some((prompt, _)) => edit.on_own_rig(&clip, &prompt.clip, self.resampled_fps())?,
            None => (Motion::new(out, edit.at_rate(&clip, self.frames, self.resolved.fps)?), None),
        };
        let changed = changed.map(|changed| (changed, edit.text.clone()));
        Ok(Generated { motion, locked, locked_fps: self.tokenizer.fps(), errors, changed })
    }

    /// The motion of words, at the model's rate.
    fn decoded(&self, words: &Words, out: &Path) -> Result<Motion> {
        let clip = self.clip(words)?;
        let Some((prompt, _)) = self.on_own_rig() else { return Ok(Motion::new(out, clip)) };
        let follows = self.resolved.uncoded_joints == UncodedJoints::Follow;
        let base = follows.then(|| uncoded::settle(&prompt.clip.at_rate()?, prompt.frames)).transpose()?;
        let about_m = prompt.clip.about_m(RootGiven::by(prompt).path)?;
        prompt.clip.on_own_rig(&clip, about_m, base.as_ref())
    }

    /// The clip of words on the model's rig, in its place: on y = 0, unless it is an edit.
    fn clip(&self, words: &Words) -> Result<Clip> {
        self.placed(self.tokenizer.decode(words, UncodedPose::Clip(&self.rest()?))?)
    }

    /// The clip as which the joints move that the model doesn't code, see [`uncoded::rest`].
    pub(crate) fn rest(&self) -> Result<Clip> {
        let prompt = self.prompt.as_ref().map(|prompt| (&prompt.clip.clip, prompt.frames));
        uncoded::rest(&self.tokenizer, self.resolved.uncoded_joints, prompt)
    }

    fn placed(&self, clip: Clip) -> Result<Clip> {
        let clip = self.without_lead_in(&clip)?;
        let clip = clip.slice(0..self.frames.min(clip.frames()));
        if let Some(open) = &self.way {
            return placement::along(&clip, &open.clip);
        }
        match (&self.prompt, self.resolved.placement) {
            (Some(prompt), Some(placement)) => {
                let given = RootGiven::by(prompt);
                let first = clip.root().first().filter(|_| given.path);
                let rise = first.map(|first| prompt.clip.rise_m(first.y)).transpose()?;
                let clip = placement.put(&clip, given)?.raised(rise.unwrap_or(0.0));
                match &prompt.selection {
                    // steps are coded from the heading, which a tilt that isn't given turns a little
                    Some(selection) if selection.path && !selection.joints.contains(&0) => {
                        placement::on_path(&clip, &prompt.clip.clip)
                    }
                    _ => Ok(clip),
                }
            }
            _ => Ok(clip),
        }
    }

    /// A clip without its lead-in, standing where dances begin: at x = z = 0, facing as the model's rig does.
    fn without_lead_in(&self, clip: &Clip) -> Result<Clip> {
        if self.resolved.lead_in == 0 {
            return Ok(clip.clone());
        }
        let clip = clip.slice(self.resolved.lead_in.min(clip.frames())..clip.frames());
        let origin = Placement { x: 0.0, z: 0.0, heading: Some(0.0) };
        origin.put(&clip, RootGiven { path: false, heading: false })
    }

    /// How the dance is read from `dance`, the file that it is written to.
    pub fn read_back(&self, dance: &Path) -> ReadOptions {
        let own = self.resolved.read_back(dance);
        let written = self.edit().zip(self.resampled_fps()).filter(|_| self.resolved.rig == Rig::Prompt);
        let Some(((prompt, edit), fps)) = written.filter(|((_, edit), _)| edit.seam.is_none()) else {
            return own;
        };
        // as many seconds in front as reading leaves out of the clip
        let skip = (edit.left_out as f64 * fps / prompt.clip.motion.clip.fps() - 1e-6).ceil() as usize;
        ReadOptions { skip, rest: RestFrame::Keep, ..own }
    }

    /// The parts of the dance, in seconds as it is read, that are generated while the rest is given; empty where all of it is
    /// generated.
    pub fn generated_s(&self) -> Vec<[f64; 2]> {
        if let Some((prompt, edit)) = self.edit() {
            let seconds = |frame: usize| frame as f64 / prompt.clip.motion.clip.fps();
            return edit.generated().iter().map(|gap| [seconds(gap.start), seconds(gap.end)]).collect();
        }
        let from = self.resolved.prompt.as_ref().filter(|p| p.joints.is_none()).and_then(|p| p.from_frame);
        from.map(|from| [from, self.frames].map(|frame| frame as f64 / self.tokenizer.fps())).into_iter().collect()
    }
}
