//! One dance being drawn: what of its window the model has read, what it reads next, what is drawn from the logits.

use super::{NextToken, SamplingPlan, sampling};
use crate::{Error, Result};
use kinelm_engine::decode as engine;
use kinelm_model::goal::{Conditioning, GoalTrack};
use kinelm_tokenizer::root_path::RootState;
use kinelm_tokenizer::{SPACE, Slot};

pub(super) struct Dance<'a> {
    plan: &'a SamplingPlan<'a>,
    seed: u64,
    /// Ids that it begins with.
    beginning: &'a [u32],
    /// Tokens that a window holds.
    context: usize,
    /// The tokens in front of the window.
    front: &'a [u32],
    /// Words that a window holds, if all have one length.
    most: Option<usize>,
    /// What is known: drawn, given, spaces. Behind it stands a free place, or nothing.
    ids: Vec<u32>,
    /// The first token of each word, the one that is being drawn among them.
    starts: Vec<usize>,
    /// Where the next token stands in its word.
    place: Slot,
    /// The window's first token.
    first: usize,
    /// Tokens of the window that the model has read.
    read: usize,
    /// What the model reads next: what it hasn't of the window, then the guesses.
    block: Vec<u32>,
    /// The same for the reading without conditions, if there is one.
    block_without: Vec<u32>,
    /// Tokens of the block that are guesses, or given places between them.
    ahead: usize,
    /// What was drawn where it is given: the place among the ids, and the id.
    foretold: Vec<(usize, u32)>,
    /// Words up to here need not be foretold any more.
    told: usize,
    /// Tokens that are left of those that the model has read, since words were foretold and taken back.
    taken_back: Option<usize>,
    /// How likely what is given of the first word and up to the next free place is, ln p, as far as it was weighed.
    likelihood: f64,
    /// Whether all of that was.
    weighed: bool,
    /// Where the model is told what is given ahead.
    led: Option<Led<'a>>,
    /// Tokens guessed so far, and those that were right.
    pub guessed: u64,
    pub right: u64,
}

/// A dance on its way to what is given ahead.
struct Led<'a> {
    course: &'a GoalTrack,
    /// Where the root stands behind each word, as far as that was asked for.
    stands: Vec<Option<RootState>>,
    /// What one frame is told.
    told: Conditioning,
    /// The last word that was told something.
    last: Option<usize>,
}

impl<'a> Led<'a> {
    fn new(course: &'a GoalTrack) -> Led<'a> {
        Led { course, stands: Vec::new(), told: Conditioning::none(1, course.characters()), last: None }
    }

    /// What a word is told behind those of `ids`.
    fn tell(&mut self, word: usize, ids: &[u32]) -> Option<engine::FrameConditioning<'_>> {
        let length = self.course.characters() + 1;
        let codes = |word: usize| self.course.codes(&ids[word * length..][..length]);
        for word in self.stands.len()..word {
            let stand = self.course.stand(word, &codes(word), self.stands.last().and_then(Option::as_ref));
            self.stands.push(stand);
        }
        let before = word.checked_sub(1)?;
        let Conditioning { numbers, rows: [steps, paces], .. } = &mut self.told;
        let behind = (codes(before), self.stands[before].as_ref());
        let is_told = self.course.encode(word, (&behind.0, behind.1), numbers, [steps, paces]);
        self.last = self.last.filter(|_| !is_told).or(is_told.then_some(word));
        is_told.then_some(engine::FrameConditioning { numbers, rows: [steps, paces] })
    }
}

impl<'a> Dance<'a> {
    pub fn new(plan: &'a SamplingPlan<'a>, (seed, beginning): (u64, &'a [u32]), context: usize) -> Self {
        let word = plan.grammar.tokens_per_word();
        let mut dance = Dance {
            plan,
            seed,
            beginning,
            context,
            front: plan.front,
            most: word.map(|word| (context + 1 - plan.front.len()) / word),
            ids: Vec::with_capacity(plan.words * word.unwrap_or(1)),
            starts: vec![0],
            place: Slot::default(),
            first: 0,
            read: 0,
            block: Vec::new(),
            block_without: Vec::new(),
            ahead: 0,
            foretold: Vec::new(),
            told: 0,
            taken_back: None,
            likelihood: 0.0,
            weighed: false,
            led: plan.told().map(Led::new),
            guessed: 0,
            right: 0,
        };
        dance.advance();
        dance
    }

    /// Whole words.
    pub fn words(&self) -> usize {
        self.starts.len() - 1
    }

    pub fn is_done(&self) -> bool {
        self.words() == self.plan.words
    }

    /// How likely what is given of the first word and up to the next free place is, ln p, as far as it was weighed.
    pub fn likelihood(&self) -> f64 {
        self.likelihood
    }

    /// Whether all of that was.
    pub fn is_weighed(&self) -> bool {
        self.weighed
    }

    /// Its ids, and what was drawn where they are given.
    pub fn into_drawn(self) -> (Vec<u32>, Vec<(usize, u32)>) {
        (self.ids, self.foretold)
    }

    /// What the model reads next; nothing when the dance is done.
    pub fn block(&self) -> &[u32] {
        &self.block
    }

    /// The same for the second reading; `None` where the dance has one alone.
    pub fn block_without(&self) -> Option<&[u32]> {
        (self.plan.streams() > 1).then_some(self.block_without.as_slice())
    }

    /// Tells the sequence `stream` of a model what is given ahead of the frames that begin with the block, and their music; all
    /// words have one length then.
    pub fn tell(&mut self, model: &mut dyn NextToken, stream: usize) -> Result<()> {
        let (Some(length), m) = (self.plan.grammar.tokens_per_word(), self.plan.music.len() / self.plan.words.max(1))
        else {
            return Ok(());
        };
        if self.led.is_none() && m == 0 {
            return Ok(());
        }
        let front = self.plan.front.len();
        let frames = (0..).map(|frame| (frame, front - 1 + frame * length));
        let begun = frames.take_while(|(_, at)| *at < self.read + self.block.len()).filter(|(_, at)| *at >= self.read);
        for (frame, _) in begun {
            let word = self.first / length + frame;
            let music = self.plan.music.get(word * m..(word + 1) * m).unwrap_or_default();
            // a window's first frame has none before it
            let led = self.led.as_mut().filter(|_| frame > 0);
            model.condition(stream, frame, led.and_then(|led| led.tell(word, &self.ids)), music)?;
        }
        Ok(())
    }

    /// What the difference of both readings is multiplied with for the next token: where the frame is told what is given
    /// ahead, or is what was told of, [`SamplingPlan::ahead`], else the guidance's; `None`: the first reading alone counts.
    pub fn scale(&self) -> Option<f64> {
        let is_led = |led: &Led| led.last == Some(self.words()) || self.foretells(self.place);
        let ahead = self.led.as_ref().filter(|led| is_led(led)).map(|_| self.plan.ahead);
        ahead.or(self.plan.guidance.map(|guidance| guidance.scale))
    }

    /// Whether there are guesses in the block.
    pub fn guesses(&self) -> bool {
        self.ahead > 0
    }

    /// Tokens of the window: the front and all that are known from its first on.
    fn window(&self) -> usize {
        self.plan.front.len() + self.ids.len() - self.first
    }

    /// The token that must stand at a place of the word that is being drawn, `behind` tokens behind the next one; none where
    /// it is to be drawn all the same.
    fn known(&self, place: Slot, behind: usize) -> Option<u32> {
        let plan = self.plan;
        let given = || self.given(place).filter(|_| !self.foretells(place));
        let known = self.beginning.get(self.ids.len() + behind).copied().or_else(given);
        known.or_else(|| plan.grammar.only(place))
    }

    /// The prompt's token at a place of this word, if it is given.
    fn given(&self, place: Slot) -> Option<u32> {
        let word = self.plan.grammar.tokens_per_word()?;
        let prompted = self.words().checked_sub(self.plan.lead_in)?;
        let given = self.is_so(self.plan.given, place);
        self.plan.prompt.get(prompted * word + place.tokens).copied().filter(|_| given)
    }

    /// Whether a place of this word is drawn although it is given.
    fn foretells(&self, place: Slot) -> bool {
        self.words() >= self.told && self.is_so(self.plan.foretold, place)
    }

    /// What `flags`, (C) of every word or (P, C), say of a place of this word.
    fn is_so(&self, flags: &[bool], place: Slot) -> bool {
        let characters = self.plan.grammar.tokens_per_word().map_or(0, |word| word - 1);
        let Some(prompted) = self.words().checked_sub(self.plan.lead_in) else { return false };
        let word = if flags.len() > characters { prompted } else { 0 };
        place.tokens < characters && flags.get(word * characters + place.tokens).copied().unwrap_or(false)
    }

    /// Adds what is known up to the next free place, for which the window has room then.
    fn advance(&mut self) {
        while !self.is_done() {
            self.change_front();
            self.move_by_words();
            match self.known(self.place, 0) {
                Some(id) => self.push(id),
                None => return self.make_room(),
            }
        }
    }

    fn push(&mut self, id: u32) {
        self.ids.push(id);
        self.place = self.plan.grammar.advance(self.place, id);
        if id == SPACE && !self.take_back() {
            self.starts.push(self.ids.len());
        }
    }

    /// A whole word of which something was foretold is noted and taken back, to be made anew of what is given.
    fn take_back(&mut self) -> bool {
        let start = self.starts[self.words()];
        let place = |at: usize| Slot { tokens: at - start, ..Slot::default() };
        let told: Vec<_> = (start..self.ids.len()).filter(|&at| self.foretells(place(at))).collect();
        if told.is_empty() {
            return false;
        }
        self.foretold.extend(told.into_iter().map(|at| (at, self.ids[at])));
        self.told = self.words() + 1;
        self.ids.truncate(start);
        self.place = Slot::default();
        self.taken_back = Some(self.window());
        true
    }

    /// A window before which other tokens are to stand is read anew with the word that begins.
    fn change_front(&mut self) {
        let begun = self.plan.fronts.iter().rev().find(|(word, _)| *word <= self.words());
        let front = begun.map_or(self.plan.front, |(_, front)| front.as_slice());
        if front != self.front {
            (self.front, self.read) = (front, 0);
        }
    }

    /// Words of one length: a window that is full moves when the next word begins.
    fn move_by_words(&mut self) {
        let (Some(most), word) = (self.most, self.plan.grammar.tokens_per_word().unwrap_or(1)) else { return };
        if self.place == Slot::default() && self.ids.len() - self.first == most * word {
            self.first = self.starts[self.words() - (most - most / 2)];
            self.read = 0;
        }
    }

    /// Words of any length: a window that has no room for the next token moves on by half, to where a word begins; inside
    /// a word only if that one alone fills it.
    fn make_room(&mut self) {
        while self.most.is_none() && self.window() > self.context {
            let half = self.first + (self.context / 2).max(1);
            let words = &self.starts[..self.starts.partition_point(|&s| s < self.ids.len())];
            let next = words.get(words.partition_point(|&s| s < half)).or(words.last().filter(|&&s| s > self.first));
            self.first = next.copied().unwrap_or(half);
            self.read = 0;
        }
    }

    /// Makes the next block, with up to `guesses` guesses; the number of tokens of the window that the model has read.
    pub fn prepare(&mut self, guesses: usize) -> usize {
        self.fill_block(guesses);
        if self.plan.streams() > 1 {
            self.block_without.clone_from(&self.block);
        }
        if let Some(guidance) = self.plan.guidance.filter(|_| self.read == 0 && !self.block.is_empty()) {
            self.block_without[..guidance.without.len()].copy_from_slice(guidance.without);
        }
        self.read
    }

    fn fill_block(&mut self, guesses: usize) {
        self.block.clear();
        self.ahead = 0;
        if self.is_done() {
            return;
        }
        if self.read == 0 {
            self.block.extend_from_slice(self.front);
        }
        self.block.extend_from_slice(&self.ids[self.first + self.read.saturating_sub(self.plan.front.len())..]);
        // a window that begins is read for itself: its rows would all be given logits
        if self.read > 0 {
            self.guess(guesses);
        }
    }

    /// Adds up to `most` guesses to the block, and the given places between them, as long as a free place of the same word
    /// follows and the window has room.
    fn guess(&mut self, most: usize) {
        let before = self.block.len();
        let mut place = self.place;
        for _ in 0..most {
            let whole = self.block.len();
            let mut next = self.guessed_at(place);
            while let Some(id) = next.filter(|&id| id != SPACE) {
                self.block.push(id);
                place = self.plan.grammar.advance(place, id);
                next = self.known(place, self.block.len() - before);
            }
            // the word ends, no token was guessed, or the window is full
            if next.is_some() || self.block.len() == whole || self.window() + self.block.len() - before > self.context {
                self.block.truncate(whole);
                break;
            }
        }
        self.ahead = self.block.len() - before;
    }

    /// The token of the word before.
    fn guessed_at(&self, place: Slot) -> Option<u32> {
        let word = self.words().checked_sub(1)?;
        let id = self.ids[self.starts[word]..self.starts[word + 1]].get(place.tokens).copied();
        id.filter(|&id| self.plan.grammar.allows(place, id))
    }

    /// Weighs what the block holds, by the `logits` (rows, V) of all its tokens, until the first word is whole. All but the
    /// block's first token is given.
    pub fn weigh(&mut self, logits: &[f32], vocabulary: usize) {
        let word = self.plan.grammar.tokens_per_word().unwrap_or(1);
        for (behind, row) in (1..self.block.len()).zip(logits.chunks_exact(vocabulary.max(1))) {
            if let Some(at) = (self.read + behind).checked_sub(self.plan.front.len()) {
                let allowed = self.plan.grammar.allowed(Slot { tokens: at % word, characters: at % word });
                self.likelihood += sampling::log_probability(row, &allowed, self.block[behind]);
            }
        }
        self.weighed = self.words() > 0;
    }

    /// Draws what the block's `logits` (rows, V) are good for: the next free place, and those behind guesses that turn out
    /// right. The rows end with the block.
    pub fn take(&mut self, logits: &[f32], vocabulary: usize) -> Result<()> {
        if self.block.is_empty() {
            return Ok(());
        }
        let (first, front) = (self.first, self.front);
        let (read, start) = (self.window(), self.ids.len());
        let ahead = self.block.split_off(self.block.len() - self.ahead);
        let rows = logits.len() / vocabulary.max(1);
        // tokens ahead that have turned out right
        let mut right = 0;
        loop {
            let row = (rows + right).checked_sub(1 + ahead.len());
            let row = row.and_then(|row| logits.get(row * vocabulary..(row + 1) * vocabulary)).unwrap_or_default();
            let id = self.draw(row)?;
            if let Some(guess) = ahead.get(right) {
                self.guessed += 1;
                self.right += u64::from(*guess == id);
            }
            self.push(id);
            self.advance();
            if self.taken_back.is_some() {
                break;
            }
            // up to the next free place, if the model has read so far
            let drawn = self.ids.len() - start;
            match ahead.get(right..drawn) {
                Some(guessed) if guessed == &self.ids[start + right..] => right = drawn,
                _ => break,
            }
        }
        // a window that has moved, or has another front, is read anew
        if self.first == first && self.front == front {
            self.read = self.taken_back.map_or(read + right, |left| left.min(read + right));
            // a word taken back may begin with a free place, which the token before it speaks for
            self.read = self.read.min(self.window() - 1);
        }
        self.taken_back = None;
        Ok(())
    }

    /// The tokens that stood at this place of the words that a repetition penalty looks back on.
    fn recent(&self, place: usize) -> Vec<u32> {
        let words = self.words();
        let looked_at = words.saturating_sub(self.plan.draw.looks_back())..words;
        looked_at.filter_map(|w| self.ids[self.starts[w]..self.starts[w + 1]].get(place).copied()).collect()
    }

    /// The token of the next place, which is free.
    fn draw(&self, logits: &[f32]) -> Result<u32> {
        let (knows, expected) = (logits.len(), self.plan.grammar.vocabulary());
        if knows != expected as usize {
            let what = "they don't belong together";
            return Err(Error::call(format!("the model knows {knows} tokens, the tokenizer {expected}: {what}")));
        }
        let (word, place) = (self.words(), self.place.tokens);
        let mut rng = kinelm_store::random::stream(self.seed, "character", word as u64, place as u64);
        let recent = self.recent(place);
        self.plan.draw_of(word).pick(logits, &self.plan.grammar.allowed(self.place), &recent, &mut rng).ok_or_else(
            || Error::call(format!("word {word}, place {place}: the model's logits allow no token; the run is broken")),
        )
    }
}
