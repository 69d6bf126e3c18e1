//! `kinelm generate --given --free`: what is asked for, and what was understood.

use crate::cli::{Say, WrongCall};
use crate::generate::edit::Edited;
use crate::generate::edit::close::LeftOver;
use crate::generate::edit::mask::Understood;
use crate::generate::edit::round::roughness;
use crate::generate::followed::Followed;
use crate::generate::open::Generated;
use crate::generate::request::{Comes, Edit, PromptRequest, Round, Span, TimedLabel, Timeline};
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
    /// Keep these joints of the prompt, throughout or from one moment to another (2s, 40f of the file, 12m of the model, -1s
    /// from the end); all else is made anew. Several add up
    #[arg(long, value_name = "JOINTS[@FROM:TO]", requires = "prompt", conflicts_with_all = ["joints", "from_frame"])]
    given: Vec<Span>,
    /// Make these joints anew, throughout or from one moment to another, even where they are given; without --given all else
    /// is kept. The file's other numbers stay as they are
    #[arg(long, value_name = "JOINTS[@FROM:TO]", requires = "prompt", conflicts_with_all = ["joints", "from_frame"])]
    free: Vec<Span>,
    /// Make the end of the prompt anew so that it goes over into its beginning: it can be played over and over. With `pose`
    /// only the pose comes back, while place and heading go on
    #[arg(long = "loop", value_name = "back|pose", num_args = 0..=1, require_equals = true, default_missing_value = "back",
        requires = "prompt", conflicts_with_all = ["joints", "from_frame", "given", "free", "frames", "seconds"])]
    round: Option<Comes>,
    /// Seconds of the end that --loop makes anew: 2s, 2 or 120f (frames of the file)
    #[arg(long, value_name = "S", default_value = "2s", requires = "round", value_parser = crate::cli::read::time)]
    loop_over: Moment,
    /// Seconds over which what differs where new meets old is faded, on the new side: 0.2s, 0.2 or 12f (frames of the file)
    #[arg(long, value_name = "S", default_value = "0.2s", value_parser = crate::cli::read::time)]
    blend: Moment,
    /// Ways that are drawn through a gap, of which the one is kept that ends nearest to where the clip goes on
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u8).range(1..=64))]
    tries: u8,
}

/// The seconds of a flag, `least` to 60; `fps` is asked where they are told in frames.
fn seconds(flag: &str, time: Moment, least: f64, fps: &dyn Fn() -> Result<f64>) -> Result<f64> {
    let s = match time {
        Moment::Seconds(s) => s,
        frames => frames.seconds(fps()?),
    };
    if (least..=60.0).contains(&s) {
        return Ok(s);
    }
    Err(WrongCall(format!("--{flag} {time}: expected {least} to 60 seconds")).into())
}

impl EditArgs {
    /// Whether a clip is to be edited.
    pub fn is_asked(&self) -> bool {
        !self.given.is_empty() || !self.free.is_empty() || self.round.is_some()
    }

    /// What is asked for, if a clip is to be edited; `fps` gives its file's rate.
    ///
    /// # Errors
    /// Times outside their limits.
    pub fn get(&self, fps: &dyn Fn() -> Result<f64>) -> Result<Option<Edit>> {
        let (given, free, blend_s) = (self.given.clone(), self.free.clone(), self.blend_s(fps)?);
        let over_s = seconds("loop-over", self.loop_over, 0.1, fps)?;
        let round = self.round.map(|comes| Round { comes, over_s });
        Ok(self.is_asked().then(|| Edit { given, free, blend_s, tries: self.tries.into(), round }))
    }

    fn blend_s(&self, fps: &dyn Fn() -> Result<f64>) -> Result<f64> {
        seconds("blend", self.blend, 0.0, fps)
    }
}

/// What a plan asks for: what is made of its clips, and what the model is told when.
pub fn planned(path: &Path, args: &EditArgs, say: Say) -> Result<(PromptRequest, Vec<TimedLabel>)> {
    let (plan, laid) = Timeline::load(path)?;
    laid.notes.iter().for_each(|note| say.line(note));
    let (path, read, given) = (laid.path().to_owned(), laid.read(), laid.given());
    let (free, blend_s) = (Vec::new(), args.blend_s(&|| Ok(laid.fps))?);
    let edit = Edit { given, free, blend_s, tries: args.tries.into(), round: None };
    let prompt = PromptRequest { path, read, joints: None, from_frame: None, plan: Some(plan), edit: Some(edit) };
    Ok((prompt, laid.labels))
}

/// Says what was understood of an edit.
pub fn say_understood(prompt: &Followed, edited: &Edited, say: Say) {
    let fps = prompt.clip.motion.clip.fps();
    let names = |joints: &[usize]| joints.iter().map(|&j| smpl::NAMES[j]).collect::<Vec<_>>().join(" ");
    let tell = |word: &str, understood: &Understood| {
        let Understood { span, joints, uncoded, frames, twice } = understood;
        let (from, to) = (frames.start + edited.left_out, frames.end + edited.left_out);
        let (from_s, to_s) = (frames.start as f64 / fps, frames.end as f64 / fps);
        let (joints, last) = (names(joints), to - 1);
        say.line(format_args!(
            "{word} {span}: {joints}; frames {from} to {last} of the file, {from_s:.2} to {to_s:.2} s"
        ));
        twice.iter().for_each(|(part, own)| say.line(format_args!("  {}", ambiguity_note(part, own))));
        if !uncoded.is_empty() {
            let what = "the model doesn't know them; they are the prompt's, and where all that it knows is free, go from their \
                        pose before to that behind";
            say.line(format_args!("  {}: {what}", names(uncoded)));
        }
    };
    edited.read.given.iter().for_each(|understood| tell("given", understood));
    edited.read.free.iter().for_each(|understood| tell("free", understood));
    say.line(match edited.read.given.is_empty() {
        _ if edited.seam.is_some() => "all else is given; behind it the beginning comes again",
        true => "all else is given",
        false => "all else is free",
    });
}

/// Says how far the dance was from its clip where gaps end.
pub fn say_left(left: &[LeftOver], fps: f64, say: Say) {
    for gap in left {
        let (from, to) = (gap.frames.start as f64 / fps, gap.frames.end as f64 / fps);
        let LeftOver { cm, heading_degrees, joints_degrees, .. } = gap;
        say.line(format_args!(
            "at {to:.2} s the new frames since {from:.2} s ended {cm:.1} cm and {heading_degrees:.0} degrees of heading from where \
             the clip goes on, joints {joints_degrees:.0} degrees; spread over them"
        ));
    }
    let is_far =
        |gap: &&LeftOver| gap.cm > FAR_CM || gap.heading_degrees > FAR_DEGREES || gap.joints_degrees > FAR_DEGREES;
    let far = left.iter().filter(is_far).count();
    if far > 0 {
        let what = "may look pulled; more --tries, a longer gap or another --seed may end nearer";
        say.line(format_args!("warning: {} ended far from where the clip goes on: it {what}", counted(far, "gaps")));
    }
}

/// Says how rough the seam of a clip is that goes round.
pub fn say_seam(edited: &Edited, made: &Generated, say: Say) {
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
