//! Tracks a pulse through the flux, at any metrical level.

use super::tempogram::STEP;

/// Cost of a step of another length than the period, per squared logarithm of their ratio.
const STIFFNESS: f32 = 1000.0;

/// The frames of a pulse at peaks of the flux, with the given periods (one every [`STEP`] frames), extended to both ends. Empty
/// for constant flux.
///
/// Source: Ellis, "Beat tracking by dynamic programming" (2007), eq. 4 to 7.
pub fn pulse(change: &[f32], periods: &[f64]) -> Vec<f64> {
    let n = change.len() as f64;
    let mean = change.iter().map(|x| f64::from(*x)).sum::<f64>() / n;
    let deviation = (change.iter().map(|x| (f64::from(*x) - mean).powi(2)).sum::<f64>() / n).sqrt();
    // no frames give 0 / 0
    if deviation.is_nan() || deviation < 1e-6 {
        return Vec::new();
    }
    let period = |f: usize| {
        let (i, t) = (f / STEP, (f % STEP) as f64 / STEP as f64);
        let at = |i: usize| periods[i.min(periods.len() - 1)];
        at(i) + t * (at(i + 1) - at(i))
    };
    let longest = periods.iter().copied().fold(0.0, f64::max);
    // a logarithm per step would be most of the time; steps are whole frames, up to two periods
    let logs: Vec<f32> = (0..=(2.0 * longest) as usize + 1).map(|i| (i as f32).ln()).collect();
    let mut score = vec![0.0f32; change.len()];
    let mut back: Vec<Option<u32>> = vec![None; change.len()];
    for f in 0..change.len() {
        let p = period(f);
        let log = p.ln() as f32;
        // a frame may begin the pulse: no chain is continued below 0
        let mut best = (0.0, None);
        // half to double the period; from 1, as ln 0 is -infinity
        let nearest = ((p / 2.0) as usize).max(1);
        for (i, of_step) in logs[nearest..=(2.0 * p) as usize].iter().enumerate() {
            let Some(from) = f.checked_sub(nearest + i) else { break };
            let off = of_step - log;
            let found = score[from] - STIFFNESS * off * off;
            // among equals the longer step wins
            if found >= best.0 && found > 0.0 {
                best = (found, Some(from as u32));
            }
        }
        score[f] = change[f] / deviation as f32 + best.0;
        back[f] = best.1;
    }
    // scores add up along a chain, so the end of the best one is within the last period and a half
    let tail = (periods[periods.len() - 1] * 1.5) as usize;
    let from = change.len().saturating_sub(tail.max(1));
    let last = (from..change.len()).fold(from, |a, b| if score[b] >= score[a] { b } else { a });
    let mut path = vec![last as f64];
    let mut at = back[last];
    while let Some(f) = at {
        path.push(f64::from(f));
        at = back[f as usize];
    }
    path.reverse();
    extend(path, change.len() as f64)
}

/// Extends a path to both ends at the median pace of the nearest eight steps.
fn extend(path: Vec<f64>, end: f64) -> Vec<f64> {
    let pace = |steps: &[f64]| {
        let mut all: Vec<f64> = steps.windows(2).map(|w| w[1] - w[0]).collect();
        super::median(&mut all).unwrap_or(f64::INFINITY)
    };
    let n = path.len();
    let (first, last) = (pace(&path[..n.min(9)]), pace(&path[n.saturating_sub(9)..]));
    let mut out: Vec<f64> = (1..).map(|i| path[0] - first * f64::from(i)).take_while(|t| *t > 0.0).collect();
    out.reverse();
    let start = path[n - 1];
    out.extend(path);
    out.extend((1..).map(|i| start + last * f64::from(i)).take_while(|t| *t < end));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pulse_follows_ticks_and_bridges_a_gap() {
        let mut change = vec![0.0f32; 4000];
        let truth: Vec<f64> = (0..99).map(|i| 20.0 + 40.5 * f64::from(i)).collect();
        for t in &truth {
            change[*t as usize] = 1.0;
        }
        change[1500..1700].fill(0.0);
        let found = pulse(&change, &[40.0; 48]);
        assert_eq!(found.len(), truth.len());
        assert!(found.iter().zip(&truth).all(|(a, b)| (a - b).abs() < 2.0), "{found:?}");
        assert!(pulse(&[0.0; 100], &[40.0; 2]).is_empty());
        assert!(pulse(&[], &[40.0]).is_empty());
        assert_eq!(pulse(&[0.0, 1.0, 0.0], &[40.0]), [1.0]);
    }
}
