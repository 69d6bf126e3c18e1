//! Byte-pair merging: characters that are often adjacent in a word become one token.
//!
//! The trainer of Hugging Face's `tokenizers` (Sennrich et al. 2016) learns merges on the words of training clips, never across
//! a space. The encoder here gives the same ids as theirs.

#[cfg(feature = "merges")]
use crate::vocab::{FIRST_CHARACTER, Vocabulary};
#[cfg(feature = "merges")]
use crate::{Error, Result, Words, alphabet};
use std::collections::HashMap;
#[cfg(feature = "merges")]
use tokenizers::Trainer;
#[cfg(feature = "merges")]
use tokenizers::models::bpe::{BPE, BpeTrainer};

/// Pairs of ids and their merged ids, in the order of training.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Merges {
    /// Pair to rank and merged id.
    table: HashMap<(u32, u32), (u32, u32)>,
}

/// No pair.
const NONE: u32 = u32::MAX;

impl Merges {
    /// From pairs and their merged ids.
    pub(crate) fn new(merges: impl IntoIterator<Item = ((u32, u32), u32)>) -> Self {
        let table = merges.into_iter().enumerate().map(|(rank, (pair, into))| (pair, (rank as u32, into)));
        Merges { table: table.collect() }
    }

    /// Merges the ids of one word in place: always the pair of lowest rank, leftmost first.
    pub(crate) fn apply(&self, ids: &mut Vec<u32>, ranks: &mut Vec<u32>) {
        if self.table.is_empty() {
            return;
        }
        let rank = |a: u32, b: u32| self.table.get(&(a, b)).map_or(NONE, |&(rank, _)| rank);
        ranks.clear();
        ranks.extend(ids.windows(2).map(|w| rank(w[0], w[1])));
        while let Some(&best) = ranks.iter().min().filter(|&&r| r != NONE) {
            let at = ranks.iter().position(|&r| r == best).expect("the least is there");
            ids[at] = self.table[&(ids[at], ids[at + 1])].1;
            // shifting is quadratic, but words are short
            ids.remove(at + 1);
            ranks.remove(at);
            if at > 0 {
                ranks[at - 1] = rank(ids[at - 1], ids[at]);
            }
            if at < ranks.len() {
                ranks[at] = rank(ids[at], ids[at + 1]);
            }
        }
    }
}

/// Learns up to `count` merges on words: pairs of ids of `vocabulary`, which has no merges yet.
///
/// Only pairs that occur at least twice are merged, so few or short words give fewer merges.
///
/// # Errors
/// [`Error::Nothing`] with the trainer's message.
#[cfg(feature = "merges")]
pub(crate) fn learn(vocabulary: &Vocabulary, words: &Words, count: u32) -> Result<Vec<(u32, u32)>> {
    let failed = |e: String| Error::Nothing(format!("byte-pair merges: {e}"));
    let text = |word: &[u16]| word.iter().filter_map(|&k| alphabet::character(k.into())).collect::<String>();
    // their vocabulary size counts the characters that occur, then merges
    let mut seen = vec![false; vocabulary.characters() as usize];
    words.codes().iter().for_each(|&k| seen[usize::from(k)] = true);
    let alphabet_size = seen.iter().filter(|&&s| s).count();
    let mut trainer =
        BpeTrainer::builder().vocab_size(alphabet_size + count as usize).min_frequency(2).show_progress(false).build();
    trainer.feed(words.iter().map(text), |word| Ok(vec![word.to_owned()])).map_err(|e| failed(e.to_string()))?;
    let mut model = BPE::default();
    trainer.train(&mut model).map_err(|e| failed(e.to_string()))?;
    let model = serde_json::to_value(&model).map_err(|e| failed(e.to_string()))?;
    let pairs = model["merges"].as_array().ok_or_else(|| failed("a model without merges".into()))?;
    let mut ids: HashMap<String, u32> = (0..vocabulary.characters())
        .filter_map(|k| Some((alphabet::character(k)?.to_string(), FIRST_CHARACTER + k)))
        .collect();
    let mut next = FIRST_CHARACTER + vocabulary.characters();
    let mut merges = Vec::with_capacity(pairs.len());
    for pair in pairs {
        let side = |i: usize| {
            let token = pair[i].as_str().ok_or_else(|| failed(format!("{pair} is no pair")))?;
            let id = ids.get(token).copied().ok_or_else(|| failed(format!("{token:?} was never made")))?;
            Ok::<_, Error>((token.to_owned(), id))
        };
        let ((a, left), (b, right)) = (side(0)?, side(1)?);
        merges.push((left, right));
        // two pairs may spell one token (ab + c, a + bc): the second takes the id of the first
        ids.entry(a + &b).or_insert_with(|| {
            next += 1;
            next - 1
        });
    }
    Ok(merges)
}
