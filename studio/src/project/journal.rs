//! The journal: every change of a project as a line of JSON, synced before anybody is told of it.
//!
//! A process may end at any moment. A line that isn't whole was told nobody and is dropped; a line that is whole
//! counts. When the journal has grown it is written anew, as one line with the state and the steps that can be taken back.

use super::document::{Change, Document};
use super::history::{History, Step};
use crate::{Error, Result};
use kinelm_store::{files, input};
use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The version of the layout.
const SCHEMA: u32 = 1;
/// Bytes that are added before a journal is written anew, at least; and as many as it had then.
const GROWN: u64 = 4 << 20;

/// A line.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Line {
    /// All that was before, the first line.
    Begin {
        /// The layout's version.
        schema: u32,
        /// The state.
        document: Document,
        /// The steps.
        history: History,
        /// The next number of an id.
        next: u64,
    },
    /// A step of the user.
    Step(Step),
    /// Changes that aren't taken back: a dance was made.
    Plain(Vec<Change>),
    /// The last step is taken back.
    Undo,
    /// And carried out again.
    Redo,
}

impl Line {
    /// Whether its ids and files are such as a studio writes, so that a project of somebody else leads to no other file.
    fn is_sound(&self) -> bool {
        let all = |changes: &[Change]| changes.iter().all(Change::is_sound);
        match self {
            Line::Begin { document, history, .. } => {
                document.is_sound() && history.steps().all(|step| all(&step.changes))
            }
            Line::Step(step) => all(&step.changes),
            Line::Plain(changes) => all(changes),
            Line::Undo | Line::Redo => true,
        }
    }
}

/// The state that a journal leads to.
#[derive(Debug, Default)]
pub struct Replayed {
    /// The state.
    pub document: Document,
    /// The steps.
    pub history: History,
    /// The next number of an id.
    pub next: u64,
}

impl Replayed {
    /// Carries a line out; `false` where it can't be.
    pub fn apply(&mut self, line: &Line) -> bool {
        let changes = match line {
            Line::Begin { document, history, next, .. } => {
                (self.document, self.history, self.next) = (document.clone(), history.clone(), *next);
                return true;
            }
            Line::Step(step) => {
                self.history.push(step.clone());
                Some(step.changes.clone())
            }
            Line::Plain(changes) => Some(changes.clone()),
            Line::Undo => self.history.undo(),
            Line::Redo => self.history.redo(),
        };
        let Some(changes) = changes else { return false };
        for change in &changes {
            self.document.apply(change);
            let id = match change {
                Change::Clip { after: Some(clip), .. } => &clip.id,
                Change::Dance { after: Some(dance), .. } => &dance.id,
                _ => continue,
            };
            self.next = self.next.max(super::document::number(id) + 1);
        }
        true
    }
}

/// The file of a journal.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
    bytes: u64,
    /// Where it is written anew.
    limit: u64,
}

impl Journal {
    /// Reads a journal, or begins one.
    ///
    /// # Errors
    /// A line that is none, but for the last; I/O errors.
    pub fn open(path: &Path) -> Result<(Journal, Replayed)> {
        let mut state = Replayed { next: 1, ..Replayed::default() };
        let mut whole = 0;
        if path.exists() {
            let bytes = input::peek_bytes(path).map_err(Error::io(path))?;
            whole = replay(path, &bytes, &mut state)?;
        }
        let file = OpenOptions::new().create(true).append(true).open(path).map_err(Error::io(path))?;
        file.set_len(whole).map_err(Error::io(path))?;
        if whole == 0 {
            files::sync_folder(files::folder_of(path))?;
        }
        let mut journal = Journal { path: path.into(), file, bytes: whole, limit: GROWN };
        if whole > GROWN {
            journal.rewrite(&state)?;
        }
        Ok((journal, state))
    }

    /// Adds a line; it is on the disk when this returns.
    ///
    /// # Errors
    /// I/O errors: the journal is as before then.
    pub fn append(&mut self, line: &Line) -> Result<()> {
        let mut text = serde_json::to_vec(line).map_err(Error::failed)?;
        text.push(b'\n');
        if let Err(e) = self.file.write_all(&text).and_then(|()| self.file.sync_data()) {
            let _ = self.file.set_len(self.bytes);
            return Err(Error::io(&self.path)(e));
        }
        self.bytes += text.len() as u64;
        Ok(())
    }

    /// Whether it is time to write it anew.
    pub fn has_grown(&self) -> bool {
        self.bytes > self.limit
    }

    /// Writes it anew, as the state that it leads to.
    ///
    /// # Errors
    /// I/O errors.
    pub fn rewrite(&mut self, state: &Replayed) -> Result<()> {
        let (document, history) = (state.document.clone(), state.history.clone());
        let line = Line::Begin { schema: SCHEMA, document, history, next: state.next };
        let mut text = serde_json::to_vec(&line).map_err(Error::failed)?;
        text.push(b'\n');
        files::write_whole(&self.path, &text)?;
        self.file = OpenOptions::new().append(true).open(&self.path).map_err(Error::io(&self.path))?;
        self.bytes = text.len() as u64;
        self.limit = 2 * self.bytes + GROWN;
        Ok(())
    }
}

/// Carries out the lines of a journal; returns the bytes of those that are whole.
fn replay(path: &Path, bytes: &[u8], state: &mut Replayed) -> Result<u64> {
    let mut whole = 0;
    for (n, text) in bytes.split_inclusive(|byte| *byte == b'\n').enumerate() {
        let line = text.strip_suffix(b"\n").map(serde_json::from_slice::<Line>);
        let help = "put back the file of a copy, or move it away: clips, dances and the timeline are files beside it";
        match line {
            Some(Ok(Line::Begin { schema, .. })) if schema != SCHEMA => {
                let (found, expected) = (format!("schema {schema}"), format!("schema {SCHEMA}"));
                return Err(Error::file(path, found, expected, help));
            }
            Some(Ok(line)) if !line.is_sound() => {
                let found = format!("line {}: an id or a file that a studio wouldn't write", n + 1);
                return Err(Error::file(path, found, "files below the project's folder", help));
            }
            Some(Ok(line)) if state.apply(&line) => {}
            Some(Ok(_)) => {
                return Err(Error::file(path, format!("line {}: an undo of nothing", n + 1), "a step before it", help));
            }
            Some(Err(e)) => return Err(Error::file(path, format!("line {}: {e}", n + 1), "a change", help)),
            // the process ended, or the power, while it was written: nobody was told of it
            None => break,
        }
        whole += text.len();
    }
    Ok(whole as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(name: &str, before: Option<&str>, after: &str) -> Line {
        let change = Change::Timeline { before: before.map(str::to_owned), after: Some(after.into()) };
        Line::Step(Step { name: name.into(), changes: vec![change] })
    }

    fn open(path: &Path) -> Replayed {
        Journal::open(path).unwrap().1
    }

    #[test]
    fn what_was_appended_is_there_again_and_half_a_line_is_not() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("journal.jsonl");
        let (mut journal, _) = Journal::open(&path).unwrap();
        for line in [step("a", None, "one"), step("b", Some("one"), "two"), Line::Undo] {
            journal.append(&line).unwrap();
        }
        let whole = std::fs::read(&path).unwrap();
        let state = open(&path);
        assert_eq!((state.document.timeline.as_deref(), state.history.counts()), (Some("one"), (1, 1)));
        // cut anywhere, it leads to one of the states that were
        for cut in 0..whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            let state = open(&path);
            assert!([None, Some("one"), Some("two")].contains(&state.document.timeline.as_deref()), "{cut}");
            let (mut journal, _) = Journal::open(&path).unwrap();
            journal.append(&step("c", None, "three")).unwrap();
            assert_eq!(open(&path).document.timeline.as_deref(), Some("three"), "{cut}");
        }
        // a line of zeros, as a file system may leave behind
        std::fs::write(&path, [&whole[..], &[0; 100]].concat()).unwrap();
        assert_eq!(open(&path).history.counts(), (1, 1));
    }

    #[test]
    fn a_damaged_line_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("journal.jsonl");
        let (mut journal, _) = Journal::open(&path).unwrap();
        journal.append(&step("a", None, "one")).unwrap();
        journal.append(&step("b", None, "two")).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, text.replacen("step", "stop", 1)).unwrap();
        let said = Journal::open(&path).unwrap_err().to_string();
        assert!(said.contains("line 1: unknown variant `stop`") && said.contains("move it away"), "{said}");
        // a whole line that can't be read isn't what a process left behind that ended
        std::fs::write(&path, format!("{text}{{\"later\": 1}}\n")).unwrap();
        assert!(Journal::open(&path).unwrap_err().to_string().contains("line 3: unknown variant `later`"));
        assert!(std::fs::read_to_string(&path).unwrap().contains("later"), "nothing of it is lost");
        std::fs::write(&path, format!("\"undo\"\n{text}")).unwrap();
        assert!(Journal::open(&path).unwrap_err().to_string().contains("line 1: an undo of nothing"));
    }

    #[test]
    fn written_anew_it_leads_to_the_same() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("journal.jsonl");
        let (mut journal, mut state) = Journal::open(&path).unwrap();
        let large = "x".repeat(GROWN as usize / 3);
        for n in 0..4 {
            let text = format!("{n}{large}");
            journal.append(&step("a", None, &text)).unwrap();
            state.apply(&step("a", None, &text));
        }
        assert!(journal.has_grown());
        journal.rewrite(&state).unwrap();
        assert!(!journal.has_grown());
        journal.append(&Line::Undo).unwrap();
        let again = open(&path);
        assert_eq!((again.history.counts(), again.next), ((3, 1), 1));
        assert_eq!(again.document.timeline, None, "as before the last step");
    }
}
