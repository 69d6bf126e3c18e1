//! Tempo as a label: `<tempo:NNN>`, beats per minute in steps of five.

use kinelm_music::beat::Beats;
use std::collections::BTreeMap;

/// The label's field.
pub const FIELD: &str = "tempo";
/// Beats per minute between two values.
const STEP: f64 = 5.0;

/// The value of a tempo, three digits.
fn value(bpm: f64) -> String {
    format!("{:03}", STEP * (bpm / STEP).round())
}

/// Beats per minute among the beats from 0 to `seconds`; `None` for fewer than two.
pub fn bpm(beats_s: &[f64], seconds: f64) -> Option<f64> {
    let times_s = beats_s.iter().copied().filter(|time| (0.0..=seconds).contains(time)).collect();
    Beats { times_s, seconds, ..Beats::default() }.bpm()
}

/// The tempo label of a clip of `seconds`; `None` for fewer than two beats in it.
pub fn label(beats_s: &[f64], seconds: f64) -> Option<String> {
    bpm(beats_s, seconds).map(value)
}

/// The value among a model's `known` ones that is nearest to a tempo; the slower of two.
pub fn nearest(known: &[&str], bpm: f64) -> Option<String> {
    let tempos = known.iter().filter_map(|value| Some((value, value.parse::<f64>().ok().filter(|x| x.is_finite())?)));
    let nearest = tempos.min_by(|(_, a), (_, b)| (a - bpm).abs().total_cmp(&(b - bpm).abs()).then(a.total_cmp(b)));
    nearest.map(|(value, _)| (*value).to_owned())
}

/// The labels of a clip that is played `factor` times as fast, its tempo the nearest that a model knows; `None` if they
/// don't change.
pub fn faster(labels: &BTreeMap<String, String>, known: &[&str], factor: f64) -> Option<BTreeMap<String, String>> {
    let tempo: f64 = labels.get(FIELD).filter(|_| factor != 1.0)?.parse().ok()?;
    let mut labels = labels.clone();
    labels.insert(FIELD.into(), nearest(known, tempo * factor)?);
    Some(labels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_counts_the_beats_inside_the_clip() {
        // 120 a minute up to 10 s, then 80
        let beats: Vec<f64> =
            (-4..20).map(|i| 0.5 * f64::from(i)).chain((0..20).map(|i| 10.0 + 0.75 * f64::from(i))).collect();
        assert_eq!(label(&beats, 9.0).as_deref(), Some("120"));
        let later: Vec<f64> = beats.iter().map(|beat| beat - 10.0).collect();
        assert_eq!(label(&later, 14.0).as_deref(), Some("080"));
        assert_eq!((label(&beats, 0.4), label(&[], 5.0)), (None, None));
        assert_eq!((value(97.4), value(97.6), value(243.0)), ("095".into(), "100".into(), "245".into()));
    }

    #[test]
    fn the_nearest_known_tempo_is_taken() {
        let known = ["080", "100", "slow", "140", "NaN"];
        let near = |bpm| nearest(&known, bpm);
        assert_eq!([near(60.0), near(90.0), near(91.0), near(300.0)].map(Option::unwrap), ["080", "080", "100", "140"]);
        assert_eq!((nearest(&["slow"], 90.0), nearest(&[], 90.0)), (None, None));
    }

    #[test]
    fn a_faster_clip_has_a_faster_tempo() {
        let labels =
            |tempo: &str| BTreeMap::from([("tempo".to_owned(), tempo.to_owned()), ("genre".into(), "a".into())]);
        let known = ["100", "110", "120"];
        assert_eq!(faster(&labels("100"), &known, 1.09), Some(labels("110")));
        assert_eq!(faster(&labels("120"), &known, 0.85), Some(labels("100")));
        assert_eq!([faster(&labels("100"), &known, 1.0), faster(&labels("slow"), &known, 1.1)], [None, None]);
        assert_eq!([faster(&BTreeMap::new(), &known, 1.1), faster(&labels("100"), &[], 1.1)], [None, None]);
    }
}
