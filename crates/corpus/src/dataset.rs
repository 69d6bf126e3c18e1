//! The motion files of a dataset, with what is known of each.

use super::archive::{self, Member, is_archive};
use super::artifacts;
use super::clip_info::ClipInfo;
use super::item::Item;
use super::labels::{Labels, Rule};
use super::pattern::without_extension;
use super::record::Split;
use super::sidecar;
use super::splits::{self, abbreviated};
use crate::{Error, Result};
use kinelm_motion::format::Format;
use kinelm_store::Subject;
use kinelm_store::input;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The motion files below some folders.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Dataset {
    /// The files, by source and then by path.
    pub items: Vec<Item>,
    /// The files and folders that were searched, as given.
    pub sources: Vec<String>,
    /// Notes for the user, one line each: the labels found and their rules, the files left out, splits that lack something.
    pub notes: Vec<String>,
    /// AMASS files without motion (shapes, first stages) and JSON files that are no clips.
    pub no_motion: usize,
    /// Files that an `ignore_list.txt` names.
    pub ignored: usize,
    /// Files without a row in their label CSV.
    pub without_row: usize,
    /// Rows of label CSVs without a file.
    pub without_file: usize,
}

struct MotionFile {
    path: PathBuf,
    /// Where it lies in an archive, if it does.
    member: Option<Member>,
    /// The path below its source.
    relative: String,
    source: usize,
    /// Whether the file itself was given, not a folder with it.
    is_source: bool,
}

impl Dataset {
    /// Finds the motion files in `data` (files, or folders searched to any depth, in the order of their names) and labels
    /// them. `labels` has a source of labels ([`Labels::parse`]) for each of `data`, or one for all, or none: then the names
    /// of known data sets are tried.
    ///
    /// Files are taken by their extensions ([`Format::extensions`]), those of tar archives too; hidden files and folders are
    /// skipped. An `ignore_list.txt`, as AIST++ has one, leaves out the names that it lists from its folder and all folders
    /// below; one beside a folder of `data` counts too.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`] for a path that can't be read; [`kinelm_store::Error::Missing`] if there is no motion;
    /// [`kinelm_store::Error::Invalid`] for another number of `labels`; [`kinelm_store::Error::File`] if there are only FBX
    /// files, in a build that doesn't read them; those of [`Labels::parse`] and [`Labels::find`].
    pub fn find(data: &[PathBuf], labels: &[String]) -> Result<Dataset> {
        if labels.len() > 1 && labels.len() != data.len() {
            let (found, expected) =
                (labels.len(), format!("none, one for all, or {}, one for each path of data", data.len()));
            return Err(Error::invalid(Subject::about("the number of `labels`", "labels"), found, expected));
        }
        let labels: Vec<Labels> = labels.iter().map(|l| Labels::parse(l)).collect::<Result<_>>()?;
        let mut dataset = Dataset { sources: data.iter().map(|d| slashed(d)).collect(), ..Dataset::default() };
        let (mut found, mut seen) = (Vec::new(), HashSet::new());
        let mut twice = 0;
        for (source, place) in data.iter().enumerate() {
            let mut walk = Walk::new(&mut dataset, source, true);
            walk.start(place)?;
            for file in walk.files {
                // a broken link is reported where it is read
                if seen.insert(fs::canonicalize(&file.path).unwrap_or(file.path.clone())) {
                    found.push(file);
                } else {
                    twice += 1;
                }
            }
        }
        if found.is_empty() {
            let what = format!("motion in {}", dataset.sources.join(", "));
            return Err(Error::missing(what, format!("looked for files ending in {}", Format::read_list())));
        }
        for (count, what) in [
            (dataset.no_motion, "files hold no motion (body shapes, other JSON) and are left out"),
            (dataset.ignored, "files are left out because ignore_list.txt names them"),
            (twice, "files were given twice and are taken once"),
        ] {
            dataset.notes.extend((count > 0).then(|| format!("{count} {what}")));
        }
        let stated = dataset.label(found, &labels)?;
        let notes = splits::assign(&mut dataset.items, &stated);
        dataset.notes.extend(notes);
        dataset.read_sidecars();
        Ok(dataset)
    }

    /// Makes the items; returns the splits stated for them.
    fn label(&mut self, found: Vec<MotionFile>, labels: &[Labels]) -> Result<Vec<Option<Split>>> {
        let names = unique_names(&found, &self.sources)?;
        let mut stated = Vec::new();
        let mut by_rule: BTreeMap<(usize, Rule), (usize, BTreeSet<String>)> = BTreeMap::new();
        let mut rows: BTreeMap<usize, HashSet<usize>> = BTreeMap::new();
        let mut unlabelled: BTreeMap<usize, Vec<String>> = BTreeMap::new();
        for (key, (file, name)) in found.into_iter().zip(names).enumerate() {
            let which = if labels.len() > 1 { file.source } else { 0 };
            let info = match info_of(labels.get(which).unwrap_or(&Labels::Auto), &file)? {
                Some((info, rule)) => {
                    let group = match rule {
                        Rule::Row(row) => {
                            // in the notes all rows of a table are one rule
                            rows.entry(which).or_default().insert(row);
                            Rule::Row(0)
                        }
                        rule => rule,
                    };
                    let (clips, fields) = by_rule.entry((which, group)).or_default();
                    *clips += 1;
                    let timed = info.timed.iter().flat_map(|timed| timed.labels.keys());
                    fields.extend(info.labels.keys().chain(timed).cloned());
                    info
                }
                None => {
                    unlabelled.entry(which).or_default().push(name.clone());
                    ClipInfo::default()
                }
            };
            stated.push(info.split);
            self.items.push(Item {
                take: info.take.unwrap_or_else(|| name.clone()),
                path: file.path,
                member: file.member,
                name,
                labels: info.labels,
                timed: info.timed,
                fps: info.fps,
                skip: info.skip,
                floor: info.floor,
                music_from_s: info.music_from_s,
                key,
                source: file.source,
                ..Item::default()
            });
        }
        for ((_, rule), (count, fields)) in by_rule {
            let fields: Vec<&str> = fields.iter().map(String::as_str).collect();
            let fields = if fields.is_empty() { "no labels".into() } else { fields.join(", ") };
            self.notes.push(format!("{count} clips have labels by {}: {fields}", rule.describe()));
        }
        self.note_unmatched(labels, &rows, &unlabelled);
        Ok(stated)
    }

    /// Notes rows without a file and files without labels, by source of labels.
    fn note_unmatched(
        &mut self,
        labels: &[Labels],
        rows: &BTreeMap<usize, HashSet<usize>>,
        unlabelled: &BTreeMap<usize, Vec<String>>,
    ) {
        for (which, labels) in labels.iter().enumerate() {
            let names: Vec<&str> = unlabelled.get(&which).into_iter().flatten().map(String::as_str).collect();
            let (n, shown) = (names.len(), abbreviated(&names));
            match labels {
                Labels::Table(table) => {
                    let unused = table.unused(|row| rows.get(&which).is_some_and(|r| r.contains(&row)));
                    let unused: Vec<&str> = unused.iter().map(String::as_str).collect();
                    let csv = table.path().display();
                    self.without_file += unused.len();
                    self.without_row += n;
                    let (rows, clips) = (unused.len(), abbreviated(&unused));
                    self.notes.extend((rows > 0).then(|| format!("{csv}: {rows} rows have no file: {clips}")));
                    let what = || format!("{csv}: {n} files have no row and go without labels: {shown}");
                    self.notes.extend((n > 0).then(what));
                }
                Labels::Pattern(p) if n > 0 => {
                    self.notes.push(format!("{n} files don't fit {} and go without labels: {shown}", p.text()));
                }
                _ => {}
            }
        }
        let is_auto = |which: &usize| matches!(labels.get(*which), None | Some(Labels::Auto));
        let auto: usize = unlabelled.iter().filter(|(which, _)| is_auto(which)).map(|(_, names)| names.len()).sum();
        if auto > 0 {
            let help = "their names fit no known pattern; `labels` gives them some";
            self.notes.push(format!("{auto} clips have no labels: {help}"));
        }
    }

    /// Reads how dances with a sidecar are read, and notes it.
    fn read_sidecars(&mut self) {
        let mut described = Vec::new();
        for item in self.items.iter_mut().filter(|item| item.member.is_none()) {
            match sidecar::read_options(&item.path) {
                Ok(None) => continue,
                Ok(options) => item.sidecar = options,
                Err(e) => self.notes.push(e.to_string()),
            }
            let words = item.sidecar.as_ref().and_then(|options| sidecar::describe(options, options));
            described.extend(words.map(|words| (item.path.display().to_string(), words)));
        }
        self.notes.extend(sidecar::describe_all(&described));
    }
}

/// The motion files below a folder, by path, as [`Dataset::find`] finds them; none of those in archives, which have no path.
///
/// # Errors
/// [`kinelm_store::Error::Io`] for paths that can't be read.
pub fn motion_files(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut dataset = Dataset::default();
    let mut walk = Walk::new(&mut dataset, 0, false);
    walk.start(folder)?;
    Ok(walk.files.into_iter().map(|file| file.path).collect())
}

/// The labels of a file. A file that was given itself is also looked up by the folders above it, longest path first,
/// but not by the known names: any folder would pass for a genre.
fn info_of(labels: &Labels, file: &MotionFile) -> Result<Option<(ClipInfo, Rule)>> {
    if !file.is_source || matches!(labels, Labels::Auto) {
        return labels.find(&file.relative);
    }
    let full = slashed(&file.path);
    let starts = std::iter::once(0).chain(full.match_indices('/').map(|(i, _)| i + 1));
    for start in starts {
        if let Some(known) = labels.find(&full[start..])? {
            return Ok(Some(known));
        }
    }
    Ok(None)
}

/// The path below the source without extension; if two are the same, with the extension or the source's name.
fn unique_names(found: &[MotionFile], sources: &[String]) -> Result<Vec<String>> {
    let long = |f: &MotionFile| {
        let source = sources[f.source].trim_end_matches('/');
        format!("{}/{}", source.rsplit('/').next().unwrap_or(source), f.relative)
    };
    let count = |names: &[String]| -> HashMap<String, usize> {
        let mut counts = HashMap::new();
        names.iter().for_each(|n| *counts.entry(n.clone()).or_insert(0) += 1);
        counts
    };
    let mut names: Vec<String> = found.iter().map(|f| without_extension(&f.relative).to_owned()).collect();
    let longer: [&dyn Fn(&MotionFile) -> String; 3] = [&|f| f.relative.clone(), &long, &|f| slashed(&f.path)];
    for longer in longer {
        // only names that clash grow, so that adding a file seldom renames others
        let counts = count(&names);
        for (name, file) in names.iter_mut().zip(found) {
            if counts[name] > 1 {
                *name = longer(file);
            }
        }
    }
    match count(&names).into_iter().find(|(_, n)| *n > 1) {
        Some((name, n)) => {
            let found = format!("the name of {n} clips");
            Err(Error::invalid(name, found, "each name once; rename one of the files"))
        }
        None => Ok(names),
    }
}

/// A path with `/` between its parts.
fn slashed(path: &Path) -> String {
    path.to_string_lossy().replace(std::path::MAIN_SEPARATOR, "/")
}

/// Bytes of a JSON file within which a clip says that it is one.
const HEAD: u64 = 4096;
/// Folders inside each other that are searched at most.
const MAX_DEPTH: usize = 64;

struct Walk<'a> {
    dataset: &'a mut Dataset,
    /// The number of what is searched.
    source: usize,
    /// Whether archives are searched.
    archives: bool,
    files: Vec<MotionFile>,
    /// Folders searched so far: a link may lead back up.
    folders: HashSet<PathBuf>,
}

impl<'a> Walk<'a> {
    fn new(dataset: &'a mut Dataset, source: usize, archives: bool) -> Walk<'a> {
        Walk { dataset, source, archives, files: Vec::new(), folders: HashSet::new() }
    }

    /// Adds a file, or all files of a folder or an archive.
    fn start(&mut self, place: &Path) -> Result<()> {
        let kind = fs::metadata(place).map_err(Error::io(place))?;
        if kind.is_dir() {
            let beside = place.parent().filter(|_| place.file_name().is_some());
            let ignore = beside.map(ignore_list).transpose()?.unwrap_or_default();
            return self.folder(place, "", &ignore);
        }
        if self.archives && is_archive(place) {
            return match self.archive(place, "", &HashSet::new())? {
                Some(why) if self.files.is_empty() => {
                    let help = "copy it again; unpack it, if it is compressed";
                    Err(Error::file(place, why, "a tar archive", help))
                }
                _ => Ok(()),
            };
        }
        let relative = place.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        Format::of(place)?;
        let (path, source) = (place.to_owned(), self.source);
        self.files.push(MotionFile { path, member: None, relative, source, is_source: true });
        Ok(())
    }

    fn folder(&mut self, folder: &Path, relative: &str, ignore: &HashSet<String>) -> Result<()> {
        if let Some(kind) = artifacts::kind(folder) {
            self.dataset.notes.push(format!("{}: {kind}, where no clip is looked for", folder.display()));
            return Ok(());
        }
        if relative.matches('/').count() >= MAX_DEPTH {
            let (found, help) =
                (format!("folders in more than {MAX_DEPTH} others"), "give a folder further in, or move it up");
            return Err(Error::file(folder, found, "fewer folders in each other", help));
        }
        if !self.folders.insert(fs::canonicalize(folder).map_err(Error::io(folder))?) {
            return Ok(());
        }
        let ignore: HashSet<String> = ignore.union(&ignore_list(folder)?).cloned().collect();
        let entries =
            fs::read_dir(folder).and_then(|all| all.map(|e| Ok(e?.file_name())).collect::<std::io::Result<_>>());
        let mut entries: Vec<_> = entries.map_err(Error::io(folder))?;
        // a folder lists its entries in any order; keys and corpora must not depend on it
        entries.sort();
        for name in entries {
            let path = folder.join(&name);
            let name = name.to_string_lossy();
            if name.starts_with('.') {
                continue;
            }
            let relative = if relative.is_empty() { name.to_string() } else { format!("{relative}/{name}") };
            // a broken link counts as a file, and is reported where it is read
            match path.is_dir() {
                true => self.folder(&path, &relative, &ignore)?,
                false if self.archives && is_archive(&path) => {
                    let below = relative.rsplit_once('.').map_or(&*relative, |(name, _)| name);
                    self.archive(&path, below, &ignore)?;
                }
                false => self.file(path, relative, &ignore, None),
            }
        }
        Ok(())
    }

    /// Adds the files of an archive, in its order: so it is read from front to back. Returns why it can't be read to its end,
    /// which is noted, if so.
    fn archive(&mut self, archive: &Path, relative: &str, ignore: &HashSet<String>) -> Result<Option<String>> {
        let members = archive::members(archive).map_err(Error::io(archive))?;
        for (name, member) in members.files {
            let below = if relative.is_empty() { name.clone() } else { format!("{relative}/{name}") };
            if Format::of_name(Path::new(&name)).is_some() {
                self.file(archive.join(&name), below, ignore, Some(member));
            }
        }
        let path = archive.display();
        let note = |why| format!("{path}: {why}: what follows in the archive is left out; copy it again");
        self.dataset.notes.extend(members.fault.as_ref().map(note));
        Ok(members.fault)
    }

    fn file(&mut self, path: PathBuf, relative: String, ignore: &HashSet<String>, member: Option<Member>) {
        let stem = without_extension(&relative);
        if stem == relative {
            return;
        }
        let name = stem.rsplit('/').next().unwrap_or(stem);
        if ignore.contains(name) {
            self.dataset.ignored += 1;
        } else if has_no_motion(&path, name, member.as_ref()) {
            self.dataset.no_motion += 1;
        } else {
            self.files.push(MotionFile { path, member, relative, source: self.source, is_source: false });
        }
    }
}

/// Whether a file in a folder is known to have no motion: body shapes and first stages of AMASS, sidecars of dances
/// (`NAME.kinelm.json`), and JSON without the first key of a clip.
fn has_no_motion(path: &Path, stem: &str, member: Option<&Member>) -> bool {
    match path.extension().map(|e| e.to_ascii_lowercase()) {
        Some(e) if e == "npz" => stem == "shape" || stem.ends_with("_stagei"),
        Some(e) if e == "json" && stem.ends_with(".kinelm") => true,
        Some(e) if e == "json" => {
            let of_file = || {
                let mut head = Vec::new();
                input::peek(path)?.take(HEAD).read_to_end(&mut head)?;
                Ok(head)
            };
            let head = member.map_or_else(of_file, |member| member.first(HEAD));
            head.is_ok_and(|head| !String::from_utf8_lossy(&head).contains("\"schema\""))
        }
        _ => false,
    }
}

/// The names in a folder's `ignore_list.txt`, one per line, without extension.
fn ignore_list(folder: &Path) -> Result<HashSet<String>> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let path = folder.join("ignore_list.txt");
    match input::bytes(&path) {
        Ok(bytes) => {
            let text = String::from_utf8_lossy(&bytes).into_owned();
            Ok(text.lines().map(|l| without_extension(l.trim()).to_owned()).filter(|l| !l.is_empty()).collect())
        }
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(HashSet::new()),
        Err(e) => Err(Error::io(&path)(e)),
    }
}

#[cfg(test)]
mod tests;
