//! One file to a clip that a tokenizer takes.

use super::gather::Item;
use super::record::{FileRecord, hex};
use crate::{Error, Result};
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::{Clip, Motion, Warning, retarget};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::path::Path;

/// A clip on the 24 SMPL joints at the rate wanted.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// What moves.
    pub clip: Clip,
    /// SHA-256 of the file.
    pub sha256: String,
    /// What was odd in it.
    pub warnings: Vec<Warning>,
}

/// Reads an item's file, brings it onto the neutral SMPL-24 body and to `fps` frames per second. The rate and the
/// frames to skip that the item's labels state overrule those of `options`.
///
/// # Errors
/// What reading and retargeting fail with, the file named; [`Error::File`] for a clip without frames.
pub fn load_item(item: &Item, options: &ReadOptions, fps: f64) -> Result<Loaded> {
    let (motion, clip, sha256) = load_hashed(&item.path, &item_options(item, options), fps)?;
    if clip.frames() == 0 {
        return Err(Error::file(&item.path, "no frames", "at least one", ""));
    }
    Ok(Loaded { clip, sha256, warnings: motion.warnings })
}

/// A file on the neutral SMPL-24 body at `fps` frames per second, and the motion as it was read.
///
/// # Errors
/// What reading and retargeting fail with, the file named.
pub fn load_clip(path: &Path, options: &ReadOptions, fps: f64) -> Result<(Motion, Clip)> {
    at_rate(format::read(path, options)?, options, fps)
}

/// [`load_clip`] with the SHA-256 of the very bytes that were read.
///
/// # Errors
/// Those of [`load_clip`].
pub fn load_hashed(path: &Path, options: &ReadOptions, fps: f64) -> Result<(Motion, Clip, String)> {
    // refused by its name before it is read
    format::Format::of(path)?;
    let bytes = kinelm_motion::format::input::bytes(path).map_err(Error::io(path))?;
    let (motion, clip) = parse_clip(path, &bytes, options, fps)?;
    Ok((motion, clip, FileRecord::of(&bytes).sha256))
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

/// The reading options with what the item's labels state.
pub fn item_options(item: &Item, options: &ReadOptions) -> ReadOptions {
    ReadOptions {
        fps_source: item.fps.or(options.fps_source),
        skip: item.skip.unwrap_or(options.skip),
        ..options.clone()
    }
}

/// SHA-256 of a file, hexadecimal.
///
/// # Errors
/// [`Error::Io`] when it can't be read.
pub fn hash_file(path: &Path) -> Result<String> {
    let mut hash = Sha256::new();
    kinelm_motion::format::input::check(path).map_err(Error::io(path))?;
    let mut file = File::open(path).map_err(Error::io(path))?;
    std::io::copy(&mut file, &mut hash).map_err(Error::io(path))?;
    Ok(hex(hash))
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
        let loaded = load_item(&item, &options, 20.0).unwrap();
        let source = format::read(&item.path, &ReadOptions::default()).unwrap().clip.frames();
        assert_eq!(loaded.clip.frames(), (source - 10 - 1) / 3 + 1);
        assert_eq!((loaded.clip.joints(), loaded.clip.fps(), loaded.sha256.len()), (24, 20.0, 64));
    }
}
