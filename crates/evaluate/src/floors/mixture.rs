//! Models mixed online: who told a slot's last codes well counts more for the next.
//!
//! Every slot has a weight a model, all equal at a clip's first frame. A code has the mean of the models' probabilities by
//! these weights; then each weight is multiplied by the probability that its model gave, and a hundredth of all is shared
//! evenly, so that none is ever out. Source: Herbster, Warmuth, "Tracking the Best Expert" (1998), fixed share.

/// Of the weights, what is shared evenly after each frame.
const SHARE: f64 = 0.01;

/// Bits of the codes (F, C) of a clip under the mixture of models with these bits, each (F, C). All bits are finite.
///
/// # Panics
/// If the models have other numbers of codes, or there is none.
pub(crate) fn mixed(models: &[&[f32]], channels: usize) -> Vec<f32> {
    let (count, codes) = (models.len(), models[0].len());
    assert!(models.iter().all(|bits| bits.len() == codes), "all models have bits of every code");
    let mut weights = vec![1.0 / count as f64; count * channels];
    let mut found = Vec::with_capacity(codes);
    for at in 0..codes {
        let weights = &mut weights[at % channels * count..][..count];
        // from the least bits: a probability of 2^-1100 is no number
        let least = models.iter().map(|bits| f64::from(bits[at])).fold(f64::INFINITY, f64::min);
        let mut sum = 0.0;
        for (weight, bits) in weights.iter_mut().zip(models) {
            *weight *= (least - f64::from(bits[at])).exp2();
            sum += *weight;
        }
        found.push((least - sum.log2()) as f32);
        weights.iter_mut().for_each(|weight| *weight = (1.0 - SHARE) * *weight / sum + SHARE / count as f64);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        // one bit and three: the mean of 1/2 and 1/8, then weights of 4/5 and 1/5, a hundredth of which is shared
        let found = mixed(&[&[1.0, 1.0], &[3.0, 3.0]], 1);
        assert!((f64::from(found[0]) + 0.3125f64.log2()).abs() < 1e-6, "{found:?}");
        let first = 0.99 * 0.8 + 0.005;
        let second = -(first / 2.0 + (1.0 - first) / 8.0f64).log2();
        assert!((f64::from(found[1]) - second).abs() < 1e-6, "{found:?} {second}");
        // each slot has weights of its own
        let two = mixed(&[&[1.0, 3.0, 1.0, 3.0], &[3.0, 1.0, 3.0, 1.0]], 2);
        assert_eq!(two, [found[0], found[0], found[1], found[1]]);
        assert_eq!(mixed(&[&[2.5, 0.0]], 1), [2.5, 0.0]);
    }

    #[test]
    fn it_is_hardly_worse_than_the_better_one_and_follows_a_change() {
        let (good, bad) = (1.0f32, 6.0f32);
        let first: Vec<f32> = (0..400).map(|f| if f < 200 { good } else { bad }).collect();
        let second: Vec<f32> = first.iter().map(|x| good + bad - x).collect();
        let sum: f32 = mixed(&[&first, &second], 1).iter().sum();
        assert!(sum > 400.0 && sum < 430.0, "{sum}");
        // far from any probability that is a number
        assert!(mixed(&[&[5000.0; 3], &[4000.0; 3]], 1).iter().all(|x| *x > 3999.0 && *x < 4002.0));
    }
}
