//! A row of a label CSV, and how several rows of one clip go together.

use super::csv::Field;
use super::labels::Known;
use super::timed::Timed;
use crate::{Error, Result};
use kinelm_store::SourcePos;

/// Columns that say for what time a row's labels hold.
pub(super) const FROM: &str = "from_s";
pub(super) const TO: &str = "to_s";

/// What is known of a clip.
#[derive(Debug, Clone)]
pub(super) struct Row {
    pub clip: String,
    /// The first line of the clip.
    pub line: usize,
    pub known: Known,
    /// The line that tells of the whole clip, if one does.
    pub whole: Option<usize>,
}

impl Row {
    /// Takes what another row of the clip states of it, and looks whether their labels go together; `at` is where that row
    /// says what.
    pub fn merge(&mut self, other: &Known, at: impl Fn(&str) -> SourcePos) -> Result<()> {
        let line = self.line;
        let known = &mut self.known;
        let differs = |column: &str| {
            let (found, help) = (format!("another {column} than in line {line}"), "state it in one of the rows");
            Err(Error::at(at(column), found, format!("one {column} a clip"), help))
        };
        let same = [
            ("split", agree(&mut known.split, &other.split)),
            ("take", agree(&mut known.take, &other.take)),
            ("fps", agree(&mut known.fps, &other.fps)),
            ("skip", agree(&mut known.skip, &other.skip)),
            ("floor", agree(&mut known.floor, &other.floor)),
            ("music_from", agree(&mut known.music_from_s, &other.music_from_s)),
        ];
        if let Some((column, _)) = same.into_iter().find(|(_, same)| !same) {
            return differs(column);
        }
        let always = |known: &Known, line: usize| {
            let (from_s, to_s, labels) = (0.0, f64::INFINITY, known.labels.clone());
            Timed { from_s, to_s, labels, line }
        };
        let (known_always, other_always) = (always(known, self.whole.unwrap_or(line)), always(other, 0));
        for told in known.timed.iter().chain([&known_always]) {
            for new in other.timed.iter().chain([&other_always]).filter(|new| new.meets(told)) {
                if let Some(field) = new.labels.keys().find(|field| told.labels.contains_key(*field)) {
                    let found = format!("{field} at a time at which line {} tells it", told.line);
                    let help = "times are half-open: let one row end where the next begins";
                    return Err(Error::at(at(field), found, "a value of a field at a time", help));
                }
            }
        }
        Ok(())
    }
}

/// Whether two rows can both be right; the first takes what the second alone states.
fn agree<T: Clone + PartialEq>(known: &mut Option<T>, other: &Option<T>) -> bool {
    match (&*known, other) {
        (Some(a), Some(b)) => a == b,
        (None, Some(_)) => {
            known.clone_from(other);
            true
        }
        _ => true,
    }
}

/// Where a record's field of a column stands.
pub(super) fn at_column(header: &[Field], record: &[Field], column: &str) -> SourcePos {
    let index = header.iter().position(|c| c.text == column).unwrap_or(0);
    record[index].at.clone()
}

/// From when until when a record's labels hold, in seconds; `None`: always.
pub(super) fn time_of(header: &[Field], record: &[Field]) -> Result<Option<(f64, f64)>> {
    let field = |column: &str| header.iter().position(|c| c.text == column).map(|i| &record[i]);
    let seconds = |column: &str| {
        let Some(field) = field(column).filter(|field| !field.text.is_empty()) else { return Ok(None) };
        let s: Option<f64> = field.text.parse().ok().filter(|s: &f64| s.is_finite() && *s >= 0.0).map(f64::abs);
        let wrong = || Error::at(field.at.clone(), format!("{column} `{}`", field.text), "seconds, 0 or more", "");
        s.map(|s| Some((s, field))).ok_or_else(wrong)
    };
    match (seconds(FROM)?, seconds(TO)?) {
        (None, None) => Ok(None),
        (from, to) => {
            let (from_s, to_s) = (from.map_or(0.0, |(s, _)| s), to.map_or(f64::INFINITY, |(s, _)| s));
            match to.filter(|_| to_s <= from_s) {
                Some((_, field)) => {
                    let found = format!("{TO} `{}`", field.text);
                    Err(Error::at(field.at.clone(), found, format!("more than {FROM}, {from_s}"), ""))
                }
                None => Ok(Some((from_s, to_s))),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::labels::{Labels, Rule, Table};
    use crate::record::Split;
    use std::collections::BTreeMap;
    use std::path::Path;

    fn table(text: &str) -> crate::Result<Table> {
        Table::parse(Path::new("l.csv"), text.as_bytes())
    }

    #[test]
    fn rows_of_a_clip_go_together() {
        let t = table(
            "clip,split,genre,mood,from_s,to_s\na,train,salsa,,0,2\nb,,waltz,,,\na,,waltz,,2,\na,train,,glad,,\na,,house,,,0\n",
        );
        assert!(t.unwrap_err().to_string().starts_with("l.csv:6:12: found to_s `0`"));
        let t = table("clip,split,genre,mood,from_s,to_s\na,,salsa,,0,2\nb,,waltz,,,\na,,waltz,,2,\na,train,,glad,,\n");
        let (k, rule) = Labels::Table(t.unwrap()).find("a.bvh").unwrap().unwrap();
        let told = |labels: &BTreeMap<String, String>| format!("{labels:?}");
        assert_eq!((rule, k.split, told(&k.labels)), (Rule::Row(0), Some(Split::Train), "{\"mood\": \"glad\"}".into()));
        let timed: Vec<_> = k.timed.iter().map(|t| (t.from_s, t.to_s, told(&t.labels), t.line)).collect();
        let expected = [(0.0, 2.0, "salsa", 2), (2.0, f64::INFINITY, "waltz", 4)];
        assert_eq!(
            timed,
            expected.map(|(from, to, genre, line)| (from, to, format!("{{\"genre\": {genre:?}}}"), line))
        );
    }
}
