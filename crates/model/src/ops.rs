//! The model's operations from the tensor library's differentiable steps: slow, checkable by reading, the same on every
//! device and in f32 and f64.
//!
//! The library's own layer norm, softmax and GELU don't serve here: the first two cut the graph silently (no
//! gradient reaches what comes before them), the third has constants of seven digits in its gradient.

use candle_core::{D, DType, Device, Result, Tensor};
use kinelm_engine::op::cross_entropy::RowTarget;
use kinelm_engine::op::smoothing::Smoothing;

/// Stands for minus infinity in a mask: what it hides gets exactly 0, and a row that hides all is no NaN.
const HIDDEN: f64 = -1e30;

/// GPT-2's GELU, in its tanh form.
///
/// # Errors
/// None on floats.
///
/// Source: Hendrycks and Gimpel, "Gaussian error linear units" (2016), the approximation with 0.044715.
pub fn gelu(x: &Tensor) -> Result<Tensor> {
    let slope = (2.0 / std::f64::consts::PI).sqrt();
    let u = ((x + ((x.sqr()? * x)? * 0.044715)?)? * slope)?;
    (x * 0.5)? * (u.tanh()? + 1.0)?
}

/// Each row of `x` (.., D) brought to mean 0 and variance 1 (biased, `epsilon` added), times `weight` (D), plus `bias` (D).
///
/// # Errors
/// Shapes that don't fit.
pub fn layer_norm(x: &Tensor, weight: &Tensor, bias: &Tensor, epsilon: f64) -> Result<Tensor> {
    // centred first: the mean of squares less the square of the mean cancels where rows are far from 0
    let centred = x.broadcast_sub(&x.mean_keepdim(D::Minus1)?)?;
    let variance = centred.sqr()?.mean_keepdim(D::Minus1)?;
    let normal = centred.broadcast_div(&(variance + epsilon)?.sqrt()?)?;
    normal.broadcast_mul(weight)?.broadcast_add(bias)
}

/// The tokens that a token may see.
#[derive(Debug, Clone)]
pub enum Mask {
    /// Itself and the tokens before it.
    Causal,
    /// Every token.
    Full,
    /// What this adds to the scores (B, H, queries, keys) or broadcasts to them; minus infinity hides. A query that sees
    /// nothing attends to nothing: its row of weights is 0.
    Additive(Tensor),
}

/// A mask as it is added to scores.
#[derive(Debug, Clone)]
pub struct Hiding {
    /// Numbers that are added to the scores; finite.
    add: Tensor,
    /// 1 where a place is seen, 0 where it is hidden; only where a row may hide everything.
    seen: Option<Tensor>,
}

impl Mask {
    /// What to do with the scores of `queries` that are the last of `keys` places; `None`: nothing.
    ///
    /// # Errors
    /// More queries than keys; what the device refuses.
    pub(crate) fn hiding(&self, queries: usize, keys: usize, dtype: DType, device: &Device) -> Result<Option<Hiding>> {
        if queries > keys {
            candle_core::bail!("{queries} queries over {keys} keys; expected as many keys or more");
        }
        match self {
            Mask::Causal if queries > 1 => {
                let add = |q: usize, k: usize| if k > keys - queries + q { HIDDEN as f32 } else { 0.0 };
                let add: Vec<f32> = (0..queries).flat_map(|q| (0..keys).map(move |k| add(q, k))).collect();
                let add = Tensor::from_vec(add, (queries, keys), device)?.to_dtype(dtype)?;
                Ok(Some(Hiding { add, seen: None }))
            }
            Mask::Causal | Mask::Full => Ok(None),
            Mask::Additive(mask) => {
                let mask = mask.to_device(device)?.to_dtype(dtype)?;
                // a row that hides all gets even weights from the softmax, which `seen` then sets to 0
                Ok(Some(Hiding { add: mask.maximum(HIDDEN)?, seen: Some(mask.gt(HIDDEN)?.to_dtype(dtype)?) }))
            }
        }
    }
}

/// Softmax of `scores` (B, H, queries, keys) over the keys that a query may see; the others get 0.
///
/// # Errors
/// A mask of another shape.
pub fn masked_softmax(scores: &Tensor, hiding: Option<&Hiding>) -> Result<Tensor> {
    let Some(Hiding { add, seen }) = hiding else { return softmax(scores) };
    let weights = softmax(&scores.broadcast_add(add)?)?;
    match seen {
        Some(seen) => weights.broadcast_mul(seen),
        None => Ok(weights),
    }
}

fn softmax(x: &Tensor) -> Result<Tensor> {
    // the maximum cancels out of value and gradient
    let e = x.broadcast_sub(&x.max_keepdim(D::Minus1)?.detach())?.exp()?;
    e.broadcast_div(&e.sum_keepdim(D::Minus1)?)
}

/// -ln p of the target of every row of `logits` (N, C), in nats (N). With `smoothing` the numbers are the same, and their
/// gradient is that of the cross-entropy with the smoothed targets.
///
/// # Errors
/// For another number of targets than rows, or targets outside the columns.
pub fn nats(logits: &Tensor, targets: &[RowTarget], smoothing: Option<&Smoothing>) -> Result<Tensor> {
    let (rows, columns) = logits.dims2()?;
    let outside =
        |a: &&RowTarget| (a.first + a.count) as usize > columns || !(a.first..a.first + a.count).contains(&a.target);
    if let Some(a) = targets.iter().find(outside) {
        candle_core::bail!("column {} of {} from {} on, of {columns} in all", a.target, a.count, a.first);
    }
    let columns_of_targets: Vec<u32> = targets.iter().map(|a| a.target).collect();
    let columns_of_targets = Tensor::from_vec(columns_of_targets, (rows, 1), logits.device())?;
    let mut x = logits.clone();
    if targets.iter().any(|a| a.count as usize != columns) {
        let hide = |a: &RowTarget, c: usize| {
            if c.wrapping_sub(a.first as usize) < a.count as usize { 0.0 } else { f32::NEG_INFINITY }
        };
        let hide: Vec<f32> = targets.iter().flat_map(|a| (0..columns).map(move |c| hide(a, c))).collect();
        x = (x + Tensor::from_vec(hide, (rows, columns), logits.device())?.to_dtype(logits.dtype())?)?;
    }
    let x = x.broadcast_sub(&x.max_keepdim(1)?.detach())?;
    let sum = x.exp()?.sum_keepdim(1)?.log()?;
    let nats = (&sum - x.gather(&columns_of_targets, 1)?)?.squeeze(1)?;
    let Some(smoothing) = smoothing else { return Ok(nats) };
    let smooth = (sum.squeeze(1)? - mean_of_neighbours(&x, targets, smoothing)?)?;
    // the value of one, the gradient of the other
    nats.detach() + (&smooth - smooth.detach())?
}

/// Of every row of `x` (N, C), the mean over the columns that share the target's mass (N).
fn mean_of_neighbours(x: &Tensor, targets: &[RowTarget], smoothing: &Smoothing) -> Result<Tensor> {
    let most = 2 * smoothing.reach() + 1;
    let (mut columns, mut shares) = (Vec::new(), Vec::new());
    for (i, a) in targets.iter().enumerate() {
        smoothing.shares(a.target, a.bins, |column, share| {
            columns.push(column);
            shares.push(share);
        });
        // padding points at the target, whose logit is finite: 0 times minus infinity would be NaN
        columns.resize((i + 1) * most, a.target);
        shares.resize((i + 1) * most, 0.0);
    }
    let columns = Tensor::from_vec(columns, (targets.len(), most), x.device())?;
    let shares = Tensor::from_vec(shares, (targets.len(), most), &Device::Cpu)?.to_dtype(x.dtype())?;
    (x.gather(&columns, 1)? * shares.to_device(x.device())?)?.sum(1)
}

#[cfg(any(test, feature = "fixtures"))]
#[doc(hidden)]
pub mod check {
    use candle_core::{Device, Tensor};
    use rand_chacha::rand_core::RngCore;

    /// Random f64 tensor of `shape` in -range..range.
    pub fn random(purpose: &str, shape: &[usize], range: f64) -> Tensor {
        let mut rng = kinelm_store::random::stream(7, purpose, 0, 0);
        let n = shape.iter().product();
        let data: Vec<f64> = (0..n).map(|_| (rng.next_u32() as f64 / u32::MAX as f64 * 2.0 - 1.0) * range).collect();
        Tensor::from_vec(data, shape, &Device::Cpu).unwrap()
    }
}

#[cfg(test)]
mod tests {
    use super::check::random;
    use super::*;
    use kinelm_engine::bins::Bins;

    fn rows(t: &Tensor) -> Vec<Vec<f64>> {
        let width = t.dim(D::Minus1).unwrap();
        t.reshape(((), width)).unwrap().to_vec2().unwrap()
    }

    fn near(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-12, "{a}, expected {b}");
    }

    #[test]
    fn values_are_those_of_the_definitions() {
        let (x, w, b) = (random("x", &[3, 5], 3.0), random("w", &[5], 2.0), random("b", &[5], 2.0));
        let (numbers, w1, b1) = (rows(&x), &rows(&w)[0], &rows(&b)[0]);
        let (normal, smooth) = (rows(&layer_norm(&x, &w, &b, 1e-5).unwrap()), rows(&gelu(&x).unwrap()));
        // all columns, the last three, the first two
        let targets = [(4, 0, 5), (3, 2, 3), (0, 0, 2)];
        let targets = targets.map(|(target, first, count)| RowTarget { target, first, count, bins: Bins::NONE });
        let nats = super::nats(&x, &targets, None).unwrap().to_vec1::<f64>().unwrap();
        for (r, row) in numbers.iter().enumerate() {
            let mean = row.iter().sum::<f64>() / 5.0;
            let sd = (row.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 5.0 + 1e-5).sqrt();
            for (i, &x) in row.iter().enumerate() {
                near(normal[r][i], (x - mean) / sd * w1[i] + b1[i]);
                let u = (2.0 / std::f64::consts::PI).sqrt() * (x + 0.044715 * x * x * x);
                near(smooth[r][i], 0.5 * x * (1.0 + u.tanh()));
            }
            let RowTarget { target, first, count, .. } = targets[r];
            let sum: f64 = row[first as usize..][..count as usize].iter().map(|x| x.exp()).sum();
            near(nats[r], sum.ln() - row[target as usize]);
        }
    }

    #[test]
    fn a_mask_hides_and_a_row_that_sees_nothing_is_zero() {
        let scores = random("scores", &[2, 1, 2, 3], 4.0);
        let hiding = |mask: &Mask, queries| mask.hiding(queries, 3, DType::F64, &Device::Cpu);
        let weights = |mask: &Mask| rows(&masked_softmax(&scores, hiding(mask, 2).unwrap().as_ref()).unwrap());
        let of = |row: &[f64], seen: &[bool]| {
            let e: Vec<f64> = row.iter().zip(seen).map(|(x, &s)| if s { x.exp() } else { 0.0 }).collect();
            let sum: f64 = e.iter().sum();
            e.iter().map(|e| if sum > 0.0 { e / sum } else { 0.0 }).collect::<Vec<_>>()
        };
        let hide = |seen: &[[bool; 3]; 2]| {
            let add = seen.iter().flatten().map(|&s| if s { 0.0 } else { f64::NEG_INFINITY }).collect::<Vec<_>>();
            Mask::Additive(Tensor::from_vec(add, (2, 3), &Device::Cpu).unwrap())
        };
        let (causal, none) = ([[true, true, false], [true; 3]], [[false; 3], [true, false, true]]);
        for (mask, seen) in
            [(Mask::Causal, causal), (Mask::Full, [[true; 3]; 2]), (hide(&causal), causal), (hide(&none), none)]
        {
            for (i, (found, row)) in weights(&mask).iter().zip(rows(&scores)).enumerate() {
                found.iter().zip(of(&row, &seen[i % 2])).for_each(|(a, b)| near(*a, b));
            }
        }
        assert!(hiding(&Mask::Full, 4).unwrap_err().to_string().contains("4 queries over 3 keys"));
    }

    #[test]
    fn smoothed_targets_change_the_gradient_and_not_the_number() {
        let x = candle_core::Var::from_tensor(&random("x", &[1, 6], 2.0)).unwrap();
        let bins = Bins { first: 1, count: 4, circular: true };
        let targets = [RowTarget { target: 1, first: 0, count: 6, bins }];
        let gradient = |smoothing: Option<&Smoothing>| {
            let nats = nats(x.as_tensor(), &targets, smoothing).unwrap().sum_all().unwrap();
            let store = nats.backward().unwrap();
            (nats.to_scalar::<f64>().unwrap(), rows(store.get(x.as_tensor()).unwrap())[0].clone())
        };
        let (plain, smooth) = (gradient(None), gradient(Some(&Smoothing::new(0.4))));
        near(plain.0, smooth.0);
        // one neighbour on each side, round the circle of 1 to 4
        let side = (-1.0 / (2.0 * 0.4 * 0.4f64)).exp();
        let mass = [0.0, 1.0, side, 0.0, side, 0.0].map(|w| w / (1.0 + 2.0 * side));
        for (column, mass) in mass.into_iter().enumerate() {
            let one = if column == 1 { 1.0 } else { 0.0 };
            near(smooth.1[column] + mass, plain.1[column] + one);
        }
    }

    #[test]
    fn wrong_questions_are_refused() {
        let logits = random("logits", &[1, 5], 1.0);
        let said = |target, first, count| {
            nats(&logits, &[RowTarget { target, first, count, bins: Bins::NONE }], None).unwrap_err().to_string()
        };
        assert!(said(5, 0, 5).contains("column 5 of 5 from 0 on, of 5 in all"));
        assert!(said(1, 2, 3).contains("column 1 of 3 from 2 on"));
        assert!(said(4, 2, 4).contains("column 4 of 4 from 2 on, of 5"));
    }
}
