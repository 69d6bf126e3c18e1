//! AMASS, AIST++ and body models, compared with files and values made by numpy and SciPy
//! (`scripts/reference/motion_files.py`).

use kinelm_motion::format::{
    self, Axes, ReadOptions, Up, UpSource, aist, amass, body_model::BodyModel, json, npz::Npz, positions::Positions,
};
use kinelm_motion::rotation::{angle_between, exp_map};
use kinelm_motion::{Clip, Motion, Quat, Result, Source, Vec3, smpl};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Rounding error of f64 through a rotation vector and back.
const ANGLE: f64 = 1e-9;
const METRES: f64 = 1e-9;

fn golden(kind: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(kind)
}

fn expected(kind: &str) -> Value {
    serde_json::from_slice(&std::fs::read(golden(kind).join("expected.json")).unwrap()).unwrap()
}

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().map_or_else(|| vec![v.as_f64().unwrap()], |a| a.iter().flat_map(numbers).collect())
}

fn bytes(kind: &str, name: &str) -> (PathBuf, Vec<u8>) {
    let path = golden(kind).join(name);
    let bytes = std::fs::read(&path).unwrap();
    (path, bytes)
}

fn read_amass(name: &str, options: &ReadOptions) -> Result<Motion> {
    let (path, bytes) = bytes("amass", name);
    amass::read(&path, &bytes, options)
}

fn read_aist(name: &str, options: &ReadOptions) -> Result<Motion> {
    let (path, bytes) = bytes("aist", name);
    aist::read(&path, &bytes, options)
}

fn check_clip(name: &str, clip: &Clip, want: &Value) {
    assert_eq!(clip.skeleton(), &smpl::neutral(), "{name}");
    assert_eq!(clip.fps(), want["fps"].as_f64().unwrap(), "{name}");
    let (root, rotations) = (numbers(&want["root"]), numbers(&want["rotations"]));
    assert_eq!((clip.frames() * 3, clip.rotations().len() * 4), (root.len(), rotations.len()), "{name}");
    for (p, w) in clip.root().iter().zip(root.chunks(3)) {
        assert!((*p - Vec3::from_slice(w)).length() < METRES, "{name}: {p} {w:?}");
    }
    for (i, (q, w)) in clip.rotations().iter().zip(rotations.chunks(4)).enumerate() {
        let angle = angle_between(*q, Quat::from_xyzw(w[1], w[2], w[3], w[0]));
        assert!(angle < ANGLE, "{name}: frame {}, joint {}: {angle}", i / 24, i % 24);
    }
}

#[test]
fn amass_files_of_all_kinds() {
    let all = expected("amass");
    let files = all["files"].as_object().unwrap();
    assert_eq!(files.len(), 11);
    for (name, about) in files {
        let motion = read_amass(name, &ReadOptions::default()).unwrap();
        check_clip(name, &motion.clip, &all["expected"][about["values"].as_str().unwrap()]);
        assert_eq!(motion.warnings, [], "{name}");
        let source = Source::Amass {
            model: about["model"].as_str().unwrap().into(),
            gender: about["gender"].as_str().unwrap().into(),
            betas: about["betas"].as_u64().unwrap() as usize,
            rest_pelvis: smpl::REST_PELVIS,
            body_model: false,
            axes: Axes { up: Up::Z, rest_too: false, by: UpSource::Given, mirror: None },
        };
        assert_eq!(motion.source, source, "{name}");
    }
}

#[test]
fn amass_axes() {
    // (1, 2, 3) z up is (1, 3, -2) y up
    let clip = read_amass("deflated.npz", &ReadOptions::default()).unwrap().clip;
    let written = amass::write(&clip).unwrap();
    let trans = Npz::open(Path::new("w.npz"), &written).unwrap().array("trans").unwrap().reals().unwrap();
    let p = clip.root()[0];
    assert!((Vec3::new(p.x, -p.z, p.y) - smpl::REST_PELVIS - Vec3::from_slice(&trans)).length() < 1e-15);
    let zup = Vec3::new(1.0, 2.0, 3.0);
    let turned = Quat::from_rotation_x(-std::f64::consts::FRAC_PI_2) * zup;
    assert!((turned - Vec3::new(1.0, 3.0, -2.0)).length() < 1e-15);
}

#[test]
fn amass_faults_are_named() {
    let all = expected("amass");
    for (name, want) in all["faults"].as_object().unwrap() {
        let e = read_amass(name, &ReadOptions::default()).unwrap_err();
        assert_eq!(e.fault().map(|k| k.to_string()).as_deref(), want["kind"].as_str(), "{name}: {e}");
        assert!(e.to_string().contains(want["says"].as_str().unwrap()), "{name}: {e}");
        assert!(e.to_string().contains(name.as_str()), "{e}");
    }
}

#[test]
fn a_given_rate_makes_the_files_needless() {
    let options = ReadOptions { fps_source: Some(100.0), ..ReadOptions::default() };
    assert_eq!(read_amass("no_rate.npz", &options).unwrap().clip.fps(), 100.0);
    assert_eq!(read_aist("protocol2.pkl", &options).unwrap().clip.fps(), 100.0);
}

#[test]
fn aist_files_of_all_protocols() {
    let all = expected("aist");
    let files = all["files"].as_object().unwrap();
    assert_eq!(files.len(), 19);
    for (name, values) in files {
        let motion = read_aist(name, &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
        check_clip(name, &motion.clip, &all["expected"][values.as_str().unwrap()]);
        let axes = Axes { up: Up::Y, rest_too: false, by: UpSource::Given, mirror: None };
        let source = Source::Aist { scaling: 93.5, rest_pelvis: smpl::REST_PELVIS, body_model: false, axes };
        assert_eq!(motion.source, source, "{name}");
    }
}

#[test]
fn body_models() {
    let all = expected("body");
    let betas = numbers(&all["betas"]);
    let files = all["files"].as_object().unwrap();
    assert_eq!(files.len(), 7);
    for (name, about) in files {
        let model = BodyModel::load(&golden("body").join(name)).unwrap_or_else(|e| panic!("{e}"));
        for (betas, want) in [(&[][..], &about["mean"]), (&betas, &about["shaped"])] {
            let body = model.body(betas).unwrap();
            // only J is float32
            let tolerance = if name == "joints.npz" { 1e-6 } else { 1e-12 };
            let near =
                |a: Vec3, w: &[f64]| assert!((a - Vec3::from_slice(w)).length() < tolerance, "{name}: {a} {w:?}");
            near(body.rest_pelvis, &numbers(&want["rest_pelvis"]));
            let offsets = numbers(&want["offsets"]);
            body.skeleton.offsets().iter().zip(offsets.chunks(3)).for_each(|(&a, w)| near(a, w));
            assert_eq!(body.skeleton.names(), smpl::neutral().names());
        }
    }
}

#[test]
fn a_body_model_moves_the_pelvis_and_the_bones() {
    let options = ReadOptions { body_model: Some(golden("body").join("dense.npz")), ..ReadOptions::default() };
    let all = expected("body");
    let shaped = &all["files"]["dense.npz"]["shaped"];
    let rest = Vec3::from_slice(&numbers(&shaped["rest_pelvis"]));
    // these two have different betas, so the model is tested by itself
    let motion = read_amass("deflated.npz", &options).unwrap();
    let (path, raw) = bytes("amass", "deflated.npz");
    let betas = Npz::open(&path, &raw).unwrap().array("betas").unwrap().reals().unwrap();
    let body = BodyModel::load(options.body_model.as_ref().unwrap()).unwrap().body(&betas).unwrap();
    assert_eq!(motion.clip.skeleton(), &body.skeleton);
    let plain = read_amass("deflated.npz", &ReadOptions::default()).unwrap().clip;
    let moved = body.rest_pelvis - smpl::REST_PELVIS;
    let moved = Vec3::new(moved.x, moved.z, -moved.y);
    assert!((motion.clip.root()[1] - plain.root()[1] - moved).length() < 1e-12);
    assert!((rest - body.rest_pelvis).length() > 1e-6, "the shape counts");
    assert!(matches!(motion.source, Source::Amass { body_model: true, betas: 16, .. }));
    let dance = read_aist("protocol4.pkl", &options).unwrap();
    let mean = Vec3::from_slice(&numbers(&all["files"]["dense.npz"]["mean"]["rest_pelvis"]));
    assert!(
        matches!(dance.source, Source::Aist { body_model: true, rest_pelvis, .. } if (rest_pelvis - mean).length() < 1e-12)
    );
    let missing = ReadOptions { body_model: Some("nowhere.npz".into()), ..ReadOptions::default() };
    assert!(read_aist("protocol4.pkl", &missing).unwrap_err().to_string().starts_with("nowhere.npz"));
}

fn any_dance() -> Clip {
    let motion = read_aist("protocol5.pkl", &ReadOptions::default()).unwrap();
    let mut rotations = motion.clip.rotations().to_vec();
    for f in 0..motion.clip.frames() {
        // AMASS doesn't store these two
        rotations[f * 24 + 22..f * 24 + 24].fill(Quat::IDENTITY);
    }
    // half turns, where rotation vectors are discontinuous
    rotations[0] = exp_map::from_vector(Vec3::new(0.0, std::f64::consts::PI, 0.0));
    rotations[5] = Quat::from_xyzw(-1.0, 0.0, 0.0, 0.0);
    Clip::new(smpl::neutral(), 59.94, motion.clip.root().to_vec(), rotations).unwrap()
}

#[test]
fn amass_write_and_read_gives_the_clip_back() {
    let clip = any_dance();
    let written = amass::write(&clip).unwrap();
    assert_eq!(written, amass::write(&clip).unwrap(), "the same bytes each time");
    let motion = amass::read(Path::new("w.npz"), &written, &ReadOptions::default()).unwrap();
    assert_eq!((motion.clip.fps(), motion.clip.skeleton()), (59.94, &smpl::neutral()));
    for (a, b) in clip.rotations().iter().zip(motion.clip.rotations()) {
        assert!(angle_between(*a, *b) < ANGLE);
    }
    for (a, b) in clip.root().iter().zip(motion.clip.root()) {
        assert!((*a - *b).length() < METRES);
    }
    let empty = clip.slice(0..0);
    assert_eq!(
        amass::read(Path::new("w.npz"), &amass::write(&empty).unwrap(), &ReadOptions::default()).unwrap().clip,
        empty
    );
    let one = kinelm_motion::Skeleton::new(vec!["a".into()], vec![None], vec![Vec3::ZERO], vec![]).unwrap();
    let other = Clip::new(one.into(), 20.0, vec![], vec![]).unwrap();
    assert!(amass::write(&other).unwrap_err().to_string().contains("retarget"));
}

/// Our arrays, read by an independent reader (the npyz crate).
#[test]
fn npyz_reads_our_arrays() {
    use std::io::{Cursor, Read};
    let clip = any_dance();
    let positions = Positions::from_clip(&clip);
    let mut zip = zip::ZipArchive::new(Cursor::new(positions.write().unwrap())).unwrap();
    let mut array = |name: &str| {
        let mut bytes = Vec::new();
        zip.by_name(name).unwrap().read_to_end(&mut bytes).unwrap();
        bytes
    };
    let raw = array("positions.npy");
    let file = npyz::NpyFile::new(&raw[..]).unwrap();
    assert_eq!((file.shape(), file.order()), (&[2, 24, 3][..], npyz::Order::C));
    assert_eq!(file.dtype().descr(), "'<f4'");
    let flat: Vec<f32> = positions.positions.iter().flat_map(|p| p.as_vec3().to_array()).collect();
    assert_eq!(file.into_vec::<f32>().unwrap(), flat);
    let raw = array("parents.npy");
    assert_eq!(npyz::NpyFile::new(&raw[..]).unwrap().into_vec::<i32>().unwrap(), smpl::PARENTS);
    let raw = array("joints.npy");
    let names = npyz::NpyFile::new(&raw[..]).unwrap();
    assert_eq!(names.dtype().descr(), "'<U14'");
    assert_eq!(names.into_vec::<String>().unwrap(), smpl::NAMES);
    let raw = array("fps.npy");
    let fps = npyz::NpyFile::new(&raw[..]).unwrap();
    assert_eq!(fps.shape(), [0u64; 0]);
    assert_eq!(fps.into_vec::<f64>().unwrap(), [59.94]);
}

#[test]
fn files_by_their_names() {
    let folder = tempfile::tempdir().unwrap();
    let dance = format::read(&golden("aist").join("protocol4.pkl"), &ReadOptions::default()).unwrap();
    let (npz, json) = (folder.path().join("a.NPZ"), folder.path().join("a.json"));
    format::write(&npz, &dance).unwrap();
    format::write(&json, &dance).unwrap();
    let again = format::read(&json, &ReadOptions::default()).unwrap();
    assert_eq!((&again.clip, &again.source), (&dance.clip, &Source::Plain));
    let options = ReadOptions { skip: 1, fps_source: Some(24.0), ..ReadOptions::default() };
    for path in [&npz, &json] {
        let cut = format::read(path, &options).unwrap().clip;
        assert_eq!((cut.frames(), cut.fps()), (1, 24.0));
        assert!((cut.root()[0] - dance.clip.root()[1]).length() < METRES);
        assert_eq!(format::positions(path, &options).unwrap().positions.len(), 24);
    }
    let none = ReadOptions { skip: 2, ..ReadOptions::default() };
    assert!(format::read(&json, &none).unwrap_err().to_string().contains("there are 2"));
    let pickle = format::write(&folder.path().join("a.pkl"), &dance).unwrap_err();
    assert!(pickle.to_string().contains("expected a .bvh, .npz, .json, .glb or .vrma to write"), "{pickle}");
    // a file with the wrong extension
    let wrong = folder.path().join("b.pkl");
    std::fs::copy(&npz, &wrong).unwrap();
    let e = format::read(&wrong, &ReadOptions::default()).unwrap_err().to_string();
    assert!(e.contains("not_this_format: found an npz archive, expected a pickle"), "{e}");
    std::fs::copy(&json, &npz).unwrap();
    let e = format::read(&npz, &ReadOptions::default()).unwrap_err().to_string();
    assert!(e.contains("not_this_format") && e.contains("expected an npz"), "{e}");
}

#[test]
#[ignore = "writes files for scripts/reference/motion_files.py --check"]
fn for_numpy() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("for_numpy");
    std::fs::create_dir_all(&folder).unwrap();
    let clip = any_dance();
    std::fs::write(folder.join("clip.json"), json::write(&clip)).unwrap();
    std::fs::write(folder.join("amass.npz"), amass::write(&clip).unwrap()).unwrap();
    std::fs::write(folder.join("positions.npz"), Positions::from_clip(&clip).write().unwrap()).unwrap();
    println!("{}", folder.display());
}

#[cfg(feature = "amass")]
#[test]
fn an_archive_of_still_frames_is_read_back() {
    use kinelm_motion::format::npz::{Npz, Values, Writer};
    // 100,000 equal frames: deflated, they would look like a zip bomb
    let poses = vec![0.25; 100_000 * 156];
    let mut writer = Writer::new();
    writer.add("poses", &[100_000, 156], Values::F64(&poses)).unwrap();
    let bytes = writer.finish().unwrap();
    let npz = Npz::open(std::path::Path::new("still.npz"), &bytes).unwrap();
    assert!(npz.array("poses").is_ok());
    let mut writer = Writer::new();
    writer.add("poses", &[1000, 156], Values::F64(&poses[..156_000])).unwrap();
    assert!(writer.finish().unwrap().len() < 100_000, "short ones are deflated");
}
