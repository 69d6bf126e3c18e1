//! Files of a call: inputs, of which some may fail, and outputs.

use super::{Say, WrongCall, chain, print};
use crate::view::plot;
use anyhow::Result;
use kinelm_motion::convert::{ConvertOptions, TargetRig, convert};
use kinelm_motion::format::Format;
use kinelm_motion::{Motion, smpl};
use kinelm_store::output::Outputs;
use std::path::{Path, PathBuf};

/// A text of help with the extensions that are read in the place of `READ`.
pub fn with_extensions(text: &str) -> String {
    text.replace("READ", &Format::read_list())
}

/// The extension of a motion file to write; refuses, before any work, other kinds of files.
pub fn writable(path: &Path) -> Result<String> {
    let extension = extension(path);
    if !Format::WRITTEN.contains(&extension.as_str()) {
        let why = match extension.as_str() {
            "vrm" => {
                "; players of VRM ignore an animation inside a .vrm: a .vrma animates it, and --embed of generate and \
                      convert puts one inside all the same"
            }
            _ => "",
        };
        let what = format!("{}: expected a name ending in .bvh, .npz, .json, .glb or .vrma{why}", path.display());
        return Err(WrongCall(what).into());
    }
    Ok(extension)
}

/// As [`writable`]; `embedded`: a VRM with an animation inside.
pub fn writable_into(path: &Path, embedded: bool) -> Result<String> {
    match (embedded, extension(path).as_str()) {
        (false, _) => writable(path),
        (true, "vrm") => Ok("vrm".into()),
        (true, _) => {
            let what =
                format!("--embed with {}: it puts a dance into a .vrm; write one, or leave it out", path.display());
            Err(WrongCall(what).into())
        }
    }
}

/// The result of a report on `file`; with `json` an error is printed as an object too, so that every file has a line.
pub fn reported<T>(found: Result<T>, file: &Path, json: bool) -> Result<T> {
    if let Err(e) = &found
        && json
    {
        let line = serde_json::json!({"schema": 1, "file": file, "error": chain(e)});
        print(&format!("{line}\n"))?;
    }
    found
}

/// Works on each file, which `each` gets with its number. Of several files one that fails is reported and left out, which makes
/// the call fail in the end ([`Say::left_out`]); the others' results are returned with their numbers.
///
/// # Errors
/// The error of a single file; an error if none of several could be used.
pub fn each_file<P: AsRef<Path>, T>(
    files: &[P],
    say: Say,
    mut each: impl FnMut(usize, &Path) -> Result<T>,
) -> Result<Vec<(usize, T)>> {
    let mut done = Vec::with_capacity(files.len());
    for (i, file) in files.iter().map(AsRef::as_ref).enumerate() {
        match each(i, file).map_err(|e| of_file(file, e)) {
            Ok(one) => done.push((i, one)),
            // one file: its error decides the exit code, and "left out" would be odd
            Err(e) if files.len() == 1 => return Err(e),
            Err(e) => say.left_out(chain(&e)),
        }
    }
    anyhow::ensure!(files.is_empty() || !done.is_empty(), "none of the {} files could be used", files.len());
    Ok(done)
}

/// The motion files among these and in folders among them, at any depth.
///
/// # Errors
/// A folder without motion files.
pub fn motion_files(given: &[PathBuf]) -> Result<Vec<PathBuf>> {
    Ok(crate::corpus::in_out::files(given)?.into_iter().map(|(path, _)| path).collect())
}

/// A motion on the rig that its format is written for: an .npz is on SMPL's.
pub fn written_as(out: &Path, motion: Motion) -> Result<Motion> {
    if extension(out) != "npz" {
        return Ok(motion);
    }
    let options = ConvertOptions { rig: Some(TargetRig::Smpl(smpl::neutral())), ..ConvertOptions::default() };
    Ok(convert(motion, &options)?)
}

/// An error that starts with the file that it is about.
fn of_file(path: &Path, e: anyhow::Error) -> anyhow::Error {
    let path = path.display().to_string();
    // errors of files begin with their path already; a wrong call is about no file
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

/// Refuses, before any work, a picture under another name than a picture's, and a file that must not be written over.
pub fn picture(path: &Path, outputs: &Outputs) -> Result<()> {
    plot::check(path).map_err(|e| WrongCall(e.to_string()))?;
    Ok(outputs.check([path])?)
}

/// Writes charts to a file; nothing if all are empty.
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
