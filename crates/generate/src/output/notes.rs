//! Notes for the user on a generated dance.

use super::Generated;
use super::distance::given_distance;
use super::placement::off_way;
use crate::Result;
use crate::edit::gap::ClosingError;
use crate::edit::loop_seam::roughness;
use crate::open::{OpenRequest, OpenWay};
use crate::prompt;
use kinelm_motion::resample::{Method, resample_held};
use kinelm_motion::retarget::to_smpl;
use kinelm_store::counted;
use kinelm_tokenizer::Words;
use std::path::Path;

/// Closing errors from which a warning is due.
const FAR_CM: f64 = 30.0;
const FAR_DEGREES: f64 = 30.0;
/// A seam this many times as rough as 99 % of its clip is visible.
const ROUGH: f64 = 3.0;

impl Generated {
    /// Lines to print about gaps, the seam of a loop and locked feet.
    pub fn notes(&self, open: &OpenRequest) -> Vec<String> {
        let mut notes = self.closing_notes();
        let seam = open.prompt.as_ref().and_then(|prompt| prompt.edit.as_ref()?.seam.as_ref());
        // at another rate than the file's the gap is elsewhere
        let seam = seam.filter(|seam| self.motion.clip.frames() == seam.frames());
        if let Some((seam, usual)) = seam.and_then(|seam| roughness(&self.motion.clip, &seam.gap)) {
            let warning = if seam > ROUGH * usual { "warning: " } else { "" };
            notes.push(format!(
                "{warning}the seam of the loop jerks by {seam:.0} m/s³; 99 of 100 given frames by less than {usual:.0}"
            ));
        }
        notes.extend(open.way.as_ref().and_then(|open| self.off_way_note(open)));
        notes.extend(self.locked.iter().flat_map(|locked| locked.notes(self.locked_fps)));
        notes
    }

    /// How far the dance is from the path that it was led along; nothing on a rig that can't be read as a body.
    fn off_way_note(&self, open: &OpenWay) -> Option<String> {
        let way = resample_held(&open.clip, self.motion.clip.fps(), Method::Smooth).ok()?;
        // the pelvis isn't the root of each rig
        let body = to_smpl(&self.motion).ok()?;
        let [mean_m, most_m, mean, most] = off_way(&body, &way)?;
        Some(format!(
            "off its path by {:.1} cm on average, {:.1} at most, and by {mean:.1} degrees, {most:.1} at most",
            100.0 * mean_m / open.scale,
            100.0 * most_m / open.scale
        ))
    }

    fn closing_notes(&self) -> Vec<String> {
        let fps = self.locked_fps;
        let line = |gap: &ClosingError| {
            let (from, to) = (gap.frames.start as f64 / fps, gap.frames.end as f64 / fps);
            let ClosingError { cm, heading_degrees, joints_degrees, .. } = gap;
            format!(
                "the gap from {from:.2} to {to:.2} s ended {cm:.1} cm and {heading_degrees:.0} degrees of heading from where the \
                 clip continues, joints {joints_degrees:.0} degrees; spread over it"
            )
        };
        let mut notes: Vec<String> = self.errors.iter().map(line).collect();
        let is_far = |gap: &&ClosingError| {
            gap.cm > FAR_CM || gap.heading_degrees > FAR_DEGREES || gap.joints_degrees > FAR_DEGREES
        };
        let far = self.errors.iter().filter(is_far).count();
        if far > 0 {
            let what = "may look pulled; more `tries`, a longer gap or another `seed` may end nearer";
            notes.push(format!("warning: {} ended far from where the clip continues: it {what}", counted(far, "gaps")));
        }
        notes
    }
}

impl OpenRequest {
    /// Reads a dance on the prompt's rig back: the percentage of given characters that are coded differently, and the mean
    /// distance of the given joints from the prompt's, as a line to print.
    ///
    /// # Errors
    /// Errors of reading and coding the file `out`.
    pub fn read_back_note(&self, words: &Words, out: &Path) -> Result<Option<String>> {
        let given = self.on_own_rig().filter(|(prompt, _)| !prompt.given.is_empty());
        let Some((prompt, _)) = given else { return Ok(None) };
        let back = prompt::read_back(out, &self.resolved, &prompt.clip, &self.tokenizer)?;
        let Some((motion, again)) = back else { return Ok(None) };
        let share = prompt::share_changed(words.codes(), again.codes(), &prompt.given, prompt.clip.words.len());
        let Some(share) = share else { return Ok(None) };
        let distance = given_distance(&self.tokenizer, prompt, &motion.clip)?;
        let distance = distance
            .map(|d| format!("; the given joints are {:.2} cm off on average, {:.2} at most", d.mean_cm, d.max_cm));
        Ok(Some(format!(
            "read back from the prompt's rig, {:.4} % of the given characters differ{}",
            100.0 * share,
            distance.unwrap_or_default()
        )))
    }
}
