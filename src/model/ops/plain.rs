//! The operations from the tensor library's differentiable steps: slow, and right by looking at them.

use candle_core::{D, Result, Tensor};
use candle_nn::ops;

/// See [`super::add_bias`].
///
/// # Errors
/// Shapes that don't fit.
pub fn add_bias(x: &Tensor, bias: &Tensor) -> Result<Tensor> {
    x.broadcast_add(bias)
}

/// See [`super::gelu`].
///
/// # Errors
/// None on floats.
pub fn gelu(x: &Tensor) -> Result<Tensor> {
    // the library's own gelu has constants of seven digits in its gradient
    let slope = (2.0 / std::f64::consts::PI).sqrt();
    let u = ((x + (x.powf(3.0)? * 0.044715)?)? * slope)?;
    (x * 0.5)? * (u.tanh()? + 1.0)?
}

/// See [`super::layer_norm`].
///
/// # Errors
/// Shapes that don't fit.
pub fn layer_norm(x: &Tensor, weight: &Tensor, bias: &Tensor, epsilon: f64) -> Result<Tensor> {
    let centred = x.broadcast_sub(&x.mean_keepdim(D::Minus1)?)?;
    let variance = centred.sqr()?.mean_keepdim(D::Minus1)?;
    let normal = centred.broadcast_div(&(variance + epsilon)?.sqrt()?)?;
    normal.broadcast_mul(weight)?.broadcast_add(bias)
}

/// See [`super::causal_softmax`].
///
/// # Errors
/// Fewer keys than queries.
pub fn causal_softmax(scores: &Tensor, scale: f64) -> Result<Tensor> {
    let (_, queries, keys) = scores.dims3()?;
    let hidden = |r: usize, k: usize| if k > keys - queries + r { f64::NEG_INFINITY } else { 0.0 };
    let mask: Vec<f64> = (0..queries).flat_map(|r| (0..keys).map(move |k| hidden(r, k))).collect();
    let mask = Tensor::from_vec(mask, (1, queries, keys), scores.device())?.to_dtype(scores.dtype())?;
    ops::softmax(&(scores * scale)?.broadcast_add(&mask)?, D::Minus1)
}

/// See [`super::cross_entropy_sum`].
///
/// # Errors
/// Another number of targets than rows.
pub fn cross_entropy_sum(logits: &Tensor, targets: &[u32], ignored: u32) -> Result<Tensor> {
    let counted: Vec<f64> = targets.iter().map(|&t| if t == ignored { 0.0 } else { -1.0 }).collect();
    let counted = Tensor::new(counted, logits.device())?.to_dtype(logits.dtype())?;
    let ids: Vec<u32> = targets.iter().map(|&t| if t == ignored { 0 } else { t }).collect();
    let ids = Tensor::new(ids, logits.device())?.unsqueeze(1)?;
    let log_p = ops::log_softmax(logits, D::Minus1)?.gather(&ids, 1)?.squeeze(1)?;
    (log_p * counted)?.sum_all()
}
