//! The forward pass over a sequence.

use super::layer::TeacherForcing;
use super::{Lstm, Wiring, stretches};

impl Lstm {
    /// Outputs (T, B, C) of up to as many steps as there is memory for: the input of step t is that of `inputs` (T, B, C) where
    /// `given[t]`, else the previous output. It starts from the state that [`Lstm::rest`] or [`Lstm::carry`] set.
    ///
    /// # Panics
    /// If there are no steps or more than there is memory for, or for inputs of another length.
    pub fn forward(&mut self, inputs: &[f32], given: &[bool]) -> &[f32] {
        let (b, c, d) = (self.batch, self.shape.channels, self.shape.width);
        let (row, steps) = (b * c, given.len());
        assert!((1..=self.steps).contains(&steps), "{steps} steps, room for {}", self.steps);
        assert_eq!(inputs.len(), steps * row, "inputs of {steps} steps, {b} sequences, {c} channels");
        self.given.clear();
        self.given.extend_from_slice(given);
        for stretch in stretches(given) {
            let (from, to) = (stretch.start, stretch.end);
            self.x[from * row..to * row].copy_from_slice(&inputs[from * row..to * row]);
            if !given[from] {
                // y is one step ahead of x: y[from] is the output of step from - 1
                self.x[from * row..][..row].copy_from_slice(&self.y[from * row..][..row]);
            }
            self.layers[0].forward(stretch.clone(), &self.x[from * row..to * row], TeacherForcing::NONE);
            for l in 1..self.layers.len() {
                let (below, layers) = self.layers.split_at_mut(l);
                // h[t + 1] is the output of step t: fixed wiring reads that, compat wiring the one before
                let late = usize::from(self.shape.wiring == Wiring::Fixed);
                let inputs = &below[l - 1].h[(from + late) * b * d..(to + late) * b * d];
                layers[0].forward(stretch.clone(), inputs, TeacherForcing::NONE);
            }
            let top = &self.layers[self.layers.len() - 1].h[(from + 1) * b * d..(to + 1) * b * d];
            self.output.times(&mut self.y[(from + 1) * row..(to + 1) * row], top, Some(&self.bias));
        }
        &self.y[row..(steps + 1) * row]
    }
}
