//! ASF and AMC (Acclaim): a skeleton in one file, motions on it in others, as the CMU database itself gives its clips.
//!
//! Grammar and conventions: "Acclaim Skeleton File Definition V1.10" (Schafer, 1995); scale and rate of CMU's files:
//! mocap.cs.cmu.edu/faqs.php. A bone begins where its parent ends; the joint that is named after it is at its beginning.

mod asf;
mod rows;
mod words;

use super::size;
use super::{Axes, ReadOptions};
use crate::rig::{map_if_any, recognise};
use crate::{Clip, EndSite, Error, FaultKind, FileError, Motion, Quat, Result, Skeleton, Source, Vec3, Warning};
use asf::Asf;
use kinelm_store::{SourcePos, input};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The rate of CMU's clips, which an AMC doesn't state, frames per second.
pub const FPS: f64 = 120.0;

/// Reads an AMC, and the ASF of its skeleton from the same folder: of the same stem, else of its part before the first
/// `_` (`07.asf` for `07_01.amc`), else the only one there is.
///
/// # Errors
/// [`FaultKind::NoMotion`] without an ASF, a channel or a frame; [`FaultKind::UnexpectedWord`], [`FaultKind::NumberBad`],
/// [`FaultKind::RowWidth`] with line and column; [`FaultKind::UnitUnknown`] when neither the ASF nor the legs show the unit;
/// [`FaultKind::TooDeep`], [`FaultKind::TooLarge`].
pub fn read(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
    let beside = skeleton_beside(path)?;
    parse(path, bytes, &beside, &input::bytes(&beside).map_err(Error::io(&beside))?, options)
}

/// Reads a motion from the bytes of an AMC and of its ASF, each with its path for messages.
///
/// # Errors
/// Those of [`read`] but for an ASF that isn't there.
pub fn parse(path: &Path, amc: &[u8], beside: &Path, asf: &[u8], options: &ReadOptions) -> Result<Motion> {
    let asf = &Asf::parse(beside, asf)?;
    let rows = rows::Rows::parse(path, amc, asf)?;
    let mut warnings = rows.warnings;
    let unit_m = unit_m(asf, beside, options)?;
    let skeleton = Arc::new(skeleton(asf, unit_m)?);
    let bones = asf.bones.len();
    let mut root = Vec::with_capacity(rows.frames);
    let mut rotations = Vec::with_capacity(rows.frames * (bones + 1));
    for frame in rows.values.chunks_exact(asf.width) {
        let (place, turn) = asf.root.pose(&frame[..asf.root.channels.len()], rows.angle);
        root.push(place * unit_m);
        rotations.push(turn);
        rotations.extend(asf.bones.iter().map(|bone| bone.turn(&frame[bone.column..], rows.angle)));
    }
    let fps = options.fps_source.or(rows.fps).unwrap_or_else(|| {
        let what = format!("an AMC states no rate: read at CMU's {FPS}; give `fps_source` if that is wrong");
        warnings.push(Warning { kind: "rate_assumed", what });
        FPS
    });
    let clip = Clip::new(skeleton, fps, root, rotations).map_err(|e| e.in_clip(path))?;
    let found = map_if_any(&clip, options.map.as_deref())?;
    let (axes, doubt) = Axes::of(&clip, options.up, found.as_ref());
    warnings.extend(doubt);
    let clip = axes.to_y_up(clip)?;
    Ok(Motion::read(path, clip, Source::plain(axes), warnings, found))
}

/// The ASF that belongs to an AMC.
fn skeleton_beside(path: &Path) -> Result<PathBuf> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut found: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let file = entry.map_err(Error::io(folder))?.path();
        if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("asf")) {
            found.push(file);
        }
    }
    // folders list their files in any order; messages must not depend on it
    found.sort();
    let of_stem = |stem: &str| found.iter().find(|f| f.file_stem().is_some_and(|s| s.eq_ignore_ascii_case(stem)));
    let subject = stem.split('_').next().unwrap_or(&stem);
    match of_stem(&stem).or_else(|| of_stem(subject)) {
        Some(file) => Ok(file.clone()),
        None if found.len() == 1 => Ok(found.swap_remove(0)),
        None => {
            let found = format!("{} ASF files in its folder, none of its name", found.len());
            let expected = format!("its skeleton beside it: {stem}.asf, {subject}.asf, or the only .asf of the folder");
            Err(FileError::new(SourcePos::file(path), FaultKind::NoMotion, found, expected).into())
        }
    }
}

/// The unit in metres: as given; inches by the ASF's scale, as CMU's 0.45; else by the legs.
fn unit_m(asf: &Asf, beside: &Path, options: &ReadOptions) -> Result<f64> {
    if let Some(unit) = options.unit.metres() {
        return Ok(unit);
    }
    if asf.length != 1.0 {
        // CMU's FAQ: lengths divided by the scale are inches; a scale of 1 is also what a file without one has
        return Ok(0.0254 / asf.length);
    }
    let rig = skeleton(asf, 1.0)?;
    let legs = recognise(&rig, None).and_then(|found| size::leg(&rig, &found.map));
    let leg = legs.map(|legs| legs.iter().map(|&j| rig.offsets()[j].length()).sum::<f64>());
    leg.and_then(size::unit_of_leg).ok_or_else(|| {
        let found = leg.map_or("no legs".into(), |l| format!("a length unit of 1 and a leg of {l:.4}"));
        let fault = FileError::new(SourcePos::file(beside), FaultKind::UnitUnknown, found, "a leg of a person");
        fault.help(size::GIVE_UNIT).into()
    })
}

/// Joint 0 is the root, joint n + 1 the beginning of bone n.
fn skeleton(asf: &Asf, unit_m: f64) -> Result<Skeleton> {
    let names = std::iter::once("root".to_owned()).chain(asf.bones.iter().map(|b| b.name.clone())).collect();
    let parents = std::iter::once(None).chain(asf.bones.iter().map(|b| Some(b.parent))).collect();
    let end = |joint: usize| joint.checked_sub(1).map_or(Vec3::ZERO, |n| asf.bones[n].way * unit_m);
    let offsets = std::iter::once(Vec3::ZERO).chain(asf.bones.iter().map(|b| end(b.parent))).collect();
    let leaf = |joint: &usize| asf.bones.iter().all(|b| b.parent != *joint);
    let ends = (1..=asf.bones.len()).filter(leaf).map(|parent| EndSite { parent, offset: end(parent) }).collect();
    Skeleton::new(names, parents, offsets, ends)
}

/// A rotation about fixed axes, one after the other, radians.
fn about_fixed(turns: impl Iterator<Item = (crate::rotation::Axis, f64)>) -> Quat {
    // about fixed axes, each later rotation multiplies from the left
    turns.fold(Quat::IDENTITY, |before, (axis, angle)| axis.turn(angle) * before)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn golden(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
    }

    /// Places by an independent reader: `scripts/reference/amc.py`.
    #[test]
    fn places_are_those_of_another_reader() {
        let path = golden("bones.amc");
        let motion = crate::format::read(&path, &ReadOptions::default()).unwrap();
        assert_eq!((motion.clip.frames(), motion.clip.fps()), (3, 120.0));
        assert!(motion.warnings.iter().any(|w| w.kind == "rate_assumed"), "{:?}", motion.warnings);
        let text = std::fs::read_to_string(golden("bones.json")).unwrap();
        let expected: serde_json::Value = serde_json::from_str(&text).unwrap();
        let positions = motion.clip.positions();
        for (f, frame) in expected["frames"].as_array().unwrap().iter().enumerate() {
            for (j, name) in motion.clip.skeleton().names().iter().enumerate() {
                let start = &frame[name.as_str()];
                let place = Vec3::from_array([0, 1, 2].map(|i| start[i].as_f64().unwrap()));
                let found = positions[f * motion.clip.joints() + j];
                assert!(found.distance(place) < 1e-8, "frame {f}, {name}: {found} {place}");
            }
        }
    }

    fn said(asf: &str, amc: &str) -> String {
        let files = [Path::new("x.amc"), Path::new("x.asf")];
        let read = parse(files[0], amc.as_bytes(), files[1], asf.as_bytes(), &ReadOptions::default());
        read.unwrap_err().to_string()
    }

    #[test]
    fn faults_have_their_place() {
        let asf = std::fs::read_to_string(golden("bones.asf")).unwrap();
        let amc = std::fs::read_to_string(golden("bones.amc")).unwrap();
        for (of_asf, [from, to], expected) in [
            (true, ["length 7.5", "length x"], "x.asf:39:13"),
            (true, ["lfemur ltibia", "lfemur nobody"], "nobody"),
            (true, ["lfemur ltibia", "lfemmur ltibia"], "found lfemmur, expected root, or a bone of :bonedata"),
            (true, ["dof rx\n", "dof rq\n"], "rq"),
            (true, [":root", ":tree"], "no :root"),
            (false, ["lfemur 0 0 0", "lfemur 0 0"], "x.amc:7"),
            (false, ["ltibia 45", "ltibia NaN"], "NaN"),
            (false, ["ltibia 45", "tail 45"], "tail"),
            (false, [&amc[amc.find("1\n").unwrap()..], ""], "no frame"),
        ] {
            let (a, m) = if of_asf {
                (asf.replacen(from, to, 1), amc.clone())
            } else {
                (asf.clone(), amc.replacen(from, to, 1))
            };
            assert!(a != asf || m != amc, "{from}");
            let message = said(&a, &m);
            assert!(message.contains(expected), "{from}: {message}");
        }
    }

    #[test]
    fn a_skeleton_without_channels_is_refused() {
        let asf =
            ":root\n:bonedata\nbegin\nname leg\ndirection 0 1 0\nlength 1\nend\n:hierarchy\nbegin\nroot leg\nend\n";
        let message = said(asf, "1\n2\n");
        assert!(message.contains("no channels"), "{message}");
    }
}
