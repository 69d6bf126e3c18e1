//! Dances sampled as a request says.

use super::{OpenRequest, PreparedPrompt};
use crate::sampler::{Guidance, NextToken, SampledTokens, Sampler, SamplingPlan, readers, variation_seed};
use crate::{Error, Result, RunModel};
use kinelm_corpus::music::clip_music::ClipMusic;
use kinelm_model::goal::{GoalEncoder, GoalTrack};
use kinelm_tokenizer::Words;
use std::ops::ControlFlow;
use std::sync::Arc;

/// A [`crate::sampler::SamplingProgress`] that gets the number of the first dance that is being sampled first.
type VariationProgress<'a> = dyn FnMut(usize, usize, &[Vec<u32>]) -> ControlFlow<()> + 'a;

impl OpenRequest {
    /// The sampling of `variations` dances side by side, as an iterator over their words: it can be dropped at any frame. Of
    /// a request with `tries` it samples one try of each; [`OpenRequest::make`] chooses among them.
    ///
    /// # Errors
    /// Those of [`readers`] and [`Sampler::new`]; a masked model, which fills windows, not words.
    pub fn sampler(&self, variations: usize) -> Result<Sampler<Box<dyn NextToken>>> {
        if self.is_masked() {
            let why = "a masked model fills whole windows; sample the dance as a whole";
            return Err(Error::unsupported("a dance word by word", why));
        }
        let plan = self.plan(variations)?;
        let (computing, each) = (&self.resolved.computing, plan.streams());
        let streams = variations * plan.candidates() * each;
        let models = readers(&self.run, computing.compute()?, computing.reading(streams), each)?;
        Sampler::side_by_side(models, plan)
    }

    /// Samples `variations` dances. `guesses` as [`SamplingPlan::guesses`]; `progress` gets the number of the first dance that is
    /// being sampled, the words that each has, and the ids of the last one.
    ///
    /// Of an edited clip whose gaps end, each dance is the best of several tries; the tries of a variation are sampled side by
    /// side, the variations one after the other.
    ///
    /// # Errors
    /// Those of [`RunModel::open`] and [`RunModel::sample`].
    pub(crate) fn sample(
        &self,
        variations: usize,
        guesses: Option<usize>,
        progress: &mut VariationProgress<'_>,
    ) -> Result<SampledTokens> {
        let mut plan = self.plan(variations)?;
        plan.guesses = guesses.unwrap_or(plan.guesses);
        let tries = self.tries();
        let (computing, each) = (&self.resolved.computing, plan.streams());
        let dances = if tries > 1 { tries } else { variations };
        let reading = computing.reading(dances * plan.candidates() * each);
        let mut model = RunModel::open(&self.run, computing.compute()?, reading, each)?;
        if tries == 1 {
            return model.sample(&plan, &mut |words, last| progress(0, words, last));
        }
        let (beginnings, mut all) = (plan.beginnings.clone(), SampledTokens::default());
        for variation in 0..variations {
            plan.seed = variation_seed(self.resolved.seed, variation);
            plan.beginnings = beginnings.get(variation).or(beginnings.first()).cloned().into_iter().collect();
            let mut sampled = model.sample(&plan, &mut |words, last| progress(variation, words, last))?;
            let best = self.best_try(&sampled)?;
            all.ids.push(sampled.ids.swap_remove(best));
            all.lookahead.push(sampled.lookahead.swap_remove(best));
            (all.guessed, all.right) = (all.guessed + sampled.guessed, all.right + sampled.right);
        }
        Ok(all)
    }

    /// The words of one of several dances, with the look-ahead tokens after gaps of an edited clip.
    pub(crate) fn words(&self, sampled: &SampledTokens, dance: usize) -> Words {
        self.tokenizer.words_of_ids(&sampled.with_lookahead(dance)).words
    }

    /// Ways through its gaps that are sampled of each variation.
    pub(crate) fn tries(&self) -> usize {
        let edit = self.resolved.prompt.as_ref().and_then(|prompt| prompt.edit.as_ref());
        let has_ends = self.prompt.as_ref().is_some_and(PreparedPrompt::has_ends) && !self.resolved.sampling.greedy;
        edit.and_then(|edit| edit.tries).filter(|_| has_ends).map_or(1, |tries| tries.max(1))
    }

    /// Words that are sampled of each dance, the lead-in included.
    pub(crate) fn words_in_all(&self) -> usize {
        let frames = self.edit().map_or(self.frames, |(_, edit)| edit.frames);
        let length = self.tokenizer.frames_per_word();
        frames.div_ceil(length) + self.resolved.lead_in / length
    }

    /// The sampling plan of `variations` dances.
    fn plan(&self, variations: usize) -> Result<SamplingPlan> {
        let request = &self.resolved;
        let length = self.tokenizer.frames_per_word();
        let edit = self.edit();
        let lead_in = request.lead_in / length;
        let words = self.words_in_all();
        let mut plan = SamplingPlan::free(self.tokenizer.grammar(), words, request.sampling, request.seed);
        if let Some(prompt) = &self.prompt {
            if !prompt.given.is_empty() || edit.is_some() {
                plan.prompt = self.tokenizer.ids_of_words(&prompt.clip.words)?;
            }
            plan.beginnings = Some(prompt.beginning.clone()).into_iter().filter(|ids| !ids.is_empty()).collect();
            plan.given.clone_from(&prompt.given);
        }
        plan.way = self.way.as_ref().map(|open| open.way.clone());
        if let Some((prompt, edit)) = edit {
            (plan.given, plan.lookahead) = edit.given(prompt.clip.words.len());
            plan.goals = self.goals(&plan.prompt, &plan.given, lead_in)?.map(Arc::new);
        }
        let lead_ins: Vec<Vec<u32>> = (0..variations)
            .filter_map(|variation| self.lead_in(variation))
            .map(|lead_in| lead_in.ids.clone())
            .collect();
        if !lead_ins.is_empty() {
            plan.beginnings = lead_ins;
        }
        plan.music = self.music_rows(words);
        (plan.lead_in, plan.first_frames) = (lead_in, request.first_frames);
        plan.passes = request.passes.unwrap_or(1);
        plan.look_ahead = self.look_ahead()?;
        (plan.goal_guidance, plan.inputs_hash) = (request.goal_guidance, self.inputs_hash());
        // the first front holds for the lead-in too
        let from_word = |frame: usize| if frame == 0 { 0 } else { lead_in + frame.div_ceil(length) };
        plan.fronts = self.fronts.iter().map(|(frame, front)| (from_word(*frame), front.clone())).collect();
        let unconditioned = self.unconditioned.clone();
        plan.guidance = unconditioned.map(|unconditioned| Guidance { scale: request.guidance, unconditioned });
        Ok(plan)
    }

    /// The goals of an edited clip, by the ids of its words and (P, C) which of their characters are given.
    fn goals(&self, ids: &[u32], given: &[bool], lead_in: usize) -> Result<Option<GoalTrack>> {
        if self.resolved.goal_guidance == 0.0 || !self.run.config.goal || given.is_empty() {
            return Ok(None);
        }
        let encoder = GoalEncoder::of(&self.tokenizer)?;
        let front = lead_in * encoder.characters();
        // the lead-in has no goals: its codes are placeholders that are never given
        let codes = [vec![0; front], encoder.codes(ids)].concat();
        let goals = GoalTrack::new(encoder, codes, [&vec![false; front], given].concat(), lead_in);
        Ok(Some(goals).filter(GoalTrack::has_goals))
    }

    /// (words, M) conditioning on the music, the lead-in included.
    fn music_rows(&self, words: usize) -> Vec<f32> {
        let Some(music) = &self.music else { return Vec::new() };
        let (fps, lead_in) = (self.tokenizer.fps(), self.resolved.lead_in as f64);
        let times = (0..words).map(|word| (word as f64 - lead_in) / fps);
        let beats_s = music.beats_s();
        self.run.config.music_conditioning(&ClipMusic { beats_s: &beats_s, rows: music.rows() }, times, 1.0)
    }

    /// The try that ends nearest to where the clip continues; of equals the first.
    fn best_try(&self, sampled: &SampledTokens) -> Result<usize> {
        let Some((prompt, edit)) = self.edit() else { return Ok(0) };
        let mut best = (f64::INFINITY, 0);
        for i in 0..sampled.ids.len() {
            let words = self.words(sampled, i);
            let closed = edit.close(&words, &prompt.clip, self.resolved.lead_in, &self.tokenizer, false)?;
            // strictly less: of equals the first, and NaN never wins
            if closed.total_error() < best.0 {
                best = (closed.total_error(), i);
            }
        }
        Ok(best.1)
    }
}
