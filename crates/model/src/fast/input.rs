//! What is added to a token's vector, and the word whose angle rotates it: rows of tables, for batches of one shape.

use crate::config::{ModelConfig, Positions, TokenLayout};
use crate::position::Counter;
use crate::previous::PreviousFrames;
use kinelm_engine::op::embedding::NONE;
use kinelm_engine::op::rope::{Angles, Rope};

/// The most tables: front, frame and place, character and step one frame back.
pub(super) const TABLES: usize = 5;

/// The tables, and the row of each that an input takes.
pub(super) struct Inputs {
    /// Without the token's own; (T), or (N) where the tokens decide.
    tables: Vec<(&'static str, Vec<u32>)>,
    counter: Option<Counter>,
    /// Where `tables` has the words of [`Inputs::counter`], if they have a table, and the places.
    word_table: Option<usize>,
    place_table: usize,
    /// Where it has the character one frame back, and what reads it.
    previous_frames: Option<(usize, PreviousFrames)>,
    turns: Option<Turns>,
}

/// The rotary embedding of queries and keys.
struct Turns {
    angles: Angles,
    /// As the tables' rows: 0 in front, 1 in the first word.
    words: Vec<u32>,
}

impl Inputs {
    pub fn new(config: &ModelConfig, tokens: &TokenLayout, rows: usize, length: usize) -> Inputs {
        let front = (0..length).map(|i| if i < tokens.front { i as u32 } else { NONE });
        let counter = Counter::of(config, tokens);
        // where ids don't decide positions, one window's rows serve all: lookups repeat shorter lists
        let decided = if counter.is_some_and(Counter::reads) { rows } else { length };
        let none = |n: usize| vec![NONE; n];
        let mut tables = match config.positions {
            Positions::Absolute => vec![("position.absolute.weight", (0..length as u32).collect())],
            _ => vec![("position.front.weight", front.collect()), ("position.place.weight", none(decided))],
        };
        let place_table = tables.len() - 1;
        let word_table = (config.positions == Positions::FrameJoint).then(|| {
            tables.push(("position.frame.weight", none(decided)));
            tables.len() - 1
        });
        let previous_frames = config.reads_previous(tokens).then(|| {
            tables.extend(["previous.character.weight", "previous.step.weight"].map(|name| (name, none(rows))));
            (tables.len() - 2, PreviousFrames::new(tokens, tokens.front))
        });
        let turns = (config.positions == Positions::Rope).then(|| Turns {
            // words of varying length may have one token each, and 0 is the front
            angles: Angles::new(length + 1, config.width / config.heads),
            words: none(decided),
        });
        let mut inputs = Inputs { tables, counter, word_table, place_table, previous_frames, turns };
        if let Some(counter) = counter.filter(|c| !c.reads()) {
            inputs.count(counter, &vec![tokens.pad; length], length);
        }
        inputs
    }

    /// Takes what `ids` (B, T), T = `length`, decide.
    pub fn read(&mut self, ids: &[u32], length: usize) {
        if let Some(counter) = self.counter.filter(|c| c.reads()) {
            self.count(counter, ids, length);
        }
        let Some((at, previous_frames)) = &self.previous_frames else { return };
        let [(_, characters), (_, steps)] = &mut self.tables[*at..*at + 2] else { return };
        for (row, (character, step)) in characters.iter_mut().zip(steps).enumerate() {
            let (window, i) = (row / length * length, row % length);
            [*character, *step] = previous_frames.previous(&ids[window..window + length], i);
        }
    }

    fn count(&mut self, counter: Counter, ids: &[u32], length: usize) {
        // the table of words is pushed right after that of places, so it is the first of the rest
        let (places, words) = self.tables.split_at_mut(self.place_table + 1);
        let (_, places) = &mut places[self.place_table];
        let words = match (&mut self.turns, self.word_table) {
            (Some(turns), _) => &mut turns.words,
            (None, Some(_)) => &mut words[0].1,
            (None, None) => return,
        };
        let windows = ids.chunks(length).zip(words.chunks_mut(length).zip(places.chunks_mut(length)));
        for (window, (words, places)) in windows {
            words.fill(NONE);
            counter.count(window, words, places);
        }
        if let Some(turns) = &mut self.turns {
            // angle 0 is no rotation: for tokens of the front, which belong to no word
            turns.words.iter_mut().for_each(|word| *word = if *word == NONE { 0 } else { *word + 1 });
        }
    }

    /// The tables and their rows.
    pub fn tables(&self) -> &[(&'static str, Vec<u32>)] {
        &self.tables
    }

    /// The rotary embedding of queries and keys.
    pub fn rope(&self) -> Option<Rope<'_>> {
        self.turns.as_ref().map(|Turns { angles, words }| Rope { angles, words })
    }
}
