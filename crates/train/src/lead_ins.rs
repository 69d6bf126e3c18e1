//! Selection of lead-ins: seconds of training clips with which unprompted dances begin.

use super::data::Data;
use crate::Result;
use kinelm_corpus::{ClipRecord, Corpus, Split};
use kinelm_model::lead_in;
use kinelm_model::lead_in::{LEAD_INS, LeadIn, LeadInFrom, LeadIns};
use kinelm_store::{files, random};
use kinelm_tokenizer::UncodedPose;
use std::path::Path;

/// Lead-ins per label value, and of clips with any labels.
const EACH: u64 = 8;
/// Candidates for each.
const CANDIDATES: usize = 5;

/// A train clip that is long enough.
struct Candidate<'a> {
    /// The corpus's number, from 1.
    number: usize,
    corpus: &'a Corpus,
    clip: &'a ClipRecord,
    /// The number of words that a lead-in can begin at.
    starts: usize,
    /// The corpus's weight.
    weight: f64,
}

/// Writes the lead-ins of a run, unless it has some.
///
/// # Errors
/// A corpus that can no longer be read; what the system refuses.
pub fn write(run: &Path, seed: u64, data: &Data) -> Result<()> {
    let path = run.join(LEAD_INS);
    if path.exists() {
        return Ok(());
    }
    Ok(files::write_whole(&path, select(seed, data)?.to_json().as_bytes())?)
}

/// Eight lead-ins of any clips and eight per value of the label fields, from random streams of the run's seed.
///
/// # Errors
/// A corpus that can no longer be read.
pub fn select(seed: u64, data: &Data) -> Result<LeadIns> {
    let words = lead_in::words(data.tokenizer());
    let mut all = Vec::new();
    for (number, part) in (1..).zip(data.parts()) {
        let (corpus, weight) = (&part.corpus, part.weight);
        for clip in corpus.split(Split::Train) {
            // + 1: a clip of exactly that many words has one start
            let starts = (corpus.words(clip).len() + 1).saturating_sub(words);
            all.extend((starts > 0).then_some(Candidate { number, corpus, clip, starts, weight }));
        }
    }
    let mut group = 0..;
    let mut of = |clips: &[&Candidate]| {
        let group = group.next().unwrap_or_default();
        of_clips(seed, group, clips, words, data)
    };
    let any = of(&all.iter().collect::<Vec<_>>())?;
    let mut labelled = Vec::new();
    for field in data.conditions().fields() {
        for value in data.conditions().values(field) {
            let has = |c: &&Candidate| c.clip.labels.get(field).is_some_and(|own| own == value);
            labelled.extend(of(&all.iter().filter(has).collect::<Vec<_>>())?);
        }
    }
    Ok(LeadIns::new(data.tokenizer(), any, labelled))
}

/// Lead-ins of some clips. All starts, weighted as in training, are divided into [`EACH`] equal stretches. Each stretch
/// gives the second fastest of [`CANDIDATES`] random starts: from standing a dance tends to stay still, and the fastest may be a
/// jump. Duplicates are dropped.
fn of_clips(seed: u64, group: u64, clips: &[&Candidate], words: usize, data: &Data) -> Result<Vec<LeadIn>> {
    let mass = |c: &Candidate| c.weight * c.starts as f64;
    let all: f64 = clips.iter().map(|c| mass(c)).sum();
    let mut found: Vec<LeadIn> = Vec::new();
    for i in 0..EACH {
        let mut rng = random::stream(seed, "lead-in", group, i);
        let mut candidates: Vec<(f64, LeadIn)> = Vec::new();
        for _ in 0..CANDIDATES {
            // one stretch each, so that long clips don't give all eight
            let mut at = (i as f64 + random::unit(&mut rng)) / EACH as f64 * all;
            let Some(last) = clips.last() else { return Ok(found) };
            let clip = clips.iter().find(|c| {
                let here = at < mass(c);
                at -= if here { 0.0 } else { mass(c) };
                here
            });
            // rounded sums may end after the last clip
            let lead_in = clip.unwrap_or(last).lead_in(at, words, data)?;
            candidates.push((speed(&lead_in.ids, data)?, lead_in));
        }
        // stable, and total_cmp orders NaN: the same seed gives the same lead-ins
        candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (_, second) = candidates.swap_remove(1);
        if found.iter().all(|other| other.from != second.from) {
            found.push(second);
        }
    }
    Ok(found)
}

impl Candidate<'_> {
    /// The lead-in at a position of its starts, each as wide as the corpus's weight.
    fn lead_in(&self, at: f64, words: usize, data: &Data) -> Result<LeadIn> {
        // rounding may put `at` on the end of the last start
        let word = ((at / self.weight) as usize).min(self.starts - 1);
        let frame = word * data.tokenizer().frames_per_word();
        let from = LeadInFrom { corpus: self.number, clip: self.clip.name.clone(), frame };
        let labels = self.clip.labels.iter().filter(|(field, _)| data.conditions().fields().contains(field));
        let labels = labels.map(|(field, value)| (field.clone(), value.clone())).collect();
        Ok(LeadIn { from, labels, ids: self.corpus.word_ids(self.clip, word..word + words)? })
    }
}

/// Mean speed of the joints over some words, m/s.
fn speed(ids: &[u32], data: &Data) -> Result<f64> {
    let tokenizer = data.tokenizer();
    let clip = tokenizer.decode(&tokenizer.words_of_ids(ids).words, UncodedPose::Identity)?;
    let (places, joints) = (clip.positions(), clip.joints());
    let steps = places.iter().zip(places.iter().skip(joints)).map(|(a, b)| (*b - *a).length());
    Ok(steps.sum::<f64>() / places.len().saturating_sub(joints).max(1) as f64 * clip.fps())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Part;
    use crate::fixture;
    use std::collections::BTreeSet;

    #[test]
    fn each_label_value_has_its_own_from_train_clips_that_have_it() {
        let dir = tempfile::tempdir().unwrap();
        let clips =
            [(300, Split::Train), (200, Split::Train), (19, Split::Train), (90, Split::Valid), (21, Split::Train)];
        let corpus = fixture::corpus(dir.path(), &clips);
        let data = Data::of(vec![Part { corpus, weight: 2.0 }], None, &["genre".into()]).unwrap();
        let all = select(5, &data).unwrap();
        assert_eq!(select(5, &data).unwrap(), all);
        assert_ne!(select(6, &data).unwrap(), all);
        write(dir.path(), 5, &data).unwrap();
        write(dir.path(), 6, &data).unwrap();
        assert_eq!(LeadIns::load(dir.path(), data.tokenizer()).unwrap(), Some(all.clone()), "what is there stays");
        let chosen = |genre: Option<&str>| {
            let labels: Vec<_> = genre.map(|value| ("genre".to_owned(), value.to_owned())).into_iter().collect();
            let front = data.conditions().requested(&labels).unwrap();
            let of = |seed| all.choose(data.conditions(), &front, seed).unwrap();
            (0..200)
                .map(of)
                .map(|l| (l.from.clip.clone(), l.from.frame, l.labels["genre"].clone()))
                .collect::<BTreeSet<_>>()
        };
        let corpus = &data.parts()[0].corpus;
        for (genre, own) in
            [(None, &["clip0", "clip1", "clip4"][..]), (Some("a"), &["clip0", "clip4"]), (Some("b"), &["clip1"])]
        {
            let found = chosen(genre);
            assert_eq!(found.len(), 8, "{found:?}");
            assert!(found.iter().all(|(clip, ..)| own.contains(&clip.as_str())), "{found:?}");
            assert!(genre.is_none_or(|genre| found.iter().all(|(_, _, own)| own == genre)), "{found:?}");
        }
        for lead_in in chosen(None) {
            let clip = corpus.clips().iter().find(|clip| clip.name == lead_in.0).unwrap();
            let from = LeadInFrom { corpus: 1, clip: lead_in.0.clone(), frame: lead_in.1 };
            let ids = corpus.word_ids(clip, lead_in.1..lead_in.1 + 20).unwrap();
            assert_eq!(all.find(&from).unwrap().ids, ids);
        }
        // two of its starts, for any length of the others
        assert!(chosen(Some("b")).iter().all(|(_, frame, _)| *frame <= 180));
    }

    #[test]
    fn corpora_are_weighted_as_in_training() {
        let dir = tempfile::tempdir().unwrap();
        let corpora = ["a", "b"].map(|name| {
            std::fs::create_dir(dir.path().join(name)).unwrap();
            fixture::corpus(&dir.path().join(name), &[(300, Split::Train)])
        });
        let parts = corpora.into_iter().zip([1.0, 3.0]).map(|(corpus, weight)| Part { corpus, weight }).collect();
        let data = Data::of(parts, None, &[]).unwrap();
        let all = select(5, &data).unwrap();
        let of = |seed| all.choose(data.conditions(), &[1], seed).unwrap().from.clone();
        let found: BTreeSet<_> = (0..200).map(of).map(|from| (from.corpus, from.frame)).collect();
        assert_eq!(found.iter().filter(|(corpus, _)| *corpus == 1).count(), 2, "{found:?}");
        assert_eq!(found.len(), 8, "{found:?}");
    }

    #[test]
    fn words_of_any_length_and_clips_that_are_all_too_short() {
        let dir = tempfile::tempdir().unwrap();
        let data = Data::one(fixture::merged(dir.path(), &[(60, Split::Train), (40, Split::Train)])).unwrap();
        write(dir.path(), 1, &data).unwrap();
        assert!(LeadIns::load(dir.path(), data.tokenizer()).unwrap().is_some(), "ids of whole words");
        let dir = tempfile::tempdir().unwrap();
        let data = Data::one(fixture::corpus(dir.path(), &[(19, Split::Train)])).unwrap();
        write(dir.path(), 1, &data).unwrap();
        let none = LeadIns::load(dir.path(), data.tokenizer()).unwrap().unwrap();
        assert!(none.choose(data.conditions(), &[1], 1).is_none());
    }
}
