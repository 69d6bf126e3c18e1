//! A resolved request carried out: the model and the prompt read, the dances drawn, and put on a rig.

use super::conditions::{check_ahead, tell_tempo, without};
use super::edit::close::LeftOver;
use super::edit::{Closed, Edited};
use super::followed::Followed;
use super::guidance::Guidance;
use super::music::Music;
use super::place::Led;
use super::request::{FootMode, Place, PromptRequest, Resolved, Rig};
use super::resolve::Decision;
use super::rest::{self, RestJoints};
use super::{GUESSES, SampledTokens, SamplingPlan, check_frames, dances, feet, labels, prompt, reader, variation_seed};
use crate::{Error, Result};
use kinelm_corpus::Conditions;
use kinelm_corpus::music::sound::Sound;
use kinelm_model::checkpoint::Checkpoints;
use kinelm_model::goal::{GoalEncoder, GoalTrack};
use kinelm_model::lead_in::{LeadIn, LeadInFrom, LeadIns};
use kinelm_model::{CheckpointChoice, LoadedRun, lead_in, load_run, music};
use kinelm_motion::feet::FootLock;
use kinelm_motion::format::{self, Format, ReadOptions, RestFrame, bvh::Changed};
use kinelm_motion::moment::Timebase;
use kinelm_motion::resample::{Method, held_frames, resample_held};
use kinelm_motion::{Clip, Motion, Source};
use kinelm_tokenizer::{Tokenizer, UncodedPose, Words};
use std::path::Path;
use std::sync::Arc;

/// All that a recipe names, read.
pub struct OpenRequest {
    /// The recipe.
    pub recipe: Resolved,
    /// The model.
    pub run: LoadedRun,
    /// Its tokenizer.
    pub tokenizer: Tokenizer,
    /// The clip that is followed.
    pub prompt: Option<Followed>,
    /// The music that is danced to.
    pub music: Option<Music>,
    /// Frames of the dance.
    pub frames: usize,
    /// What the request left open; none of a resolved one.
    pub decisions: Vec<Decision>,
    /// The tokens in front of windows, `<bos>` and the labels, each from a frame on; the first from 0.
    fronts: Vec<(usize, Vec<u32>)>,
    /// The same with every label unknown, where the dance is guided.
    without: Option<Vec<u32>>,
    /// What dances from nothing go on from, where this one does.
    lead_ins: Option<(LeadIns, Conditions)>,
}

/// A dance as it is written.
pub struct Generated {
    /// On its rig, at its rate.
    pub motion: Motion,
    /// What was done to its feet, gap by gap where a clip is edited; frames are [`Generated::locked_fps`] a second.
    pub locked: Vec<FootLock>,
    /// The rate at which feet were held.
    pub locked_fps: f64,
    /// Of an edited clip: what was left over at the ends of gaps, frames at the model's rate.
    pub left: Vec<LeftOver>,
    /// Of an edited clip on its own rig and at its own rate: what is new, and the bytes of its file.
    changed: Option<(Changed, Arc<[u8]>)>,
}

impl Generated {
    /// The bytes of a file of this name.
    ///
    /// # Errors
    /// Those of [`format::to_bytes`].
    pub fn bytes(&self, out: &Path) -> Result<Vec<u8>> {
        match (&self.motion.source, &self.changed) {
            (Source::Bvh(source), Some((changed, text))) if Format::of_name(out) == Some(Format::Bvh) => {
                Ok(source.spliced(text, &self.motion.clip, changed)?)
            }
            _ => Ok(format::to_bytes(out, &self.motion)?),
        }
    }
}

/// Ways through a gap that are drawn side by side, at most.
const MOST_TRIES: usize = 64;

/// How far gaps are led to what is given behind them, where nobody says.
pub const AHEAD: f64 = 2.0;

impl OpenRequest {
    /// The tokens in front of a window that begins at a frame.
    pub(super) fn front_at(&self, frame: usize) -> &[u32] {
        let last = self.fronts.iter().rev().find(|(from, _)| *from <= frame);
        last.map_or(&[], |(_, front)| front)
    }

    /// Reads what a recipe names; the checkpoint as [`load_run`] takes it.
    ///
    /// # Errors
    /// What reading the run and the prompt fails with; settings outside their ranges; a model that is not causal; labels
    /// that the model doesn't know, with those that it knows; guidance of a model without conditions, or without labels and music;
    /// music for a model that isn't told of any, or that the dance has no room in; what is ahead told to a model that can't be told;
    /// joints that aren't coded; a prompt of which nothing is followed, or that is too short to go on from; neither frames
    /// nor a prompt, more frames than memory holds, none that are left to make.
    pub fn load(mut recipe: Resolved, which: CheckpointChoice) -> Result<OpenRequest> {
        recipe.draw.check()?;
        let music = recipe.music.as_ref().map(|music| &music.path);
        let paths = [Some(&recipe.run), recipe.prompt.as_ref().map(|prompt| &prompt.path), music];
        if let Some(path) = paths.into_iter().flatten().find(|path| path.to_str().is_none()) {
            let what = "a name that is no UTF-8 can't be kept beside the dance; give it another name";
            return Err(Error::call(format!("{}: {what}", path.display())));
        }
        if let CheckpointChoice::Step(step) = which {
            check_step(&recipe.run, step)?;
        }
        let mut run = load_run(&recipe.run, which)?;
        let tokenizer = run.load_tokenizer()?;
        check_ahead(recipe.ahead, &run)?;
        let music = recipe.music.as_ref().map(|music| Music::hear(music, &run, tokenizer.fps())).transpose()?;
        let conditions = run.load_conditions()?;
        let without = without(&recipe, &run, &conditions)?;
        let of_seconds = recipe.seconds.map(|s| (s * tokenizer.fps()).round().max(1.0) as usize);
        let asked = recipe.frames.or(of_seconds);
        [asked.unwrap_or(0), recipe.lead_in].into_iter().try_for_each(check_frames)?;
        let tries = recipe.prompt.as_ref().and_then(|prompt| prompt.edit.as_ref()).map_or(1, |edit| edit.tries);
        for (what, many, most) in [("starts", recipe.starts, u8::MAX.into()), ("tries", tries, MOST_TRIES)] {
            if many > most {
                return Err(Error::call(format!("{many} {what}; expected {most} at most")));
            }
        }
        let prompt = recipe.prompt.as_mut().map(|prompt| Followed::load(prompt, asked, &tokenizer)).transpose()?;
        let of_prompt = |p: &Followed| p.edit.as_ref().map_or(p.clip.frames(), Edited::known);
        let follows = |p: &&Followed| p.edit.is_some() || !p.given.is_empty();
        let of_followed = prompt.as_ref().filter(follows).map(of_prompt);
        let of_music = music.as_ref().map(|music| (music.seconds() * tokenizer.fps() + 1e-6).floor().max(1.0) as usize);
        let frames = asked.or(of_followed).or(of_music).or(prompt.as_ref().map(of_prompt));
        let frames = frames.ok_or_else(|| Error::call("neither frames nor a prompt that says how many"))?;
        let written = recipe.fps.map_or(frames, |fps| held_frames(frames, tokenizer.fps(), fps));
        [frames, written].into_iter().try_for_each(check_frames)?;
        let of_edit = prompt.as_ref().and_then(|p| p.edit.as_ref()).map(|edited| edited.frames);
        let fps = tokenizer.fps();
        let scale = Timebase { frames: of_edit.unwrap_or(frames), fps, left_out: 0, model_fps: Some(fps) };
        if let Some(music) = &music {
            tell_tempo(&mut recipe, music, (&run, &conditions), frames as f64 / fps)?;
        }
        if run.label_dropout == Some(0.0) && (without.is_some() || recipe.labels.len() < run.conditions.len()) {
            let what = "labels were never hidden in training (train.label_dropout = 0): without some, or with guidance, the model \
                        is asked what it has not seen";
            run.notes.push(what.into());
        }
        let fronts = labels::fronts(&conditions, &recipe.labels, &recipe.timed_labels, scale)?;
        let from = recipe.prompt.as_ref().and_then(|p| p.from_frame);
        if let Some(from) = from.filter(|from| *from >= frames) {
            let what =
                format!("--from-frame {from} of a dance of {frames} frames; expected fewer: nothing is left to make");
            return Err(Error::call(what));
        }
        if let Some(music) = &music {
            music.check(frames as f64 / tokenizer.fps())?;
        }
        let lead_ins = match &recipe.lead_in_from {
            Some(from) => Some((lead_ins_with(from, &recipe, &tokenizer)?, conditions)),
            None => None,
        };
        Ok(OpenRequest {
            recipe,
            run,
            tokenizer,
            prompt,
            music,
            frames,
            decisions: Vec::new(),
            fronts,
            without,
            lead_ins,
        })
    }

    /// Labels and music are followed so far.
    pub(super) fn guide(&mut self, scale: f64) {
        self.recipe.guidance = scale;
        self.without = self.without.take().filter(|_| scale != 1.0);
    }

    /// Whether a clip is edited that goes on after a gap.
    pub(super) fn has_gaps_that_end(&self) -> bool {
        self.edit().is_some_and(|(_, edited)| edited.has_ends())
    }

    /// Whether nothing of the first frame is given: there is no prompt, or an edit that frees all of it.
    pub fn begins_from_nothing(&self) -> bool {
        let edit = |prompt: &Followed| prompt.edit.as_ref().is_some_and(Edited::begins_from_nothing);
        self.prompt.as_ref().is_none_or(edit)
    }

    /// A second leads in to what begins from nothing: one of a train clip, if it is to be and the run keeps some, or one that
    /// the model draws.
    ///
    /// # Errors
    /// Those of [`LeadIns::load`].
    pub(super) fn lead_in_from_nothing(&mut self, of_train: bool) -> Result<()> {
        let nothing = self.begins_from_nothing();
        let words = lead_in::words(&self.tokenizer);
        self.recipe.lead_in = if nothing { words * self.tokenizer.frames_per_word() } else { 0 };
        (self.recipe.lead_in_from, self.lead_ins) = (None, None);
        if nothing && of_train {
            let all = LeadIns::load(&self.recipe.run, &self.tokenizer)?;
            self.lead_ins =
                all.map(|all| self.run.load_conditions().map(|conditions| (all, conditions))).transpose()?;
            self.recipe.lead_in_from = self.lead_in(0).map(|lead_in| lead_in.from.clone());
        }
        Ok(())
    }

    /// The second of a train clip that a variation goes on from, if it does.
    pub fn lead_in(&self, variation: usize) -> Option<&LeadIn> {
        let (all, conditions) = self.lead_ins.as_ref()?;
        match (variation, &self.recipe.lead_in_from) {
            (0, Some(from)) => all.find(from),
            _ => all.choose(conditions, self.front_at(0), variation_seed(self.recipe.seed, variation)),
        }
    }

    /// What the model is told of an edited clip, of the ids of its words and which of their characters are given.
    fn course(&self, ids: &[u32], given: &[bool], lead_in: usize) -> Result<Option<GoalTrack>> {
        if self.recipe.ahead == 0.0 || !self.run.config.goal || given.is_empty() {
            return Ok(None);
        }
        let ahead = GoalEncoder::of(&self.tokenizer)?;
        let front = lead_in * ahead.characters();
        let codes = [vec![0; front], ahead.codes(ids)].concat();
        let course = GoalTrack::new(ahead, codes, [&vec![false; front], given].concat(), lead_in);
        Ok(Some(course).filter(GoalTrack::has_goals))
    }

    /// Draws `variations` dances side by side; guesses as [`SamplingPlan::guesses`]. `progress` is told the frames done.
    ///
    /// Of an edited clip whose gaps end, each is the best of several tries, drawn side by side, and the variations one after
    /// the other.
    ///
    /// # Errors
    /// Those of [`reader`] and [`dances`].
    pub fn dance(
        &self,
        variations: usize,
        guesses: Option<usize>,
        progress: &mut dyn FnMut(usize),
    ) -> Result<SampledTokens> {
        let length = self.tokenizer.frames_per_word();
        let edit = self.edit();
        let followed = self.prompt.as_ref().filter(|p| !p.given.is_empty() || p.edit.is_some());
        let ids = followed.map(|p| self.tokenizer.ids_of_words(&p.clip.words)).transpose()?.unwrap_or_default();
        let lead_in = self.recipe.lead_in / length;
        let words = edit.map_or(self.frames, |(_, edited)| edited.frames).div_ceil(length) + lead_in;
        let mut plan = SamplingPlan::free(self.tokenizer.grammar(), words, self.recipe.draw, self.recipe.seed);
        let given = edit.map(|(prompt, edited)| edited.given(prompt.clip.words.len())).unwrap_or_default();
        if let Some(prompt) = &self.prompt {
            (plan.beginning, plan.given, plan.prompt) = (&prompt.beginning, &prompt.given, &ids);
        }
        if edit.is_some() {
            (plan.given, plan.foretold) = (&given.0, &given.1);
        }
        let beginnings = (0..variations).filter_map(|variation| self.lead_in(variation));
        let beginnings: Vec<&[u32]> = beginnings.map(|lead_in| &lead_in.ids[..]).collect();
        plan.beginnings = &beginnings;
        let course = self.course(&ids, &given.0, lead_in)?;
        let heard = self.heard(words);
        plan.music = &heard;
        (plan.course, plan.ahead, plan.given_number) = (course.as_ref(), self.recipe.ahead, self.given_number());
        (plan.lead_in, plan.starts) = (lead_in, self.recipe.starts);
        let begins = |(frame, front): &(usize, Vec<u32>)| (lead_in + frame.div_ceil(length), front.clone());
        let fronts: Vec<_> = self.fronts.iter().skip(1).map(begins).collect();
        (plan.front, plan.fronts) = (&self.fronts[0].1, &fronts);
        plan.guidance = self.without.as_deref().map(|without| Guidance { scale: self.recipe.guidance, without });
        plan.guesses = guesses.unwrap_or(if self.recipe.draw.greedy { GUESSES } else { 0 });
        let computing = &self.recipe.computing;
        let tries = self.tries();
        let at_once = if tries > 1 { tries } else { variations };
        let mut model = reader(&self.run, computing.compute()?, computing.reading(at_once * plan.streams()))?;
        if tries == 1 {
            return dances(&mut *model, &plan, &mut |words| progress((words * length).min(self.frames)));
        }
        let mut all = SampledTokens { ids: Vec::new(), foretold: Vec::new(), guessed: 0, right: 0 };
        for variation in 0..variations {
            plan.seed = variation_seed(self.recipe.seed, variation);
            plan.beginning = beginnings.get(variation).copied().unwrap_or(plan.beginning);
            plan.beginnings = &[];
            let drawn = dances(&mut *model, &plan, &mut |words| progress((words * length).min(self.frames)))?;
            let best = self.best(&drawn)?;
            all.ids.push(drawn.ids[best].clone());
            all.foretold.push(drawn.foretold[best].clone());
            (all.guessed, all.right) = (all.guessed + drawn.guessed, all.right + drawn.right);
        }
        Ok(all)
    }

    /// (words, M) What each word is told of the music, the lead-in's among them.
    fn heard(&self, words: usize) -> Vec<f32> {
        let Some(music) = &self.music else { return Vec::new() };
        let (fps, lead_in) = (self.tokenizer.fps(), self.recipe.lead_in as f64);
        let times = (0..words).map(|word| (word as f64 - lead_in) / fps);
        let beats_s = music.beats_s();
        music::conditioning(
            self.run.config.music_conditioning(),
            &Sound { beats_s: &beats_s, rows: music.rows() },
            times,
            1.0,
        )
    }

    /// The prompt that is edited, and how.
    fn edit(&self) -> Option<(&Followed, &Edited)> {
        let prompt = self.prompt.as_ref()?;
        Some((prompt, prompt.edit.as_ref()?))
    }

    /// Ways that are drawn of each variation.
    pub(super) fn tries(&self) -> usize {
        let asked = self.recipe.prompt.as_ref().and_then(|prompt| prompt.edit.as_ref()).map_or(1, |edit| edit.tries);
        let ends = self.edit().is_some_and(|(_, edited)| edited.has_ends());
        if ends && !self.recipe.draw.greedy { asked.max(1) } else { 1 }
    }

    /// The try that ends nearest to where the clip goes on, the first of several.
    fn best(&self, drawn: &SampledTokens) -> Result<usize> {
        let Some((prompt, edited)) = self.edit() else { return Ok(0) };
        let mut best = (f64::INFINITY, 0);
        for i in 0..drawn.ids.len() {
            let closed =
                edited.closed(&self.words(drawn, i), (&prompt.clip, self.recipe.lead_in), &self.tokenizer, false)?;
            if closed.left_over() < best.0 {
                best = (closed.left_over(), i);
            }
        }
        Ok(best.1)
    }

    /// The words of one of several dances; behind gaps of an edited clip those that were foretold.
    pub fn words(&self, danced: &SampledTokens, dance: usize) -> Words {
        let mut ids = danced.ids[dance].clone();
        danced.foretold[dance].iter().for_each(|&(at, id)| ids[at] = id);
        self.tokenizer.words_of_ids(&ids).words
    }

    /// Words as a motion on the rig and at the rate wanted, to be written to `out`.
    ///
    /// # Errors
    /// Words that are not this tokenizer's, a rig that no skeleton map knows, a rate that is none.
    pub fn motion(&self, words: &Words, out: &Path) -> Result<Generated> {
        if let Some((prompt, edited)) = self.edit() {
            return self.edited(words, (prompt, edited), out);
        }
        let mut motion = self.motion_as_drawn(words, out)?;
        if let Some(fps) = self.recipe.fps {
            motion.clip = resample_held(&motion.clip, fps, Method::Smooth)?;
        }
        let made = |motion: Motion, locked: Vec<FootLock>| {
            let locked_fps = motion.clip.fps();
            Generated { motion, locked, locked_fps, left: Vec::new(), changed: None }
        };
        if self.recipe.feet == FootMode::Off {
            return Ok(made(motion, Vec::new()));
        }
        let (map, floor_m) = match self.on_own_rig() {
            Some((prompt, recipe)) => (recipe.read.map.as_deref(), prompt.clip.floor_m),
            None => (None, self.prompt.as_ref().map_or(Some(0.0), |prompt| prompt.clip.under_m())),
        };
        let floor_m = floor_m.filter(|_| self.tokenizer.config().above_floor());
        let kept = self.recipe.prompt.as_ref().and_then(|p| p.from_frame).unwrap_or(0);
        // the last of the frames that are kept, at the rate that is written
        let kept =
            kept.checked_sub(1).map_or(0, |last| (last as f64 * motion.clip.fps() / self.tokenizer.fps()) as usize + 1);
        let (motion, locked) = feet::held(motion, map, floor_m, feet::fixed(self.prompt.as_ref(), kept))?;
        Ok(made(motion, vec![locked]))
    }

    /// An edited clip.
    fn edited(&self, words: &Words, (prompt, edited): (&Followed, &Edited), out: &Path) -> Result<Generated> {
        let hold = self.recipe.feet == FootMode::Lock;
        let Closed { clip, left, locked } =
            edited.closed(words, (&prompt.clip, self.recipe.lead_in), &self.tokenizer, hold)?;
        let fps = self.recipe.fps;
        let (motion, changed) = match self.on_own_rig() {
            Some((prompt, recipe)) => edited.on_own_rig(&clip, (&prompt.clip, recipe.read.map.as_deref()), fps)?,
            None => {
                let fps = fps.unwrap_or(clip.fps());
                (prompt::on_model_rig(out, edited.turn(&clip, self.frames, fps)?), None)
            }
        };
        let changed = changed.map(|changed| (changed, edited.text.clone()));
        Ok(Generated { motion, locked, locked_fps: self.tokenizer.fps(), left, changed })
    }

    fn motion_as_drawn(&self, words: &Words, out: &Path) -> Result<Motion> {
        let clip = self.clip(words)?;
        let Some((prompt, recipe)) = self.on_own_rig() else { return Ok(prompt::on_model_rig(out, clip)) };
        let follows = self.recipe.rest_joints == RestJoints::Follow;
        let base = follows.then(|| rest::settling(&prompt.clip.at_rate()?, prompt.frames)).transpose()?;
        prompt.clip.on_own_rig(&clip, recipe.read.map.as_deref(), base.as_ref())
    }

    /// Words as a clip on the model's rig, where it is to stand.
    fn clip(&self, words: &Words) -> Result<Clip> {
        let clip = match &self.prompt {
            Some(prompt) => prompt.clip.decode(&self.tokenizer, words, self.recipe.rest_joints, prompt.frames)?,
            None if self.recipe.rest_joints == RestJoints::Training => {
                self.tokenizer.decode(words, self.tokenizer.uncoded_pose())?
            }
            None => self.tokenizer.decode(words, UncodedPose::Identity)?,
        };
        let clip = self.behind_lead_in(&clip)?.slice(0..self.frames);
        match (&self.prompt, self.recipe.place) {
            (Some(prompt), Some(place)) => place.put(&clip, Led::by(prompt)),
            _ => Ok(clip),
        }
    }

    /// A clip without the frames that led in, standing where dances begin: at x = z = 0, facing as the model's rig does.
    fn behind_lead_in(&self, clip: &Clip) -> Result<Clip> {
        if self.recipe.lead_in == 0 {
            return Ok(clip.clone());
        }
        let clip = clip.slice(self.recipe.lead_in.min(clip.frames())..clip.frames());
        Place { x: 0.0, z: 0.0, heading: Some(0.0) }.put(&clip, Led { place: false, heading: false })
    }

    /// How the dance is read from `dance`, the file that it is written to.
    pub fn read_back(&self, dance: &Path) -> ReadOptions {
        let own = self.recipe.read_back(dance);
        let written = self.edit().zip(self.recipe.fps).filter(|_| self.recipe.rig == Rig::Prompt);
        let Some(((prompt, edited), fps)) = written.filter(|((_, edited), _)| edited.seam.is_none()) else {
            return own;
        };
        // as many seconds in front as are left out of the clip
        let skip = (edited.left_out as f64 * fps / prompt.clip.motion.clip.fps() - 1e-6).ceil() as usize;
        ReadOptions { skip, rest: RestFrame::Keep, ..own }
    }

    /// Seconds of the dance, as it is read, in which something is made anew while the rest is as it is given; none where all of
    /// it is made.
    pub fn anew_s(&self) -> Vec<[f64; 2]> {
        if let Some((prompt, edited)) = self.edit() {
            let seconds = |frame: usize| frame as f64 / prompt.clip.motion.clip.fps();
            return edited.anew().iter().map(|gap| [seconds(gap.start), seconds(gap.end)]).collect();
        }
        let from = self.recipe.prompt.as_ref().filter(|p| p.joints.is_none()).and_then(|p| p.from_frame);
        from.map(|from| [from, self.frames].map(|frame| frame as f64 / self.tokenizer.fps())).into_iter().collect()
    }

    /// The prompt on whose own rig the dance is written.
    pub fn on_own_rig(&self) -> Option<(&Followed, &PromptRequest)> {
        let prompt = self.prompt.as_ref().zip(self.recipe.prompt.as_ref());
        prompt.filter(|_| self.recipe.rig == Rig::Prompt)
    }
}

/// The lead-ins of a recipe's run, with the one that it names.
fn lead_ins_with(from: &LeadInFrom, recipe: &Resolved, tokenizer: &Tokenizer) -> Result<LeadIns> {
    let path = recipe.run.join(lead_in::LEAD_INS);
    let named = format!("the one of {} from frame {}, which the dance goes on from", from.clip, from.frame);
    let wrong = |found: &str| Error::file(&path, found, named.clone(), "put back the file that the run had");
    let all = LeadIns::load(&recipe.run, tokenizer)?.ok_or_else(|| wrong("no lead-ins"))?;
    let length = lead_in::words(tokenizer) * tokenizer.frames_per_word();
    if recipe.lead_in != length {
        let what = format!("a lead-in of {} frames of a train clip; expected {length}", recipe.lead_in);
        return Err(Error::call(what));
    }
    match all.find(from) {
        Some(_) => Ok(all),
        None => Err(wrong("other lead-ins")),
    }
}

/// Refuses a checkpoint that a run no longer has.
fn check_step(run: &Path, step: u64) -> Result<()> {
    let steps = Checkpoints::of(run).steps()?;
    if steps.is_empty() || steps.contains(&step) {
        return Ok(()); // without any, reading the run says what is wrong with it
    }
    let listed = steps.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
    let found = format!("no checkpoint of step {step}, but those of {listed}");
    let help = "a run keeps the best and the last train.keep: begin one with a greater keep, or sample a new dance";
    Err(Error::file(run, found, "the one that the dance is of", help))
}
