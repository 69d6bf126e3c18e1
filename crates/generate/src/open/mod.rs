//! Requests opened and resolved: the model, the prompt and the music are read, every option is decided, and dances can be
//! sampled.

mod conditions;
mod labels;
mod lead_in;
mod music;
mod prompt;
mod resolve;
mod sample;
mod seeding;
mod truncation;

pub use conditions::check_goal_guidance;
pub use music::{MUSIC_GUIDANCE, OpenMusic, music_guidance};
pub use prompt::PreparedPrompt;
pub use resolve::{Decision, FPS, GOAL_GUIDANCE};
pub use truncation::{GAP_TOP_P, GIVEN_TOP_P};

use crate::edit::PreparedEdit;
use crate::masked::MOST_PASSES;
use crate::request::{PromptRequest, Resolved, Rig};
use crate::sampler::check_frames;
use crate::timeline::TimelineLayout;
use crate::{Error, Result};
use conditions::{add_tempo, unconditioned};
use kinelm_corpus::Conditions;
use kinelm_model::checkpoint::Checkpoints;
use kinelm_model::lead_in::LeadIns;
use kinelm_model::{CheckpointChoice, LoadedRun, ModelKind, load_run};
use kinelm_motion::moment::Timebase;
use kinelm_motion::resample::{check_fps, held_frames};
use kinelm_store::Subject;
use kinelm_tokenizer::Tokenizer;
use std::path::Path;

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
    /// The music.
    pub music: Option<OpenMusic>,
    /// F, frames of the dance at the model's rate.
    pub frames: usize,
    /// What the request left open; nothing for a resolved one.
    pub decisions: Vec<Decision>,
    /// The tokens in front of windows, `<bos>` and the labels, each with the frame from which on they stand there.
    fronts: Vec<(usize, Vec<u32>)>,
    /// The same with every label unknown, where the dance is guided.
    unconditioned: Option<Vec<u32>>,
    /// The run's lead-ins, where the dance continues from one.
    lead_ins: Option<(LeadIns, Conditions)>,
}

/// The most ways through a gap that are sampled side by side.
const MOST_TRIES: usize = 64;

impl OpenRequest {
    /// Reads what a resolved request names; of the run's checkpoints the one that `which` selects.
    ///
    /// # Errors
    /// What reading the run, the prompt and the music fails with; options outside their ranges; passes of a causal model, or
    /// none of a masked one; labels that the model doesn't know; guidance without labels or music; goal guidance of a model without goals; music
    /// for a model that isn't conditioned on any, or that ends too soon; joints that aren't coded; a prompt of which nothing
    /// is given, or that is too short to continue from; no length; more frames than memory holds; nothing to generate.
    pub fn load(resolved: Resolved, which: CheckpointChoice) -> Result<OpenRequest> {
        let open = OpenRequest::load_with(resolved, which, None)?;
        if open.is_masked() && open.resolved.passes.is_none() {
            return Err(Error::missing("`passes`", "the model is masked: say how many times it reads a window"));
        }
        Ok(open)
    }

    /// [`OpenRequest::load`] with the request's timeline laid out already.
    fn load_with(
        mut resolved: Resolved,
        which: CheckpointChoice,
        layout: Option<TimelineLayout>,
    ) -> Result<OpenRequest> {
        resolved.sampling.validate()?;
        check_names(&resolved)?;
        check_length(&resolved)?;
        check_given(&resolved)?;
        if let CheckpointChoice::Step(step) = which {
            check_step(&resolved.run, step)?;
        }
        let mut run = load_run(&resolved.run, which)?;
        let tokenizer = run.load_tokenizer()?;
        let fps = tokenizer.fps();
        check_goal_guidance(resolved.goal_guidance, &run)?;
        check_passes(resolved.passes, &run)?;
        let music = resolved.music.as_ref().map(|music| OpenMusic::open(music, &run, fps)).transpose()?;
        let conditions = run.load_conditions()?;
        let unconditioned = unconditioned(&resolved, &run, &conditions)?;
        let of_seconds = resolved.seconds.map(|s| (s * fps).round().max(1.0) as usize);
        let requested = resolved.frames.or(of_seconds);
        [requested.unwrap_or(0), resolved.lead_in].into_iter().try_for_each(check_frames)?;
        check_candidates(&resolved)?;
        let prompt = resolved.prompt.as_mut();
        let prompt = prompt.map(|prompt| PreparedPrompt::load(prompt, layout, requested, &tokenizer)).transpose()?;
        let frames = requested.or_else(|| frames_of(prompt.as_ref(), music.as_ref(), fps));
        let help = "give a number of frames or seconds, or a prompt or music that has a length";
        let frames = frames.ok_or_else(|| Error::missing("length of the dance", help))?;
        check_frames(frames)?;
        if let Some(music) = &music {
            add_tempo(&mut resolved, music, (&run, &conditions), frames as f64 / fps)?;
        }
        if run.label_dropout == Some(0.0) && (unconditioned.is_some() || resolved.labels.len() < run.conditions.len()) {
            let what = "labels were never hidden in training (train.label_dropout = 0), so the model has never seen a dance \
                        without some of them, and guidance needs that";
            run.notes.push(what.into());
        }
        let of_edit = prompt.as_ref().and_then(|p| p.edit.as_ref()).map(|edit| edit.frames);
        let scale = Timebase { frames: of_edit.unwrap_or(frames), fps, left_out: 0, model_fps: Some(fps) };
        let fronts = labels::fronts(&conditions, &resolved.labels, &resolved.timed_labels, scale)?;
        let from = resolved.prompt.as_ref().and_then(|p| p.from_frame);
        if let Some(from) = from.filter(|from| *from >= frames) {
            let expected = format!("a frame before {frames}, the end of the dance: nothing is left to generate");
            return Err(Error::invalid("`from_frame`", from, expected));
        }
        if let Some(music) = &music {
            music.check(frames as f64 / fps)?;
        }
        let lead_ins = match &resolved.lead_in_from {
            Some(from) => Some((lead_in::with(from, &resolved, &tokenizer)?, conditions)),
            None => None,
        };
        let decisions = Vec::new();
        let open =
            OpenRequest { resolved, run, tokenizer, prompt, music, frames, decisions, fronts, unconditioned, lead_ins };
        open.check_written()?;
        Ok(open)
    }

    /// Refuses more frames at the rate of the file than a dance may have.
    fn check_written(&self) -> Result<()> {
        match self.resampled_fps() {
            Some(fps) => check_frames(held_frames(self.frames, self.tokenizer.fps(), fps)),
            None => Ok(()),
        }
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
    pub fn on_own_rig(&self) -> Option<(&PreparedPrompt, &PromptRequest)> {
        let prompt = self.prompt.as_ref().zip(self.resolved.prompt.as_ref());
        prompt.filter(|_| self.resolved.rig == Rig::Prompt)
    }
}

/// Refuses paths that JSON can't hold.
fn check_names(request: &Resolved) -> Result<()> {
    let (prompt, music) = (request.prompt.as_ref().map(|p| &p.path), request.music.as_ref().map(|m| &m.path));
    match [Some(&request.run), prompt, music].into_iter().flatten().find(|path| path.to_str().is_none()) {
        Some(path) => {
            let found = format!("{}, which is no UTF-8", path.display());
            Err(Error::invalid("a path of the `request`", found, "a name that the sidecar can store"))
        }
        None => Ok(()),
    }
}

/// Refuses passes of a causal model, none, and more than [`MOST_PASSES`].
///
/// # Errors
/// [`kinelm_store::Error::Unsupported`] and [`kinelm_store::Error::Invalid`].
pub fn check_passes(passes: Option<usize>, run: &LoadedRun) -> Result<()> {
    let Some(passes) = passes else { return Ok(()) };
    if run.config.kind != ModelKind::Masked {
        let why = "a causal model reads its tokens once; leave it out, or take a masked model";
        return Err(Error::unsupported(Subject::of_parameter("passes").with(passes), why));
    }
    match (1..=MOST_PASSES).contains(&passes) {
        true => Ok(()),
        false => Err(Error::invalid("`passes`", passes, format!("1 to {MOST_PASSES}"))),
    }
}

/// Refuses lengths below one frame, and rates that no file has.
fn check_length(request: &Resolved) -> Result<()> {
    if let Some(seconds) = request.seconds.filter(|s| !(s.is_finite() && *s > 0.0)) {
        return Err(Error::invalid("`seconds`", seconds, "a number above 0"));
    }
    if request.frames == Some(0) {
        return Err(Error::invalid("`frames`", 0, "1 or more"));
    }
    Ok(check_fps(request.fps)?)
}

/// Refuses a prompt that is for nothing.
fn check_given(request: &Resolved) -> Result<()> {
    match request.prompt.as_ref().filter(|prompt| prompt.lends() && request.rig != Rig::Prompt) {
        Some(prompt) => {
            let what = format!("given part of the prompt {}", prompt.path.display());
            let help = "give joints, a frame to continue from, or both; or `rig` prompt, for a new dance on its rig";
            Err(Error::missing(what, help))
        }
        None => Ok(()),
    }
}

/// Refuses more candidates than can be sampled side by side.
fn check_candidates(request: &Resolved) -> Result<()> {
    let tries = request.prompt.as_ref().and_then(|prompt| prompt.edit.as_ref()).map_or(1, |edit| edit.tries);
    for (name, n, most) in [("`first_frames`", request.first_frames, u8::MAX.into()), ("`tries`", tries, MOST_TRIES)] {
        if n > most {
            return Err(Error::invalid(name, n, format!("{most} at most")));
        }
    }
    Ok(())
}

/// The length of a dance whose request has none: as much as is given of the prompt, else the music, else the prompt.
fn frames_of(prompt: Option<&PreparedPrompt>, music: Option<&OpenMusic>, fps: f64) -> Option<usize> {
    let of_prompt = |p: &PreparedPrompt| p.edit.as_ref().map_or(p.clip.frames(), PreparedEdit::known);
    let is_given = |p: &&PreparedPrompt| p.edit.is_some() || !p.given.is_empty();
    let of_music = music.map(|music| (music.seconds() * fps + 1e-6).floor().max(1.0) as usize);
    prompt.filter(is_given).map(of_prompt).or(of_music).or(prompt.map(of_prompt))
}

/// Refuses a checkpoint that a run no longer has.
fn check_step(run: &Path, step: u64) -> Result<()> {
    let steps = Checkpoints::of(run).steps()?;
    if steps.is_empty() || steps.contains(&step) {
        return Ok(()); // without any, reading the run names the fault
    }
    let listed = steps.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
    let found = format!("no checkpoint of step {step}, but those of {listed}");
    let help =
        "a run keeps the best checkpoint and the last train.keep: train with a greater keep, or sample a new dance";
    Err(Error::file(run, found, "the one that the dance is of", help))
}
