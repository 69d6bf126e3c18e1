//! Files as encoders write them, and as they come after an accident. `scripts/reference/music_sounds.sh` made them.

use kinelm_music::read::{open, samples};
use kinelm_music::{Error, FaultKind, wav};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

fn sound(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/sounds").join(name)
}

/// The script's tone: the mean of both channels, late by some samples.
fn tone(rate: f64, i: f64) -> f64 {
    let t = i / rate;
    if t < 0.0 { 0.0 } else { 0.3 * (TAU * (200.0 + 600.0 * t) * t).sin() }
}

/// The shift in samples at which a file is most like the tone, and the root of the mean square of what differs then.
fn shift(x: &[f32], rate: f64) -> (i32, f64) {
    let off = |shift: i32| {
        let of = |i: usize| (f64::from(x[i]) - tone(rate, i as f64 - f64::from(shift))).powi(2);
        ((3000..8000).map(of).sum::<f64>() / 5000.0).sqrt()
    };
    (-2500..2500).map(|s| (s, off(s))).min_by(|a, b| a.1.total_cmp(&b.1)).unwrap()
}

#[test]
fn each_coding_sounds_as_it_did() {
    // how far a sample may be off in the mean: what the coding itself leaves out
    for (name, loss) in
        [("tone.flac", 2e-5), ("tone-u8.wav", 5e-3), ("tone.ogg", 0.02), ("tone.mp3", 0.02), ("tone.m4a", 0.05)]
    {
        let reader = open(&sound(name)).unwrap();
        assert_eq!((reader.info().rate, reader.info().channels), (22_050, 2), "{name}");
        let x = samples(&sound(name), 22_050).unwrap();
        let (late, off) = shift(&x, 22_050.0);
        println!("{name}: {} samples, {late} late, {off:.1e} off", x.len());
        assert!(off < loss, "{name}: {off}");
        assert_eq!(late, 0, "{name}");
        assert!(x.len().abs_diff(11_025) < 1200, "{name}: {}", x.len());
    }
    for name in ["tone-24.wav", "tone-f32.wav"] {
        let x = samples(&sound(name), 22_050).unwrap();
        let worst = x.iter().enumerate().map(|(i, x)| (f64::from(*x) - tone(22_050.0, i as f64)).abs());
        assert!(x.len() == 2205 && worst.fold(0.0, f64::max) < 1e-6, "{name}");
    }
}

fn refused(path: &Path) -> (FaultKind, String) {
    match samples(path, 22_050).map(|x| x.len()) {
        Err(Error::File(e)) => (e.kind, e.to_string()),
        other => panic!("{}: {other:?}", path.display()),
    }
}

#[test]
fn what_cannot_be_heard_is_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: &[u8]| {
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    assert_eq!(refused(&sound("tone.opus")).0, FaultKind::Opus);
    assert_eq!(refused(&sound("silent.mp4")).0, FaultKind::NoAudioTrack);
    assert_eq!(refused(&put("empty.wav", b"")).0, FaultKind::Empty);
    assert_eq!(refused(&put("text.mp3", "no sound at all ".repeat(99).as_bytes())).0, FaultKind::Unknown);
    assert_eq!(refused(dir.path()).0, FaultKind::Unknown);
    assert_eq!(samples(&dir.path().join("none.wav"), 22_050).unwrap_err().kind(), kinelm_store::Kind::Io);
    let m4a = std::fs::read(sound("tone.m4a")).unwrap();
    let at = m4a.windows(4).position(|w| w == b"mp4a").unwrap();
    let mut protected = m4a.clone();
    protected[at..at + 4].copy_from_slice(b"enca");
    let (kind, text) = refused(&put("bought.m4a", &protected));
    assert_eq!(kind, FaultKind::Protected);
    assert!(
        text.ends_with(
            "bought.m4a: protected: found encrypted sound, expected plain; its shop's own player is the \
                            only one to open it"
        ),
        "{text}"
    );
}

#[test]
fn cut_files_are_refused_wherever_they_are_cut() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["tone.flac", "tone.ogg", "tone.mp3", "tone.m4a", "tone-u8.wav"] {
        let whole = std::fs::read(sound(name)).unwrap();
        let path = dir.path().join(name);
        for share in [0.3, 0.5, 0.7] {
            std::fs::write(&path, &whole[..(whole.len() as f64 * share) as usize]).unwrap();
            let kind = refused(&path).0;
            assert!([FaultKind::Cut, FaultKind::Damaged].contains(&kind), "{name} at {share}: {kind}");
        }
        // any cut and any flipped byte: an answer or an error, never a panic
        for at in (0..whole.len()).step_by(97) {
            std::fs::write(&path, &whole[..at]).unwrap();
            let _ = samples(&path, 22_050);
            let mut flipped = whole.clone();
            flipped[at] ^= 0x55;
            std::fs::write(&path, &flipped).unwrap();
            let _ = samples(&path, 22_050);
        }
    }
}

#[test]
fn a_streamed_wav_whose_length_nobody_knew_ends_where_it_ends() {
    let dir = tempfile::tempdir().unwrap();
    let mut bytes = wav::bytes(&[0.25; 3000], 16_000);
    for at in [4, 40] {
        bytes[at..at + 4].fill(0xff);
    }
    let path = dir.path().join("piped.wav");
    std::fs::write(&path, bytes).unwrap();
    assert_eq!(samples(&path, 16_000).unwrap().len(), 3000);
}

#[test]
fn a_wav_is_read_as_it_was_written() {
    let dir = tempfile::tempdir().unwrap();
    let x: Vec<f32> = (0..5000).map(|i| ((i * 37 % 1000) as f32 / 500.0 - 1.0) * 0.99).collect();
    let path = dir.path().join("x.wav");
    std::fs::write(&path, wav::bytes(&x, 16_000)).unwrap();
    let back = samples(&path, 16_000).unwrap();
    assert_eq!(back.len(), x.len());
    assert!(back.iter().zip(&x).all(|(a, b)| (a - b).abs() <= 0.51 / 32_768.0));
}
