//! The model's operations, each with its gradient.
//!
//! On the CPU these are single passes over memory; [`plain`] holds the same from the tensor library's own small steps,
//! which other devices use and the tests compare with, values and gradients. The library's fused layer norm and softmax
//! would cut the graph without a word (no gradient reaches what stands before them), its stepwise ones take several
//! times as long.

mod bias;
mod causal_softmax;
mod cross_entropy;
mod gelu;
mod layer_norm;
pub mod plain;

use candle_core::{CpuStorage, DType, Layout, Result, Storage, Tensor, WithDType};

/// `x` (.., D) + `bias` (D).
///
/// # Errors
/// Shapes that don't fit.
pub fn add_bias(x: &Tensor, bias: &Tensor) -> Result<Tensor> {
    if fused(x) { x.apply_op2(bias, bias::AddBias) } else { plain::add_bias(x, bias) }
}

/// GPT-2's GELU, in its tanh form.
///
/// # Errors
/// None on floats.
///
/// Source: Hendrycks and Gimpel, "Gaussian error linear units" (2016), the approximation with 0.044715.
pub fn gelu(x: &Tensor) -> Result<Tensor> {
    if fused(x) { x.apply_op1(gelu::Gelu) } else { plain::gelu(x) }
}

/// Each row of `x` (.., D) brought to mean 0 and variance 1 (biased, `epsilon` added), times `weight` (D), plus `bias` (D).
///
/// # Errors
/// Shapes that don't fit.
pub fn layer_norm(x: &Tensor, weight: &Tensor, bias: &Tensor, epsilon: f64) -> Result<Tensor> {
    if fused(x) {
        x.apply_op3(weight, bias, layer_norm::LayerNorm { epsilon })
    } else {
        plain::layer_norm(x, weight, bias, epsilon)
    }
}

/// Softmax of `scale * scores` over the keys that a query may see.
///
/// `scores` (N, R, K): the queries are the last R of K places, so row r sees keys `0..=K - R + r`; the others get 0.
///
/// # Errors
/// Fewer keys than queries.
pub fn causal_softmax(scores: &Tensor, scale: f64) -> Result<Tensor> {
    let (_, queries, keys) = scores.dims3()?;
    if queries > keys {
        candle_core::bail!("causal softmax of {queries} queries over {keys} keys; expected as many keys or more");
    }
    if fused(scores) {
        scores.apply_op1(causal_softmax::CausalSoftmax { scale })
    } else {
        plain::causal_softmax(scores, scale)
    }
}

/// Sum of -ln p(target) over the rows of `logits` (N, V) whose target is not `ignored`, in nats; `targets` has N ids.
///
/// # Errors
/// Another number of targets than rows, a target outside the vocabulary.
pub fn cross_entropy_sum(logits: &Tensor, targets: &[u32], ignored: u32) -> Result<Tensor> {
    let (rows, vocabulary) = logits.dims2()?;
    if rows != targets.len() {
        candle_core::bail!("{} targets for {rows} rows of logits", targets.len());
    }
    if let Some(bad) = targets.iter().find(|&&t| t != ignored && t as usize >= vocabulary) {
        candle_core::bail!("target {bad} outside the vocabulary of {vocabulary} ids");
    }
    if fused(logits) {
        logits.apply_op1(cross_entropy::CrossEntropySum { targets: targets.to_vec(), ignored })
    } else {
        plain::cross_entropy_sum(logits, targets, ignored)
    }
}

/// Rows that one parallel task takes; sums over rows add up task by task, so they don't depend on the threads.
const ROWS: usize = 64;

fn fused(x: &Tensor) -> bool {
    x.device().is_cpu() && matches!(x.dtype(), DType::F32 | DType::F64)
}

/// The floats that the operations are written for: f32 to train, f64 to check gradients.
pub(crate) trait Real: WithDType {
    fn exp(self) -> Self;
    fn ln(self) -> Self;
    fn sqrt(self) -> Self;
}

macro_rules! real {
    ($($float:ty),*) => {$(
        impl Real for $float {
            fn exp(self) -> Self { <$float>::exp(self) }
            fn ln(self) -> Self { <$float>::ln(self) }
            fn sqrt(self) -> Self { <$float>::sqrt(self) }
        }
    )*};
}
real!(f32, f64);

/// Calls `$f::<f32>` or `$f::<f64>`.
macro_rules! by_dtype {
    ($dtype:expr, $f:ident($($arg:expr),*)) => {
        match $dtype {
            candle_core::DType::F32 => $f::<f32>($($arg),*),
            candle_core::DType::F64 => $f::<f64>($($arg),*),
            other => candle_core::bail!("{} knows f32 and f64, not {other:?}", stringify!($f)),
        }
    };
}
pub(crate) use by_dtype;

/// The numbers of a contiguous operand.
fn dense<'a, T: Real>(storage: &'a CpuStorage, layout: &Layout) -> Result<&'a [T]> {
    match layout.contiguous_offsets() {
        Some((start, end)) => Ok(&T::cpu_storage_as_slice(storage)?[start..end]),
        None => candle_core::bail!("the operation wants a contiguous operand, found strides {:?}", layout.stride()),
    }
}

/// Hands the numbers of a CPU tensor to `f`.
pub(crate) fn with_slice<T: Real, R>(tensor: &Tensor, f: impl FnOnce(&[T]) -> Result<R>) -> Result<R> {
    let tensor = tensor.contiguous()?;
    let (storage, layout) = tensor.storage_and_layout();
    match &*storage {
        Storage::Cpu(storage) => f(dense::<T>(storage, layout)?),
        _ => candle_core::bail!("the operation wants a tensor on the CPU"),
    }
}

/// A CPU tensor of `data` in the shape of `like`.
fn tensor_like<T: Real>(data: Vec<T>, like: &Tensor) -> Result<Tensor> {
    Tensor::from_vec(data, like.shape(), like.device())
}

/// Adds `rows` sums, one after the other.
fn sum_of<T: Real>(partial: impl Iterator<Item = Vec<T>>, width: usize) -> Vec<T> {
    let mut sum = vec![T::zero(); width];
    for part in partial {
        for (s, p) in sum.iter_mut().zip(part) {
            *s += p;
        }
    }
    sum
}

#[cfg(test)]
pub(crate) mod check {
    //! One check for every operation: fused against plain, values and gradients, in both precisions.
    use candle_core::{DType, Device, Result, Tensor, Var};
    use rand_chacha::rand_core::RngCore;

    /// Random tensor of `shape` in -range..range.
    pub fn random(purpose: &str, shape: &[usize], range: f64) -> Tensor {
        let mut rng = crate::random::stream(7, purpose, 0, 0);
        let n = shape.iter().product();
        let data: Vec<f64> = (0..n).map(|_| (rng.next_u32() as f64 / u32::MAX as f64 * 2.0 - 1.0) * range).collect();
        Tensor::from_vec(data, shape, &Device::Cpu).unwrap()
    }

    type Op<'a> = &'a dyn Fn(&[Tensor]) -> Result<Tensor>;

    fn run(op: Op, inputs: &[Tensor], dtype: DType) -> (Vec<f64>, Vec<Vec<f64>>) {
        let vars: Vec<Var> = inputs.iter().map(|t| Var::from_tensor(&t.to_dtype(dtype).unwrap()).unwrap()).collect();
        let tensors: Vec<Tensor> = vars.iter().map(|v| v.as_tensor().clone()).collect();
        let out = op(&tensors).unwrap();
        // a loss that weighs every output differently
        let weights = random("loss weights", out.dims(), 1.0).to_dtype(dtype).unwrap();
        let grads = (&out * weights).unwrap().sum_all().unwrap().backward().unwrap();
        let flat = |t: &Tensor| t.to_dtype(DType::F64).unwrap().flatten_all().unwrap().to_vec1::<f64>().unwrap();
        let of = |v: &Var| flat(grads.get(v.as_tensor()).expect("every input gets a gradient"));
        (flat(&out), vars.iter().map(of).collect())
    }

    fn furthest(a: &[f64], b: &[f64]) -> f64 {
        assert_eq!(a.len(), b.len());
        let scale = b.iter().fold(1.0, |m: f64, x| m.max(x.abs()));
        a.iter().zip(b).fold(0.0, |m: f64, (x, y)| m.max((x - y).abs() / scale))
    }

    /// f64 agrees to 1e-12 of the largest value; f32 to 1e-5, which rounding explains.
    pub fn same(name: &str, fused: Op, plain: Op, inputs: &[Tensor]) {
        let truth = run(plain, inputs, DType::F64);
        for (dtype, bound) in [(DType::F64, 1e-12), (DType::F32, 1e-5)] {
            let got = run(fused, inputs, dtype);
            let apart = furthest(&got.0, &truth.0);
            assert!(apart <= bound, "{name} {dtype:?}: values {apart:e} apart, at most {bound:e} allowed");
            for (i, (g, t)) in got.1.iter().zip(&truth.1).enumerate() {
                let apart = furthest(g, t);
                assert!(apart <= bound, "{name} {dtype:?}: gradient {i} {apart:e} apart, at most {bound:e} allowed");
            }
        }
    }
}
