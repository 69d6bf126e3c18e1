//! Every fault of a BVH with its position, and arbitrary bytes without a panic.

use kinelm_motion::format::{ReadOptions, Unit, bvh};
use kinelm_motion::{Error, FaultKind, Motion, Result, Source};
use proptest::prelude::*;
use std::path::Path;
use std::time::Instant;

const GOOD: &str = "HIERARCHY
ROOT hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT left leg
  {
    OFFSET 1 -2 .5
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 1e0 0.
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.033333
0 1 2 3 4 5 6 7 8
1 2 3 -4 5.5 6 7 8 9
0.5 1e-3 -0 4 5 6 7 8 +9
";

fn options() -> ReadOptions {
    ReadOptions { unit: Unit::CENTIMETRE, ..Default::default() }
}

fn read(bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
    bvh::read(Path::new("x.bvh"), bytes, options)
}

fn good(text: &str) -> Motion {
    read(text.as_bytes(), &options()).unwrap()
}

/// `GOOD` with the first `from` replaced.
fn with(from: &str, to: &str) -> String {
    assert!(GOOD.contains(from), "{from:?}");
    GOOD.replacen(from, to, 1)
}

fn kinds(motion: &Motion) -> Vec<&'static str> {
    motion.warnings.iter().map(|w| w.kind).collect()
}

#[test]
fn every_fault_has_its_kind_its_place_and_what_was_found() {
    let cases: &[(String, &str, &str)] = &[
        (String::new(), "x.bvh:1:1: not_bvh", "an empty file"),
        ("<!DOCTYPE html><html>".into(), "x.bvh:1:1: not_bvh", "an HTML page"),
        ("version https://git-lfs.github.com/spec/v1".into(), "x.bvh:1:1: not_bvh", "a Git LFS pointer"),
        ("; FBX 7.3.0 project file".into(), "x.bvh:1:1: not_bvh", "an FBX file"),
        ("PK\u{3}\u{4}poses.npy".into(), "x.bvh:1:1: not_bvh", "an npz archive"),
        (with("ROOT hips", "hips"), "x.bvh:2:1: unexpected_word", "found \"hips\", expected ROOT"),
        (with("ROOT hips", "ROOT"), "x.bvh:2:5: unexpected_word", "the end of the line, expected the name of a joint"),
        (with("ROOT hips\n{", "ROOT hips\n"), "x.bvh:4:3: unexpected_word", "expected '{' for \"hips\""),
        (with("End Site", "Tail"), "x.bvh:10:5: unexpected_word", "in \"left leg\" OFFSET and CHANNELS"),
        (with("0.\n    }", "0.\n JOINT x"), "x.bvh:13:2: unexpected_word", "the end site of \"left leg\""),
        (with("  }\n}\nMOTION", "  }\nMOTION"), "x.bvh:15:1: unexpected_word", "'}' for the '{' of \"hips\" at 3:1"),
        (
            GOOD[..GOOD.find("    End").unwrap()].into(),
            "x.bvh:10:1: unexpected_word",
            "'}' for the '{' of \"left leg\" at 7:3",
        ),
        (with("}\nMOTION", "}\n}\nMOTION"), "x.bvh:16:1: unexpected_word", "expected ROOT or MOTION"),
        (with("}\nMOTION", "}\nJOINT a"), "x.bvh:16:1: unexpected_word", "expected ROOT or MOTION"),
        (with("  OFFSET 0 0 0\n", ""), "x.bvh:5:3: offset_missing", "\"hips\" has no OFFSET"),
        (
            with("      OFFSET 0 1e0 0.\n", ""),
            "x.bvh:12:5: offset_missing",
            "the end site of \"left leg\" has no OFFSET",
        ),
        (with("OFFSET 1 -2 .5", "OFFSET 1 -2"), "x.bvh:9:5: offset_short", "\"left leg\" has 2"),
        (with("OFFSET 1 -2 .5", "OFFSET 1 x .5"), "x.bvh:8:14: number_bad", "y of the OFFSET of \"left leg\""),
        (with("OFFSET 1 -2 .5", "OFFSET 1 -2,5 .5"), "x.bvh:8:14: number_bad", "decimal comma"),
        (with("OFFSET 1 -2 .5", "OFFSET 1 nan .5"), "x.bvh:8:14: number_bad", "\"nan\""),
        (with("OFFSET 1 -2 .5", "OFFSET 1 2 3 4"), "x.bvh:8:18: unexpected_word", "\"4\""),
        (with("OFFSET 1 -2 .5", "OFFSET 1 2 3 OFFSET 1 2 3"), "x.bvh:8:18: unexpected_word", "once each"),
        (with("CHANNELS 3 Z", "CHANNELS 3 W"), "x.bvh:9:16: channel_unknown", "\"Wrotation\""),
        (with("CHANNELS 3", "CHANNELS 7"), "x.bvh:9:14: channel_count", "0 to 6"),
        (with("CHANNELS 3", "CHANNELS three"), "x.bvh:9:14: channel_count", "\"three\""),
        (with("CHANNELS 3", "CHANNELS 4"), "x.bvh:10:5: channel_count", "found 3 names, expected 4"),
        (with("CHANNELS 3", "CHANNELS 2"), "x.bvh:9:36: unexpected_word", "more channel names than CHANNELS says"),
        (with("3 Zrotation Xrotation", "3 Zrotation ZROTATION"), "x.bvh:9:26: channel_repeated", "\"ZROTATION\""),
        (with("Frames: 3\n", ""), "x.bvh:17:1: frames_missing", "\"Frame\""),
        (with("Frames: 3", "Frames: many"), "x.bvh:17:9: number_bad", "\"many\""),
        (with("Frames: 3", "Frames: 3 4"), "x.bvh:17:11: unexpected_word", "\"4\""),
        (with("Frame Time: 0.033333\n", ""), "x.bvh:18:1: frame_time_missing", "\"0\""),
        (with("0.033333", "0"), "x.bvh:18:13: frame_time_bad", "seconds from 0.0001 to 1"),
        (with("0.033333", "-0.1"), "x.bvh:18:13: frame_time_bad", "\"-0.1\""),
        (with("0.033333", "30"), "x.bvh:18:13: frame_time_bad", "if 30 is a rate, write 0.033333"),
        (with("0.033333", "inf"), "x.bvh:18:13: frame_time_bad", "\"inf\""),
        (with("0.033333", "0,033"), "x.bvh:18:13: frame_time_bad", "decimal comma"),
        (
            with("5.5", "5,5"),
            "x.bvh:20:10: number_bad",
            "frame 1, joint \"hips\", channel Xrotation; this looks like a decimal",
        ),
        (with("5.5", "NaN"), "x.bvh:20:10: number_bad", "found \"NaN\", expected a finite number for frame 1"),
        (with("7 8 9", "7 1.#QNAN 9"), "x.bvh:20:18: number_bad", "joint \"left leg\", channel Xrotation"),
        (with("7 8 9", "7 8 1e999"), "x.bvh:20:20: number_bad", "joint \"left leg\", channel Yrotation"),
        (with("1 2 3 -4", "# 2 3 -4"), "x.bvh:20:1: unexpected_word", "BVH has no comments"),
        (with("1 2 3 -4", "2 3 -4"), "x.bvh:20:1: row_width", "found 8 numbers in row 1, expected 9"),
        (with("1 2 3 -4", "0 1 2 3 -4"), "x.bvh:20:1: row_width", "found 10 numbers in row 1, expected 9"),
        (with("Frames: 3", "Frames: 4"), "x.bvh:22:1: frames_short", "found 3 rows, expected 4 rows"),
        (
            with("Frames: 3", "Frames: 0"),
            "x.bvh:17:9: frames_zero",
            "found Frames: 0 before 3 rows, expected Frames: 3",
        ),
        (with("7 8 +9\n", "7"), "x.bvh:21:20: frames_short", "found 2 rows and 7 of the 9 numbers of another"),
        (with("7 8 +9\n", "7 8 +"), "x.bvh:21:24: frames_short", "found 2 rows and 8 of the 9 numbers of another"),
        (with("Frames: 3", "Frames: 1000000000"), "x.bvh:17:9: too_large", "1000000000 frames of 9 channels"),
        (
            with("Frames: 3", "Frames: 99999999999999999999999"),
            "x.bvh:17:9: too_large",
            "99999999999999999999999 frames",
        ),
        (with("+9\n", "+9\njunk\n"), "x.bvh:22:1: unexpected_word", "the end of the file after 3 frames"),
    ];
    for (text, starts, contains) in cases {
        let e = read(text.as_bytes(), &options()).expect_err(starts).to_string();
        assert!(e.starts_with(starts) && e.contains(contains), "wanted {starts} .. {contains}, got\n{e}");
    }
}

#[test]
fn odd_files_are_read_and_said() {
    assert_eq!(kinds(&good(GOOD)), [""; 0]);
    let cases: &[(String, &[&str])] = &[
        (with("ROOT hips", "# made by hand\n // twice\nROOT hips"), &["comment_skipped"]),
        (with("JOINT left leg", "JOINT hips"), &["duplicate_name"]),
        (
            with("    CHANNELS 3 Zrotation Xrotation Yrotation\n", "")
                .replace(" 6 7 8\n", " \n")
                .replace(" 7 8 9\n", "\n")
                .replace(" 7 8 +9", ""),
            &["no_channels"],
        ),
        (with("    End Site\n    {\n      OFFSET 0 1e0 0.\n    }\n", ""), &["missing_end_site"]),
        (with("1 2 3 -4", "1 2 3\n-4"), &["rows_wrapped"]),
        (with("Frames: 3", "Frames: 2"), &["more_rows"]),
        (GOOD[..GOOD.find("\n0 1 2").unwrap() + 1].replace("Frames: 3", "Frames: 0"), &["no_frames"]),
    ];
    for (text, want) in cases {
        assert_eq!(&kinds(&good(text)), want, "{text}");
    }
    let wrapped = good(&GOOD.replacen("1 2 3 -4 5.5 6", "1 2\n3 -4 5.5\n\n6", 1));
    assert_eq!(wrapped.clip, good(GOOD).clip);
    assert_eq!(good(&with("JOINT left leg", "JOINT hips")).clip.skeleton().names()[1], "hips.2");
}

#[test]
fn the_same_file_in_other_clothes() {
    let want = good(GOOD);
    let mut mixed = String::from("\u{FEFF}");
    for (i, line) in GOOD.lines().enumerate() {
        mixed += line;
        mixed += ["\r\n", "\n", "\r", "  \n\n"][i % 4];
    }
    for text in [
        mixed,
        GOOD.replace('\n', "\r"),
        GOOD.replace('\n', "\r\n"),
        GOOD.to_lowercase(),
        GOOD.replace("HIERARCHY", "hierarchy").replace("rotation", "ROTATION").replace("End Site", "END SITE"),
        GOOD.replace("End Site", "End"),
        GOOD.replace("End Site", "End Site toes"),
        GOOD.replace("\n{", "{").replace("left leg\n  {", "left leg {"),
        with("Frames: 3", "Frames :\t3\t").replace("Frame Time:", "FrameTime  : "),
        with("Frames: 3", "Frames 3").replace("Frame Time:", "frame time"),
        with("  OFFSET 0 0 0\n", "").replace("Yrotation\n  JOINT", "Yrotation OFFSET 0 0 0 JOINT"),
        GOOD.trim_end().into(),
        GOOD.to_owned() + "\n \t\n",
    ] {
        let m = good(&text);
        assert_eq!(m.clip, want.clip, "{text}");
        let again = bvh::to_bytes(&m).unwrap();
        let back = read(&again, &options()).unwrap();
        assert_eq!(bvh::to_bytes(&back).unwrap(), again, "{text}");
    }
}

#[test]
fn names_may_be_latin_1_and_are_written_back_as_found() {
    let bytes: Vec<u8> = GOOD.replace("left leg", "H~fte").bytes().map(|b| if b == b'~' { 0xFC } else { b }).collect();
    let m = read(&bytes, &options()).unwrap();
    assert_eq!(m.clip.skeleton().names()[1], "Hüfte");
    assert!(bvh::to_bytes(&m).unwrap().windows(5).any(|w| w == b"H\xFCfte"));
    assert_eq!(good(&GOOD.replace("left leg", "Hüfte")).clip.skeleton().names()[1], "Hüfte");
    // columns count characters, not bytes
    let e = read(&[&bytes[..], b"\xFC\xFC x"].concat(), &options()).unwrap_err().to_string();
    assert!(e.starts_with("x.bvh:22:1: unexpected_word: found \"üü\""), "{e}");
}

#[test]
fn the_header_is_written_back_byte_for_byte() {
    let text = with("ROOT hips", "# a comment\r\nROOT hips")
        .replace("Frames: 3\n", "Frames:\t3 \r\n")
        .replace("JOINT left leg", "JOINT  hips");
    let m = good(&text);
    let written = String::from_utf8(bvh::to_bytes(&m).unwrap()).unwrap();
    let head = |t: &str| t[..t.find("0.033333").unwrap()].replace("3 \r\n", "3\r\n");
    assert_eq!(head(&written).replace(" \r", "\r"), head(&text));
    let Source::Bvh(source) = &m.source else { panic!("a BVH") };
    assert_eq!((source.frames, source.numbers.len(), source.head.nodes[1].name.as_str()), (3, 27, "hips"));
}

#[test]
fn a_cut_file_gives_its_whole_rows_when_asked() {
    let lenient = ReadOptions { lenient: true, ..options() };
    for (text, rows) in [
        (with("7 8 +9\n", "7 8 +"), 2),
        (with("Frames: 3", "Frames: 5"), 3),
        (with("Frames: 3", "Frames: 0"), 3),
        (with("Frames: 3", "Frames: 1000000000"), 3),
        (with("+9\n", "+9\njunk\n"), 3),
        (GOOD[..GOOD.find("\n0 1 2").unwrap() + 4].into(), 0),
    ] {
        let m = read(text.as_bytes(), &lenient).unwrap();
        assert_eq!((m.clip.frames(), m.warnings.len()), (rows, 1), "{text}");
    }
    let e = read(with("1 2 3 -4", "2 3 -4").as_bytes(), &lenient).unwrap_err();
    assert_eq!(e.fault(), Some(FaultKind::RowWidth), "a wrong row is no cut");
}

#[test]
fn a_billion_frames_or_deep_nesting_cost_nothing() {
    let start = Instant::now();
    // one channel: the declared numbers stay below the limit of 2^31
    let one = "HIERARCHY\nROOT a { OFFSET 0 0 0 CHANNELS 1 Xrotation End Site { OFFSET 0 1 0 } }\nMOTION\nFrames: 1000000000\nFrame Time: 0.01\n1\n2\n";
    assert_eq!(read(one.as_bytes(), &options()).unwrap_err().fault(), Some(FaultKind::FramesShort));
    let none = one.replace("CHANNELS 1 Xrotation", "CHANNELS 0").replace("1\n2\n", "");
    assert_eq!(read(none.as_bytes(), &options()).unwrap_err().fault(), Some(FaultKind::FramesShort));

    let deep = |n: usize| {
        let opens: String =
            (0..n).map(|i| format!("{} j{i} {{ OFFSET 0 0 0\n", if i == 0 { "ROOT" } else { "JOINT" })).collect();
        format!("HIERARCHY\n{opens}{}MOTION\nFrames: 0\nFrame Time: 0.01\n", "}".repeat(n))
    };
    assert_eq!(read(deep(100_000).as_bytes(), &options()).unwrap_err().fault(), Some(FaultKind::TooDeep));
    assert_eq!(read(deep(513).as_bytes(), &options()).unwrap_err().fault(), Some(FaultKind::TooDeep));
    assert_eq!(good(&deep(512)).clip.joints(), 512);

    let wide = |n: usize| {
        let joints = "JOINT same { OFFSET 0 0 0 End { OFFSET 0 0 0 } }\n".repeat(n - 1);
        format!("HIERARCHY\nROOT r {{ OFFSET 0 0 0\n{joints}}}\nMOTION\nFrames: 0\nFrame Time: 0.01\n")
    };
    assert_eq!(good(&wide(4096)).clip.joints(), 4096);
    assert_eq!(read(wide(4097).as_bytes(), &options()).unwrap_err().fault(), Some(FaultKind::TooLarge));
    let ends = format!("HIERARCHY\nROOT r {{ OFFSET 0 0 0\n{}", "#\nEnd { OFFSET 0 0 0 }\n".repeat(200_000));
    assert_eq!(read(ends.as_bytes(), &options()).unwrap_err().fault(), Some(FaultKind::UnexpectedWord));
    // with overflow checks and little optimisation everything takes longer
    let most = if cfg!(debug_assertions) { 10.0 } else { 2.0 };
    assert!(start.elapsed().as_secs_f64() < most, "{:?}", start.elapsed());
}

#[test]
fn every_cut_gives_an_error_or_a_clip() {
    for text in [GOOD.to_owned(), GOOD.replace('\n', "\r\n")] {
        for end in 0..text.len() {
            let cut = &text.as_bytes()[..end];
            match read(cut, &options()) {
                // only the end of the last number or line is missing
                Ok(m) => assert!(m.clip.frames() == 3 && end + 4 > text.len(), "{end}"),
                Err(Error::File(e)) => assert!(e.at.line > 0 && !e.found.is_empty() && !e.expected.is_empty()),
                Err(e) => panic!("{end}: {e}"),
            }
            if let Ok(m) = read(cut, &ReadOptions { lenient: true, ..options() }) {
                assert!(m.clip.frames() <= 3);
            }
        }
    }
}

#[test]
fn skipping_slices_the_numbers_with_the_clip() {
    let skip = |n| read(GOOD.as_bytes(), &ReadOptions { skip: n, ..options() });
    let whole = good(GOOD);
    for n in 0..3 {
        let m = skip(n).unwrap();
        let Source::Bvh(source) = &m.source else { panic!("a BVH") };
        assert_eq!(m.clip, whole.clip.slice(n..3));
        assert!(source.is_untouched(&m.clip));
        let slice = whole.clone().slice(n..3);
        assert_eq!(bvh::to_bytes(&slice).unwrap(), bvh::to_bytes(&m).unwrap());
    }
    for n in [3, 4, usize::MAX] {
        let e = skip(n).unwrap_err().to_string();
        assert!(e.contains("there are 3"), "{e}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn edited_bytes_never_panic(edits in prop::collection::vec((0..GOOD.len(), any::<u8>()), 1..6), lenient in any::<bool>()) {
        let mut bytes = GOOD.as_bytes().to_vec();
        edits.iter().for_each(|&(at, b)| bytes[at] = b);
        check(&bytes, lenient);
    }

    #[test]
    fn moved_pieces_never_panic(a in 0..GOOD.len(), b in 0..GOOD.len(), to in 0..GOOD.len(), lenient in any::<bool>()) {
        let piece = &GOOD.as_bytes()[a.min(b)..a.max(b)];
        let (front, back) = GOOD.as_bytes().split_at(to);
        check(&[front, piece, back].concat(), lenient);
        check(&[&GOOD.as_bytes()[..a.min(b)], &GOOD.as_bytes()[a.max(b)..]].concat(), lenient);
    }

    #[test]
    fn junk_never_panics(junk in prop::collection::vec(any::<u8>(), 0..300), header in any::<bool>()) {
        let front = if header { "HIERARCHY\nROOT " } else { "" };
        check(&[front.as_bytes(), &junk].concat(), false);
    }

    #[test]
    fn numbers_are_those_of_the_standard_library(
        numbers in prop::collection::vec(
            "[+-]?([0-9]{1,20}\\.?[0-9]{0,20}|\\.[0-9]{1,12})(e[+-]?[0-9]{1,2}|E-[0-9]{1,3})?", 9..90),
    ) {
        let rows: Vec<String> = numbers.chunks_exact(9).map(|r| r.join(" ")).collect();
        let text = format!("{}{}\n", &with("Frames: 3", &format!("Frames: {}", rows.len()))[..GOOD.find("0 1 2 3 4 5").unwrap()], rows.join("\n"));
        let text = text.replacen("0.033333\n", "0.05\n", 1);
        let head = bvh::parse_header(Path::new("x"), text.as_bytes(), &options()).unwrap();
        let want: Vec<f64> = rows.iter().flat_map(|r| r.split(' ')).map(|w| w.parse().unwrap()).collect();
        match head.rows(Path::new("x"), text.as_bytes(), &options()) {
            Ok((got, _)) => prop_assert!(got.iter().map(|v| v.to_bits()).eq(want.iter().map(|v| v.to_bits()))),
            Err(e) => prop_assert!(want.iter().any(|v| !v.is_finite()), "{}", e),
        }
    }
}

/// Arbitrary bytes don't panic, and what is read can be written and read again.
fn check(bytes: &[u8], lenient: bool) {
    let options = ReadOptions { lenient, ..options() };
    if let Ok(m) = read(bytes, &options) {
        let written = bvh::to_bytes(&m).unwrap();
        let again = read(&written, &options).unwrap();
        assert_eq!(again.clip.frames(), m.clip.frames());
        assert_eq!(bvh::to_bytes(&again).unwrap(), written);
        let _ = bvh::positions(Path::new("x.bvh"), bytes, &options).unwrap();
    }
}
