//! Which of the allowed tokens comes next.

use crate::random;
use rand_chacha::ChaCha8Rng;
use std::ops::Range;

/// How a token is drawn from the model's logits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Draw {
    /// The likeliest; of equals the first. The thesis's way.
    Greedy,
    /// By its probability, the logits divided by a temperature above 0 first.
    Temperature(f64),
}

impl Draw {
    /// The id that is drawn of those that are `allowed`, ranges that ascend, by the `logits` (V) of all; `None` if one of
    /// theirs is missing, NaN or plus infinity, or if all of them are minus infinity, which says that an id can't come.
    ///
    /// Probabilities are summed in f64 in the order of the ids, so the same stream draws the same everywhere.
    pub fn pick(self, logits: &[f32], allowed: &[Range<u32>], rng: &mut ChaCha8Rng) -> Option<u32> {
        let ids = || allowed.iter().cloned().flatten();
        let logit = |id: u32| logits[id as usize];
        let known = |id: u32| logits.get(id as usize).is_some_and(|l| *l < f32::INFINITY);
        let first = ids().next().filter(|_| ids().all(known))?;
        let best = ids().fold(first, |best, id| if logit(id) > logit(best) { id } else { best });
        if logit(best) == f32::NEG_INFINITY {
            return None;
        }
        let Draw::Temperature(temperature) = self else { return Some(best) };
        let top = f64::from(logit(best));
        let weight = |id: u32| ((f64::from(logit(id)) - top) / temperature).exp();
        let total: f64 = ids().map(weight).sum();
        let mut left = random::unit(rng) * total;
        for id in ids() {
            left -= weight(id);
            if left < 0.0 {
                return Some(id);
            }
        }
        Some(best)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn share(draw: Draw, logits: &[f32]) -> Vec<f64> {
        let mut rng = random::stream(1, "test", 0, 0);
        let mut count = vec![0.0; logits.len()];
        for _ in 0..20_000 {
            count[draw.pick(logits, &[0..1, 1..logits.len() as u32], &mut rng).unwrap() as usize] += 1.0 / 20_000.0;
        }
        count
    }

    #[test]
    fn temperature_one_draws_by_probability() {
        let logits = [0.0, 3f32.ln(), 6f32.ln()];
        for (got, want) in share(Draw::Temperature(1.0), &logits).iter().zip([0.1, 0.3, 0.6]) {
            // five standard deviations of a share over 20,000 draws
            assert!((got - want).abs() < 0.018, "{got} {want}");
        }
        for (got, want) in share(Draw::Temperature(0.5), &logits).iter().zip([1.0 / 46.0, 9.0 / 46.0, 36.0 / 46.0]) {
            assert!((got - want).abs() < 0.018, "{got} {want}");
        }
    }

    #[test]
    fn greedy_takes_the_first_of_the_best() {
        let mut rng = random::stream(1, "test", 0, 0);
        let mut pick =
            |draw: Draw, logits: &[f32]| draw.pick(logits, std::slice::from_ref(&(0..logits.len() as u32)), &mut rng);
        assert_eq!(pick(Draw::Greedy, &[1.0, 5.0, 5.0]), Some(1));
        assert_eq!(pick(Draw::Greedy, &[1.0, f32::NAN]), None);
        assert_eq!(pick(Draw::Temperature(1.0), &[f32::INFINITY]), None);
        assert_eq!(pick(Draw::Greedy, &[]), None);
    }

    #[test]
    fn minus_infinity_is_never_drawn() {
        const NEVER: f32 = f32::NEG_INFINITY;
        let mut rng = random::stream(1, "test", 0, 0);
        let logits = [NEVER, 0.0, NEVER, 1.0, NEVER];
        assert_eq!(Draw::Greedy.pick(&logits, &[0..3, 4..5], &mut rng), Some(1));
        let drawn = share(Draw::Temperature(50.0), &logits);
        assert_eq!(drawn.iter().map(|share| *share > 0.0).collect::<Vec<_>>(), [false, true, false, true, false]);
        assert_eq!(Draw::Temperature(1.0).pick(&logits, &[0..1, 2..3], &mut rng), None);
        assert_eq!(Draw::Greedy.pick(&logits, &[0..1], &mut rng), None);
    }

    #[test]
    fn only_what_is_allowed_is_drawn_and_looked_at() {
        let mut rng = random::stream(1, "test", 0, 0);
        let logits = [f32::NAN, 1.0, 9.0, 2.0, 1.0];
        assert_eq!(Draw::Greedy.pick(&logits, &[1..2, 3..5], &mut rng), Some(3));
        for _ in 0..200 {
            let drawn = Draw::Temperature(5.0).pick(&logits, &[1..2, 3..5], &mut rng).unwrap();
            assert!([1, 3, 4].contains(&drawn), "{drawn}");
        }
        assert_eq!(Draw::Greedy.pick(&logits, &[1..5, 5..6], &mut rng), None);
        assert_eq!(Draw::Greedy.pick(&logits, &[], &mut rng), None);
    }
}
