//! Motion files below the folders given, with what is known of each.

use super::labels::{Known, Labels, Rule};
use super::left_out::Range;
use super::pattern::{EXTENSIONS, without_extension};
use super::record::Split;
use super::sidecar;
use super::splits::{self, some_of};
use super::timed::{Piece, Timed};
use crate::{Error, Result, ours};
use kinelm_motion::format::{Format, ReadOptions};
use kinelm_store::{counted, input};
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A motion file and what is known of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Item {
    /// The file.
    pub path: PathBuf,
    /// Its path below its source without extension, `/` between parts; unique among all items.
    pub name: String,
    /// Field to value.
    pub labels: BTreeMap<String, String>,
    /// Labels that hold for a time alone; [`super::timed::in_pieces`] cuts by them.
    pub timed: Vec<Timed>,
    /// What of it a corpus does without.
    pub left_out: Vec<Range>,
    /// What of the file it is, where it was cut.
    pub piece: Option<Piece>,
    /// The recording; the name where nothing else is known.
    pub take: String,
    /// Which part of the experiment it serves.
    pub split: Split,
    /// The true source rate, where its labels state it.
    pub fps: Option<f64>,
    /// Source frames to leave out at the start, where its labels state it.
    pub skip: Option<usize>,
    /// Where the floor is, metres, where its labels state it.
    pub floor: Option<f64>,
    /// How its sidecar says that it is read, if it is a dance that has one.
    pub told: Option<ReadOptions>,
    /// The time of its music at which it begins, seconds, where its labels state it.
    pub music_from_s: Option<f64>,
    /// Its place among all items.
    pub key: usize,
    /// Index into [`Gathered::sources`].
    pub source: usize,
}

impl Item {
    /// The clip's name, whatever piece of it this is.
    pub fn clip_name(&self) -> &str {
        let of_piece = self.piece.and_then(|_| self.name.rsplit_once('@'));
        of_piece.map_or(&self.name, |(name, _)| name)
    }
}

impl Item {
    /// Its path below its source, as a message names it.
    pub fn file_name(&self) -> String {
        let name = self.clip_name();
        match self.path.extension().map(|e| e.to_string_lossy()) {
            Some(extension) if !name.ends_with(&format!(".{extension}")) => format!("{name}.{extension}"),
            _ => name.to_owned(),
        }
    }
}

impl Default for Item {
    fn default() -> Self {
        Item {
            path: PathBuf::new(),
            name: String::new(),
            labels: BTreeMap::new(),
            timed: Vec::new(),
            left_out: Vec::new(),
            piece: None,
            take: String::new(),
            split: Split::Train,
            fps: None,
            skip: None,
            floor: None,
            told: None,
            music_from_s: None,
            key: 0,
            source: 0,
        }
    }
}

/// All motion files found.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Gathered {
    /// By source, then by path.
    pub items: Vec<Item>,
    /// The files and folders as they were given.
    pub sources: Vec<String>,
    /// What the user should be told: what labels were found and by which rule, what was left out, splits that lack
    /// something. One line each.
    pub said: Vec<String>,
    /// AMASS files without motion (shapes, first stages) and JSON files that are no clips.
    pub no_motion: usize,
    /// Files that an `ignore_list.txt` names.
    pub ignored: usize,
    /// FBX files that this build doesn't read.
    pub unread_fbx: usize,
    /// Files without a row in their label CSV.
    pub without_row: usize,
    /// Rows of label CSVs without a file.
    pub without_file: usize,
}

struct Found {
    path: PathBuf,
    relative: String,
    source: usize,
    alone: bool, // given itself, not found in a folder
}

/// Finds the motion files in `data` (files, or folders searched to any depth, in the order of their names) and labels
/// them. `labels` are what `--labels` was given, in the order of `data`; a single one serves all; none lets the known
/// names be tried.
///
/// Files are taken by their extensions ([`EXTENSIONS`]); hidden ones are not looked at. An `ignore_list.txt` (as AIST++
/// has one) leaves out the names it lists from its folder and all below it; the one beside a folder given counts too.
///
/// # Errors
/// [`kinelm_store::Error::Io`] for a path that is not there or can't be read; [`kinelm_store::Error::Call`] when nothing is found, or `labels` are
/// neither none, one nor as many as `data`; [`kinelm_store::Error::File`] when nothing is found but FBX files, in a build that doesn't read
/// them; those of [`Labels::parse`] and [`Labels::find`].
pub fn gather(data: &[PathBuf], labels: &[String]) -> Result<Gathered> {
    if labels.len() > 1 && labels.len() != data.len() {
        let (l, d) = (labels.len(), data.len());
        return Err(Error::call(format!("{l} label lists for {d} places of data; give none, one for all, or {d}")));
    }
    let parsed: Vec<Labels> = labels.iter().map(|l| Labels::parse(l)).collect::<Result<_>>()?;
    let mut gathered = Gathered { sources: data.iter().map(|d| slashed(d)).collect(), ..Gathered::default() };
    let mut found = Vec::new();
    let mut seen = HashSet::new();
    let (mut twice, mut of_fbx) = (0, None);
    for (source, place) in data.iter().enumerate() {
        let mut walk = Walk { gathered: &mut gathered, files: Vec::new(), folders: HashSet::new() };
        let alone = !walk.start(place)?;
        of_fbx = of_fbx.or((walk.gathered.unread_fbx > 0).then_some(place));
        for (path, relative) in std::mem::take(&mut walk.files) {
            // a link to nowhere is told where it is read
            if seen.insert(fs::canonicalize(&path).unwrap_or(path.clone())) {
                found.push(Found { path, relative, source, alone });
            } else {
                twice += 1;
            }
        }
    }
    if found.is_empty() {
        of_fbx.map_or(Ok(()), |place| refuse_fbx_alone(place, gathered.unread_fbx))?;
        let places = gathered.sources.join(", ");
        return Err(Error::call(format!(
            "no motion in {places}; looked for files ending in {}",
            EXTENSIONS.join(", ")
        )));
    }
    say_left_out(&mut gathered, twice);
    let stated = label(&mut gathered, found, &parsed)?;
    let said = splits::assign(&mut gathered.items, &stated);
    gathered.said.extend(said);
    ask_sidecars(&mut gathered);
    Ok(gathered)
}

/// Finds out how dances are read that have a sidecar, and says so.
fn ask_sidecars(g: &mut Gathered) {
    let mut words = Vec::new();
    for item in &mut g.items {
        match sidecar::reading_of(&item.path) {
            Ok(None) => continue,
            Ok(told) => item.told = told,
            Err(e) => g.said.push(e.to_string()),
        }
        let said = item.told.as_ref().and_then(|told| sidecar::in_words(told, told));
        words.extend(said.map(|said| (item.path.display().to_string(), said)));
    }
    g.said.extend(sidecar::line(&words));
}

/// The motion files below a folder, by path, as [`gather`] finds them.
///
/// # Errors
/// [`kinelm_store::Error::Io`] for what can't be read; [`kinelm_store::Error::File`] for a folder of FBX files alone, in a build that doesn't read them.
pub fn files_below(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut counts = Gathered::default();
    let mut walk = Walk { gathered: &mut counts, files: Vec::new(), folders: HashSet::new() };
    walk.start(folder)?;
    let files: Vec<PathBuf> = walk.files.into_iter().map(|(path, _)| path).collect();
    if files.is_empty() {
        refuse_fbx_alone(folder, counts.unread_fbx)?;
    }
    Ok(files)
}

/// Says why `place`, which holds no other motion, is refused for all its FBX files.
fn refuse_fbx_alone(place: &Path, unread: usize) -> Result<()> {
    if unread == 0 {
        return Ok(());
    }
    let expected = "motion that this build reads, or a build with the feature `fbx`";
    let help = "cargo install --path . --features fbx makes one; or convert the files to BVH";
    Err(Error::file(place, format!("{} and no other motion", counted(unread, ".fbx files")), expected, help))
}

/// Whether a file is one that only another build reads.
fn is_unread_fbx(path: &Path) -> bool {
    !cfg!(feature = "fbx") && Format::of_name(path) == Some(Format::Fbx)
}

fn say_left_out(g: &mut Gathered, twice: usize) {
    for (count, what) in [
        (g.no_motion, "files hold no motion (body shapes, other JSON) and are left out"),
        (g.ignored, "files are left out because ignore_list.txt names them"),
        (g.unread_fbx, ".fbx files are left out: this build has not the feature `fbx`"),
        (twice, "files were given twice and are taken once"),
    ] {
        if count > 0 {
            g.said.push(format!("{count} {what}"));
        }
    }
}

/// Makes the items; returns the splits stated for them.
fn label(g: &mut Gathered, found: Vec<Found>, labels: &[Labels]) -> Result<Vec<Option<Split>>> {
    let names = unique_names(&found, &g.sources)?;
    let mut stated = Vec::new();
    let mut by_rule: BTreeMap<(usize, Rule), (usize, BTreeSet<String>)> = BTreeMap::new();
    let mut rows: BTreeMap<usize, HashSet<usize>> = BTreeMap::new();
    let mut unknown: BTreeMap<usize, Vec<String>> = BTreeMap::new();
    for (key, (file, name)) in found.into_iter().zip(names).enumerate() {
        let which = if labels.len() > 1 { file.source } else { 0 };
        let rules = labels.get(which).unwrap_or(&Labels::Auto);
        let known = match known_of(rules, &file)? {
            Some((known, rule)) => {
                let group = match rule {
                    Rule::Row(row) => {
                        rows.entry(which).or_default().insert(row);
                        Rule::Row(0)
                    }
                    rule => rule,
                };
                let entry = by_rule.entry((which, group)).or_default();
                entry.0 += 1;
                let timed = known.timed.iter().flat_map(|timed| timed.labels.keys());
                entry.1.extend(known.labels.keys().chain(timed).cloned());
                known
            }
            None => {
                unknown.entry(which).or_default().push(name.clone());
                Known::default()
            }
        };
        stated.push(known.split);
        g.items.push(Item {
            take: known.take.unwrap_or_else(|| name.clone()),
            path: file.path,
            name,
            labels: known.labels,
            timed: known.timed,
            left_out: Vec::new(),
            piece: None,
            split: Split::Train, // given by `splits::assign`
            fps: known.fps,
            skip: known.skip,
            floor: known.floor,
            told: None,
            music_from_s: known.music_from_s,
            key,
            source: file.source,
        });
    }
    for ((_, rule), (count, fields)) in by_rule {
        let fields: Vec<&str> = fields.iter().map(String::as_str).collect();
        let fields = if fields.is_empty() { "no labels".into() } else { fields.join(", ") };
        g.said.push(format!("{count} clips have labels by {}: {fields}", rule.describe()));
    }
    say_unmatched(g, labels, &rows, &unknown);
    Ok(stated)
}

/// What is known of a file. Of one given itself the folders above it are tried too, longest path first, but for the
/// known names: any folder would pass for a genre.
fn known_of(rules: &Labels, file: &Found) -> Result<Option<(Known, Rule)>> {
    if !file.alone || matches!(rules, Labels::Auto) {
        return rules.find(&file.relative);
    }
    let full = slashed(&file.path);
    let starts = std::iter::once(0).chain(full.match_indices('/').map(|(i, _)| i + 1));
    for start in starts {
        if let Some(known) = rules.find(&full[start..])? {
            return Ok(Some(known));
        }
    }
    Ok(None)
}

fn say_unmatched(
    g: &mut Gathered,
    labels: &[Labels],
    rows: &BTreeMap<usize, HashSet<usize>>,
    unknown: &BTreeMap<usize, Vec<String>>,
) {
    for (which, rules) in labels.iter().enumerate() {
        let names: Vec<&str> = unknown.get(&which).into_iter().flatten().map(String::as_str).collect();
        match rules {
            Labels::Table(table) => {
                let unused = table.unused(|row| rows.get(&which).is_some_and(|r| r.contains(&row)));
                let unused: Vec<&str> = unused.iter().map(String::as_str).collect();
                let csv = table.path().display();
                if !unused.is_empty() {
                    g.without_file += unused.len();
                    g.said.push(format!("{csv}: {} rows have no file: {}", unused.len(), some_of(&unused)));
                }
                if !names.is_empty() {
                    g.without_row += names.len();
                    g.said.push(format!(
                        "{csv}: {} files have no row and go without labels: {}",
                        names.len(),
                        some_of(&names)
                    ));
                }
            }
            Labels::Pattern(p) if !names.is_empty() => {
                let (n, text) = (names.len(), p.text());
                g.said.push(format!("{n} files don't fit {text} and go without labels: {}", some_of(&names)));
            }
            _ => {}
        }
    }
    let auto: usize = unknown
        .iter()
        .filter(|(w, _)| matches!(labels.get(**w), None | Some(Labels::Auto)))
        .map(|(_, n)| n.len())
        .sum();
    if auto > 0 {
        g.said.push(format!("{auto} clips have no labels: their names fit no known pattern; --labels gives them some"));
    }
}

/// The path below the source without extension; where two are the same, with the extension or the source's name.
fn unique_names(found: &[Found], sources: &[String]) -> Result<Vec<String>> {
    let short = |f: &Found| without_extension(&f.relative).to_owned();
    let long = |f: &Found| {
        let source = sources[f.source].trim_end_matches('/');
        format!("{}/{}", source.rsplit('/').next().unwrap_or(source), f.relative)
    };
    let whole = |f: &Found| slashed(&f.path);
    let count = |names: &[String]| -> HashMap<String, usize> {
        let mut counts = HashMap::new();
        names.iter().for_each(|n| *counts.entry(n.clone()).or_insert(0) += 1);
        counts
    };
    let mut names: Vec<String> = found.iter().map(short).collect();
    for longer in [&(|f: &Found| f.relative.clone()) as &dyn Fn(&Found) -> String, &long, &whole] {
        let counts = count(&names);
        for (name, file) in names.iter_mut().zip(found) {
            if counts[name] > 1 {
                *name = longer(file);
            }
        }
    }
    match count(&names).into_iter().find(|(_, n)| *n > 1) {
        Some((name, _)) => Err(Error::call(format!("{name}: two clips of this name; rename one of the files"))),
        None => Ok(names),
    }
}

/// A path with `/` between its parts.
fn slashed(path: &Path) -> String {
    path.to_string_lossy().replace(std::path::MAIN_SEPARATOR, "/")
}

/// Folders in each other that are looked through at most.
const MOST_FOLDERS: usize = 64;

struct Walk<'a> {
    gathered: &'a mut Gathered,
    files: Vec<(PathBuf, String)>,
    folders: HashSet<PathBuf>, // seen: a link may lead back up
}

impl Walk<'_> {
    /// Takes a file or all files of a folder; whether it was a folder.
    fn start(&mut self, place: &Path) -> Result<bool> {
        let kind = fs::metadata(place).map_err(Error::io(place))?;
        if kind.is_dir() {
            let beside = place.parent().filter(|_| place.file_name().is_some());
            let ignore = beside.map(ignore_list).transpose()?.unwrap_or_default();
            self.folder(place, "", &ignore)?;
            return Ok(true);
        }
        let name = place.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        if without_extension(&name) == name {
            refuse_fbx_alone(place, usize::from(is_unread_fbx(place)))?;
            let expected = format!("a file ending in {}, or a folder", EXTENSIONS.join(", "));
            return Err(Error::file(place, "a file of another kind", expected, ""));
        }
        self.files.push((place.to_owned(), name));
        Ok(false)
    }

    fn folder(&mut self, folder: &Path, relative: &str, ignore: &HashSet<String>) -> Result<()> {
        if let Some(kind) = ours::kind(folder) {
            self.gathered.said.push(format!("{}: {kind}, where no clip is looked for", folder.display()));
            return Ok(());
        }
        if relative.matches('/').count() >= MOST_FOLDERS {
            let found = format!("folders in more than {MOST_FOLDERS} others");
            return Err(Error::file(
                folder,
                found,
                "motion that lies less deep",
                "give a folder further in, or move it up",
            ));
        }
        if !self.folders.insert(fs::canonicalize(folder).map_err(Error::io(folder))?) {
            return Ok(());
        }
        let ignore: HashSet<String> = ignore.union(&ignore_list(folder)?).cloned().collect();
        let mut entries = Vec::new();
        for entry in fs::read_dir(folder).map_err(Error::io(folder))? {
            entries.push(entry.map_err(Error::io(folder))?.file_name());
        }
        entries.sort();
        for name in entries {
            let path = folder.join(&name);
            let name = name.to_string_lossy();
            if name.starts_with('.') {
                continue;
            }
            let relative = if relative.is_empty() { name.to_string() } else { format!("{relative}/{name}") };
            match fs::metadata(&path) {
                Ok(m) if m.is_dir() => self.folder(&path, &relative, &ignore)?,
                Ok(_) => self.file(path, relative, &ignore),
                // a link to nowhere among them, which is told where it is read
                Err(_) => self.file(path, relative, &ignore),
            }
        }
        Ok(())
    }

    fn file(&mut self, path: PathBuf, relative: String, ignore: &HashSet<String>) {
        let stem = without_extension(&relative);
        if stem == relative {
            self.gathered.unread_fbx += usize::from(is_unread_fbx(&path));
            return;
        }
        let name = stem.rsplit('/').next().unwrap_or(stem);
        if ignore.contains(name) {
            self.gathered.ignored += 1;
        } else if holds_no_motion(&path, name) {
            self.gathered.no_motion += 1;
        } else {
            self.files.push((path, relative));
        }
    }
}

/// Whether a file found in a folder is known not to hold motion: AMASS's body shapes and first stages and what tells of a
/// dance (`NAME.kinelm.json`) by name, JSON that has not the first key of a clip.
fn holds_no_motion(path: &Path, stem: &str) -> bool {
    match path.extension().map(|e| e.to_ascii_lowercase()) {
        Some(e) if e == "npz" => stem == "shape" || stem.ends_with("_stagei"),
        Some(e) if e == "json" && stem.ends_with(".kinelm") => true,
        Some(e) if e == "json" => {
            let mut head = Vec::new();
            let read = input::peek(path).and_then(|file| file.take(4096).read_to_end(&mut head));
            read.is_ok() && !String::from_utf8_lossy(&head).contains("\"schema\"")
        }
        _ => false,
    }
}

/// The names in a folder's `ignore_list.txt`, one a line, without extension.
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
