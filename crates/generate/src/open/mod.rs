//! Requests opened and resolved: the model, the prompt and the music are read, every option is decided, and dances can be
//! sampled.

mod conditions;
mod defaults;
mod inputs;
mod labels;
mod lead_in;
mod look_ahead;
mod music;
mod prompt;
mod sample;
mod seeding;
mod way;

pub use conditions::{check_goal_guidance, check_passes};
pub use defaults::{
    FEATURE_GUIDANCE, FPS, GAP_TOP_P, GIVEN_TOP_P, GOAL_GUIDANCE, LABEL_GUIDANCE, MUSIC_GUIDANCE, SEED,
};
pub use look_ahead::MOST_CANDIDATES;
pub use music::OpenMusic;
pub use prompt::PreparedPrompt;
pub use way::OpenWay;

use crate::edit::PreparedEdit;
use crate::request::{PromptRequest, Request, Resolved, Rig};
use crate::sampler::check_frames;
use crate::score::Limits;
use crate::timeline::TimelineLayout;
use crate::{Error, Result};
use defaults::NO_LEAD_IN;
use inputs::{Inputs, check_candidates};
use kinelm_corpus::Conditions;
use kinelm_model::lead_in::LeadIns;
use kinelm_model::{CheckpointChoice, LoadedRun, ModelKind};
use kinelm_motion::resample::held_frames;
use kinelm_tokenizer::Tokenizer;

/// A request with everything that it names, read.
pub struct OpenRequest {
    /// The request, resolved: running it again gives the same dance.
    pub resolved: Resolved,
    /// The model.
    pub run: LoadedRun,
    /// Its tokenizer.
    pub tokenizer: Tokenizer,
    /// The prompt.
    pub prompt: Option<PreparedPrompt>,
    /// The path that the dance is led along.
    pub way: Option<OpenWay>,
    /// The music.
    pub music: Option<OpenMusic>,
    /// F, frames of the dance at the model's rate.
    pub frames: usize,
    /// The model's labels.
    conditions: Conditions,
    /// The fronts of windows, `<bos>` and the labels, each with its first frame.
    fronts: Vec<(usize, Vec<u32>)>,
    /// The same with every label unknown, where the dance is guided.
    unconditioned: Option<Vec<u32>>,
    /// The run's lead-ins, where the dance continues from one.
    lead_ins: Option<LeadIns>,
    /// What blocks are chosen by, where the dance is looked ahead.
    limits: Option<Limits>,
}

impl OpenRequest {
    /// Opens the model that a request names, reads prompt and music, and decides every option that the request leaves open:
    /// [`OpenRequest::resolved`] holds them.
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
        let mut request = defaults::without_inputs(request)?;
        let inputs = Inputs::read(&mut request, layout)?;
        let leaves_lead_in = request.lead_in.is_none();
        let (resolved, lead_ins) = defaults::decide(request, &inputs)?;
        let mut open = OpenRequest::of(resolved, inputs, lead_ins)?;
        if leaves_lead_in && open.resolved.lead_in > 0 && open.resolved.lead_in_from.is_none() {
            let run = open.resolved.run.display();
            let note = format!("{run}: {NO_LEAD_IN}: the dance continues from one that the model samples");
            open.run.notes.push(note);
        }
        Ok(open)
    }

    /// Reads what a resolved request names; of the run's checkpoints the one that `which` selects.
    ///
    /// # Errors
    /// Errors of reading the run, the prompt and the music; options outside their ranges; passes of a causal model, or
    /// none of a masked one; labels that the model doesn't know; guidance without labels or music; goal guidance of a model
    /// without goals; music for a model that isn't conditioned on any, or that ends too soon; joints that aren't coded; a
    /// prompt of which nothing is given, or that is too short to continue from; no length; more frames than memory holds;
    /// nothing to generate.
    pub fn load(resolved: Resolved, which: CheckpointChoice) -> Result<OpenRequest> {
        let mut request = Request { checkpoint: which, ..resolved.request() };
        let inputs = Inputs::read(&mut request, None)?;
        let resolved = Resolved { prompt: request.prompt, labels: request.labels, ..resolved };
        let lead_ins = resolved.lead_in_from.as_ref();
        let lead_ins = lead_ins.map(|from| lead_in::with(from, &resolved, &inputs.tokenizer)).transpose()?;
        OpenRequest::of(resolved, inputs, lead_ins)
    }

    fn of(resolved: Resolved, inputs: Inputs, lead_ins: Option<LeadIns>) -> Result<OpenRequest> {
        let Inputs { mut run, tokenizer, conditions, prompt, way, music, frames, fronts } = inputs;
        check_goal_guidance(resolved.goal_guidance, &run)?;
        check_passes(resolved.passes, &run)?;
        if run.config.kind == ModelKind::Masked && resolved.passes.is_none() {
            return Err(Error::missing("`passes`", "the model is masked: say how many times it reads a window"));
        }
        if run.config.kind == ModelKind::Masked && way.is_some() {
            let why = "a masked model fills whole windows and can't be led step by step; give a clip's path (`joints`)";
            return Err(Error::unsupported("a drawn path", why));
        }
        check_frames(resolved.lead_in)?;
        check_candidates(&resolved)?;
        let limits = (resolved.look_ahead > 1).then(|| Limits::load(&resolved.run)).transpose()?;
        let unconditioned = conditions::unconditioned(&resolved, &run, &conditions)?;
        if run.label_dropout == Some(0.0) && (unconditioned.is_some() || resolved.labels.len() < run.conditions.len()) {
            let what = "labels were never hidden in training (train.label_dropout = 0), so the model has never seen a dance \
                        without some of them, and guidance needs that";
            run.notes.push(what.into());
        }
        let open = OpenRequest {
            resolved,
            run,
            tokenizer,
            prompt,
            way,
            music,
            frames,
            conditions,
            fronts,
            unconditioned,
            lead_ins,
            limits,
        };
        // more frames at the rate of the file than a dance may have
        if let Some(fps) = open.resampled_fps() {
            check_frames(held_frames(frames, open.tokenizer.fps(), fps))?;
        }
        Ok(open)
    }

    /// The rate that the dance is resampled to; `None` for an edited clip at its own, whose numbers stay.
    pub(crate) fn resampled_fps(&self) -> Option<f64> {
        let own =
            self.edit().filter(|_| self.resolved.rig == Rig::Prompt).map(|(prompt, _)| prompt.clip.motion.clip.fps());
        Some(self.resolved.fps).filter(|fps| own != Some(*fps))
    }

    /// Whether the model is masked.
    pub(crate) fn is_masked(&self) -> bool {
        self.run.config.kind == ModelKind::Masked
    }

    /// The tokens in front of a window that begins at a frame.
    pub(crate) fn front_at(&self, frame: usize) -> &[u32] {
        let last = self.fronts.iter().rev().find(|(from, _)| *from <= frame);
        last.map_or(&[], |(_, front)| front)
    }

    /// The prompt that is edited, and its edit.
    pub(crate) fn edit(&self) -> Option<(&PreparedPrompt, &PreparedEdit)> {
        let prompt = self.prompt.as_ref()?;
        Some((prompt, prompt.edit.as_ref()?))
    }

    /// The prompt on whose own rig the dance is written.
    pub(crate) fn on_own_rig(&self) -> Option<(&PreparedPrompt, &PromptRequest)> {
        let prompt = self.prompt.as_ref().zip(self.resolved.prompt.as_ref());
        prompt.filter(|_| self.resolved.rig == Rig::Prompt)
    }
}
