//! The sequences of an update: a random clip, from a random frame on, turned by a random angle. Those of a measurement: spread
//! evenly, as they are.

use crate::aclstm::Config;
use crate::aclstm::sequences::Sequences;
use crate::form::{Coder, steps};
use crate::train::spread;
use kinelm_store::random;
use rand_chacha::rand_core::RngCore;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Sequences of one pass.
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
    let c = coder.channels();
    let one = |index: usize| -> (usize, Vec<f64>) {
        let mut rng = random::stream(config.seed, "aclstm batch", step, index as u64);
        let clip = (rng.next_u64() % sequences.clips.len() as u64) as usize;
        let first = (rng.next_u64() % sequences.room(clip, c, config.length) as u64) as usize;
        let angle = TAU * random::unit(&mut rng) - TAU / 2.0;
        let mut sequence = sequences.frames(clip, c, config.length, first);
        if config.turn {
            sequence.chunks_exact_mut(c).for_each(|frame| coder.turn(frame, angle));
        }
        (clip, steps(&sequence, c))
    };
    assembled(&(0..config.batch).into_par_iter().map(one).collect::<Vec<_>>(), c, config)
}

/// The sequences of a measurement: spread evenly over the clips, not turned.
pub fn held_out(sequences: &Sequences, coder: &Coder, config: &Config) -> Batch {
    let c = coder.channels();
    let rooms: Vec<usize> = (0..sequences.clips.len()).map(|clip| sequences.room(clip, c, config.length)).collect();
    let at = |(clip, first)| (clip, steps(&sequences.frames(clip, c, config.length, first), c));
    assembled(&spread(config.batch, &rooms).into_iter().map(at).collect::<Vec<_>>(), c, config)
}

/// Sequences of T + 1 steps side by side.
fn assembled(sampled: &[(usize, Vec<f64>)], c: usize, config: &Config) -> Batch {
    let (t, b) = (config.length, config.batch);
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
