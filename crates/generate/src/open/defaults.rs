//! Every option that a request leaves open is decided here, and only here.
//!
//! [`without_inputs`] decides what reading the inputs needs, [`decide`] all else, once they are read. Constants of single
//! rooms are defined there: [`default_top_p`], [`FIRST_FRAMES`], [`PASSES`], [`crate::sampler::GUESSES`].

use super::inputs::Inputs;
use super::prompt::PreparedPrompt;
use crate::masked::PASSES;
use crate::request::{Edit, FootMode, LeadInKind, Loop, Placement, Request, Resolved, Rig, Seeding, UncodedJoints};
use crate::sampler::FIRST_FRAMES;
use crate::sampling::default_top_p;
use crate::{Error, Result};
use kinelm_model::ModelKind;
use kinelm_model::lead_in::{self, LeadInFrom, LeadIns};
use kinelm_model::music::Music;
use kinelm_motion::joints::LEGS;
use kinelm_store::Subject;

/// The seed of the random streams.
pub const SEED: u64 = 1;

/// Frames per second of a dance without a prompt.
pub const FPS: f64 = 30.0;

/// Scale of guidance towards goals, by a goal-conditioned model where a gap ends.
pub const GOAL_GUIDANCE: f64 = 1.5;

/// The guidance scale of a model conditioned on beats: at 1 the music is followed little (docs/results/music.md).
pub const MUSIC_GUIDANCE: f64 = 3.0;

/// The same of a model conditioned on sound features: at higher scales some dances fly apart.
pub const FEATURE_GUIDANCE: f64 = 2.0;

/// The same under labels, without music, by a model that has seen dances without some of them: at 1 a dance forgets a genre
/// that has few training clips (docs/results/two-level.md, "Labels").
pub const LABEL_GUIDANCE: f64 = 2.0;

/// [`crate::sampling::Sampling::top_p`] of a dance all of whose frames have joints given after free ones. These keep
/// such a dance going, and less chance leaves less to go wrong; a dance by itself would freeze sooner
/// (docs/results/two-level.md, "Truncation").
pub const GIVEN_TOP_P: f64 = 0.8;

/// [`crate::sampling::Sampling::top_p`] of other gaps that end, by a goal-conditioned model: what is given on both sides keeps
/// the dance going, and likelier samples end nearer and jerk less (docs/results/gaps.md).
pub const GAP_TOP_P: f64 = 0.7;

/// The request with the options of its edit decided, by which the prompt is read. Refuses options that others rule out.
pub(super) fn without_inputs(request: &Request) -> Result<Request> {
    if request.goal_guidance.is_some() && request.prompt.is_none() {
        let why = "goals are given frames after a gap, and there is no prompt or timeline";
        return Err(Error::unsupported_parameter("goal_guidance", why));
    }
    let edit = request.prompt.as_ref().and_then(|prompt| prompt.edit.as_ref());
    if edit.is_some() && request.uncoded_joints.is_some() {
        let why = "in an edited clip the uncoded joints are the clip's; leave it out";
        return Err(Error::unsupported_parameter("uncoded_joints", why));
    }
    let is_given = request.prompt.as_ref().is_some_and(|prompt| !prompt.lends());
    if request.uncoded_joints == Some(UncodedJoints::Follow) && !is_given {
        let why = "nothing of a prompt is given, so there is nothing to follow; leave it out";
        return Err(Error::unsupported(Subject::of_parameter("uncoded_joints").with("follow"), why));
    }
    let mut request = request.clone();
    if let Some(edit) = request.prompt.as_mut().and_then(|prompt| prompt.edit.as_mut()) {
        edit.blend_s.get_or_insert(Edit::BLEND_S);
        edit.tries.get_or_insert(Edit::TRIES.into());
        edit.looping.as_mut().map(|looping| looping.over_s.get_or_insert(Loop::OVER_S));
    }
    Ok(request)
}

/// The request with every option decided, and the lead-ins that its dances continue from.
pub(super) fn decide(request: Request, inputs: &Inputs) -> Result<(Resolved, Option<LeadIns>)> {
    let (run, prompt) = (&inputs.run, inputs.prompt.as_ref());
    let is_edited = prompt.is_some_and(|prompt| prompt.edit.is_some());
    let is_given = prompt.is_some_and(|prompt| !prompt.lends());
    let is_masked = run.config.kind == ModelKind::Masked;
    let is_unprompted = prompt.is_none_or(PreparedPrompt::begins_free);
    // the model knows the ends of gaps, and there are some
    let has_goals = run.config.goal && prompt.is_some_and(PreparedPrompt::has_ends);
    let goal_guidance = request.goal_guidance.unwrap_or(if has_goals { GOAL_GUIDANCE } else { 0.0 });
    let has_labels = !(request.labels.is_empty() && request.timed_labels.is_empty());
    let guidance = request.guidance.unwrap_or(match has_labels && run.label_dropout.is_some_and(|share| share > 0.0) {
        _ if request.music.is_some() => music_guidance(run.config.music),
        true => LABEL_GUIDANCE,
        false => 1.0,
    });
    let sampling = request.sampling.truncated_at(match prompt {
        Some(prompt) if prompt.is_given_throughout(inputs.frames) => GIVEN_TOP_P,
        _ if has_goals && goal_guidance != 0.0 => GAP_TOP_P,
        _ => default_top_p(&run.config),
    });
    let seed = request.seed.unwrap_or(SEED);
    let lead_ins = lead_ins(&request, is_unprompted, inputs)?;
    let lead_in_from = lead_ins.as_ref().and_then(|all| lead_in_of(all, inputs, seed));
    if lead_in_from.is_none() && request.lead_in == Some(LeadInKind::Train) {
        return Err(Error::unsupported(
            Subject::of_parameter("lead_in").with("train"),
            format!("{NO_LEAD_IN}; leave it out"),
        ));
    }
    // joints of the first frame are given after free ones, and a causal model doesn't see them
    let begins_in_part = prompt.is_some_and(PreparedPrompt::begins_in_part) && !is_masked && !sampling.greedy;
    let chooses_dance = prompt.is_some_and(PreparedPrompt::has_ends)
        && request.prompt.as_ref().and_then(|prompt| prompt.edit.as_ref()?.tries).is_some_and(|tries| tries > 1);
    let first_frames = match request.first_frames {
        Some(n) if n > 1 && !begins_in_part => {
            let why = "there is nothing to choose a first frame by; expected joints that are given in it after free ones \
                       (right_arm, not root), no frames to continue from, a causal model, and no greedy sampling";
            return Err(Error::unsupported(Subject::of_parameter("first_frames").with(n), why));
        }
        Some(n) => n,
        None if begins_in_part && !chooses_dance => FIRST_FRAMES,
        None => 1,
    };
    // a leg that is given isn't moved
    let is_leg = |joint: &usize| LEGS.iter().flatten().any(|leg| leg == joint);
    let has_leg = prompt.and_then(|prompt| prompt.selection.as_ref()).is_some_and(|s| s.joints.iter().any(is_leg));
    let look_ahead = look_ahead(&request, is_masked || is_edited || sampling.greedy || has_leg)?;
    let resolved = Resolved {
        guidance,
        goal_guidance,
        frames: inputs.frames,
        fps: request.fps.or(prompt.map(|prompt| prompt.clip.motion.clip.fps())).unwrap_or(FPS),
        lead_in: if is_unprompted { lead_in::words(&inputs.tokenizer) * inputs.tokenizer.frames_per_word() } else { 0 },
        lead_in_from,
        first_frames,
        look_ahead,
        passes: request.passes.or(is_masked.then_some(PASSES)),
        seed,
        seeding: request.seeding.unwrap_or(Seeding::Inputs),
        sampling,
        rig: request.rig.unwrap_or(if is_edited { Rig::Prompt } else { Rig::Model }),
        uncoded_joints: match request.uncoded_joints {
            Some(uncoded) => uncoded,
            None if is_given => UncodedJoints::Follow,
            None => UncodedJoints::Training,
        },
        // a dance that a prompt gives part of begins at the prompt's place; an edit is at it anyway
        placement: prompt.filter(|_| is_given && !is_edited).and_then(|prompt| Placement::of(&prompt.clip.clip)),
        feet: request.feet.unwrap_or(if has_leg { FootMode::Off } else { FootMode::Lock }),
        computing: request.computing.unwrap_or_default(),
        run: request.run,
        prompt: request.prompt,
        path: request.path,
        labels: request.labels,
        timed_labels: request.timed_labels,
        music: request.music,
    };
    Ok((resolved, lead_ins))
}

/// Candidates for each block; `is_out`: where there is nothing to choose, or something else chooses.
fn look_ahead(request: &Request, is_out: bool) -> Result<usize> {
    match request.look_ahead {
        Some(n) if n > 1 && is_out => {
            let why = "nothing is chosen block by block in an edited clip (tries chooses there), where a leg is given, in \
                       greedy sampling, and by a masked model; leave it out";
            Err(Error::unsupported(Subject::of_parameter("look_ahead").with(n), why))
        }
        Some(0) => Err(Error::invalid_parameter("look_ahead", 0, "1 (no choice) or more")),
        Some(n) => Ok(n),
        None => Ok(1),
    }
}

/// The scale that suits a model's music conditioning; 1 where its tempo label is all it knows of music.
fn music_guidance(conditioning: Music) -> f64 {
    match conditioning {
        music if music.has_features() => FEATURE_GUIDANCE,
        music if music.has_beats() => MUSIC_GUIDANCE,
        _ => 1.0,
    }
}

/// The seconds of train clips that an unprompted dance may continue from, if it is to and the run stores some.
fn lead_ins(request: &Request, is_unprompted: bool, inputs: &Inputs) -> Result<Option<LeadIns>> {
    if request.lead_in.is_some() && !is_unprompted {
        let why = "part of the first frame is given, and the dance continues from that; leave it out";
        return Err(Error::unsupported_parameter("lead_in", why));
    }
    if !is_unprompted || request.lead_in == Some(LeadInKind::None) {
        return Ok(None);
    }
    LeadIns::load(&request.run, &inputs.tokenizer)
}

/// The one that the first dance continues from.
fn lead_in_of(all: &LeadIns, inputs: &Inputs, seed: u64) -> Option<LeadInFrom> {
    let front = inputs.fronts.first().map_or(&[][..], |(_, front)| front);
    all.choose(&inputs.conditions, front, seed).map(|lead_in| lead_in.from.clone())
}

/// Why a dance begins with a second that the model samples.
pub(super) const NO_LEAD_IN: &str =
    "the run stores no second of a train clip, as where it was trained elsewhere or all clips are shorter";
