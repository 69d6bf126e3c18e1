//! x + bias. The sum over rows that is the bias's gradient is what the library is slow at.

use super::{ROWS, Real, by_dtype, dense, sum_of, tensor_like, with_slice};
use candle_core::backend::BackendStorage;
use candle_core::{CpuStorage, CustomOp2, Layout, Result, Shape, Tensor};
use rayon::prelude::*;

pub(super) struct AddBias;

impl CustomOp2 for AddBias {
    fn name(&self) -> &'static str {
        "add-bias"
    }

    fn cpu_fwd(&self, x: &CpuStorage, xl: &Layout, b: &CpuStorage, bl: &Layout) -> Result<(CpuStorage, Shape)> {
        Ok((by_dtype!(x.dtype(), forward(x, xl, b, bl))?, xl.shape().clone()))
    }

    fn bwd(&self, _: &Tensor, bias: &Tensor, _: &Tensor, grad: &Tensor) -> Result<(Option<Tensor>, Option<Tensor>)> {
        Ok((Some(grad.clone()), Some(by_dtype!(grad.dtype(), row_sum(grad, bias))?)))
    }
}

fn forward<T: Real>(x: &CpuStorage, xl: &Layout, b: &CpuStorage, bl: &Layout) -> Result<CpuStorage> {
    let (x, bias) = (dense::<T>(x, xl)?, dense::<T>(b, bl)?);
    if bias.is_empty() || xl.dims().last() != Some(&bias.len()) {
        candle_core::bail!("a bias of {} for rows of {:?}", bias.len(), xl.dims());
    }
    let mut out = x.to_vec();
    out.par_chunks_mut(ROWS * bias.len()).for_each(|rows| {
        for row in rows.chunks_mut(bias.len()) {
            for (o, &b) in row.iter_mut().zip(bias) {
                *o += b;
            }
        }
    });
    Ok(T::to_cpu_storage_owned(out))
}

/// Sum of the rows of `grad`, in the shape of `bias`.
fn row_sum<T: Real>(grad: &Tensor, bias: &Tensor) -> Result<Tensor> {
    let width = bias.elem_count();
    let sum = with_slice(grad, |g: &[T]| {
        let partial: Vec<Vec<T>> =
            g.par_chunks(ROWS * width).map(|rows| sum_of(rows.chunks(width).map(|r| r.to_vec()), width)).collect();
        Ok(sum_of(partial.into_iter(), width))
    })?;
    tensor_like(sum, bias)
}

#[cfg(test)]
mod tests {
    use super::super::check::{random, same};
    use super::super::{add_bias, plain};

    #[test]
    fn fused_is_plain() {
        for (rows, width) in [(1, 1), (3, 5), (130, 7), (64, 16)] {
            let inputs = [random("x", &[2, rows, width], 3.0), random("b", &[width], 3.0)];
            same("add_bias", &|i| add_bias(&i[0], &i[1]), &|i| plain::add_bias(&i[0], &i[1]), &inputs);
        }
    }
}
