//! Conditioning of frames beside the tokens read: goals and music.

use super::add_row;
use super::numbers::Numbers;
use crate::{ModelConfig, goal, layout};
use kinelm_engine::arena::Floats;
use kinelm_engine::op::embedding::NONE;

/// Goal conditioning of one frame: C characters and an end make it, W = C + 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameConditioning<'a> {
    /// (P) numbers, which a matrix each brings to the trunk's row and to the frame decoder's rows.
    pub numbers: &'a [f32],
    /// (W) each: a row of either table for every row of the frame decoder; [`NONE`] adds nothing.
    pub rows: [&'a [u32]; 2],
}

/// The conditioning of the frames of all streams, and its weights.
pub(super) struct Conditioning {
    /// F, W, and the numbers of goals and of music: P = G + M, 0 without conditioning.
    frames: usize,
    word: usize,
    goal: usize,
    numbers_per_frame: usize,
    /// (streams, F); the rest is empty without conditioning.
    is_set: Vec<bool>,
    /// (streams, F, P).
    numbers: Vec<f32>,
    /// (streams, F, W) each.
    rows: [Vec<u32>; 2],
    /// (P, D) and (P, d).
    pub trunk: Floats,
    pub decoder: Floats,
    /// (R, d) each.
    tables: [Floats; 2],
}

/// The conditioning of a stream's frames.
#[derive(Debug, Clone)]
pub(super) struct SavedConditioning {
    is_set: Vec<bool>,
    numbers: Vec<f32>,
    rows: [Vec<u32>; 2],
}

impl Conditioning {
    pub fn new(numbers: &Numbers, config: &ModelConfig, streams: usize, frames: usize, word: usize) -> Conditioning {
        let [trunk, decoder, tables @ ..] = layout::GOAL.map(|name| numbers.optional(name));
        let [trunk_music, decoder_music] = layout::MUSIC.map(|name| numbers.optional(name));
        let goal = if config.goal { goal::numbers(word - 1) } else { 0 };
        let numbers_per_frame = goal + config.music.numbers();
        let all = if numbers_per_frame > 0 { streams * frames } else { 0 };
        Conditioning {
            frames,
            word,
            goal,
            numbers_per_frame,
            is_set: vec![false; all],
            numbers: vec![0.0; all * numbers_per_frame],
            rows: [(); 2].map(|()| vec![NONE; all * word]),
            trunk: Floats::of(&[trunk, trunk_music].concat()),
            decoder: Floats::of(&[decoder, decoder_music].concat()),
            tables: tables.map(Floats::of),
        }
    }

    /// Sets the conditioning of a frame; nothing is set where there is neither a goal nor music.
    pub fn set(&mut self, stream: usize, frame: usize, goal: Option<FrameConditioning>, music: &[f32]) {
        assert!(frame < self.frames, "frame {frame} of {}", self.frames);
        if self.numbers_per_frame == 0 {
            return;
        }
        let at = stream * self.frames + frame;
        self.is_set[at] = goal.is_some() || !music.is_empty();
        let numbers = &mut self.numbers[at * self.numbers_per_frame..][..self.numbers_per_frame];
        // `clear` only lowers the flags: numbers of an earlier setting may still be here
        numbers.fill(0.0);
        if let Some(goal) = goal {
            numbers[..self.goal].copy_from_slice(goal.numbers);
        }
        if !music.is_empty() {
            numbers[self.goal..].copy_from_slice(music);
        }
        for (i, rows) in self.rows.iter_mut().enumerate() {
            let rows = &mut rows[at * self.word..][..self.word];
            match goal {
                Some(goal) => rows.copy_from_slice(goal.rows[i]),
                None => rows.fill(NONE),
            }
        }
    }

    /// Frames of a stream from `first` on have no conditioning.
    pub fn clear(&mut self, stream: usize, first: usize) {
        if let Some(frames) = self.is_set.get_mut(stream * self.frames..(stream + 1) * self.frames) {
            frames[first.min(self.frames)..].fill(false);
        }
    }

    /// The conditioning of a stream's frames, for another stream.
    pub fn save(&self, stream: usize) -> SavedConditioning {
        SavedConditioning {
            is_set: of_stream(&self.is_set, stream, self.frames).to_vec(),
            numbers: of_stream(&self.numbers, stream, self.frames * self.numbers_per_frame).to_vec(),
            rows: self.rows.each_ref().map(|rows| of_stream(rows, stream, self.frames * self.word).to_vec()),
        }
    }

    /// Gives a stream's frames the conditioning of another's.
    pub fn restore(&mut self, stream: usize, saved: &SavedConditioning) {
        put(&mut self.is_set, stream, &saved.is_set);
        put(&mut self.numbers, stream, &saved.numbers);
        self.rows.iter_mut().zip(&saved.rows).for_each(|(rows, saved)| put(rows, stream, saved));
    }

    /// Whether a frame has conditioning.
    fn is_set(&self, stream: usize, frame: usize) -> bool {
        self.is_set.get(stream * self.frames + frame).is_some_and(|is| *is)
    }

    /// Adds a frame's numbers times `matrix` (P, n), one of the weights, to `x` (n).
    pub fn add(&self, x: &mut [f32], stream: usize, frame: usize, matrix: &[f32]) {
        if !self.is_set(stream, frame) {
            return;
        }
        let numbers =
            &self.numbers[(stream * self.frames + frame) * self.numbers_per_frame..][..self.numbers_per_frame];
        // most numbers are 0 and cost nothing: a slot without a goal has four
        for (&number, row) in numbers.iter().zip(matrix.chunks_exact(x.len())).filter(|(number, _)| **number != 0.0) {
            x.iter_mut().zip(row).for_each(|(x, y)| *x += number * y);
        }
    }

    /// Adds the rows of both tables to the row `x` (d) of a slot of a frame.
    pub fn add_rows(&self, x: &mut [f32], stream: usize, frame: usize, slot: usize) {
        if !self.is_set(stream, frame) {
            return;
        }
        for (rows, table) in self.rows.iter().zip(&self.tables) {
            let row = rows[(stream * self.frames + frame) * self.word + slot];
            if row != NONE {
                add_row(x, table, row as usize);
            }
        }
    }
}

/// The part of a stream in `all`, `each` long; empty where there is no conditioning.
fn of_stream<T>(all: &[T], stream: usize, each: usize) -> &[T] {
    all.get(stream * each..(stream + 1) * each).unwrap_or_default()
}

/// Puts the part of a stream.
fn put<T: Copy>(all: &mut [T], stream: usize, saved: &[T]) {
    all[stream * saved.len()..][..saved.len()].copy_from_slice(saved);
}
