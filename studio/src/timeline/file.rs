//! The text of a timeline, changed in place: comments, blanks and the order of keys stay.

use super::segments::Cut;
use crate::library::Source;
use crate::project::dances::free_name;
use crate::project::document::Reading;
use crate::{Error, Result};
use kinelm_motion::joints;
use kinelm_store::Subject;
use kinelm_store::files::path_from;
use serde_json::Value as Json;
use std::path::{Path, PathBuf};
use toml_edit::{ArrayOfTables, DocumentMut, InlineTable, Item, Table, Value};

/// Above the first line of a timeline that the studio begins.
const HEAD: &str = "# a timeline of kinelm: docs/timelines.md has every key\n";

/// A timeline's text, parsed.
#[derive(Debug, Clone)]
pub struct TimelineFile {
    document: DocumentMut,
    folder: PathBuf,
    /// The text that was parsed: its line ends are lost in the document.
    parsed: String,
}

impl TimelineFile {
    /// Parses the text of the file `path`.
    ///
    /// # Errors
    /// Text that is no TOML, with line and column.
    pub fn parse(path: &Path, text: &str) -> Result<TimelineFile> {
        let wrong = |e: toml_edit::TomlError| {
            Error::in_text(path, text, e.span(), e.message(), "a timeline", "docs/timelines.md has examples")
        };
        // toml_edit drops carriage returns: `text` puts them back
        let mut document: DocumentMut = text.parse().map_err(wrong)?;
        // `segment = [{ .. }, ..]` as tables, which can be cut
        if document.get("segment").is_some_and(|item| item.is_value())
            && let Some(item) = document.get_mut("segment")
            && let Ok(tables) = std::mem::take(item).into_array_of_tables()
        {
            *item = Item::ArrayOfTables(tables);
        }
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        Ok(TimelineFile { document, folder, parsed: text.into() })
    }

    /// Its text.
    pub fn text(&self) -> String {
        with_ends_of(&self.parsed, &self.document.to_string())
    }

    /// Whether it has no key at all.
    pub fn says_nothing(&self) -> bool {
        self.document.is_empty()
    }

    /// Whether it has no segment.
    pub fn is_empty(&self) -> bool {
        self.segments() == 0
    }

    /// How many segments it has.
    pub fn segments(&self) -> usize {
        self.document.get("segment").and_then(Item::as_array_of_tables).map_or(0, ArrayOfTables::len)
    }

    /// The clips by name, with their files.
    pub fn clips(&self) -> Vec<(String, PathBuf)> {
        self.of_clips("file").into_iter().map(|(name, file)| (name, file.into())).collect()
    }

    /// The skeleton maps that it states of clips, by the name of the clip.
    pub fn maps(&self) -> Vec<(String, String)> {
        self.of_clips("map")
    }

    /// A key of the clips that have it, by the name of the clip.
    fn of_clips(&self, key: &str) -> Vec<(String, String)> {
        let clips = self.document.get("clips").and_then(Item::as_table_like);
        let text = |item: &Item| item.as_table_like()?.get(key)?.as_str().map(str::to_owned);
        let clips = clips.into_iter().flat_map(|clips| clips.iter());
        clips.filter_map(|(name, item)| Some((name.to_owned(), text(item)?))).collect()
    }

    /// A key at the top, as JSON.
    pub fn top(&self, key: &str) -> Json {
        self.document.get(key).map_or(Json::Null, json)
    }

    /// A segment's keys, as JSON.
    pub fn segment(&self, index: usize) -> Json {
        let tables = self.document.get("segment").and_then(Item::as_array_of_tables);
        let table = tables.and_then(|tables| tables.get(index));
        let keys = table.into_iter().flat_map(|table| table.iter());
        Json::Object(keys.map(|(key, item)| (key.to_owned(), json(item))).collect())
    }

    /// The name under which a timeline has a clip; it is added where it has none. The first clip lends its rig.
    pub fn name_of(&mut self, source: &Source) -> String {
        let same = |file: &Path| {
            let path = self.folder.join(file);
            path == source.path || path.canonicalize().is_ok_and(|path| Some(path) == source.path.canonicalize().ok())
        };
        if let Some((name, _)) = self.clips().into_iter().find(|(_, file)| same(file)) {
            return name;
        }
        let taken: Vec<String> = self.clips().into_iter().map(|(name, _)| name).collect();
        let plain = key_of(&source.name);
        let name = free_name(&plain, "", |name| taken.iter().all(|other| other != name));
        // a timeline can't be laid out without a rig, so the first clip lends its own
        if self.document.get("rig").is_none() {
            if self.document.is_empty() && self.document.trailing().as_str().is_none_or(str::is_empty) {
                self.document.decor_mut().set_prefix(HEAD);
            }
            self.document.insert("rig", toml_edit::value(&name));
        }
        let mut table = Table::new();
        let file = path_from(&self.folder, &source.path);
        // TOML's texts know no other system's separators
        table.insert("file", toml_edit::value(file.to_string_lossy().replace('\\', "/")));
        let clips = self.document.entry("clips").or_insert_with(|| {
            let mut clips = Table::new();
            // no line `[clips]` above `[clips.walk]`
            clips.set_implicit(true);
            Item::Table(clips)
        });
        // `clips = 3` is no table: laying out says so, with its line
        if let Some(clips) = clips.as_table_like_mut() {
            clips.insert(&name, Item::Table(table));
        }
        self.state(&name, &source.stated);
        name
    }

    /// States how a clip is read, and no more than that.
    pub fn state(&mut self, name: &str, reading: &Reading) {
        let clips = self.document.get_mut("clips").and_then(Item::as_table_like_mut);
        let table = clips.and_then(|clips| clips.get_mut(name)).and_then(Item::as_table_like_mut);
        let (Some(table), Ok(Json::Object(stated))) = (table, serde_json::to_value(reading)) else { return };
        for key in Reading::KEYS {
            match stated.get(key).and_then(toml) {
                Some(value) => put(table, key, value),
                None => {
                    table.remove(key);
                }
            }
        }
    }

    /// Sets a key at the top; `null` removes it.
    ///
    /// # Errors
    /// A value that a timeline can't hold.
    pub fn set_top(&mut self, key: &str, value: &Json) -> Result<()> {
        if value.is_null() {
            self.document.remove(key);
            return Ok(());
        }
        let value =
            toml(value).ok_or_else(|| Error::invalid(Subject::of_parameter(key), value, "a number or a text"))?;
        put(self.document.as_table_mut(), key, value);
        Ok(())
    }

    /// The tables of the segments.
    fn tables(&mut self) -> Result<&mut ArrayOfTables> {
        let item = self.document.entry("segment").or_insert_with(|| Item::ArrayOfTables(ArrayOfTables::new()));
        item.as_array_of_tables_mut().ok_or_else(|| Error::invalid("segment of the timeline", "a value", "tables"))
    }

    /// Sets a key of a segment; `null` removes it.
    ///
    /// # Errors
    /// A segment that isn't there, a value that a timeline can't hold.
    pub fn set(&mut self, index: usize, key: &str, value: &Json) -> Result<()> {
        let segments = self.segments();
        let table = self.tables()?.get_mut(index).ok_or_else(|| no_segment(index, segments))?;
        if value.is_null() {
            table.remove(key);
            return Ok(());
        }
        let value =
            toml(value).ok_or_else(|| Error::invalid(Subject::of_parameter(key), value, "a number or a text"))?;
        put(table, key, value);
        Ok(())
    }

    /// Removes a segment.
    ///
    /// # Errors
    /// A segment that isn't there.
    pub fn remove(&mut self, index: usize) -> Result<()> {
        let segments = self.segments();
        if index >= segments {
            return Err(no_segment(index, segments));
        }
        self.tables()?.remove(index);
        Ok(())
    }

    /// Adds a segment after the others.
    ///
    /// # Errors
    /// None for a file that was parsed.
    pub fn add(&mut self, keys: &[(&str, Json)]) -> Result<()> {
        let mut table = Table::new();
        for (key, value) in keys {
            if let Some(value) = toml(value) {
                put(&mut table, key, value);
            }
        }
        table.decor_mut().set_prefix("\n");
        self.tables()?.push(table);
        Ok(())
    }

    /// Writes the segments as they were cut: tables of the file stay, but for the keys whose values have changed.
    ///
    /// # Errors
    /// None for a file that was parsed.
    pub fn write(&mut self, cuts: &[Cut], fps: f64) -> Result<()> {
        let before = std::mem::take(self.tables()?);
        let mut after = ArrayOfTables::new();
        for cut in cuts {
            // the file's own table, with its comments; only the first part of a cut has it
            let own = cut.origin.and_then(|index| before.get(index)).cloned();
            let is_new = own.is_none();
            let mut table = own.unwrap_or_else(|| {
                let mut table = Table::new();
                table.decor_mut().set_prefix("\n");
                table
            });
            match &cut.clip {
                Some(clip) if is_new => put(&mut table, "clip", clip.as_str().into()),
                Some(_) => {}
                // labels alone
                None => ["clip", "joints", "at"].iter().for_each(|key| {
                    table.remove(key);
                }),
            }
            let list = joints::list_of(&cut.joints);
            if cut.clip.is_some() && (cut.changed[0] || (is_new && list != "all")) {
                put(&mut table, "joints", list.into());
            }
            // a time that wasn't changed stays as it was written, be it in frames or in seconds
            if is_new || cut.changed[1] {
                put(&mut table, "from", seconds(cut.frames.start as f64 / fps));
            }
            if is_new || cut.changed[2] {
                put(&mut table, "to", seconds(cut.frames.end as f64 / fps));
            }
            if cut.clip.is_some() && (cut.changed[1] || is_new) && (cut.at_s != 0.0 || table.contains_key("at")) {
                put(&mut table, "at", seconds(cut.at_s));
            }
            if is_new && !cut.labels.is_empty() {
                let labels: InlineTable = cut.labels.iter().collect();
                put(&mut table, "labels", labels.into());
            }
            after.push(table);
        }
        *self.tables()? = after;
        Ok(())
    }
}

/// The text `after` with the line ends of `before`: equal lines at its beginning and end have the old ones, others the
/// usual one.
fn with_ends_of(before: &str, after: &str) -> String {
    // almost always: nothing to put back
    if !before.contains('\r') {
        return after.into();
    }
    let plain = |line: &str| line.trim_end_matches(['\r', '\n']).len();
    // a last line without an end, which has an end now, would run into the line after it
    let is_same = |(a, b): &(&&str, &&str)| a[..plain(a)] == b[..plain(b)] && (a.ends_with('\n') || !b.ends_with('\n'));
    let (old, new): (Vec<&str>, Vec<&str>) =
        (before.split_inclusive('\n').collect(), after.split_inclusive('\n').collect());
    let front = old.iter().zip(&new).take_while(is_same).count();
    // after the front, so that no line is in both
    let back = old[front..].iter().rev().zip(new[front..].iter().rev()).take_while(is_same).count();
    let windows = old.iter().filter(|line| line.ends_with("\r\n")).count();
    let usual = if 2 * windows > old.len() { "\r\n" } else { "\n" };
    let middle = &new[front..new.len() - back];
    let mut text = old[..front].concat();
    for line in middle {
        text.push_str(&line[..plain(line)]);
        text.push_str(if line.ends_with('\n') { usual } else { "" });
    }
    text + &old[old.len() - back..].concat()
}

fn no_segment(index: usize, segments: usize) -> Error {
    Error::invalid_parameter("index", index, format!("one of the {segments} segments, from 0"))
}

/// Puts a value in place of another; blanks and the comment around it stay.
fn put(table: &mut dyn toml_edit::TableLike, key: &str, value: Value) {
    match table.get_mut(key).and_then(Item::as_value_mut) {
        Some(old) => {
            let decor = old.decor().clone();
            *old = value;
            *old.decor_mut() = decor;
        }
        None => {
            table.insert(key, Item::Value(value));
        }
    }
}

/// Seconds as a timeline has them: whole ones without a point.
fn seconds(s: f64) -> Value {
    // a microsecond: 0.30000000000000004 is 0.3, and no rate has frames as short
    let s = (s * 1e6).round() / 1e6;
    if s.fract() == 0.0 { (s as i64).into() } else { s.into() }
}

/// A clip's name as a key without quotes.
fn key_of(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' || c == '_' { c } else { '-' };
    let key: String = name.chars().map(plain).take(40).collect();
    let key = key.trim_matches('-');
    if key.is_empty() { "clip".into() } else { key.into() }
}

fn json(item: &Item) -> Json {
    match item {
        Item::Value(Value::String(text)) => text.value().as_str().into(),
        Item::Value(Value::Integer(number)) => (*number.value()).into(),
        Item::Value(Value::Float(number)) => (*number.value()).into(),
        Item::Value(Value::Boolean(truth)) => (*truth.value()).into(),
        Item::Value(Value::InlineTable(table)) => {
            let of = |(key, value): (&str, &Value)| (key.to_owned(), json(&Item::Value(value.clone())));
            Json::Object(table.iter().map(of).collect())
        }
        Item::Table(table) => Json::Object(table.iter().map(|(key, item)| (key.to_owned(), json(item))).collect()),
        _ => Json::Null,
    }
}

fn toml(value: &Json) -> Option<Value> {
    Some(match value {
        Json::String(text) => text.as_str().into(),
        Json::Number(number) => match number.as_i64() {
            Some(whole) => whole.into(),
            None => seconds(number.as_f64().filter(|number| number.is_finite())?),
        },
        Json::Object(table) => {
            let text = |value: &Json| value.as_str().map(str::to_owned);
            let pairs: Option<Vec<(String, String)>> =
                table.iter().map(|(key, value)| Some((key.clone(), text(value)?))).collect();
            pairs?.into_iter().collect::<InlineTable>().into()
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_as_they_did() {
        let before = "a\r\nb\nc\r\nd";
        assert_eq!(with_ends_of(before, "a\nb\nc\nd"), before);
        assert_eq!(with_ends_of(before, "a\nb\nx\ny\nc\nd"), "a\r\nb\nx\ny\nc\r\nd");
        assert_eq!(with_ends_of("a\r\nb\r\nc\r\n", "a\nx\nc\n"), "a\r\nx\r\nc\r\n");
        assert_eq!(with_ends_of("a\r\n", ""), "");
        assert_eq!(with_ends_of("", "a\n"), "a\n");
        // what is added after a last line without an end stands in a line of its own
        assert_eq!(with_ends_of("a\r\nb\r\nc", "a\nb\nc\nd"), "a\r\nb\r\nc\r\nd");
    }

    #[test]
    fn names_are_keys() {
        for (name, key) in [("walk 3 (final)", "walk-3--final"), ("übung", "bung"), ("...", "clip"), ("a_b-c", "a_b-c")]
        {
            assert_eq!(key_of(name), key);
        }
    }
}
