//! The data of a run: corpora of one tokenizer with their weights, and the label fields that it is conditioned on.

use crate::{Error, Result};
use kinelm_corpus::conditions::{Conditions, with_labels};
use kinelm_corpus::{ClipRecord, Corpus, CorpusOptions, Split, each_eval_window};
use kinelm_model::likelihood::likelihood;
use kinelm_model::music::features::{Scale, Scaling};
use kinelm_model::scored_windows::{Likelihood, room};
use kinelm_model::{Scores, TokenLayout};
use kinelm_tokenizer::Tokenizer;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::str::FromStr;

/// A corpus of a run: a table of `[[corpora]]` in a training file, `DIR` or `DIR=WEIGHT` as text.
///
/// ```
/// let part: kinelm_train::CorpusPart = "corpora/salsa=0.5".parse()?;
/// assert_eq!((part.path.to_str(), part.weight), (Some("corpora/salsa"), 0.5));
/// # kinelm_train::Result::Ok(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CorpusPart {
    /// The corpus folder; in a file, relative to the file.
    pub path: PathBuf,
    /// How many times a pass takes each of its windows, 0.001 to 1,000. Default 1.
    #[serde(default = "one")]
    pub weight: f64,
}

fn one() -> f64 {
    1.0
}

impl CorpusPart {
    /// The corpus in a folder, with weight 1.
    pub fn once(path: impl Into<PathBuf>) -> CorpusPart {
        CorpusPart { path: path.into(), weight: 1.0 }
    }

    /// Checks the weight.
    ///
    /// # Errors
    /// A weight outside its limits.
    pub fn validate(&self) -> Result<()> {
        match (0.001..=1000.0).contains(&self.weight) {
            true => Ok(()),
            false => {
                Err(Error::invalid(format!("the weight of {}", self.path.display()), self.weight, "0.001 to 1000"))
            }
        }
    }
}

impl FromStr for CorpusPart {
    type Err = Error;

    fn from_str(text: &str) -> Result<CorpusPart> {
        // the last `=`, and only before a number: a folder's name may hold one
        let part = match text.rsplit_once('=').and_then(|(path, weight)| Some((path, weight.parse().ok()?))) {
            Some((path, weight)) => CorpusPart { path: path.into(), weight },
            None => CorpusPart::once(text),
        };
        part.validate().map(|()| part)
    }
}

/// An open corpus.
#[derive(Debug)]
pub struct Part {
    /// The corpus.
    pub corpus: Corpus,
    /// How many times a pass takes each of its windows.
    pub weight: f64,
}

/// The corpora of a run, its vocabulary and its conditions.
#[derive(Debug)]
pub struct Data {
    parts: Vec<Part>,
    tokenizer: Tokenizer,
    conditions: Conditions,
}

impl Data {
    /// Opens corpora for a run conditioned on `fields`. Its tokenizer is `tokenizer`, or the first corpus's, with a token
    /// for every value that training clips have of the fields.
    ///
    /// # Errors
    /// No corpus; one that can't be opened, or has another tokenizer (apart from labels); a field that no clip has.
    pub fn open(
        parts: &[CorpusPart],
        tokenizer: Option<&Tokenizer>,
        fields: &[String],
        opening: CorpusOptions,
    ) -> Result<Data> {
        let open = |p: &CorpusPart| {
            p.validate()?;
            Ok(Part { corpus: Corpus::open_with(&p.path, opening)?, weight: p.weight })
        };
        Data::of(parts.iter().map(open).collect::<Result<_>>()?, tokenizer, fields)
    }

    /// As [`Data::open`], from open corpora.
    ///
    /// # Errors
    /// As [`Data::open`].
    pub(crate) fn of(parts: Vec<Part>, tokenizer: Option<&Tokenizer>, fields: &[String]) -> Result<Data> {
        let Some(first) = parts.first() else {
            return Err(Error::missing("corpus", "give `corpus`, or `corpus` in the training file"));
        };
        let own = tokenizer.unwrap_or(first.corpus.tokenizer());
        // without labels: corpora that differ in them share the codes, and the run's tokenizer has all labels
        let base = own.base_hash();
        for Part { corpus, .. } in &parts {
            let found = corpus.tokenizer().base_hash();
            if found != base {
                let whose =
                    if tokenizer.is_some() { "the run's".into() } else { first.corpus.dir().display().to_string() };
                return Err(Error::file(
                    corpus.dir(),
                    format!("a corpus of tokenizer {found}"),
                    format!("that of {whose}, {base}"),
                    "make all corpora of a run with one tokenizer.json: kinelm tokenize DATA --tokenizer FILE",
                ));
            }
        }
        let clips = parts.iter().flat_map(|p| p.corpus.split(Split::Train));
        let tokenizer = with_labels(own, clips, fields)?;
        let conditions = Conditions::new(fields, tokenizer.vocabulary());
        Ok(Data { parts, tokenizer, conditions })
    }

    /// One corpus, without conditions.
    ///
    /// # Errors
    /// None in practice.
    pub fn one(corpus: Corpus) -> Result<Data> {
        Data::of(vec![Part { corpus, weight: 1.0 }], None, &[])
    }

    /// The corpora.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// The run's tokenizer: the corpora's, with the tokens of its labels.
    pub fn tokenizer(&self) -> &Tokenizer {
        &self.tokenizer
    }

    /// The label fields, which precede a window.
    pub(crate) fn conditions(&self) -> &Conditions {
        &self.conditions
    }

    /// The part of a model that the tokenizer and the label fields decide.
    pub fn tokens(&self) -> TokenLayout {
        TokenLayout { front: self.conditions.len(), ..TokenLayout::of(&self.tokenizer) }
    }

    /// Mean tokens per frame of the training clips, over all corpora by their weights.
    pub(crate) fn tokens_per_frame(&self) -> f64 {
        let sum = |of: &dyn Fn(&ClipRecord) -> usize| -> f64 {
            let of_part = |p: &Part| p.weight * p.corpus.split(Split::Train).map(of).sum::<usize>() as f64;
            self.parts.iter().map(of_part).sum()
        };
        sum(&|c| c.tokens) / sum(&|c| c.frames).max(1.0)
    }

    /// Whether some training clip has music.
    pub(crate) fn has_music(&self) -> bool {
        self.parts.iter().any(|p| p.corpus.split(Split::Train).any(|c| c.beats.is_some()))
    }

    /// Mean and deviation of the music features of the training clips, over all corpora by their weights; `None`: no clip
    /// has any.
    ///
    /// # Errors
    /// A corpus that can no longer be read.
    pub(crate) fn music_scale(&self) -> Result<Option<Scale>> {
        let mut scaling = Scaling::default();
        for part in &self.parts {
            for clip in part.corpus.split(Split::Train) {
                // by the weights, since the model sees the corpora by them
                scaling.add(&part.corpus.music(clip)?.rows.numbers, part.weight);
            }
        }
        Ok(scaling.scale())
    }

    /// Whether some clip of a split has a frame.
    pub fn has(&self, split: Split) -> bool {
        self.parts.iter().any(|p| p.corpus.split(split).any(|c| c.frames > 0))
    }

    /// Bits per frame of the clips of a split, over all corpora, each frame counting once. At most `most` windows (0: all) are
    /// read, in proportion to the windows of the corpora, at least one of each.
    ///
    /// # Errors
    /// Those of [`likelihood`].
    pub fn likelihood(&self, model: &mut dyn Scores, split: Split, most: usize) -> Result<Option<Likelihood>> {
        let clips: Vec<Vec<&ClipRecord>> =
            self.parts.iter().map(|p| p.corpus.split(split).filter(|c| c.frames > 0).collect()).collect();
        let room = room(model.config(), model.tokens());
        let mut windows = Vec::with_capacity(clips.len());
        for (part, clips) in self.parts.iter().zip(&clips) {
            windows.push(each_eval_window(clips.iter().map(|c| part.corpus.words(c)), room)?.count());
        }
        let all: usize = windows.iter().sum();
        let mut found = Vec::new();
        for ((part, clips), windows) in self.parts.iter().zip(&clips).zip(windows) {
            // 1 at least, as 0 would mean all of a small corpus
            let share = if most == 0 { 0 } else { (most * windows / all.max(1)).max(1) };
            found.extend(likelihood(model, &part.corpus, clips, share, &self.conditions)?);
        }
        Ok(together(&found))
    }
}

/// The likelihood over several corpora.
fn together(all: &[Likelihood]) -> Option<Likelihood> {
    let (first, rest) = all.split_first()?;
    if rest.is_empty() {
        return Some(*first);
    }
    let count = |of: fn(&Likelihood) -> usize| all.iter().map(of).sum::<usize>();
    let mean = |of: fn(&Likelihood) -> f64, by: fn(&Likelihood) -> usize| {
        all.iter().map(|l| of(l) * by(l) as f64).sum::<f64>() / count(by) as f64
    };
    Some(Likelihood {
        bits_per_frame: mean(|l| l.bits_per_frame, |l| l.frames),
        nats_per_token: mean(|l| l.nats_per_token, |l| l.tokens),
        tokens: count(|l| l.tokens),
        frames: count(|l| l.frames),
        windows: count(|l| l.windows),
        all_windows: count(|l| l.all_windows),
        pseudo: first.pseudo,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;
    use kinelm_model::{Gpt, ModelConfig};

    fn two(dir: &std::path::Path) -> [Corpus; 2] {
        [("a", 30), ("b", 50)].map(|(name, frames)| {
            let dir = dir.join(name);
            std::fs::create_dir(&dir).unwrap();
            fixture::corpus(&dir, &[(frames, Split::Train), (9, Split::Train), (frames / 2, Split::Valid)])
        })
    }

    #[test]
    fn weights_are_parsed_after_the_last_equals_sign() {
        let part = |text: &str| text.parse::<CorpusPart>().map_err(|e| e.to_string());
        assert_eq!(part("a/b"), Ok(CorpusPart::once("a/b")));
        assert_eq!(part("a=b=2.5"), Ok(CorpusPart { path: "a=b".into(), weight: 2.5 }));
        assert_eq!(part("a=b"), Ok(CorpusPart::once("a=b")));
        for text in ["a=0", "a=-1", "a=1e-9", "a=1e9", "a=nan"] {
            assert!(part(text).unwrap_err().contains("expected 0.001 to 1000"), "{text}");
        }
    }

    #[test]
    fn corpora_of_two_tokenizers_and_none_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let [a, b] = two(dir.path());
        let merged = fixture::merged(dir.path(), &[(9, Split::Train)]);
        let parts = [&a, &b, &merged].map(|c| CorpusPart::once(c.dir()));
        let data = Data::open(&parts[..2], None, &["genre".into()], CorpusOptions::default()).unwrap();
        assert_eq!((data.parts().len(), data.tokens().front, data.tokens_per_frame()), (2, 2, 7.0));
        let message = Data::open(&parts, None, &[], CorpusOptions::default()).unwrap_err().to_string();
        assert!(message.contains("merged: found a corpus of tokenizer") && message.contains("one tokenizer.json"));
        assert!(Data::open(&[], None, &[], CorpusOptions::default()).unwrap_err().to_string().contains("no corpus"));
    }

    #[test]
    fn validation_is_over_all_frames_of_all_corpora() {
        let dir = tempfile::tempdir().unwrap();
        let [a, b] = two(dir.path());
        let config = ModelConfig { layers: 1, heads: 1, width: 8, context: 36, ..Default::default() };
        let mut gpt = Gpt::new(&config, &fixture::TOKENS, 1).unwrap();
        let alone = |gpt: &mut Gpt, corpus: &Corpus| {
            let clips: Vec<_> = corpus.split(Split::Valid).collect();
            likelihood(gpt, corpus, &clips, 0, &Conditions::none()).unwrap().unwrap()
        };
        let (of_a, of_b) = (alone(&mut gpt, &a), alone(&mut gpt, &b));
        let parts = vec![Part { corpus: a, weight: 3.0 }, Part { corpus: b, weight: 1.0 }];
        let data = Data::of(parts, None, &[]).unwrap();
        let found = data.likelihood(&mut gpt, Split::Valid, 0).unwrap().unwrap();
        let expected = (15.0 * of_a.bits_per_frame + 25.0 * of_b.bits_per_frame) / 40.0;
        assert!((found.bits_per_frame - expected).abs() < 1e-9, "{} {expected}", found.bits_per_frame);
        assert_eq!((found.frames, found.tokens), (40, 280));
        // 6 and 11 windows
        let some = data.likelihood(&mut gpt, Split::Valid, 8).unwrap().unwrap();
        assert_eq!((some.windows, some.all_windows), (2 + 5, 17));
        assert!(data.has(Split::Valid) && !data.has(Split::Test));
        assert_eq!(data.likelihood(&mut gpt, Split::Test, 0).unwrap(), None);
    }
}
