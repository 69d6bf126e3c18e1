//! A request decided: every choice that it leaves open is made here, and only here, with the reason.

use super::open::{AHEAD, OpenRequest};
use super::request::{Draws, FootMode, LeadInKind, Length, Place, Request, Resolved, Rig};
use super::rest::RestJoints;
use super::starts::STARTS;
use super::{feet, music};
use crate::{Error, Result};
use kinelm_model::CheckpointChoice;

/// A choice that the request left open.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Decision {
    /// The field of [`Request`].
    pub option: &'static str,
    /// What was chosen.
    pub value: String,
    /// Why.
    pub why: &'static str,
}

impl OpenRequest {
    /// Opens the model that a request names, reads prompt and music, and decides everything that the request leaves open:
    /// [`OpenRequest::recipe`] then says all of it, and [`OpenRequest::decisions`] why.
    ///
    /// ```no_run
    /// use kinelm_generate::open::OpenRequest;
    /// use kinelm_generate::request::{Length, Request};
    /// use std::path::Path;
    ///
    /// let request = Request { length: Some(Length::Seconds(10.0)), ..Request::of("run") };
    /// let ready = OpenRequest::open(&request)?;
    /// let danced = ready.dance(1, None, &mut |frames| eprintln!("{frames} of {}", ready.frames))?;
    /// let out = Path::new("dance.bvh");
    /// std::fs::write(out, ready.motion(&ready.words(&danced, 0), out)?.bytes(out)?)?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// Those of [`OpenRequest::load`]; a lead-in for a dance whose first frame is given, or that the run doesn't keep; candidates
    /// for a first frame that there is nothing to choose by.
    pub fn open(request: &Request) -> Result<OpenRequest> {
        if request.ahead.is_some() && request.prompt.is_none() {
            return Err(Error::option("ahead", "there is no clip; what is given ahead is that of a prompt or a plan"));
        }
        let edit = request.prompt.as_ref().and_then(|prompt| prompt.edit.as_ref());
        if edit.is_some() && request.rest_joints.is_some() {
            let what = "the clip is edited: joints that the model doesn't know are the clip's; leave it out";
            return Err(Error::option("rest-joints", what));
        }
        let mut ready = OpenRequest::load(request.begun(), CheckpointChoice::Auto)?;
        if request.rig.is_none() {
            let why = if edit.is_some() { "a clip is edited" } else { "no clip is edited" };
            ready.decided("rig", format!("{:?}", ready.recipe.rig).to_lowercase(), why);
        }
        if request.rest_joints.is_none() {
            let why = if request.prompt.is_some() { "there is a prompt" } else { "there is no prompt" };
            ready.decided("rest-joints", format!("{:?}", ready.recipe.rest_joints).to_lowercase(), why);
        }
        if request.length.is_none() {
            ready.decided(
                "length",
                ready.frames,
                "as long as what is given of the prompt, else the music, else the prompt",
            );
        }
        ready.stand_with_prompt();
        ready.decide_lead_in(request.lead_in)?;
        ready.decide_first_frame(request.starts)?;
        if !request.draw.truncates() {
            ready.cut_where_given();
            let why = if ready.recipe.draw.top_p == Some(super::cut::GIVEN_TOP_P) {
                "joints are given from end to end"
            } else {
                "the model's own distribution without its rare tail"
            };
            ready.decided("top-p", ready.recipe.draw.top_p.unwrap_or(1.0), why);
        }
        if request.ahead.is_none() {
            let leads = ready.run.config.goal && ready.has_gaps_that_end();
            ready.recipe.ahead = if leads { AHEAD } else { 0.0 };
            let why =
                if leads { "the model was trained for it and a gap ends" } else { "no gap ends, or untrained for it" };
            ready.decided("ahead", ready.recipe.ahead, why);
        }
        if request.guidance.is_none() {
            let why = if ready.music.is_some() {
                ready.guide(music::guidance(ready.run.config.music));
                "what suits the model's conditioning on music"
            } else {
                "no music: labels are followed as the model has learned them"
            };
            ready.decided("guidance", ready.recipe.guidance, why);
        }
        if request.feet.is_none() {
            let given = feet::fixed(ready.prompt.as_ref(), 0).legs.contains(&true);
            ready.recipe.feet = if given { FootMode::Off } else { FootMode::Lock };
            let why = if given { "a leg is given" } else { "no leg is given" };
            ready.decided("feet", format!("{:?}", ready.recipe.feet).to_lowercase(), why);
        }
        Ok(ready)
    }

    fn decided(&mut self, option: &'static str, value: impl ToString, why: &'static str) {
        self.decisions.push(Decision { option, value: value.to_string(), why });
    }

    /// The dance is to stand where and as its prompt does, if it has one.
    fn stand_with_prompt(&mut self) {
        let free = self.prompt.as_ref().filter(|prompt| prompt.edit.is_none());
        self.recipe.place = free.as_ref().and_then(|prompt| Place::of(&prompt.clip.clip));
    }

    /// What an unprompted dance goes on from.
    fn decide_lead_in(&mut self, kind: Option<LeadInKind>) -> Result<()> {
        let nothing = self.begins_from_nothing();
        if kind.is_some() && !nothing {
            let what = "something of the first frame is given, and the dance goes on from that; leave it out";
            return Err(Error::option("lead-in", what));
        }
        self.lead_in_from_nothing(kind != Some(LeadInKind::None))?;
        if !nothing || self.lead_in(0).is_some() || kind == Some(LeadInKind::None) {
            if nothing && kind.is_none() {
                self.decided("lead-in", "train", "the run keeps seconds of train clips");
            }
            return Ok(());
        }
        let what = format!(
            "{}: no second of a train clip is kept with the model, as where it was trained elsewhere or all clips are shorter",
            self.recipe.run.display()
        );
        if kind.is_some() {
            return Err(Error::option("lead-in", format!("train: {what}; leave it out")));
        }
        self.run.notes.push(format!("{what}: the dance goes on from one that the model draws"));
        self.decided("lead-in", "none", "no second of a train clip is kept with the model");
        Ok(())
    }

    /// How many candidates the first frame is chosen among.
    fn decide_first_frame(&mut self, starts: Option<usize>) -> Result<()> {
        match starts {
            None => {
                let chosen = self.begins_in_part() && self.tries() == 1;
                self.recipe.starts = if chosen { STARTS } else { 1 };
                let why =
                    if chosen { "joints of the first frame are given after free ones" } else { "nothing to choose by" };
                self.decided("starts", self.recipe.starts, why);
                Ok(())
            }
            Some(starts) if starts > 1 && !self.begins_in_part() => Err(Error::option(
                "starts",
                format!(
                    "{starts}: there is nothing to choose a start by; expected joints that are given in the first frame and \
                     stand there behind others that are drawn (right_arm does, root doesn't), and no frames kept in front \
                     or greedy draws"
                ),
            )),
            Some(_) => Ok(()),
        }
    }
}

impl Request {
    /// What can be said of the request before the model is open.
    fn begun(&self) -> Resolved {
        let is_edited = self.prompt.as_ref().is_some_and(|prompt| prompt.edit.is_some());
        let rest = if self.prompt.is_some() { RestJoints::Follow } else { RestJoints::Training };
        let (frames, seconds) = match self.length {
            Some(Length::Frames(frames)) => (Some(frames), None),
            Some(Length::Seconds(seconds)) => (None, Some(seconds)),
            None => (None, None),
        };
        Resolved {
            run: self.run.clone(),
            prompt: self.prompt.clone(),
            labels: self.labels.clone(),
            timed_labels: self.timed_labels.clone(),
            guidance: self.guidance.unwrap_or(if self.music.is_some() { music::GUIDANCE } else { 1.0 }),
            ahead: self.ahead.unwrap_or(0.0),
            music: self.music.clone(),
            frames,
            seconds,
            fps: self.fps,
            lead_in: 0,
            lead_in_from: None,
            starts: self.starts.unwrap_or(1),
            seed: self.seed,
            draws: Draws::Given,
            draw: self.draw.truncated(),
            rig: self.rig.unwrap_or(if is_edited { Rig::Prompt } else { Rig::Model }),
            rest_joints: self.rest_joints.unwrap_or(rest),
            place: None,
            feet: self.feet.unwrap_or(FootMode::Off),
            computing: self.computing.clone(),
        }
    }
}
