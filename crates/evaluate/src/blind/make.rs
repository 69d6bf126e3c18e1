//! The page and the key of a study.

use super::Ask;
use super::key::{Key, Source, Trial};
use crate::{Error, Result};
use kinelm_corpus::{in_out, sidecar};
use kinelm_generate::output::RootGiven;
use kinelm_generate::request::Placement;
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::{Clip, retarget};
use kinelm_store::{hash, random};
use kinelm_view::Figure;
use kinelm_view::survey::Survey;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The most frames per second of a study's clips.
const FPS: f64 = 30.0;
/// Seconds of the shortest clip that says something.
const SHORTEST_S: f64 = 0.5;

/// What is asked of which clips.
#[derive(Debug, Clone)]
pub struct StudyOptions {
    /// The question.
    pub ask: Ask,
    /// A, B and, for a question with an X, C.
    pub folders: Vec<PathBuf>,
    /// The most trials.
    pub pairs: usize,
    /// The most seconds of a clip.
    pub seconds: f64,
    /// Of pairs, order and sides.
    pub seed: u64,
    /// How clips are read; those with a sidecar as that says.
    pub read: ReadOptions,
}

/// A study.
#[derive(Debug, Clone, PartialEq)]
pub struct Study {
    /// The page.
    pub page: String,
    /// Its key.
    pub key: Key,
}

impl Study {
    /// Makes a study.
    ///
    /// Clips of one name (without the extension, in the folders' order) make a trial. Where the folders share no names,
    /// a question about pairs takes any two, each clip once. All clips of a study are put on the neutral body, at the
    /// lowest of their rates and at most 30 frames a second, cut to one length, and begin at one place facing the
    /// viewer: rate, rig, length and room say nothing of where a clip is from.
    ///
    /// # Errors
    /// Folders of another number than the question needs, or without clips that belong together; clips that can't be
    /// read or are shorter than half a second.
    pub fn make(options: &StudyOptions) -> Result<Study> {
        let &StudyOptions { ask, seed, seconds, .. } = options;
        if !(seconds.is_finite() && seconds >= SHORTEST_S) {
            return Err(Error::invalid_parameter("seconds", seconds, format!("at least {SHORTEST_S} s")));
        }
        let trials = trials(options)?;
        let files: Vec<&PathBuf> =
            trials.iter().flat_map(|t| [&t.left.clip, &t.right.clip].into_iter().chain(&t.x)).collect();
        let read = |file: &&PathBuf| -> Result<Clip> {
            let own = sidecar::read_options(file)?;
            let read = own.map_or_else(|| options.read.clone(), |own| sidecar::combined(own, &options.read));
            Ok(retarget::to_smpl(&format::read(file, &read)?)?)
        };
        let clips = files.iter().map(read).collect::<Result<Vec<_>>>()?;
        let fps = clips.iter().map(Clip::fps).fold(FPS, f64::min);
        let clips = clips.iter().map(|clip| Ok(resample(clip, fps, Method::Auto)?)).collect::<Result<Vec<_>>>()?;
        let shortest = clips.iter().map(Clip::frames).min().unwrap_or(0);
        let frames = shortest.min((seconds * fps).round() as usize);
        if (frames as f64) < SHORTEST_S * fps {
            let short = clips.iter().position(|clip| clip.frames() == shortest).unwrap_or(0);
            let found = format!("{:.2} s", shortest as f64 / fps);
            return Err(Error::file(files[short], found, format!("clips of at least {SHORTEST_S} s"), "leave it out"));
        }
        // nowhere and facing the viewer, whatever the clip's world is
        let front = Placement { x: 0.0, z: 0.0, heading: Some(0.0) };
        let place = |clip: &Clip| front.put(&clip.slice(0..frames), RootGiven { path: false, heading: false });
        let clips = clips.iter().map(place).collect::<Result<Vec<_>>>()?;
        let titles: &[&str] = if ask.has_x() { &["1", "X", "2"] } else { &["1", "2"] };
        let mut left = clips.iter();
        let figures = trials.iter().map(|trial| {
            let [a, b] = [left.next(), left.next()];
            let x = if trial.x.is_some() { left.next() } else { None };
            titles.iter().zip([a, x, b].into_iter().flatten()).map(|(title, clip)| Figure::new(*title, clip)).collect()
        });
        let mut survey = Survey {
            question: ask.question().into(),
            choices: ask.choices().iter().map(|choice| choice.to_string()).collect(),
            trials: figures.collect(),
            id: String::new(),
        };
        // a page can't have its own hash: that of the page without it
        survey.id = hash::of(survey.html()?.as_bytes());
        let (page, seconds) = (survey.html()?, frames as f64 / fps);
        let folders = options.folders.clone();
        let key = Key { schema: Key::SCHEMA, ask, page: survey.id.clone(), seed, seconds, fps, folders, trials };
        Ok(Study { page, key })
    }
}

/// The trials in the order of the page, with their sides.
fn trials(options: &StudyOptions) -> Result<Vec<Trial>> {
    let StudyOptions { ask, folders, pairs, seed, .. } = options;
    let needed = if ask.has_x() { 3 } else { 2 };
    if folders.len() != needed {
        let found = format!("{} folders", folders.len());
        let expected = if needed == 3 { "three, A, B and C with the X" } else { "two, A and B" };
        return Err(Error::invalid_parameter("ask", format!("a question about {found}"), expected));
    }
    let real = |folder: &PathBuf| std::fs::canonicalize(folder).map_err(Error::io(folder));
    let real = folders.iter().map(real).collect::<Result<Vec<_>>>()?;
    if let Some(again) = (1..real.len()).find(|&i| real[..i].contains(&real[i])) {
        let expected = "folders of their own, or both sides of a pair are the same";
        return Err(Error::file(&folders[again], "a folder that is given twice", expected, ""));
    }
    let named = folders.iter().map(|folder| {
        let files = in_out::files(std::slice::from_ref(folder))?;
        Ok(files.into_iter().map(|(path, below)| (below.with_extension(""), path)).collect())
    });
    let named: Vec<BTreeMap<PathBuf, PathBuf>> = named.collect::<Result<_>>()?;
    let shared = named[0].keys().filter(|name| named.iter().all(|files| files.contains_key(*name)));
    let mut together: Vec<Vec<PathBuf>> =
        shared.map(|name| named.iter().map(|files| files[name].clone()).collect()).collect();
    let mut rng = random::stream(*seed, "blind", 0, 0);
    if together.is_empty() && ask.has_x() {
        let names: Vec<String> = folders.iter().map(|folder| folder.display().to_string()).collect();
        let why = "no clips of one name in all folders; name those that belong together alike";
        return Err(Error::unsupported(names.join(", "), why));
    }
    if together.is_empty() {
        let mut drawn = named.iter().map(|files| {
            let mut files: Vec<PathBuf> = files.values().cloned().collect();
            random::shuffle(&mut files, &mut rng);
            files
        });
        let (a, b) = (drawn.next().unwrap_or_default(), drawn.next().unwrap_or_default());
        together = a.into_iter().zip(b).map(|(a, b)| vec![a, b]).collect();
    }
    random::shuffle(&mut together, &mut rng);
    together.truncate(*pairs);
    // A on the left in half of the trials, so that a habit of one side is no opinion
    let mut sides: Vec<bool> = (0..together.len()).map(|i| i % 2 == 0).collect();
    random::shuffle(&mut sides, &mut rng);
    let trial = |(clips, swapped): (Vec<PathBuf>, bool)| {
        let mut clips = clips.into_iter();
        let [a, b] = [0, 1].map(|folder| Source { folder, clip: clips.next().unwrap_or_default() });
        let (left, right) = if swapped { (b, a) } else { (a, b) };
        Trial { left, right, x: clips.next() }
    };
    Ok(together.into_iter().zip(sides).map(trial).collect())
}
