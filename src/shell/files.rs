//! Files of a call: several that are read, and what is written.

use super::{Say, WrongCall, chain};
use crate::view::plot;
use anyhow::Result;
use kinelm_motion::convert::{ConvertOptions, TargetRig, convert};
use kinelm_motion::{Motion, smpl};
use kinelm_store::output::Outputs;
use std::path::{Path, PathBuf};

/// The extension of a motion file to write; refuses, before any work, what no motion is written as.
pub fn writable(path: &Path) -> Result<String> {
    let extension = extension(path);
    if !["bvh", "npz", "json", "glb"].contains(&extension.as_str()) {
        let what = format!("{}: expected a name ending in .bvh, .npz, .json or .glb", path.display());
        return Err(WrongCall(what).into());
    }
    Ok(extension)
}

/// Does something with each file and its number; one that fails is told and doesn't keep the others from it, but a single
/// file's error is the call's.
pub fn each_file(
    files: &[PathBuf],
    failed_what: &str,
    say: Say,
    mut each: impl FnMut(usize, &Path) -> Result<()>,
) -> Result<()> {
    let mut failed = 0;
    for (i, file) in files.iter().enumerate() {
        if let Err(e) = each(i, file).map_err(|e| of_file(file, e)) {
            if files.len() == 1 {
                return Err(e);
            }
            failed += 1;
            say.error(chain(&e));
        }
    }
    anyhow::ensure!(failed == 0, "{failed} of {} {failed_what}", files.len());
    Ok(())
}

/// A motion on the rig that its format is written for: an .npz is on SMPL's.
pub fn written_as(out: &Path, motion: Motion, map: Option<&str>) -> Result<Motion> {
    if extension(out) != "npz" {
        return Ok(motion);
    }
    let wanted = ConvertOptions { rig: Some(TargetRig::Smpl(smpl::neutral())), ..ConvertOptions::default() };
    Ok(convert(motion, &wanted, map)?)
}

/// What came of each file that could be read, with its number; the others are named and left out. Where none could be, or the
/// only one couldn't, its error is the call's.
pub fn readable<T>(results: impl IntoIterator<Item = Result<T>>, say: Say) -> Result<Vec<(usize, T)>> {
    let (mut kept, mut errors) = (Vec::new(), Vec::new());
    for (i, result) in results.into_iter().enumerate() {
        match result {
            Ok(one) => kept.push((i, one)),
            Err(e) => errors.push(e),
        }
    }
    if kept.is_empty() && !errors.is_empty() {
        return Err(errors.remove(0));
    }
    errors.iter().for_each(|e| say.left_out(chain(e)));
    Ok(kept)
}

/// An error that names the file that it is about.
fn of_file(path: &Path, e: anyhow::Error) -> anyhow::Error {
    let path = path.display().to_string();
    match chain(&e).starts_with(&path) || e.is::<WrongCall>() {
        true => e,
        false => e.context(path),
    }
}

/// Refuses a page under another name than a page's, before any work.
pub fn page(path: &Path) -> Result<()> {
    if extension(path) != "html" {
        return Err(WrongCall(format!("{}: expected a name ending in .html for a page", path.display())).into());
    }
    Ok(())
}

/// Refuses a picture under another name than a picture's, and what must not be written over, before any work.
pub fn picture(path: &Path, outputs: &Outputs) -> Result<()> {
    plot::check(path).map_err(|e| WrongCall(e.to_string()))?;
    Ok(outputs.check([path])?)
}

/// Draws charts into a file; nothing where there is nothing to draw.
pub fn draw_charts(path: &Path, charts: &[plot::Chart], outputs: &Outputs) -> Result<()> {
    if let Some(bytes) = plot::to_bytes(path, charts)? {
        outputs.write(path, &bytes)?;
    }
    Ok(())
}

/// The extension of a path, lower case, empty if it has none.
pub fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}
