//! Motion files: found by name and first bytes, read into a [`Motion`], written back.

pub mod aist;
pub mod amass;
pub mod atomic;
pub mod body_model;
pub mod bvh;
pub mod json;
pub mod npy;
pub mod npz;
pub mod pickle;
pub mod positions;
mod smpl_arrays;

use crate::rotation::angle_between;
use crate::{Error, FileError, Kind, Motion, Place, Quat, Result, Source, Warning};
use positions::Positions;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// What a file's bytes are to be read as; the same on every command.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReadOptions {
    /// The true rate, where the file states it wrongly.
    pub fps_source: Option<f64>,
    /// The unit of a BVH.
    pub unit: Unit,
    /// A skeleton TOML by its shipped name or its path, for a rig whose names no shipped one knows.
    pub map: Option<String>,
    /// What position channels do to a joint's OFFSET.
    pub bvh_position: BvhPosition,
    /// The ROOT to read, of several.
    pub root: Option<String>,
    /// Keep the whole rows of a cut file.
    pub lenient: bool,
    /// What to do with a leading rest-pose frame.
    pub rest: RestFrame,
    /// Source frames left out, counted from the file's first. Above 0 no rest frame is looked for.
    pub skip: usize,
    /// A body model (`SMPL_*.npz`) whose rest offsets replace the neutral skeleton's, for AMASS and AIST++.
    pub body_model: Option<PathBuf>,
}

/// The length that 1 in a BVH means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Unit {
    /// Judged by the leg's length.
    #[default]
    Auto,
    /// Metres.
    Metre,
    /// Centimetres.
    Centimetre,
    /// Millimetres.
    Millimetre,
    /// Inches.
    Inch,
    /// 0.0564444 m, the unit of CMU's ASF/AMC files.
    Cmu,
}

impl Unit {
    /// Metres; `None` for [`Unit::Auto`].
    pub fn metres(self) -> Option<f64> {
        Some(match self {
            Unit::Auto => return None,
            Unit::Metre => 1.0,
            Unit::Centimetre => 0.01,
            Unit::Millimetre => 0.001,
            Unit::Inch => 0.0254,
            Unit::Cmu => 0.0564444,
        })
    }
}

/// The two conventions of BVH position channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BvhPosition {
    /// A channel takes the place of its component of the OFFSET.
    #[default]
    Replace,
    /// A channel is added to its component of the OFFSET.
    Add,
}

/// What to do with a leading rest-pose frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RestFrame {
    /// Leave it.
    #[default]
    Keep,
    /// Leave it out, and say so.
    Drop,
}

/// The formats of motion files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Format {
    /// `.bvh`.
    Bvh,
    /// `.npz`: AMASS.
    Npz,
    /// `.pkl`: AIST++.
    Pickle,
    /// `.json`: a clip of our own.
    Json,
}

impl Format {
    /// The format that a file's name says, in any letter case.
    pub fn of_name(path: &Path) -> Option<Format> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Some(match extension.as_str() {
            "bvh" => Format::Bvh,
            "npz" => Format::Npz,
            "pkl" => Format::Pickle,
            "json" => Format::Json,
            _ => return None,
        })
    }

    /// The format of a file by its name, or an error that lists the names there are.
    ///
    /// # Errors
    /// `not_this_format`.
    pub fn of(path: &Path) -> Result<Format> {
        let found = match path.extension() {
            Some(e) => format!("the extension .{}", e.to_string_lossy()),
            None => "no extension".into(),
        };
        let expected = ".bvh, .npz, .pkl or .json";
        Format::of_name(path)
            .ok_or_else(|| FileError::new(Place::file(path), Kind::NotThisFormat, found, expected).into())
    }
}

/// Reads a motion file.
///
/// The format goes by the extension, and the first bytes must agree. Then, in this order: the rate is overruled
/// (`fps_source`), the first frames are left out (`skip`), and, where `skip` is 0, a leading rest-pose frame is looked for;
/// found, it is reported as the warning `rest_frame` and kept or dropped as `rest` says.
///
/// # Errors
/// [`Error::Io`]; [`Error::File`] with place and kind for a file that is wrong; [`Error::Call`] for a rate that is not
/// positive and finite; [`Error::Clip`] when skipping leaves nothing.
pub fn read(path: &Path, options: &ReadOptions) -> Result<Motion> {
    let format = Format::of(path)?;
    if let Some(fps) = options.fps_source.filter(|f| !(f.is_finite() && *f > 0.0)) {
        return Err(Error::Call(format!("a source rate of {fps} frames per second; expected a positive number")));
    }
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    let motion = match format {
        Format::Bvh => bvh::read(path, &bytes, options)?,
        Format::Npz => skipped(amass::read(path, &bytes, options)?, options)?,
        Format::Pickle => skipped(aist::read(path, &bytes, options)?, options)?,
        Format::Json => skipped(json::read(path, &bytes, options)?, options)?,
    };
    after_reading(motion, options)
}

/// Where every joint and end site of a motion file is: of a BVH by the file's own channels, in its own order, nothing
/// folded; of all others by the clip's skeleton, for AMASS and AIST++ the neutral one (or the body model's).
///
/// # Errors
/// As [`read`].
pub fn positions(path: &Path, options: &ReadOptions) -> Result<Positions> {
    match Format::of(path)? {
        Format::Bvh => bvh::positions(path, &std::fs::read(path).map_err(Error::io(path))?, options),
        _ => Ok(Positions::from_clip(&read(path, options)?.clip)),
    }
}

/// A motion without the first frames that are to be left out.
fn skipped(motion: Motion, options: &ReadOptions) -> Result<Motion> {
    if options.skip == 0 {
        return Ok(motion);
    }
    let frames = motion.clip.frames();
    check_skip(&motion.path, options.skip, frames)?;
    Ok(motion.slice(options.skip..frames))
}

/// The rest-pose frame of a motion that was read with `options`: reported, and kept or dropped.
fn after_reading(mut motion: Motion, options: &ReadOptions) -> Result<Motion> {
    if options.skip > 0 || !rest_frame(&motion) {
        return Ok(motion);
    }
    let done = match options.rest {
        RestFrame::Keep => "kept",
        RestFrame::Drop => "left out",
    };
    if options.rest == RestFrame::Drop {
        motion = motion.slice(1..motion.clip.frames());
    }
    let what = format!("frame 0 looks like a rest pose before the motion: {done}");
    motion.warnings.push(Warning { kind: "rest_frame", what });
    Ok(motion)
}

/// Whether a rest-pose frame is to be looked for and left out.
pub(crate) fn looks_for_rest(options: &ReadOptions) -> bool {
    options.skip == 0 && options.rest == RestFrame::Drop
}

/// Fails when `skip` leaves none of `frames`.
pub(crate) fn check_skip(path: &Path, skip: usize, frames: usize) -> Result<()> {
    if skip < frames {
        return Ok(());
    }
    let what = format!("{skip} frames are to be skipped and there are {frames}; skip fewer");
    Err(Error::Clip { clip: path.display().to_string(), what })
}

/// Whether frame 0 is a rest pose put before the motion, as many CMU conversions have it.
///
/// So it is if the root's rotation is exactly nothing (of a BVH: all its rotation channels are 0) and the step from frame
/// 0 to frame 1 is above 10 times the median step. A step is the largest angle that a joint turns between two frames (the
/// mean over the joints misses a clip of cmu-dance). Fewer than 3 frames have no median to compare with.
pub fn rest_frame(motion: &Motion) -> bool {
    let clip = &motion.clip;
    let unturned = match &motion.source {
        _ if clip.frames() < 3 => false,
        Source::Bvh(source) if source.frames == clip.frames() => source.root_unturned(0),
        _ => clip.pose(0)[0].abs_diff_eq(Quat::IDENTITY, 0.0),
    };
    if !unturned {
        return false;
    }
    let step = |f: usize| {
        let turned = clip.pose(f).iter().zip(clip.pose(f + 1)).map(|(a, b)| angle_between(*a, *b));
        turned.fold(0.0, f64::max)
    };
    let first = step(0);
    let mut steps: Vec<f64> = (0..clip.frames() - 1).map(step).collect();
    let middle = steps.len() / 2;
    let (_, median, _) = steps.select_nth_unstable_by(middle, f64::total_cmp);
    first > 10.0 * *median
}

/// Writes a motion file in the format of its name, whole or not at all.
///
/// # Errors
/// [`Error::Io`]; `not_this_format` for a name that says no format that is written; [`Error::Call`] for a clip that the
/// format can't hold.
pub fn write(path: &Path, motion: &Motion) -> Result<()> {
    match Format::of(path)? {
        Format::Bvh => bvh::write(path, motion),
        Format::Npz => atomic::write(path, &amass::write(&motion.clip)?),
        Format::Json => atomic::write(path, &json::write(&motion.clip)),
        Format::Pickle => {
            let expected = "a .bvh, .npz or .json to write";
            Err(FileError::new(Place::file(path), Kind::NotThisFormat, "the extension .pkl", expected).into())
        }
    }
}

impl Motion {
    /// The frames of a range, of the clip and of the file's own numbers beside it.
    ///
    /// # Panics
    /// If the range leaves the clip.
    pub fn slice(&self, frames: Range<usize>) -> Motion {
        let source = match &self.source {
            Source::Bvh(s) if s.frames == self.clip.frames() => Source::Bvh(Box::new(s.slice(frames.clone()))),
            other => other.clone(),
        };
        Motion { path: self.path.clone(), clip: self.clip.slice(frames), source, warnings: self.warnings.clone() }
    }
}
