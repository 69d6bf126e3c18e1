//! Malicious files: refused with a named fault, never executed, without a panic or much memory.

use kinelm_motion::format::array::Array;
use kinelm_motion::format::pickle::{MAX_MARKS, MAX_STACK, MAX_VALUES, Pickle};
use kinelm_motion::format::{ReadOptions, aist, amass, body_model::BodyModel, npz::Npz};
use kinelm_motion::{Error, FaultKind};
use proptest::prelude::*;
use std::io::{Cursor, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use zip::write::SimpleFileOptions;

/// Most memory of this test program, MiB. Ordinary files are a few KiB; the largest zip bomb may take 64 MiB and some
/// copies.
const PEAK_MIB: u64 = 256;

/// The peak memory of this program, if the system reports it.
fn check_peak() {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else { return };
    let kib = status.lines().find_map(|l| l.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse::<u64>().ok());
    assert!(kib.unwrap() / 1024 < PEAK_MIB, "{} MiB", kib.unwrap() / 1024);
}

fn golden(kind: &str, extension: &str) -> Files {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(kind);
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    files.retain(|p| p.extension().is_some_and(|e| e == extension));
    files.sort();
    files.iter().map(|p| (p.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read(p).unwrap())).collect()
}

fn read_pickle(bytes: &[u8]) -> Result<(), Error> {
    aist::read(Path::new("a.pkl"), bytes, &ReadOptions::default()).map(drop)
}

fn read_npz(bytes: &[u8]) -> Result<(), Error> {
    amass::read(Path::new("a.npz"), bytes, &ReadOptions::default()).map(drop)
}

/// The fault of an error.
fn kind(result: Result<(), Error>) -> FaultKind {
    result.unwrap_err().fault().expect("an error of the file")
}

// pickles

#[test]
fn forbidden_names_are_refused_by_name() {
    let cases: [(&[u8], &str); 14] = [
        (b"cos\nsystem\n(S'echo harm'\ntR.", "os.system"),
        (b"\x80\x02cposix\nsystem\nX\x04\x00\x00\x00harm\x85R.", "posix.system"),
        (b"\x80\x04\x8c\x02os\x8c\x06system\x93\x8c\x04harm\x85R.", "os.system"),
        (b"\x80\x04\x8c\x08builtins\x8c\x04eval\x93\x8c\x011\x85R.", "builtins.eval"),
        (b"c__builtin__\neval\n(S'1'\ntR.", "__builtin__.eval"),
        (b"(S'harm'\nios\nsystem\n.", "os.system"),
        (b"cnumpy\nload\n(S'x'\ntR.", "numpy.load"),
        (b"cnumpy.core.multiarray\nfromfile\n.", "numpy.core.multiarray.fromfile"),
        (b"cnumpy\ndtype\n(S'f8'\nI0\nI1\ntRcos\nsystem\n.", "os.system"),
        // allowed names, misused
        (b"cnumpy\nndarray\n(I1000000000\ntR.", "ndarray"),
        (b"\x80\x02cnumpy\nndarray\n)\x81.", "making of an object"),
        (b"c_codecs\nencode\nVx\nVzlib\n\x86R.", "encoding other than latin1"),
        (b"\x82\x01.", "extension registry"),
        (b"Pharm\n.", "persistent id"),
    ];
    for (bytes, says) in cases {
        let e = read_pickle(bytes).unwrap_err();
        assert_eq!(e.fault(), Some(FaultKind::PickleRefused), "{e}");
        assert!(e.to_string().contains(says), "{e}");
    }
}

#[test]
fn nesting_costs_nothing() {
    for (unit, tail) in
        [(&b"("[..], &b""[..]), (b"]", b""), (b"(]", b""), (b"}", b""), (b"\x85", b"."), (b"(\x94", b"")]
    {
        let mut bytes = b"N".to_vec();
        bytes.extend(unit.repeat(1_000_000));
        bytes.extend(tail);
        let kind = kind(read_pickle(&bytes));
        assert!(matches!(kind, FaultKind::TooLarge | FaultKind::PickleBad), "{unit:?}: {kind}");
    }
    let marks = [&b"("[..]].concat().repeat(MAX_MARKS + 1);
    assert_eq!(kind(read_pickle(&marks)), FaultKind::TooLarge);
    // lists nested up to the limit and closed in order: read, but no motion
    let deep = [b"]".repeat(10_000), b"a".repeat(9_999), b".".to_vec()].concat();
    assert_eq!(kind(read_pickle(&deep)), FaultKind::NoMotion);
    // a list that contains itself
    assert_eq!(kind(read_pickle(b"]q\x00h\x00a.")), FaultKind::NoMotion);
    assert_eq!(kind(read_pickle(b"}q\x00X\x0a\x00\x00\x00smpl_posesh\x00s.")), FaultKind::Dtype);
    check_peak();
}

#[test]
fn the_memo_and_the_stack_stay_small() {
    // large memo indices cost no memory
    assert_eq!(kind(read_pickle(b"Nr\xff\xff\xff\xffj\xff\xff\xff\xff.")), FaultKind::NoMotion);
    assert_eq!(kind(read_pickle(b"j\xff\xff\xff\xff.")), FaultKind::PickleBad);
    let twice = [b"N".to_vec(), b"2\x86".repeat(100_000), b".".to_vec()].concat();
    assert_eq!(kind(read_pickle(&twice)), FaultKind::NoMotion, "2^100000 values, were they copied");
    assert_eq!(kind(read_pickle(&b"N".repeat(MAX_STACK + 1))), FaultKind::TooLarge);
    assert_eq!(kind(read_pickle(&b"N0".repeat(MAX_VALUES + 1))), FaultKind::TooLarge);
    assert_eq!(kind(read_pickle(&[b"N".to_vec(), b"\x94".repeat(MAX_STACK + 1)].concat())), FaultKind::TooLarge);
    // one text encoded repeatedly
    let mut bytes = b"\x80\x02X\x00\x00\x01\x00".to_vec();
    bytes.extend(b"a".repeat(1 << 16));
    bytes.extend(b"q\x00X\x06\x00\x00\x00latin1q\x01c_codecs\nencode\nq\x02".iter());
    bytes.extend(b"h\x02h\x00h\x01\x86R".repeat(10_000));
    assert_eq!(kind(read_pickle(&bytes)), FaultKind::TooLarge);
    // many keys that share one long text
    let mut bytes = b"\x80\x02}(B\x00\x00\x01\x00".to_vec();
    bytes.extend(b"a".repeat(1 << 16));
    bytes.extend(b"q\x00N".iter());
    bytes.extend(b"h\x00N".repeat(100_000));
    bytes.extend(b"u.");
    assert_eq!(kind(read_pickle(&bytes)), FaultKind::KeyMissing);
    check_peak();
}

/// A dict whose `smpl_poses` is an array by `_reconstruct` with this shape and these bytes.
fn pickled(shape: &[u8], dtype: &str, bytes: &[u8]) -> Vec<u8> {
    let mut p = b"\x80\x02}X\x0a\x00\x00\x00smpl_posescnumpy.core.multiarray\n_reconstruct\n".to_vec();
    p.extend(b"cnumpy\nndarray\nK\x00\x85U\x01b\x87R(K\x01");
    p.extend(shape);
    p.extend(format!("cnumpy\ndtype\nU\u{2}{dtype}K\u{0}K\u{1}\u{ffff}").replace('\u{ffff}', "").bytes());
    p.extend(b"\x87R(K\x03U\x01<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb\x89T");
    p.extend((bytes.len() as u32).to_le_bytes());
    p.extend(bytes);
    p.extend(b"tbs.");
    p
}

#[test]
fn arrays_are_as_large_as_their_bytes() {
    assert_eq!(
        kind(read_pickle(&pickled(b"K\x01KH\x86", "f8", &[0; 576]))),
        FaultKind::KeyMissing,
        "sound, but for the rest"
    );
    let shapes: [&[u8]; 8] = [
        b"K\x02KH\x86",
        b"J\x00\x00\x00\x40KH\x86",
        b"J\xff\xff\xff\xffKH\x86",
        b"\x8a\x08\xff\xff\xff\xff\xff\xff\xff\x7f\x8a\x08\xff\xff\xff\xff\xff\xff\xff\x7f\x86",
        b"\x8a\x08\x00\x00\x00\x00\x00\x00\x00\x20\x8a\x01\x08\x86",
        b"\x8a\x09\x00\x00\x00\x00\x00\x00\x00\x00\x01\x85",
        b"N",
        b"N\x85",
    ];
    for shape in shapes {
        assert_eq!(kind(read_pickle(&pickled(shape, "f8", &[0; 576]))), FaultKind::PickleBad, "{shape:?}");
    }
    // any number of elements of no bytes
    assert_eq!(kind(read_pickle(&pickled(b"J\x00\x00\x00\x40\x85", "U0", b""))), FaultKind::PickleBad);
    assert_eq!(kind(read_pickle(&pickled(b"K\x00J\x00\x00\x00\x40\x86", "f8", b""))), FaultKind::KeyMissing);
    assert_eq!(kind(read_pickle(&pickled(b"K\x01\x85", "c8", &[0; 8]))), FaultKind::Dtype);
    check_peak();
}

#[test]
fn pickles_cut_anywhere() {
    for (name, bytes) in golden("aist", "pkl") {
        for n in 0..bytes.len() {
            let e = read_pickle(&bytes[..n]).expect_err(&name);
            assert_eq!(e.fault(), Some(FaultKind::PickleBad), "{name} cut at {n}: {e}");
        }
        assert!(read_pickle(&[&bytes[..], b"what follows is left alone"].concat()).is_ok());
    }
}

static PICKLES: LazyLock<Files> = LazyLock::new(|| golden("aist", "pkl"));

// archives

/// An archive of stored raw entries with correct checksums.
fn archive(entries: &[(&str, &[u8])], method: zip::CompressionMethod) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in entries {
        zip.start_file(*name, SimpleFileOptions::default().compression_method(method)).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

fn npy(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.bytes());
    bytes.extend(data);
    bytes
}

#[test]
fn claims_of_size_are_not_believed() {
    let stored = zip::CompressionMethod::Stored;
    for shape in ["(1000000000, 156)", "(4000000000000000000, 156)", "(99999999999999999999, 1)", "(1,)", "(2, 156)"] {
        let poses = npy("<f8", shape, &[0; 8]);
        let kind = kind(read_npz(&archive(&[("poses.npy", &poses)], stored)));
        assert!(matches!(kind, FaultKind::Truncated | FaultKind::TooLarge | FaultKind::Shape), "{shape}: {kind}");
    }
    let nothing = npy("<U0", "(4000000000000000000,)", b"");
    assert_eq!(kind(read_npz(&archive(&[("poses.npy", &nothing)], stored))), FaultKind::Truncated);
    let header = b"\x93NUMPY\x02\x00\xff\xff\xff\xff{".to_vec();
    assert_eq!(kind(read_npz(&archive(&[("poses.npy", &header)], stored))), FaultKind::Truncated);
    check_peak();
}

#[test]
fn an_archive_that_inflates_without_end() {
    // 200 MiB of zeros in 200 KiB
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    zip.start_file("poses.npy", SimpleFileOptions::default()).unwrap();
    zip.write_all(&npy("<f8", &format!("({}, 156)", (200 << 20) / 1248), b"")).unwrap();
    for _ in 0..200 {
        zip.write_all(&[0; 1 << 20]).unwrap();
    }
    let bytes = zip.finish().unwrap().into_inner();
    assert!(bytes.len() < 1 << 20);
    let e = read_npz(&bytes).unwrap_err();
    assert_eq!(e.fault(), Some(FaultKind::TooLarge), "{e}");
    check_peak();
}

#[test]
fn directories_that_claim_much() {
    let (_, good) = golden("amass", "npz").into_iter().find(|(n, _)| n == "zip64.npz").unwrap();
    let end = good.windows(4).rposition(|w| w == b"PK\x06\x06").unwrap();
    for entries in [1_000u64, 1 << 40, u64::MAX] {
        let mut bytes = good.clone();
        bytes[end + 24..end + 32].copy_from_slice(&entries.to_le_bytes());
        bytes[end + 32..end + 40].copy_from_slice(&entries.to_le_bytes());
        bytes[end + 40..end + 48].copy_from_slice(&u64::MAX.to_le_bytes());
        let e = read_npz(&bytes).unwrap_err();
        assert_eq!(e.fault(), Some(FaultKind::Truncated));
        assert!(e.to_string().contains("more entries than the file has room for"), "{e}");
    }
    for entries in [0u16, 1, 0xfffe] {
        let (_, mut bytes) = golden("amass", "npz").into_iter().find(|(n, _)| n == "stored.npz").unwrap();
        let end = bytes.len() - 22;
        bytes[end + 8..end + 10].copy_from_slice(&entries.to_le_bytes());
        bytes[end + 10..end + 12].copy_from_slice(&entries.to_le_bytes());
        assert!(read_npz(&bytes).is_err());
    }
    check_peak();
}

#[test]
fn archives_cut_anywhere() {
    for (name, bytes) in golden("amass", "npz") {
        for n in 0..bytes.len() {
            let kind = kind(read_npz(&bytes[..n]));
            assert!(matches!(kind, FaultKind::Truncated | FaultKind::NotThisFormat), "{name} cut at {n}: {kind}");
        }
    }
}

#[test]
fn damage_is_seen_by_the_checksum() {
    let (_, mut bytes) = golden("amass", "npz").into_iter().find(|(n, _)| n == "stored.npz").unwrap();
    let inside = bytes.windows(9).position(|w| w == b"poses.npy").unwrap() + 400;
    bytes[inside] ^= 1;
    assert_eq!(kind(read_npz(&bytes)), FaultKind::Truncated);
}

/// Names and contents.
type Files = Vec<(String, Vec<u8>)>;

/// The entries of the golden archives, unpacked.
static ENTRIES: LazyLock<Vec<Files>> = LazyLock::new(|| {
    let unpacked = |(_, bytes): (String, Vec<u8>)| {
        let mut zip = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
        (0..zip.len())
            .map(|i| {
                let mut entry = zip.by_index(i).unwrap();
                let mut bytes = Vec::new();
                entry.read_to_end(&mut bytes).unwrap();
                (entry.name().unwrap().into_owned(), bytes)
            })
            .collect()
    };
    golden("amass", "npz").into_iter().map(unpacked).collect()
});

static ARCHIVES: LazyLock<Files> =
    LazyLock::new(|| golden("amass", "npz").into_iter().chain(golden("body", "npz")).collect());

/// Positions, as fractions of the file, and the bytes put there.
fn edits() -> impl Strategy<Value = Vec<(f64, u8)>> {
    prop::collection::vec((0.0..1.0f64, any::<u8>()), 1..5)
}

fn edit(bytes: &mut [u8], edits: &[(f64, u8)]) {
    for &(at, byte) in edits {
        let at = (at * bytes.len() as f64) as usize;
        bytes[at] = byte;
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, ..ProptestConfig::default() })]

    #[test]
    fn edited_pickles(which: prop::sample::Index, edits in edits()) {
        let mut bytes = which.get(&PICKLES).1.clone();
        edit(&mut bytes, &edits);
        if let Err(e) = read_pickle(&bytes) {
            prop_assert!(!e.to_string().is_empty());
        }
        check_peak();
    }

    #[test]
    fn random_opcodes(bytes in prop::collection::vec(prop::sample::select(b"(]}).01234NKJMXUTSVILFGcRbiotdlaesupqrghj\x80\x85\x86\x87\x88\x89\x8a\x8c\x8e\x93\x94\x95\x96\n\x00\x01\x02numpydtypef8".to_vec()), 0..200)) {
        let _ = Pickle::parse(Path::new("a.pkl"), &bytes);
        let _ = read_pickle(&bytes);
    }

    #[test]
    fn edited_archives(which: prop::sample::Index, edits in edits()) {
        let mut bytes = which.get(&ARCHIVES).1.clone();
        edit(&mut bytes, &edits);
        let _ = read_npz(&bytes);
        let _ = BodyModel::parse(Path::new("b.npz"), &bytes);
        if let Ok(npz) = Npz::open(Path::new("a.npz"), &bytes) {
            for key in npz.keys() {
                let _ = npz.array(key);
            }
        }
        check_peak();
    }

    /// After the checksum, in the arrays themselves; mostly in their headers.
    #[test]
    fn edited_arrays(which: prop::sample::Index, entry: prop::sample::Index, edits in edits()) {
        let mut entries = which.get(&ENTRIES).clone();
        let bytes = &mut entry.get_mut(&mut entries).1;
        let header = bytes.len().min(128);
        edit(&mut bytes[..header], &edits);
        if let Ok(array) = Array::parse(Path::new("a.npy"), "a", bytes) {
            let _ = (array.reals(), array.integers(), array.texts());
        }
        let parts: Vec<(&str, &[u8])> = entries.iter().map(|(n, b)| (n.as_str(), &b[..])).collect();
        let _ = read_npz(&archive(&parts, zip::CompressionMethod::Stored));
        check_peak();
    }
}
