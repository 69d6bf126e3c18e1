use super::*;
use crate::feature::tests::{largest_difference, noise};
use crate::pca::PcaFit;
use crate::{LowDct, Stft};
use candle_core::{Device, Tensor, Var};

const C: usize = 3;
const N: usize = 64;

fn transforms() -> Vec<Transform> {
    let mut fit = PcaFit::new(N);
    fit.add(&noise(11, N * 40));
    vec![
        Transform::Dct(LowDct::new(N, 9)),
        Transform::Pca(fit.finish(7).unwrap()),
        Transform::Stft(Stft::new(N, false)),
        Transform::Stft(Stft::new(N, true)),
    ]
}

/// (N, K) the matrix of a linear map of series, column by column its answers to unit series.
fn matrix(map: impl Fn(&[f64]) -> Vec<f64>) -> Tensor {
    let rows: Vec<Vec<f64>> =
        (0..N).map(|t| map(&(0..N).map(|i| f64::from(u8::from(i == t))).collect::<Vec<_>>())).collect();
    Tensor::new(rows, &Device::Cpu).unwrap()
}

/// The feature of (C, N) in candle's own operations.
fn feature(transform: &Transform, x: &Tensor) -> Tensor {
    match transform {
        Transform::Dct(t) => x.matmul(&matrix(|s| t.low(s))).unwrap(),
        Transform::Pca(t) => {
            let mean = Tensor::new(t.mean.as_slice(), &Device::Cpu).unwrap();
            let components = Tensor::from_slice(&t.components, (t.kept(), N), &Device::Cpu).unwrap();
            x.broadcast_sub(&mean).unwrap().matmul(&components.t().unwrap()).unwrap()
        }
        Transform::Stft(t) => {
            let re = x.matmul(&matrix(|s| t.forward(s).0)).unwrap();
            let im = x.matmul(&matrix(|s| t.forward(s).1)).unwrap();
            let all = (re.sqr().unwrap() + im.sqr().unwrap()).unwrap().sqrt().unwrap();
            let all = all.reshape((C, t.frames(), t.bins())).unwrap();
            let first = t.bins() - t.kept() / t.frames();
            all.narrow(2, first, t.bins() - first).unwrap().contiguous().unwrap().reshape((C, t.kept())).unwrap()
        }
    }
}

#[test]
fn the_gradient_is_the_one_that_candle_finds_by_itself() {
    let (x, b) = (noise(1, C * N), noise(2, C * N));
    for transform in transforms() {
        let goal = Goal { transform: &transform, channels: C, target: transform.feature(&b, C) };
        let (loss, gradient) = goal.loss_and_gradient(&x);
        let var = Var::from_slice(&x, (C, N), &Device::Cpu).unwrap();
        let target = Tensor::from_slice(&goal.target, (C, transform.kept()), &Device::Cpu).unwrap();
        let theirs = (feature(&transform, &var) - target).unwrap().sqr().unwrap().mean_all().unwrap();
        let slopes = theirs.backward().unwrap();
        let slopes = slopes.get(&var).unwrap().flatten_all().unwrap().to_vec1::<f64>().unwrap();
        assert!((theirs.to_scalar::<f64>().unwrap() - loss).abs() < 1e-12 * loss);
        let size = gradient.iter().fold(0.0f64, |m, g| m.max(g.abs()));
        assert!(largest_difference(&gradient, &slopes) < 1e-11 * size, "{transform:?}");
    }
}

#[test]
fn plain_descent_goes_where_the_closed_form_says() {
    let (a, b) = (noise(3, C * N), noise(4, C * N));
    for transform in &transforms()[..2] {
        let n = C * transform.kept();
        for (strength, rate, steps) in [(1.0, 0.2, 40), (0.5, 1.3, 30), (1.0, 0.5 * n as f64, 1)] {
            let descent = Descent { strength, rate: Some(rate), steps };
            let amount = strength * (1.0 - (1.0 - 2.0 * rate / n as f64).powi(steps as i32));
            let plain = descend(transform, C, &a, &b, Method::Plain(descent)).unwrap();
            let closed = descend(transform, C, &a, &b, Method::Closed { amount }).unwrap();
            assert!(largest_difference(&plain.window, &closed.window) < 1e-9, "{transform:?} {descent:?}");
            assert!(plain.loss[1] < plain.loss[0]);
        }
        let steps = 37;
        let rate = Descent::rate_for(0.3, n, steps);
        let plain =
            descend(transform, C, &a, &b, Method::Plain(Descent { strength: 1.0, rate: Some(rate), steps })).unwrap();
        let closed = descend(transform, C, &a, &b, Method::Closed { amount: 0.3 }).unwrap();
        assert!(largest_difference(&plain.window, &closed.window) < 1e-9);
    }
}

#[test]
fn only_the_kept_coefficients_move() {
    let (a, b) = (noise(5, C * N), noise(6, C * N));
    let dct = LowDct::new(N, 9);
    let half = descend(&Transform::Dct(dct.clone()), C, &a, &b, Method::Closed { amount: 0.5 }).unwrap().window;
    for c in 0..C {
        let of = |x: &[f64]| dct.forward(&x[c * N..][..N]);
        let (a, b, out) = (of(&a), of(&b), of(&half));
        let low: Vec<f64> = a.iter().zip(&b).take(9).map(|(a, b)| 0.5 * (a + b)).collect();
        assert!(largest_difference(&out[..9], &low) < 1e-12 && largest_difference(&out[9..], &a[9..]) < 1e-12);
    }
}

#[test]
fn adam_comes_to_the_goal_of_every_transform() {
    let (a, b) = (noise(7, C * N), noise(8, C * N));
    for transform in transforms() {
        let descent = Descent { strength: 0.5, rate: None, steps: Descent::STEPS };
        let way = descend(&transform, C, &a, &b, Method::Adam(descent)).unwrap();
        // overlapping magnitudes contradict each other a little
        let most = if matches!(transform, Transform::Stft(_)) { 0.2 } else { 1e-6 };
        assert!(way.loss[1] < most * way.loss[0], "{transform:?}: {:?}", way.loss);
        if !matches!(transform, Transform::Stft(_)) {
            let closed = descend(&transform, C, &a, &b, Method::Closed { amount: 0.5 }).unwrap();
            let off = largest_difference(&way.window, &closed.window);
            assert!(off < 1e-3, "{transform:?}: {off}, nothing but the kept coefficients moves");
        }
        let none = descend(&transform, C, &a, &b, Method::Adam(Descent { strength: 0.0, ..descent })).unwrap();
        assert!(largest_difference(&none.window, &a) < 1e-9, "no strength, no change");
    }
}

#[test]
fn what_cannot_be_is_refused() {
    let (a, b) = (noise(9, C * N), noise(10, C * N));
    let all = transforms();
    let said = |t: &Transform, method: Method| descend(t, C, &a, &b, method).unwrap_err().to_string();
    assert!(said(&all[2], Method::Closed { amount: 0.5 }).contains("no closed form"));
    assert!(said(&all[0], Method::Closed { amount: 1.5 }).contains("`amount` is 1.5; expected 0"));
    let descent = Descent { strength: -0.1, rate: Some(0.01), steps: 1 };
    assert!(said(&all[0], Method::Adam(descent)).contains("`strength` is -0.1"));
    assert!(
        said(&all[0], Method::Plain(Descent { strength: 1.0, rate: Some(f64::NAN), steps: 1 }))
            .contains("`rate` is NaN")
    );
    let wild = Descent { strength: 1.0, rate: Some(1e9), steps: 60 };
    assert!(said(&all[0], Method::Plain(wild)).contains("smaller one"));
}
