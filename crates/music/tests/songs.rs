//! Songs as they are sold: frames without a length, tags at both ends, several songs in one file, edit lists. Clicks and lengths are
//! those of ffmpeg's decode. `scripts/reference/music_sounds.sh` made the files.

use kinelm_music::FaultKind;
use kinelm_music::read::{open, samples};
use std::f64::consts::TAU;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Samples by which a mp3 without a LAME tag is late: the encoder's 576 and the decoder's 529.
const LATE: f64 = 1105.0;

fn sound(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/sounds").join(name)
}

/// The sound of a file at its own rate.
fn decode(path: &Path) -> (Vec<f32>, f64) {
    let rate = open(path).unwrap().info().rate;
    (samples(path, rate).unwrap(), f64::from(rate))
}

/// Asserts that the clicks with these numbers, one every quarter of a second after `first_s`, stand where they should to 0.5 ms.
fn assert_clicks(name: &str, (x, rate): (&[f32], f64), first_s: f64, clicks: Range<usize>) {
    for click in clicks {
        let due = (first_s + 0.25 * click as f64) * rate;
        // a click is two periods of 1 kHz; it stands where the sound is most like it
        let likeness = |at: f64| -> f64 {
            let sample = |i: f64| x.get((at + i).round() as usize).copied().map_or(0.0, f64::from);
            (0..(rate * 2e-3) as usize).map(|i| (TAU * 1e3 * i as f64 / rate).sin() * sample(i as f64)).sum()
        };
        let reach = (0.05 * rate) as i32;
        let late =
            (-reach..reach).max_by(|a, b| likeness(due + f64::from(*a)).total_cmp(&likeness(due + f64::from(*b))));
        let late_ms = f64::from(late.unwrap()) / rate * 1e3;
        assert!(late_ms.abs() <= 0.5, "{name}: click {click} is {late_ms} ms late");
    }
}

#[test]
fn songs_without_a_stated_length_are_whole() {
    // loud and quiet beginnings mislead a guess from the first frames, either way
    let late = LATE / 22_050.0;
    for (name, expected, first_s, clicks) in [
        ("v2-loud.mp3", 45_504, late, 3..8),
        ("v2-quiet.mp3", 45_504, late, 0..5),
        ("abr-loud.mp3", 45_504, late, 3..8),
        ("abr-quiet.mp3", 45_504, late, 0..5),
        ("cbr.mp3", 33_408, LATE / 16_000.0, 0..8),
        ("loud.aac", 46_080, 1024.0 / 22_050.0, 3..8),
    ] {
        assert_eq!(open(&sound(name)).unwrap().info().samples, None, "{name}");
        let (x, rate) = decode(&sound(name));
        assert_eq!(x.len(), expected, "{name}");
        assert_clicks(name, (&x, rate), first_s, clicks);
    }
}

#[test]
fn a_length_stated_by_vbri_counts() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("vbri.mp3");
    let song = std::fs::read(sound("cbr.mp3")).unwrap();
    // its 58 frames have 72 bytes; a frame before them, empty but for the tag
    let mut frame = [&song[..4], &[0; 32], b"VBRI", &[0, 1, 0, 0, 0, 0]].concat();
    frame.extend((song.len() as u32 + 72).to_be_bytes());
    frame.extend(58_u32.to_be_bytes());
    frame.resize(72, 0);
    std::fs::write(&path, [&frame[..], &song].concat()).unwrap();
    assert_eq!(open(&path).unwrap().info().samples, Some(33_408));
    assert_eq!(decode(&path).0.len(), 33_408);
    std::fs::write(&path, [&frame[..], &song[..song.len() / 2]].concat()).unwrap();
    assert_eq!(samples(&path, 16_000).unwrap_err().fault(), Some(FaultKind::Cut));
}

#[test]
fn an_aac_of_uneven_frames_is_whole() {
    let bytes = std::fs::read(sound("loud.aac")).unwrap();
    let mut frames = Vec::new();
    let mut rest = &bytes[..];
    while let [0xff, 0xf1, _, a, b, c, ..] = rest {
        let size = (usize::from(a & 3) << 11) + (usize::from(*b) << 3) + usize::from(c >> 5);
        frames.push(&rest[..size]);
        rest = &rest[size..];
    }
    frames.sort_by_key(|frame| frame.len());
    // a guess from the frames at each quarter of the file sees the short ones only
    let quarter = [frames[0].repeat(110), frames[frames.len() - 1].repeat(40)].concat();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("uneven.aac");
    std::fs::write(&path, quarter.repeat(4)).unwrap();
    assert_eq!(decode(&path).0.len(), 4 * 150 * 1024);
}

/// An APEv2 tag with a picture, whose bytes look like frames here and there.
fn ape(picture: usize) -> Vec<u8> {
    let mut items = Vec::new();
    for (key, value) in [("Artist", b"Nobody".to_vec()), ("Cover Art (front)", noise(picture))] {
        items.extend((value.len() as u32).to_le_bytes());
        items.extend([0; 4]);
        items.extend([key.as_bytes(), &[0], &value].concat());
    }
    let size = (items.len() as u32 + 32).to_le_bytes();
    let ends = |flags: u32| {
        [&b"APETAGEX"[..], &2000_u32.to_le_bytes(), &size, &2_u32.to_le_bytes(), &flags.to_le_bytes(), &[0; 8]].concat()
    };
    [ends(0xa000_0000), items, ends(0x8000_0000)].concat()
}

fn noise(bytes: usize) -> Vec<u8> {
    let mut state = 1_u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    (0..bytes).map(|_| next()).collect()
}

#[test]
fn tags_at_both_ends_are_no_sound() {
    let dir = tempfile::tempdir().unwrap();
    let bare = std::fs::read(sound("cbr.mp3")).unwrap();
    let (whole, _) = decode(&sound("cbr.mp3"));
    // 300,000 bytes in seven bits each
    let id3 = [b"ID3\x04\0\0", &[0, 18, 39, 96][..], &noise(300_000)].concat();
    let id3v1 = [b"TAG", &noise(125)[..]].concat();
    let lyrics = b"LYRICSBEGIN[00:00]\xff\xfb\x90LYRICS200";
    let lyrics = [&lyrics[..lyrics.len() - 9], b"000021LYRICS200"].concat();
    for (name, before, after) in [
        ("small.mp3", &[][..], ape(0)),
        ("cover.mp3", &[], ape(200_000)),
        ("all.mp3", &id3, [ape(100_000), lyrics, id3v1].concat()),
    ] {
        let path = dir.path().join(name);
        std::fs::write(&path, [before, &bare, &after].concat()).unwrap();
        let (x, _) = decode(&path);
        assert!(x == whole, "{name}: {} samples, expected the {} without tags", x.len(), whole.len());
    }
}

#[test]
fn a_cut_song_begins_where_its_delay_says() {
    // ffmpeg leaves the checksum of the whole song
    let (x, rate) = decode(&sound("cut.mp3"));
    assert_eq!(x.len(), 33_621);
    assert_clicks("cut.mp3", (&x, rate), 546.5 / 22_050.0, 0..6);
}

#[test]
fn several_songs_in_one_file_are_all_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("two.mp3");
    let one = std::fs::read(sound("tone.mp3")).unwrap();
    std::fs::write(&path, [&one[..], &one].concat()).unwrap();
    let (x, _) = decode(&path);
    assert_eq!(x.len(), 24_815);
    // the second tone follows 22 frames of the first and the silent frame of its own tag
    let (tone, _) = decode(&sound("tone.mp3"));
    let second = x[23 * 576..].iter().zip(&tone).skip(1000);
    let worst = second.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-3, "the second tone is {worst} off");
    // cut within the second song
    std::fs::write(&path, [&one[..], &one[..one.len() / 2]].concat()).unwrap();
    assert_eq!(samples(&path, 22_050).unwrap_err().fault(), Some(FaultKind::Cut));
}

/// An m4a whose sound has these edits of (duration in ms, time in samples).
fn with_edits(m4a: &[u8], version: u8, edits: &[(u64, i64)]) -> Vec<u8> {
    let list: Vec<u8> = edits
        .iter()
        .flat_map(|(duration, time)| {
            let wide = [duration.to_be_bytes(), time.to_be_bytes()];
            let from = if version == 1 { 0 } else { 4 };
            [&wide[0][from..], &wide[1][from..], &[0, 1, 0, 0]].concat()
        })
        .collect();
    let size = |n: usize| (n as u32).to_be_bytes();
    let elst = [&size(list.len() + 16)[..], b"elst", &[version, 0, 0, 0], &size(edits.len()), &list].concat();
    let edts = [&size(elst.len() + 8)[..], b"edts", &elst].concat();
    let at = |kind: &[u8]| m4a.windows(4).position(|w| w == kind).unwrap() - 4;
    let length = |at: usize| u32::from_be_bytes(m4a[at..at + 4].try_into().unwrap()) as usize;
    let old = at(b"edts");
    let mut out = [&m4a[..old], &edts, &m4a[old + length(old)..]].concat();
    // the tables stand after the sound, so its positions stay
    assert!(at(b"mdat") < at(b"moov"));
    for outer in [at(b"moov"), at(b"trak")] {
        let new = length(outer) + edts.len() - length(old);
        out[outer..outer + 4].copy_from_slice(&size(new));
    }
    out
}

#[test]
fn an_mp4_begins_where_the_edits_of_its_sound_say() {
    // the picture's edits are others, and stand first
    let (x, rate) = decode(&sound("picture.mp4"));
    assert_clicks("picture.mp4", (&x, rate), 0.0, 1..8);

    let dir = tempfile::tempdir().unwrap();
    let m4a = std::fs::read(sound("tone.m4a")).unwrap();
    let (whole, _) = decode(&sound("tone.m4a"));
    let silence = vec![0.0; 5512];
    for (name, version, edits, expected) in [
        ("v0.m4a", 0, &[(500, 1024)][..], whole.clone()),
        ("v1.m4a", 1, &[(500, 1024)], whole.clone()),
        ("empty-v0.m4a", 0, &[(250, -1), (500, 1024)], [&silence[..], &whole].concat()),
        ("empty-v1.m4a", 1, &[(250, -1), (500, 1024)], [&silence[..], &whole].concat()),
        ("later.m4a", 1, &[(300, 4024)], whole[3000..].to_vec()),
    ] {
        let path = dir.path().join(name);
        std::fs::write(&path, with_edits(&m4a, version, edits)).unwrap();
        let (x, _) = decode(&path);
        // 250 ms are 5512.5 samples
        let x = if name.starts_with("empty") { &x[x.len() - expected.len()..] } else { &x[..] };
        assert!(x == expected, "{name}: {} samples, expected {}", x.len(), expected.len());
    }
    // a silence that no song has
    let path = dir.path().join("never.m4a");
    std::fs::write(&path, with_edits(&m4a, 1, &[(1 << 50, -1), (500, 1024)])).unwrap();
    let e = samples(&path, 22_050).unwrap_err();
    assert!(e.to_string().contains("of silence before the sound, expected 3600 s at most"), "{e}");
}
