//! Rollout: a trained network continues from true frames by itself.

use super::run::Trained;
use crate::Result;
use crate::form::{check_finite, steps};
use kinelm_engine::arena::Floats;
use kinelm_engine::lstm::{Lstm, Shape};

/// Steps that are computed at a time.
const AT_ONCE: usize = 50;

impl Trained {
    /// As [`roll_out`].
    ///
    /// # Errors
    /// As [`roll_out`].
    pub(crate) fn roll_out(
        &self,
        seeds: &[&[f64]],
        frames: usize,
        progress: &mut dyn FnMut(usize),
    ) -> Result<Vec<Vec<f64>>> {
        roll_out(self.shape, &self.weights, seeds, frames, progress)
    }
}

/// (F, C) steps that follow each seed; F is `frames`. All seeds have the same number of frames, at least 2: the last step
/// of the hip leads to the last frame.
///
/// The network reads the seed from the zero state, then its own outputs. Each seed gives the same bits in any company.
///
/// # Errors
/// [`crate::Error::NotFinite`] for steps that diverge, with the frame and the channel. `progress` receives the number of
/// frames done.
///
/// # Panics
/// Seeds of different lengths, or shorter than 2 frames.
pub(crate) fn roll_out(
    shape: Shape,
    weights: &[Floats],
    seeds: &[&[f64]],
    frames: usize,
    progress: &mut dyn FnMut(usize),
) -> Result<Vec<Vec<f64>>> {
    let (c, b) = (shape.channels, seeds.len());
    let seeds: Vec<Vec<f64>> = seeds.iter().map(|seed| steps(seed, c)).collect();
    let Some(length) = seeds.first().map(|seed| seed.len() / c) else { return Ok(Vec::new()) };
    assert!(length > 0 && seeds.iter().all(|seed| seed.len() == length * c), "seeds of one length, 2 frames or more");
    let mut lstm = Lstm::new(shape, b, AT_ONCE, false);
    lstm.pack(weights);
    for first in (0..length).step_by(AT_ONCE) {
        let n = AT_ONCE.min(length - first);
        let rows = (first..first + n).flat_map(|t| seeds.iter().flat_map(move |s| &s[t * c..(t + 1) * c]));
        let inputs: Vec<f32> = rows.map(|x| *x as f32).collect();
        lstm.forward(&inputs, &vec![true; n]);
        lstm.carry();
    }
    let mut outputs: Vec<Vec<f64>> = vec![Vec::with_capacity(frames * c); b];
    let mut take = |rows: &[f32]| {
        for (i, row) in rows.chunks_exact(c).enumerate() {
            outputs[i % b].extend(row.iter().map(|x| *x as f64));
        }
    };
    // the seed's last step has predicted the first frame already
    if frames > 0 {
        take(lstm.last_output());
    }
    // steps without ground truth read the network's outputs, and only the size of this
    let no_input = vec![0.0; AT_ONCE * b * c];
    for first in (1..frames).step_by(AT_ONCE) {
        let n = AT_ONCE.min(frames - first);
        take(lstm.forward(&no_input[..n * b * c], &vec![false; n]));
        lstm.carry();
        progress(first + n);
    }
    outputs.iter().try_for_each(|steps| check_finite(steps, c))?;
    Ok(outputs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aclstm::run::RunFile;
    use crate::aclstm::{Config, network};
    use crate::data::Sources;
    use crate::form::Coder;
    use crate::rig::Rig;
    use kinelm_motion::format::ReadOptions;
    use kinelm_motion::{Motion, synth};

    fn untrained() -> (Trained, Vec<f64>) {
        let clip = synth::corpus(4, 1, 4.0, 30.0).unwrap().remove(0).clip;
        let motion = Motion::new("made-up", clip);
        let config = Config { width: 24, layers: 2, ..Config::default() };
        let sources = Sources { data: vec![], labels: vec![], only: vec![], read: ReadOptions::default() };
        let file = RunFile {
            kind: "aclstm".into(),
            version: 1,
            clips_sha256: String::new(),
            rig: Rig::of(&motion),
            config,
            sources,
            files: Default::default(),
            from: None,
        };
        let coder = Coder::new(file.config.form, &file.rig).unwrap();
        let shape = file.config.shape(coder.channels());
        let frames = coder.frames(&motion.clip);
        let weights = network::initial(&shape, 1);
        let (step, sha256, notes) = (0, String::new(), vec![]);
        (Trained { run: "run".into(), file, coder, shape, weights, step, sha256, notes }, frames)
    }

    #[test]
    fn seeds_side_by_side_give_what_each_gives_alone_for_any_length() {
        let (trained, frames) = untrained();
        let c = trained.shape.channels;
        let seeds: Vec<&[f64]> = [0, 7, 20].iter().map(|first| &frames[first * c..(first + 61) * c]).collect();
        let together = trained.roll_out(&seeds, 120, &mut |_| ()).unwrap();
        for (seed, made) in seeds.iter().zip(&together) {
            let alone = trained.roll_out(&[seed], 130, &mut |_| ()).unwrap().remove(0);
            assert!(alone[..120 * c] == made[..], "side by side");
            assert_eq!(alone.len(), 130 * c);
        }
        assert_ne!(together[0], together[1]);
        assert!(trained.roll_out(&[], 9, &mut |_| ()).unwrap().is_empty());
        assert_eq!(trained.roll_out(&seeds[..1], 0, &mut |_| ()).unwrap(), [Vec::<f64>::new()]);
    }

    #[test]
    fn a_network_that_diverges_is_refused() {
        let (mut trained, frames) = untrained();
        trained.weights.iter_mut().for_each(|w| w.fill(f32::NAN));
        let seed = &frames[..40 * trained.shape.channels];
        let message = trained.roll_out(&[seed], 9, &mut |_| ()).unwrap_err().to_string();
        assert_eq!(message, "frame 0, channel 0: found NaN, expected a number");
    }
}
