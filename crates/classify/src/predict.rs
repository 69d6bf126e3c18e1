//! Classes of a motion file, as a whole and second by second.

use super::Classifier;
use super::class_scores::{ClassScores, likeliest, normalised};
use crate::{Error, Result};
use kinelm_corpus::load::ModelClip;
use kinelm_motion::Motion;
use kinelm_motion::format::ReadOptions;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

/// The classes of a file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Prediction {
    /// The file.
    pub file: PathBuf,
    /// Its length.
    pub seconds: f64,
    /// One per field.
    pub fields: Vec<FieldPrediction>,
}

/// The class of one field.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FieldPrediction {
    /// The field.
    pub field: String,
    /// The most likely class.
    pub class: String,
    /// Probabilities, the largest first.
    pub probabilities: Vec<(String, f64)>,
    /// For every second the most likely class of the windows that show it, and its probability.
    pub strip: Vec<(String, f64)>,
}

impl Classifier {
    /// Classifies a motion file of any rig.
    ///
    /// # Errors
    /// A file that can't be read or retargeted, or has no whole word.
    pub fn predict(&mut self, path: &Path, options: &ReadOptions) -> Result<(Motion, Prediction)> {
        let placed = ModelClip::load(path, options, self.tokenizer.config().into())?;
        let (clip, motion) = (placed.lowered(), placed.motion);
        let words = self.tokenizer.encode(&clip)?.words;
        let none = || {
            let (found, expected) = (format!("{} frames", motion.clip.frames()), "at least one whole word of motion");
            Error::file(path, found, expected, "give a longer clip")
        };
        if words.is_empty() || motion.clip.frames() == 0 {
            return Err(none());
        }
        let (windows, all) = self.classify_words(&words)?;
        let all = all.ok_or_else(none)?;
        let second = self.tokenizer.fps() / self.tokenizer.frames_per_word() as f64;
        let fields = self.manifest.fields.0.iter().enumerate().map(|(table, field)| {
            let of = |log_p: &[f64]| {
                let at = likeliest(log_p);
                (field.classes[at].clone(), log_p[at].exp())
            };
            let mut probabilities: Vec<(String, f64)> =
                field.classes.iter().cloned().zip(all.log_p[table].iter().map(|l| l.exp())).collect();
            probabilities.sort_by(|a, b| b.1.total_cmp(&a.1));
            FieldPrediction {
                field: field.name.clone(),
                class: of(&all.log_p[table]).0,
                probabilities,
                strip: seconds(&windows, table, second).iter().map(|l| of(l)).collect(),
            }
        });
        let seconds = motion.clip.frames() as f64 / motion.clip.fps();
        let prediction = Prediction { file: path.into(), seconds, fields: fields.collect() };
        Ok((motion, prediction))
    }
}

/// For each second of a clip, `second` words long, the mean ln p of the windows that show some of it.
fn seconds(windows: &[ClassScores], table: usize, second: f64) -> Vec<Vec<f64>> {
    let words = windows.last().map_or(0, |w| w.words.end);
    let count = (words as f64 / second).ceil() as usize;
    let one = |s: usize| {
        let (from, to) = (s as f64 * second, (s + 1) as f64 * second);
        // half open: a window that ends where the second begins shows nothing of it
        let shows = |w: &&ClassScores| (w.words.start as f64) < to && w.words.end as f64 > from;
        let some: Vec<&ClassScores> = windows.iter().filter(shows).collect();
        let classes = windows[0].log_p[table].len();
        let mean = |class: usize| some.iter().map(|w| w.log_p[table][class]).sum::<f64>() / some.len().max(1) as f64;
        normalised((0..classes).map(mean).collect())
    };
    (0..count).map(one).collect()
}

impl fmt::Display for Prediction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} ({:.1} s)", self.file.display(), self.seconds)?;
        self.fields.iter().try_for_each(|field| write!(f, "{field}"))
    }
}

/// `genre: salsa 91.2 %, martial 6.0 %`, and a letter per second.
impl fmt::Display for FieldPrediction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shares: Vec<String> = self.probabilities.iter().map(|(c, p)| format!("{c} {:.1} %", 100.0 * p)).collect();
        writeln!(f, "  {}: {}", self.field, shares.join(", "))?;
        let letter = |class: &str| {
            let at = self.probabilities.iter().position(|(c, _)| c == class).unwrap_or(0);
            (b'a' + (at % 26) as u8) as char
        };
        let strip: String =
            self.strip.iter().map(|(c, p)| if *p > 0.5 { letter(c).to_ascii_uppercase() } else { letter(c) }).collect();
        let mut shown: Vec<&String> = self.strip.iter().map(|(c, _)| c).collect();
        shown.sort_by_key(|c| letter(c));
        shown.dedup();
        let legend: Vec<String> = shown.iter().map(|c| format!("{} {c}", letter(c).to_ascii_uppercase())).collect();
        writeln!(f, "  a letter a second, large above 50 %: {strip}   ({})", legend.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_have_the_mean_of_the_windows_that_show_them() {
        let window = |words, p: f64| ClassScores { clip: 0, words, log_p: vec![vec![p.ln(), (1.0 - p).ln()]] };
        // two words a second
        let all = [window(0..2, 0.9), window(1..3, 0.5), window(3..5, 0.2)];
        let p: Vec<f64> = seconds(&all, 0, 2.0).iter().map(|l| l[0].exp()).collect();
        assert_eq!(p.len(), 3);
        // of 9 to 1 and 1 to 1 the geometric mean: 3 to 1
        assert!((p[0] - 0.75).abs() < 1e-12, "{p:?}");
        // of 1 to 1 and 1 to 4: 1 to 2
        assert!((p[1] - 1.0 / 3.0).abs() < 1e-12, "{p:?}");
        assert!((p[2] - 0.2).abs() < 1e-12, "{p:?}");
    }
}
