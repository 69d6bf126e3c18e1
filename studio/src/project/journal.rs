//! The journal: every change of a project as a line of JSON with a checksum, synced before any page gets it.
//!
//! ```text
//! {"crc32c":"9ae0daaf","line":{"begin":{"schema":2,..}}}
//! ```
//!
//! The checksum of a line continues that of the line before: a missing, doubled or moved line doesn't fit.
//!
//! A process may end at any moment. A line without its end was never reported to a page and is dropped; one with it
//! counts, and where its checksum is another, the file was damaged and nothing is guessed. When the journal has grown
//! it is written anew, as one line with the state and the steps that can be undone.

use super::JOURNAL;
use super::document::{Change, Document};
use super::history::{History, Step};
use crate::{Error, Result};
use kinelm_store::files;
use kinelm_store::owned::{self, Access};
use kinelm_store::part;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The version of the layout.
const SCHEMA: u32 = 2;
/// Bytes of a journal, at most.
const MOST_BYTES: u64 = 1 << 30;
/// The text around a line and its checksum of 8 hexadecimal digits.
const AROUND: [&str; 3] = ["{\"crc32c\":\"", "\",\"line\":", "}\n"];
/// The least number of bytes that are added before a journal is rewritten, beside as many as it had.
const GROWN: u64 = 4 << 20;
/// The file for a journal without a whole line.
const DAMAGED: &str = ".studio/journal.damaged";

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
    /// Changes that can't be undone: a dance was made.
    Plain(Vec<Change>),
    /// The last step is undone.
    Undo,
    /// The step that was undone last is carried out again.
    Redo,
}

impl Line {
    /// Whether a studio could have written its ids and files: a foreign project must lead to no other file.
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
            // an id is never given again, though its record may be gone
            self.next = self.next.max(super::document::number(id) + 1);
        }
        true
    }
}

/// The file of a journal.
#[derive(Debug)]
pub struct Journal {
    folder: PathBuf,
    file: File,
    bytes: u64,
    /// The checksum of the last line.
    last: u32,
    /// Whether it was empty.
    is_new: bool,
    /// The bytes at which it is rewritten.
    limit: u64,
    /// Whether a part of a line may stand after the whole ones, which could not be cut off.
    is_torn: bool,
}

impl Journal {
    /// Reads the journal of a project's folder, or begins one.
    ///
    /// # Errors
    /// A line that can't be parsed, except for the last; I/O errors.
    pub fn open(folder: &Path) -> Result<(Journal, Replayed)> {
        let mut state = Replayed { next: 1, ..Replayed::default() };
        let bytes = owned::bytes(folder, JOURNAL, MOST_BYTES)?.unwrap_or_default();
        let (whole, last) = replay(&folder.join(JOURNAL), &bytes, &mut state)?;
        if whole == 0 && !bytes.is_empty() {
            // no line of it is whole: it is begun anew, and the damaged one is stored beside it
            files::write_whole(&folder.join(DAMAGED), &bytes)?;
        }
        let file = owned::open(folder, JOURNAL, Access::Append, MOST_BYTES)?;
        let is_new = whole == 0;
        let mut journal =
            Journal { folder: folder.into(), file, bytes: whole, last, is_new, limit: GROWN, is_torn: false };
        // the unfinished line goes, or the next one would be appended to it
        journal.file.set_len(whole).map_err(Error::io(journal.path()))?;
        if is_new {
            part::sync_folder(part::folder_of(&journal.path()))?;
        }
        if whole > GROWN {
            journal.rewrite(&state)?;
        }
        Ok((journal, state))
    }

    fn path(&self) -> PathBuf {
        self.folder.join(JOURNAL)
    }

    /// Whether it was empty when it was opened: the project is new, or its journal is lost.
    pub fn is_new(&self) -> bool {
        self.is_new
    }

    /// Adds a line; it is on the disk when this returns.
    ///
    /// # Errors
    /// I/O errors: the journal is as before then.
    pub fn append(&mut self, line: &Line) -> Result<()> {
        let (text, last) = to_text(line, self.last)?;
        if self.is_torn {
            self.file.set_len(self.bytes).map_err(Error::io(self.path()))?;
            self.is_torn = false;
        }
        if let Err(e) = self.file.write_all(&text).and_then(|()| self.file.sync_data()) {
            // half a line may be there: the next line must not be appended to it, so none is until it could be cut off
            self.is_torn = self.file.set_len(self.bytes).is_err();
            return Err(Error::io(self.path())(e));
        }
        self.bytes += text.len() as u64;
        self.last = last;
        Ok(())
    }

    /// Whether it is time to rewrite it.
    pub fn has_grown(&self) -> bool {
        self.bytes > self.limit
    }

    /// Replaces it by one line with its state.
    ///
    /// # Errors
    /// I/O errors.
    pub fn rewrite(&mut self, state: &Replayed) -> Result<()> {
        let (document, history) = (state.document.clone(), state.history.clone());
        let line = Line::Begin { schema: SCHEMA, document, history, next: state.next };
        let (text, last) = to_text(&line, 0)?;
        files::write_whole(&self.path(), &text)?;
        // the old file has no name any more: lines that went there would be lost
        self.file = owned::open(&self.folder, JOURNAL, Access::Append, MOST_BYTES)?;
        (self.bytes, self.last, self.is_torn) = (text.len() as u64, last, false);
        // doubled, so that writing it anew costs each line a constant share
        self.limit = 2 * self.bytes + GROWN;
        Ok(())
    }
}

/// A line with its checksum and its end, and the checksum, which goes on from that of the line before.
fn to_text(line: &Line, last: u32) -> Result<(Vec<u8>, u32)> {
    let line = serde_json::to_vec(line).map_err(Error::failed)?;
    let [before, between, after] = AROUND;
    let checksum = crc32c::crc32c_append(last, &line);
    let digits = format!("{checksum:08x}");
    Ok(([before.as_bytes(), digits.as_bytes(), between.as_bytes(), &line, after.as_bytes()].concat(), checksum))
}

/// Parses a line of a text that has its end, after one with the checksum `last`, which becomes its own.
fn of_text(text: &[u8], last: &mut u32) -> std::result::Result<Line, String> {
    let [before, between, after] = AROUND;
    let line = (|| {
        let (checksum, rest) = text.strip_prefix(before.as_bytes())?.split_at_checked(8)?;
        let line = rest.strip_prefix(between.as_bytes())?.strip_suffix(after.as_bytes())?;
        Some((checksum, line))
    })();
    let (checksum, line) = line.ok_or("no checksum, as a journal of another version of kinelm has none")?;
    *last = crc32c::crc32c_append(*last, line);
    let found = format!("{last:08x}");
    match found.as_bytes() == checksum {
        true => serde_json::from_slice(line).map_err(|e| e.to_string()),
        false => Err(format!("CRC-32C {found}, {} stands before it", String::from_utf8_lossy(checksum))),
    }
}

/// Carries out the lines of a journal; returns the bytes of those that are whole, and the checksum of the last.
fn replay(path: &Path, bytes: &[u8], state: &mut Replayed) -> Result<(u64, u32)> {
    let (mut whole, mut last) = (0, 0);
    for (n, text) in bytes.split_inclusive(|byte| *byte == b'\n').enumerate() {
        // only the last can lack its end; a checksum that is wrong before it is damage, not an interruption
        let line = text.ends_with(b"\n").then(|| of_text(text, &mut last));
        let help = "put back the file of a copy, or move it away: clips, dances and the timeline are files beside it";
        match line {
            Some(Ok(Line::Begin { schema, .. })) if schema != SCHEMA => {
                let (found, expected) = (format!("schema {schema}"), format!("schema {SCHEMA}"));
                return Err(Error::file(path, found, expected, help));
            }
            // checked line by line, before any is carried out: paths of a foreign project lead nowhere else
            Some(Ok(line)) if !line.is_sound() => {
                let found = format!("line {}: an id or a file that a studio wouldn't write", n + 1);
                return Err(Error::file(path, found, "files below the project's folder", help));
            }
            Some(Ok(line)) if state.apply(&line) => {}
            Some(Ok(_)) => {
                return Err(Error::file(path, format!("line {}: an undo of nothing", n + 1), "a step before it", help));
            }
            Some(Err(e)) => return Err(Error::file(path, format!("line {}: {e}", n + 1), "a change", help)),
            // the process ended, or the power, while it was written: no page has got it
            None => break,
        }
        whole += text.len();
    }
    Ok((whole as u64, last))
}

#[cfg(test)]
mod tests {
    use super::super::OWN;
    use super::*;
    use std::fs;

    fn step(name: &str, before: Option<&str>, after: &str) -> Line {
        let change = Change::Timeline { before: before.map(str::to_owned), after: Some(after.into()) };
        Line::Step(Step { name: name.into(), changes: vec![change] })
    }

    /// A project's folder.
    fn folder() -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join(OWN)).unwrap();
        dir
    }

    fn open(dir: &tempfile::TempDir) -> Replayed {
        Journal::open(dir.path()).unwrap().1
    }

    #[test]
    fn what_was_appended_is_there_again_and_half_a_line_is_not() {
        let dir = folder();
        let path = dir.path().join(JOURNAL);
        let (mut journal, _) = Journal::open(dir.path()).unwrap();
        assert!(journal.is_new());
        for line in [step("a", None, "one"), step("b", Some("one"), "two"), Line::Undo] {
            journal.append(&line).unwrap();
        }
        let whole = fs::read(&path).unwrap();
        let state = open(&dir);
        assert_eq!((state.document.timeline.as_deref(), state.history.counts()), (Some("one"), (1, 1)));
        // cut anywhere, it leads to one of the states that were
        for cut in 0..whole.len() {
            fs::write(&path, &whole[..cut]).unwrap();
            let state = open(&dir);
            assert!([None, Some("one"), Some("two")].contains(&state.document.timeline.as_deref()), "{cut}");
            let (mut journal, _) = Journal::open(dir.path()).unwrap();
            assert_eq!(journal.is_new(), !whole[..cut].contains(&b'\n'), "{cut}");
            journal.append(&step("c", None, "three")).unwrap();
            assert_eq!(open(&dir).document.timeline.as_deref(), Some("three"), "{cut}");
        }
        // a line of zeros, as a file system may leave after a power cut
        fs::write(&path, [&whole[..], &[0; 100]].concat()).unwrap();
        assert_eq!(open(&dir).history.counts(), (1, 1));
    }

    #[test]
    fn every_flipped_bit_is_found_and_its_line_named() {
        let dir = folder();
        let path = dir.path().join(JOURNAL);
        let (mut journal, _) = Journal::open(dir.path()).unwrap();
        for line in [step("a", None, "one"), step("b", Some("one"), "two")] {
            journal.append(&line).unwrap();
        }
        let whole = fs::read(&path).unwrap();
        let ends: Vec<usize> = (0..whole.len()).filter(|&at| whole[at] == b'\n').collect();
        for at in 0..whole.len() {
            for bit in 0..8 {
                let mut flipped = whole.clone();
                flipped[at] ^= 1 << bit;
                fs::write(&path, &flipped).unwrap();
                let opened = Journal::open(dir.path()).map(|(_, state)| state.document.timeline);
                match opened {
                    // without its end the last line was never reported to a page
                    Ok(timeline) => assert!(at == ends[1] && timeline.as_deref() == Some("one"), "{at} {bit}"),
                    Err(e) => {
                        let line = 1 + usize::from(at > ends[0]);
                        assert!(e.to_string().contains(&format!("line {line}: ")), "{at} {bit}: {e}");
                        assert_eq!(fs::read(&path).unwrap(), flipped, "nothing of it is lost");
                    }
                }
            }
        }
    }

    #[test]
    fn lines_that_are_missing_doubled_or_swapped_are_found() {
        let dir = folder();
        let path = dir.path().join(JOURNAL);
        let (mut journal, _) = Journal::open(dir.path()).unwrap();
        for text in ["one", "two", "three"] {
            journal.append(&step("a", None, text)).unwrap();
        }
        let whole = fs::read_to_string(&path).unwrap();
        let lines: Vec<&str> = whole.split_inclusive('\n').collect();
        for (order, line) in [(&[1, 2][..], 1), (&[0, 2], 2), (&[0, 0, 1, 2], 2), (&[0, 2, 1], 2), (&[1, 0, 2], 1)] {
            fs::write(&path, order.iter().map(|n| lines[*n]).collect::<String>()).unwrap();
            let said = Journal::open(dir.path()).unwrap_err().to_string();
            assert!(said.contains(&format!("line {line}: CRC-32C")), "{order:?}: {said}");
        }
        // a journal without a whole line is begun anew, and stored beside it
        fs::write(&path, &lines[0][..40]).unwrap();
        assert!(Journal::open(dir.path()).unwrap().0.is_new());
        assert_eq!(fs::read_to_string(dir.path().join(DAMAGED)).unwrap(), lines[0][..40]);
    }

    #[test]
    fn a_line_that_is_none_is_named() {
        let dir = folder();
        let path = dir.path().join(JOURNAL);
        let with = |line: &str| {
            let [before, between, after] = AROUND;
            format!("{before}{:08x}{between}{line}{after}", crc32c::crc32c(line.as_bytes()))
        };
        let (document, history) = (Document::default(), History::default());
        let (other, _) = to_text(&Line::Begin { schema: 1, document, history, next: 1 }, 0).unwrap();
        let other = String::from_utf8(other).unwrap();
        for (text, said) in [
            (with("{\"later\":1}"), "line 1: unknown variant `later`"),
            (with("\"undo\""), "line 1: an undo of nothing"),
            (other, "schema 1, expected schema 2"),
            ("\"undo\"\n".into(), "line 1: no checksum"),
        ] {
            fs::write(&path, &text).unwrap();
            let found = Journal::open(dir.path()).unwrap_err().to_string();
            assert!(found.contains(said) && found.contains("move it away"), "{said}: {found}");
            assert_eq!(fs::read_to_string(&path).unwrap(), text, "nothing of it is lost");
        }
    }

    #[test]
    fn written_anew_it_leads_to_the_same() {
        let dir = folder();
        let (mut journal, mut state) = Journal::open(dir.path()).unwrap();
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
        let again = open(&dir);
        assert_eq!((again.history.counts(), again.next), ((3, 1), 1));
        assert_eq!(again.document.timeline, None, "as before the last step");
    }
}
