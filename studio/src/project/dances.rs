//! The files of dances: `.studio/made/d3.bvh` until the user keeps them, then `dances/NAME.bvh`, each beside its
//! sidecar.
//!
//! The first file stays when its dance is kept, so that an undo loses nothing.

use super::document::{Change, DanceRecord, Document};
use super::history::History;
use super::{DANCES, MADE, remove};
use crate::{Error, Result};
use kinelm_generate::provenance::Provenance;
use kinelm_store::output::{Ours, Outputs};
use kinelm_store::sidecar::{FileHash, has_hash_of, is_beside_its_file, name_of, path_of};
use kinelm_store::{input, owned};
use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Dances that are neither kept nor rejected, beyond which the oldest go when a project is opened.
const MOST_MADE: usize = 400;

impl DanceRecord {
    /// Its file, in the project's folder: the kept one if there is one.
    pub fn file(&self) -> Option<&Path> {
        self.kept.as_deref().or(self.made.as_deref())
    }
}

/// The files that a studio may write over: dances as kinelm made them.
pub fn outputs() -> Outputs {
    let is_file = |path: &Path| Ok(is_beside_its_file(path) || has_hash_of(path)?);
    Outputs::new(Ours { is_marked: |_| false, is_file, owner: |_| None }, Vec::<PathBuf>::new(), false)
}

/// A free file for a dance that the user keeps under a name.
pub fn file_for(folder: &Path, document: &Document, name: &str) -> PathBuf {
    let plain = plain_name(name);
    let taken = |file: &Path| document.dances.iter().any(|dance| dance.kept.as_deref() == Some(file));
    let of = |name: &str| Path::new(DANCES).join(name);
    // also the names of dances whose file the user has moved away: it may come back
    let is_free = |file: &Path| !taken(file) && !folder.join(file).exists() && !path_of(&folder.join(file)).exists();
    of(&free_name(&plain, ".bvh", |name| is_free(&of(name))))
}

/// The first of `STEM END`, `STEM-2 END`, .. that is free.
pub fn free_name(stem: &str, end: &str, is_free: impl Fn(&str) -> bool) -> String {
    let numbered = |n: usize| if n == 1 { format!("{stem}{end}") } else { format!("{stem}-{n}{end}") };
    (1..).map(numbered).find(|name| is_free(name)).unwrap_or_default()
}

/// Bytes of a name: file systems take 255, with a number, an extension and a sidecar's.
const MOST_NAME: usize = 160;

/// Marks of writing direction, by which `gpj.bvh` can be made to look like another kind of file.
const DIRECTIONS: [char; 12] = [
    '\u{61c}', '\u{200e}', '\u{200f}', '\u{202a}', '\u{202b}', '\u{202c}', '\u{202d}', '\u{202e}', '\u{2066}',
    '\u{2067}', '\u{2068}', '\u{2069}',
];

/// A name as a file may have it: no separators, control or odd characters, no marks of writing direction, not hidden, of
/// moderate length.
pub fn plain_name(name: &str) -> String {
    let is_odd = |c: char| c.is_control() || "/\\:*?\"<>|".contains(c);
    let seen = name.chars().filter(|c| !DIRECTIONS.contains(c));
    let mut name: String = seen.map(|c| if is_odd(c) { '_' } else { c }).take(80).collect();
    // whole characters, since 80 of them may be 320 bytes
    while name.len() > MOST_NAME {
        name.pop();
    }
    let name = name.trim().trim_start_matches('.').trim_end_matches(['.', ' ']).to_owned();
    // names of devices on Windows
    let stem = name.split('.').next().unwrap_or_default().to_ascii_lowercase();
    let is_device = ["con", "prn", "aux", "nul"].contains(&&*stem)
        || (stem.len() == 4 && (stem.starts_with("com") || stem.starts_with("lpt")));
    match name {
        _ if name.is_empty() => "unnamed".into(),
        _ if is_device => format!("_{name}"),
        name => name,
    }
}

/// Writes a dance that was made, with its sidecar.
///
/// # Errors
/// I/O errors.
pub fn write_made(folder: &Path, id: &str, bytes: &[u8], provenance: Provenance) -> Result<PathBuf> {
    let file = Path::new(MADE).join(format!("{id}.bvh"));
    let path = owned::path(folder, &file)?;
    // a leftover of a process that ended while it wrote: its id was never in the journal, and is given again
    remove(&path)?;
    remove(&path_of(&path))?;
    provenance.write(&path, bytes, &outputs())?;
    Ok(file)
}

/// Makes the kept file of a dance as a change has it.
pub(super) fn settle(folder: &Path, before: Option<&DanceRecord>, after: Option<&DanceRecord>) -> Result<()> {
    let kept = |dance: Option<&DanceRecord>| dance.and_then(|dance| dance.kept.clone());
    let (old, new) = (kept(before), kept(after));
    if old == new {
        return Ok(());
    }
    // copied before the old one goes: a failure in between leaves one too many, not none
    if let (Some(file), Some(made)) = (&new, after.and_then(|dance| dance.made.as_deref())) {
        copy(&owned::path(folder, made)?, &owned::path(folder, file)?)?;
    }
    if let Some(file) = old {
        let path = folder.join(file);
        // a file that was changed since, or whose first one is gone, is the user's
        let made = before.and_then(|dance| dance.made.as_deref()).is_some_and(|made| folder.join(made).is_file());
        if made && has_hash_of(&path).unwrap_or(false) {
            remove(&path)?;
            remove(&path_of(&path))?;
        }
    }
    Ok(())
}

/// Copies a dance with its sidecar, which gets the new name.
fn copy(made: &Path, file: &Path) -> Result<()> {
    // a call that was cut off may have copied it already
    if file.exists() && has_hash_of(file)? {
        return Ok(());
    }
    let bytes = input::peek_bytes(made).map_err(Error::io(made))?;
    let provenance = Provenance::load(&path_of(made))?;
    let output = FileHash { file: name_of(file), ..provenance.output.clone() };
    Ok(Provenance { output, replaces: None, ..provenance }.write(file, &bytes, &outputs())?)
}

/// The change for a dance whose file is missing: it isn't kept any more, or it is removed. `None` if its files are
/// there.
pub(super) fn missing(folder: &Path, dance: &DanceRecord) -> Option<Change> {
    let is_there = |file: &PathBuf| folder.join(file).is_file();
    let kept = dance.kept.clone().filter(is_there);
    let made = dance.made.clone().filter(is_there);
    if kept == dance.kept && (made.is_some() || kept.is_some()) {
        return None;
    }
    let after = DanceRecord { kept, made, ..dance.clone() };
    let after = after.file().is_some().then(|| Box::new(after.clone()));
    Some(Change::Dance { before: Some(Box::new(dance.clone())), after })
}

/// Removes the files of dances that can't be reached any more: rejected ones and the oldest of too many, unless a step
/// or another dance needs them.
pub(super) fn sweep(folder: &Path, document: &Document, history: &History) {
    let open = document.dances.iter().filter(|dance| dance.kept.is_none() && !dance.rejected);
    let oldest: HashSet<&str> = {
        let open: Vec<&str> = open.map(|dance| &*dance.id).collect();
        open.iter().take(open.len().saturating_sub(MOST_MADE)).copied().collect()
    };
    // dances that others were made from: their files are needed to make those again
    let sources = document.dances.iter().flat_map(|dance| dance.source.iter().chain(&dance.rig));
    let sources: HashSet<&str> = sources.map(String::as_str).collect();
    let is_over = |dance: &&DanceRecord| dance.rejected || oldest.contains(&*dance.id);
    let is_needed =
        |dance: &&DanceRecord| dance.kept.is_some() || sources.contains(&*dance.id) || history.has_dance(&dance.id);
    for dance in document.dances.iter().filter(is_over).filter(|dance| !is_needed(dance)) {
        for path in dance.made.iter().map(|made| folder.join(made)) {
            // the sidecar first: a dance without one is of no use, a sidecar without a dance looks like a lost file
            let _ = fs::remove_file(path_of(&path)).and(fs::remove_file(&path));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_plain() {
        assert_eq!(plain_name("\u{202e}hvb.ecnad\u{200f}\u{2066}!\u{2069}"), "hvb.ecnad!");
        for (name, expected) in [
            ("../../etc/passwd", "_.._etc_passwd"),
            ("a/b\\c:d", "a_b_c_d"),
            ("  .hidden. ", "hidden"),
            ("", "unnamed"),
            ("..", "unnamed"),
            ("con", "_con"),
            ("Com1.bvh", "_Com1.bvh"),
            ("a\nb\0", "a_b_"),
            ("arm of salsa 3", "arm of salsa 3"),
        ] {
            assert_eq!(plain_name(name), expected);
            assert!(kinelm_store::files::is_plain(&plain_name(name)));
        }
        assert_eq!(plain_name(&"ä".repeat(300)).chars().count(), 80);
    }
}
