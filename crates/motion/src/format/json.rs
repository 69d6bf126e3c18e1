//! Clips as JSON, with all digits of every number.
//!
//! ```json
//! {"schema": 1, "fps": 20.0, "names": ["pelvis"], "parents": [-1], "offsets": [[0.0, 0.0, 0.0]],
//!  "root": [[0.0, 0.97, 0.0]], "rotations": [[[1.0, 0.0, 0.0, 0.0]]]}
//! ```
//! `root` is (F, 3) in metres, `rotations` (F, J, 4) in the order w, x, y, z; the root's parent is -1. `ends` is an optional
//! list of `{"parent": j, "offset": [x, y, z]}`.

use super::{Axes, ReadOptions, Up};
use crate::error::{FaultKind, FileError};
use crate::rig::map_if_any;
use crate::{Clip, EndSite, Error, Motion, Quat, Result, Skeleton, Source, Vec3};
use kinelm_store::SourcePos;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// The version of the format.
pub const SCHEMA: u64 = 1;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    #[serde(rename = "schema")]
    _schema: u64,
    fps: f64,
    names: Vec<String>,
    parents: Vec<i64>,
    offsets: Vec<[f64; 3]>,
    #[serde(default)]
    ends: Vec<End>,
    root: Vec<[f64; 3]>,
    rotations: Vec<Vec<[f64; 4]>>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct End {
    parent: usize,
    offset: [f64; 3],
}

/// Reads a clip: bit for bit the one that [`write()`] was given, at the rate in the options if there is one, and rotated to
/// y up if the options give another axis.
///
/// # Errors
/// [`FaultKind::JsonBad`], with line and column for a syntax error or unknown key, without them for impossible values.
pub fn read(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
    match super::sniff(bytes) {
        "JSON" | "text" => check_schema(path, bytes)?,
        other => {
            let at = SourcePos::file(path);
            return Err(FileError::new(at, FaultKind::NotThisFormat, other, "a clip as JSON").into());
        }
    }
    let Document { fps, names, parents, offsets, ends, root, rotations, .. } =
        serde_json::from_slice(bytes).map_err(|e| malformed(path, &e))?;
    let bad = |found: String, expected: &str| Error::from(fault(path, found, expected));
    let j = names.len();
    if rotations.len() != root.len() {
        return Err(bad(format!("{} rows of rotations and {} of root", rotations.len(), root.len()), "as many"));
    }
    if let Some(f) = rotations.iter().position(|row| row.len() != j) {
        return Err(bad(format!("{} rotations at frame {f}", rotations[f].len()), &format!("{j}, one a joint")));
    }
    if let Some(p) = parents.iter().find(|&&p| p < -1) {
        return Err(bad(format!("parent {p}"), "an earlier joint, -1 for the root"));
    }
    let parents = parents.iter().map(|&p| usize::try_from(p).ok()).collect();
    let ends = ends.iter().map(|e| EndSite { parent: e.parent, offset: e.offset.into() }).collect();
    let offsets = offsets.into_iter().map(Vec3::from).collect();
    let root = root.into_iter().map(Vec3::from).collect();
    let rotations = rotations.into_iter().flatten().map(|[w, x, y, z]| Quat::from_xyzw(x, y, z, w)).collect();
    let clip = Skeleton::new(names, parents, offsets, ends)
        .and_then(|s| Clip::new(Arc::new(s), options.fps_source.unwrap_or(fps), root, rotations))
        .and_then(|clip| match options.unit.metres() {
            Some(metres) => clip.scaled(metres),
            None => Ok(clip),
        })
        .map_err(|e| bad(e.to_string(), "a clip"))?;
    let mirror = options.mirror_axis;
    let clip = Axes::OWN.mirrored(mirror).to_y_up(clip)?;
    let found = map_if_any(&clip, options.map.as_deref())?;
    let (axes, doubt) = Axes::of_format(&clip, Up::Y, options, found.as_ref());
    let clip = axes.to_y_up(clip)?;
    let is_plain = axes.up == Up::Y && mirror.is_none();
    let source = if is_plain { Source::Plain } else { Source::Json(axes.mirrored(mirror)) };
    Ok(Motion::read(path, clip, source, doubt.into_iter().collect(), found))
}

/// A motion as JSON, in the axes of its file if that was JSON too.
///
/// # Errors
/// None for a finite clip.
pub(super) fn to_bytes(motion: &Motion) -> Result<Vec<u8>> {
    match motion.source {
        Source::Json(axes) => Ok(write(axes.restored(&motion.clip)?.as_ref())),
        _ => Ok(write(&motion.clip)),
    }
}

/// A clip as JSON, one line per field and per frame.
pub fn write(clip: &Clip) -> Vec<u8> {
    let skeleton = clip.skeleton();
    let parents: Vec<i64> = skeleton.parents().iter().map(|p| p.map_or(-1, |p| p as i64)).collect();
    let offsets: Vec<[f64; 3]> = skeleton.offsets().iter().map(|o| o.to_array()).collect();
    let ends: Vec<End> =
        skeleton.ends().iter().map(|e| End { parent: e.parent, offset: e.offset.to_array() }).collect();
    let mut out = format!("{{\"schema\": {SCHEMA},\n").into_bytes();
    field(&mut out, "fps", &clip.fps());
    field(&mut out, "names", &skeleton.names());
    field(&mut out, "parents", &parents);
    field(&mut out, "offsets", &offsets);
    if !ends.is_empty() {
        field(&mut out, "ends", &ends);
    }
    rows(&mut out, "root", clip.root().iter().map(|p| p.to_array()));
    out.extend(b",\n");
    let row = |f: usize| clip.pose(f).iter().map(|q| [q.w, q.x, q.y, q.z]).collect::<Vec<_>>();
    rows(&mut out, "rotations", (0..clip.frames()).map(row));
    out.extend(b"}\n");
    out
}

fn field(out: &mut Vec<u8>, name: &str, value: &impl Serialize) {
    out.extend(format!("\"{name}\": ").bytes());
    put(out, value);
    out.extend(b",\n");
}

fn rows(out: &mut Vec<u8>, name: &str, rows: impl Iterator<Item = impl Serialize>) {
    out.extend(format!("\"{name}\": [").bytes());
    for (i, row) in rows.enumerate() {
        out.extend(if i == 0 { &b"\n"[..] } else { b",\n" });
        put(out, &row);
    }
    out.push(b']');
}

fn put(out: &mut Vec<u8>, value: &impl Serialize) {
    // the numbers of a clip are finite, and writing to memory can't fail
    serde_json::to_writer(out, value).expect("plain values");
}

/// Checks the version first, because other versions may have any fields.
fn check_schema(path: &Path, bytes: &[u8]) -> Result<()> {
    #[derive(Deserialize)]
    struct Version {
        schema: u64,
    }
    let version: Version = serde_json::from_slice(bytes).map_err(|e| malformed(path, &e))?;
    match version.schema {
        SCHEMA => Ok(()),
        n => Err(fault(path, format!("schema {n}"), "1").help("it was written by a newer version").into()),
    }
}

fn fault(path: &Path, found: String, expected: &str) -> FileError {
    FileError::new(SourcePos::file(path), FaultKind::JsonBad, found, expected)
}

fn malformed(path: &Path, e: &serde_json::Error) -> Error {
    let place = format!(" at line {} column {}", e.line(), e.column());
    // serde_json appends the place, which the position has already
    let found = e.to_string().replace(&place, "");
    let at = SourcePos { path: path.to_owned(), line: e.line(), column: e.column() };
    FileError::new(at, FaultKind::JsonBad, found, "a clip as JSON").into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::tests::any_quat;
    use proptest::prelude::*;

    fn back(bytes: &[u8]) -> Result<Clip> {
        read(Path::new("c.json"), bytes, &ReadOptions::default()).map(|m| m.clip)
    }

    fn clip(q: Vec<Quat>, root: Vec<Vec3>, fps: f64) -> Clip {
        let ends = vec![EndSite { parent: 1, offset: Vec3::new(0.1, -0.0, 1e-300) }];
        let offsets = vec![Vec3::new(0.1, 0.2, 0.3), Vec3::Y];
        let s = Skeleton::new(vec!["a\"é".into(), "b".into()], vec![None, Some(0)], offsets, ends).unwrap();
        Clip::new(Arc::new(s), fps, root, q).unwrap()
    }

    proptest! {
        #[test]
        fn reading_gives_the_same_clip(
            q in prop::collection::vec(any_quat(), 6),
            p in prop::collection::vec(prop::array::uniform3(prop::num::f64::NORMAL | prop::num::f64::ZERO), 3),
            fps in 1e-3..1e4f64,
        ) {
            let c = clip(q, p.into_iter().map(Vec3::from).collect(), fps);
            let again = back(&write(&c)).unwrap();
            prop_assert_eq!(&again, &c);
            prop_assert_eq!(write(&again), write(&c));
        }

        #[test]
        fn edited_bytes_give_an_error_or_a_clip(at in 0usize..400, byte: u8) {
            let mut bytes = write(&clip(vec![Quat::IDENTITY; 2], vec![Vec3::X], 20.0));
            let n = bytes.len();
            bytes[at % n] = byte;
            let _ = back(&bytes);
        }
    }

    #[test]
    fn no_frames() {
        let c = clip(vec![], vec![], 20.0);
        assert_eq!(back(&write(&c)).unwrap(), c);
    }

    #[test]
    fn faults_have_their_place() {
        let text = |c: &str| back(c.as_bytes()).unwrap_err().to_string();
        let whole = String::from_utf8(write(&clip(vec![Quat::IDENTITY; 2], vec![Vec3::X], 20.0))).unwrap();
        assert!(back(whole.as_bytes()).is_ok());
        assert!(text("{\n \"schema\": x}").starts_with("c.json:2:12: json_bad: "), "{}", text("{\n \"schema\": x}"));
        assert!(
            text(&whole.replace("\"schema\": 1", "\"schema\": 2, \"new\": 3")).contains("found schema 2, expected 1")
        );
        assert!(text(&whole.replace("\"fps\"", "\"rate\"")).contains("rate"));
        assert!(text(&whole.replace("20.0", "-20.0")).contains("-20 frames per second"));
        assert!(text(&whole.replace("20.0", "1e999")).contains("c.json:2:"));
        assert!(text(&whole.replace("[-1,0]", "[-1,1]")).contains("joint 1 (b)"));
        assert!(text(&whole.replace("[-1,0]", "[-1,-2]")).contains("parent -2"));
        assert!(text(&whole.replace("[1.0,0.0,0.0,0.0],", "[0.0,0.0,0.0,0.0],")).contains("frame 0, joint a"));
        assert!(text(&whole.replace("[1.0,0.0,0.0,0.0],", "")).contains("1 rotations at frame 0"));
        assert!(text(&"[".repeat(100_000)).contains("json_bad"));
        for n in 0..whole.len() - 2 {
            assert!(back(&whole.as_bytes()[..n]).is_err(), "cut at {n}");
        }
    }
}
