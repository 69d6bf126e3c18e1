//! The flags of edits: `--given`, `--free`, `--loop`.

use super::dance::DanceArgs;
use crate::cli::{Say, wrong_call};
use crate::generate::request::{Edit, Loop, LoopKind, PromptRequest, Span, Timeline};
use crate::generate::timeline::TimelineLayout;
use anyhow::Result;
use kinelm_motion::moment::Moment;
use std::path::Path;

#[derive(Debug, clap::Args)]
pub struct EditArgs {
    /// Joints to keep as they are in the prompt, throughout or for a time (2s, 40f of the file, 12m of the model, -1s from the
    /// end); all else is generated. May be repeated
    #[arg(long, value_name = "JOINTS[@FROM:TO]", conflicts_with_all = ["joints", "from_frame"])]
    given: Vec<Span>,
    /// Joints to generate, throughout or for a time, even where --given names them; without --given all else is kept. The
    /// file's other numbers stay as they are. May be repeated
    #[arg(long, value_name = "JOINTS[@FROM:TO]", conflicts_with_all = ["joints", "from_frame"])]
    free: Vec<Span>,
    /// Generate the end of the prompt so that it leads into its beginning, to be played in a loop. With `pose` only the pose
    /// returns, while position and heading go on
    #[arg(long = "loop", value_name = "back|pose", num_args = 0..=1, require_equals = true, default_missing_value = "back",
        conflicts_with_all = ["joints", "from_frame", "given", "free", "frames", "seconds"])]
    round: Option<LoopKind>,
    /// Seconds at the end that --loop generates: 2s, 2 or 120f (frames of the file); 0.1 to 60
    #[arg(long, value_name = "S", default_value_t = Moment::Seconds(Loop::OVER_S), value_parser = crate::cli::values::time)]
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
        let (blend_s, tries) = (Some(seconds("blend", dance.blend, 0.0, fps)?), Some(dance.tries.into()));
        let over_s = Some(seconds("loop-over", self.loop_over, 0.1, fps)?);
        let looping = self.round.map(|kind| Loop { kind, over_s });
        Ok(self.is_requested().then_some(Edit { given, free, blend_s, tries, looping }))
    }
}

/// The prompt that a timeline makes of its clips, and the layout.
pub fn of_timeline(path: &Path, dance: &DanceArgs, say: Say) -> Result<(PromptRequest, TimelineLayout)> {
    let (timeline, layout) = Timeline::load(path)?;
    layout.notes.iter().for_each(|note| say.line(note));
    let blend_s = seconds("blend", dance.blend, 0.0, &|| Ok(layout.fps))?;
    let prompt = layout.prompt(timeline, Some(blend_s), Some(dance.tries.into()));
    Ok((prompt, layout))
}
