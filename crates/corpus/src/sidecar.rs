//! How a dance is read: as its sidecar says, `dance.bvh.kinelm.json` beside `dance.bvh`.
//!
//! Of a sidecar only the dance's name and hash and the reading options are read here, for everything that reads motion;
//! `kinelm_generate::provenance` reads the rest.

use crate::{Error, Result};
use kinelm_motion::format::{BvhPosition, Format, ReadOptions, Unit, Up};
use kinelm_store::sidecar::{FileHash, name_of, path_of};
use kinelm_store::{counted, hash, input};
use serde::Deserialize;
use std::path::Path;

/// The part of a sidecar that says how the dance is read.
#[derive(Deserialize)]
struct Sidecar {
    output: FileHash,
    read: ReadOptions,
}

/// The reading options in the sidecar of `dance`; `None` if it has none, or has changed since.
///
/// # Errors
/// [`kinelm_store::Error::Io`] for a sidecar that can't be read; [`kinelm_store::Error::File`] for a bad one.
pub fn read_options(dance: &Path) -> Result<Option<ReadOptions>> {
    let path = path_of(dance);
    if !path.is_file() {
        return Ok(None);
    }
    let text = input::text(&path).map_err(Error::io(&path))?;
    let sidecar: Sidecar = serde_json::from_str(&text).map_err(|e| {
        let help = "the dance is read as any file; make it again with this version, or take the sidecar away";
        Error::file(&path, e.to_string(), "what this version of kinelm writes beside a dance", help)
    })?;
    let FileHash { file, sha256 } = sidecar.output;
    // a dance that can't be read is reported where it is read
    let fits = file == name_of(dance) && hash::of_file(dance).is_ok_and(|found| found == sha256);
    Ok(fits.then_some(sidecar.read))
}

/// The options with which a dance is read from the file `dance` that it is written to: on the rig of `clip`, a file and the
/// options that it was read with, or on SMPL's.
pub fn output_read_options(dance: &Path, clip: Option<(&Path, &ReadOptions)>) -> ReadOptions {
    let format = Format::of_name(dance);
    // BVH and JSON are written with y up, except on a clip's rig in the clip's format, whose axes stay; the other formats
    // have one axis, whatever a clip was read with
    let keeps_axes = matches!(format, Some(Format::Bvh | Format::Json));
    let up = if keeps_axes { Up::Y } else { Up::Auto };
    if format == Some(Format::Vrma) {
        // it states its joints, and its rest is a pose of its own, with the floor at 0
        return ReadOptions { floor: Some(0.0), ..ReadOptions::default() };
    }
    let Some((path, read)) = clip else { return ReadOptions { up, ..ReadOptions::default() } };
    let own = ReadOptions { up, map: read.map.clone(), floor: read.floor, ..ReadOptions::default() };
    if Format::of_name(path) != format {
        // a rig that is no BVH is written as one in centimetres, which its legs need not show
        let unit = if format == Some(Format::Bvh) { Unit::CENTIMETRE } else { Unit::Auto };
        return ReadOptions { unit, ..own };
    }
    let up = if keeps_axes { read.up } else { up };
    let mirror_axis = read.mirror_axis.filter(|_| keeps_axes);
    let own = ReadOptions { up, mirror_axis, ..own };
    if format != Some(Format::Bvh) {
        // written in metres, from the clip's root on
        return own;
    }
    let ReadOptions { unit, bvh_position, .. } = *read;
    ReadOptions { unit, bvh_position, root: read.root.clone(), ..own }
}

/// The options for a dance with a sidecar among several files: the sidecar's, except those that don't depend on the file's
/// format.
pub fn combined(sidecar: ReadOptions, options: &ReadOptions) -> ReadOptions {
    ReadOptions {
        map: options.map.clone().or(sidecar.map),
        floor: options.floor.or(sidecar.floor),
        lenient: options.lenient,
        body_model: options.body_model.clone(),
        ..sidecar
    }
}

/// Describes the options that `read` took over from a sidecar; `None` if they are the defaults. Rate and rest-pose frames
/// are left out: the file states the rate, and reading reports the frame.
pub fn describe(sidecar: &ReadOptions, read: &ReadOptions) -> Option<String> {
    let mut words = Vec::new();
    let mut add = |is_taken: bool, what: String| words.extend(is_taken.then_some(what));
    add(sidecar.skip > 0 && sidecar.skip == read.skip, format!("skip {}", sidecar.skip));
    add(
        sidecar.unit != Unit::Auto && sidecar.unit == read.unit,
        format!("unit {} m", sidecar.unit.metres().unwrap_or(1.0)),
    );
    add(!matches!(sidecar.up, Up::Auto | Up::Y) && sidecar.up == read.up, format!("up {}", sidecar.up));
    if let Some(axis) = sidecar.mirror_axis.filter(|_| sidecar.mirror_axis == read.mirror_axis) {
        add(true, format!("mirrored along {axis}"));
    }
    let is_added = sidecar.bvh_position == BvhPosition::Add && sidecar.bvh_position == read.bvh_position;
    add(is_added, "positions added".into());
    let named =
        [("map", &sidecar.map, &read.map), ("root", &sidecar.root, &read.root), ("take", &sidecar.take, &read.take)];
    for (what, sidecar, read) in named {
        if let Some(name) = sidecar.as_ref().filter(|_| sidecar == read) {
            let name = if name.contains('\n') { "of its own" } else { name };
            add(true, format!("{what} {name}"));
        }
    }
    // a lower floor would be shown as 0.000 m
    if let Some(floor) = sidecar.floor.filter(|floor| floor.abs() >= 5e-4 && sidecar.floor == read.floor) {
        add(true, format!("floor at {floor:.3} m"));
    }
    (!words.is_empty()).then(|| words.join(", "))
}

/// One line for several files and their descriptions ([`describe`]); `None` for no files.
pub fn describe_all(files: &[(String, String)]) -> Option<String> {
    let (name, words) = files.first()?;
    Some(match files.len() {
        1 => format!("{name}: read as its sidecar says: {words}"),
        n => format!("{} are read as their sidecars say, the first {name}: {words}", counted(n, "files")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::format::MirrorAxis;

    #[test]
    fn a_changed_dance_is_read_like_any_file() {
        let dir = tempfile::tempdir().unwrap();
        let dance = dir.path().join("a.bvh");
        std::fs::write(&dance, "dance").unwrap();
        assert_eq!(read_options(&dance).unwrap(), None);
        let read = ReadOptions { skip: 3, unit: Unit::INCH, up: Up::Z, floor: Some(0.1), ..ReadOptions::default() };
        let output = FileHash { file: "a.bvh".into(), sha256: hash::of(b"dance") };
        let text = serde_json::json!({ "schema": 3, "output": output, "read": read, "recipe": {} }).to_string();
        std::fs::write(path_of(&dance), &text).unwrap();
        assert_eq!(read_options(&dance).unwrap(), Some(read.clone()));
        assert_eq!(describe(&read, &read).unwrap(), "skip 3, unit 0.0254 m, up z, floor at 0.100 m");
        assert_eq!(
            describe(&read, &ReadOptions { skip: 0, ..read.clone() }).unwrap(),
            "unit 0.0254 m, up z, floor at 0.100 m"
        );
        std::fs::copy(path_of(&dance), path_of(&dir.path().join("b.bvh"))).unwrap();
        std::fs::copy(&dance, dir.path().join("b.bvh")).unwrap();
        assert_eq!(read_options(&dir.path().join("b.bvh")).unwrap(), None, "it is the sidecar of a.bvh");
        std::fs::write(&dance, "changed").unwrap();
        assert_eq!(read_options(&dance).unwrap(), None);
        std::fs::write(path_of(&dance), text.replace("\"read\"", "\"reads\"")).unwrap();
        assert!(read_options(&dance).unwrap_err().to_string().contains("missing field `read`"));
    }

    #[test]
    fn dances_are_read_with_the_axis_that_they_are_written_with() {
        let read = ReadOptions { up: Up::Z, ..ReadOptions::default() };
        let up = |dance: &str, clip: &str| output_read_options(Path::new(dance), Some((Path::new(clip), &read))).up;
        for format in ["npz", "glb"] {
            let [dance, clip] = ["a", "b"].map(|name| format!("{name}.{format}"));
            assert_eq!((up(&dance, &clip), up(&dance, "b.bvh")), (Up::Auto, Up::Auto), "{format}");
        }
        assert_eq!((up("a.bvh", "b.bvh"), up("a.json", "b.json"), up("a.bvh", "b.glb")), (Up::Z, Up::Z, Up::Y));
    }

    #[test]
    fn dances_are_read_in_the_unit_that_they_are_written_in() {
        let (unit, root) = (Unit::MILLIMETRE, Some("hips".to_owned()));
        let read = ReadOptions { unit, root: root.clone(), ..ReadOptions::default() };
        let of = |dance: &str, clip: &str| {
            let own = output_read_options(Path::new(dance), Some((Path::new(clip), &read)));
            (own.unit, own.root)
        };
        assert_eq!((of("a.bvh", "b.bvh"), of("a.bvh", "b.fbx")), ((unit, root), (Unit::CENTIMETRE, None)));
        for name in ["a.glb", "a.json", "a.npz"] {
            assert_eq!((of(name, name), of(name, "b.bvh")), ((Unit::Auto, None), (Unit::Auto, None)));
        }
    }

    #[test]
    fn options_of_the_format_are_the_sidecar_s() {
        let sidecar = ReadOptions { skip: 3, up: Up::Y, floor: Some(0.1), ..ReadOptions::default() };
        let options = ReadOptions { skip: 10, fps_source: Some(60.0), floor: Some(0.2), ..ReadOptions::default() };
        let read = combined(sidecar.clone(), &options);
        assert_eq!(read, ReadOptions { floor: Some(0.2), ..sidecar });
    }

    #[test]
    fn a_mirror_is_written_back_by_formats_that_keep_the_file_s_axes() {
        let read = ReadOptions { mirror_axis: Some(MirrorAxis::Z), ..ReadOptions::default() };
        let written = |dance: &str, clip: &str| output_read_options(Path::new(dance), Some((Path::new(clip), &read)));
        assert_eq!(written("b.bvh", "a.bvh").mirror_axis, Some(MirrorAxis::Z));
        assert_eq!(describe(&read, &written("b.bvh", "a.bvh")).unwrap(), "mirrored along z");
        for (dance, clip) in [("b.glb", "a.glb"), ("b.json", "a.bvh")] {
            assert_eq!(written(dance, clip).mirror_axis, None, "{dance}");
        }
    }
}
