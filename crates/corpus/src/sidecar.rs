//! How a dance is read: as the file beside it says, `dance.bvh.kinelm.json`.
//!
//! Whatever wrote the dance, its sidecar holds the dance's name and hash, and how the dance is read. Here no more of it is
//! known, so that all that reads motion can ask; what else stands in it, `kinelm_generate::provenance` reads.

use crate::{Error, Result};
use kinelm_motion::format::{BvhPosition, Format, ReadOptions, Unit, Up};
use kinelm_store::sidecar::{FileHash, name_of, path_of};
use kinelm_store::{counted, hash, input};
use serde::Deserialize;
use std::path::Path;

/// What of a sidecar says how the dance is read.
#[derive(Deserialize)]
struct Sidecar {
    output: FileHash,
    read: ReadOptions,
}

/// How the sidecar of `dance` says that it is read; `None` where there is none, or the dance has changed since.
///
/// # Errors
/// [`kinelm_store::Error::Io`] for a sidecar that can't be read; [`kinelm_store::Error::File`] for one of another version, or text that is none.
pub fn reading_of(dance: &Path) -> Result<Option<ReadOptions>> {
    let path = path_of(dance);
    if !path.is_file() {
        return Ok(None);
    }
    let text = input::text(&path).map_err(Error::io(&path))?;
    let told: Sidecar = serde_json::from_str(&text).map_err(|e| {
        let help = "the dance is read as any file; make it again with this version, or take the sidecar away";
        Error::file(&path, e.to_string(), "what this version of kinelm writes beside a dance", help)
    })?;
    // a dance that can't be read is told of where it is read
    let is_its =
        |output: FileHash| output.file == name_of(dance) && hash::of_file(dance).is_ok_and(|is| is == output.sha256);
    Ok(is_its(told.output).then_some(told.read))
}

/// How a dance is read from the file `dance` that it is written to: on the rig of a clip that was read so, or on SMPL's.
pub fn as_written(dance: &Path, clip: Option<(&Path, &ReadOptions)>) -> ReadOptions {
    let format = Format::of_name(dance);
    // the program writes with y up, but on a clip's rig in the clip's format, where its axes are kept
    let up = if matches!(format, Some(Format::Bvh | Format::Json)) { Up::Y } else { Up::Auto };
    let Some((path, read)) = clip else { return ReadOptions { up, ..ReadOptions::default() } };
    let own = ReadOptions { up, map: read.map.clone(), floor: read.floor, ..ReadOptions::default() };
    if Format::of_name(path) != format {
        return own;
    }
    ReadOptions { up: read.up, unit: read.unit, bvh_position: read.bvh_position, root: read.root.clone(), ..own }
}

/// How a dance is read among files that a call says something of: what its sidecar says of the file holds, as the call says it
/// of those that have none.
pub fn among_others(told: ReadOptions, call: &ReadOptions) -> ReadOptions {
    ReadOptions {
        map: call.map.clone().or(told.map),
        floor: call.floor.or(told.floor),
        lenient: call.lenient,
        body_model: call.body_model.clone(),
        ..told
    }
}

/// What a sidecar says, in words, of what `read` took over from it; `None` where that is what any file of ours is read with.
/// The rate isn't told, which the file states itself; nor is a rest-pose frame, of which reading tells.
pub fn in_words(told: &ReadOptions, read: &ReadOptions) -> Option<String> {
    let mut words = Vec::new();
    let mut say = |is_said: bool, what: String| words.extend(is_said.then_some(what));
    say(told.skip > 0 && told.skip == read.skip, format!("skip {}", told.skip));
    if let Some(metres) = told.unit.metres().filter(|_| told.unit != Unit::Auto && told.unit == read.unit) {
        say(true, format!("unit {metres} m"));
    }
    say(!matches!(told.up, Up::Auto | Up::Y) && told.up == read.up, format!("up {}", told.up));
    say(told.bvh_position == BvhPosition::Add && told.bvh_position == read.bvh_position, "positions added".into());
    for (what, told, read) in [("map", &told.map, &read.map), ("root", &told.root, &read.root)] {
        if let Some(name) = told.as_ref().filter(|_| told == read) {
            say(true, format!("{what} {name}"));
        }
    }
    if let Some(floor) = told.floor.filter(|floor| floor.abs() >= 5e-4 && told.floor == read.floor) {
        say(true, format!("floor at {floor:.3} m"));
    }
    (!words.is_empty()).then(|| words.join(", "))
}

/// One line of what sidecars say of files, in words; `None` where they say nothing.
pub fn line(told: &[(String, String)]) -> Option<String> {
    let (name, words) = told.first()?;
    Some(match told.len() {
        1 => format!("{name}: read as its sidecar says: {words}"),
        n => format!("{} are read as their sidecars say, the first {name}: {words}", counted(n, "files")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dance_that_has_changed_is_a_file_like_any_other() {
        let dir = tempfile::tempdir().unwrap();
        let dance = dir.path().join("a.bvh");
        std::fs::write(&dance, "dance").unwrap();
        assert_eq!(reading_of(&dance).unwrap(), None);
        let read = ReadOptions { skip: 3, unit: Unit::Inch, up: Up::Z, floor: Some(0.1), ..ReadOptions::default() };
        let output = FileHash { file: "a.bvh".into(), sha256: hash::of(b"dance") };
        let text = serde_json::json!({ "schema": 3, "output": output, "read": read, "recipe": {} }).to_string();
        std::fs::write(path_of(&dance), &text).unwrap();
        assert_eq!(reading_of(&dance).unwrap(), Some(read.clone()));
        assert_eq!(in_words(&read, &read).unwrap(), "skip 3, unit 0.0254 m, up z, floor at 0.100 m");
        assert_eq!(
            in_words(&read, &ReadOptions { skip: 0, ..read.clone() }).unwrap(),
            "unit 0.0254 m, up z, floor at 0.100 m"
        );
        std::fs::copy(path_of(&dance), path_of(&dir.path().join("b.bvh"))).unwrap();
        std::fs::copy(&dance, dir.path().join("b.bvh")).unwrap();
        assert_eq!(reading_of(&dir.path().join("b.bvh")).unwrap(), None, "it tells of a.bvh");
        std::fs::write(&dance, "danced").unwrap();
        assert_eq!(reading_of(&dance).unwrap(), None);
        std::fs::write(path_of(&dance), text.replace("\"read\"", "\"reads\"")).unwrap();
        assert!(reading_of(&dance).unwrap_err().to_string().contains("missing field `read`"));
    }

    #[test]
    fn among_others_the_sidecar_knows_its_file() {
        let told = ReadOptions { skip: 3, up: Up::Y, floor: Some(0.1), ..ReadOptions::default() };
        let call = ReadOptions { skip: 10, fps_source: Some(60.0), floor: Some(0.2), ..ReadOptions::default() };
        let read = among_others(told.clone(), &call);
        assert_eq!(read, ReadOptions { floor: Some(0.2), ..told });
    }
}
