//! Bits a frame that a model needs for clips it is shown: docs/measures.md, "Bits a frame".

use super::pseudo_likelihood::pseudo;
use super::scored_windows::{Likelihood, MeasuredClips, Score, Taken, room};
use crate::{Error, ModelKind, Result, Scores, TokenLayout};
use kinelm_corpus::{ClipRecord, Conditions, Corpus, EvalWindow, fill_sequence};

/// Bits a frame of `model` on `clips`, `None` where they have no frame.
///
/// Windows hold as many whole words as the context and advance by half of them (`eval_windows`); each scores the words that
/// the one before has not. A positive `most` limits the number of windows, spread evenly. Each begins with the labels of
/// its clip that `conditions` knows; [`Conditions::unknown`] hides them all.
///
/// A masked model predicts 15 % of the tokens of each window, the same at every call; its figures are
/// [`Likelihood::pseudo`].
///
/// # Errors
/// A corpus of other words than the model's; other conditions than the model's; a model whose probabilities are not
/// finite, with the clip named.
pub fn likelihood(
    model: &mut dyn Scores,
    corpus: &Corpus,
    clips: &[&ClipRecord],
    most: usize,
    conditions: &Conditions,
) -> Result<Option<Likelihood>> {
    likelihood_by_token(model, corpus, clips, most, conditions, &mut |_, _, _| {})
}

/// As [`likelihood`]; `each` gets every scored token: the clip, the token's index in it, its nats.
///
/// # Errors
/// As [`likelihood`].
pub fn likelihood_by_token(
    model: &mut dyn Scores,
    corpus: &Corpus,
    clips: &[&ClipRecord],
    most: usize,
    conditions: &Conditions,
    each: &mut dyn FnMut(&ClipRecord, usize, f64),
) -> Result<Option<Likelihood>> {
    let (own, found) = (model.tokens(), TokenLayout::of(corpus.tokenizer()));
    if conditions.len() != own.front {
        let (k, front) = (conditions.len(), own.front);
        let expected = format!("{front}, as the model was trained with");
        return Err(Error::invalid("the number of tokens in front of a window", k, expected));
    }
    if !own.reads(&found) {
        let describe = |t: &TokenLayout| {
            format!("words of {}{} tokens from {} ids", if t.varying { "up to " } else { "" }, t.word, t.vocabulary)
        };
        let why = format!("the model was trained on {}; make the corpus with the run's tokenizer", describe(own));
        return Err(Error::unsupported(format!("a corpus of {}", describe(&found)), why));
    }
    if model.config().kind == ModelKind::Masked {
        return pseudo(model, corpus, clips, most, conditions);
    }
    let taken = Taken::of(corpus, clips, room(model.config(), own), most)?;
    // the front's last token predicts a window's first
    let (pad, before) = (own.pad, conditions.len() - 1);
    let measured = MeasuredClips { corpus, clips, conditions, length: taken.longest + before, taken };
    let fill = |_, window: &EvalWindow, ids: &[u32], front: &[u32], input: &mut [u32], target: &mut [u32]| {
        // all tokens are read, but those that the window before has scored are no targets
        fill_sequence(ids, front, pad, input, target);
        target[..before + window.scored.start].fill(pad);
        target[before + window.scored.end..].fill(pad);
    };
    let Score { nats, tokens, frames } = measured.score(model, fill, |window, nats| {
        for i in window.scored.clone() {
            each(clips[window.clip], window.start + i, nats[before + i].into());
        }
    })?;
    let taken = measured.taken;
    let bits_per_frame = nats / std::f64::consts::LN_2 / frames;
    let nats_per_token = nats / tokens as f64;
    let (frames, windows, all_windows) = (frames.round() as usize, taken.count, taken.all);
    let found = Likelihood { bits_per_frame, nats_per_token, tokens, frames, windows, all_windows, pseudo: false };
    Ok((tokens > 0).then_some(found))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fast::Fast;
    use crate::fixtures::TOKENS;
    use crate::goal::Conditioning;
    use crate::scored_windows;
    use crate::{Gpt, ModelConfig, Reader, ReaderOptions, TokenWindows};
    use candle_core::{Device, Tensor};
    use kinelm_corpus::conditions::with_labels;
    use kinelm_corpus::{Split, fixture};

    #[test]
    fn every_token_counts_once_and_a_model_that_knows_nothing_needs_its_vocabulary() {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::corpus(dir.path(), &[(30, Split::Valid), (2, Split::Valid)]);
        let clips: Vec<_> = corpus.split(Split::Valid).collect();
        let config = ModelConfig { layers: 1, heads: 1, width: 8, context: 36, ..Default::default() };
        let mut gpt = Gpt::new(&config, &TOKENS, 1).unwrap();
        let zero = Tensor::zeros((TOKENS.vocabulary, 8), candle_core::DType::F32, &Device::Cpu).unwrap();
        gpt.vars()["token.weight"].set(&zero).unwrap();
        let all = likelihood(&mut gpt, &corpus, &clips, 0, &Conditions::none()).unwrap().unwrap();
        assert_eq!((all.tokens, all.frames), (32 * 7, 32));
        let expected = 7.0 * (TOKENS.vocabulary as f64).log2();
        assert!((all.bits_per_frame - expected).abs() < 1e-4, "{} {expected}", all.bits_per_frame);
        // 30 frames in windows of 5 that move by 2: 14; and one of the short clip
        assert_eq!((all.windows, all.all_windows), (15, 15));
        let some = likelihood(&mut gpt, &corpus, &clips, 4, &Conditions::none()).unwrap().unwrap();
        assert_eq!((some.windows, some.all_windows), (4, 15));
        assert_eq!(likelihood(&mut gpt, &corpus, &[], 0, &Conditions::none()).unwrap(), None);
    }

    #[test]
    fn the_windows_are_those_of_the_definition() {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::corpus(dir.path(), &[(11, Split::Valid)]);
        let clips: Vec<_> = corpus.split(Split::Valid).collect();
        let config = ModelConfig { layers: 2, heads: 2, width: 8, context: 30, ..Default::default() };
        let mut gpt = Gpt::new(&config, &TOKENS, 4).unwrap();
        let found = likelihood(&mut gpt, &corpus, &clips, 0, &Conditions::none()).unwrap().unwrap();
        // by hand: windows of 4 words at frames 0, 2, 4, 6, 8; the first is scored whole, then two words each, then one
        let ids = corpus.clip_ids(clips[0]).unwrap();
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

    #[test]
    fn labels_in_front_count_nothing_and_tell_the_model() {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::corpus(dir.path(), &[(11, Split::Valid), (4, Split::Valid)]);
        let clips: Vec<_> = corpus.split(Split::Valid).collect();
        let fields = ["genre".to_string()];
        let tokenizer = with_labels(corpus.tokenizer(), corpus.clips(), &fields).unwrap();
        let conditions = Conditions::new(&fields, tokenizer.vocabulary());
        let tokens = TokenLayout { front: 2, ..TokenLayout::of(&tokenizer) };
        // 30 tokens of words beside the front: windows of 4 words
        let config = ModelConfig { layers: 2, heads: 2, width: 8, context: 31, ..Default::default() };
        let mut gpt = Gpt::new(&config, &tokens, 4).unwrap();
        let found = likelihood(&mut gpt, &corpus, &clips, 0, &conditions).unwrap().unwrap();
        assert_eq!((found.tokens, found.frames, found.windows), (15 * 7, 15, 6));
        // by hand, the second clip of one window: <bos> <genre:b> and its tokens but the last
        let by_hand = |model: &Gpt, genre: u32| {
            let ids = corpus.clip_ids(clips[1]).unwrap();
            let mut cache = model.cache().unwrap();
            let input: Vec<u32> = [1, genre].into_iter().chain(ids[..27].iter().copied()).collect();
            let logits = cache.read_all(&input).unwrap().to_vec2::<f32>().unwrap();
            let rows = logits[1..].iter().zip(&ids).map(|(row, &id)| {
                let sum: f64 = row.iter().map(|&x| (x as f64).exp()).sum();
                sum.ln() - row[id as usize] as f64
            });
            rows.sum::<f64>() / std::f64::consts::LN_2 / 4.0
        };
        for (conditions, genre) in [(conditions.clone(), 17), (conditions.unknown(), 4)] {
            let found = likelihood(&mut gpt, &corpus, &clips[1..], 0, &conditions).unwrap().unwrap();
            let expected = by_hand(&gpt, genre);
            assert!((found.bits_per_frame - expected).abs() < 1e-4, "{} {expected}", found.bits_per_frame);
        }
        assert!((by_hand(&gpt, 17) - by_hand(&gpt, 4)).abs() > 1e-3);
        let message = likelihood(&mut gpt, &corpus, &clips, 0, &Conditions::none()).unwrap_err().to_string();
        assert_eq!(
            message,
            "the number of tokens in front of a window is 1; expected 2, as the model was trained with"
        );
    }

    #[test]
    fn music_is_used_where_each_window_stands_unless_it_is_hidden() {
        use crate::music::Music;
        use crate::{Architecture, fixtures};
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::with_music(dir.path(), &[(40, Split::Train), (20, Split::Valid)]);
        let clips: Vec<_> = corpus.split(Split::Valid).collect();
        let tokens = TokenLayout::of(corpus.tokenizer());
        let config = ModelConfig {
            architecture: Architecture::TwoLevel,
            layers: 1,
            heads: 2,
            width: 16,
            window: Some(16),
            music: Music::Beats,
            ..Default::default()
        };
        let gpt = fixtures::model(&config.resolved(&tokens), &tokens);
        let mut fast = Fast::of(&gpt).unwrap();
        let mut bits = |conditions: &Conditions| {
            likelihood(&mut fast, &corpus, &clips, 0, conditions).unwrap().unwrap().bits_per_frame
        };
        let (conditioning, hidden) = (bits(&Conditions::none()), bits(&Conditions::none().unknown()));
        // by hand: a window of the first 16 frames, and one from frame 8 on of which the last four are scored
        let ids = corpus.clip_ids(clips[0]).unwrap();
        let mut by_hand = |is_used: bool| {
            let mut nats = 0.0;
            for (first, last, scored) in [(0, 16, 0), (8, 20, 8)] {
                let word = tokens.word;
                let targets = &ids[first * word..last * word];
                let inputs = [&[1], &targets[..targets.len() - 1]].concat();
                let times = (first..last).map(|frame| frame as f64 / 20.0);
                let music = config.music_conditioning(&corpus.music(clips[0]).unwrap(), times, 1.0);
                let conditioning = Conditioning { music, ..Conditioning::default() };
                let mut found = vec![0.0; inputs.len()];
                let (length, conditioning) = (inputs.len(), is_used.then_some(&conditioning));
                // the second window is read after the clip's frames before it
                let history = scored_windows::history(&ids[..first * word], config.history() * word, 0);
                let windows = TokenWindows { inputs: &inputs, targets, length, history: &history, conditioning };
                fast.nats(windows, &mut found).unwrap();
                nats += found[scored * word..].iter().map(|&x| f64::from(x)).sum::<f64>();
            }
            nats / std::f64::consts::LN_2 / 20.0
        };
        assert!((conditioning - by_hand(true)).abs() < 1e-4 && (hidden - by_hand(false)).abs() < 1e-4);
        assert!((conditioning - hidden).abs() > 1e-2, "{conditioning} {hidden}");
    }

    #[test]
    fn words_of_any_length_count_once_and_all_forms_agree() {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::merged(dir.path(), &[(120, Split::Valid), (1, Split::Valid), (77, Split::Valid)]);
        let clips: Vec<_> = corpus.split(Split::Valid).collect();
        let tokens = TokenLayout::of(corpus.tokenizer());
        let all: usize = clips.iter().map(|c| c.tokens).sum();
        assert!(tokens.varying && corpus.words(clips[0]).len() == 120);
        // a context of several words, and one that some words don't fit into
        for context in [50, 4] {
            let config = ModelConfig { layers: 2, heads: 2, width: 8, context, ..Default::default() };
            let mut gpt = Gpt::new(&config, &tokens, 1).unwrap();
            let plain = likelihood(&mut gpt, &corpus, &clips, 0, &Conditions::none()).unwrap().unwrap();
            assert_eq!((plain.tokens, plain.frames), (all, 198));
            let per_frame = plain.nats_per_token / std::f64::consts::LN_2 * all as f64 / 198.0;
            assert!((plain.bits_per_frame - per_frame).abs() < 1e-9);
            let mut fast = Fast::of(&gpt).unwrap();
            let mut reader = Reader::new(&gpt, ReaderOptions::default()).unwrap();
            for other in [&mut fast as &mut dyn Scores, &mut reader] {
                let found = likelihood(other, &corpus, &clips, 0, &Conditions::none()).unwrap().unwrap();
                let apart = (found.bits_per_frame / plain.bits_per_frame - 1.0).abs();
                assert!(apart < 1e-6 && found.tokens == all, "{found:?}, {plain:?}");
            }
            let zero = Tensor::zeros((tokens.vocabulary, 8), candle_core::DType::F32, &Device::Cpu).unwrap();
            gpt.vars()["token.weight"].set(&zero).unwrap();
            let found = likelihood(&mut gpt, &corpus, &clips, 0, &Conditions::none()).unwrap().unwrap();
            let expected = all as f64 * (tokens.vocabulary as f64).log2() / 198.0;
            assert!((found.bits_per_frame / expected - 1.0).abs() < 1e-6, "{} {expected}", found.bits_per_frame);
            // of some windows, words that are scored in part count in part
            let third = found.all_windows / 3;
            let some = likelihood(&mut gpt, &corpus, &clips, third, &Conditions::none()).unwrap().unwrap();
            assert!(
                some.windows == third && (some.bits_per_frame / expected - 1.0).abs() < 0.2,
                "{some:?}, {expected}"
            );
        }
    }
}
