//! The sequences of an update: a random clip, from a random frame on, turned by a random angle.

use crate::aclstm::Config;
use crate::aclstm::sequences::Sequences;
use crate::form::{Coder, steps};
use kinelm_store::random;
use rand_chacha::rand_core::RngCore;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// The sequences of an update.
pub struct Batch {
    /// (T, B, C) true steps.
    pub inputs: Vec<f32>,
    /// (T, B, C) the next ones.
    pub targets: Vec<f32>,
    /// (B) the clips.
    pub clips: Vec<usize>,
}

/// The sequences of update `step`, counted from 0: a function of the seed and the step.
pub fn batch(sequences: &Sequences, coder: &Coder, config: &Config, step: u64) -> Batch {
    let (c, t, b) = (coder.channels(), config.length, config.batch);
    let one = |index: usize| -> (usize, Vec<f64>) {
        let mut rng = random::stream(config.seed, "aclstm batch", step, index as u64);
        let clip = (rng.next_u64() % sequences.clips.len() as u64) as usize;
        let (frames, stride, _) = &sequences.clips[clip];
        // T inputs, the target of the last, and the frame that the last step leads to
        let span = (t + 1) * stride + 1;
        let first = (rng.next_u64() % (frames.len() / c - span + 1) as u64) as usize;
        let angle = TAU * random::unit(&mut rng) - TAU / 2.0;
        let rows = frames[first * c..(first + span) * c].chunks_exact(c).step_by(*stride);
        let mut sequence: Vec<f64> = rows.flatten().map(|x| *x as f64).collect();
        if config.turn {
            sequence.chunks_exact_mut(c).for_each(|frame| coder.turn(frame, angle));
        }
        (clip, steps(&sequence, c))
    };
    let sampled: Vec<(usize, Vec<f64>)> = (0..b).into_par_iter().map(one).collect();
    let mut batch = Batch { inputs: vec![0.0; t * b * c], targets: vec![0.0; t * b * c], clips: Vec::new() };
    for (i, (clip, sequence)) in sampled.iter().enumerate() {
        batch.clips.push(*clip);
        // targets are the same steps, one later
        for (late, to) in [&mut batch.inputs, &mut batch.targets].into_iter().enumerate() {
            let rows = to.chunks_exact_mut(c).skip(i).step_by(b);
            for (to, from) in rows.zip(sequence[late * c..].chunks_exact(c)) {
                to.iter_mut().zip(from).for_each(|(to, from)| *to = *from as f32);
            }
        }
    }
    batch
}
