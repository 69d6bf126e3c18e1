//! Linear heads over the final vectors of some tokens, beside the heads over ids: what names a dance.

use super::{Fast, Windows};
use crate::Result;
use crate::model::Dropout;
use kinelm_engine::arena::Floats;
use kinelm_engine::bins::Bins;
use kinelm_engine::block::Norm;
use kinelm_engine::head::{self, Exam, Workspace};
use kinelm_engine::op::cross_entropy::Asked;
use kinelm_engine::op::matmul::Store;

/// What a row of a batch (N = B T rows) is asked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClassRow {
    /// The row.
    pub row: usize,
    /// The table that answers.
    pub table: usize,
    /// The right class: a row of that table.
    pub class: u32,
    /// What its -ln p and the gradient of it are multiplied with.
    pub weight: f32,
}

/// What the two kinds of heads say of a batch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Losses {
    /// Sum of -ln p over the targets that aren't `<pad>`, in nats.
    pub tokens: f64,
    /// Sum of weight times -ln p over the class rows, in nats.
    pub classes: f64,
}

impl Fast {
    /// As [`Fast::gradients`], of the mean over the targets plus the weighted sum over the class rows: logit c of a row is
    /// h . row c of its table (C, D), h the final norm's output. `of_tables` become the gradients of the tables.
    ///
    /// # Errors
    /// As [`Fast::gradients`].
    ///
    /// # Panics
    /// If a row, a table or a class isn't there.
    pub fn gradients_with_classes(
        &mut self,
        windows: Windows,
        dropout: Option<&Dropout>,
        gradients: &mut [Floats],
        (tables, rows): (&[Floats], &[ClassRow]),
        of_tables: &mut [Floats],
    ) -> Result<Losses> {
        let mut classes = 0.0;
        of_tables.iter_mut().for_each(|t| t.fill(0.0));
        let tokens = self.gradients_and(windows, dropout, gradients, &mut |model, last, dx, gradients| {
            classes = model.class_loss(last, dx, gradients, (tables, rows), of_tables);
        })?;
        Ok(Losses { tokens, classes })
    }

    /// The final norm's output at the rows `rows` of a batch, a vector of D each, one after the other.
    ///
    /// # Errors
    /// As [`Fast::gradients`].
    ///
    /// # Panics
    /// If a row isn't there.
    pub fn final_vectors(&mut self, windows: Windows, rows: &[usize]) -> Result<Vec<f32>> {
        let mut pass = self.scored(windows)?;
        pass.forward(self, windows, None);
        let found = self.normed(pass.last(self), rows);
        self.scoring = Some(pass);
        Ok(found)
    }

    fn normed(&self, last: &[f32], rows: &[usize]) -> Vec<f32> {
        let d = self.config.width;
        let x: Vec<f32> = rows.iter().flat_map(|&row| &last[row * d..][..d]).copied().collect();
        let (mut out, mut stats) = (vec![0.0; x.len()], vec![0.0; 2 * rows.len()]);
        let Norm { weight, bias } = self.norm();
        kinelm_engine::op::layer_norm::forward(&mut out, &mut stats, &x, weight, bias);
        out
    }

    fn class_loss(
        &self,
        last: &[f32],
        dx: &mut [f32],
        gradients: &mut [Floats],
        (tables, rows): (&[Floats], &[ClassRow]),
        of_tables: &mut [Floats],
    ) -> f64 {
        let d = self.config.width;
        let [Some(bias), Some(weight)] = ["norm.bias", "norm.weight"].map(|name| self.rest(name)) else {
            panic!("a model has a norm")
        };
        let mut nats = 0.0;
        // an exam has one scale: rows of one table and one weight go together
        let mut order: Vec<&ClassRow> = rows.iter().collect();
        order.sort_by(|a, b| (a.table, a.weight.to_bits(), a.row).cmp(&(b.table, b.weight.to_bits(), b.row)));
        for same in order.chunk_by(|a, b| (a.table, a.weight.to_bits()) == (b.table, b.weight.to_bits())) {
            let ClassRow { table, weight: scale, .. } = *same[0];
            let count = tables[table].len() / d;
            let ask = |r: &&ClassRow| Asked { target: r.class, first: 0, count: count as u32, bins: Bins::NONE };
            let asked: Vec<Asked> = same.iter().map(ask).collect();
            let x: Vec<f32> = same.iter().flat_map(|r| &last[r.row * d..][..d]).copied().collect();
            let mut of_x = vec![0.0; x.len()];
            let mut space = Workspace::new(same.len(), d, count, true);
            let Ok([bias, weight]) = gradients.get_disjoint_mut([bias, weight]) else {
                panic!("{} gradients for a model of {}", gradients.len(), self.parameters.len());
            };
            let norm = Norm { weight: &mut **weight, bias: &mut **bias };
            let mut to = head::Gradients { dx: &mut of_x, norm, head: &mut of_tables[table] };
            let exam = Exam { asked: &asked, smoothing: None, scale };
            let found = head::loss(&x, self.norm(), &tables[table], exam, &mut to, Store::Add, &mut space);
            nats += f64::from(scale) * found;
            for (r, of_x) in same.iter().zip(of_x.chunks(d)) {
                dx[r.row * d..][..d].iter_mut().zip(of_x).for_each(|(dx, g)| *dx += g);
            }
        }
        nats
    }
}

/// What is added to a backward pass when the heads over ids are done: from the last block's output (N, D) to its gradient
/// and those of the model's tensors.
pub(super) type Added<'a> = &'a mut dyn FnMut(&Fast, &[f32], &mut [f32], &mut [Floats]);
