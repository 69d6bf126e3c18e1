//! Bits per frame in gaps before a given frame, with goal conditioning ([`kinelm_model::goal`]) and without.

use super::gaps::CONTEXT_FRAMES;
use crate::{Error, Result};
use kinelm_corpus::{ClipRecord, Conditions, Corpus, fill_sequence};
use kinelm_model::goal::{GoalEncoder, GoalTrack};
use kinelm_model::scored_windows::history_of;
use kinelm_model::{Scores, TokenWindows};
use serde::Serialize;
use std::f64::consts::LN_2;
use std::ops::Range;

/// The bits of a model in gaps of one length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GapBits {
    /// Frames of a gap.
    pub frames: usize,
    /// Gaps.
    pub gaps: usize,
    /// Bits per frame without goal conditioning.
    pub unconditioned: f64,
    /// Bits per frame, conditioned on the frame after the gap.
    pub conditioned: f64,
    /// The same of the last quarter of the gaps' frames.
    pub unconditioned_end: f64,
    /// See [`GapBits::unconditioned_end`].
    pub conditioned_end: f64,
}

/// Bits in gaps of `frames` frames, all characters free, spread over the clips without overlap; each after 64 known
/// frames, or as many as a window holds. `None` where no clip is long enough.
///
/// # Errors
/// A model without goal conditioning, gaps that don't fit into its window, those of the model's reading.
pub fn gap_bits(
    model: &mut dyn Scores,
    corpus: &Corpus,
    clips: &[&ClipRecord],
    frames: usize,
    conditions: &Conditions,
) -> Result<Option<GapBits>> {
    let window = model.config().frames(model.tokens());
    // one more for the goal, the frame after the gap
    let before = CONTEXT_FRAMES.min(window.saturating_sub(frames + 1));
    if frames == 0 || before == 0 {
        let most = window.saturating_sub(2);
        let expected = format!("1 to {most} in windows of {window} frames");
        return Err(Error::invalid("a gap", format!("{frames} frames long"), expected));
    }
    let ahead = GoalEncoder::of(corpus.tokenizer())?;
    let (gap, shown) = (before..before + frames, before + frames + 1);
    let end = gap.end - frames.div_ceil(4)..gap.end;
    let (mut gaps, mut sums) = (0, [0.0; 4]);
    for clip in clips {
        // neighbours share a frame, the goal of one and the first context frame of the other: no gap's frame counts
        // twice
        for start in (0..(clip.frames + 1).saturating_sub(shown)).step_by(before + frames) {
            let [unconditioned, conditioned] = nats(model, (corpus, clip, start), (&gap, shown), &ahead, conditions)?;
            let sum = |nats: &[f64], of: &Range<usize>| nats[of.clone()].iter().sum::<f64>();
            let found = [
                sum(&unconditioned, &gap),
                sum(&conditioned, &gap),
                sum(&unconditioned, &end),
                sum(&conditioned, &end),
            ];
            sums.iter_mut().zip(found).for_each(|(sum, x)| *sum += x);
            gaps += 1;
        }
    }
    let bits = |i: usize, of: &Range<usize>| sums[i] / LN_2 / (gaps * of.len()) as f64;
    Ok((gaps > 0).then(|| GapBits {
        frames,
        gaps,
        unconditioned: bits(0, &gap),
        conditioned: bits(1, &gap),
        unconditioned_end: bits(2, &end),
        conditioned_end: bits(3, &end),
    }))
}

/// Nats of each of the `shown` frames of a clip from `start` on, 0 outside of the gap: without conditioning, with it.
fn nats(
    model: &mut dyn Scores,
    (corpus, clip, start): (&Corpus, &ClipRecord, usize),
    (gap, shown): (&Range<usize>, usize),
    ahead: &GoalEncoder,
    conditions: &Conditions,
) -> Result<[Vec<f64>; 2]> {
    let (pad, word, c) = (model.tokens().pad, model.tokens().word, ahead.characters());
    let ids = corpus.ids(clip, start * word..(start + shown) * word)?;
    // targets are one ahead of inputs, so the front's last token predicts the first of the words
    let (front, first) = (conditions.front(&clip.labels), conditions.len() - 1);
    let length = first + ids.len();
    let history = history_of(model, corpus, clip, start * word)?;
    let (mut inputs, mut targets, mut found) = (vec![pad; length], vec![pad; length], vec![0.0; length]);
    fill_sequence(&ids, &front, pad, &mut inputs, &mut targets);
    // padded targets cost 0: the model reads all, but only the gap is scored
    targets[..first + gap.start * word].fill(pad);
    targets[first + gap.end * word..].fill(pad);
    let given = (0..shown).flat_map(|frame| vec![!gap.contains(&frame); c]).collect();
    let goal = GoalTrack::new(ahead.clone(), ahead.codes(&ids), given, 0).conditioning(shown);
    let mut nats = |conditioning| -> Result<Vec<f64>> {
        model.nats(
            TokenWindows { inputs: &inputs, targets: &targets, length, history: &history, conditioning },
            &mut found,
        )?;
        Ok(found[first..].chunks(word).map(|frame| frame.iter().map(|&x| f64::from(x)).sum()).collect())
    };
    Ok([nats(None)?, nats(Some(&goal))?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_corpus::Split;
    use kinelm_model::fast::Fast;
    use kinelm_model::{Architecture, ModelConfig, TokenLayout, fixtures};
    use kinelm_train::fixture;

    #[test]
    fn gaps_are_counted_and_both_forms_find_the_same() {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::turning(dir.path(), &[(50, Split::Test), (16, Split::Test)]);
        let clips: Vec<_> = corpus.split(Split::Test).collect();
        let tokens = TokenLayout::of(corpus.tokenizer());
        let config = ModelConfig {
            architecture: Architecture::TwoLevel,
            layers: 1,
            heads: 2,
            width: 16,
            window: Some(12),
            goal: true,
            ..Default::default()
        };
        let mut gpt = fixtures::model(&config.resolved(&tokens), &tokens);
        let mut fast = Fast::of(&gpt).unwrap();
        let of = |model: &mut dyn Scores, frames| gap_bits(model, &corpus, &clips, frames, &Conditions::none());
        let (plain, found) = (of(&mut gpt, 4).unwrap().unwrap(), of(&mut fast, 4).unwrap().unwrap());
        // 7 frames before, 4 free, one after: at 0, 11, 22, 33 of the first clip, at 0 of the second
        assert_eq!((found.frames, found.gaps), (4, 5));
        for (a, b) in [
            (plain.unconditioned, found.unconditioned),
            (plain.conditioned, found.conditioned),
            (plain.conditioned_end, found.conditioned_end),
        ] {
            assert!((a / b - 1.0).abs() < 1e-4, "{a} {b}");
        }
        assert!((found.conditioned_end - found.unconditioned_end).abs() > 0.1, "{found:?}");
        assert!(of(&mut fast, 11).unwrap_err().to_string().contains("expected 1 to 10 in windows of 12 frames"));
        let short: Vec<&ClipRecord> = Vec::new();
        assert_eq!(gap_bits(&mut fast, &corpus, &short, 4, &Conditions::none()).unwrap(), None);
        let without = ModelConfig { goal: false, ..config }.resolved(&tokens);
        let mut other = Fast::of(&fixtures::model(&without, &tokens)).unwrap();
        assert!(of(&mut other, 4).unwrap_err().to_string().contains("model.goal = false"));
    }
}
