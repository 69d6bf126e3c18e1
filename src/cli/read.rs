//! The reading options, the same on every command that reads motion.

use kinelm::spectral::windows::{LEAST_FRAMES, MOST_FRAMES};
use kinelm_motion::format::{BvhPosition, ReadOptions, RestFrame, Unit, Up};
use kinelm_motion::moment::{EXPECTED, Moment};
use kinelm_motion::resample::MOST_FPS;
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// How motion files are read.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Reading motion")]
pub struct ReadArgs {
    /// The true rate of the files, where they state it wrongly (an fps column of the labels overrules it)
    #[arg(long, value_name = "FPS", value_parser = rate)]
    pub fps_source: Option<f64>,
    /// Unit of a BVH, which has none of its own; auto judges by the length of the leg
    #[arg(long, value_enum, default_value = "auto")]
    pub unit: UnitArg,
    /// The axis that points up in a BVH or JSON; auto judges a BVH by its rest pose and its motion, a JSON has y up
    #[arg(long, value_enum, default_value = "auto", allow_hyphen_values = true, value_name = "AXIS")]
    pub up: UpArg,
    /// Skeleton TOML for a rig whose joint names no shipped one knows: a shipped name or a file
    #[arg(long, value_name = "NAME|FILE")]
    pub map: Option<String>,
    /// Whether a joint's position channels replace its OFFSET or are added to it
    #[arg(long, value_enum, default_value = "replace")]
    pub bvh_position: PositionArg,
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
    /// Source frames left out at the start; with N > 0 no rest-pose frame is looked for (a skip column overrules it)
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub skip: usize,
    /// Your own SMPL_*.npz: its rest offsets and shape take the place of the neutral skeleton's (AMASS, AIST++)
    #[arg(long, value_name = "FILE")]
    pub body_model: Option<PathBuf>,
    /// Where the floor is, metres, for tokenizers that code heights above it; auto goes by the feet (a floor column of the
    /// labels overrules it)
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
        ReadOptions {
            fps_source: self.fps_source,
            unit: self.unit.into(),
            up: self.up.into(),
            map: self.map.clone(),
            bvh_position: self.bvh_position.into(),
            root: self.root.clone(),
            lenient: self.lenient,
            rest: match (self.keep_rest, self.drop_rest) {
                (true, _) => RestFrame::Keep,
                (_, true) => RestFrame::Drop,
                _ => rest,
            },
            skip: self.skip,
            body_model: self.body_model.clone(),
            floor: self.floor.and_then(|f| f.0),
        }
    }
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
    within(LEAST_FRAMES..=MOST_FRAMES)(text)
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

/// `--unit`.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub enum UnitArg {
    /// Judged by the leg
    Auto,
    /// Metres
    M,
    /// Centimetres
    Cm,
    /// Millimetres
    Mm,
    /// Inches
    In,
    /// CMU's 0.0564444 m
    Cmu,
}

impl From<UnitArg> for Unit {
    fn from(unit: UnitArg) -> Unit {
        match unit {
            UnitArg::Auto => Unit::Auto,
            UnitArg::M => Unit::Metre,
            UnitArg::Cm => Unit::Centimetre,
            UnitArg::Mm => Unit::Millimetre,
            UnitArg::In => Unit::Inch,
            UnitArg::Cmu => Unit::Cmu,
        }
    }
}

/// `--up`.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub enum UpArg {
    /// Judged by how the body stands
    Auto,
    /// x
    X,
    /// x, pointing down
    #[value(name = "-x")]
    NegX,
    /// y
    Y,
    /// y, pointing down
    #[value(name = "-y")]
    NegY,
    /// z, as in Blender
    Z,
    /// z, pointing down
    #[value(name = "-z")]
    NegZ,
}

impl From<UpArg> for Up {
    fn from(up: UpArg) -> Up {
        match up {
            UpArg::Auto => Up::Auto,
            UpArg::X => Up::X,
            UpArg::NegX => Up::NegX,
            UpArg::Y => Up::Y,
            UpArg::NegY => Up::NegY,
            UpArg::Z => Up::Z,
            UpArg::NegZ => Up::NegZ,
        }
    }
}

/// `--bvh-position`.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub enum PositionArg {
    /// A channel takes the place of its component of the OFFSET
    Replace,
    /// A channel is added to its component of the OFFSET
    Add,
}

impl From<PositionArg> for BvhPosition {
    fn from(position: PositionArg) -> BvhPosition {
        match position {
            PositionArg::Replace => BvhPosition::Replace,
            PositionArg::Add => BvhPosition::Add,
        }
    }
}
