//! What frames are told beside what was read.

use crate::arena::Floats;
use crate::op::embedding::NONE;

/// What one frame is told: C characters and an end make it, W = C + 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameConditioning<'a> {
    /// (P) numbers, which the trunk's row of the frame and its rows of the speller are told through a matrix each.
    pub numbers: &'a [f32],
    /// (W) each: a row of either table for every row of the speller; [`NONE`] adds nothing.
    pub rows: [&'a [u32]; 2],
}

/// What the frames of all streams are told.
pub(super) struct ConditionedFrames {
    /// F.
    frames: usize,
    /// P.
    width: usize,
    /// W.
    word: usize,
    /// (streams, F); the rest is empty where the model can't be told.
    is_told: Vec<bool>,
    /// (streams, F, P).
    numbers: Vec<f32>,
    /// (streams, F, W) each.
    rows: [Vec<u32>; 2],
}

impl ConditionedFrames {
    /// Of so many streams and frames; `width` numbers a frame, 0 where it can't be told.
    pub fn new((streams, frames): (usize, usize), width: usize, word: usize) -> ConditionedFrames {
        let all = if width > 0 { streams * frames } else { 0 };
        ConditionedFrames {
            frames,
            width,
            word,
            is_told: vec![false; all],
            numbers: vec![0.0; all * width],
            rows: [(); 2].map(|()| vec![NONE; all * word]),
        }
    }

    /// # Panics
    /// What is told has another shape, or a row beyond `steps`; a model that can't be told.
    pub fn condition(&mut self, stream: usize, frame: usize, conditioning: Option<FrameConditioning>, steps: usize) {
        assert!(frame < self.frames, "frame {frame} of {}", self.frames);
        if self.width == 0 {
            assert!(conditioning.is_none(), "a model that can't be told");
            return;
        }
        let at = stream * self.frames + frame;
        self.is_told[at] = conditioning.is_some();
        let Some(conditioning) = conditioning else { return };
        self.numbers[at * self.width..][..self.width].copy_from_slice(conditioning.numbers);
        for (own, rows) in self.rows.iter_mut().zip(conditioning.rows) {
            assert!(rows.iter().all(|&row| row == NONE || (row as usize) < steps), "rows of {steps} steps");
            own[at * self.word..][..self.word].copy_from_slice(rows);
        }
    }

    /// Frames of a stream from `first` on are told nothing.
    pub fn forget(&mut self, stream: usize, first: usize) {
        if let Some(frames) = self.is_told.get_mut(stream * self.frames..(stream + 1) * self.frames) {
            frames[first.min(self.frames)..].fill(false);
        }
    }

    /// Adds what a frame's numbers times `matrix` (P, n) give to `x` (n).
    pub fn add(&self, x: &mut [f32], (stream, frame): (usize, usize), matrix: &[f32]) {
        let at = stream * self.frames + frame;
        if !self.is_told[at] {
            return;
        }
        let numbers = &self.numbers[at * self.width..][..self.width];
        for (&number, row) in numbers.iter().zip(matrix.chunks_exact(x.len())).filter(|(number, _)| **number != 0.0) {
            x.iter_mut().zip(row).for_each(|(x, y)| *x += number * y);
        }
    }

    /// Adds the rows of both tables (R, d) to the row `x` (d) of a place of a frame.
    pub fn add_rows(&self, x: &mut [f32], (stream, frame): (usize, usize), place: usize, tables: &[Floats; 2]) {
        let at = stream * self.frames + frame;
        if !self.is_told[at] {
            return;
        }
        for (rows, table) in self.rows.iter().zip(tables) {
            let row = rows[at * self.word + place];
            if row != NONE {
                let row = &table[row as usize * x.len()..][..x.len()];
                x.iter_mut().zip(row).for_each(|(x, y)| *x += y);
            }
        }
    }
}
