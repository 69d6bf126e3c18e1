//! One dance being sampled: how much of its window the model has read, what it reads next, and what its logits give.

use super::goals::GoalConditioning;
use super::look_ahead::block_seed;
use super::way::Follower;
use super::{NextToken, SamplingPlan};
use crate::Result;
use crate::sampling;
use kinelm_tokenizer::{SPACE, Slot};
use std::ops::Range;
use std::sync::Arc;

pub(super) struct Sequence {
    plan: Arc<SamplingPlan>,
    /// Its dance's number among those sampled side by side, and its own among the dance's candidates.
    dance: usize,
    candidate: usize,
    /// The dance's seed, and that of the block which is being sampled.
    dance_seed: u64,
    seed: u64,
    /// Words that it samples before its dance's candidates are compared.
    until: usize,
    /// Tokens that a window holds.
    context: usize,
    /// Index of the window's front among the plan's.
    front: usize,
    /// Words that a window holds, if all have one length.
    window_words: Option<usize>,
    /// The known tokens: sampled, given, spaces. After them comes a free slot, or nothing.
    ids: Vec<u32>,
    /// The first token of each word, the unfinished one included.
    starts: Vec<usize>,
    /// The slot of the next token in its word.
    slot: Slot,
    /// The window's first token.
    first: usize,
    /// Tokens of the window that the model has read.
    read: usize,
    /// The tokens that the model reads next: the unread part of the window, then the guesses.
    block: Vec<u32>,
    /// The same for the unconditioned reading, if there is one.
    unconditioned: Vec<u32>,
    /// Tokens of the block that are guesses, or given characters between them.
    guesses: usize,
    /// Look-ahead tokens: index among the ids, and id.
    lookahead: Vec<(usize, u32)>,
    /// Words before this one have their look-ahead tokens.
    looked_ahead: usize,
    /// Tokens of the window that are left after a word was sampled ahead and taken back.
    taken_back: Option<usize>,
    /// ln p of what is given of the first word and up to the next free slot, as far as it is scored.
    log_likelihood: f64,
    /// Whether all of that is scored.
    is_scored: bool,
    goals: Option<GoalConditioning>,
    way: Option<Follower>,
    /// Tokens guessed so far.
    pub guessed: u64,
    /// The number of right guesses.
    pub right: u64,
}

/// What a candidate sampled from a word on, and where it stands.
pub(super) struct Continuation {
    from: usize,
    ids: Vec<u32>,
    starts: Vec<usize>,
    front: usize,
    slot: Slot,
    first: usize,
    read: usize,
    lookahead: Vec<(usize, u32)>,
    looked_ahead: usize,
    goals: Option<GoalConditioning>,
    way: Option<Follower>,
}

impl Sequence {
    /// The sequence with this number among all candidates of all dances; `dance_seed`: its dance's.
    pub fn new(plan: Arc<SamplingPlan>, number: usize, dance_seed: u64, context: usize) -> Sequence {
        let word = plan.grammar.tokens_per_word();
        let (dance, candidate) = (number / plan.candidates(), number % plan.candidates());
        let mut sequence = Sequence {
            dance,
            candidate,
            dance_seed,
            seed: block_seed(dance_seed, 0, candidate),
            until: usize::MAX,
            context,
            front: 0,
            window_words: word.map(|word| (context + 1 - plan.front_length()) / word),
            ids: Vec::with_capacity(plan.words * word.unwrap_or(1)),
            starts: vec![0],
            slot: Slot::default(),
            first: 0,
            read: 0,
            block: Vec::new(),
            unconditioned: Vec::new(),
            guesses: 0,
            lookahead: Vec::new(),
            looked_ahead: 0,
            taken_back: None,
            log_likelihood: 0.0,
            is_scored: false,
            goals: plan.used_goals().cloned().map(GoalConditioning::new),
            way: plan.way.clone().map(|way| Follower::new(way, plan.lead_in)),
            guessed: 0,
            right: 0,
            plan,
        };
        sequence.advance();
        sequence
    }

    /// Samples no more than the first `words` words.
    pub fn wait_at(&mut self, words: usize) {
        self.until = words;
    }

    /// What it sampled from word `from` on. What comes before is the same in all candidates of a dance, and to copy it at
    /// every block would take time that grows with the square of the dance.
    pub fn since(&self, from: usize) -> Continuation {
        Continuation {
            from,
            ids: self.ids[self.starts[from]..].to_vec(),
            starts: self.starts[from..].to_vec(),
            front: self.front,
            slot: self.slot,
            first: self.first,
            read: self.read,
            lookahead: self.lookahead.clone(),
            looked_ahead: self.looked_ahead,
            goals: self.goals.clone(),
            way: self.way.clone(),
        }
    }

    /// Goes on as another candidate of the same dance did, with `block`; `has_read`: whether the model has read what that has.
    pub fn go_on_from(&mut self, other: &Continuation, block: usize, has_read: bool) {
        self.seed = block_seed(self.dance_seed, block, self.candidate);
        self.ids.truncate(self.starts[other.from]);
        self.ids.extend_from_slice(&other.ids);
        self.starts.truncate(other.from);
        self.starts.extend_from_slice(&other.starts);
        (self.front, self.slot, self.first) = (other.front, other.slot, other.first);
        self.read = if has_read { other.read } else { 0 };
        self.lookahead.clone_from(&other.lookahead);
        self.looked_ahead = other.looked_ahead;
        self.goals.clone_from(&other.goals);
        self.way.clone_from(&other.way);
    }

    /// The ids of some words.
    pub fn words_in(&self, words: Range<usize>) -> &[u32] {
        &self.ids[self.starts[words.start]..self.starts[words.end]]
    }

    /// The number of whole words.
    pub fn words(&self) -> usize {
        self.starts.len() - 1
    }

    /// The ids of a whole word, its space included.
    pub(crate) fn word(&self, word: usize) -> &[u32] {
        self.words_in(word..word + 1)
    }

    pub(crate) fn is_done(&self) -> bool {
        self.words() == self.plan.words
    }

    /// ln p of what is given of the first word and up to the next free slot, as far as it is scored.
    pub(crate) fn log_likelihood(&self) -> f64 {
        self.log_likelihood
    }

    /// Whether all of that is scored.
    pub(crate) fn is_scored(&self) -> bool {
        self.is_scored
    }

    /// Begins after what is given before the first free slot, which the model has read and scored.
    pub(crate) fn skip_prefix(&mut self, log_likelihood: f64) {
        // the last of it is read again, for its logits
        self.read = self.window() - 1;
        self.log_likelihood = log_likelihood;
    }

    /// The ids, and the look-ahead tokens.
    pub(crate) fn into_tokens(self) -> (Vec<u32>, Vec<(usize, u32)>) {
        (self.ids, self.lookahead)
    }

    /// The tokens before the window, whole words.
    pub(crate) fn before(&self) -> &[u32] {
        &self.ids[..self.first]
    }

    /// The tokens that the model reads next; none when the dance is done.
    pub(crate) fn block(&self) -> &[u32] {
        &self.block
    }

    /// The same for the unconditioned reading; `None` where the dance has one reading.
    pub(crate) fn unconditioned_block(&self) -> Option<&[u32]> {
        (self.plan.streams() > 1).then_some(self.unconditioned.as_slice())
    }

    /// Conditions the frames that begin within the block on their goals and their music. Only for words of one length.
    pub(crate) fn condition(&mut self, model: &mut (impl NextToken + ?Sized), stream: usize) -> Result<()> {
        let m = self.plan.music_width();
        let Some(length) = self.plan.grammar.tokens_per_word().filter(|_| self.goals.is_some() || m > 0) else {
            return Ok(());
        };
        let front = self.plan.front_length();
        let frames = (0..).map(|frame| (frame, front - 1 + frame * length));
        let begun = frames.take_while(|(_, at)| *at < self.read + self.block.len()).filter(|(_, at)| *at >= self.read);
        for (frame, _) in begun {
            let word = self.first / length + frame;
            let music = self.plan.music.get(word * m..(word + 1) * m).unwrap_or_default();
            // a window's first frame has no previous frame to measure the way to its goals from
            let goals = self.goals.as_mut().filter(|_| frame > 0);
            model.condition(stream, frame, goals.and_then(|goals| goals.condition(word, &self.ids)), music)?;
        }
        Ok(())
    }

    /// The guidance scale of the next token: towards the goals where its frame has any or is sampled ahead, else by the
    /// conditions in front. `None`: the conditioned reading alone counts.
    pub(crate) fn scale(&self) -> Option<f64> {
        let has_goal = |goals: &GoalConditioning| goals.has_conditioned(self.words()) || self.looks_ahead(self.slot);
        let towards = self.goals.as_ref().filter(|goals| has_goal(goals)).map(|_| self.plan.goal_guidance);
        towards.or(self.plan.guidance.as_ref().map(|guidance| guidance.scale))
    }

    /// Whether there are guesses in the block.
    pub(crate) fn has_guesses(&self) -> bool {
        self.guesses > 0
    }

    /// The tokens in front of the window.
    fn front(&self) -> &[u32] {
        self.plan.fronts.get(self.front).map_or(&[], |(_, front)| front)
    }

    /// Tokens of the window: the front and all known tokens from its first on.
    fn window(&self) -> usize {
        self.front().len() + self.ids.len() - self.first
    }

    /// The token of a slot of the unfinished word, `later` tokens after the next one, if it needs no sampling.
    fn known(&self, slot: Slot, later: usize) -> Option<u32> {
        let given = || self.given(slot).filter(|_| !self.looks_ahead(slot));
        let known = self.plan.beginning(self.dance).get(self.ids.len() + later).copied().or_else(given);
        known.or_else(|| self.plan.grammar.only(slot))
    }

    /// The prompt's token in a slot of this word, if it is given.
    fn given(&self, slot: Slot) -> Option<u32> {
        self.plan.given(self.words(), slot.tokens)
    }

    /// Whether a slot of this word is sampled although it is given.
    fn looks_ahead(&self, slot: Slot) -> bool {
        let word = self.words();
        word >= self.looked_ahead && self.plan.is_flagged(&self.plan.lookahead, word, slot.tokens)
    }

    /// Adds known tokens up to the next free slot, and makes room for it in the window.
    fn advance(&mut self) {
        while !self.is_done() {
            self.change_front();
            self.move_by_words();
            match self.known(self.slot, 0) {
                Some(id) => self.push(id),
                None => return self.make_room(),
            }
        }
    }

    fn push(&mut self, id: u32) {
        self.ids.push(id);
        self.slot = self.plan.grammar.advance(self.slot, id);
        if id == SPACE && !self.take_back() {
            self.starts.push(self.ids.len());
        }
    }

    /// Stores the look-ahead tokens of a whole word, if it has any, and takes the word back, to be made of given characters.
    fn take_back(&mut self) -> bool {
        let start = self.starts[self.words()];
        let slot = |at: usize| Slot { tokens: at - start, ..Slot::default() };
        let ahead: Vec<_> = (start..self.ids.len()).filter(|&at| self.looks_ahead(slot(at))).collect();
        if ahead.is_empty() {
            return false;
        }
        self.lookahead.extend(ahead.into_iter().map(|at| (at, self.ids[at])));
        // or the same word would be taken back again
        self.looked_ahead = self.words() + 1;
        self.ids.truncate(start);
        self.slot = Slot::default();
        self.taken_back = Some(self.window());
        true
    }

    /// Where the tokens in front change, the window is read again.
    fn change_front(&mut self) {
        let words = self.words();
        let front = self.plan.fronts.iter().rposition(|(word, _)| *word <= words).unwrap_or(0);
        if front != self.front {
            let is_other = self.plan.fronts[front].1 != self.front();
            self.front = front;
            self.read = if is_other { 0 } else { self.read };
        }
    }

    /// Words of one length: a full window moves when the next word begins.
    fn move_by_words(&mut self) {
        let (Some(most), word) = (self.window_words, self.plan.grammar.tokens_per_word().unwrap_or(1)) else { return };
        if self.slot == Slot::default() && self.ids.len() - self.first == most * word {
            // the younger half stays: a move by one word would read the whole window for every word
            self.first = self.starts[self.words() - (most - most / 2)];
            self.read = 0;
        }
    }

    /// Words of any length: a window without room for the next token moves by half, to the beginning of a word. Only a word
    /// that fills a window alone is cut.
    fn make_room(&mut self) {
        while self.window_words.is_none() && self.window() > self.context {
            let half = self.first + (self.context / 2).max(1);
            let words = &self.starts[..self.starts.partition_point(|&s| s < self.ids.len())];
            // the first word from the middle on, else the last one that isn't the window's first
            let next = words.get(words.partition_point(|&s| s < half)).or(words.last().filter(|&&s| s > self.first));
            self.first = next.copied().unwrap_or(half);
            self.read = 0;
        }
    }

    /// Makes the next block, with up to `guesses` guesses. Returns the number of tokens of the window that the model has
    /// read.
    pub(crate) fn prepare(&mut self, guesses: usize) -> usize {
        self.fill_block(guesses);
        if self.plan.streams() > 1 {
            self.unconditioned.clone_from(&self.block);
        }
        let front = self.plan.guidance.as_ref().and_then(|guidance| guidance.unconditioned.get(self.read..));
        for (token, unconditioned) in self.unconditioned.iter_mut().zip(front.unwrap_or_default()) {
            *token = *unconditioned;
        }
        self.read
    }

    fn fill_block(&mut self, guesses: usize) {
        self.block.clear();
        self.guesses = 0;
        // one that is ahead of the others waits: what comes after depends on which of them is the best
        if self.is_done() || self.words() >= self.until {
            return;
        }
        let front = self.plan.fronts.get(self.front).map_or(&[][..], |(_, front)| front);
        // where the first slot after the front is free, the front's last token is read again for its logits
        self.block.extend_from_slice(front.get(self.read..).unwrap_or_default());
        self.block.extend_from_slice(&self.ids[self.first + self.read.saturating_sub(front.len())..]);
        // a new window is read without guesses: logits would be computed for all its rows
        if self.read > 0 {
            self.guess(guesses);
        }
    }

    /// Adds up to `most` guesses to the block, and the given characters between them, as long as a free slot of the same word
    /// follows and the window has room.
    fn guess(&mut self, most: usize) {
        let known = self.block.len();
        let mut slot = self.slot;
        for _ in 0..most {
            let whole = self.block.len();
            let mut next = self.guess_at(slot);
            while let Some(id) = next.filter(|&id| id != SPACE) {
                self.block.push(id);
                slot = self.plan.grammar.advance(slot, id);
                next = self.known(slot, self.block.len() - known);
            }
            // the word ends, no token was guessed, or the window is full
            if next.is_some() || self.block.len() == whole || self.window() + self.block.len() - known > self.context {
                self.block.truncate(whole);
                break;
            }
        }
        self.guesses = self.block.len() - known;
    }

    /// The token in the same slot of the previous word.
    fn guess_at(&self, slot: Slot) -> Option<u32> {
        let id = self.word(self.words().checked_sub(1)?).get(slot.tokens).copied();
        id.filter(|&id| self.plan.grammar.allows(slot, id))
    }

    /// Scores the block by the `logits` (rows, V) of all its tokens, until the first word is whole. All but the block's first
    /// token is given.
    pub(crate) fn score(&mut self, logits: &[f32], vocabulary: usize) {
        let word = self.plan.grammar.tokens_per_word().unwrap_or(1);
        for (later, row) in (1..self.block.len()).zip(logits.chunks_exact(vocabulary.max(1))) {
            if let Some(at) = (self.read + later).checked_sub(self.front().len()) {
                let allowed = self.plan.grammar.allowed(Slot { tokens: at % word, characters: at % word });
                self.log_likelihood += sampling::log_probability(row, &allowed, self.block[later]);
            }
        }
        self.is_scored = self.words() > 0;
    }

    /// Samples what the block's `logits` (rows, V) allow to: the next free slot, and those after guesses that turn out right.
    /// The rows end with the block.
    /// Of guided logits the scale, and the conditioned ones (rows, V).
    pub fn take(&mut self, logits: &[f32], guided: Option<(f64, &[f32])>, vocabulary: usize) -> Result<()> {
        if self.block.is_empty() {
            return Ok(());
        }
        let (first, front) = (self.first, self.front);
        let (read, start) = (self.window(), self.ids.len());
        let guesses = self.block.split_off(self.block.len() - self.guesses);
        let rows = logits.len() / vocabulary.max(1);
        // tokens of the guesses that have turned out right
        let mut right = 0;
        loop {
            // counted from the end, as the block may be read with its last logits alone
            let row = (rows + right).checked_sub(1 + guesses.len());
            let row = row.map_or(0..0, |row| row * vocabulary..(row + 1) * vocabulary);
            let guided = guided.map(|(scale, conditioned)| (scale, part(conditioned, &row)));
            let id = self.sample(part(logits, &row), guided)?;
            if let Some(guess) = guesses.get(right) {
                self.guessed += 1;
                self.right += u64::from(*guess == id);
            }
            self.push(id);
            self.advance();
            if self.taken_back.is_some() {
                break;
            }
            // up to the next free slot, if the model has read so far
            let sampled = self.ids.len() - start;
            match guesses.get(right..sampled) {
                Some(guessed) if guessed == &self.ids[start + right..] => right = sampled,
                _ => break,
            }
        }
        // a window that has moved, or has another front, is read again
        if self.first == first && self.front == front {
            self.read = self.taken_back.map_or(read + right, |left| left.min(read + right));
            // a word taken back may begin with a free slot, whose logits come after the token before it
            self.read = self.read.min(self.window() - 1);
        }
        self.taken_back = None;
        Ok(())
    }

    /// The tokens in this slot of the words that the repetition penalty looks back on.
    fn recent(&self, slot: usize) -> Vec<u32> {
        let words = self.words();
        let looked_at = words.saturating_sub(self.plan.sampling.looks_back())..words;
        looked_at.filter_map(|word| self.word(word).get(slot).copied()).collect()
    }

    /// The token of the next slot, which is free.
    fn sample(&mut self, logits: &[f32], guided: Option<(f64, &[f32])>) -> Result<u32> {
        let (word, slot) = (self.words(), self.slot);
        let pull = self.way.as_mut().and_then(|way| way.pull(word, slot.tokens, &self.ids));
        let pulled = pull.map(|pull| {
            let on = |logits: &[f32]| (0..).zip(logits).map(|(id, logit)| logit + pull(id)).collect::<Vec<f32>>();
            (on(logits), guided.map(|(scale, conditioned)| (scale, on(conditioned))))
        });
        let (logits, guided) = match &pulled {
            Some((logits, guided)) => (&logits[..], guided.as_ref().map(|(scale, logits)| (*scale, &logits[..]))),
            None => (logits, guided),
        };
        // a first word that is chosen by what is given in it is that of all candidates
        let seed = if word == 0 && self.plan.has_chosen_first_word() { self.dance_seed } else { self.seed };
        self.plan.draw(seed, (word, slot), logits, guided, &self.recent(slot.tokens))
    }
}

/// The logits of a row; none where the model returned too few.
fn part<'a>(logits: &'a [f32], row: &Range<usize>) -> &'a [f32] {
    logits.get(row.clone()).unwrap_or_default()
}
