//! A trained network that goes on from true frames by itself.

use super::form::{check_finite, steps};
use super::run::Trained;
use crate::Result;
use kinelm_engine::lstm::Lstm;

/// Steps that are computed at a time: what the memory is for.
const AT_ONCE: usize = 50;

impl Trained {
    /// What follows each of some seeds, (F, C) steps, `frames` of them. All seeds have the same number of frames, at least 2:
    /// the hip's steps need the one behind.
    ///
    /// The network is driven by the seed from rest; from there on it sees its own steps, as they come out of it. Seeds side
    /// by side give the bits that each one gives alone.
    ///
    /// # Errors
    /// [`crate::Error::NotFinite`] for steps that run away, with the frame and the channel; `progress` is told the frames done.
    ///
    /// # Panics
    /// Seeds of different lengths, or shorter than 2 frames.
    pub fn go_on(&self, seeds: &[&[f64]], frames: usize, progress: &mut dyn FnMut(usize)) -> Result<Vec<Vec<f64>>> {
        let (c, b) = (self.shape.channels, seeds.len());
        let seeds: Vec<Vec<f64>> = seeds.iter().map(|seed| steps(seed, c)).collect();
        let Some(length) = seeds.first().map(|seed| seed.len() / c) else { return Ok(Vec::new()) };
        assert!(
            length > 0 && seeds.iter().all(|seed| seed.len() == length * c),
            "seeds of one length, 2 frames or more"
        );
        let mut lstm = Lstm::new(self.shape, b, AT_ONCE, false);
        lstm.pack(&self.weights);
        for first in (0..length).step_by(AT_ONCE) {
            let n = AT_ONCE.min(length - first);
            let rows = (first..first + n).flat_map(|t| seeds.iter().flat_map(move |s| &s[t * c..(t + 1) * c]));
            let inputs: Vec<f32> = rows.map(|x| *x as f32).collect();
            lstm.forward(&inputs, &vec![true; n]);
            lstm.carry();
        }
        let mut made: Vec<Vec<f64>> = vec![Vec::with_capacity(frames * c); b];
        let mut take = |outputs: &[f32]| {
            for (i, row) in outputs.chunks_exact(c).enumerate() {
                made[i % b].extend(row.iter().map(|x| *x as f64));
            }
        };
        if frames > 0 {
            take(lstm.last_output());
        }
        let nothing = vec![0.0; AT_ONCE * b * c];
        for first in (1..frames).step_by(AT_ONCE) {
            let n = AT_ONCE.min(frames - first);
            take(lstm.forward(&nothing[..n * b * c], &vec![false; n]));
            lstm.carry();
            progress(first + n);
        }
        made.iter().try_for_each(|made| check_finite(made, c))?;
        Ok(made)
    }
}
