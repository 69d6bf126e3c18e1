//! The input of the first block: a vector for the token, its position and its previous-frame features.

use super::rotary::Rotary;
use super::{rows_of, table};
use crate::config::{ModelConfig, Positions, TokenLayout};
use crate::position::Counter;
use crate::previous::PreviousFrames;
use candle_core::{Result, Tensor};
use candle_nn::{Embedding, Module, VarBuilder};
use std::ops::Range;

#[derive(Clone)]
pub(super) struct Input {
    token: Embedding,
    position: Position,
    previous: Option<Previous>,
}

/// How a token's position is embedded.
#[derive(Clone)]
enum Position {
    Absolute(Tensor),
    /// Tables of the front, of words (with turns: none) and of places.
    Words {
        front: Tensor,
        frame: Option<Embedding>,
        place: Embedding,
        counter: Counter,
    },
}

/// How the previous frame is embedded.
#[derive(Clone)]
struct Previous {
    character: Embedding,
    step: Embedding,
    previous_frames: PreviousFrames,
}

impl Input {
    pub fn new(config: &ModelConfig, tokens: &TokenLayout, vars: &VarBuilder) -> Result<Input> {
        let position = match Counter::of(config, tokens) {
            None => Position::Absolute(vars.get_unchecked("position.absolute.weight")?),
            Some(counter) => Position::Words {
                front: vars.get_unchecked("position.front.weight")?,
                frame: match config.positions {
                    Positions::FrameJoint => Some(table(vars, "position.frame.weight")?),
                    _ => None,
                },
                place: table(vars, "position.place.weight")?,
                counter,
            },
        };
        let previous = match config.reads_previous(tokens) {
            true => Some(Previous {
                character: table(vars, "previous.character.weight")?,
                step: table(vars, "previous.step.weight")?,
                previous_frames: PreviousFrames::new(tokens, tokens.front),
            }),
            false => None,
        };
        Ok(Input { token: table(vars, "token.weight")?, position, previous })
    }

    /// The rows (B, n, D) of `ids` (B, n), the last of each of `windows`, after `before` others.
    pub fn forward(&self, ids: &Tensor, windows: &[Vec<u32>], before: usize) -> Result<Tensor> {
        let (batch, n) = ids.dims2()?;
        let x = self.token.forward(ids)?.broadcast_add(&self.position.rows(windows, before)?)?;
        let Some(Previous { character, step, previous_frames }) = &self.previous else { return Ok(x) };
        let rows = windows.iter().flat_map(|w| (before..w.len()).map(|i| previous_frames.previous(w, i)));
        let (characters, steps): (Vec<u32>, Vec<u32>) = rows.map(|[a, step]| (a, step)).unzip();
        let added = (rows_of(character, characters)? + rows_of(step, steps)?)?;
        x + added.reshape((batch, n, ()))?
    }

    /// The rotary embedding of queries and keys of heads of `width` numbers, if there is one.
    pub fn rotary(&self, windows: &[Vec<u32>], before: usize, width: usize) -> Result<Option<Rotary>> {
        let Position::Words { frame: None, counter, front, .. } = &self.position else { return Ok(None) };
        let (windows, length) = seen(*counter, windows);
        // tokens of the front belong to no word: angle 0 is no rotation
        let number = |i: usize, word: u32| if i < front.dims()[0] { 0 } else { word + 1 };
        let words = windows.iter().flat_map(|w| {
            let (words, _) = counted(*counter, w);
            (before..length).map(move |i| number(i, words[i]))
        });
        let words: Vec<u32> = words.collect();
        Rotary::new(&words, windows.len(), width, self.token.embeddings().dtype(), self.token.embeddings().device())
            .map(Some)
    }
}

impl Position {
    /// (b, n, D) of the places `before..` of `windows`; b is 1 where all windows have the same.
    fn rows(&self, windows: &[Vec<u32>], before: usize) -> Result<Tensor> {
        let (front, frame, place, counter) = match self {
            Position::Absolute(table) => return table.narrow(0, before, windows[0].len() - before)?.unsqueeze(0),
            Position::Words { front, frame, place, counter } => (front, frame, place, *counter),
        };
        let (windows, length) = seen(counter, windows);
        let all = front.dim(0)?;
        let (fronts, after) = (before.min(all)..length.min(all), before.max(all)..length);
        let mut parts = Vec::new();
        if !fronts.is_empty() {
            let rows = front.narrow(0, fronts.start, fronts.len())?.unsqueeze(0)?;
            parts.push(rows.broadcast_as((windows.len(), fronts.len(), front.dim(1)?))?.contiguous()?);
        }
        if !after.is_empty() {
            let (words, places) = all_counted(counter, windows, after.clone());
            let mut rows = rows_of(place, places)?;
            if let Some(frame) = frame {
                rows = (rows_of(frame, words)? + rows)?;
            }
            parts.push(rows.reshape((windows.len(), after.len(), ()))?);
        }
        Tensor::cat(&parts, 1)
    }
}

/// The windows whose tokens decide positions (the first where a token's index alone does), and their length.
fn seen(counter: Counter, windows: &[Vec<u32>]) -> (&[Vec<u32>], usize) {
    (if counter.reads() { windows } else { &windows[..1] }, windows[0].len())
}

fn counted(counter: Counter, window: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let (mut words, mut places) = (vec![0; window.len()], vec![0; window.len()]);
    counter.count(window, &mut words, &mut places);
    (words, places)
}

/// Words and places of the tokens `range` of all windows.
fn all_counted(counter: Counter, windows: &[Vec<u32>], range: Range<usize>) -> (Vec<u32>, Vec<u32>) {
    let (mut words, mut places) = (Vec::new(), Vec::new());
    for window in windows {
        let (w, p) = counted(counter, window);
        words.extend_from_slice(&w[range.clone()]);
        places.extend_from_slice(&p[range.clone()]);
    }
    (words, places)
}
