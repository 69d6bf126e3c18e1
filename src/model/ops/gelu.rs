//! GPT-2's GELU: 0.5 x (1 + tanh u) with u = sqrt(2/pi) (x + 0.044715 x^3), which is x * sigmoid(2 u).

use super::{Real, by_dtype, dense, tensor_like, with_slice};
use candle_core::backend::BackendStorage;
use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor};
use rayon::prelude::*;

pub(super) struct Gelu;

const CUBIC: f64 = 0.044715;
/// 2 sqrt(2/pi).
const SLOPE: f64 = 2.0 * std::f64::consts::FRAC_2_SQRT_PI * std::f64::consts::FRAC_1_SQRT_2;
/// Numbers of one parallel task.
const CHUNK: usize = 16_384;

impl CustomOp1 for Gelu {
    fn name(&self) -> &'static str {
        "gelu"
    }

    fn cpu_fwd(&self, x: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        Ok((by_dtype!(x.dtype(), forward(x, layout))?, layout.shape().clone()))
    }

    fn bwd(&self, x: &Tensor, _: &Tensor, grad: &Tensor) -> Result<Option<Tensor>> {
        Ok(Some(by_dtype!(x.dtype(), backward(x, grad))?))
    }
}

/// sigmoid(2 u(x)); the form with exp is exact at both ends and needs no tanh.
fn gate<T: Real>(x: T) -> T {
    let u2 = T::from_f64(SLOPE) * x * (T::one() + T::from_f64(CUBIC) * x * x);
    T::one() / (T::one() + (T::zero() - u2).exp())
}

fn slope<T: Real>(x: T) -> T {
    let s = gate(x);
    s + x * s * (T::one() - s) * T::from_f64(SLOPE) * (T::one() + T::from_f64(3.0 * CUBIC) * x * x)
}

fn forward<T: Real>(x: &CpuStorage, layout: &Layout) -> Result<CpuStorage> {
    let mut out = dense::<T>(x, layout)?.to_vec();
    out.par_chunks_mut(CHUNK).for_each(|chunk| chunk.iter_mut().for_each(|x| *x *= gate(*x)));
    Ok(T::to_cpu_storage_owned(out))
}

fn backward<T: Real>(x: &Tensor, grad: &Tensor) -> Result<Tensor> {
    let mut out = with_slice(grad, |g: &[T]| Ok(g.to_vec()))?;
    with_slice(x, |x: &[T]| {
        out.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK)).for_each(|(out, x)| {
            for (o, &x) in out.iter_mut().zip(x) {
                *o *= slope(x);
            }
        });
        Ok(())
    })?;
    tensor_like(out, x)
}

#[cfg(test)]
mod tests {
    use super::super::check::{random, same};
    use super::super::{gelu, plain};

    #[test]
    fn fused_is_plain() {
        for range in [0.01, 1.0, 8.0] {
            same("gelu", &|i| gelu(&i[0]), &|i| plain::gelu(&i[0]), &[random("x", &[3, 211], range)]);
        }
    }

    #[test]
    fn the_ends_are_finite() {
        let x = [-1e4f32, -90.0, 0.0, 90.0, 1e4];
        let y: Vec<f32> = x.iter().map(|&x| x * super::gate(x)).collect();
        assert_eq!(y, [0.0, 0.0, 0.0, 90.0, 1e4]);
        let d: Vec<f32> = x.iter().map(|&x| super::slope(x)).collect();
        assert_eq!(d, [0.0, 0.0, 0.5, 1.0, 1.0]);
    }
}
