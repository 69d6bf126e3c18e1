//! What a music file holds.

use crate::Result;
use kinelm_music::beat::{Beats, RATE, Tempo, TempoRange, Tracker};
use kinelm_music::read::{Info, decode_at, open};
use kinelm_store::counted;
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// A file, how loud it is, and its beats.
#[derive(Debug, Clone)]
pub struct Report {
    /// The file.
    pub path: PathBuf,
    /// What its header and its samples say.
    pub info: Info,
    /// The greatest sample, without a sign; 1 is full scale.
    pub peak: f32,
    /// The root of the mean square of the samples.
    pub rms: f64,
    /// Its beats.
    pub beats: Beats,
}

/// Odds below which a tempo isn't printed.
const UNLIKELY: f64 = 0.01;

/// Reads a file once; its beats are counted within `range`, where one is given.
///
/// # Errors
/// [`Error::Music`](crate::Error::Music): what is wrong with the file.
pub fn report(path: &Path, range: Option<TempoRange>) -> Result<Report> {
    let rate = open(path)?.info().rate;
    let (mut tracker, mut peak, mut squares) = (Tracker::within(range), 0.0f32, 0.0f64);
    let mut measure = |samples: &[f32]| {
        for x in samples {
            peak = peak.max(x.abs());
            squares += f64::from(*x).powi(2);
        }
        Ok(())
    };
    let mut track = |samples: &[f32]| {
        tracker.push(samples);
        Ok(())
    };
    // one pass decodes for both: loudness at the file's own rate, beats at the tracker's
    let info = decode_at(path, &mut [(rate, &mut measure), (RATE, &mut track)])?;
    let rms = (squares / info.samples.unwrap_or(0).max(1) as f64).sqrt();
    Ok(Report { path: path.into(), info, peak, rms, beats: tracker.finish() })
}

fn decibels(x: f64) -> String {
    if x > 0.0 { format!("{:.1} dB", 20.0 * x.log10()) } else { "silent".into() }
}

impl Report {
    /// How long it is, seconds.
    pub fn seconds(&self) -> f64 {
        self.info.samples.unwrap_or(0) as f64 / f64::from(self.info.rate)
    }

    /// 5th and 95th percentile of the piece's tempi, beats a minute.
    fn tempi(&self) -> Option<[f64; 2]> {
        let mut all = self.beats.tempi_bpm();
        all.sort_by(f64::total_cmp);
        let at = |share: f64| all.get((share * (all.len().max(1) - 1) as f64).round() as usize).copied();
        Some([at(0.05)?, at(0.95)?])
    }

    /// The tempo that is counted, with its odds, and the likeliest other.
    fn tempo(&self) -> Option<(Tempo, Option<Tempo>)> {
        let (bpm, all) = (self.beats.bpm()?, &self.beats.tempi);
        // in octaves: half and double are equally far
        let off = |tempo: &&Tempo| (tempo.bpm / bpm).log2().abs();
        let counted = all.iter().min_by(|a, b| off(a).total_cmp(&off(b)))?;
        let other = all.iter().find(|tempo| *tempo != counted && tempo.odds >= UNLIKELY);
        Some((Tempo { bpm, ..*counted }, other.copied()))
    }

    /// For people.
    pub fn text(&self) -> String {
        let (info, seconds) = (&self.info, self.seconds());
        let mut out = format!("{}\n", self.path.display());
        let length = format!("{}:{:05.2}", (seconds / 60.0) as u64, seconds % 60.0);
        let channels = counted(info.channels, "channels");
        // a string takes whatever is written
        let _ = writeln!(out, "  sound     {length}, {} Hz, {channels}, {}", info.rate, info.container);
        let (peak, rms) = (decibels(f64::from(self.peak)), decibels(self.rms));
        let _ = writeln!(out, "  loudness  {rms} in the mean, {peak} at most");
        let _ = match (self.beats.bpm(), self.tempi()) {
            (Some(bpm), Some([slow, fast])) => {
                let n = counted(self.beats.times_s.len(), "beats");
                let range = if fast - slow < 1.0 { String::new() } else { format!(" ({slow:.0} to {fast:.0})") };
                writeln!(out, "  beats     {n}, {bpm:.1} a minute{range}, the first at {:.2} s", self.beats.times_s[0])
            }
            _ => writeln!(out, "  beats     none found"),
        };
        if let Some((tempo, other)) = self.tempo() {
            let say = |tempo: Tempo| format!("{:.1} a minute ({:.0} %)", tempo.bpm, 100.0 * tempo.odds);
            let other = other.map_or("no other is likely".into(), |other| format!("or {}", say(other)));
            let _ = writeln!(out, "  tempo     {}, {other}", say(tempo));
        }
        out
    }

    /// For programs: one line.
    pub fn json(&self) -> String {
        let tempi = self.tempi();
        let likely = self.beats.tempi.iter().filter(|tempo| tempo.odds >= UNLIKELY);
        let odds: Vec<_> = likely.map(|tempo| json!({"bpm": tempo.bpm, "odds": tempo.odds})).collect();
        let report = json!({
            "schema": 1, "file": self.path, "container": self.info.container, "rate": self.info.rate,
            "channels": self.info.channels, "seconds": self.seconds(), "peak": self.peak, "rms": self.rms,
            "beats": self.beats.times_s.len(), "bpm": self.beats.bpm(), "bpm_range": tempi, "tempi": odds,
            "first_beat_s": self.beats.times_s.first(),
        });
        report.to_string()
    }
}
