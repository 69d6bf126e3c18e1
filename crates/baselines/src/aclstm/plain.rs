//! The network from plain tensor operations, differentiable, in f64: the oracle of the engine.

use crate::Result;
use candle_core::{DType, Device, Tensor, Var};
use candle_nn::ops::sigmoid;
use kinelm_engine::lstm::{Shape, Wiring};

/// Outputs (T, B, C) of a sequence from the zero state, and the gradients of all weights for gradients `d_out` (T, B, C) of
/// the outputs.
pub fn outputs_and_gradients(
    shape: &Shape,
    weights: &[Vec<f64>],
    inputs: &Tensor,
    given: &[bool],
    d_out: &Tensor,
) -> Result<(Vec<f64>, Vec<Vec<f64>>)> {
    let vars: Vec<Var> = weights
        .iter()
        .zip(shape.tensors())
        .map(|(numbers, [rows, columns])| {
            Var::from_tensor(&Tensor::from_slice(numbers, (rows, columns), &Device::Cpu)?)
        })
        .collect::<candle_core::Result<_>>()?;
    let (_, batch, channels) = inputs.dims3()?;
    let zeros = |n: usize| Tensor::zeros((batch, n), DType::F64, &Device::Cpu);
    let mut states = vec![(zeros(shape.width)?, zeros(shape.width)?); shape.layers];
    let (mut last, mut outputs) = (zeros(channels)?, Vec::new());
    for (t, given) in given.iter().enumerate() {
        let x = if *given { inputs.get(t)? } else { last };
        let before: Vec<Tensor> = states.iter().map(|(h, _)| h.clone()).collect();
        for layer in 0..shape.layers {
            let below = match (layer, shape.wiring) {
                (0, _) => x.clone(),
                (_, Wiring::Fixed) => states[layer - 1].0.clone(),
                // as published: each layer reads the one below a step late
                (_, Wiring::Compat) => before[layer - 1].clone(),
            };
            let [wx, wh, bx, bh] = &vars[4 * layer..4 * layer + 4] else { unreachable!("four a layer") };
            let sums = (below.matmul(wx)? + before[layer].matmul(wh)?)?.broadcast_add(bx)?.broadcast_add(bh)?;
            let gates = sums.chunk(4, 1)?;
            let [i, f, g, o] = &gates[..] else { unreachable!("four gates") };
            let c = ((sigmoid(f)? * &states[layer].1)? + (sigmoid(i)? * g.tanh()?)?)?;
            states[layer] = ((sigmoid(o)? * c.tanh()?)?, c);
        }
        let (w, b) = (&vars[4 * shape.layers], &vars[4 * shape.layers + 1]);
        last = states[shape.layers - 1].0.matmul(w)?.broadcast_add(b)?;
        outputs.push(last.clone());
    }
    let outputs = Tensor::stack(&outputs, 0)?;
    let gradients = (&outputs * d_out)?.sum_all()?.backward()?;
    let of = |var: &Var| match gradients.get(var) {
        Some(gradient) => gradient.flatten_all()?.to_vec1::<f64>(),
        None => Ok(vec![0.0; var.elem_count()]),
    };
    let gradients = vars.iter().map(of).collect::<candle_core::Result<_>>()?;
    Ok((outputs.flatten_all()?.to_vec1()?, gradients))
}
