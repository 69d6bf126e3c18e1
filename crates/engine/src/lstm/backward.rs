//! Backpropagation through time.

use super::layer::TeacherForcing;
use super::{Lstm, Sums, Wiring, stretches};
use crate::arena::Floats;
use crate::linear::{self, Products};
use crate::op::bias;
use crate::op::matmul::{self, Store};
use crate::pieces;
use rayon::prelude::*;

impl Lstm {
    /// Gradients of the weights, in the order of [`super::Shape::tensors`], from those of the outputs (T, B, C) of the last
    /// [`Lstm::forward`]. They go through outputs that were fed back, and end where the pass began.
    ///
    /// # Panics
    /// Without a forward pass since the last backward pass, with memory for the forward pass only, or if slices have other
    /// lengths.
    pub fn backward(&mut self, outputs: &[f32], gradients: &mut [Floats]) {
        let (b, c, d, steps) = (self.batch, self.shape.channels, self.shape.width, self.given.len());
        let Some(back) = &mut self.back else { panic!("memory for the forward pass only") };
        assert!(steps > 0 && outputs.len() == steps * b * c, "gradients of {} numbers", outputs.len());
        assert_eq!(gradients.len(), 4 * self.layers.len() + 2, "tensors");
        back.dy[..steps * b * c].copy_from_slice(outputs);
        let late = usize::from(self.shape.wiring == Wiring::Compat);
        for layer in &mut self.layers {
            // compat wiring: no layer reads the last outputs of lower layers
            let Some(own) = &mut layer.back else { continue };
            // a layer above reads outputs one step late, so none gives a gradient to the last step
            own.dh[(steps - 1) * b * d..steps * b * d].fill(0.0);
        }
        for stretch in stretches(&self.given).rev() {
            let (from, to) = (stretch.start, stretch.end);
            let top = self.layers.last_mut().and_then(|top| top.back.as_mut());
            let Some(top) = top else { continue };
            back.output.times(&mut top.dh[from * b * d..to * b * d], &back.dy[from * b * c..to * b * c], None);
            for l in (0..self.layers.len()).rev() {
                let (below, layers) = self.layers.split_at_mut(l);
                layers[0].backward(stretch.clone(), steps, TeacherForcing::NONE);
                let Some(own) = &mut layers[0].back else { continue };
                if let Some(below) = below.last_mut().and_then(|below| below.back.as_mut()) {
                    let first = from.max(late);
                    let dh = &mut below.dh[(first - late) * b * d..(to - late) * b * d];
                    own.below.times(dh, &own.gates[4 * first * b * d..4 * to * b * d], None);
                // only the first step of a stretch can be fed: its input gradient belongs to the previous output
                } else if !self.given[from] && from > 0 {
                    own.below.times(&mut back.dx, &own.gates[4 * from * b * d..4 * (from + 1) * b * d], None);
                    let dy = &mut back.dy[(from - 1) * b * c..from * b * c];
                    dy.iter_mut().zip(back.dx.iter()).for_each(|(dy, dx)| *dy += dx);
                }
            }
        }
        let rows = steps * b;
        for l in 0..self.layers.len() {
            let (input, width) = match l {
                0 => (&self.x[..rows * c], c),
                // h begins with the output before the first step: compat inputs start there, fixed ones a step later
                _ => (&self.layers[l - 1].h[(1 - late) * b * d..][..rows * d], d),
            };
            let own = &self.layers[l];
            let [of_input, of_own, of_bias, of_own_bias] = &mut gradients[4 * l..4 * l + 4] else { continue };
            let Some(sums) = own.back.as_ref().map(|own| &own.gates[..4 * rows * d]) else { continue };
            back.sums.gradients(sums, 4 * d, &mut [(input, width, of_input), (&own.h[..rows * d], d, of_own)], of_bias);
            // both biases are added at the gates, so their gradients are equal; two tensors as PyTorch has them
            of_own_bias.copy_from_slice(of_bias);
        }
        let top = &self.layers[self.layers.len() - 1].h[b * d..][..rows * d];
        let [weight, bias] = &mut gradients[4 * self.layers.len()..] else { return };
        back.sums.gradients(&back.dy[..rows * c], c, &mut [(top, d, weight)], bias);
        // `cell::backward` has overwritten the gates: a second backward pass must panic
        self.given.clear();
    }
}

impl Sums {
    /// Memory for up to `rows` rows of `widest` numbers.
    pub fn new(rows: usize, widest: usize) -> Sums {
        let piece = pieces::rows(rows);
        let pieces = rows.div_ceil(piece);
        Sums { panels: Floats::new(pieces * matmul::panels_len(piece, widest)), partial: Floats::new(pieces * widest) }
    }

    /// Gradients of weights (k, n), each with its input (R, k), and of the bias (n), from gradients `d` (R, n) of the output.
    pub fn gradients(
        &mut self,
        d: &[f32],
        n: usize,
        weights: &mut [(&[f32], usize, &mut Floats)],
        of_bias: &mut [f32],
    ) {
        let (rows, products) = (d.len() / n, Products::F32);
        let piece = pieces::rows(rows);
        let room = products.panels_len(piece, n);
        let count = rows.div_ceil(piece);
        let partial = &mut self.partial[..count * n];
        let parts = self.panels[..count * room].par_chunks_mut(room).zip(partial.par_chunks_mut(n));
        parts.zip(d.par_chunks(piece * n)).for_each(|((panels, partial), d)| {
            products.pack(panels, d, n, d.len() / n, n);
            partial.fill(0.0);
            bias::add_column_sums(partial, d);
        });
        for (input, k, gradient) in weights {
            products.weight_gradient(gradient, input, *k, (&self.panels, piece), rows, Store::Set);
        }
        linear::Sums { partial, width: n, store: Store::Set }.take(of_bias);
    }
}
