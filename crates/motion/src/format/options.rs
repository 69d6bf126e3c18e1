//! Options of reading motion files.

use super::{MirrorAxis, Up};
use crate::resample::{FEWEST_FPS, MOST_FPS};
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// How a motion file is to be read; the same for all commands.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReadOptions {
    /// The true rate, if the file states a wrong one.
    pub fps_source: Option<f64>,
    /// The unit of the file's lengths, where it states none or a wrong one.
    pub unit: Unit,
    /// The up axis of the file.
    pub up: Up,
    /// A skeleton map by its built-in name or its path, or its TOML, for rigs that no built-in map fits.
    pub map: Option<String>,
    /// What position channels do to a joint's OFFSET.
    pub bvh_position: BvhPosition,
    /// What to read of a file: a figure by its root or armature, or a joint, which then is the clip's root.
    pub root: Option<String>,
    /// The animation to read of a GLB or FBX, by name; `None` takes the longest that moves the figure.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub take: Option<String>,
    /// Read the whole rows of a truncated file.
    pub lenient: bool,
    /// What to do with a leading rest-pose frame.
    pub rest: RestFrame,
    /// Frames to drop at the start. Above 0, no rest-pose frame is detected.
    pub skip: usize,
    /// A body model (`SMPL_*.npz`) whose rest offsets replace the neutral skeleton's in AMASS and AIST++ files.
    pub body_model: Option<PathBuf>,
    /// The height of the floor, metres, world; `None` detects it from the feet.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floor: Option<f64>,
    /// The axis of the file's world along which its bodies are mirrored; writing the file back mirrors them again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mirror_axis: Option<MirrorAxis>,
}

/// The unit of a file's lengths.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Unit {
    /// The unit that the file states; for a BVH, which states none, the one that its legs indicate.
    #[default]
    Auto,
    /// A length in metres, finite and above 0.
    Metres(f64),
}

impl Unit {
    /// Metre.
    pub const METRE: Unit = Unit::Metres(1.0);
    /// Decimetre.
    pub const DECIMETRE: Unit = Unit::Metres(0.1);
    /// Centimetre.
    pub const CENTIMETRE: Unit = Unit::Metres(0.01);
    /// Millimetre.
    pub const MILLIMETRE: Unit = Unit::Metres(0.001);
    /// Inch.
    pub const INCH: Unit = Unit::Metres(0.0254);
    /// Foot.
    pub const FOOT: Unit = Unit::Metres(0.3048);
    /// The unit of CMU's ASF/AMC files.
    pub const CMU: Unit = Unit::Metres(0.0564444);

    /// The units with a name, likeliest first.
    pub(super) const NAMED: [(&str, Unit); 7] = [
        ("m", Unit::METRE),
        ("cm", Unit::CENTIMETRE),
        ("mm", Unit::MILLIMETRE),
        ("in", Unit::INCH),
        ("cmu", Unit::CMU),
        ("dm", Unit::DECIMETRE),
        ("ft", Unit::FOOT),
    ];
    /// What [`Unit::from_str`] takes.
    pub const EXPECTED: &str = "auto, m, dm, cm, mm, in, ft, cmu, or metres as 0.0725 m";

    /// The unit in metres; `None` for [`Unit::Auto`].
    pub fn metres(self) -> Option<f64> {
        match self {
            Unit::Auto => None,
            Unit::Metres(metres) => Some(metres),
        }
    }
}

impl FromStr for Unit {
    type Err = String;

    /// `auto`, a name, or a number of metres with or without an `m` after it.
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let text = text.trim();
        if text == "auto" {
            return Ok(Unit::Auto);
        }
        if let Some((_, unit)) = Unit::NAMED.iter().find(|(name, _)| *name == text) {
            return Ok(*unit);
        }
        let number = text.strip_suffix('m').unwrap_or(text).trim_end().parse::<f64>();
        let metres = number.ok().filter(|metres| metres.is_finite() && *metres > 0.0);
        metres.map(Unit::Metres).ok_or_else(|| format!("expected {}", Unit::EXPECTED))
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self, Unit::NAMED.iter().find(|(_, unit)| unit == self)) {
            (Unit::Auto, _) => f.write_str("auto"),
            (_, Some((name, _))) => f.write_str(name),
            (Unit::Metres(metres), None) => write!(f, "{metres} m"),
        }
    }
}

impl TryFrom<String> for Unit {
    type Error = String;

    fn try_from(text: String) -> std::result::Result<Self, String> {
        text.parse()
    }
}

impl From<Unit> for String {
    fn from(unit: Unit) -> String {
        unit.to_string()
    }
}

/// The two meanings of BVH position channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum BvhPosition {
    /// A channel replaces its component of the OFFSET.
    #[default]
    Replace,
    /// A channel is added to its component of the OFFSET.
    Add,
}

/// What to do with a leading rest-pose frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RestFrame {
    /// Keep it.
    #[default]
    Keep,
    /// Drop it and report that.
    Drop,
}

/// Whether a rate is plausible and can be written again.
pub(crate) fn is_rate(fps: f64) -> bool {
    (FEWEST_FPS..=MOST_FPS).contains(&fps)
}

/// Fails if `skip` leaves no frame.
pub(crate) fn check_skip(path: &Path, skip: usize, frames: usize) -> Result<()> {
    if skip < frames {
        return Ok(());
    }
    Err(Error::invalid_parameter("skip", skip, format!("fewer than all frames; there are {frames}")).in_clip(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_names_or_metres() {
        for (text, metres, shown) in
            [("dm", 0.1, "dm"), ("ft", 0.3048, "ft"), ("0.0725 m", 0.0725, "0.0725 m"), ("0.01", 0.01, "cm")]
        {
            let unit: Unit = text.parse().unwrap();
            assert_eq!((unit.metres(), unit.to_string().as_str()), (Some(metres), shown));
            assert_eq!(unit.to_string().parse(), Ok(unit));
        }
        assert_eq!("auto".parse(), Ok(Unit::Auto));
        for text in ["", "mile", "0", "-1 m", "nan", "inf m", "1 cm"] {
            assert!(text.parse::<Unit>().unwrap_err().contains("0.0725 m"), "{text}");
        }
    }
}
