//! Layer norm over the last dimension.
//!
//! With y = (x - mean)/sd, the gradient is (g - mean(g) - y mean(g y))/sd where g = grad * weight.

use super::{ROWS, Real, by_dtype, dense, sum_of, tensor_like, with_slice};
use candle_core::backend::BackendStorage;
use candle_core::{CpuStorage, CustomOp3, Layout, Result, Shape, Tensor};
use rayon::prelude::*;

pub(super) struct LayerNorm {
    pub epsilon: f64,
}

impl CustomOp3 for LayerNorm {
    fn name(&self) -> &'static str {
        "layer-norm"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        xl: &Layout,
        w: &CpuStorage,
        wl: &Layout,
        b: &CpuStorage,
        bl: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        Ok((by_dtype!(x.dtype(), forward(self.epsilon, x, xl, w, wl, b, bl))?, xl.shape().clone()))
    }

    fn bwd(
        &self,
        x: &Tensor,
        weight: &Tensor,
        _: &Tensor,
        _: &Tensor,
        grad: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let (dx, dw, db) = by_dtype!(x.dtype(), backward(self.epsilon, x, weight, grad))?;
        Ok((Some(dx), Some(dw), Some(db)))
    }
}

/// Mean and 1/sd of a row.
fn moments<T: Real>(row: &[T], epsilon: f64) -> (T, T) {
    let n = T::from_f64(row.len() as f64);
    let mean = row.iter().fold(T::zero(), |s, &x| s + x) / n;
    let variance = row.iter().fold(T::zero(), |s, &x| s + (x - mean) * (x - mean)) / n;
    (mean, T::one() / (variance + T::from_f64(epsilon)).sqrt())
}

fn forward<T: Real>(
    epsilon: f64,
    x: &CpuStorage,
    xl: &Layout,
    w: &CpuStorage,
    wl: &Layout,
    b: &CpuStorage,
    bl: &Layout,
) -> Result<CpuStorage> {
    let (x, weight, bias) = (dense::<T>(x, xl)?, dense::<T>(w, wl)?, dense::<T>(b, bl)?);
    let width = weight.len();
    if width == 0 || xl.dims().last() != Some(&width) || bias.len() != width {
        candle_core::bail!("layer norm of {:?} with weight {width} and bias {}", xl.dims(), bias.len());
    }
    let mut out = x.to_vec();
    out.par_chunks_mut(ROWS * width).for_each(|rows| {
        for row in rows.chunks_mut(width) {
            let (mean, rsd) = moments(row, epsilon);
            for ((o, &w), &b) in row.iter_mut().zip(weight).zip(bias) {
                *o = (*o - mean) * rsd * w + b;
            }
        }
    });
    Ok(T::to_cpu_storage_owned(out))
}

fn backward<T: Real>(epsilon: f64, x: &Tensor, weight: &Tensor, grad: &Tensor) -> Result<(Tensor, Tensor, Tensor)> {
    let width = weight.elem_count();
    let mut dx = with_slice(grad, |g: &[T]| Ok(g.to_vec()))?;
    // dw and db stand side by side
    let dwb = with_slice(weight, |weight: &[T]| {
        with_slice(x, |x: &[T]| {
            let partial: Vec<Vec<T>> = dx
                .par_chunks_mut(ROWS * width)
                .zip(x.par_chunks(ROWS * width))
                .map(|(dx, x)| {
                    let mut sums = vec![T::zero(); 2 * width];
                    for (dx, x) in dx.chunks_mut(width).zip(x.chunks(width)) {
                        row_backward(dx, x, weight, epsilon, &mut sums);
                    }
                    sums
                })
                .collect();
            Ok(sum_of(partial.into_iter(), 2 * width))
        })
    })?;
    let dw = Tensor::from_slice(&dwb[..width], width, x.device())?;
    let db = Tensor::from_slice(&dwb[width..], width, x.device())?;
    Ok((tensor_like(dx, x)?, dw, db))
}

/// `dx` holds the gradient of the output and becomes that of the input.
fn row_backward<T: Real>(dx: &mut [T], x: &[T], weight: &[T], epsilon: f64, sums: &mut [T]) {
    let (mean, rsd) = moments(x, epsilon);
    let (dw, db) = sums.split_at_mut(x.len());
    let (mut g_sum, mut gy_sum) = (T::zero(), T::zero());
    for i in 0..x.len() {
        let y = (x[i] - mean) * rsd;
        dw[i] += dx[i] * y;
        db[i] += dx[i];
        dx[i] *= weight[i];
        g_sum += dx[i];
        gy_sum += dx[i] * y;
    }
    let n = T::from_f64(x.len() as f64);
    let (g_mean, gy_mean) = (g_sum / n, gy_sum / n);
    for (d, &x) in dx.iter_mut().zip(x) {
        *d = (*d - g_mean - (x - mean) * rsd * gy_mean) * rsd;
    }
}

#[cfg(test)]
mod tests {
    use super::super::check::{random, same};
    use super::super::{layer_norm, plain};

    #[test]
    fn fused_is_plain() {
        for (rows, width) in [(1, 3), (5, 8), (131, 16)] {
            let inputs = [random("x", &[rows, width], 3.0), random("w", &[width], 2.0), random("b", &[width], 2.0)];
            let fused = |i: &[_]| layer_norm(&i[0], &i[1], &i[2], 1e-5);
            same("layer_norm", &fused, &|i| plain::layer_norm(&i[0], &i[1], &i[2], 1e-5), &inputs);
        }
    }
}
