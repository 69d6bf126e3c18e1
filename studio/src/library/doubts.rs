//! The facts of a file, and its doubts in plain words, each with a button that settles it.
//!
//! The doubts are the library's own, those that `kinelm inspect` prints; here they get words for somebody who doesn't
//! know its options, and the option as a button.

use crate::project::document::Reading;
use crate::{Error, Result};
use kinelm_corpus::music::library::EXTENSIONS;
use kinelm_corpus::sidecar;
use kinelm_motion::capsules::standing_height_m;
use kinelm_motion::format::{
    self, FileRate, Format, MirrorAxis, RateDoubt, ReadOptions, RestFrame, Unit, Up, smeared_frames, standing_axis,
};
use kinelm_motion::inspect::report;
use kinelm_motion::rig::{self, SkeletonMap};
use kinelm_motion::{FaultKind, Motion, Source};
use kinelm_store::files;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The result of reading a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// It was read.
    Ready(Box<Info>),
    /// It can't be read.
    Failed {
        /// Why.
        text: String,
        /// Doubts that may settle it.
        doubts: Vec<Doubt>,
    },
}

/// The facts of a file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Info {
    /// `BVH`, `FBX`, `MP3`, ..
    pub format: String,
    /// Whether it is music.
    pub music: bool,
    /// Its length.
    pub seconds: f64,
    /// Frames per second; 0 of music.
    pub fps: f64,
    /// Frames; 0 of music.
    pub frames: usize,
    /// Joints of the rig.
    pub joints: usize,
    /// The skeleton map that knows the rig.
    pub rig: Option<String>,
    /// The height of the floor, metres.
    pub floor_m: f64,
    /// Whether it was converted to a BVH.
    pub converted: bool,
    /// Whether its file has a mesh, and can be given an animation.
    pub character: bool,
    /// Beats of music, seconds.
    pub beats_s: Vec<f64>,
    /// The file's own statements about its rate; empty for music.
    pub rate: FileRate,
    /// Things that look wrong.
    pub doubts: Vec<Doubt>,
}

/// Something that looks wrong in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Doubt {
    /// A stable name.
    pub kind: String,
    /// The doubt in plain words.
    pub text: String,
    /// A button that settles it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fix: Option<Fix>,
}

/// A button.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fix {
    /// Its text.
    pub label: String,
    /// The reading of the file that it states.
    pub body: Reading,
}

impl Outcome {
    /// A file that can't be read.
    pub fn failed(e: &Error) -> Outcome {
        Outcome::Failed { text: plain(&e.to_string()), doubts: Vec::new() }
    }
}

impl Doubt {
    fn new(kind: &str, text: impl Into<String>) -> Doubt {
        Doubt { kind: kind.into(), text: text.into(), fix: None }
    }

    fn fixed(self, label: impl Into<String>, body: Reading) -> Doubt {
        Doubt { fix: Some(Fix { label: label.into(), body }), ..self }
    }
}

/// A text of the library without its marks of parameters.
fn plain(text: &str) -> String {
    text.replace('`', "")
}

/// Reads a file. A clip of another format than BVH is written to `convert` as one.
pub fn outcome(file: &Path, reading: &Reading, convert: &Path) -> Outcome {
    let found = if is_music(file) { music(file) } else { motion(file, reading, convert) };
    match found {
        Ok(info) => Outcome::Ready(Box::new(info)),
        Err(e) => match &e {
            Error::Library(kinelm_model::Error::Motion(fault)) if fault.fault() == Some(FaultKind::UnitUnknown) => {
                let text = "The file doesn't say in which unit it is, and the length of its legs fits none.".into();
                Outcome::Failed { text, doubts: units(file, reading) }
            }
            _ => Outcome::failed(&e),
        },
    }
}

/// Frames times joints of a clip: an hour and a half of 24 joints at 60 frames a second, some 2 GB where it is edited.
const MOST_POSES: usize = 8_000_000; // 8e6 rotations are 256 MB as f64 quaternions; an edit has several copies of them

/// Whether a file is music by its name.
pub fn is_music(file: &Path) -> bool {
    let extension = file.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    extension.is_some_and(|extension| EXTENSIONS.contains(&&*extension))
}

fn music(file: &Path) -> Result<Info> {
    let beats = kinelm_music::beat::beats(file)?;
    let format = file.extension().unwrap_or_default().to_string_lossy().to_uppercase();
    let doubts =
        if beats.times_s.is_empty() { vec![Doubt::new("no_beats", "No beat was found in it.")] } else { vec![] };
    Ok(Info { format, music: true, seconds: beats.seconds, beats_s: beats.times_s, doubts, ..Info::default() })
}

/// The options with which a file is read.
///
/// # Errors
/// A sidecar that can't be read.
pub fn options(file: &Path, reading: &Reading) -> Result<ReadOptions> {
    let own = sidecar::read_options(file)?.map(|own| {
        // a file beside a clip is no reason to open others; a map of several lines is no file
        let map = own.map.filter(|map| SkeletonMap::builtin(map).is_some() || map.contains('\n'));
        ReadOptions { map, ..own }
    });
    Ok(reading.options(own.as_ref()))
}

fn motion(file: &Path, reading: &Reading, convert: &Path) -> Result<Info> {
    let options = options(file, reading)?;
    let motion = format::read(file, &options)?;
    if motion.clip.frames() == 0 {
        return Err(Error::file(file, "no frames", "at least one", "export it again with its animation"));
    }
    let poses = motion.clip.frames() * motion.clip.joints();
    // after reading: the limits of the process are there for what no header announces
    if poses > MOST_POSES {
        let limit = format!("{MOST_POSES} poses of a joint");
        return Err(Error::limit("the clip", format!("{poses} poses of a joint"), limit, "cut it into shorter ones"));
    }
    let is_bvh = matches!(motion.source, Source::Bvh(_));
    if !is_bvh {
        // from the clip alone: what else the format holds has no place in a BVH
        let own = Motion::new(convert, motion.clip.clone());
        files::write_whole(convert, &format::to_bytes(convert, &own)?)?;
    }
    let (mut floor_m, mut doubts) = (options.floor.unwrap_or(0.0), Vec::new());
    doubts.extend(of_rate(&motion));
    doubts.extend(of_up(&motion));
    doubts.extend(of_rest(&motion, &options));
    doubts.extend(of_mirror(&motion));
    match motion.map() {
        Some(_) if options.floor.is_none() => {
            let floor = motion.floor()?;
            floor_m = floor.height_m;
            doubts.extend(of_floor(floor));
        }
        Some(_) => {}
        // the clip can still be watched, so an unknown rig is a doubt and no error
        None => doubts.push(Doubt::new(
            "rig_unknown",
            "kinelm doesn't know this rig by its joints' names or build: it can be watched, but nothing can be generated to it.",
        )),
    }
    let report: serde_json::Value = serde_json::from_str(&report(&motion, Some(floor_m)).json()).unwrap_or_default();
    doubts.extend(others(&report));
    let format = Format::of_name(file).map_or("", |format| format.info().name);
    Ok(Info {
        format: format.into(),
        seconds: motion.clip.duration_s(),
        fps: motion.clip.fps(),
        frames: motion.clip.frames(),
        joints: motion.clip.joints(),
        rig: report["rig"].as_str().map(str::to_owned),
        floor_m,
        converted: !is_bvh,
        character: motion.has_character(),
        rate: FileRate::of(&motion, &options),
        doubts,
        ..Info::default()
    })
}

fn of_rate(motion: &Motion) -> Option<Doubt> {
    let doubt = RateDoubt::in_reading(motion)?;
    let (fps, likely, g) = (short(doubt.fps), short(doubt.likely_fps()), doubt.fall_g);
    let text = format!("At {fps} frames per second the body falls {g:.1} times as fast as gravity lets it.");
    Some(rate_doubt(text, likely))
}

/// The doubt of the rate of a file that doesn't fall too fast itself, beside others of its folder and rig that do.
pub fn of_folder_rate(info: &Info, likely_fps: f64) -> Doubt {
    let (fps, likely) = (short(info.fps), short(likely_fps));
    let text = format!("Others of its folder say {fps} frames per second too, and fall faster than gravity lets them.");
    rate_doubt(text, likely)
}

fn rate_doubt(text: String, likely_fps: f64) -> Doubt {
    let body = Reading { fps_source: Some(likely_fps), ..Reading::default() };
    Doubt::new("rate_doubted", text).fixed(format!("Play it at {likely_fps} fps"), body)
}

fn of_rest(motion: &Motion, options: &ReadOptions) -> Option<Doubt> {
    motion.warnings.iter().find(|warning| warning.kind == "rest_frame")?;
    let is_left_out = options.rest == RestFrame::Drop;
    let smeared = smeared_frames(&motion.clip, usize::from(!is_left_out));
    let done = if is_left_out { "That frame is left out" } else { "That frame is kept" };
    if smeared == 0 {
        return Some(Doubt::new("rest_frame", format!("It begins with a rest pose. {done}.")));
    }
    let next = if smeared == 1 {
        "the next frame still comes".into()
    } else {
        format!("the next {smeared} frames still come")
    };
    let text = format!("It begins with a rest pose. {done}; {next} out of it.");
    let body = Reading { skip: Some(smeared + 1), ..Reading::default() };
    Some(Doubt::new("rest_frame", text).fixed("Begin behind it", body))
}

fn of_up(motion: &Motion) -> Option<Doubt> {
    let warned = |kind: &str| motion.warnings.iter().any(|warning| warning.kind == kind);
    let up = |up| Reading { up: Some(up), ..Reading::default() };
    if warned("up_axis") {
        let axis = motion.source.axes().up;
        let text = format!("Its {axis} axis points up; it was turned so that it stands.");
        return Some(Doubt::new("up_axis", text).fixed("It stood right: don't turn it", up(Up::Y)));
    }
    if !warned("up_unsure") {
        return None;
    }
    let text = "It isn't clear which way is up: the body may lie on its side or its back.";
    let axis = motion.map().and_then(|map| standing_axis(motion, map));
    let doubt = Doubt::new("up_unsure", text);
    Some(match axis.filter(|axis| *axis != Up::Y) {
        Some(axis) => doubt.fixed(format!("Stand it up: {axis} is up"), up(axis)),
        None => doubt.fixed("It is right as it is", up(Up::Y)),
    })
}

fn of_mirror(motion: &Motion) -> Option<Doubt> {
    motion.warnings.iter().find(|warning| warning.kind == "mirrored")?;
    let text = "Its toes point backwards: the body is mirrored, or left and right are exchanged in its joints' names.";
    let body = Reading { mirror_axis: Some(MirrorAxis::X), ..Reading::default() };
    Some(Doubt::new("mirrored", text).fixed("Mirror it back", body))
}

fn of_floor(floor: &rig::Floor) -> Option<Doubt> {
    let why = match floor.doubts.first()?.kind {
        "floor_below" => "joints go deep below where its feet stand",
        "floor_slides" => "its feet never stand still",
        "floor_pelvis" => "its hips aren't where a standing body has them",
        "floor_far" => "its feet are hardly ever near the floor",
        _ => "it is very short",
    };
    let (taken, found) = (floor.height_m, floor.found_m);
    let text = format!("Where the floor is isn't sure: {why}. It is taken to be at {taken:.2} m.");
    // the button offers the other of two candidates: the height found in the motion, or 0
    let other = if taken == found { 0.0 } else { (found * 1000.0).round() / 1000.0 };
    let body = Reading { floor: Some(other), ..Reading::default() };
    let doubt = Doubt::new("floor_doubted", text);
    Some(if (other - taken).abs() < 0.005 {
        doubt
    } else {
        doubt.fixed(format!("Put the floor at {other:.2} m"), body)
    })
}

/// Doubts of the report that have no words of their own here.
fn others(report: &serde_json::Value) -> Vec<Doubt> {
    // those above have words for the studio; `rig_recognised` is no doubt to somebody who sees the figure
    let own = ["rate_doubted", "up_unsure", "up_axis", "rest_frame", "rig_recognised", "mirrored"];
    let all = report["doubts"].as_array().into_iter().flatten();
    let text = |doubt: &serde_json::Value, key: &str| doubt[key].as_str().unwrap_or_default().to_owned();
    let named = all.map(|doubt| (text(doubt, "kind"), text(doubt, "what")));
    let named = named.filter(|(kind, _)| !own.contains(&&**kind) && !kind.starts_with("floor_"));
    named.map(|(kind, what)| Doubt::new(&kind, plain(&what))).collect()
}

/// The two units in which the body is nearest to a person's height, as buttons.
fn units(file: &Path, reading: &Reading) -> Vec<Doubt> {
    let named = [("metres", Unit::METRE), ("centimetres", Unit::CENTIMETRE), ("millimetres", Unit::MILLIMETRE)];
    let named = named.into_iter().chain([("inches", Unit::INCH), ("units of the CMU database", Unit::CMU)]);
    let height = |unit: Unit| {
        let stated = Reading { unit: Some(unit), ..reading.clone() };
        let motion = format::read(file, &options(file, &stated).ok()?).ok()?;
        standing_height_m(motion.clip.skeleton()).filter(|height| *height > 0.0)
    };
    let mut all: Vec<(f64, &str, Unit)> = named.filter_map(|(name, unit)| Some((height(unit)?, name, unit))).collect();
    // as a ratio: 17 m is as far from a person as 17 cm
    let far = |height: f64| (height / 1.7).ln().abs();
    all.sort_by(|a, b| far(a.0).total_cmp(&far(b.0)));
    let of = |(height, name, unit): (f64, &str, Unit)| {
        let text = format!("In {name} the body would be {height:.2} m tall.");
        let body = Reading { unit: Some(unit), ..Reading::default() };
        Doubt::new("unit_unknown", text).fixed(format!("Read it in {name}"), body)
    };
    all.into_iter().take(2).map(of).collect()
}

fn short(fps: f64) -> f64 {
    (fps * 1e3).round() / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::{Clip, Vec3, synth};
    use std::path::PathBuf;

    fn saved(dir: &Path, name: &str, clip: Clip) -> PathBuf {
        let path = dir.join(name);
        let motion = Motion::new(&path, clip);
        format::write(&path, &motion).unwrap();
        path
    }

    fn dance() -> Clip {
        synth::corpus(3, 1, 4.0, 60.0).unwrap().remove(0).clip
    }

    fn read(path: &Path, reading: &Reading) -> Info {
        match outcome(path, reading, &path.with_extension("converted.bvh")) {
            Outcome::Ready(info) => *info,
            Outcome::Failed { text, .. } => panic!("{text}"),
        }
    }

    /// Presses the button of the doubt of this kind, and reads again.
    fn pressed(path: &Path, kind: &str) -> Info {
        let info = read(path, &Reading::default());
        let doubt = info.doubts.iter().find(|doubt| doubt.kind == kind).unwrap_or_else(|| panic!("{:?}", info.doubts));
        let again = read(path, &doubt.fix.clone().unwrap().body);
        assert!(again.doubts.iter().all(|doubt| doubt.kind != kind), "{:?}", again.doubts);
        again
    }

    #[test]
    fn a_good_file_has_no_doubts() {
        let dir = tempfile::tempdir().unwrap();
        let info = read(&saved(dir.path(), "a.bvh", dance()), &Reading::default());
        assert_eq!((info.frames, info.fps, info.rig.as_deref(), info.converted), (240, 60.0, Some("smpl"), false));
        assert_eq!(info.doubts, []);
    }

    #[test]
    fn other_formats_become_a_bvh() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["a.npz", "a.glb", "a.json"] {
            let path = saved(dir.path(), name, dance());
            let info = read(&path, &Reading::default());
            let again = read(&path.with_extension("converted.bvh"), &Reading::default());
            assert!(info.converted && again.frames == info.frames && again.fps == info.fps, "{name}");
        }
    }

    #[test]
    fn buttons_settle_rate_axis_floor_and_unit() {
        let dir = tempfile::tempdir().unwrap();
        let dance = dance();
        // falls in free fall at 60 frames a second, and says 240
        let root = (0..240).map(|f| Vec3::Y * (30.0 - 4.9 * (f as f64 / 60.0).powi(2))).collect();
        let falls = Clip::new(dance.skeleton().clone(), 240.0, root, dance.rotations().to_vec()).unwrap();
        assert_eq!(pressed(&saved(dir.path(), "rate.bvh", falls), "rate_doubted").fps, 60.0);
        // stands 40 cm up, and skates
        let root = dance.root().iter().enumerate().map(|(f, p)| *p + Vec3::new(0.03 * f as f64, 2.0, 0.0)).collect();
        let skates = Clip::new(dance.skeleton().clone(), 60.0, root, dance.rotations().to_vec()).unwrap();
        let floor = pressed(&saved(dir.path(), "floor.bvh", skates), "floor_doubted");
        assert_eq!(floor.floor_m, 0.0);
        // its legs are of no unit
        let path = saved(dir.path(), "unit.bvh", dance.clone());
        let offsets = dance.skeleton().offsets().iter().map(|o| *o * 0.003).collect();
        let (names, parents) = (dance.skeleton().names().to_vec(), dance.skeleton().parents().to_vec());
        let tiny = kinelm_motion::Skeleton::new(names, parents, offsets, vec![]).unwrap();
        let tiny = Clip::new(tiny.into(), 60.0, dance.root().to_vec(), dance.rotations().to_vec()).unwrap();
        let motion = Motion::new(&path, tiny);
        std::fs::write(&path, format::bvh::to_bytes_in(&motion, 0.001).unwrap()).unwrap();
        let Outcome::Failed { text, doubts } = outcome(&path, &Reading::default(), &path) else { panic!() };
        assert!(text.contains("unit") && doubts.len() == 2, "{text} {doubts:?}");
        let fixed = read(&path, &doubts[0].fix.clone().unwrap().body);
        assert_eq!(fixed.frames, 240);
    }

    #[test]
    fn a_clip_begins_behind_a_rest_pose_that_was_smeared() {
        let dir = tempfile::tempdir().unwrap();
        let dance = dance();
        let mut rotations = dance.rotations().to_vec();
        let (smeared, danced) = rotations.split_at_mut(4 * dance.joints());
        for (k, pose) in smeared.chunks_mut(dance.joints()).enumerate() {
            for (q, to) in pose.iter_mut().zip(danced.iter()) {
                *q = kinelm_motion::Quat::IDENTITY.slerp(*to, k as f64 / 4.0);
            }
        }
        let clip = Clip::new(dance.skeleton().clone(), 60.0, dance.root().to_vec(), rotations).unwrap();
        let path = saved(dir.path(), "rest.bvh", clip);
        let info = read(&path, &Reading::default());
        let text = &info.doubts[0].text;
        assert!(info.frames == 239 && text.ends_with("left out; the next 3 frames still come out of it."), "{info:?}");
        assert_eq!(pressed(&path, "rest_frame").frames, 236);
    }

    #[test]
    fn a_body_that_lies_is_stood_up() {
        let dir = tempfile::tempdir().unwrap();
        let dance = dance();
        // lies on its back, as if z were up
        let turn = kinelm_motion::Quat::from_rotation_x(std::f64::consts::FRAC_PI_2);
        let root = dance.root().iter().map(|p| turn * *p).collect();
        let mut rotations = dance.rotations().to_vec();
        rotations.iter_mut().step_by(dance.joints()).for_each(|q| *q = turn * *q);
        let lies = Clip::new(dance.skeleton().clone(), 60.0, root, rotations).unwrap();
        // the feet tell which way is up, but the format has y up
        let info = pressed(&saved(dir.path(), "lies.json", lies.clone()), "up_unsure");
        assert!(info.floor_m.abs() < 0.05, "{info:?}");
        let info = read(&saved(dir.path(), "lies.bvh", lies), &Reading::default());
        assert!(info.floor_m.abs() < 0.05 && info.doubts.iter().any(|doubt| doubt.kind == "up_axis"), "{info:?}");
    }

    #[test]
    fn what_is_no_motion_fails_with_words() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bvh");
        std::fs::write(&path, "<html>").unwrap();
        let Outcome::Failed { text, doubts } = outcome(&path, &Reading::default(), &path) else { panic!() };
        assert!(text.contains("a.bvh") && text.contains("HTML") && doubts.is_empty(), "{text}");
    }
}
