//! One layer: its weights in panels and its memory, some units at a time.

use super::UNITS;
use super::columns::Columns;
use crate::arena::Floats;
use crate::op::cell;
use crate::op::matmul::{self, Left, Panels, Store, panel};
use rayon::prelude::*;
use std::ops::Range;

/// A layer of D units with I inputs.
pub struct Layer {
    inputs: usize,
    width: usize,
    batch: usize,
    slabs: Vec<Slab>,
    /// (T + 1, B, D): the output before the first step, then those of all steps.
    pub h: Floats,
    pub back: Option<Back>,
}

/// Teacher forcing: rows that replace a layer's own previous output at some steps.
#[derive(Debug, Clone, Copy)]
pub struct TeacherForcing<'a> {
    /// For each step of a pass: is it forced? Later steps aren't.
    pub steps: &'a [bool],
    /// (T, B, D), read at forced steps alone.
    pub rows: &'a [f32],
}

impl TeacherForcing<'_> {
    /// No forced steps.
    pub const NONE: TeacherForcing<'static> = TeacherForcing { steps: &[], rows: &[] };

    /// Whether step `t` is forced.
    pub fn at(self, t: usize) -> bool {
        self.steps.get(t).is_some_and(|forced| *forced)
    }
}

/// The gradients that a step's backward pass gets from the next step.
#[derive(Clone, Copy)]
enum Next<'a> {
    /// It is the last.
    Nothing,
    /// The state's gradient.
    State,
    /// That, and the output's by those of the sums at the gates (B, 4D).
    Both(&'a [f32]),
}

/// Memory for a layer's gradients.
pub struct Back {
    /// (T, B, D), gradients of the outputs as far as they come from above.
    pub dh: Floats,
    /// (T, B, 4D), gradients of the sums at the gates.
    pub gates: Floats,
    /// To the layer's inputs.
    pub below: Columns,
}

/// Some units of a layer; P is their number, rounded up to whole panels.
struct Slab {
    first: usize,
    units: usize,
    padded: usize,
    /// (I, 4P) and (D, 4P) in panels, (4P).
    input: Floats,
    own: Floats,
    bias: Floats,
    /// (T, B, 4P): the gates, and on the way back their gradients.
    gates: Floats,
    /// (T + 1, B, P).
    states: Floats,
    /// (B, P).
    h: Floats,
    /// The own weight transposed, (4D, P) in panels; (B, P) gradients of output and state.
    back: Option<(Floats, Floats, Floats)>,
}

impl Layer {
    pub fn new(inputs: usize, width: usize, batch: usize, steps: usize, backward: bool) -> Layer {
        let wide = UNITS.next_multiple_of(panel());
        let slab = |first: usize| {
            let units = wide.min(width - first);
            // padded units have weights and biases of 0, so gates of 1/2 and 0 and states of 0: they add nothing
            let padded = units.next_multiple_of(panel());
            let rows = batch * padded;
            let room = |k| Floats::new(matmul::panels_len(k, 4 * padded));
            Slab {
                first,
                units,
                padded,
                input: room(inputs),
                own: room(width),
                bias: Floats::new(4 * padded),
                gates: Floats::new(4 * steps * rows),
                states: Floats::new((steps + 1) * rows),
                h: Floats::new(rows),
                back: backward
                    .then(|| (Floats::new(matmul::panels_len(4 * width, units)), Floats::new(rows), Floats::new(rows))),
            }
        };
        Layer {
            inputs,
            width,
            batch,
            slabs: (0..width).step_by(wide).map(slab).collect(),
            h: Floats::new((steps + 1) * batch * width),
            back: backward.then(|| Back {
                dh: Floats::new(steps * batch * width),
                gates: Floats::new(4 * steps * batch * width),
                below: Columns::new(4 * width, inputs, batch * steps),
            }),
        }
    }

    /// Takes the weights of input (I, 4D) and own output (D, 4D), and both biases (4D).
    pub fn pack(&mut self, [input, own, bias, own_bias]: [&[f32]; 4]) {
        let (inputs, d) = (self.inputs, self.width);
        self.slabs.par_iter_mut().for_each(|slab| {
            let Slab { first, units, padded, .. } = *slab;
            for gate in 0..4 {
                let column = gate * d + first;
                for (to, from, k) in [(&mut slab.input, input, inputs), (&mut slab.own, own, d)] {
                    let room = k * padded;
                    matmul::pack(&mut to[gate * room..][..room], &from[column..], 4 * d, k, units);
                }
                let sums = bias[column..][..units].iter().zip(&own_bias[column..]);
                slab.bias[gate * padded..].iter_mut().zip(sums).for_each(|(to, (a, b))| *to = a + b);
            }
            if let Some((turned, ..)) = &mut slab.back {
                matmul::pack_transposed(turned, &own[first * 4 * d..], 4 * d, 4 * d, units);
            }
        });
        if let Some(back) = &mut self.back {
            back.below.pack_transposed(input);
        }
    }

    pub fn rest(&mut self) {
        self.h[..self.batch * self.width].fill(0.0);
        for slab in &mut self.slabs {
            slab.states[..self.batch * slab.padded].fill(0.0);
        }
    }

    pub fn carry(&mut self, steps: usize) {
        let row = self.batch * self.width;
        self.h.copy_within(steps * row..(steps + 1) * row, 0);
        for slab in &mut self.slabs {
            let row = self.batch * slab.padded;
            slab.states.copy_within(steps * row..(steps + 1) * row, 0);
        }
    }

    /// A stretch of steps whose inputs (n, B, I) are known.
    pub fn forward(&mut self, stretch: Range<usize>, inputs: &[f32], forced: TeacherForcing) {
        let (b, d, i) = (self.batch, self.width, self.inputs);
        for t in stretch.clone() {
            let (before, now) = self.h.split_at_mut((t + 1) * b * d);
            let before = if forced.at(t) { &forced.rows[t * b * d..][..b * d] } else { &before[t * b * d..] };
            self.slabs.par_iter_mut().for_each(|slab| {
                // by the slab itself, not before the loop: one barrier less per stretch
                if t == stretch.start {
                    slab.product(stretch.clone(), b, inputs, i, Store::Set);
                }
                slab.product(t..t + 1, b, before, d, Store::Add);
                slab.step(t, b);
            });
            for slab in &self.slabs {
                for (to, from) in now.chunks_exact_mut(d).zip(slab.h.chunks_exact(slab.padded)) {
                    matmul::copy(&mut to[slab.first..][..slab.units], &from[..slab.units]);
                }
            }
        }
    }

    /// The backward pass of a stretch: `gates` become the gradients of the gates' sums, from `dh` and the gates of the next
    /// stretch, if the pass of `steps` has one. A forced step stops the gradient of the output that it replaces.
    pub fn backward(&mut self, stretch: Range<usize>, steps: usize, forced: TeacherForcing) {
        let (b, d) = (self.batch, self.width);
        let Some(back) = &mut self.back else { panic!("memory for the forward pass only") };
        for t in stretch.rev() {
            let (now, next) = back.gates.split_at_mut(4 * (t + 1) * b * d);
            let next = match t + 1 < steps {
                false => Next::Nothing,
                true if forced.at(t + 1) => Next::State,
                // in split_at_mut order the next step's gates come right after this step's
                true => Next::Both(&next[..4 * b * d]),
            };
            let dh = &back.dh[t * b * d..][..b * d];
            self.slabs.par_iter_mut().for_each(|slab| slab.step_back(t, b, d, dh, next));
            for slab in &self.slabs {
                let p = slab.padded;
                let from = slab.gates[4 * t * b * p..].chunks_exact(4 * p);
                for (to, from) in now[4 * t * b * d..].chunks_exact_mut(4 * d).zip(from) {
                    for gate in 0..4 {
                        let to = &mut to[gate * d + slab.first..][..slab.units];
                        matmul::copy(to, &from[gate * p..][..slab.units]);
                    }
                }
            }
        }
    }
}

impl Slab {
    /// Products with the input (I rows) or, added, with the own output before, into the sums of these steps.
    fn product(&mut self, steps: Range<usize>, batch: usize, a: &[f32], k: usize, store: Store) {
        let n = 4 * self.padded;
        let rows = steps.len() * batch;
        let gates = &mut self.gates[steps.start * batch * n..][..rows * n];
        let numbers = if store == Store::Set { &self.input } else { &self.own };
        let (panels, left) = (Panels { numbers, block: k }, Left::Rows { a, lda: k });
        matmul::product(gates, n, (rows, k, n), left, panels, store);
    }

    fn step(&mut self, t: usize, batch: usize) {
        let row = batch * self.padded;
        let (before, now) = self.states.split_at_mut((t + 1) * row);
        let gates = &mut self.gates[4 * t * row..][..4 * row];
        cell::forward(gates, &self.bias, &before[t * row..], &mut now[..row], &mut self.h);
    }

    fn step_back(&mut self, t: usize, batch: usize, d: usize, above: &[f32], next: Next) {
        let (first, units, p) = (self.first, self.units, self.padded);
        let Some((turned, dh, dc)) = &mut self.back else { return };
        for (to, from) in dh.chunks_exact_mut(p).zip(above.chunks_exact(d)) {
            matmul::copy(&mut to[..units], &from[first..][..units]);
        }
        match next {
            Next::Both(a) => {
                let (panels, left) = (Panels { numbers: turned, block: 4 * d }, Left::Rows { a, lda: 4 * d });
                matmul::product(dh, p, (batch, 4 * d, units), left, panels, Store::Add);
            }
            // dc still holds what the next step left; the output it would have had was replaced
            Next::State => (),
            Next::Nothing => dc.fill(0.0),
        }
        let row = batch * p;
        let (before, now) = self.states[t * row..][..2 * row].split_at(row);
        cell::backward(&mut self.gates[4 * t * row..][..4 * row], before, now, dh, dc, p);
    }
}
