//! Features against librosa's figures (`scripts/reference/music_features.py`).

use kinelm_music::feature::{CEPSTRUM, CHANNELS, CHROMA, PEAK, STRENGTH, features_of};
use kinelm_music::stft::{BINS, COLUMNS, Form, Stft};
use serde_json::Value;
use std::f64::consts::TAU;

/// Decibels: librosa's transforms are f32 as ours.
const STRENGTH_OFF: f64 = 1e-4;
/// Decibels of up to some hundred.
const CEPSTRUM_OFF: f64 = 5e-3;
/// Of 1. librosa leaves a hundredth of each kernel's spectrum out, and a class near a step of its level may fall on its
/// other side.
const CHROMA_OFF: f64 = 4e-2;
/// Of the greatest magnitude of a frame.
const STFT_OFF: f64 = 1e-5;

fn golden() -> Value {
    serde_json::from_str(include_str!("golden/features.json")).unwrap()
}

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

/// The script's piece.
fn piece(rate: u32, seconds: u32) -> Vec<f32> {
    let mut state = 12_345u64;
    let mut noise = || {
        state = (state * 1_103_515_245 + 12_345) % (1 << 31);
        state as f64 / (1u64 << 30) as f64 - 1.0
    };
    let chords = [(0.0, [60, 64, 67]), (1.5, [57, 60, 64]), (3.0, [53, 57, 60]), (4.5, [55, 59, 62])];
    (0..seconds * rate)
        .map(|i| {
            let t = f64::from(i) / f64::from(rate);
            let mut y = 0.3 * (-60.0 * (t % 0.5)).exp() * noise();
            for (start, notes) in chords.iter().filter(|(start, _)| (*start..start + 1.5).contains(&t)) {
                for note in notes.iter().copied().chain([notes[0] - 24]) {
                    let hz = 440.0 * 2f64.powf((f64::from(note) - 69.0 + 0.06) / 12.0);
                    for h in [1.0, 2.0, 3.0] {
                        y += 0.08 / h * (-1.2 * (t - start)).exp() * (TAU * h * hz * t).sin();
                    }
                }
            }
            y as f32
        })
        .collect()
}

#[test]
fn features_are_those_of_librosa() {
    let golden = golden();
    for case in golden["cases"].as_array().unwrap() {
        let fps = case["fps"].as_f64().unwrap();
        let found = features_of(&piece(512 * fps as u32, golden["seconds"].as_u64().unwrap() as u32), fps).unwrap();
        assert_eq!(found.frames() as u64, case["frames"].as_u64().unwrap());
        let row = |f: usize| &found.numbers[f * CHANNELS..][..CHANNELS];
        let mut worst = [0.0f64; 3];
        for (i, f) in numbers(&case["at"]).iter().enumerate() {
            let row = row(*f as usize);
            let wanted = [vec![numbers(&case["strength"])[i]], numbers(&case["mfcc"][i]), numbers(&case["chroma"][i])];
            for (w, (wanted, range)) in worst.iter_mut().zip(wanted.iter().zip([STRENGTH..1, CEPSTRUM, CHROMA])) {
                let off = row[range].iter().zip(wanted).map(|(a, b)| (f64::from(*a) - b).abs());
                *w = off.fold(*w, f64::max);
            }
        }
        println!("{fps} frames per second: off by at most {worst:?}");
        assert!(worst[0] < STRENGTH_OFF && worst[1] < CEPSTRUM_OFF && worst[2] < CHROMA_OFF, "{fps}: {worst:?}");
        let peaks: Vec<f64> = (0..found.frames()).filter(|f| row(*f)[PEAK] == 1.0).map(|f| f as f64).collect();
        assert_eq!(peaks, numbers(&case["peaks"]));
    }
}

#[test]
fn the_dissertations_frames_are_those_of_librosa() {
    let golden = golden();
    let (x, mut found) = (piece(16_000, golden["seconds"].as_u64().unwrap() as u32), Vec::new());
    let mut stft = Stft::new(Form::Compat, 30.0).unwrap();
    let mut keep = |frame: &[f32]| {
        found.push(frame.to_vec());
        Ok(())
    };
    stft.push(&x, &mut keep).unwrap();
    stft.finish(&mut keep).unwrap();
    for case in golden["stft"].as_array().unwrap() {
        let frame = &found[case["frame"].as_u64().unwrap() as usize];
        let greatest = frame.iter().copied().fold(0.0, f32::max);
        for column in 0..COLUMNS {
            for (k, wanted) in numbers(&case["columns"][column]).iter().enumerate() {
                let off = (f64::from(frame[column * BINS + 64 * k]) - wanted).abs();
                assert!(off < STFT_OFF * f64::from(greatest) + 1e-5, "column {column}, bin {}: {off}", 64 * k);
            }
        }
    }
}
