//! A request resolved: every option that it leaves open is decided here, and only here, with the reason.

use super::truncation::{GAP_TOP_P, GIVEN_TOP_P};
use super::{MUSIC_GUIDANCE, OpenRequest, music_guidance};
use crate::masked::PASSES;
use crate::request::{FootMode, LeadInKind, Length, Placement, Request, Resolved, Rig, UncodedJoints};
use crate::sampler::FIRST_FRAMES;
use crate::timeline::TimelineLayout;
use crate::{Error, Result};
use kinelm_model::CheckpointChoice;
use kinelm_motion::joints::LEGS;
use kinelm_store::Subject;
use serde::Serialize;

/// Scale of guidance towards goals, where a request has none.
pub const GOAL_GUIDANCE: f64 = 1.5;

/// Frames per second of a dance without a prompt, where a request has none.
pub const FPS: f64 = 30.0;

/// An option that the request left open.
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
    /// Opens the model that a request names, reads prompt and music, and decides every option that the request leaves open:
    /// [`OpenRequest::resolved`] then holds the decisions, and [`OpenRequest::decisions`] the reasons.
    ///
    /// ```no_run
    /// use kinelm_generate::{Length, OpenRequest, Request};
    ///
    /// let request = Request { length: Some(Length::Seconds(10.0)), ..Request::of("run") };
    /// OpenRequest::open(&request)?.write("dance.bvh")?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// Those of [`OpenRequest::load`]; a lead-in for a dance whose first frame is given, or that the run doesn't store;
    /// candidates for a first frame without anything to choose by; options that the request's other options rule out.
    pub fn open(request: &Request) -> Result<OpenRequest> {
        OpenRequest::open_with(request, None)
    }

    /// [`OpenRequest::open`] with the request's timeline laid out already, see [`crate::request::Timeline::load`].
    ///
    /// # Errors
    /// Those of [`OpenRequest::open`].
    pub fn open_with(request: &Request, layout: Option<TimelineLayout>) -> Result<OpenRequest> {
        if request.goal_guidance.is_some() && request.prompt.is_none() {
            let why = "goals are given frames after a gap, and there is no prompt or timeline";
            return Err(Error::unsupported("`goal_guidance`", why));
        }
        let edit = request.prompt.as_ref().and_then(|prompt| prompt.edit.as_ref());
        if edit.is_some() && request.uncoded_joints.is_some() {
            let why = "in an edited clip the uncoded joints are the clip's; leave it out";
            return Err(Error::unsupported("`uncoded_joints`", why));
        }
        if request.uncoded_joints == Some(UncodedJoints::Follow) && !request.is_given() {
            let why = "nothing of a prompt is given, so there is nothing to follow; leave it out";
            return Err(Error::unsupported("`uncoded_joints` follow", why));
        }
        let mut open = OpenRequest::load_with(request.with_defaults(), CheckpointChoice::Auto, layout)?;
        if request.rig.is_none() {
            let why = if edit.is_some() { "a clip is edited" } else { "no clip is edited" };
            open.decide("rig", name(open.resolved.rig), why);
        }
        if request.uncoded_joints.is_none() {
            let why = if request.is_given() { "part of the prompt is given" } else { "nothing of a prompt is given" };
            open.decide("uncoded_joints", name(open.resolved.uncoded_joints), why);
        }
        if request.length.is_none() {
            let why = "as long as what is given of the prompt, else the music, else the prompt";
            open.decide("length", open.frames.to_string(), why);
        }
        if request.fps.is_none() {
            open.decide_fps()?;
        }
        open.decide_placement();
        open.decide_lead_in(request.lead_in)?;
        open.decide_first_frames(request.first_frames)?;
        if open.is_masked() && request.passes.is_none() {
            open.resolved.passes = Some(PASSES);
            open.decide("passes", PASSES.to_string(), "the model is masked");
        }
        if !request.sampling.truncates() {
            let goals = request.goal_guidance != Some(0.0) && open.has_goals();
            open.decide_truncation(goals);
        }
        if request.goal_guidance.is_none() {
            open.decide_goal_guidance();
        }
        if request.guidance.is_none() {
            open.decide_guidance();
        }
        if request.feet.is_none() {
            open.decide_feet();
        }
        Ok(open)
    }

    fn decide(&mut self, option: &'static str, value: String, why: &'static str) {
        self.decisions.push(Decision { option, value, why });
    }

    /// The dance has the rate of its prompt.
    fn decide_fps(&mut self) -> Result<()> {
        let prompt = self.prompt.as_ref().map(|prompt| prompt.clip.motion.clip.fps());
        self.resolved.fps = prompt.unwrap_or(FPS);
        let why = if prompt.is_some() { "the prompt's rate" } else { "there is no prompt" };
        self.decide("fps", self.resolved.fps.to_string(), why);
        self.check_written()
    }

    /// The dance stands where its prompt does, if something of one is given that isn't edited.
    fn decide_placement(&mut self) {
        let prompt = self.prompt.as_ref().filter(|prompt| prompt.edit.is_none() && !prompt.lends());
        self.resolved.placement = prompt.and_then(|prompt| Placement::of(&prompt.clip.clip));
    }

    /// What an unprompted dance continues from.
    fn decide_lead_in(&mut self, kind: Option<LeadInKind>) -> Result<()> {
        let is_unprompted = self.is_unprompted();
        if kind.is_some() && !is_unprompted {
            let why = "part of the first frame is given, and the dance continues from that; leave it out";
            return Err(Error::unsupported("`lead_in`", why));
        }
        self.add_lead_in(kind != Some(LeadInKind::None))?;
        if !is_unprompted || self.lead_in(0).is_some() || kind == Some(LeadInKind::None) {
            if is_unprompted && kind.is_none() {
                self.decide("lead_in", "train".into(), "the run stores seconds of train clips");
            }
            return Ok(());
        }
        let why =
            "the run stores no second of a train clip, as where it was trained elsewhere or all clips are shorter";
        if kind.is_some() {
            return Err(Error::unsupported("`lead_in` train", format!("{why}; leave it out")));
        }
        let run = self.resolved.run.display();
        self.run.notes.push(format!("{run}: {why}: the dance continues from one that the model samples"));
        self.decide("lead_in", "none".into(), "the run stores no second of a train clip");
        Ok(())
    }

    /// How many candidates the first frame is chosen among.
    fn decide_first_frames(&mut self, requested: Option<usize>) -> Result<()> {
        match requested {
            None => {
                let chooses = self.begins_in_part() && self.tries() == 1;
                self.resolved.first_frames = if chooses { FIRST_FRAMES } else { 1 };
                let why = match chooses {
                    true => "joints of the first frame are given after free ones",
                    false => "nothing to choose by",
                };
                self.decide("first_frames", self.resolved.first_frames.to_string(), why);
                Ok(())
            }
            Some(n) if n > 1 && !self.begins_in_part() => {
                let why = "there is nothing to choose a first frame by; expected joints that are given in it after free ones \
                           (right_arm, not root), no frames to continue from, a causal model, and no greedy sampling";
                Err(Error::unsupported(Subject::of_parameter("first_frames").with(n), why))
            }
            Some(_) => Ok(()),
        }
    }

    /// `goals`: whether goals are conditioned on.
    fn decide_truncation(&mut self, goals: bool) {
        let mut why = "the model's own distribution without its rare tail";
        if self.is_given_throughout() {
            self.resolved.sampling.top_p = Some(GIVEN_TOP_P);
            why = "joints are given from end to end";
        } else if goals {
            self.resolved.sampling.top_p = Some(GAP_TOP_P);
            why = "the model is goal-conditioned and a gap ends";
        }
        self.decide("top_p", self.resolved.sampling.top_p.unwrap_or(1.0).to_string(), why);
    }

    fn decide_goal_guidance(&mut self) {
        let has_goals = self.has_goals();
        self.resolved.goal_guidance = if has_goals { GOAL_GUIDANCE } else { 0.0 };
        let why = match has_goals {
            true => "the model is goal-conditioned and a gap ends",
            false => "no gap ends, or the model isn't goal-conditioned",
        };
        self.decide("goal_guidance", self.resolved.goal_guidance.to_string(), why);
    }

    fn decide_guidance(&mut self) {
        let mut why = "no music: labels count as trained";
        if self.music.is_some() {
            self.resolved.guidance = music_guidance(self.run.config.music);
            self.unconditioned = self.unconditioned.take().filter(|_| self.resolved.guidance != 1.0);
            why = "what suits the model's music conditioning";
        }
        self.decide("guidance", self.resolved.guidance.to_string(), why);
    }

    fn decide_feet(&mut self) {
        let given = self.prompt.as_ref().and_then(|prompt| prompt.selection.as_ref());
        let has_leg = given.is_some_and(|given| LEGS.iter().flatten().any(|joint| given.joints.contains(joint)));
        self.resolved.feet = if has_leg { FootMode::Off } else { FootMode::Lock };
        self.decide("feet", name(self.resolved.feet), if has_leg { "a leg is given" } else { "no leg is given" });
    }
}

/// The name of an option's value in files.
fn name(value: impl Serialize) -> String {
    let value = serde_json::to_value(value).expect("an enum without data is a string in JSON");
    value.as_str().unwrap_or_default().to_owned()
}

impl Request {
    /// Whether something of a prompt is given.
    fn is_given(&self) -> bool {
        self.prompt.as_ref().is_some_and(|prompt| !prompt.lends())
    }

    /// The request with the defaults that need no open model.
    fn with_defaults(&self) -> Resolved {
        let is_edited = self.prompt.as_ref().is_some_and(|prompt| prompt.edit.is_some());
        let uncoded = if self.is_given() { UncodedJoints::Follow } else { UncodedJoints::Training };
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
            guidance: self.guidance.unwrap_or(if self.music.is_some() { MUSIC_GUIDANCE } else { 1.0 }),
            goal_guidance: self.goal_guidance.unwrap_or(0.0),
            music: self.music.clone(),
            frames,
            seconds,
            fps: self.fps.unwrap_or(FPS),
            lead_in: 0,
            lead_in_from: None,
            first_frames: self.first_frames.unwrap_or(1),
            passes: self.passes,
            seed: self.seed,
            seeding: self.seeding,
            sampling: self.sampling.truncated(),
            rig: self.rig.unwrap_or(if is_edited { Rig::Prompt } else { Rig::Model }),
            uncoded_joints: self.uncoded_joints.unwrap_or(uncoded),
            placement: None,
            feet: self.feet.unwrap_or(FootMode::Off),
            computing: self.computing.clone(),
        }
    }
}
