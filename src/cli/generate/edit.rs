//! `kinelm generate --given --free`: what is asked for, and what was understood.

use super::dance::DanceArgs;
use crate::cli::{Say, wrong_call};
use crate::generate::edit::loop_seam::roughness;
use crate::generate::edit::{ClosingError, PreparedEdit, ResolvedSpan};
use crate::generate::open::PreparedPrompt;
use crate::generate::output::Generated;
use crate::generate::request::{Edit, Loop, LoopKind, PromptRequest, Span, Timeline};
use crate::generate::timeline::TimelineLayout;
use anyhow::Result;
use kinelm_motion::joints::ambiguity_note;
use kinelm_motion::moment::Moment;
use kinelm_motion::smpl;
use kinelm_store::counted;
use std::path::Path;

/// Further off than this a gap ends elsewhere than its clip goes on: said.
const FAR_CM: f64 = 30.0;
const FAR_DEGREES: f64 = 30.0;
/// A seam that is so many times as rough as nearly all of its clip is seen.
const ROUGH: f64 = 3.0;

#[derive(Debug, clap::Args)]
pub struct EditArgs {
    /// Joints to keep as they are in the prompt, throughout or for a time (2s, 40f of the file, 12m of the model, -1s from the
    /// end); all else is generated. May be repeated
    #[arg(long, value_name = "JOINTS[@FROM:TO]", requires = "prompt", conflicts_with_all = ["joints", "from_frame"])]
    given: Vec<Span>,
    /// Joints to generate, throughout or for a time, even where --given names them; without --given all else is kept. The
    /// file's other numbers stay as they are. May be repeated
    #[arg(long, value_name = "JOINTS[@FROM:TO]", requires = "prompt", conflicts_with_all = ["joints", "from_frame"])]
    free: Vec<Span>,
    /// Generate the end of the prompt so that it leads into its beginning, to be played in a loop. With `pose` only the pose
    /// returns, while position and heading go on
    #[arg(long = "loop", value_name = "back|pose", num_args = 0..=1, require_equals = true, default_missing_value = "back",
        requires = "prompt", conflicts_with_all = ["joints", "from_frame", "given", "free", "frames", "seconds"])]
    round: Option<LoopKind>,
    /// Seconds at the end that --loop generates: 2s, 2 or 120f (frames of the file); 0.1 to 60
    #[arg(long, value_name = "S", default_value = "2s", requires = "round", value_parser = crate::cli::read::time)]
    loop_over: Moment,
}

/// The seconds of a flag, `least` to 60; `fps` gives the rate of a time in frames.
fn seconds(flag: &str, time: Moment, least: f64, fps: &dyn Fn() -> Result<f64>) -> Result<f64> {
    let s = match time {
        Moment::Seconds(s) => s,
        frames => frames.seconds(fps()?),
    };
    match (least..=60.0).contains(&s) {
        true => Ok(s),
        false => wrong_call!("--{flag} {time}: expected {least} to 60 seconds"),
    }
}

impl EditArgs {
    /// Whether a clip is to be edited.
    pub fn is_requested(&self) -> bool {
        !self.given.is_empty() || !self.free.is_empty() || self.round.is_some()
    }

    /// The requested edit, if any; `fps` gives the rate of the prompt's file.
    ///
    /// # Errors
    /// Times outside their limits.
    pub fn get(&self, dance: &DanceArgs, fps: &dyn Fn() -> Result<f64>) -> Result<Option<Edit>> {
        let (given, free) = (self.given.clone(), self.free.clone());
        let blend_s = seconds("blend", dance.blend, 0.0, fps)?;
        let over_s = seconds("loop-over", self.loop_over, 0.1, fps)?;
        let looping = self.round.map(|kind| Loop { kind, over_s });
        Ok(self.is_requested().then(|| Edit { given, free, blend_s, tries: dance.tries.into(), looping }))
    }
}

/// The prompt that a timeline makes of its clips, and the layout.
pub fn of_timeline(path: &Path, dance: &DanceArgs, say: Say) -> Result<(PromptRequest, TimelineLayout)> {
    let (timeline, layout) = Timeline::load(path)?;
    layout.notes.iter().for_each(|note| say.line(note));
    let (path, read, given) = (layout.path().to_owned(), layout.read(), layout.given());
    let blend_s = seconds("blend", dance.blend, 0.0, &|| Ok(layout.fps))?;
    let edit = Edit { given, free: Vec::new(), blend_s, tries: dance.tries.into(), looping: None };
    let prompt =
        PromptRequest { path, read, joints: None, from_frame: None, timeline: Some(timeline), edit: Some(edit) };
    Ok((prompt, layout))
}

/// Says what was understood of an edit.
pub fn say_understood(prompt: &PreparedPrompt, edited: &PreparedEdit, say: Say) {
    let fps = prompt.clip.motion.clip.fps();
    let names = |joints: &[usize]| joints.iter().map(|&j| smpl::NAMES[j]).collect::<Vec<_>>().join(" ");
    let tell = |word: &str, understood: &ResolvedSpan| {
        let ResolvedSpan { span, joints, uncoded, frames, ambiguous } = understood;
        let (from, to) = (frames.start + edited.left_out, frames.end + edited.left_out);
        let (from_s, to_s) = (frames.start as f64 / fps, frames.end as f64 / fps);
        let (joints, last) = (names(joints), to - 1);
        say.line(format_args!(
            "{word} {span}: {joints}; frames {from} to {last} of the file, {from_s:.2} to {to_s:.2} s"
        ));
        ambiguous.iter().for_each(|(part, own)| say.line(format_args!("  {}", ambiguity_note(part, own))));
        if !uncoded.is_empty() {
            let what = "the model doesn't know them; they are the prompt's, and where all that it knows is free, go from their \
                        pose before to that behind";
            say.line(format_args!("  {}: {what}", names(uncoded)));
        }
    };
    edited.spans.given.iter().for_each(|understood| tell("given", understood));
    edited.spans.free.iter().for_each(|understood| tell("free", understood));
    say.line(match edited.spans.given.is_empty() {
        _ if edited.seam.is_some() => "all else is given; behind it the beginning comes again",
        true => "all else is given",
        false => "all else is free",
    });
}

/// Says how far the dance was from its clip where gaps end.
pub fn say_left(left: &[ClosingError], fps: f64, say: Say) {
    for gap in left {
        let (from, to) = (gap.frames.start as f64 / fps, gap.frames.end as f64 / fps);
        let ClosingError { cm, heading_degrees, joints_degrees, .. } = gap;
        say.line(format_args!(
            "at {to:.2} s the new frames since {from:.2} s ended {cm:.1} cm and {heading_degrees:.0} degrees of heading from where \
             the clip goes on, joints {joints_degrees:.0} degrees; spread over them"
        ));
    }
    let is_far =
        |gap: &&ClosingError| gap.cm > FAR_CM || gap.heading_degrees > FAR_DEGREES || gap.joints_degrees > FAR_DEGREES;
    let far = left.iter().filter(is_far).count();
    if far > 0 {
        let what = "may look pulled; more --tries, a longer gap or another --seed may end nearer";
        say.line(format_args!("warning: {} ended far from where the clip goes on: it {what}", counted(far, "gaps")));
    }
}

/// Says how rough the seam of a clip is that goes round.
pub fn say_seam(edited: &PreparedEdit, made: &Generated, say: Say) {
    let Some(seam) = &edited.seam else { return };
    // at another rate than the file's the gap lies elsewhere
    let clip = Some(&made.motion.clip).filter(|clip| clip.frames() == seam.frames());
    if let Some((seam, usual)) = clip.and_then(|clip| roughness(clip, &seam.gap)) {
        let warning = if seam > ROUGH * usual { "warning: " } else { "" };
        say.line(format_args!(
            "{warning}where it goes round it jerks by {seam:.0} m/s³; 99 of 100 given frames by less than {usual:.0}"
        ));
    }
}
