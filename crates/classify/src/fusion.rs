//! Late fusion: of a clip the log-probabilities of the class tokens and those of a linear discriminant, in a weighted sum.
//!
//! The discriminant reads windows longer than the class tokens'. The weights are those of the lowest -ln p on the validation clips:
//! docs/classification.md, "A clip's class".
//!
//! Limits: one of 64 pairs of weights, chosen on the validation clips, whose own figures are optimistic therefore.

use super::class_scores::{ClassScores, mean_log_p, normalised, of_clips};
use super::features::Motion;
use super::fields::{Field, Fields};
use super::lda::{COMPONENTS, Lda};
use crate::Result;
use kinelm_corpus::{ClipRecord, Corpus};
use kinelm_model::layout::{Init, Parameter, Role};
use kinelm_model::weights::{Array, Weights, floats};
use rayon::prelude::*;

/// Length of the discriminant's windows, seconds: docs/results/classification.md, "Class tokens with LDA".
const SECONDS: f64 = 5.4;

/// The weights that are tried.
const WEIGHTS: [f64; 8] = [0.0, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0];

/// A field's discriminant and the weights.
pub(super) struct Fusion {
    lda: Lda,
    /// Of the class tokens, of the discriminant.
    weights: [f64; 2],
}

/// A discriminant per field from the training clips.
pub(super) struct Discriminants {
    all: Vec<Lda>,
    /// ln p of every validation clip, per field and class.
    valid: Vec<Vec<Vec<f64>>>,
}

impl Discriminants {
    /// Fits them to the training clips and to these in a mirror, and scores the validation clips.
    ///
    /// # Errors
    /// A corpus that doesn't hold together; numbers that are not finite.
    pub fn fit(
        corpus: &Corpus,
        fields: &Fields,
        train: &[&ClipRecord],
        valid: &[&ClipRecord],
    ) -> Result<Discriminants> {
        let both = |clip: &&ClipRecord| {
            let motion = Motion::of(corpus, clip)?;
            Ok([motion.windows(SECONDS), motion.mirrored(corpus.tokenizer())?.windows(SECONDS)])
        };
        let seen = train.par_iter().map(both).collect::<Result<Vec<_>>>()?;
        let fit = |field: &Field| {
            let (mut rows, mut labels) = (Vec::new(), Vec::new());
            for (both, clip) in seen.iter().zip(train) {
                let class = field.class_of(clip);
                // in a mirror a clip shows the mirrored class; where there is none, nothing can be learned from it
                for (windows, class) in both.iter().zip([class, class.and_then(|class| field.mirrored(class))]) {
                    let Some(class) = class else { continue };
                    rows.extend_from_slice(windows);
                    labels.extend(vec![class; windows.len()]);
                }
            }
            Lda::fit(&rows, &labels, field.classes.len(), COMPONENTS)
        };
        let all = fields.0.iter().map(fit).collect::<Result<Vec<Lda>>>()?;
        let scores = |clip: &&ClipRecord| {
            let windows = Motion::of(corpus, clip)?.windows(SECONDS);
            Ok(all.iter().map(|lda| of_windows(lda, &windows)).collect())
        };
        let valid = valid.par_iter().map(scores).collect::<Result<Vec<_>>>()?;
        Ok(Discriminants { all, valid })
    }

    /// The discriminants as arrays, with the weights that suit class tokens whose validation windows have these scores.
    pub fn arrays(&self, scores: &[ClassScores], valid: &[&ClipRecord], fields: &Fields) -> Weights {
        let tokens = of_clips(scores);
        let mut arrays = Weights::new();
        for (table, (field, lda)) in fields.0.iter().zip(&self.all).enumerate() {
            let known: Vec<(usize, [&[f64]; 2])> = tokens
                .iter()
                .filter_map(|s| Some((field.class_of(valid[s.clip])?, [&*s.log_p[table], &self.valid[s.clip][table]])))
                .collect();
            let weights = best_weights(&known);
            for (name, numbers) in lda.parts().into_iter().chain([("tokens_and_lda", &weights[..])]) {
                let numbers: Vec<f32> = numbers.iter().map(|x| *x as f32).collect();
                arrays.insert(format!("fusion.{}.{name}", field.name), Array::new(&[numbers.len()], numbers));
            }
        }
        arrays
    }
}

/// ln p of every class of a clip with these windows.
fn of_windows(lda: &Lda, windows: &[Vec<f64>]) -> Vec<f64> {
    let log_p: Vec<Vec<f64>> = windows.iter().map(|window| lda.log_p(window)).collect();
    mean_log_p(&log_p)
}

/// The weights of the lowest mean -ln p of the true classes; 1 and 1 where no class is known.
fn best_weights(known: &[(usize, [&[f64]; 2])]) -> [f64; 2] {
    if known.is_empty() {
        return [1.0, 1.0];
    }
    let nats = |weights: [f64; 2]| known.iter().map(|(class, both)| -fused(*both, weights)[*class]).sum::<f64>();
    let all = WEIGHTS.iter().flat_map(|&a| WEIGHTS.iter().map(move |&b| [a, b]));
    all.min_by(|a, b| nats(*a).total_cmp(&nats(*b))).unwrap_or([1.0, 1.0])
}

fn fused([a, b]: [&[f64]; 2], weights: [f64; 2]) -> Vec<f64> {
    // a class that no training clip has is minus infinity, which 0 times is no number
    let weighed = |weight: f64, x: f64| if weight > 0.0 { weight * x } else { 0.0 };
    normalised(a.iter().zip(b).map(|(a, b)| weighed(weights[0], *a) + weighed(weights[1], *b)).collect())
}

impl Fusion {
    /// Of every field, taken out of a classifier's weights; `features` are those of a clip.
    ///
    /// # Errors
    /// Arrays that are missing or of another shape.
    pub fn take(fields: &Fields, features: usize, weights: &mut Weights) -> Result<Vec<Fusion>> {
        let one = |field: &Field| {
            let classes = field.classes.len();
            let name = |part: &str| format!("fusion.{}.{part}", field.name);
            // of few clips there are fewer components
            let basis = weights.get(&name("basis")).map_or(0, |basis| basis.numbers().len());
            let components = basis / features.max(1);
            let shapes = [features, features, components * features, classes * components, classes, 2];
            let parameters = Lda::PARTS.iter().chain(&["tokens_and_lda"]).zip(shapes).map(|(part, n)| Parameter {
                name: name(part),
                shape: vec![n],
                init: Init::Zeros,
                role: Role::Vector,
            });
            let parameters: Vec<Parameter> = parameters.collect();
            let found = floats("classifier", &parameters, weights, |p| p.name.clone())?;
            let mut parts = found.iter().map(|x| x.iter().map(|x| f64::from(*x)).collect::<Vec<f64>>());
            let mut part = || parts.next().unwrap_or_default();
            let lda = Lda::of([part(), part(), part(), part(), part()]);
            let shares = part();
            parameters.iter().for_each(|p| drop(weights.remove(&p.name)));
            Ok(Fusion { lda, weights: [shares[0], shares[1]] })
        };
        fields.0.iter().map(one).collect()
    }
}

/// The classes of a clip by class tokens together with the discriminants.
pub(super) fn fuse(fusions: &[Fusion], tokens: &ClassScores, motion: &Motion) -> ClassScores {
    let windows = motion.windows(SECONDS);
    let field =
        |(fusion, log_p): (&Fusion, &Vec<f64>)| fused([log_p, &of_windows(&fusion.lda, &windows)], fusion.weights);
    ClassScores { log_p: fusions.iter().zip(&tokens.log_p).map(field).collect(), ..tokens.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_better_of_two_gets_the_weight() {
        let ln = |p: f64| vec![p.ln(), (1.0 - p).ln()];
        let (right, wrong, guess) = (ln(0.9), ln(0.2), ln(0.5));
        let of = |a: &[f64], b: &[f64]| best_weights(&[(0, [a, b]); 3]);
        assert_eq!(of(&wrong, &right), [0.0, 8.0]);
        assert_eq!(of(&right, &wrong)[1], 0.0);
        assert!(of(&guess, &right)[1] > 1.0);
        assert_eq!(best_weights(&[]), [1.0, 1.0]);
        // a class that the discriminant has never seen
        assert!(of(&right, &[f64::NEG_INFINITY, 0.0]) == [8.0, 0.0]);
    }
}
