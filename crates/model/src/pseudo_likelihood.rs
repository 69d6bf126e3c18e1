//! The pseudo-likelihood of clips under a masked model (docs/measures.md, "Bits a frame").

use super::scored_windows::{Likelihood, MeasuredClips, Score, Taken, room};
use crate::{Result, Scores};
use kinelm_corpus::{ClipRecord, Conditions, Corpus, EvalWindow, WindowTokens, fill_masked};
use kinelm_store::random;

/// Mean loss over 15 % of the tokens of each window, hidden in a tenth less, times the tokens of a frame: bits a frame that
/// are no likelihood, since both sides of a token are seen. A window's number alone decides what is hidden.
///
/// # Errors
/// A context without room for a word; a model whose probabilities are not finite, with the clip named.
pub(super) fn pseudo(
    model: &mut dyn Scores,
    corpus: &Corpus,
    clips: &[&ClipRecord],
    most: usize,
    conditions: &Conditions,
) -> Result<Option<Likelihood>> {
    let taken = Taken::of(corpus, clips, room(model.config(), model.tokens()), most)?;
    let pad = model.tokens().pad;
    let measured = MeasuredClips { corpus, clips, conditions, length: taken.longest + conditions.len(), taken };
    let mut shown = 0;
    let fill = |number, window: &EvalWindow, ids: &[u32], front: &[u32], input: &mut [u32], target: &mut [u32]| {
        // seed 0 for all: models and checkpoints are compared on the same hidden tokens
        let mut rng = random::stream(0, "mask", 0, number);
        fill_masked(WindowTokens { front, tokens: ids, pad }, &|_| true, &mut rng, input, target);
        shown += window.scored.len();
    };
    let Score { nats, tokens: predicted, frames } = measured.score(model, fill, |_, _| ())?;
    let taken = measured.taken;
    let nats_per_token = nats / predicted as f64;
    let found = Likelihood {
        bits_per_frame: nats_per_token / std::f64::consts::LN_2 * shown as f64 / frames,
        nats_per_token,
        tokens: predicted,
        frames: frames.round() as usize,
        windows: taken.count,
        all_windows: taken.all,
        pseudo: true,
    };
    Ok((predicted > 0).then_some(found))
}

#[cfg(test)]
mod tests {
    use crate::fixtures::TOKENS;
    use crate::likelihood::likelihood;
    use crate::{Gpt, ModelConfig, ModelKind};
    use candle_core::{DType, Device, Tensor};
    use kinelm_corpus::{Conditions, Split, fixture};

    #[test]
    fn a_masked_model_that_knows_nothing_needs_its_vocabulary_for_what_is_asked() {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::corpus(dir.path(), &[(30, Split::Valid), (2, Split::Valid)]);
        let clips: Vec<_> = corpus.split(Split::Valid).collect();
        // 5 words of 7 after <bos>
        let config =
            ModelConfig { kind: ModelKind::Masked, layers: 1, heads: 1, width: 8, context: 36, ..Default::default() };
        let mut gpt = Gpt::new(&config, &TOKENS, 1).unwrap();
        let before = likelihood(&mut gpt, &corpus, &clips, 0, &Conditions::none()).unwrap().unwrap();
        assert_eq!(before, likelihood(&mut gpt, &corpus, &clips, 0, &Conditions::none()).unwrap().unwrap());
        let zero = Tensor::zeros((TOKENS.vocabulary, 8), DType::F32, &Device::Cpu).unwrap();
        gpt.vars()["token.weight"].set(&zero).unwrap();
        let found = likelihood(&mut gpt, &corpus, &clips, 0, &Conditions::none()).unwrap().unwrap();
        // 13 windows of 35 tokens, 28 at the end, 14 of the short clip: 6, 5 and 3 of them
        assert!(found.pseudo && found.windows == 15 && found.frames == 32, "{found:?}");
        assert_eq!(found.tokens, 13 * 6 + 5 + 3);
        let expected = 7.0 * (TOKENS.vocabulary as f64).log2();
        assert!((found.bits_per_frame - expected).abs() < 1e-4, "{} {expected}", found.bits_per_frame);
    }
}
