//! The reading options that follow the name of one file of several: `FILE:fps=60,skip=10`.

use super::read::ReadArgs;
use super::values::positive;
use super::{Odd, Say, WrongCall};
use anyhow::Result;
use clap::ValueEnum;
use kinelm_motion::Motion;
use kinelm_motion::format::{self, BvhPosition, MirrorAxis, ReadOptions, RestFrame, Unit, Up};
use std::path::{Path, PathBuf};

/// A file or a folder of the call, and the `key=value` pairs after its name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// Without the pairs.
    pub path: PathBuf,
    /// How it is read, or all that is in it.
    own: Vec<(String, String)>,
}

impl Named {
    /// The same options for another file: one in this folder.
    pub fn of(&self, path: PathBuf) -> Named {
        Named { path, own: self.own.clone() }
    }

    /// Sets the options that follow the name.
    ///
    /// # Errors
    /// A key that there is none of, a value that it doesn't take.
    pub fn set(&self, options: &mut ReadOptions) -> Result<()> {
        self.own.iter().try_for_each(|(key, value)| set(options, key, value))
    }
}

/// A file or a folder and its options, from the last `:` on, where what follows has a `=` and no file has the whole
/// name.
///
/// # Errors
/// Anything but pairs after the colon.
pub fn named(clip: &Path) -> Result<Named> {
    // a name that exists is taken as it is: it may have a colon itself
    let parts = clip.to_str().filter(|_| !clip.exists()).and_then(|text| text.rsplit_once(':'));
    let Some((path, list)) = parts.filter(|(_, list)| list.contains('=')) else {
        return Ok(Named { path: clip.into(), own: Vec::new() });
    };
    let pair = |part: &str| match part.split_once('=') {
        Some((key, value)) => Ok((key.trim().to_string(), value.trim().to_string())),
        None => Err(WrongCall(format!("{}: {part:?} after the colon; expected KEY=VALUE", clip.display())).into()),
    };
    Ok(Named { path: path.into(), own: list.split(',').map(pair).collect::<Result<_>>()? })
}

/// How each file is read: as the call's options say, then as its own do.
///
/// # Errors
/// Those of [`Named::set`].
pub fn options(files: &[Named], read: &ReadArgs, say: Say) -> Result<Vec<ReadOptions>> {
    let paths: Vec<&Path> = files.iter().map(|file| &*file.path).collect();
    let mut options = read.of_files(&paths, RestFrame::Drop, say);
    files.iter().zip(&mut options).try_for_each(|(file, options)| file.set(options))?;
    Ok(options)
}

/// Two motions; reports what is odd about them.
///
/// # Errors
/// Those of [`options`] and of reading.
pub fn pair(files: &[Named; 2], read: &ReadArgs, say: Say) -> Result<[Motion; 2]> {
    let options = options(files, read, say)?;
    let read = |i: usize| format::read(&files[i].path, &options[i]);
    let (motions, odd) = ([read(0)?, read(1)?], Odd::new(say));
    motions.iter().zip(&options).for_each(|(motion, options)| odd.warn(motion, options));
    Ok(motions)
}

/// Sets one option of a file.
fn set(options: &mut ReadOptions, key: &str, value: &str) -> Result<()> {
    let wrong = |expected: &str| WrongCall(format!("{key}={value}: expected {expected}"));
    match key {
        "fps" => options.fps_source = Some(positive(value).map_err(|_| wrong("a positive number"))?),
        "skip" => options.skip = value.parse().map_err(|_| wrong("a number of frames"))?,
        "unit" => options.unit = value.parse().map_err(|_| wrong(Unit::EXPECTED))?,
        "up" => options.up = Up::from_str(value, false).map_err(|_| wrong("auto, x, -x, y, -y, z or -z"))?,
        "map" => options.map = Some(value.into()),
        "root" => options.root = Some(value.into()),
        "take" => options.take = Some(value.into()),
        "rest" => {
            options.rest = match value {
                "keep" => RestFrame::Keep,
                "drop" => RestFrame::Drop,
                _ => return Err(wrong("keep or drop").into()),
            }
        }
        "position" => {
            options.bvh_position = BvhPosition::from_str(value, false).map_err(|_| wrong("replace or add"))?;
        }
        "mirror" => options.mirror_axis = Some(MirrorAxis::from_str(value, false).map_err(|_| wrong("x, y or z"))?),
        _ => return Err(wrong("one of fps, skip, up, unit, map, root, take, mirror, rest and position").into()),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_stand_behind_the_last_colon() {
        let of = |text: &str| named(Path::new(text)).map(|n| (n.path, n.own)).unwrap();
        let pair = |key: &str, value: &str| (key.to_string(), value.to_string());
        assert_eq!(of("a/b.bvh:fps=60, skip=10"), ("a/b.bvh".into(), vec![pair("fps", "60"), pair("skip", "10")]));
        for plain in ["a.bvh", "C:\\a.bvh", "a:b.bvh"] {
            assert_eq!(of(plain), (plain.into(), vec![]));
        }
        assert!(named(Path::new("a.bvh:fps=60,lenient")).unwrap_err().to_string().contains("KEY=VALUE"));
    }

    #[test]
    fn what_a_file_is_told_is_checked() {
        let mut options = ReadOptions::default();
        for (key, value) in [("fps", "60"), ("skip", "10"), ("unit", "cm"), ("rest", "drop"), ("mirror", "z")] {
            set(&mut options, key, value).unwrap();
        }
        assert_eq!((options.fps_source, options.skip, options.rest), (Some(60.0), 10, RestFrame::Drop));
        assert_eq!(options.mirror_axis, Some(MirrorAxis::Z));
        for (key, value) in [
            ("fps", "0"),
            ("fps", "x"),
            ("skip", "-1"),
            ("unit", "mile"),
            ("rest", "no"),
            ("mirror", "w"),
            ("what", "1"),
        ] {
            assert!(set(&mut options, key, value).unwrap_err().to_string().contains("expected"), "{key}={value}");
        }
    }
}
