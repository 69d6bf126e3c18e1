//! Windows that move are read after the frames before them.

use super::{sampled, two_level};
use crate::Result;
use crate::sampler::{NextToken, SamplingPlan, sample_one, unwatched};
use crate::sampling::Sampling;
use kinelm_corpus::samples;
use kinelm_model::fast::{Fast, Windows};
use kinelm_model::scored_windows::history;
use kinelm_model::{FrameConditioning, Logits, ModelConfig, Reader, ReaderOptions};
use kinelm_tokenizer::{Tokenizer, TokenizerConfig};

/// A reader whose logits are compared with those of the whole window, read at once after its history.
struct Compared {
    reader: Reader,
    fast: Fast,
    word: usize,
    before: Vec<u32>,
    window: Vec<u32>,
    /// Windows that began after something, and rows compared.
    moved: usize,
    compared: usize,
}

impl NextToken for Compared {
    fn context(&self) -> usize {
        self.reader.context()
    }

    fn streams(&self) -> usize {
        1
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn truncate(&mut self, stream: usize, length: usize) {
        self.window.truncate(length);
        self.reader.truncate(stream, length);
    }

    fn begin_after(&mut self, stream: usize, ids: &[u32]) {
        self.moved += usize::from(!ids.is_empty());
        self.before = ids.to_vec();
        self.window.clear();
        self.reader.begin_after(stream, ids);
    }

    fn condition(&mut self, _: usize, _: usize, goals: Option<FrameConditioning>, _: &[f32]) -> Result<()> {
        assert!(goals.is_none());
        Ok(())
    }

    fn read(&mut self, blocks: &[&[u32]], wanted: Logits, logits: &mut Vec<f32>) -> Result<()> {
        NextToken::read(&mut self.reader, blocks, wanted, logits)?;
        self.window.extend_from_slice(blocks[0]);
        let mut inputs = self.window.clone();
        inputs.resize(inputs.len().next_multiple_of(self.word), 0);
        let most = kinelm_model::Scores::config(&self.fast).history() * self.word;
        let (length, mask, history) = (inputs.len(), self.fast.mask(), history(&self.before, most, 0));
        let windows =
            Windows { inputs: &inputs, targets: &inputs, length, mask, history: &history, conditioning: None };
        let vocabulary = logits.len() / if wanted == Logits::All { blocks[0].len() } else { 1 };
        let all = self.fast.logits(windows)?;
        let row = &all[(self.window.len() - 1) * vocabulary..][..vocabulary];
        for (found, expected) in logits[logits.len() - vocabulary..].iter().zip(row) {
            assert!(found == expected || (found - expected).abs() < 1e-3, "{found}, expected {expected}");
        }
        self.compared += 1;
        Ok(())
    }
}

#[test]
fn logits_are_those_of_the_window_read_at_once_after_its_history() {
    let walk = samples::walk(16);
    let tokenizer = Tokenizer::fit([&walk], TokenizerConfig::uniform(&[0, 4], 20.0, 20)).unwrap();
    let gpt = two_level(&tokenizer, ModelConfig { window: Some(6), ..Default::default() });
    assert!(gpt.config().forecast());
    let plan = SamplingPlan::free(tokenizer.grammar(), 40, Sampling::temperature(1.0), 4);
    let word = tokenizer.tokens_per_word().unwrap();
    let reader = Reader::new(&gpt, ReaderOptions::default()).unwrap();
    let fast = Fast::of(&gpt).unwrap();
    let mut model = Compared { reader, fast, word, before: vec![], window: vec![], moved: 0, compared: 0 };
    let ids = sample_one(&mut model, &plan, &mut unwatched).unwrap();
    assert_eq!(ids, sampled(&gpt, &plan));
    // half a window at a time, with more and more frames before it
    assert!(model.moved > 10 && model.compared > 300, "{} {}", model.moved, model.compared);
    // what is before a window counts
    let read = |before: &[u32]| {
        let mut reader = Reader::new(&gpt, ReaderOptions::default()).unwrap();
        reader.begin_after(0, before);
        reader.read(&[&[&[1], &ids[30 * word..31 * word]].concat()], Logits::Last).unwrap().to_vec()
    };
    assert_ne!(read(&ids[..30 * word]), read(&[]));
    // but no more of it than the model reads
    assert_eq!(read(&ids[..30 * word]), read(&ids[9 * word..30 * word]));
}
