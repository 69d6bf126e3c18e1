//! One layer, whose outputs are its units, with teacher forcing: at some steps other rows replace its own previous output.
//!
//! The state continues through such a step; the gradient of the replaced output ends there.

use super::layer::{Layer, TeacherForcing};
use super::{Floats, Sums};

/// A layer of D units with I inputs, over up to T steps of B sequences.
pub struct Single {
    inputs: usize,
    width: usize,
    batch: usize,
    steps: usize,
    /// For each step of the last pass: was it forced?
    forced: Vec<bool>,
    layer: Layer,
    /// (T, B, D): each step's previous output, with those that were forced.
    seen: Floats,
    sums: Option<Sums>,
}

impl Single {
    /// Memory for sequences of up to `steps` steps, `batch` side by side; `backward`: for gradients too.
    ///
    /// # Panics
    /// If a size is 0.
    pub fn new(inputs: usize, width: usize, batch: usize, steps: usize, backward: bool) -> Single {
        assert!(inputs * width * batch * steps > 0, "{inputs} inputs, {width} units, {batch} sequences, {steps} steps");
        Single {
            inputs,
            width,
            batch,
            steps,
            forced: Vec::with_capacity(steps),
            layer: Layer::new(inputs, width, batch, steps, backward),
            seen: Floats::new(if backward { steps * batch * width } else { 0 }),
            sums: backward.then(|| Sums::new(batch * steps, 4 * width)),
        }
    }

    /// Rows and columns of its tensors: weights of the input (I, 4D) and of the own last output (D, 4D), and the biases of
    /// both, columns by gates i, f, g, o.
    pub fn tensors(inputs: usize, width: usize) -> [[usize; 2]; 4] {
        [[inputs, 4 * width], [width, 4 * width], [1, 4 * width], [1, 4 * width]]
    }

    /// Takes over weights, in the order of [`Single::tensors`]: before the first pass and after every update.
    ///
    /// # Panics
    /// If tensors have other shapes.
    pub fn pack(&mut self, weights: &[Floats]) {
        let expected = Single::tensors(self.inputs, self.width).map(|[rows, columns]| rows * columns);
        let [input, own, bias, own_bias] = weights else { panic!("{} tensors, expected 4", weights.len()) };
        let all = [&**input, own, bias, own_bias];
        assert_eq!(all.map(|w| w.len()), expected, "numbers of the tensors");
        self.layer.pack(all);
    }

    /// The next pass begins with a state and an output of 0.
    pub fn rest(&mut self) {
        self.layer.rest();
    }

    /// The next pass goes on where the last one ended: called after [`Single::forward`], before a backward pass, which
    /// forgets how many steps that had.
    pub fn carry(&mut self) {
        self.layer.carry(self.forced.len());
    }

    /// Outputs (T, B, D) of `inputs` (T, B, I), up to as many steps as there is memory for.
    ///
    /// # Panics
    /// If there are no steps or more than there is memory for, or slices have other lengths.
    pub fn forward(&mut self, inputs: &[f32], forced: TeacherForcing) -> &[f32] {
        let row = self.batch * self.width;
        let steps = inputs.len() / (self.batch * self.inputs);
        assert!((1..=self.steps).contains(&steps), "{steps} steps, room for {}", self.steps);
        assert_eq!(inputs.len(), steps * self.batch * self.inputs, "inputs of {steps} steps");
        let any = (0..steps).any(|t| forced.at(t));
        assert!(
            !any || forced.rows.len() == steps * row,
            "{} forced numbers, expected {}",
            forced.rows.len(),
            steps * row
        );
        self.forced.clear();
        self.forced.extend((0..steps).map(|t| forced.at(t)));
        self.layer.forward(0..steps, inputs, forced);
        // the gradient of the own weight needs what the step saw, not the output that was replaced
        if self.sums.is_some() && any {
            for (t, is_forced) in self.forced.iter().enumerate() {
                let from = if *is_forced { &forced.rows[t * row..][..row] } else { &self.layer.h[t * row..][..row] };
                self.seen[t * row..][..row].copy_from_slice(from);
            }
        }
        &self.layer.h[row..(steps + 1) * row]
    }

    /// From the gradient `outputs` (T, B, D) of the last pass's outputs: `gradients` become those of the weights, `dx`
    /// (T, B, I) that of its `inputs`.
    ///
    /// # Panics
    /// Without a forward pass since the last backward pass, with memory for the forward pass only, or if slices have other
    /// lengths.
    pub fn backward(&mut self, outputs: &[f32], inputs: &[f32], dx: &mut [f32], gradients: &mut [Floats]) {
        let (rows, d, steps) = (self.forced.len() * self.batch, self.width, self.forced.len());
        assert!(steps > 0 && outputs.len() == rows * d, "gradients of {} numbers", outputs.len());
        assert_eq!([inputs.len(), dx.len()], [rows * self.inputs; 2], "inputs, and their gradients");
        let (Some(back), Some(sums)) = (&mut self.layer.back, &mut self.sums) else {
            panic!("memory for the forward pass only")
        };
        back.dh[..rows * d].copy_from_slice(outputs);
        self.layer.backward(0..steps, steps, TeacherForcing { steps: &self.forced, rows: &[] });
        let Some(back) = &mut self.layer.back else { return };
        let gates = &back.gates[..4 * rows * d];
        back.below.times(dx, gates, None);
        let [of_input, of_own, of_bias, of_own_bias] = gradients else { panic!("gradients of 4 tensors") };
        let seen = if self.forced.contains(&true) { &self.seen[..rows * d] } else { &self.layer.h[..rows * d] };
        sums.gradients(gates, 4 * d, &mut [(inputs, self.inputs, of_input), (seen, d, of_own)], of_bias);
        of_own_bias.copy_from_slice(of_bias);
        self.forced.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::{near, numbers};
    use crate::scalar::lstm::cell;

    /// What is added to a number of the weights, or of the inputs.
    type Change<'a> = dyn Fn(&mut Vec<Vec<f64>>, &mut Vec<f64>, f64) + 'a;

    /// Sums of some dozen numbers below 1, over some steps.
    const BOUND: f64 = 3e-6;

    /// The layer as plain loops in f64, from rest.
    fn plain(
        (inputs, d, b): (usize, usize, usize),
        weights: &[Vec<f64>],
        x: &[f64],
        forced: &[bool],
        rows: &[f32],
    ) -> Vec<f64> {
        let (mut h, mut c, mut out) = (vec![0.0; b * d], vec![0.0; b * d], Vec::new());
        for (t, forced) in forced.iter().enumerate() {
            if *forced {
                h = rows[t * b * d..][..b * d].iter().map(|x| f64::from(*x)).collect();
            }
            let mut now = h.clone();
            for (i, now) in now.iter_mut().enumerate() {
                let (row, unit) = (i / d, i % d);
                let sum = |gate: usize| {
                    let column = gate * d + unit;
                    let of = |w: &[f64], x: &[f64]| -> f64 {
                        x.iter().enumerate().map(|(k, x)| x * w[k * 4 * d + column]).sum()
                    };
                    let x = &x[(t * b + row) * inputs..][..inputs];
                    of(&weights[0], x) + of(&weights[1], &h[row * d..][..d]) + weights[2][column] + weights[3][column]
                };
                (c[i], *now) = cell([sum(0), sum(1), sum(2), sum(3)], c[i]);
            }
            h = now;
            out.extend(&h);
        }
        out
    }

    #[test]
    fn what_is_told_takes_the_place_of_the_own_output_forth_and_back() {
        for (inputs, d, b, mask) in [(3, 5, 2, "nnnnn"), (7, 33, 3, "ntntt"), (2, 70, 1, "ttnnn"), (4, 6, 2, "ttt")] {
            let forced: Vec<bool> = mask.chars().map(|c| c == 't').collect();
            let (steps, wide) = (forced.len(), |x: &[f32]| x.iter().map(|x| f64::from(*x)).collect::<Vec<f64>>());
            let sizes = Single::tensors(inputs, d).into_iter().enumerate();
            let weights: Vec<Floats> = sizes.map(|(i, [r, c])| Floats::of(&numbers(i as u64, r * c, 0.4))).collect();
            let (x, rows) = (numbers(9, steps * b * inputs, 1.0), numbers(8, steps * b * d, 1.0));
            let pull = numbers(7, steps * b * d, 1.0);
            let all: Vec<Vec<f64>> = weights.iter().map(|w| wide(w)).collect();
            let mut single = Single::new(inputs, d, b, steps + 2, true);
            single.pack(&weights);
            let outputs = single.forward(&x, TeacherForcing { steps: &forced, rows: &rows }).to_vec();
            near(mask, &outputs, &plain((inputs, d, b), &all, &wide(&x), &forced, &rows), BOUND);
            let mut found: Vec<Floats> = weights.iter().map(|w| Floats::new(w.len())).collect();
            let mut dx = vec![f32::NAN; x.len()];
            single.backward(&pull, &x, &mut dx, &mut found);
            let total = |weights: &[Vec<f64>], x: &[f64]| -> f64 {
                let outputs = plain((inputs, d, b), weights, x, &forced, &rows);
                outputs.iter().zip(&pull).map(|(y, p)| y * f64::from(*p)).sum()
            };
            let slope = |change: &Change<'_>| {
                let of = |by: f64| {
                    let (mut weights, mut x) = (all.clone(), wide(&x));
                    change(&mut weights, &mut x, by);
                    total(&weights, &x)
                };
                (of(1e-5) - of(-1e-5)) / 2e-5
            };
            for (tensor, gradient) in found.iter().enumerate() {
                for at in (0..gradient.len()).step_by(gradient.len().div_ceil(9)) {
                    let expected = slope(&|weights, _, by| weights[tensor][at] += by);
                    near(&format!("{mask} tensor {tensor}"), &gradient[at..=at], &[expected], 2e-5);
                }
            }
            for at in (0..dx.len()).step_by(3) {
                let expected = slope(&|_, x, by| x[at] += by);
                near(&format!("{mask} input {at}"), &dx[at..=at], &[expected], 2e-5);
            }
            // in pieces, the same bits
            single.rest();
            let mut parts =
                single.forward(&x[..b * inputs], TeacherForcing { steps: &forced[..1], rows: &rows[..b * d] }).to_vec();
            single.carry();
            let rest = TeacherForcing { steps: &forced[1..], rows: &rows[b * d..] };
            parts.extend_from_slice(single.forward(&x[b * inputs..], rest));
            assert_eq!(parts, outputs, "{mask}");
        }
    }

    #[test]
    fn without_anything_told_it_is_a_layer_of_the_network() {
        use super::super::{Lstm, Shape, Wiring};
        let (channels, width) = (3, 20);
        let shape = Shape { channels, width, layers: 1, wiring: Wiring::Fixed };
        let weights: Vec<Floats> =
            shape.tensors().iter().enumerate().map(|(i, [r, c])| Floats::of(&numbers(i as u64, r * c, 0.4))).collect();
        let x = numbers(5, 6 * channels, 1.0);
        let mut lstm = Lstm::new(shape, 1, 6, false);
        lstm.pack(&weights);
        let found = lstm.forward(&x, &[true; 6]).to_vec();
        let mut single = Single::new(channels, width, 1, 6, false);
        single.pack(&weights[..4]);
        let h = single.forward(&x, TeacherForcing::NONE);
        let of = |t: usize, c: usize| -> f64 {
            let sum: f64 =
                (0..width).map(|u| f64::from(h[t * width + u]) * f64::from(weights[4][u * channels + c])).sum();
            sum + f64::from(weights[5][c])
        };
        let expected: Vec<f64> =
            (0..6).flat_map(|t| (0..channels).map(move |c| (t, c))).map(|(t, c)| of(t, c)).collect();
        near("outputs", &found, &expected, BOUND);
    }
}
