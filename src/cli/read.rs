//! The reading options, the same on every command that reads motion.

use super::Say;
use crate::corpus::sidecar;
use crate::corpus::store::reading_in;
use crate::spectral::windows::{MAX_FRAMES, MIN_FRAMES};
use kinelm_motion::format::{BvhPosition, ReadOptions, RestFrame, Unit, Up};
use kinelm_motion::moment::{EXPECTED, Moment};
use kinelm_motion::resample::MOST_FPS;
use kinelm_store::hash;
use std::collections::BTreeSet;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// How motion files are read.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Reading motion")]
pub struct ReadArgs {
    /// The true rate of the files, where they state it wrongly
    #[arg(long, value_name = "FPS", value_parser = rate)]
    pub fps_source: Option<f64>,
    /// Unit of a BVH, which has none of its own; auto, as if not given, judges by the length of the leg
    #[arg(long, value_enum)]
    pub unit: Option<Unit>,
    /// The axis that points up in a BVH or JSON; auto, as if not given, judges a BVH by its rest pose and its motion, a JSON has
    /// y up
    #[arg(long, value_enum, allow_hyphen_values = true, value_name = "AXIS")]
    pub up: Option<Up>,
    /// Skeleton TOML for a rig whose joint names no shipped one knows: a shipped name or a file
    #[arg(long, value_name = "NAME|FILE")]
    pub map: Option<String>,
    /// Whether a joint's position channels replace its OFFSET, as if not given, or are added to it
    #[arg(long, value_enum)]
    pub bvh_position: Option<BvhPosition>,
    /// The ROOT to read, where a file has several
    #[arg(long, value_name = "NAME")]
    pub root: Option<String>,
    /// Keep the whole rows of a file that ends early
    #[arg(long)]
    pub lenient: bool,
    /// Keep a leading rest-pose frame, as inspect, convert and view do unless told
    #[arg(long, conflicts_with = "drop_rest")]
    pub keep_rest: bool,
    /// Leave out a leading rest-pose frame, as the tokenizer, corpora and prompts do unless told
    #[arg(long)]
    pub drop_rest: bool,
    /// Source frames left out at the start; with N > 0 no rest-pose frame is looked for
    #[arg(long, value_name = "N")]
    pub skip: Option<usize>,
    /// Your own SMPL_*.npz: its rest offsets and shape take the place of the neutral skeleton's (AMASS, AIST++)
    #[arg(long, value_name = "FILE")]
    pub body_model: Option<PathBuf>,
    /// Where the floor is, metres, for tokenizers that code heights above it; auto goes by the feet
    #[arg(long, value_name = "auto|METRES", value_parser = floor, allow_negative_numbers = true)]
    pub floor: Option<FloorArg>,
}

/// `--floor`: by the feet, or a height.
#[derive(Debug, Clone, Copy)]
pub struct FloorArg(Option<f64>);

/// `auto`, or a height in metres.
fn floor(text: &str) -> Result<FloorArg, String> {
    if text == "auto" {
        return Ok(FloorArg(None));
    }
    text.parse()
        .ok()
        .filter(|x: &f64| x.is_finite())
        .map(|x| FloorArg(Some(x)))
        .ok_or("expected auto or a height in metres".into())
}

impl ReadArgs {
    /// The files that are read beside the motion.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        self.map.iter().map(PathBuf::from).chain(self.body_model.clone())
    }

    /// The options, with what this command does about rest-pose frames unless told.
    pub fn options(&self, rest: RestFrame) -> ReadOptions {
        self.over(&ReadOptions { rest, ..ReadOptions::default() })
    }

    /// The options that are given, and those of `read` where none are.
    fn over(&self, read: &ReadOptions) -> ReadOptions {
        ReadOptions {
            fps_source: self.fps_source.or(read.fps_source),
            unit: self.unit.unwrap_or(read.unit),
            up: self.up.unwrap_or(read.up),
            map: self.map.clone().or(read.map.clone()),
            bvh_position: self.bvh_position.unwrap_or(read.bvh_position),
            root: self.root.clone().or(read.root.clone()),
            lenient: self.lenient || read.lenient,
            rest: match (self.keep_rest, self.drop_rest) {
                (true, _) => RestFrame::Keep,
                (_, true) => RestFrame::Drop,
                _ => read.rest,
            },
            skip: self.skip.unwrap_or(read.skip),
            body_model: self.body_model.clone().or(read.body_model.clone()),
            floor: self.floor.map_or(read.floor, |floor| floor.0),
        }
    }

    /// How the files of a call are read. What is given wins; else a dance is read as its sidecar says, which is said, and any
    /// other file as this command does unless told. Of several files, what is given is said of those that no sidecar
    /// tells of.
    pub fn of_files<P: AsRef<Path>>(&self, files: &[P], rest: RestFrame, say: Say) -> Vec<ReadOptions> {
        self.of_files_known(files, rest, &[], say)
    }

    /// [`ReadArgs::of_files`] of a call on one file.
    pub fn of_file(&self, file: &Path, rest: RestFrame, say: Say) -> ReadOptions {
        self.of_files(&[file], rest, say).remove(0)
    }

    /// [`ReadArgs::of_files`] for a model that learned from `corpora`: a file without a sidecar that one of them has is read as
    /// it was read then.
    pub fn of_files_known<P: AsRef<Path>>(
        &self,
        files: &[P],
        rest: RestFrame,
        corpora: &[PathBuf],
        say: Say,
    ) -> Vec<ReadOptions> {
        let (mut all, mut words, mut gone) = (Vec::new(), Vec::new(), BTreeSet::new());
        for file in files.iter().map(AsRef::as_ref) {
            let told = sidecar::reading_of(file).unwrap_or_else(|e| {
                say.line(e);
                None
            });
            let Some(told) = told else {
                // the error of hashing is that of reading
                let sha256 = if corpora.is_empty() { None } else { hash::of_file(file).ok() };
                let known = sha256.and_then(|sha256| corpora.iter().find_map(|c| known_to(c, &sha256, &mut gone)));
                let read = self.over(known.as_ref().unwrap_or(&ReadOptions { rest, ..ReadOptions::default() }));
                if let Some(how) = known.and_then(|known| how(&known, &read)) {
                    say.line(format_args!("{}: read as the model's corpus read it: {how}", file.display()));
                }
                all.push(read);
                continue;
            };
            let read = match files.len() {
                1 => self.over(&told),
                _ => sidecar::among_others(told.clone(), &self.options(rest)),
            };
            words.extend(sidecar::in_words(&told, &read).map(|words| (file.display().to_string(), words)));
            all.push(read);
        }
        sidecar::line(&words).iter().for_each(|line| say.line(line));
        if !gone.is_empty() {
            let gone: Vec<String> = gone.iter().map(|corpus| corpus.display().to_string()).collect();
            let what =
                "the model's corpus can't be read: whether it has these files, and how it read them, isn't known";
            say.line(format_args!("{}: {what}", gone.join(", ")));
        }
        all
    }
}

/// How a corpus read the file of this hash, if it has it; one that can't be read joins those that are gone.
fn known_to<'a>(corpus: &'a Path, sha256: &str, gone: &mut BTreeSet<&'a Path>) -> Option<ReadOptions> {
    reading_in(corpus, sha256).unwrap_or_else(|_| {
        gone.insert(corpus);
        None
    })
}

/// What of `known` was taken over, in words.
fn how(known: &ReadOptions, read: &ReadOptions) -> Option<String> {
    let fps = known.fps_source.filter(|_| known.fps_source == read.fps_source).map(|fps| format!("{fps} fps"));
    let words: Vec<String> = fps.into_iter().chain(sidecar::in_words(known, read)).collect();
    (!words.is_empty()).then(|| words.join(", "))
}

/// A positive, finite number.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("expected a positive number".into()),
    }
}

/// A rate, frames a second.
pub fn rate(text: &str) -> Result<f64, String> {
    let wrong = || format!("expected a rate above 0, at most {MOST_FPS} frames per second");
    positive(text).ok().filter(|fps| *fps <= MOST_FPS).ok_or_else(wrong)
}

/// A whole number from 1 on.
pub fn count(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&n| n > 0).ok_or("expected a whole number from 1 on".into())
}

/// A whole number in a range.
pub fn within(range: RangeInclusive<usize>) -> impl Fn(&str) -> Result<usize, String> + Clone {
    move |text| {
        let wrong = || format!("expected {} to {}", range.start(), range.end());
        text.parse().ok().filter(|n| range.contains(n)).ok_or_else(wrong)
    }
}

/// The frames of a query's window.
pub fn window(text: &str) -> Result<usize, String> {
    within(MIN_FRAMES..=MAX_FRAMES)(text)
}

/// A time from the beginning on, of what has no model: a number alone is seconds.
pub fn time(text: &str) -> Result<Moment, String> {
    match text.parse()? {
        Moment::Model(_) => Err(format!("`{text}`: there is no model; {EXPECTED}")),
        time if time.number().is_sign_negative() && time.number() != 0.0 => Err("expected a time from 0 on".into()),
        time => Ok(time),
    }
}

/// A time that may lie before the beginning.
pub fn any_time(text: &str) -> Result<Moment, String> {
    let before = text.strip_prefix('-').map(|after| time(after).map(|_| ()));
    before.unwrap_or_else(|| time(text).map(|_| ()))?;
    text.parse()
}

/// A time of what has no frames, in seconds.
pub fn seconds(text: &str) -> Result<f64, String> {
    match time(text)? {
        Moment::Seconds(s) => Ok(s),
        _ => Err(format!("`{text}`: there are no frames here; expected seconds, as 2.5s or 2.5")),
    }
}

/// The same, longer than nothing.
pub fn seconds_above_0(text: &str) -> Result<f64, String> {
    seconds(text).and_then(|s| if s > 0.0 { Ok(s) } else { Err("expected more than 0 s".into()) })
}

/// How long something is, longer than nothing; a number alone is seconds.
pub fn length(text: &str) -> Result<Moment, String> {
    above_0(text.parse()?)
}

/// The same; a number alone is frames.
pub fn length_in_frames(text: &str) -> Result<Moment, String> {
    above_0(Moment::in_frames(text)?)
}

fn above_0(length: Moment) -> Result<Moment, String> {
    if length.number() > 0.0 { Ok(length) } else { Err(format!("{length}: expected more than nothing")) }
}

/// Frames of what has `fps` in a second, in a range; a number alone is frames.
pub fn frames_at(fps: f64, range: RangeInclusive<u32>) -> impl Fn(&str) -> Result<u32, String> + Clone {
    move |text| {
        let frames = Moment::in_frames(text)?.frames(fps);
        let within = (f64::from(*range.start())..=f64::from(*range.end())).contains(&frames);
        let wrong = || format!("{frames} frames; expected {} to {}", range.start(), range.end());
        if within { Ok(frames as u32) } else { Err(wrong()) }
    }
}

/// A part of a whole.
pub fn share(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|s| (0.0..=1.0).contains(s)).ok_or("expected a number from 0 to 1".into())
}
