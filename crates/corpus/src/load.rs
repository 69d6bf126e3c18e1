//! One file to a clip that a tokenizer takes.

use super::gather::Item;
use super::sidecar;
use super::timed::{behind_its_end, piece_of};
use crate::{Error, Result};
use kinelm_motion::format::{self, RateDoubt, ReadOptions, resolve_floor};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::{Clip, Motion, Warning, retarget};
use kinelm_store::FileRecord;
use kinelm_tokenizer::TokenizerConfig;
use std::path::Path;

/// What a tokenizer takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// Frames per second.
    pub fps: f64,
    /// The floor at y = 0.
    pub above_floor: bool,
}

impl Wanted {
    /// Clips as they stand in the world.
    pub fn in_world(fps: f64) -> Wanted {
        Wanted { fps, above_floor: false }
    }
}

impl From<&TokenizerConfig> for Wanted {
    fn from(config: &TokenizerConfig) -> Wanted {
        Wanted { fps: config.fps, above_floor: config.above_floor() }
    }
}

/// A clip on the 24 SMPL joints as it is wanted.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// What moves.
    pub clip: Clip,
    /// Where the file's floor is, metres, if it was taken off.
    pub floor_m: Option<f64>,
    /// SHA-256 of the file.
    pub sha256: String,
    /// What was odd in it.
    pub warnings: Vec<Warning>,
    /// The doubt of its rate.
    pub doubt: Option<RateDoubt>,
}

/// A file as a tokenizer takes it, and where it was.
#[derive(Debug, Clone)]
pub struct Placed {
    /// As it was read, with doubts of the floor.
    pub motion: Motion,
    /// On the neutral SMPL-24 body at the rate wanted, in the world.
    pub clip: Clip,
    /// Where the file's floor is, metres, if it is to be taken off.
    pub floor_m: Option<f64>,
    /// Where that floor is under `clip`, metres; 0 if it isn't to be taken off.
    pub under_m: f64,
    /// SHA-256 of the file.
    pub sha256: String,
}

impl Placed {
    /// The clip with its floor at y = 0, where that is wanted.
    pub fn lowered(&self) -> Clip {
        self.clip.clone().raised(-self.under_m)
    }
}

/// Reads a file as a tokenizer takes it.
///
/// # Errors
/// As [`load_clip`].
pub fn load_placed(path: &Path, options: &ReadOptions, wanted: Wanted) -> Result<Placed> {
    // refused by its name before it is read
    format::Format::of(path)?;
    let bytes = kinelm_store::input::bytes(path).map_err(Error::io(path))?;
    parse_placed(path, &bytes, options, wanted)
}

/// [`load_placed`] of a file's bytes.
///
/// # Errors
/// Those of [`load_clip`], but for the system's.
pub fn parse_placed(path: &Path, bytes: &[u8], options: &ReadOptions, wanted: Wanted) -> Result<Placed> {
    let (mut motion, clip) = parse_clip(path, bytes, options, wanted.fps)?;
    let sha256 = FileRecord::of(bytes).sha256;
    let (mut floor_m, mut under_m) = (None, 0.0);
    if let Some(first) = clip.root().first().filter(|_| wanted.above_floor) {
        let floor = resolve_floor(&mut motion, options)?;
        // however retargeting treats the ground: the floor is taken off on the file's own rig
        let lowered = Motion { clip: motion.clip.clone().raised(-floor), ..motion.clone() };
        let lowered = resample(&retarget::to_smpl(&lowered, options.map.as_deref())?, wanted.fps, Method::Auto)?;
        (floor_m, under_m) = (Some(floor), first.y - lowered.root()[0].y);
    }
    Ok(Placed { motion, clip, floor_m, under_m, sha256 })
}

/// Reads an item's file as a tokenizer takes it. The rate, the frames to skip and the floor that the item's labels state
/// overrule those of `options`. Of an item that is a piece of a file nothing may be left.
///
/// # Errors
/// What reading and retargeting fail with, the file named; [`kinelm_store::Error::File`] for a clip without frames, or without those that
/// labels tell of.
pub fn load_item(item: &Item, options: &ReadOptions, wanted: Wanted) -> Result<Loaded> {
    let whole = load_whole(item, options, wanted)?;
    if item.piece.is_some() {
        return whole.piece(item);
    }
    if whole.clip.frames() == 0 {
        return Err(Error::file(&item.path, "no frames", "at least one", ""));
    }
    Ok(whole)
}

/// Reads all of an item's file, whatever piece of it the item is.
///
/// # Errors
/// As [`load_item`], but for the piece's.
pub fn load_whole(item: &Item, options: &ReadOptions, wanted: Wanted) -> Result<Loaded> {
    let placed = load_placed(&item.path, &item_options(item, options), wanted)?;
    let (clip, doubt) = (placed.lowered(), RateDoubt::in_reading(&placed.motion));
    Ok(Loaded { clip, floor_m: placed.floor_m, sha256: placed.sha256, warnings: placed.motion.warnings, doubt })
}

impl Loaded {
    /// What of a whole file an item is.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] for a clip without the frames that labels tell of.
    pub fn piece(&self, item: &Item) -> Result<Loaded> {
        let mut warnings = self.warnings.clone();
        warnings.extend(behind_its_end(item, &self.clip));
        Ok(Loaded { clip: piece_of(item, &self.clip)?, warnings, sha256: self.sha256.clone(), ..*self })
    }
}

/// A file on the neutral SMPL-24 body at `fps` frames per second, and the motion as it was read.
///
/// # Errors
/// What reading and retargeting fail with, the file named.
pub fn load_clip(path: &Path, options: &ReadOptions, fps: f64) -> Result<(Motion, Clip)> {
    at_rate(format::read(path, options)?, options, fps)
}

/// [`load_clip`] of a file's bytes.
///
/// # Errors
/// Those of [`load_clip`], but for the system's.
pub fn parse_clip(path: &Path, bytes: &[u8], options: &ReadOptions, fps: f64) -> Result<(Motion, Clip)> {
    at_rate(format::parse(path, bytes, options)?, options, fps)
}

fn at_rate(motion: Motion, options: &ReadOptions, fps: f64) -> Result<(Motion, Clip)> {
    let clip = retarget::to_smpl(&motion, options.map.as_deref())?;
    let clip = resample(&clip, fps, Method::Auto)?;
    Ok((motion, clip))
}

/// The reading options with what the item's sidecar and labels state, of which labels are the nearer.
pub fn item_options(item: &Item, options: &ReadOptions) -> ReadOptions {
    let options = match &item.told {
        Some(told) => sidecar::among_others(told.clone(), options),
        None => options.clone(),
    };
    ReadOptions {
        fps_source: item.fps.or(options.fps_source),
        skip: item.skip.unwrap_or(options.skip),
        floor: item.floor.or(options.floor),
        ..options
    }
}

/// A file of a dataset on SMPL-24 at its own rate, lowered onto its floor where `wanted` codes heights above it, with the doubt
/// of its rate.
///
/// # Errors
/// What reading and retargeting fail with.
pub fn load_at_own_rate(item: &Item, options: &ReadOptions, wanted: Wanted) -> Result<(Clip, Option<RateDoubt>)> {
    let options = item_options(item, options);
    let mut motion = format::read(&item.path, &options)?;
    let doubt = RateDoubt::in_reading(&motion);
    if wanted.above_floor {
        let floor = resolve_floor(&mut motion, &options)?;
        motion.clip = motion.clip.raised(-floor);
    }
    Ok((retarget::to_smpl(&motion, options.map.as_deref())?, doubt))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_overrule_the_options() {
        let options = ReadOptions { fps_source: Some(30.0), skip: 3, lenient: true, ..ReadOptions::default() };
        let read = item_options(&Item::default(), &options);
        assert_eq!(read, options);
        let read = item_options(&Item { fps: Some(60.0), skip: Some(0), ..Item::default() }, &options);
        assert_eq!((read.fps_source, read.skip, read.lenient), (Some(60.0), 0, true));
    }

    #[test]
    fn a_salsa_is_read_at_its_true_rate() {
        let Some(dir) = kinelm_shared_data::set("cmu-dance", "corpus::load") else { return };
        let item = Item { path: dir.join("salsa/01.bvh"), fps: Some(60.0), ..Item::default() };
        let options = ReadOptions { skip: 10, ..ReadOptions::default() };
        let loaded = load_item(&item, &options, Wanted::in_world(20.0)).unwrap();
        let source = format::read(&item.path, &ReadOptions::default()).unwrap().clip.frames();
        assert_eq!(loaded.clip.frames(), (source - 10 - 1) / 3 + 1);
        assert_eq!((loaded.clip.joints(), loaded.clip.fps(), loaded.sha256.len()), (24, 20.0, 64));
    }

    #[test]
    fn the_floor_is_taken_off_once() {
        use kinelm_motion::rig::{Feet, SkeletonMap};
        use kinelm_motion::{Source, smpl, synth};
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("high.bvh");
        let dance = synth::corpus(3, 1, 4.0, 60.0).unwrap().remove(0).clip.raised(0.4);
        let motion = Motion { path: path.clone(), clip: dance, source: Source::Plain, warnings: vec![] };
        format::write(&path, &motion).unwrap();
        let (options, wanted) = (ReadOptions::default(), Wanted { fps: 20.0, above_floor: true });
        let placed = load_placed(&path, &options, wanted).unwrap();
        let floor = placed.floor_m.unwrap();
        assert!((floor - 0.4).abs() < 0.03 && (placed.under_m - floor).abs() < 1e-9, "{floor} {}", placed.under_m);
        let feet = Feet::new(&smpl::neutral(), &SkeletonMap::builtin("smpl").unwrap());
        assert!(feet.unwrap().floor(&placed.lowered()).found_m.abs() < 0.03);
        let told = load_placed(&path, &ReadOptions { floor: Some(0.1), ..options.clone() }, wanted).unwrap();
        assert_eq!(told.floor_m, Some(0.1));
        assert!((told.lowered().root()[7].y - placed.lowered().root()[7].y - (floor - 0.1)).abs() < 1e-9);
        let world = load_placed(&path, &options, Wanted::in_world(20.0)).unwrap();
        assert_eq!((world.floor_m, world.lowered() == world.clip, world.clip == placed.clip), (None, true, true));
        let item = Item { path, floor: Some(0.25), ..Item::default() };
        assert_eq!(load_item(&item, &options, wanted).unwrap().floor_m, Some(0.25));
    }
}
