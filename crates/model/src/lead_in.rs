//! Lead-ins: seconds of train clips that unprompted dances continue, stored in the run folder as ids.
//!
//! A lead-in precedes the first frame and is dropped from the output, so that a dance begins in the middle of
//! movement as the train clips have it. `train/lead_ins.rs` chooses them.

use crate::{Error, Result};
use kinelm_corpus::Conditions;
use kinelm_store::input;
use kinelm_tokenizer::{SPACE, Slot, Special, Tokenizer};
use rand_chacha::rand_core::RngCore;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The file in the run folder.
pub const LEAD_INS: &str = "lead_ins.json";
/// Its layout's version.
const VERSION: u32 = 1;
/// The least time that a lead-in lasts; it has whole words.
const SECONDS: f64 = 1.0;

/// Words of a lead-in.
pub fn words(tokenizer: &Tokenizer) -> usize {
    // rounded up to whole words: the model continues after a space
    (SECONDS * tokenizer.fps() / tokenizer.frames_per_word() as f64).ceil() as usize
}

/// The lead-ins of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeadIns {
    /// The layout's version.
    version: u32,
    /// The hash of the tokenizer whose ids they are.
    tokenizer_sha256: String,
    /// Of any train clips.
    any: Vec<LeadIn>,
    /// As many for each label value that the model knows, of clips that have it.
    labelled: Vec<LeadIn>,
}

/// One of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeadIn {
    /// Its source.
    pub from: LeadInFrom,
    /// The clip's labels, of the fields that condition the model.
    pub labels: BTreeMap<String, String>,
    /// Ids of [`words`] words, spaces included.
    pub ids: Vec<u32>,
}

/// The source of a lead-in.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeadInFrom {
    /// The corpus, counted from 1 as the run's configuration lists them.
    pub corpus: usize,
    /// The clip's name.
    pub clip: String,
    /// The clip's frame that it begins with, at the model's rate.
    pub frame: usize,
}

impl LeadIns {
    /// Those of any clips, and those that have labels.
    pub fn new(tokenizer: &Tokenizer, any: Vec<LeadIn>, labelled: Vec<LeadIn>) -> LeadIns {
        LeadIns { version: VERSION, tokenizer_sha256: tokenizer.hash(), any, labelled }
    }

    /// The file's text.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("lead-ins are plain data")
    }

    /// Reads those of a run with this tokenizer; `None` where it has none, as one that was trained elsewhere.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] for text that is none, another version or tokenizer, ids that make no words.
    pub fn load(run: &Path, tokenizer: &Tokenizer) -> Result<Option<LeadIns>> {
        let path = run.join(LEAD_INS);
        let Some(text) = input::text_if_there(&path).map_err(Error::io(&path))? else { return Ok(None) };
        let help = "delete it, and `kinelm pretrain resume` writes it anew";
        let wrong = |found: String, expected: &str| Error::file(&path, found, expected, help);
        let found: LeadIns = serde_json::from_str(&text).map_err(|e| wrong(e.to_string(), "lead-ins of a run"))?;
        if found.version != VERSION {
            return Err(wrong(format!("version {}", found.version), "version 1"));
        }
        if found.tokenizer_sha256 != tokenizer.hash() {
            let expected = format!("the run's, {}", tokenizer.hash());
            return Err(wrong(format!("ids of tokenizer {}", found.tokenizer_sha256), &expected));
        }
        let words = words(tokenizer);
        if let Some(LeadIn { from, .. }) = found.all().find(|lead_in| !lead_in.has_words(words, tokenizer)) {
            let ids = format!("other ids of {} from frame {}", from.clip, from.frame);
            return Err(wrong(ids, &format!("those of {words} words")));
        }
        Ok(Some(found))
    }

    fn all(&self) -> impl Iterator<Item = &LeadIn> {
        self.any.iter().chain(&self.labelled)
    }

    /// The one that a dance under the tokens of `requested` labels (K), as of [`Conditions::front`], continues: sampled
    /// by the seed from those that have most of the labels, or from those of any clips where none has one. `None` if there
    /// is none.
    pub fn choose(&self, conditions: &Conditions, requested: &[u32], seed: u64) -> Option<&LeadIn> {
        let shared = |lead_in: &&LeadIn| {
            let own = conditions.front(&lead_in.labels);
            // skips `<bos>`, which all have; an unknown label would match every clip without one
            let known = requested.iter().zip(&own).skip(1).filter(|(id, _)| **id != Special::Unk.id());
            known.filter(|(requested, own)| requested == own).count()
        };
        let most = self.labelled.iter().map(|lead_in| shared(&lead_in)).max().unwrap_or(0);
        let fit: Vec<&LeadIn> = match most {
            0 => self.any.iter().collect(),
            _ => self.labelled.iter().filter(|lead_in| shared(lead_in) == most).collect(),
        };
        let draw = kinelm_store::random::stream(seed, "lead-in", 0, 0).next_u64();
        // 64 bits over a few hundred lead-ins: the remainder favours none by more than 1e-16
        fit.get((draw % fit.len().max(1) as u64) as usize).copied()
    }

    /// The one from there.
    pub fn find(&self, from: &LeadInFrom) -> Option<&LeadIn> {
        self.all().find(|lead_in| lead_in.from == *from)
    }
}

impl LeadIn {
    /// Whether its ids are exactly `words` whole words.
    fn has_words(&self, words: usize, tokenizer: &Tokenizer) -> bool {
        let (grammar, mut place) = (tokenizer.grammar(), Slot::default());
        let whole = self.ids.iter().all(|&id| {
            let allows = grammar.allows(place, id);
            place = grammar.advance(place, id);
            allows
        });
        let spaces = self.ids.iter().filter(|id| **id == SPACE).count();
        whole && spaces == words && place == Slot::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_corpus::samples::{tokenizer, words as ids};
    use std::collections::BTreeSet;

    fn lead_in(clip: &str, labels: &[(&str, &str)]) -> LeadIn {
        let from = LeadInFrom { corpus: 1, clip: clip.into(), frame: 3 };
        let labels = labels.iter().map(|(f, v)| (f.to_string(), v.to_string())).collect();
        LeadIn { from, labels, ids: ids(20) }
    }

    #[test]
    fn the_one_with_most_of_the_labels_is_chosen_by_the_seed() {
        let mut t = tokenizer();
        for (field, value) in [("genre", "salsa"), ("genre", "waltz"), ("genre", "house"), ("dancer", "61")] {
            t.vocabulary_mut().add_conditioning(field, value).unwrap();
        }
        let conditions = Conditions::new(&["genre".into(), "dancer".into()], t.vocabulary());
        let labelled = vec![
            lead_in("c", &[("genre", "salsa"), ("dancer", "60")]),
            lead_in("d", &[("genre", "salsa"), ("dancer", "61")]),
            lead_in("e", &[("genre", "waltz"), ("dancer", "61")]),
        ];
        let all = LeadIns::new(&t, vec![lead_in("a", &[]), lead_in("b", &[])], labelled);
        let chosen = |labels: &[(&str, &str)]| {
            let labels: Vec<_> = labels.iter().map(|(f, v)| (f.to_string(), v.to_string())).collect();
            let front = conditions.requested(&labels).unwrap();
            let of = |seed| all.choose(&conditions, &front, seed).unwrap().from.clip.clone();
            assert_eq!(of(3), of(3));
            (0..40).map(of).collect::<BTreeSet<_>>().into_iter().collect::<Vec<_>>()
        };
        assert_eq!(chosen(&[]), ["a", "b"]);
        assert_eq!(chosen(&[("genre", "salsa")]), ["c", "d"]);
        assert_eq!(chosen(&[("dancer", "61")]), ["d", "e"]);
        assert_eq!(chosen(&[("dancer", "61"), ("genre", "salsa")]), ["d"]);
        assert_eq!(chosen(&[("dancer", "61"), ("genre", "house")]), ["d", "e"]);
        assert_eq!(chosen(&[("genre", "house")]), ["a", "b"], "no clip of it was long enough");
        assert!(LeadIns::new(&t, vec![], vec![]).choose(&conditions, &[1, 4, 4], 1).is_none());
    }

    #[test]
    fn what_is_no_file_of_lead_ins_is_refused() {
        let (dir, t) = (tempfile::tempdir().unwrap(), tokenizer());
        let load = || LeadIns::load(dir.path(), &t);
        assert_eq!(load().unwrap(), None);
        let all = LeadIns::new(&t, vec![lead_in("a", &[("genre", "salsa")])], vec![]);
        let text = all.to_json();
        std::fs::write(dir.path().join(LEAD_INS), &text).unwrap();
        assert_eq!(load().unwrap(), Some(all.clone()));
        let said = |text: &str| {
            std::fs::write(dir.path().join(LEAD_INS), text).unwrap();
            load().unwrap_err().to_string()
        };
        assert!(said("{").contains("lead_ins.json: found EOF"));
        assert!(said(&text.replace("\"version\":1", "\"version\":7")).contains("found version 7, expected version 1"));
        assert!(said(&text.replace(&t.hash(), "0")).contains("found ids of tokenizer 0"));
        let mut cut = all.clone();
        let last = all.any[0].ids.len() - 1;
        for (at, id) in [(0, SPACE), (0, 999_999), (last, 6), (last, SPACE + 1)] {
            cut.any[0].ids = ids(20);
            cut.any[0].ids[at] = id;
            let message = said(&cut.to_json());
            assert!(message.contains("found other ids of a from frame 3, expected those of 20 words"), "{message}");
        }
        cut.any[0].ids = ids(19);
        assert!(said(&cut.to_json()).contains("found other ids"));
    }
}
