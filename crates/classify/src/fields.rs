//! Label fields and their classes.

use crate::{Error, Result};
use kinelm_corpus::labels::LabelFilter;
use kinelm_corpus::{ClipRecord, Corpus, Split};
use serde::{Deserialize, Serialize};

/// A label field and its classes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Field {
    /// Its name, such as `genre`.
    pub name: String,
    /// Its values in the training clips, sorted.
    pub classes: Vec<String>,
    /// Training clips of each class.
    pub clips: Vec<usize>,
}

impl Field {
    /// The class of a clip; `None` without the label, or with a value that no training clip has.
    pub fn class_of(&self, clip: &ClipRecord) -> Option<usize> {
        let value = clip.labels.get(&self.name)?;
        self.classes.binary_search(value).ok()
    }

    /// The class of a mirrored clip: the one whose name has left and right exchanged, or the same where it names neither;
    /// `None` where there is no such class.
    pub fn mirrored(&self, class: usize) -> Option<usize> {
        let name = &self.classes[class];
        let mut swapped = String::with_capacity(name.len());
        // words end at any other sign: `left_foot` and `left-foot` have two
        for part in name.split_inclusive(|c: char| !c.is_alphanumeric()) {
            let word = part.trim_end_matches(|c: char| !c.is_alphanumeric());
            let other = match word {
                "left" => "right",
                "right" => "left",
                same => same,
            };
            swapped.push_str(other);
            swapped.push_str(&part[word.len()..]);
        }
        self.classes.binary_search(&swapped).ok()
    }
}

/// The fields of a classifier, in the order of its class tokens.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fields(pub Vec<Field>);

impl Fields {
    /// These fields, with the classes that the training clips among `clips` have.
    ///
    /// # Errors
    /// A field given twice, one that no training clip has (the message lists those that are), one of a single class.
    pub fn of(corpus: &Corpus, clips: &[&ClipRecord], names: &[String]) -> Result<Fields> {
        let train: Vec<&ClipRecord> = clips.iter().copied().filter(|c| c.split == Split::Train).collect();
        let mut fields: Vec<Field> = Vec::new();
        for name in names {
            if fields.iter().any(|f| f.name == *name) {
                return Err(Error::invalid_parameter("fields", format!("{name}, given twice"), "every field once"));
            }
            let mut classes: Vec<String> = train.iter().filter_map(|c| c.labels.get(name)).cloned().collect();
            classes.sort();
            classes.dedup();
            if classes.len() < 2 {
                return Err(too_few(corpus, &train, name, &classes));
            }
            let count = |class: &String| train.iter().filter(|c| c.labels.get(name) == Some(class)).count();
            let clips = classes.iter().map(count).collect();
            fields.push(Field { name: name.clone(), classes, clips });
        }
        match fields.is_empty() {
            true => Err(Error::missing("label field to classify by", "give some as `fields`, such as genre,dancer")),
            false => Ok(Fields(fields)),
        }
    }

    /// The same with the clips of each class counted among `clips`.
    pub fn counted(mut self, clips: &[&ClipRecord]) -> Fields {
        for field in &mut self.0 {
            let mut counts = vec![0; field.classes.len()];
            clips.iter().filter_map(|c| field.class_of(c)).for_each(|class| counts[class] += 1);
            field.clips = counts;
        }
        self
    }

    /// n: the number of fields.
    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is no field.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

fn too_few(corpus: &Corpus, train: &[&ClipRecord], name: &str, classes: &[String]) -> Error {
    let mut known: Vec<&String> = train.iter().flat_map(|c| c.labels.keys()).collect();
    known.sort();
    known.dedup();
    let known = known.into_iter().map(String::as_str).collect::<Vec<_>>().join(", ");
    let (found, help) = match classes {
        [one] => {
            (format!("the training clips have one {name} alone, {one}"), "take other clips, or another split".into())
        }
        _ if train.is_empty() => ("no training clips".into(), "give some clips the split `train`".into()),
        _ if known.is_empty() => (format!("no training clip has the label `{name}`"), "tokenize with `labels`".into()),
        _ => (format!("no training clip has the label `{name}`"), format!("they have {known}")),
    };
    Error::file(corpus.dir(), found, format!("training clips of two classes of `{name}` or more"), help)
}

/// The clips of a corpus that have frames and all these labels.
///
/// # Errors
/// There are none.
pub fn clips<'a>(corpus: &'a Corpus, only: &[LabelFilter]) -> Result<Vec<&'a ClipRecord>> {
    let meets = |c: &&ClipRecord| c.frames > 0 && only.iter().all(|label| label.allows(&c.labels));
    let found: Vec<&ClipRecord> = corpus.clips().iter().filter(meets).collect();
    if found.is_empty() {
        let labels: Vec<String> = only.iter().map(LabelFilter::to_string).collect();
        let expected = format!("clips with {}", if labels.is_empty() { "frames".into() } else { labels.join(", ") });
        return Err(Error::file(corpus.dir(), "no such clip", expected, "see kinelm corpus stats for the labels"));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirror_exchanges_left_and_right_in_a_class() {
        let classes = ["run", "turn-left", "turn-right", "wave left hand"].map(String::from).to_vec();
        let field = Field { name: "content".into(), clips: vec![1; 4], classes };
        assert_eq!([0, 1, 2, 3].map(|class| field.mirrored(class)), [Some(0), Some(2), Some(1), None]);
        // a word of which left is a part
        let classes = vec!["cleft".into(), "leftover".into()];
        let field = Field { classes, ..field };
        assert_eq!([0, 1].map(|class| field.mirrored(class)), [Some(0), Some(1)]);
    }
}
