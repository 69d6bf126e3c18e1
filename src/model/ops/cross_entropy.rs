//! Cross-entropy of a row of logits with its target, summed; the gradient of a row is softmax - one-hot.

use super::{ROWS, Real, by_dtype, dense, tensor_like, with_slice};
use candle_core::backend::BackendStorage;
use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor};
use rayon::prelude::*;

pub(super) struct CrossEntropySum {
    pub targets: Vec<u32>,
    pub ignored: u32,
}

impl CustomOp1 for CrossEntropySum {
    fn name(&self) -> &'static str {
        "cross-entropy-sum"
    }

    fn cpu_fwd(&self, logits: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        Ok((by_dtype!(logits.dtype(), forward(self, logits, layout))?, Shape::from(())))
    }

    fn bwd(&self, logits: &Tensor, _: &Tensor, grad: &Tensor) -> Result<Option<Tensor>> {
        Ok(Some(by_dtype!(logits.dtype(), backward(self, logits, grad))?))
    }
}

/// The largest logit and the sum of exp(logit - largest).
fn partition<T: Real>(row: &[T]) -> (T, T) {
    let most = row.iter().fold(T::from_f64(f64::NEG_INFINITY), |m, &x| m.max(x));
    (most, row.iter().fold(T::zero(), |s, &x| s + (x - most).exp()))
}

fn forward<T: Real>(op: &CrossEntropySum, logits: &CpuStorage, layout: &Layout) -> Result<CpuStorage> {
    let (_, vocabulary) = layout.shape().dims2()?;
    let logits = dense::<T>(logits, layout)?;
    let partial: Vec<f64> = (logits.par_chunks(ROWS * vocabulary).zip(op.targets.par_chunks(ROWS)))
        .map(|(rows, targets)| {
            let counted = rows.chunks(vocabulary).zip(targets).filter(|(_, t)| **t != op.ignored);
            counted
                .map(|(row, &t)| {
                    let (most, sum) = partition(row);
                    (sum.ln() + most - row[t as usize]).to_f64()
                })
                .sum()
        })
        .collect();
    Ok(T::to_cpu_storage_owned(vec![T::from_f64(partial.iter().sum())]))
}

fn backward<T: Real>(op: &CrossEntropySum, logits: &Tensor, grad: &Tensor) -> Result<Tensor> {
    let (_, vocabulary) = logits.dims2()?;
    let grad = grad.to_scalar::<T>()?;
    let mut out = with_slice(logits, |l: &[T]| Ok(l.to_vec()))?;
    out.par_chunks_mut(ROWS * vocabulary).zip(op.targets.par_chunks(ROWS)).for_each(|(rows, targets)| {
        for (row, &target) in rows.chunks_mut(vocabulary).zip(targets) {
            if target == op.ignored {
                row.fill(T::zero());
                continue;
            }
            let (most, sum) = partition(row);
            let share = grad / sum;
            row.iter_mut().for_each(|x| *x = (*x - most).exp() * share);
            row[target as usize] -= grad;
        }
    });
    tensor_like(out, logits)
}

#[cfg(test)]
mod tests {
    use super::super::check::{random, same};
    use super::super::{cross_entropy_sum, plain};

    #[test]
    fn fused_is_plain() {
        for rows in [1, 5, 150] {
            let targets: Vec<u32> = (0..rows).map(|r| (r * 5 % 11) as u32).collect();
            let logits = [random("logits", &[rows, 11], 20.0)];
            let fused = |i: &[_]| cross_entropy_sum(&i[0], &targets, 10);
            same("cross_entropy", &fused, &|i| plain::cross_entropy_sum(&i[0], &targets, 10), &logits);
        }
    }

    #[test]
    fn what_is_ignored_costs_nothing_and_wrong_targets_are_refused() {
        let logits = random("logits", &[2, 4], 2.0);
        assert_eq!(cross_entropy_sum(&logits, &[9, 9], 9).unwrap().to_scalar::<f64>().unwrap(), 0.0);
        let message = cross_entropy_sum(&logits, &[0, 4], 9).unwrap_err().to_string();
        assert!(message.contains("target 4 outside the vocabulary of 4 ids"), "{message}");
        assert!(cross_entropy_sum(&logits, &[0], 9).is_err());
    }
}
