//! The reading options, the same on every command that reads motion.

use super::Say;
use crate::corpus::sidecar;
use crate::corpus::store::read_options_in;
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
    /// The files' true frame rate, where they state a wrong one
    #[arg(long, value_name = "FPS", value_parser = rate)]
    pub fps_source: Option<f64>,
    /// The unit of a BVH, which states none; auto estimates it from the length of the legs [default: auto]
    #[arg(long, value_enum)]
    pub unit: Option<Unit>,
    /// The axis that points up in a BVH or JSON; auto estimates it for a BVH from its rest pose and motion, and takes y
    /// for a JSON [default: auto]
    #[arg(long, value_enum, allow_hyphen_values = true, value_name = "AXIS")]
    pub up: Option<Up>,
    /// The skeleton map, for rigs whose joint names no built-in map knows: a built-in name or a TOML file
    #[arg(long, value_name = "NAME|FILE")]
    pub map: Option<String>,
    /// Whether position channels of a joint replace its OFFSET or are added to it [default: replace]
    #[arg(long, value_enum)]
    pub bvh_position: Option<BvhPosition>,
    /// The ROOT to read, where a file has several
    #[arg(long, value_name = "NAME")]
    pub root: Option<String>,
    /// Read the whole rows of a file that ends early
    #[arg(long)]
    pub lenient: bool,
    /// Keep a leading rest-pose frame, the default of inspect, convert and view
    #[arg(long, conflicts_with = "drop_rest")]
    pub keep_rest: bool,
    /// Drop a leading rest-pose frame, the default of tokenizers, corpora and prompts
    #[arg(long)]
    pub drop_rest: bool,
    /// Source frames to drop at the start; with N > 0 no rest-pose frame is looked for
    #[arg(long, value_name = "N")]
    pub skip: Option<usize>,
    /// Your own SMPL_*.npz, whose rest offsets and shape replace those of the neutral skeleton (AMASS, AIST++)
    #[arg(long, value_name = "FILE")]
    pub body_model: Option<PathBuf>,
    /// The height of the floor in metres, for tokenizers that code heights above it; auto estimates it from the feet
    /// [default: auto]
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
    /// The files that are read besides the motion.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        self.map.iter().map(PathBuf::from).chain(self.body_model.clone())
    }

    /// The options of the call; `rest` is the command's default for rest-pose frames.
    pub fn options(&self, rest: RestFrame) -> ReadOptions {
        self.over(&ReadOptions { rest, ..ReadOptions::default() })
    }

    /// The options of the call, and those of `read` where the call gives none.
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

    /// How each file of a call is read. Options of the call win; else a dance is read as its sidecar says, which is
    /// reported, and any other file by the command's defaults. With several files, options of the call apply to those
    /// without a sidecar.
    pub fn of_files<P: AsRef<Path>>(&self, files: &[P], rest: RestFrame, say: Say) -> Vec<ReadOptions> {
        self.of_files_known(files, rest, &[], say)
    }

    /// [`ReadArgs::of_files`] for a single file.
    pub fn of_file(&self, file: &Path, rest: RestFrame, say: Say) -> ReadOptions {
        self.of_files(&[file], rest, say).remove(0)
    }

    /// [`ReadArgs::of_files`] for a model trained on `corpora`: a file without a sidecar that is in one of them is read
    /// as it was read for that corpus.
    pub fn of_files_known<P: AsRef<Path>>(
        &self,
        files: &[P],
        rest: RestFrame,
        corpora: &[PathBuf],
        say: Say,
    ) -> Vec<ReadOptions> {
        let (mut all, mut words, mut gone) = (Vec::new(), Vec::new(), BTreeSet::new());
        for file in files.iter().map(AsRef::as_ref) {
            let own = sidecar::read_options(file).unwrap_or_else(|e| {
                say.line(e);
                None
            });
            let Some(own) = own else {
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
                1 => self.over(&own),
                _ => sidecar::combined(own.clone(), &self.options(rest)),
            };
            words.extend(sidecar::describe(&own, &read).map(|words| (file.display().to_string(), words)));
            all.push(read);
        }
        sidecar::describe_all(&words).iter().for_each(|line| say.line(line));
        if !gone.is_empty() {
            let gone: Vec<String> = gone.iter().map(|corpus| corpus.display().to_string()).collect();
            let what =
                "the model's corpus can't be read: whether it has these files, and how it read them, isn't known";
            say.line(format_args!("{}: {what}", gone.join(", ")));
        }
        all
    }
}

/// How a corpus read the file with this hash, if it contains it. A corpus that can't be read is added to `gone`.
fn known_to<'a>(corpus: &'a Path, sha256: &str, gone: &mut BTreeSet<&'a Path>) -> Option<ReadOptions> {
    read_options_in(corpus, sha256).unwrap_or_else(|_| {
        gone.insert(corpus);
        None
    })
}

/// The options that were taken over from `known`, as text.
fn how(known: &ReadOptions, read: &ReadOptions) -> Option<String> {
    let fps = known.fps_source.filter(|_| known.fps_source == read.fps_source).map(|fps| format!("{fps} fps"));
    let words: Vec<String> = fps.into_iter().chain(sidecar::describe(known, read)).collect();
    (!words.is_empty()).then(|| words.join(", "))
}

/// A positive, finite number.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("expected a positive number".into()),
    }
}

/// A rate in frames per second.
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

/// The frames of a window of a search.
pub fn window(text: &str) -> Result<usize, String> {
    within(MIN_FRAMES..=MAX_FRAMES)(text)
}

/// A time from the start on, where there is no model; a bare number is seconds.
pub fn time(text: &str) -> Result<Moment, String> {
    match moment(text)? {
        Moment::Model(_) => Err(format!("`{text}`: there is no model; {EXPECTED}")),
        time if time.number().is_sign_negative() && time.number() != 0.0 => Err("expected a time from 0 on".into()),
        time => Ok(time),
    }
}

/// A time that may be before the start.
pub fn any_time(text: &str) -> Result<Moment, String> {
    let before = text.strip_prefix('-').map(|after| time(after).map(|_| ()));
    before.unwrap_or_else(|| time(text).map(|_| ()))?;
    text.parse()
}

/// A time in seconds, where there are no frames.
pub fn seconds(text: &str) -> Result<f64, String> {
    match time(text)? {
        Moment::Seconds(s) => Ok(s),
        _ => Err(format!("`{text}`: there are no frames here; expected seconds, as 2.5s or 2.5")),
    }
}

/// A duration in seconds, above 0.
pub fn seconds_above_0(text: &str) -> Result<f64, String> {
    seconds(text).and_then(|s| if s > 0.0 { Ok(s) } else { Err("expected more than 0 s".into()) })
}

/// A duration above 0; a bare number is seconds.
pub fn length(text: &str) -> Result<Moment, String> {
    above_0(moment(text)?)
}

/// A duration above 0; a bare number is frames.
pub fn length_in_frames(text: &str) -> Result<Moment, String> {
    above_0(Moment::in_frames(text)?)
}

/// Seconds or frames that a length may have at most, so that it is a number of frames at any rate.
const LONGEST: f64 = 1e9;

fn above_0(length: Moment) -> Result<Moment, String> {
    match length.number() {
        n if n <= 0.0 => Err(format!("{length}: expected more than nothing")),
        n if n > LONGEST => Err(format!("{length}: expected at most {LONGEST:e} seconds or frames")),
        _ => Ok(length),
    }
}

/// A time or a length; a bare number is seconds.
fn moment(text: &str) -> Result<Moment, String> {
    text.parse().map_err(|_| format!("`{text}` is no time; {EXPECTED}"))
}

/// A number of frames at `fps`, in a range; a bare number is frames.
pub fn frames_at(fps: f64, range: RangeInclusive<u32>) -> impl Fn(&str) -> Result<u32, String> + Clone {
    move |text| {
        let frames = Moment::in_frames(text)?.frames(fps);
        let within = (f64::from(*range.start())..=f64::from(*range.end())).contains(&frames);
        let wrong = || format!("{frames} frames; expected {} to {}", range.start(), range.end());
        if within { Ok(frames as u32) } else { Err(wrong()) }
    }
}

/// A fraction, 0 to 1.
pub fn share(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|s| (0.0..=1.0).contains(s)).ok_or("expected a number from 0 to 1".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_is_refused_with_what_it_may_be() {
        assert_eq!(length("inf").unwrap_err(), "`inf` is no time; expected 2.5s, 2.5 or 40f");
        assert_eq!(length("1e308").unwrap_err(), "1e308s: expected at most 1e9 seconds or frames");
        assert_eq!(length_in_frames("0").unwrap_err(), "0f: expected more than nothing");
        assert_eq!(length("40f"), Ok(Moment::Frames(40.0)));
        assert_eq!(time("-1s").unwrap_err(), "expected a time from 0 on");
        assert_eq!(any_time("-1s"), Ok(Moment::Seconds(-1.0)));
    }
}
