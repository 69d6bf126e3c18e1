//! Motion files that are made of clips and dances: a dance in the file of its character, a clip mirrored or retimed.

use super::Library;
use super::doubts;
use crate::{Error, Result};
use kinelm_motion::convert::{TargetRig, on_rig};
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::mirror::Mirror;
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::{Motion, Source};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// How much slower or faster a clip may be made.
pub const SPEEDS: std::ops::RangeInclusive<f64> = 0.5..=2.0;
/// Dances of dances of a character, at most.
const MOST_DANCES: usize = 1000;

/// A change of a clip, as a page requests it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Change {
    /// Whether left and right are exchanged.
    pub mirror: bool,
    /// The speed, of the clip's own.
    pub speed: Option<f64>,
}

impl Change {
    /// Refuses a speed that is out of range, and a change of nothing.
    ///
    /// # Errors
    /// What is expected.
    pub fn check(self) -> Result<()> {
        let expected = || format!("{} to {}", SPEEDS.start(), SPEEDS.end());
        match self.speed.filter(|speed| !SPEEDS.contains(speed)) {
            Some(speed) => Err(Error::invalid_parameter("speed", speed, expected())),
            None if self == Change::default() => Err(Error::missing("a change", "mirror, or a speed")),
            None => Ok(()),
        }
    }

    /// What a clip is called after it.
    pub fn name(self, of: &str) -> String {
        let mirrored = if self.mirror { " mirrored" } else { "" };
        let retimed = self.speed.map_or_else(String::new, |speed| format!(" at {speed} times"));
        format!("{of}{mirrored}{retimed}")
    }

    fn of(self, mut motion: Motion) -> Result<Motion> {
        if self.mirror {
            let clip = Mirror::new(motion.humanoid()?)?.apply(&motion.clip)?;
            motion = motion.with_clip(clip);
        }
        if let Some(speed) = self.speed {
            let fps = motion.clip.fps();
            let clip = resample(&motion.clip.clone().with_fps(fps * speed)?, fps, Method::Auto)?;
            motion = motion.with_clip(clip);
        }
        Ok(motion)
    }
}

/// A request for a file, as the process that reads the others gets it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Wanted {
    /// The name of the file: its extension is the format, its stem what an animation is called.
    pub name: String,
    /// How the motion is read.
    pub read: ReadOptions,
    /// The height of its floor, metres.
    pub floor_m: f64,
    /// What is changed of it.
    pub change: Change,
    /// The file of the character on which it is put, and how that is read.
    pub onto: Option<(PathBuf, ReadOptions)>,
}

/// A file that was made.
#[derive(Debug, Clone, PartialEq)]
pub struct Derived {
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// The matrix (4 x 4, column by column) from a character's own world to the stage's, where the floor is at 0; that of no
    /// change for a file without a character.
    pub to_stage: [f64; 16],
}

impl Wanted {
    /// Reads a motion and makes the file.
    ///
    /// # Errors
    /// Those of reading, mirroring and writing; an animation of the name that the character's file has.
    pub fn made(&self, file: &Path) -> Result<Derived> {
        let mut motion = self.change.of(format::read(file, &self.read)?)?;
        if let Some((character, read)) = &self.onto {
            motion = on_rig(motion, &TargetRig::OfFile(Box::new(format::read(character, read)?)))?;
        }
        let mut to_stage = std::array::from_fn(|i| if i % 5 == 0 { 1.0 } else { 0.0 });
        let name = Path::new(&self.name);
        match &motion.source {
            Source::Glb(glb) => to_stage = glb.world(),
            // from the clip alone: what the file says of units and rates is settled in it
            _ => motion = Motion::new(name, motion.clip),
        }
        to_stage[13] -= self.floor_m;
        Ok(Derived { bytes: format::to_bytes(name, &motion)?, to_stage })
    }
}

impl Library {
    /// The clip whose character a clip or dance is on; `None` if the file of its rig has no mesh.
    pub fn character_of(&self, id: &str) -> Option<String> {
        let mut id = id.to_owned();
        // a dance is on the rig of what it was made from, which may be a dance
        for _ in 0..MOST_DANCES {
            match self.project().dance(&id) {
                Ok(dance) => id = dance.rig.or(dance.source)?,
                Err(_) => break,
            }
        }
        self.info(&id).ok()?.character.then_some(id)
    }

    /// A clip or dance as a file of this name, on its character: a GLB is the character's file with an animation called so.
    ///
    /// # Errors
    /// No character; those of [`Wanted::made`].
    pub fn on_character(&self, id: &str, name: &str) -> Result<Derived> {
        let none = || Error::Conflict("its rig has no mesh: it came from a file with bones alone".into());
        let character = self.character_of(id).ok_or_else(none)?;
        let source = self.source(id)?;
        let (path, read) = self.original(&character)?;
        let (file, read, onto) = match character == id {
            true => (path, read, None),
            false => (source.path, source.read, Some((path, read))),
        };
        let (name, change) = (name.to_owned(), Change::default());
        self.derived(&file, Wanted { name, read, floor_m: source.floor_m, change, onto })
    }

    /// A changed clip, as a file of this name without an extension: in the file of its character if it has one, else a BVH.
    /// Returns the extension too.
    ///
    /// # Errors
    /// A dance; those of [`Wanted::made`].
    pub fn changed(&self, id: &str, change: Change, stem: &str) -> Result<(Derived, &'static str)> {
        change.check()?;
        let info = self.info(id)?;
        if info.music {
            return Err(Error::invalid_parameter("clip", id, "a clip with a body; this is music"));
        }
        if info.frames < 2 {
            return Err(Error::Conflict("the clip is a single pose: it has no motion to change".into()));
        }
        let (path, read) = self.original(id)?;
        let extension = if info.character { "glb" } else { "bvh" };
        let name = format!("{stem}.{extension}");
        let derived = self.derived(&path, Wanted { name, read, floor_m: info.floor_m, change, onto: None })?;
        Ok((derived, extension))
    }

    /// The file of a clip as it came, and how it is read.
    fn original(&self, id: &str) -> Result<(PathBuf, ReadOptions)> {
        let record = self.project().clip(id)?;
        let path = self.project().path(&record.file);
        let read = doubts::options(&path, &self.resolved(self.reading(&record))?)?;
        Ok((path, read))
    }

    fn derived(&self, file: &Path, wanted: Wanted) -> Result<Derived> {
        self.reader.derived(file, wanted, &self.answer_file("derived")?, &self.stop)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;
    use kinelm_motion::Clip;

    #[test]
    fn a_clip_is_mirrored_and_retimed() {
        let dir = tempfile::tempdir().unwrap();
        let (_project, library) = fixture::library(dir.path(), &[("a.bvh", fixture::dance(1, 2.0, 30.0))]);
        let read = |change| {
            let (derived, extension) = library.changed("c1", change, "b").unwrap();
            let path = dir.path().join(format!("b.{extension}"));
            std::fs::write(&path, derived.bytes).unwrap();
            format::read(&path, &ReadOptions::default()).unwrap().clip
        };
        let own = format::read(&dir.path().join("clips/a.bvh"), &ReadOptions::default()).unwrap().clip;
        let fast = read(Change { mirror: false, speed: Some(2.0) });
        assert_eq!((fast.frames(), fast.fps()), (own.frames().div_ceil(2), own.fps()));
        let mirrored = read(Change { mirror: true, speed: None });
        let apart = |a: &Clip, f: usize, x: f64| (a.root()[f].x - x * own.root()[f].x).abs();
        assert!(mirrored.frames() == own.frames() && (0..own.frames()).all(|f| apart(&mirrored, f, -1.0) < 1e-4));
        for (change, expected) in [
            (Change { mirror: false, speed: Some(2.1) }, "0.5 to 2"),
            (Change { mirror: false, speed: Some(f64::NAN) }, "0.5 to 2"),
            (Change::default(), "mirror, or a speed"),
        ] {
            let said = library.changed("c1", change, "b").unwrap_err().to_string();
            assert!(said.contains(expected), "{said}");
        }
        assert!(library.character_of("c1").is_none());
        let said = library.on_character("c1", "x.glb").unwrap_err();
        assert!(said.status() == 409 && said.to_string().contains("bones alone"), "{said}");
    }

    #[test]
    fn a_dance_goes_into_the_file_of_its_character() {
        let dir = tempfile::tempdir().unwrap();
        let hero = fixture::dance(1, 1.0, 30.0);
        let (_project, library) = fixture::library(dir.path(), &[("hero.glb", hero.clone())]);
        assert_eq!(library.character_of("c1").as_deref(), Some("c1"));
        let file = dir.path().join("clips/hero.glb");
        let own = std::fs::read(&file).unwrap();
        let dance = fixture::dance(2, 2.0, 20.0);
        // what a dance is kept as: a BVH of the rig
        let bvh = dir.path().join("d.bvh");
        fixture::save(&bvh, &dance);
        let wanted = Wanted {
            name: "salsa.glb".into(),
            read: ReadOptions::default(),
            floor_m: 0.1,
            change: Change::default(),
            onto: Some((file, ReadOptions::default())),
        };
        let made = wanted.made(&bvh).unwrap();
        let expected = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.1, 0.0, 1.0];
        assert_eq!(made.to_stage, expected);
        // its vertices are there, and both animations
        let vertices = |bytes: &[u8]| bytes.windows(8).filter(|w| w == b"POSITION").count();
        assert!(vertices(&own) > 0 && vertices(&made.bytes) == vertices(&own));
        let taken = |bytes: &[u8], take: &str| {
            let read = ReadOptions { take: Some(take.into()), ..ReadOptions::default() };
            format::parse(Path::new("a.glb"), bytes, &read).unwrap().clip
        };
        let (back, before) = (taken(&made.bytes, "salsa"), taken(&made.bytes, "dance"));
        assert_eq!((back.frames(), back.fps(), before.frames()), (dance.frames(), 20.0, hero.frames()));
        let far = (0..back.frames()).map(|f| back.root()[f].distance(dance.root()[f])).fold(0.0, f64::max);
        assert!(far < 1e-4, "{far} m");
        // as the stage shows the clip itself, and changed
        let shown = library.on_character("c1", "on the stage.glb").unwrap();
        assert_eq!(taken(&shown.bytes, "on the stage").frames(), hero.frames());
        let (slow, extension) = library.changed("c1", Change { mirror: true, speed: Some(0.5) }, "slow").unwrap();
        assert_eq!((extension, taken(&slow.bytes, "slow").frames()), ("glb", 2 * hero.frames() - 1));
    }
}
