//! Which of the allowed characters comes next.

use crate::random;
use rand_chacha::ChaCha8Rng;

/// How a character is drawn from the model's logits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Draw {
    /// The likeliest; of equals the first. The thesis's way.
    Greedy,
    /// By its probability, the logits divided by a temperature above 0 first.
    Temperature(f64),
}

impl Draw {
    /// The place in `logits` that is drawn; `None` if one of them is not finite.
    ///
    /// Probabilities are summed in f64 in the order of the places, so the same stream draws the same everywhere.
    pub fn pick(self, logits: &[f32], rng: &mut ChaCha8Rng) -> Option<usize> {
        if logits.is_empty() || logits.iter().any(|l| !l.is_finite()) {
            return None;
        }
        let (best, top) = logits.iter().enumerate().fold((0, f32::MIN), |b, (i, &l)| if l > b.1 { (i, l) } else { b });
        let Draw::Temperature(temperature) = self else { return Some(best) };
        let weight = |l: f32| ((f64::from(l) - f64::from(top)) / temperature).exp();
        let total: f64 = logits.iter().map(|&l| weight(l)).sum();
        let mut left = random::unit(rng) * total;
        for (i, &l) in logits.iter().enumerate() {
            left -= weight(l);
            if left < 0.0 {
                return Some(i);
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
            count[draw.pick(logits, &mut rng).unwrap()] += 1.0 / 20_000.0;
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
        assert_eq!(Draw::Greedy.pick(&[1.0, 5.0, 5.0], &mut rng), Some(1));
        assert_eq!(Draw::Greedy.pick(&[1.0, f32::NAN], &mut rng), None);
        assert_eq!(Draw::Temperature(1.0).pick(&[f32::INFINITY], &mut rng), None);
        assert_eq!(Draw::Greedy.pick(&[], &mut rng), None);
    }
}
