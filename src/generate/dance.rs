//! One dance being drawn: what of its window the model has read, what it reads next, what is drawn from the logits.

use super::Plan;
use crate::{Error, Result};
use std::ops::Range;

pub(super) struct Dance<'a> {
    plan: &'a Plan<'a>,
    seed: u64,
    /// Words that a window holds.
    most: usize,
    /// What is known: drawn, given, spaces. Behind it stands a free place, or nothing.
    ids: Vec<u32>,
    /// The window's first frame.
    first: usize,
    /// Tokens of the window that the model has read.
    read: usize,
    /// What the model reads next: what it hasn't of the window, then the guesses.
    block: Vec<u32>,
    /// Tokens of the block that are guesses, or given places between them.
    ahead: usize,
    /// Characters guessed so far, and those that were right.
    pub guessed: u64,
    pub right: u64,
}

impl<'a> Dance<'a> {
    pub fn new(plan: &'a Plan<'a>, seed: u64, most: usize) -> Self {
        let ids = Vec::with_capacity(plan.frames * (plan.given.len() + 1));
        let mut dance =
            Dance { plan, seed, most, ids, first: 0, read: 0, block: Vec::new(), ahead: 0, guessed: 0, right: 0 };
        dance.advance();
        dance
    }

    /// W.
    fn word(&self) -> usize {
        self.plan.given.len() + 1
    }

    /// Whole frames.
    pub fn frames(&self) -> usize {
        self.ids.len() / self.word()
    }

    pub fn is_done(&self) -> bool {
        self.frames() == self.plan.frames
    }

    pub fn into_ids(self) -> Vec<u32> {
        self.ids
    }

    /// What the model reads next; nothing when the dance is done.
    pub fn block(&self) -> &[u32] {
        &self.block
    }

    /// Whether there are guesses in the block.
    pub fn guesses(&self) -> bool {
        self.ahead > 0
    }

    /// Tokens of the window: the front token and the words from its first on.
    fn window(&self) -> usize {
        1 + self.ids.len() - self.first * self.word()
    }

    /// The given character at a place, if it is given there.
    fn given(&self, frame: usize, place: usize) -> Option<u32> {
        let word = self.plan.prompt.chunks_exact(self.word()).nth(frame)?;
        self.plan.given[place].then(|| word[place])
    }

    /// Adds what is known up to the next free place. A window that is full moves when the next word begins.
    fn advance(&mut self) {
        while !self.is_done() {
            let (frame, place) = (self.frames(), self.ids.len() % self.word());
            if place == 0 && frame - self.first == self.most {
                self.first = frame - (self.most - self.most / 2);
                self.read = 0;
            }
            let known = match place == self.plan.given.len() {
                true => Some(self.plan.space),
                false => self.given(frame, place),
            };
            match known {
                Some(id) => self.ids.push(id),
                None => return,
            }
        }
    }

    /// Makes the next block, with up to `guesses` guesses; the number of tokens of the window that the model has read.
    pub fn prepare(&mut self, guesses: usize) -> usize {
        self.block.clear();
        self.ahead = 0;
        if self.is_done() {
            return self.read;
        }
        let start = self.first * self.word();
        if self.read == 0 {
            self.block.push(self.plan.bos);
        }
        self.block.extend_from_slice(&self.ids[start + self.read.max(1) - 1..]);
        // a window that begins is read for itself: its rows would all be given logits
        if self.read > 0 {
            self.guess(guesses);
        }
        self.read
    }

    /// Adds up to `most` guesses to the block, and the given places between them, as long as a free place of the same word
    /// follows.
    fn guess(&mut self, most: usize) {
        let (frame, c) = (self.frames(), self.plan.given.len());
        let before = self.block.len();
        let mut place = self.ids.len() % self.word();
        for _ in 0..most {
            let Some(id) = self.guessed_at(frame, place) else { break };
            let Some(next) = (place + 1..c).find(|&p| self.given(frame, p).is_none()) else { break };
            self.block.push(id);
            self.block.extend((place + 1..next).filter_map(|p| self.plan.prompt.get(frame * (c + 1) + p)));
            place = next;
        }
        self.ahead = self.block.len() - before;
    }

    /// The character of the frame before.
    fn guessed_at(&self, frame: usize, place: usize) -> Option<u32> {
        self.ids.get(frame.checked_sub(1)? * self.word() + place).copied()
    }

    /// Draws what the block's `logits` (rows, V) are good for: the next free place, and those behind guesses that turn out
    /// right. The rows end with the block.
    pub fn take(&mut self, logits: &[f32], vocabulary: usize) -> Result<()> {
        if self.block.is_empty() {
            return Ok(());
        }
        let (first, read, start) = (self.first, self.window(), self.ids.len());
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
            self.ids.push(id);
            self.advance();
            // up to the next free place, if the model has read so far
            let drawn = self.ids.len() - start;
            match ahead.get(right..drawn) {
                Some(guessed) if guessed == &self.ids[start + right..] => right = drawn,
                _ => break,
            }
        }
        // a window that has moved is read anew
        if self.first == first {
            self.read = read + right;
        }
        Ok(())
    }

    /// The character of the next place, which is free.
    fn draw(&self, logits: &[f32]) -> Result<u32> {
        let (frame, place) = (self.frames(), self.ids.len() % self.word());
        let Range { start, end } = self.plan.characters.clone();
        let allowed = logits.get(start as usize..end as usize).ok_or_else(|| {
            let knows = logits.len();
            Error::Call(format!("the model knows {knows} tokens, the tokenizer {end}: they don't belong together"))
        })?;
        let mut rng = crate::random::stream(self.seed, "character", frame as u64, place as u64);
        let drawn = self.plan.draw.pick(allowed, &mut rng).ok_or_else(|| {
            Error::Call(format!("frame {frame}, place {place}: the model's logits are not finite; the run is broken"))
        })?;
        Ok(start + drawn as u32)
    }
}
