//! Labels as tokens in front of a window: `<bos>`, then one token a field, `<unk>` where a clip's label is not known.
//!
//! Fields have one order, whatever order the caller gives: genre, dancer, music, situation, choreography, then the
//! others by name (docs/training.md, "Labels"). The tokens `<field:value>` are the last ids of a run's vocabulary.

use super::record::ClipRecord;
use crate::{Error, Result};
use kinelm_store::Subject;
use kinelm_store::suggest::did_you_mean;
use kinelm_tokenizer::{Special, Tokenizer, Vocabulary};
use std::collections::{BTreeMap, BTreeSet};

/// Fields that stand before all others, in this order.
const FIRST: [&str; 5] = ["genre", "dancer", "music", "situation", "choreography"];

/// The label fields that condition a model, in their order, and the ids of their values.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Conditions {
    fields: Vec<String>,
    /// Per field: value and id, by value.
    values: Vec<BTreeMap<String, u32>>,
    /// Whether all conditioning is hidden, labels and music.
    hidden: bool,
}

impl Conditions {
    /// These fields, in their order, with the values that `vocabulary` has tokens for. A field named twice counts once.
    pub fn new(fields: &[String], vocabulary: &Vocabulary) -> Conditions {
        let fields = in_order(fields);
        let mut values = vec![BTreeMap::new(); fields.len()];
        for (id, token) in (vocabulary.first_conditioning()..).zip(vocabulary.conditioning()) {
            let inner = token.strip_prefix('<').and_then(|t| t.strip_suffix('>'));
            let Some((field, value)) = inner.and_then(|t| t.split_once(':')) else { continue };
            if let Some(at) = fields.iter().position(|f| f == field) {
                values[at].insert(value.to_owned(), id);
            }
        }
        Conditions { fields, values, hidden: false }
    }

    /// No fields: `<bos>` alone stands in front.
    pub fn none() -> Conditions {
        Conditions::default()
    }

    /// The same fields without their values, so that every label is unknown, and music too: the unconditional
    /// half of guidance.
    pub fn unknown(&self) -> Conditions {
        Conditions { fields: self.fields.clone(), values: vec![BTreeMap::new(); self.fields.len()], hidden: true }
    }

    /// Whether all conditioning is hidden, labels and music.
    pub fn are_hidden(&self) -> bool {
        self.hidden
    }

    /// The fields, in their order.
    pub fn fields(&self) -> &[String] {
        &self.fields
    }

    /// The values of a field, sorted; none of a field that is not among them.
    pub fn values(&self, field: &str) -> Vec<&str> {
        let at = self.fields.iter().position(|f| f == field);
        at.map_or_else(Vec::new, |at| self.values[at].keys().map(String::as_str).collect())
    }

    /// K: tokens in front of a window, `<bos>` among them.
    #[allow(clippy::len_without_is_empty, reason = "<bos> is always there")]
    pub fn len(&self) -> usize {
        1 + self.fields.len()
    }

    /// `<bos>` and an id a field, (K); `<unk>` where the labels have no such field or no known value.
    pub fn front(&self, labels: &BTreeMap<String, String>) -> Vec<u32> {
        let id = |(field, values): (&String, &BTreeMap<String, u32>)| {
            labels.get(field).and_then(|value| values.get(value)).copied().unwrap_or(Special::Unk.id())
        };
        std::iter::once(Special::Bos.id()).chain(self.fields.iter().zip(&self.values).map(id)).collect()
    }

    /// As [`Conditions::front`], of pairs of field and value that a caller requests.
    ///
    /// # Errors
    /// An unknown field, an unknown value, a field given twice; the known ones are listed.
    pub fn requested(&self, pairs: &[(String, String)]) -> Result<Vec<u32>> {
        let mut labels = BTreeMap::new();
        for (field, value) in pairs {
            let Some(at) = self.fields.iter().position(|f| f == field) else {
                let known = match self.fields.is_empty() {
                    true => "this model knows no labels; train one with train.conditions".to_string(),
                    false => format!("this model knows {}", self.fields.join(", ")),
                };
                let meant = did_you_mean(field, self.fields.iter().map(String::as_str));
                return Err(Error::unsupported(labels_with(field, value), format!("{known}{meant}")));
            };
            if !self.values[at].contains_key(value) {
                let (known, meant) = (self.values(field), did_you_mean(value, self.values(field)));
                let known = known.join(", ");
                let why = format!("this model knows the {field} {known}{meant}");
                return Err(Error::unsupported(labels_with(field, value), why));
            }
            if labels.insert(field.clone(), value.clone()).is_some() {
                let twice = Subject::of_parameter("labels").with(format!("with {field} twice"));
                return Err(Error::unsupported(twice, "give each field once"));
            }
        }
        Ok(self.front(&labels))
    }
}

/// Fields in the order in which their tokens stand, each once.
pub fn in_order(fields: &[String]) -> Vec<String> {
    let rank = |field: &String| FIRST.iter().position(|f| f == field).unwrap_or(FIRST.len());
    let mut all: Vec<String> = fields.to_vec();
    all.sort_by(|a, b| rank(a).cmp(&rank(b)).then_with(|| a.cmp(b)));
    all.dedup();
    all
}

/// `tokenizer` with a token for every value that the clips have of these fields, after those it has: field by field in
/// their order, values sorted. Earlier ids stay.
///
/// # Errors
/// A field that no clip has, nor the tokenizer a token of, with those there are; a label that can't be a token.
pub fn with_labels<'a>(
    tokenizer: &Tokenizer,
    clips: impl IntoIterator<Item = &'a ClipRecord>,
    fields: &[String],
) -> Result<Tokenizer> {
    let mut all: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for (field, value) in clips.into_iter().flat_map(|c| &c.labels) {
        all.entry(field).or_default().insert(value);
    }
    let mut grown = tokenizer.clone();
    for field in in_order(fields) {
        let Some(values) = all.get(field.as_str()) else {
            if !Conditions::new(std::slice::from_ref(&field), grown.vocabulary()).values(&field).is_empty() {
                continue;
            }
            let known: Vec<&str> = all.keys().copied().collect();
            let known = if known.is_empty() { "no labels at all".into() } else { known.join(", ") };
            let what = format!("training clip has the label `{field}` of train.conditions");
            return Err(Error::missing(what, format!("the clips have {known}")));
        };
        for value in values {
            // in a fixed order: ids are rows of a model's embedding and must not depend on the order of the clips
            grown.vocabulary_mut().add_conditioning(&field, value)?;
        }
    }
    Ok(grown)
}

/// A requested label, for messages.
fn labels_with(field: &str, value: &str) -> Subject {
    Subject::of_parameter("labels").with(format!("with {field}={value}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Corpus;
    use crate::samples::{small, tokenizer};

    fn labels(pairs: &[(&str, &str)]) -> BTreeMap<String, String> {
        pairs.iter().map(|(f, v)| (f.to_string(), v.to_string())).collect()
    }

    fn fields(names: &[&str]) -> Vec<String> {
        names.iter().map(|n| n.to_string()).collect()
    }

    /// Ids from 66 on: two genres, a style, a dancer, a genre.
    fn conditions() -> Conditions {
        let mut t = tokenizer();
        for (f, v) in [("genre", "salsa"), ("genre", "waack"), ("style", "old: new"), ("dancer", "61"), ("genre", "a")]
        {
            t.vocabulary_mut().add_conditioning(f, v).unwrap();
        }
        Conditions::new(&fields(&["style", "angle", "dancer", "genre", "style"]), t.vocabulary())
    }

    #[test]
    fn labels_stand_in_the_order_of_the_protocol() {
        let c = conditions();
        assert_eq!(c.fields(), ["genre", "dancer", "angle", "style"]);
        assert_eq!((c.len(), Conditions::none().len()), (5, 1));
        assert_eq!(c.front(&labels(&[("style", "old: new"), ("genre", "waack"), ("dancer", "60")])), [1, 67, 4, 4, 68]);
        assert_eq!(c.front(&labels(&[])), [1, 4, 4, 4, 4]);
        assert_eq!(c.unknown().front(&labels(&[("genre", "waack")])), [1, 4, 4, 4, 4]);
        assert_eq!(Conditions::none().front(&labels(&[("genre", "waack")])), [1]);
        assert_eq!(
            (c.values("genre"), c.values("angle"), c.values("x")),
            (vec!["a", "salsa", "waack"], vec![], vec![])
        );
    }

    #[test]
    fn what_is_asked_is_known_or_refused_with_what_is() {
        let c = conditions();
        let ask = |pairs: &[(&str, &str)]| {
            let pairs: Vec<_> = pairs.iter().map(|(f, v)| (f.to_string(), v.to_string())).collect();
            c.requested(&pairs).map_err(|e| e.to_string())
        };
        assert_eq!(ask(&[("dancer", "61"), ("genre", "a")]), Ok(vec![1, 70, 69, 4, 4]));
        assert_eq!(ask(&[]), Ok(vec![1, 4, 4, 4, 4]));
        let said = ask(&[("genre", "house")]).unwrap_err();
        assert!(ask(&[("genre", "slasa")]).unwrap_err().ends_with("; did you mean salsa?"));
        assert_eq!(said, "`labels` with genre=house: this model knows the genre a, salsa, waack");
        assert!(ask(&[("mood", "x")]).unwrap_err().ends_with("this model knows genre, dancer, angle, style"));
        assert!(ask(&[("genre", "a"), ("genre", "a")]).unwrap_err().contains("genre twice"));
        let none = Conditions::none().requested(&[("genre".into(), "a".into())]).unwrap_err().to_string();
        assert!(none.contains("this model knows no labels"), "{none}");
    }

    #[test]
    fn a_vocabulary_grows_by_the_labels_and_keeps_its_ids() {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("c");
        small(&dir);
        let corpus = Corpus::open(&dir).unwrap();
        let mut before = corpus.tokenizer().clone();
        before.vocabulary_mut().add_conditioning("music", "x").unwrap();
        let grown = with_labels(&before, corpus.clips(), &fields(&["genre"])).unwrap();
        assert_eq!(grown.vocabulary().conditioning(), ["<music:x>", "<genre:salsa>"]);
        assert_eq!(grown.vocabulary().conditioning_id("music", "x"), before.vocabulary().conditioning_id("music", "x"));
        assert_eq!(grown.base_hash(), corpus.tokenizer().hash());
        assert_eq!(with_labels(&before, corpus.clips(), &[]).unwrap(), before);
        assert_eq!(with_labels(&before, corpus.clips(), &fields(&["music"])).unwrap(), before);
        let said = with_labels(&before, corpus.clips(), &fields(&["dancer"])).unwrap_err().to_string();
        assert_eq!(said, "no training clip has the label `dancer` of train.conditions; the clips have genre");
        assert!(with_labels(&before, [], &fields(&["x"])).unwrap_err().to_string().contains("no labels at all"));
    }
}
