//! A motion file as a clip that a tokenizer takes: on the model's body, at the model's rate.

use super::item::Item;
use super::segments::{past_end_warning, segment_of};
use crate::{Error, Result};
use kinelm_motion::format::{self, FileRate, ReadOptions, floor_and_doubts};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::retarget::OntoNeutral;
use kinelm_motion::{Clip, Motion, Warning};
use kinelm_store::FileRecord;
use kinelm_tokenizer::TokenizerConfig;
use std::path::Path;
use std::sync::Arc;

/// The form of requested clips, always on the neutral SMPL-24 body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipSpec {
    /// Frames per second.
    pub fps: f64,
    /// Whether the clip's floor is moved to y = 0.
    pub above_floor: bool,
    /// Whether the clip at the file's own rate is kept beside it.
    pub keep_own: bool,
}

impl ClipSpec {
    /// Clips at their own height in the world.
    pub fn in_world(fps: f64) -> ClipSpec {
        ClipSpec { fps, above_floor: false, keep_own: false }
    }
}

impl From<&TokenizerConfig> for ClipSpec {
    fn from(config: &TokenizerConfig) -> ClipSpec {
        ClipSpec { fps: config.fps, above_floor: config.above_floor(), keep_own: false }
    }
}

/// A motion file on the model's body, beside the motion that was read.
#[derive(Debug, Clone)]
pub struct ModelClip {
    /// The motion as it was read, with the warnings about its floor.
    pub motion: Motion,
    /// The clip on the model's body at the requested rate, at its own height in the world.
    pub clip: Clip,
    /// The same at the rate of the file, where the spec keeps it.
    pub own: Option<Clip>,
    /// Height of the file's floor in metres, on the file's own rig; `None` if the floor stays.
    pub floor_m: Option<f64>,
    /// Height of that floor under `clip` in metres; 0 if the floor stays.
    pub clip_floor_m: f64,
    /// SHA-256 of the file.
    pub sha256: String,
}

impl ModelClip {
    /// Reads, retargets and resamples a file.
    ///
    /// # Errors
    /// The errors of reading and retargeting, which name the file.
    ///
    /// ```
    /// use kinelm_corpus::load::{ClipSpec, ModelClip};
    /// # let dir = tempfile::tempdir()?;
    /// # let path = dir.path().join("sway.json");
    /// # let dance = kinelm_motion::synth::corpus(1, 1, 4.0, 60.0)?.remove(0).clip;
    /// # let motion = kinelm_motion::Motion::new(&path, dance);
    /// # kinelm_motion::format::write(&path, &motion)?;
    /// let loaded = ModelClip::load(&path, &Default::default(), ClipSpec::in_world(20.0))?;
    /// assert_eq!((loaded.clip.fps(), loaded.clip.joints()), (20.0, 24));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn load(path: &Path, options: &ReadOptions, spec: ClipSpec) -> Result<ModelClip> {
        // refused by its name before it is read
        format::Format::of(path)?;
        let bytes = kinelm_store::input::bytes(path).map_err(Error::io(path))?;
        ModelClip::parse(path, &bytes, options, spec)
    }

    /// [`ModelClip::load`] of the bytes of the file `path`.
    ///
    /// # Errors
    /// Those of [`ModelClip::load`], but for the system's.
    pub fn parse(path: &Path, bytes: &[u8], options: &ReadOptions, spec: ClipSpec) -> Result<ModelClip> {
        let clip = ModelClip::of(format::parse(path, bytes, options)?, options, spec)?;
        Ok(ModelClip { sha256: FileRecord::of(bytes).sha256, ..clip })
    }

    /// [`ModelClip::load`] of a motion that was read with these options, or made; without the hash of a file.
    ///
    /// # Errors
    /// Those of retargeting and resampling.
    pub fn of(motion: Motion, options: &ReadOptions, spec: ClipSpec) -> Result<ModelClip> {
        let at_own = ModelClip::at_own_rate(motion, options, spec.above_floor)?;
        let own = spec.keep_own.then(|| at_own.clip.clone());
        let clip = at_rate(at_own.clip, spec.fps)?;
        Ok(ModelClip { own, clip, ..at_own })
    }

    /// [`ModelClip::of`] a motion at the rate that it has.
    ///
    /// # Errors
    /// Those of retargeting.
    pub fn at_own_rate(mut motion: Motion, options: &ReadOptions, above_floor: bool) -> Result<ModelClip> {
        let OnModel { clip, floor_m, clip_floor_m, doubts } = OnModel::of(&motion, options, above_floor)?;
        motion.warnings.extend(doubts);
        Ok(ModelClip { motion, clip, own: None, floor_m, clip_floor_m, sha256: String::new() })
    }

    /// The clip as the tokenizer takes it: with its floor at y = 0, if the spec says so.
    pub fn lowered(&self) -> Clip {
        self.clip.clone().raised(-self.clip_floor_m)
    }
}

/// A motion as a tokenizer takes it: [`ModelClip::of`] it, [lowered](ModelClip::lowered), without the rest.
///
/// # Errors
/// As [`ModelClip::of`].
pub fn model_clip(motion: &Motion, options: &ReadOptions, spec: ClipSpec) -> Result<Clip> {
    let OnModel { clip, clip_floor_m, .. } = OnModel::of(motion, options, spec.above_floor)?;
    Ok(at_rate(clip, spec.fps)?.raised(-clip_floor_m))
}

/// A motion's clip on the model's body at its own rate.
struct OnModel {
    clip: Clip,
    floor_m: Option<f64>,
    clip_floor_m: f64,
    doubts: Vec<Warning>,
}

impl OnModel {
    fn of(motion: &Motion, options: &ReadOptions, above_floor: bool) -> Result<OnModel> {
        let way = OntoNeutral::of(motion)?;
        let clip = way.clip(&motion.clip)?;
        let Some(first) = clip.root().first().filter(|_| above_floor) else {
            return Ok(OnModel { clip, floor_m: None, clip_floor_m: 0.0, doubts: Vec::new() });
        };
        let (floor, doubts) = floor_and_doubts(motion, options)?;
        // retargeting scales heights about its own floor: the difference gives this floor's height under the clip
        let lowered = way.when_lowered(floor).clip(&motion.clip.slice(0..1).raised(-floor))?;
        let clip_floor_m = first.y - lowered.root()[0].y;
        Ok(OnModel { clip, floor_m: Some(floor), clip_floor_m, doubts })
    }
}

/// A clip at another rate, without a copy at its own.
fn at_rate(clip: Clip, fps: f64) -> Result<Clip> {
    if clip.fps() == fps { Ok(clip) } else { Ok(resample(&clip, fps, Method::Auto)?) }
}

/// The clip of an item, whole or the item's segment, as the tokenizer takes it.
#[derive(Debug, Clone)]
pub struct ItemClip {
    /// The clip.
    pub clip: Clip,
    /// The whole file at its own rate, at its own height, where the spec keeps it.
    pub own: Option<Arc<Clip>>,
    /// Height of the file's floor in metres, if the floor was moved to y = 0.
    pub floor_m: Option<f64>,
    /// SHA-256 of the file.
    pub sha256: String,
    /// Oddities of the file.
    pub warnings: Vec<Warning>,
    /// The rate of the file, with its doubt.
    pub rate: FileRate,
}

impl ItemClip {
    /// Loads an item; [`Item::read_options`] says how its file is read. A segment may turn out to have no frames.
    ///
    /// # Errors
    /// The errors of [`ModelClip::load`]; [`kinelm_store::Error::File`] for a file without frames, or without those that
    /// labels name.
    pub fn load(item: &Item, options: &ReadOptions, spec: ClipSpec) -> Result<ItemClip> {
        let whole = ItemClip::load_file(item, options, spec)?;
        if item.segment.is_some() {
            return whole.segment(item);
        }
        if whole.clip.frames() == 0 {
            return Err(Error::file(&item.path, "no frames", "at least one", ""));
        }
        Ok(whole)
    }

    /// Loads the whole file of an item, whatever segment of it the item is.
    pub(super) fn load_file(item: &Item, options: &ReadOptions, spec: ClipSpec) -> Result<ItemClip> {
        let options = item.read_options(options);
        let loaded = ModelClip::parse(&item.path, &item.bytes()?, &options, spec)?;
        let (clip, rate) = (loaded.lowered(), FileRate::of(&loaded.motion, &options));
        let ModelClip { motion, own, floor_m, sha256, .. } = loaded;
        Ok(ItemClip { clip, own: own.map(Arc::new), floor_m, sha256, warnings: motion.warnings, rate })
    }

    /// The segment of this whole file that an item is.
    pub(super) fn segment(&self, item: &Item) -> Result<ItemClip> {
        let mut warnings = self.warnings.clone();
        warnings.extend(past_end_warning(item, &self.clip));
        let (own, sha256, rate) = (self.own.clone(), self.sha256.clone(), self.rate.clone());
        Ok(ItemClip { clip: segment_of(item, &self.clip)?, own, warnings, sha256, rate, ..*self })
    }
}

/// The clip of a dataset's file on the model's body at the file's own rate, lowered onto its floor if that is to be at y = 0,
/// with the doubt of its rate.
///
/// # Errors
/// The errors of reading and retargeting.
pub fn load_at_own_rate(item: &Item, options: &ReadOptions, above_floor: bool) -> Result<(Clip, FileRate)> {
    let options = item.read_options(options);
    let motion = format::parse(&item.path, &item.bytes()?, &options)?;
    let rate = FileRate::of(&motion, &options);
    Ok((ModelClip::at_own_rate(motion, &options, above_floor)?.lowered(), rate))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_overrule_the_options() {
        let options = ReadOptions { fps_source: Some(30.0), skip: 3, lenient: true, ..ReadOptions::default() };
        let read = Item::default().read_options(&options);
        assert_eq!(read, options);
        let read = Item { fps: Some(60.0), skip: Some(0), ..Item::default() }.read_options(&options);
        assert_eq!((read.fps_source, read.skip, read.lenient), (Some(60.0), 0, true));
    }

    #[test]
    fn a_salsa_is_read_at_its_true_rate() {
        let Some(dir) = kinelm_shared_data::set("cmu-dance", "corpus::load") else { return };
        let item = Item { path: dir.join("salsa/01.bvh"), fps: Some(60.0), ..Item::default() };
        let options = ReadOptions { skip: 10, ..ReadOptions::default() };
        let loaded = ItemClip::load(&item, &options, ClipSpec::in_world(20.0)).unwrap();
        let source = format::read(&item.path, &ReadOptions::default()).unwrap().clip.frames();
        assert_eq!(loaded.clip.frames(), (source - 10 - 1) / 3 + 1);
        assert_eq!((loaded.clip.joints(), loaded.clip.fps(), loaded.sha256.len()), (24, 20.0, 64));
    }

    #[test]
    fn the_floor_is_taken_off_once() {
        use kinelm_motion::rig::{Humanoid, SkeletonMap};
        use kinelm_motion::{smpl, synth};
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("high.bvh");
        let dance = synth::corpus(3, 1, 4.0, 60.0).unwrap().remove(0).clip.raised(0.4);
        let motion = Motion::new(&path, dance);
        format::write(&path, &motion).unwrap();
        let (options, wanted) = (ReadOptions::default(), ClipSpec { fps: 20.0, above_floor: true, keep_own: false });
        let loaded = ModelClip::load(&path, &options, wanted).unwrap();
        let floor = loaded.floor_m.unwrap();
        assert!(
            (floor - 0.4).abs() < 0.03 && (loaded.clip_floor_m - floor).abs() < 1e-9,
            "{floor} {}",
            loaded.clip_floor_m
        );
        let feet = Humanoid::with_map(&smpl::neutral(), &SkeletonMap::builtin("smpl").unwrap()).feet();
        assert!(feet.unwrap().floor(&loaded.lowered()).found_m.abs() < 0.03);
        let stated = ModelClip::load(&path, &ReadOptions { floor: Some(0.1), ..options.clone() }, wanted).unwrap();
        assert_eq!(stated.floor_m, Some(0.1));
        assert!((stated.lowered().root()[7].y - loaded.lowered().root()[7].y - (floor - 0.1)).abs() < 1e-9);
        let world = ModelClip::load(&path, &options, ClipSpec::in_world(20.0)).unwrap();
        assert_eq!((world.floor_m, world.lowered() == world.clip, world.clip == loaded.clip), (None, true, true));
        let item = Item { path, floor: Some(0.25), ..Item::default() };
        assert_eq!(ItemClip::load(&item, &options, wanted).unwrap().floor_m, Some(0.25));
    }
}
