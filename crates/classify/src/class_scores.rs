//! Class probabilities of windows and of clips.

use std::ops::Range;

/// Class probabilities of a window, or of a clip.
#[derive(Debug, Clone, PartialEq)]
pub struct ClassScores {
    /// Index into the clips.
    pub clip: usize,
    /// The words that it shows.
    pub words: Range<usize>,
    /// ln p, per field and class.
    pub log_p: Vec<Vec<f64>>,
}

impl ClassScores {
    /// The most likely class of a field; of equals the first.
    pub(crate) fn likeliest(&self, field: usize) -> usize {
        likeliest(&self.log_p[field])
    }
}

/// The index of the largest number; of equals the first.
pub fn likeliest(log_p: &[f64]) -> usize {
    (0..log_p.len()).fold(0, |best, i| if log_p[i] > log_p[best] { i } else { best })
}

/// The classes of clips from those of their windows, which follow each other clip by clip: the mean ln p, normalised.
pub fn of_clips(windows: &[ClassScores]) -> Vec<ClassScores> {
    let one = |windows: &[ClassScores]| {
        let fields = windows[0].log_p.len();
        let mean = |field: usize| {
            let of_field: Vec<&Vec<f64>> = windows.iter().map(|w| &w.log_p[field]).collect();
            mean_log_p(&of_field)
        };
        let words = windows[0].words.start..windows[windows.len() - 1].words.end;
        ClassScores { clip: windows[0].clip, words, log_p: (0..fields).map(mean).collect() }
    };
    windows.chunk_by(|a, b| a.clip == b.clip).map(one).collect()
}

/// ln p of every class of a clip: the mean over its windows, one or more, normalised.
pub(super) fn mean_log_p(windows: &[impl AsRef<[f64]>]) -> Vec<f64> {
    // a mean: a sum would count overlapping windows as independent, and be too sure
    let sum = |class: usize| windows.iter().map(|w| w.as_ref()[class]).sum::<f64>();
    let classes = windows[0].as_ref().len();
    normalised((0..classes).map(|class| sum(class) / windows.len() as f64).collect())
}

/// Logits as ln p: log-softmax.
pub(super) fn normalised(logits: Vec<f64>) -> Vec<f64> {
    // less the largest, or `exp` would overflow
    let most = logits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum = most + logits.iter().map(|l| (l - most).exp()).sum::<f64>().ln();
    logits.into_iter().map(|l| l - sum).collect()
}
