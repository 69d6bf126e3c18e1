//! Windows of a masked model: some tokens are hidden, and each chosen one is its own target (docs/training.md, "Masked
//! models").

use kinelm_store::random;
use kinelm_tokenizer::Special;
use rand_chacha::rand_core::RngCore;

/// Of the tokens that may be chosen, so many are.
const CHOSEN: f64 = 0.15;
/// Of those chosen, so many become `<mask>`; the others stay in sight.
const HIDDEN: f64 = 0.9;

/// How many of `n` tokens are chosen: 15 %, rounded up.
pub fn chosen(n: usize) -> usize {
    (CHOSEN * n as f64).ceil() as usize
}

/// Writes a sequence of T places from the tokens of a window: `front` and the tokens to `input`, `pad` behind them. Of the
/// tokens whose number `may` allows, 15 % (rounded up) are chosen; the target of each stands at its own place, not one
/// before as in [`fill_sequence`](super::fill_sequence), and all others are `pad`. Each of the chosen becomes `<mask>` in
/// the input with probability 0.9.
///
/// One number of `rng` is drawn for each token, those with the least are chosen; then one for each that is chosen, by place.
///
/// # Panics
/// If `input` and `target` differ in length, or front and tokens don't fit.
pub fn fill_masked(
    (tokens, front): (&[u32], &[u32]),
    pad: u32,
    may: &dyn Fn(usize) -> bool,
    rng: &mut impl RngCore,
    (input, target): (&mut [u32], &mut [u32]),
) {
    assert_eq!(input.len(), target.len(), "input and target of one length");
    let (k, end) = (front.len(), front.len() + tokens.len());
    assert!(end <= input.len(), "{end} tokens for {} places", input.len());
    input[..k].copy_from_slice(front);
    input[k..end].copy_from_slice(tokens);
    input[end..].fill(pad);
    target.fill(pad);
    let drawn: Vec<f64> = tokens.iter().map(|_| random::unit(rng)).collect();
    let mut open: Vec<usize> = (0..tokens.len()).filter(|&i| may(i)).collect();
    let number = chosen(open.len());
    open.sort_by(|&a, &b| drawn[a].total_cmp(&drawn[b]));
    open.truncate(number);
    open.sort_unstable();
    for place in open.into_iter().map(|i| k + i) {
        target[place] = input[place];
        if random::unit(rng) < HIDDEN {
            input[place] = Special::Mask.id();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_store::random;

    #[test]
    fn fifteen_percent_are_chosen_and_about_a_tenth_of_them_stays() {
        assert_eq!([0, 1, 6, 7, 20, 100, 101].map(chosen), [0, 1, 1, 2, 3, 15, 16]);
        let tokens: Vec<u32> = (10..210).collect();
        let (mut counts, mut hidden) = (vec![0; 200], 0);
        for window in 0..400 {
            let (mut input, mut target) = ([9; 220], [9; 220]);
            let mut rng = random::stream(1, "mask", 0, window);
            fill_masked((&tokens, &[1, 7]), 0, &|_| true, &mut rng, (&mut input, &mut target));
            assert_eq!((input[..2].to_vec(), &input[202..], &target[202..]), (vec![1, 7], &[0; 18][..], &[0; 18][..]));
            let chosen: Vec<usize> = (0..220).filter(|&i| target[i] != 0).collect();
            assert_eq!(chosen.len(), 30);
            hidden += input.iter().filter(|id| **id == 3).count();
            for i in 2..202 {
                let own = tokens[i - 2];
                assert!(target[i] == 0 && input[i] == own || target[i] == own && [own, 3].contains(&input[i]));
            }
            chosen.iter().for_each(|i| counts[i - 2] += 1);
        }
        // 60 each; five standard deviations of a binomial are 36
        // 0.9 of 12,000; five standard deviations of a binomial are 164
        assert!(hidden.abs_diff(10_800) < 164, "{hidden}");
        assert!(counts.iter().all(|&c: &i32| (c - 60).abs() < 36), "{counts:?}");
    }

    #[test]
    fn what_may_not_be_chosen_is_not_and_does_not_count() {
        let (mut input, mut target) = ([9; 41], [9; 41]);
        let tokens = [5; 40];
        let mut rng = random::stream(1, "mask", 0, 0);
        fill_masked((&tokens, &[1]), 0, &|i| i % 2 == 0, &mut rng, (&mut input, &mut target));
        assert_eq!(target.iter().filter(|id| **id == 5).count(), 3);
        assert!((1..41).all(|i| target[i] == 0 || (i - 1) % 2 == 0));
    }
}
