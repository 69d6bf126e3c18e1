//! The end of a model: logits over all ids, or over the steps from the frame before.

use crate::config::{ModelConfig, TokenLayout};
use crate::head_groups::{Group, Groups, HeadGroups, STEPS};
use crate::previous::{Basis, PreviousFrames};
use crate::sequence::Sequences;
use crate::{Result, ops};
use candle_core::Tensor;
use candle_nn::VarBuilder;
use kinelm_engine::op::smoothing::Smoothing;
use std::ops::Range;

#[derive(Clone)]
pub(super) struct Head {
    /// (V, D).
    ids: Tensor,
    /// (steps, D) each, where there are such places.
    steps: [Option<Tensor>; 2],
    head_groups: HeadGroups,
}

impl Head {
    pub fn new(config: &ModelConfig, tokens: &TokenLayout, vars: &VarBuilder) -> candle_core::Result<Head> {
        let head_groups = HeadGroups::of(config, tokens);
        let steps = head_groups.steps().map(PreviousFrames::steps).unwrap_or_default();
        let table = |rows: usize, name: &str| (rows > 0).then(|| vars.get_unchecked(name)).transpose();
        Ok(Head {
            ids: vars.get_unchecked(config.ids_table())?,
            steps: [table(steps.circular, STEPS[0])?, table(steps.up_and_down(), STEPS[1])?],
            head_groups,
        })
    }

    /// (V, D).
    pub fn ids(&self) -> &Tensor {
        &self.ids
    }

    /// The tables in the order of the groups.
    fn tables(&self) -> [Option<&Tensor>; 3] {
        [Some(&self.ids), self.steps[0].as_ref(), self.steps[1].as_ref()]
    }

    /// Logits (N, V) of the rows `hidden` (N, D), those of the `inputs` of all windows in their sequences.
    pub fn logits(&self, hidden: &Tensor, sequences: &Sequences, inputs: Range<usize>) -> Result<Tensor> {
        let inputs = sequences.iter().flat_map(|sequence| inputs.clone().map(move |i| (sequence, i)));
        let bases: Vec<Basis> = inputs.map(|(sequence, i)| self.head_groups.basis(&sequence, i)).collect();
        let mut parts = Vec::new();
        let mut order = Vec::new();
        for (group, table) in self.tables().into_iter().enumerate() {
            let rows: Vec<u32> = (0..).zip(&bases).filter(|(_, b)| b.group() == group).map(|(row, _)| row).collect();
            let Some(table) = table.filter(|_| !rows.is_empty()) else { continue };
            let logits = of_rows(hidden, &rows)?.matmul(&table.t()?)?;
            parts.push(if group == 0 { logits } else { self.spread(&logits, &rows, &bases)? });
            order.extend(rows);
        }
        // rows came out group by group
        back_in_order(Tensor::cat(&parts, 0)?, &order)
    }

    /// Logits (n, V) of all ids from those of the steps (n, steps) of `rows`.
    fn spread(&self, steps: &Tensor, rows: &[u32], bases: &[Basis]) -> Result<Tensor> {
        let vocabulary = self.ids.dim(0)?;
        let (mut columns, mut hide) =
            (vec![0; rows.len() * vocabulary], vec![f32::NEG_INFINITY; rows.len() * vocabulary]);
        for (i, &row) in rows.iter().enumerate() {
            let (Basis::Steps { bins, from }, Some(previous_frames)) = (bases[row as usize], self.head_groups.steps())
            else {
                continue;
            };
            for (bin, id) in bins.ids().enumerate() {
                let at = i * vocabulary + id as usize;
                // ids out of the slot gather column 0 and are hidden
                (columns[at], hide[at]) = (previous_frames.steps().column(bins, from, bin) as u32, 0.0);
            }
        }
        let shape = (rows.len(), vocabulary);
        let columns = Tensor::from_vec(columns, shape, steps.device())?;
        let hide = Tensor::from_vec(hide, shape, steps.device())?.to_dtype(steps.dtype())?;
        Ok((steps.gather(&columns, 1)? + hide)?)
    }

    /// -ln p of each of `targets` (N), 0 where it is `<pad>`, for the rows `hidden` (N, D) of windows in their sequences.
    pub fn nats(
        &self,
        hidden: &Tensor,
        sequences: &Sequences,
        targets: &[u32],
        smoothing: Option<&Smoothing>,
    ) -> Result<Tensor> {
        let mut groups = Groups::default();
        self.head_groups.sort(sequences.iter(), targets, &mut groups)?;
        let mut parts = Vec::new();
        let mut order = Vec::new();
        // what has no part in this batch still gets its gradient, 0
        let mut nothing = (hidden.narrow(0, 0, 1)?.sum_all()? * 0.0)?;
        for (Group { rows, targets }, table) in groups.iter().zip(self.tables()) {
            match table {
                None => continue,
                Some(table) if rows.is_empty() => nothing = (nothing + (table.narrow(0, 0, 1)?.sum_all()? * 0.0)?)?,
                Some(table) => {
                    let logits = of_rows(hidden, rows)?.matmul(&table.t()?)?;
                    parts.push(ops::nats(&logits, targets, smoothing)?);
                    order.extend_from_slice(rows);
                }
            }
        }
        parts.push(nothing.reshape(1)?);
        // rows without a target take the last number, the 0 of `nothing`
        let mut places = vec![order.len() as u32; targets.len()];
        (0..).zip(&order).for_each(|(place, &row)| places[row as usize] = place);
        Ok(Tensor::cat(&parts, 0)?.index_select(&Tensor::new(places, hidden.device())?, 0)?)
    }
}

/// Some rows of `x`, ascending.
fn of_rows(x: &Tensor, rows: &[u32]) -> candle_core::Result<Tensor> {
    match rows.len() == x.dim(0)? {
        true => Ok(x.clone()),
        false => x.index_select(&Tensor::new(rows, x.device())?, 0),
    }
}

/// Row i of `x` at place `order[i]`.
fn back_in_order(x: Tensor, order: &[u32]) -> Result<Tensor> {
    if order.is_sorted() {
        return Ok(x);
    }
    let mut places = vec![0u32; order.len()];
    (0..).zip(order).for_each(|(place, &row)| places[row as usize] = place);
    Ok(x.index_select(&Tensor::new(places, x.device())?, 0)?)
}
