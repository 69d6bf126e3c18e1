//! The inputs that a request names, read and checked.

use super::conditions::add_tempo;
use super::labels::fronts;
use super::{MOST_CANDIDATES, OpenMusic, OpenWay, PreparedPrompt};
use crate::edit::PreparedEdit;
use crate::request::{Length, Request, Resolved, Rig};
use crate::sampler::check_frames;
use crate::timeline::TimelineLayout;
use crate::{Error, Result};
use kinelm_corpus::Conditions;
use kinelm_model::{LoadedRun, load_run};
use kinelm_motion::moment::Timebase;
use kinelm_motion::resample::check_fps;
use kinelm_store::Subject;
use kinelm_tokenizer::Tokenizer;

/// The most ways through a gap that are sampled side by side.
const MOST_TRIES: usize = 64;

/// Refuses what needs no file to be found wrong.
fn check(request: &Request) -> Result<()> {
    request.sampling.validate()?;
    let (prompt, music) = (request.prompt.as_ref(), request.music.as_ref());
    let mut paths = [Some(&request.run), prompt.map(|p| &p.path), music.map(|m| &m.path)].into_iter().flatten();
    if let Some(path) = paths.find(|path| path.to_str().is_none()) {
        let found = format!("{}, which is no UTF-8", path.display());
        return Err(Error::invalid(
            Subject::about("a path of the `request`", "request"),
            found,
            "a name that the sidecar can store",
        ));
    }
    match request.length {
        Some(Length::Seconds(s)) if !(s.is_finite() && s > 0.0) => {
            return Err(Error::invalid_parameter("seconds", s, "a number above 0"));
        }
        Some(Length::Frames(0)) => return Err(Error::invalid_parameter("frames", 0, "1 or more")),
        _ => {}
    }
    request.fps.map_or(Ok(()), check_fps)?;
    if let Some(prompt) = prompt.filter(|prompt| prompt.lends() && request.rig != Some(Rig::Prompt)) {
        let what = format!("given part of the prompt {}", prompt.path.display());
        let help = "give joints, a frame to continue from, or both; or `rig` prompt, for a new dance on its rig";
        return Err(Error::missing(what, help));
    }
    Ok(())
}

/// The inputs that a request names, read.
pub(super) struct Inputs {
    pub run: LoadedRun,
    pub tokenizer: Tokenizer,
    pub conditions: Conditions,
    pub prompt: Option<PreparedPrompt>,
    pub way: Option<OpenWay>,
    pub music: Option<OpenMusic>,
    /// F, frames of the dance at the model's rate.
    pub frames: usize,
    /// The fronts of windows, each with its first frame.
    pub fronts: Vec<(usize, Vec<u32>)>,
}

impl Inputs {
    /// Reads all of it, and writes into the request what was found: joints in SMPL's names, floor and up axis of the prompt,
    /// the tempo of the music. `layout`: of a timeline that is laid out already.
    pub fn read(request: &mut Request, layout: Option<TimelineLayout>) -> Result<Inputs> {
        check(request)?;
        let run = load_run(&request.run, request.checkpoint)?;
        let tokenizer = run.load_tokenizer()?;
        let fps = tokenizer.fps();
        let music = request.music.as_ref().map(|music| OpenMusic::open(music, &run, fps)).transpose()?;
        let conditions = run.load_conditions()?;
        let requested = request.length.map(|length| match length {
            Length::Frames(frames) => frames,
            Length::Seconds(seconds) => (seconds * fps).round().max(1.0) as usize,
        });
        // before the prompt is read, so that a length of years costs no time
        check_frames(requested.unwrap_or(0))?;
        let from = request.prompt.as_ref().and_then(|prompt| prompt.from_frame);
        let prompt = request.prompt.as_mut();
        let prompt = prompt.map(|prompt| PreparedPrompt::load(prompt, layout, requested, &tokenizer)).transpose()?;
        let way =
            request.path.as_ref().map(|path| OpenWay::open(path, request, prompt.as_ref(), &tokenizer)).transpose()?;
        let of_way = way.as_ref().map(|way| way.clip.frames());
        let frames = requested.or(of_way).or_else(|| frames_of(prompt.as_ref(), music.as_ref(), fps));
        let help =
            "give a number of seconds or frames (`seconds`, `frames`), or a prompt, a path or music that has a length";
        let frames = frames.ok_or_else(|| Error::missing("length of the dance", help))?;
        check_frames(frames)?;
        let seconds = frames as f64 / fps;
        if let Some(music) = &music {
            add_tempo(request, music.tempo(&conditions, seconds), &run, &conditions)?;
        }
        let of_edit = prompt.as_ref().and_then(|p| p.edit.as_ref()).map(|edit| edit.frames);
        let scale = Timebase { frames: of_edit.unwrap_or(frames), fps, left_out: 0, model_fps: Some(fps) };
        let fronts = fronts(&conditions, &request.labels, &request.timed_labels, scale)?;
        if let Some(from) = from.filter(|from| *from >= frames) {
            let expected = format!("a frame before {frames}, the end of the dance: nothing is left to generate");
            return Err(Error::invalid_parameter("from_frame", from, expected));
        }
        music.as_ref().map_or(Ok(()), |music| music.check(seconds))?;
        Ok(Inputs { run, tokenizer, conditions, prompt, way, music, frames, fronts })
    }
}

/// Refuses more candidates than can be sampled side by side.
pub(super) fn check_candidates(request: &Resolved) -> Result<()> {
    let tries = request.prompt.as_ref().and_then(|prompt| prompt.edit.as_ref()?.tries).unwrap_or(1);
    for (name, n, most) in [
        ("first_frames", request.first_frames, u8::MAX.into()),
        ("tries", tries, MOST_TRIES),
        ("look_ahead", request.look_ahead, MOST_CANDIDATES),
    ] {
        if n > most {
            return Err(Error::invalid_parameter(name, n, format!("{most} at most")));
        }
    }
    Ok(())
}

/// The length of a dance whose request has none: as much as is given of the prompt, else the music, else the prompt, unless it
/// is a single pose, which lends its rig alone.
fn frames_of(prompt: Option<&PreparedPrompt>, music: Option<&OpenMusic>, fps: f64) -> Option<usize> {
    let of_prompt = |p: &PreparedPrompt| p.edit.as_ref().map_or(p.clip.frames(), PreparedEdit::known);
    let is_given = |p: &&PreparedPrompt| p.edit.is_some() || !p.given.is_empty();
    // 1e-6: seconds that are whole frames may come out just below one
    let of_music = music.map(|music| (music.seconds() * fps + 1e-6).floor().max(1.0) as usize);
    let moves = |p: &&PreparedPrompt| p.clip.motion.clip.frames() > 1;
    prompt.filter(is_given).map(of_prompt).or(of_music).or(prompt.filter(moves).map(of_prompt))
}
