//! Bits a frame that a model needs for clips it is shown: PROTOCOLS 2.5.

use crate::corpus::{ClipRecord, Corpus, EvalWindow, eval_windows, fill_sequence};
use crate::model::workers::Workers;
use crate::model::{Gpt, ops};
use crate::{Error, Result};
use candle_core::{Device, Tensor};
use serde::Serialize;

/// What a model makes of some clips.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Likelihood {
    /// Bits of all scored tokens, spaces included, divided by their frames.
    pub bits_per_frame: f64,
    /// Nats of all scored tokens divided by their number.
    pub nats_per_token: f64,
    /// Tokens that were scored.
    pub tokens: usize,
    /// Windows they stood in.
    pub windows: usize,
    /// Windows there are; more than `windows` where a limit was set.
    pub all_windows: usize,
}

/// Bits a frame of `model` on `clips`, `None` where they have no frame.
///
/// Windows hold as many whole words as the context does and move by half of them; of each only what the one before has
/// not scored counts. With `most` above 0, at most so many windows are taken, spread evenly. The number of threads in
/// `workers` changes nothing.
///
/// # Errors
/// A corpus of other words than the model's; a model whose probabilities are not finite, with the clip named.
pub fn likelihood(
    model: &Gpt,
    corpus: &Corpus,
    clips: &[&ClipRecord],
    most: usize,
    workers: &Workers,
) -> Result<Option<Likelihood>> {
    let word = corpus.tokens_per_frame();
    if (word, corpus.manifest().vocabulary) != (model.tokens().word, model.tokens().vocabulary) {
        return Err(Error::Call(format!(
            "the corpus has words of {word} tokens from {} ids, the model was trained on words of {} from {}; make the \
             corpus with the run's tokenizer",
            corpus.manifest().vocabulary,
            model.tokens().word,
            model.tokens().vocabulary
        )));
    }
    let all = eval_windows(clips.iter().map(|c| c.frames), model.config().context, word)?;
    let taken: Vec<&EvalWindow> = match most {
        0 => all.iter().collect(),
        most if most >= all.len() => all.iter().collect(),
        most => (0..most).map(|i| &all[i * all.len() / most]).collect(),
    };
    let (mut nats, mut tokens) = (0.0, 0);
    let work = |i: usize| {
        let window = taken[i];
        let clip = clips[window.clip];
        let ids = corpus.frame_ids(clip, window.frame..window.frame + window.frames);
        window_nats(model, &ids, window)
    };
    workers.each(taken.len(), &work, &mut |i, value| {
        if !value.is_finite() {
            let window = taken[i];
            let clip = &clips[window.clip].name;
            return Err(Error::Call(format!("{clip} from frame {}: {value} nats", window.frame)));
        }
        nats += value;
        tokens += taken[i].scored.len();
        Ok(())
    })?;
    let bits_per_frame = nats / std::f64::consts::LN_2 / (tokens as f64 / word as f64);
    let nats_per_token = nats / tokens as f64;
    let found = Likelihood { bits_per_frame, nats_per_token, tokens, windows: taken.len(), all_windows: all.len() };
    Ok((tokens > 0).then_some(found))
}

/// Nats of the scored tokens of one window.
fn window_nats(model: &Gpt, ids: &[u32], window: &EvalWindow) -> Result<f64> {
    let tokens = model.tokens();
    let (mut inputs, mut targets) = (vec![0; ids.len()], vec![0; ids.len()]);
    fill_sequence(ids, tokens.bos, tokens.pad, &mut inputs, &mut targets);
    let logits = model.predict(&Tensor::new(inputs, &Device::Cpu)?.unsqueeze(0)?)?.squeeze(0)?;
    let logits = logits.narrow(0, window.scored.start, window.scored.len())?;
    Ok(ops::cross_entropy_sum(&logits, &targets[window.scored.clone()], tokens.pad)?.to_scalar::<f32>()? as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::corpus::Split;
    use crate::model::ModelConfig;
    use crate::train::fixture;

    #[test]
    fn every_token_counts_once_and_a_model_that_knows_nothing_needs_its_vocabulary() {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::corpus(dir.path(), &[(30, Split::Valid), (2, Split::Valid)]);
        let clips: Vec<_> = corpus.split(Split::Valid).collect();
        let config = ModelConfig { layers: 1, heads: 1, width: 8, context: 36, ..Default::default() };
        let gpt = Gpt::new(&config, &fixture::TOKENS, 1).unwrap();
        let zero = Tensor::zeros((fixture::TOKENS.vocabulary, 8), candle_core::DType::F32, &Device::Cpu).unwrap();
        gpt.vars()["token.weight"].set(&zero).unwrap();
        let workers = Workers::new(Some(2), 2).unwrap();
        let all = likelihood(&gpt, &corpus, &clips, 0, &workers).unwrap().unwrap();
        assert_eq!(all.tokens, 32 * 7);
        let expected = 7.0 * (fixture::TOKENS.vocabulary as f64).log2();
        assert!((all.bits_per_frame - expected).abs() < 1e-4, "{} {expected}", all.bits_per_frame);
        // 30 frames in windows of 5 that move by 2: 14; and one of the short clip
        assert_eq!((all.windows, all.all_windows), (15, 15));
        let some = likelihood(&gpt, &corpus, &clips, 4, &workers).unwrap().unwrap();
        assert_eq!((some.windows, some.all_windows), (4, 15));
        assert_eq!(likelihood(&gpt, &corpus, &[], 0, &workers).unwrap(), None);
    }

    #[test]
    fn the_windows_are_those_of_the_definition() {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::corpus(dir.path(), &[(11, Split::Valid)]);
        let clips: Vec<_> = corpus.split(Split::Valid).collect();
        let config = ModelConfig { layers: 2, heads: 2, width: 8, context: 30, ..Default::default() };
        let gpt = Gpt::new(&config, &fixture::TOKENS, 4).unwrap();
        let found = likelihood(&gpt, &corpus, &clips, 0, &Workers::new(Some(1), 1).unwrap()).unwrap().unwrap();
        // by hand: windows of 4 words at frames 0, 2, 4, 6, 8; the first is scored whole, then two words each, then one
        let ids = corpus.frame_ids(clips[0], 0..11);
        let mut nats = 0.0;
        for (first, last, unscored) in [(0, 4, 0), (2, 6, 2), (4, 8, 2), (6, 10, 2), (8, 11, 2)] {
            let mut cache = gpt.cache().unwrap();
            let mut input = vec![1];
            input.extend(&ids[first * 7..last * 7 - 1]);
            let logits = cache.read_all(&input).unwrap().to_vec2::<f32>().unwrap();
            for (i, row) in logits.iter().enumerate().skip(unscored * 7) {
                let sum: f64 = row.iter().map(|&x| (x as f64).exp()).sum();
                nats += sum.ln() - row[ids[first * 7 + i] as usize] as f64;
            }
        }
        let expected = nats / std::f64::consts::LN_2 / 11.0;
        assert!((found.bits_per_frame - expected).abs() < 1e-4, "{} {expected}", found.bits_per_frame);
    }
}
