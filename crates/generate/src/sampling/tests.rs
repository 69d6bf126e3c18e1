use super::*;
use kinelm_store::random;
use proptest::prelude::*;

fn rng() -> ChaCha8Rng {
    random::stream(1, "test", 0, 0)
}

/// The ids that a rule leaves of centred logits.
pub fn left_by(logits: &[f64], rule: impl Fn(&mut Vec<Candidate>)) -> Vec<u32> {
    let mut left: Vec<Candidate> =
        logits.iter().enumerate().map(|(id, &logit)| Candidate { id: id as u32, logit }).collect();
    centre(&mut left);
    rule(&mut left);
    left.iter().map(|c| c.id).collect()
}

fn shares(sampling: Sampling, logits: &[f32]) -> Vec<f64> {
    let mut rng = rng();
    let mut count = vec![0.0; logits.len()];
    for _ in 0..20_000 {
        count[sampling.sample(logits, &[0..1, 1..logits.len() as u32], &[], &mut rng).unwrap() as usize] +=
            1.0 / 20_000.0;
    }
    count
}

fn check_shares(sampling: Sampling, logits: &[f32], expected: &[f64]) {
    for (got, want) in shares(sampling, logits).iter().zip(expected) {
        // five standard deviations of a share over 20,000 samples
        assert!((got - want).abs() < 0.018, "{got} {want}");
    }
}

#[test]
fn ids_are_sampled_by_probability() {
    let logits = [0.0, 3f32.ln(), 6f32.ln()];
    check_shares(Sampling::default(), &logits, &[0.1, 0.3, 0.6]);
    check_shares(Sampling::temperature(0.5), &logits, &[1.0 / 46.0, 9.0 / 46.0, 36.0 / 46.0]);
    check_shares(Sampling { top_k: Some(2), ..Sampling::default() }, &logits, &[0.0, 1.0 / 3.0, 2.0 / 3.0]);
    check_shares(Sampling { min_p: Some(0.4), ..Sampling::default() }, &logits, &[0.0, 1.0 / 3.0, 2.0 / 3.0]);
    check_shares(Sampling { top_p: Some(0.5), ..Sampling::default() }, &logits, &[0.0, 0.0, 1.0]);
}

#[test]
fn rules_apply_in_their_order() {
    let left = |sampling: Sampling| left_by(&[0.4f64, 0.3, 0.2, 0.1].map(f64::ln), |c| sampling.truncate(c));
    // of the two that top-k leaves, the first has 4/7: top-p sees these shares, not those of all
    assert_eq!(left(Sampling { top_p: Some(0.55), ..Sampling::default() }), [0, 1]);
    assert_eq!(left(Sampling { top_k: Some(2), top_p: Some(0.55), ..Sampling::default() }), [0]);
    // at temperature 1/2 the shares are 16 : 9 : 4 : 1, and min-p sees those
    assert_eq!(left(Sampling { min_p: Some(0.3), ..Sampling::default() }), [0, 1, 2]);
    assert_eq!(left(Sampling { min_p: Some(0.3), temperature: 0.5, ..Sampling::default() }), [0, 1]);
    // the penalty comes first: a penalised id may lose its place among the k
    let sampling = Sampling { top_k: Some(1), repetition_penalty: 2.0, ..Sampling::default() };
    let logits = [0.4f32, 0.3].map(f32::ln);
    assert_eq!(sampling.sample(&logits, &[0..1, 1..2], &[0], &mut rng()), Some(1));
    assert_eq!(Sampling { greedy: true, ..sampling }.sample(&logits, &[0..1, 1..2], &[0], &mut rng()), Some(1));
    assert_eq!(sampling.sample(&logits, &[0..1, 1..2], &[], &mut rng()), Some(0));
}

#[test]
fn greedy_takes_the_first_of_the_most_likely() {
    let all = |logits: &[f32]| std::ops::Range { start: 0, end: logits.len() as u32 };
    let pick = |sampling: Sampling, logits: &[f32]| sampling.sample(logits, &[all(logits)], &[], &mut rng());
    assert_eq!(pick(Sampling::greedy(), &[1.0, 5.0, 5.0]), Some(1));
    assert_eq!(pick(Sampling::greedy(), &[1.0, f32::NAN]), None);
    assert_eq!(pick(Sampling::default(), &[f32::INFINITY]), None);
    assert_eq!(pick(Sampling::greedy(), &[]), None);
}

#[test]
fn minus_infinity_is_probability_0() {
    let none = f32::NEG_INFINITY;
    for sampling in [
        Sampling::greedy(),
        Sampling::temperature(9.0),
        Sampling { top_k: Some(3), min_p: Some(0.0), ..Sampling::default() },
    ] {
        let mut rng = rng();
        let mut pick = |logits: &[f32]| sampling.sample(logits, &[0..2, 2..4], &[0, 3], &mut rng);
        for _ in 0..50 {
            assert_eq!(pick(&[none, none, -50.0, none]), Some(2));
        }
        assert_eq!(pick(&[none; 4]), None);
        assert_eq!(pick(&[none, f32::NAN, 0.0, 0.0]), None);
    }
}

#[test]
fn only_allowed_ids_are_sampled_and_looked_at() {
    let mut rng = rng();
    let logits = [f32::NAN, 1.0, 9.0, 2.0, 1.0];
    assert_eq!(Sampling::greedy().sample(&logits, &[1..2, 3..5], &[], &mut rng), Some(3));
    for _ in 0..200 {
        let sampled = Sampling::temperature(5.0).sample(&logits, &[1..2, 3..5], &[], &mut rng).unwrap();
        assert!([1, 3, 4].contains(&sampled), "{sampled}");
    }
    assert_eq!(Sampling::greedy().sample(&logits, &[1..5, 5..6], &[], &mut rng), None);
    assert_eq!(Sampling::greedy().sample(&logits, &[], &[], &mut rng), None);
}

#[test]
fn options_outside_their_ranges_are_named() {
    assert!(Sampling { top_k: Some(1), top_p: Some(1.0), min_p: Some(0.0), ..Sampling::default() }.validate().is_ok());
    for (sampling, said) in [
        (Sampling::temperature(0.0), "`temperature` is 0; expected a number above 0"),
        (Sampling::temperature(f64::NAN), "`temperature` is NaN; expected"),
        (Sampling { top_k: Some(0), ..Sampling::default() }, "`top_k` is 0; expected at least 1"),
        (Sampling { top_p: Some(1.5), ..Sampling::default() }, "`top_p` is 1.5; expected"),
        (Sampling { min_p: Some(-0.1), ..Sampling::default() }, "`min_p` is -0.1; expected"),
        (Sampling { repetition_penalty: 0.0, ..Sampling::default() }, "`repetition_penalty` is 0; expected"),
    ] {
        let message = sampling.validate().unwrap_err().to_string();
        assert!(message.starts_with(said), "{message}");
    }
}

fn any_sampling() -> impl Strategy<Value = Sampling> {
    let p = || prop::option::of(0.01..1.0f64);
    (any::<bool>(), 0.2..5.0f64, 0.1..5.0f64, prop::option::of(1..20usize), p(), p()).prop_map(
        |(greedy, repetition_penalty, temperature, top_k, top_p, min_p)| Sampling {
            greedy,
            repetition_penalty,
            temperature,
            top_k,
            top_p,
            min_p,
            ..Sampling::default()
        },
    )
}

fn any_logits() -> impl Strategy<Value = Vec<f32>> {
    let logit = prop_oneof![4 => -20.0..20.0f32, 1 => Just(f32::NEG_INFINITY), 1 => Just(1.0f32)];
    prop::collection::vec(logit, 24)
}

proptest! {
    /// Every combination of rules gives an allowed id of probability above 0, the same for the same stream.
    #[test]
    fn every_sample_is_allowed_and_repeats(sampling in any_sampling(), logits in any_logits(), recent in prop::collection::vec(0..24u32, 0..4), seed: u64) {
        let allowed = [2..9, 11..24];
        let pick = || sampling.sample(&logits, &allowed, &recent, &mut random::stream(seed, "test", 0, 0));
        let possible = |id: u32| allowed.iter().any(|r| r.contains(&id)) && logits[id as usize].is_finite();
        match pick() {
            Some(id) => prop_assert!(possible(id)),
            None => prop_assert!(!(0..24).any(possible)),
        }
        prop_assert_eq!(pick(), pick());
    }

    /// The most likely is never ruled out, so something always is left, and rules set to nothing change nothing.
    #[test]
    fn the_most_likely_stays_and_rules_of_nothing_change_nothing(sampling in any_sampling(), logits in any_logits()) {
        let all: Vec<f64> = logits.iter().filter(|l| l.is_finite()).map(|&l| l.into()).collect();
        if !all.is_empty() {
            let left = left_by(&all, |c| sampling.truncate(c));
            let best = (0..all.len()).fold(0, |best, i| if all[i] > all[best] { i } else { best });
            prop_assert!(left.contains(&(best as u32)) && left.is_sorted());
            let nothing = Sampling { top_k: Some(24), top_p: Some(1.0), min_p: Some(0.0), ..Sampling::default() };
            prop_assert_eq!(left_by(&all, |c| nothing.truncate(c)).len(), all.len());
        }
    }

    /// A constant added to every logit changes nothing, which models with a softmax may do.
    #[test]
    fn where_the_logits_have_their_zero_does_not_matter(sampling in any_sampling(), logits in prop::collection::vec(-8..8i32, 12), by in -4..4i32, seed: u64) {
        let pick = |by: i32| {
            let logits: Vec<f32> = logits.iter().map(|l| (l + by) as f32).collect();
            sampling.sample(&logits, &[0..6, 6..12], &[3], &mut random::stream(seed, "test", 0, 0))
        };
        prop_assert_eq!(pick(0), pick(by));
    }
}

#[test]
#[allow(clippy::single_range_in_vec_init, reason = "the ids of a place often are one range")]
fn the_probability_of_an_id_is_its_share_of_those_that_are_allowed() {
    let logits = [9.0, 1.0, 2.0, f32::NEG_INFINITY, 0.5, 3.0];
    let allowed = [1..4, 5..6];
    let p = |id: u32| log_probability(&logits, &allowed, id).exp();
    let sum: f64 = [1.0f64, 2.0, 3.0].map(f64::exp).iter().sum();
    for (id, logit) in [(1, 1.0f64), (2, 2.0), (5, 3.0)] {
        assert!((p(id) - logit.exp() / sum).abs() < 1e-12, "{id}");
    }
    assert_eq!([0, 3, 4, 7].map(p), [0.0; 4]);
    assert_eq!(log_probability(&[f32::NAN], &[0..1], 0), f64::NEG_INFINITY);
    assert_eq!(log_probability(&[-1e30, 1e30], &[0..2], 0), f64::from(-1e30f32) - f64::from(1e30f32));
}

/// The rules compared with candle-transformers' sampler: which ids they leave, and how often each is sampled.
#[cfg(feature = "oracle")]
mod oracle {
    use super::*;
    use candle_core::{Device, Tensor};
    use candle_transformers::generation::{LogitsProcessor, Sampling as Theirs};

    const SEED: u64 = 299_792_458;
    const SAMPLES: usize = 20_000;
    const IDS: u32 = 24;

    /// Neither even nor in order. Even the least likely id is sampled some tens of times, so that an id that never is has been
    /// truncated.
    fn logits() -> Vec<f32> {
        (0..IDS).map(|i| ((i * 37 + 11) % 101) as f32 / 101.0 * 3.0 - 1.5).collect()
    }

    /// The statistic that two equally large samples of `ids` ids exceed one time in 10,000 if their distribution is the same; by
    /// Wilson and Hilferty (1931).
    fn chi_square_bound(ids: usize) -> f64 {
        let (df, z) = ((ids - 1) as f64, 3.719);
        let part = 2.0 / (9.0 * df);
        df * (1.0 - part + z * part.sqrt()).powi(3)
    }

    fn check(theirs: Theirs, ours: Sampling) {
        let logits = logits();
        let tensor = Tensor::new(logits.as_slice(), &Device::Cpu).unwrap();
        let (mut processor, mut rng) = (LogitsProcessor::from_sampling(SEED, theirs), rng());
        let (mut counts, mut own) = (vec![0u32; IDS as usize], vec![0u32; IDS as usize]);
        for _ in 0..SAMPLES {
            counts[processor.sample(&tensor).unwrap() as usize] += 1;
            own[ours.sample(&logits, std::slice::from_ref(&(0..IDS)), &[], &mut rng).unwrap() as usize] += 1;
        }
        let left: Vec<u32> = (0..).zip(&counts).filter(|(_, n)| **n > 0).map(|(id, _)| id).collect();
        let wide: Vec<f64> = logits.iter().map(|l| f64::from(*l)).collect();
        assert_eq!(left_by(&wide, |c| ours.truncate(c)), left, "{ours:?}");
        if left.len() > 1 {
            let term = |(a, b): (&u32, &u32)| (f64::from(*a) - f64::from(*b)).powi(2) / f64::from((a + b).max(1));
            let (statistic, bound) = (own.iter().zip(&counts).map(term).sum::<f64>(), chi_square_bound(left.len()));
            assert!(statistic < bound, "{ours:?}: chi-square {statistic:.1}, expected below {bound:.1}");
        }
    }

    #[test]
    fn temperature_samples_as_candle_transformers() {
        for temperature in [0.7, 1.0, 1.5] {
            check(Theirs::All { temperature }, Sampling::temperature(temperature));
        }
    }

    #[test]
    fn top_k_leaves_the_ids_of_candle_transformers() {
        for (k, temperature) in [(1, 1.0), (5, 0.8), (23, 1.0)] {
            check(Theirs::TopK { k, temperature }, Sampling { top_k: Some(k), ..Sampling::temperature(temperature) });
        }
    }

    #[test]
    fn top_p_leaves_the_ids_of_candle_transformers() {
        for (p, temperature) in [(0.05, 1.0), (0.5, 1.0), (0.9, 0.7), (0.9, 1.5)] {
            check(Theirs::TopP { p, temperature }, Sampling { top_p: Some(p), ..Sampling::temperature(temperature) });
        }
    }

    #[test]
    fn top_p_after_top_k_leaves_the_ids_of_candle_transformers() {
        for (k, p, temperature) in [(10, 0.4, 1.0), (6, 0.3, 0.7)] {
            // their p is of all ids, ours of the k that are left
            let mut all: Vec<f64> = logits().iter().map(|l| (f64::from(*l) / temperature).exp()).collect();
            all.sort_by(|a, b| b.total_cmp(a));
            let share = p * all.iter().sum::<f64>() / all[..k].iter().sum::<f64>();
            let ours = Sampling { top_k: Some(k), top_p: Some(share), ..Sampling::temperature(temperature) };
            check(Theirs::TopKThenTopP { k, p, temperature }, ours);
        }
    }
}
