//! Scale, causal mask and softmax of attention scores in one pass; hidden keys are not even read.

use super::{Real, by_dtype, dense, tensor_like, with_slice};
use candle_core::backend::BackendStorage;
use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor};
use rayon::prelude::*;

pub(super) struct CausalSoftmax {
    pub scale: f64,
}

impl CustomOp1 for CausalSoftmax {
    fn name(&self) -> &'static str {
        "causal-softmax"
    }

    fn cpu_fwd(&self, scores: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        Ok((by_dtype!(scores.dtype(), forward(self.scale, scores, layout))?, layout.shape().clone()))
    }

    fn bwd(&self, _: &Tensor, p: &Tensor, grad: &Tensor) -> Result<Option<Tensor>> {
        Ok(Some(by_dtype!(p.dtype(), backward(self.scale, p, grad))?))
    }
}

fn forward<T: Real>(scale: f64, scores: &CpuStorage, layout: &Layout) -> Result<CpuStorage> {
    let (_, queries, keys) = layout.shape().dims3()?;
    let scores = dense::<T>(scores, layout)?;
    let mut p = vec![T::zero(); scores.len()];
    let block = queries * keys;
    p.par_chunks_mut(block).zip(scores.par_chunks(block)).for_each(|(p, scores)| {
        for (r, (p, scores)) in p.chunks_mut(keys).zip(scores.chunks(keys)).enumerate() {
            let seen = keys - queries + r + 1;
            softmax_row(&mut p[..seen], &scores[..seen], T::from_f64(scale));
        }
    });
    Ok(T::to_cpu_storage_owned(p))
}

fn softmax_row<T: Real>(p: &mut [T], scores: &[T], scale: T) {
    let most = scores.iter().fold(T::from_f64(f64::NEG_INFINITY), |m, &s| m.max(s));
    for (p, &s) in p.iter_mut().zip(scores) {
        *p = ((s - most) * scale).exp();
    }
    let sum = p.iter().fold(T::zero(), |s, &p| s + p);
    let inverse = T::one() / sum;
    p.iter_mut().for_each(|p| *p *= inverse);
}

/// scale * p (g - sum(g p)); hidden keys have p = 0.
fn backward<T: Real>(scale: f64, p: &Tensor, grad: &Tensor) -> Result<Tensor> {
    let (_, queries, keys) = p.dims3()?;
    let block = queries * keys;
    let scale = T::from_f64(scale);
    let mut out = vec![T::zero(); p.elem_count()];
    with_slice(p, |p: &[T]| {
        with_slice(grad, |g: &[T]| {
            out.par_chunks_mut(block).zip(p.par_chunks(block)).zip(g.par_chunks(block)).for_each(|((out, p), g)| {
                for (r, ((out, p), g)) in out.chunks_mut(keys).zip(p.chunks(keys)).zip(g.chunks(keys)).enumerate() {
                    let seen = keys - queries + r + 1;
                    let dot = p[..seen].iter().zip(g).fold(T::zero(), |s, (&p, &g)| s + p * g);
                    for ((out, &p), &g) in out[..seen].iter_mut().zip(p).zip(g) {
                        *out = scale * p * (g - dot);
                    }
                }
            });
            Ok(())
        })
    })?;
    tensor_like(out, p)
}

#[cfg(test)]
mod tests {
    use super::super::check::{random, same};
    use super::super::{causal_softmax, plain};
    use candle_core::{Device, Tensor};

    #[test]
    fn fused_is_plain() {
        for (queries, keys) in [(1, 1), (1, 9), (7, 7), (4, 10)] {
            let scores = [random("scores", &[3, queries, keys], 9.0)];
            let fused = |i: &[_]| causal_softmax(&i[0], 0.3);
            same("causal_softmax", &fused, &|i| plain::causal_softmax(&i[0], 0.3), &scores);
        }
    }

    #[test]
    fn later_keys_have_no_weight_and_rows_sum_to_one() {
        let scores = Tensor::new(&[[[1e4f32, 1e4, 7.0], [-1e4, 0.0, 0.0]]], &Device::Cpu).unwrap();
        let p = causal_softmax(&scores, 1.0).unwrap().to_vec3::<f32>().unwrap();
        assert_eq!(p, [[[0.5, 0.5, 0.0], [0.0, 0.5, 0.5]]]);
        assert!(causal_softmax(&scores.transpose(1, 2).unwrap(), 1.0).is_err());
    }
}
