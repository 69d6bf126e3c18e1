//! The motion file.

use super::asf::{Asf, Channel};
use super::words::lines;
use crate::{FaultKind, FileError, Result, Warning};
use kinelm_store::SourcePos;
use std::collections::HashMap;
use std::path::Path;

/// Most numbers.
const MOST_NUMBERS: usize = 1 << 30;

/// The numbers of a motion.
pub(super) struct Rows {
    pub frames: usize,
    /// Numbers (F, width of the skeleton), in the order of its bones.
    pub values: Vec<f64>,
    /// The factor from the file's angles to radians.
    pub angle: f64,
    /// The rate, if the file states one.
    pub fps: Option<f64>,
    pub warnings: Vec<Warning>,
}

impl Rows {
    pub fn parse(path: &Path, bytes: &[u8], asf: &Asf) -> Result<Rows> {
        let text = String::from_utf8_lossy(bytes);
        // where a bone's numbers are in a frame, and how many
        let mut places: HashMap<String, (usize, usize)> = HashMap::new();
        places.insert("root".into(), (0, asf.root.channels.len()));
        for bone in &asf.bones {
            places.insert(bone.name.to_ascii_lowercase(), (bone.column, bone.channels.len()));
        }
        let (mut values, mut frames, mut fps, mut degrees) = (Vec::new(), 0usize, None, asf.degrees);
        let mut said: Vec<bool> = vec![false; asf.width];
        let mut missing = 0usize;
        for line in lines(path, &text) {
            let key = line.key();
            match key.as_str() {
                ":radians" => degrees = false,
                ":degrees" => degrees = true,
                ":samples-per-second" => fps = Some(line.number(1)?),
                _ if key.starts_with(':') => {}
                // a bone without dof has no line in an AMC, so a lone number can only be a frame's
                _ if line.words.len() == 1 && key.parse::<u64>().is_ok() => {
                    missing += usize::from(frames > 0 && said.contains(&false));
                    said.fill(false);
                    frames += 1;
                    if frames.saturating_mul(asf.width) > MOST_NUMBERS {
                        return Err(line.fault(
                            0,
                            FaultKind::TooLarge,
                            format!("frame {frames}"),
                            "2^30 numbers at most",
                        ));
                    }
                    // a bone that a frame leaves out stays as it was
                    let before = values.len().saturating_sub(asf.width);
                    if values.is_empty() {
                        values.resize(asf.width, 0.0);
                    } else {
                        values.extend_from_within(before..);
                    }
                }
                _ => {
                    let Some(&(column, width)) = places.get(&key) else {
                        let expected = "a bone of the ASF that moves, or a frame's number";
                        return Err(line.fault(0, FaultKind::UnexpectedWord, line.words[0].1, expected));
                    };
                    if line.words.len() - 1 != width {
                        let found = format!("{} numbers", line.words.len() - 1);
                        return Err(line.fault(
                            0,
                            FaultKind::RowWidth,
                            found,
                            format!("{width}, as the ASF says of {key}"),
                        ));
                    }
                    if frames == 0 {
                        return Err(line.fault(
                            0,
                            FaultKind::UnexpectedWord,
                            line.words[0].1,
                            "a frame's number first",
                        ));
                    }
                    let from = values.len() - asf.width + column;
                    for n in 0..width {
                        values[from + n] = line.number(n + 1)?;
                        said[column + n] = true;
                    }
                }
            }
        }
        if frames == 0 {
            let fault = FileError::new(SourcePos::file(path), FaultKind::NoMotion, "no frame", "frames of an AMC");
            return Err(fault.into());
        }
        missing += usize::from(said.contains(&false));
        let mut warnings = Vec::new();
        let mut warn = |kind, what: String| warnings.push(Warning { kind, what });
        if missing > 0 {
            warn("bones_missing", format!("{missing} of {frames} frames leave bones out: they stay as they were"));
        }
        if asf.bones.iter().any(|b| b.channels.iter().any(|c| !matches!(c, Channel::Turn(_)))) {
            warn("stretch_dropped", "bones that move or get longer: left as at rest".into());
        }
        let angle = if degrees { std::f64::consts::PI / 180.0 } else { 1.0 };
        Ok(Rows { frames, values, angle, fps, warnings })
    }
}
