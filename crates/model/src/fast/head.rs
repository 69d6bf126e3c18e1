//! The end of a model, whose rows get logits from different tables: each table gets its rows one after the other, and
//! the result is put back in the batch's order.

use super::Fast;
use super::tables::embed;
use crate::Result;
use crate::config::{ModelConfig, TokenLayout};
use crate::head_groups::{Groups, HeadGroups, STEPS};
use crate::previous::Basis;
use crate::sequence::Sequences;
use kinelm_engine::arena::Floats;
use kinelm_engine::block::Norm;
use kinelm_engine::head::{self, Targets, Workspace};
use kinelm_engine::linear::Products;
use kinelm_engine::op::cross_entropy;
use kinelm_engine::op::embedding::{Lookup, NONE};
use kinelm_engine::op::matmul::Store;
use rayon::prelude::*;

/// Rows that are scored at a time.
const ROWS: usize = 64;

/// The heads for batches of one shape.
pub(super) struct Heads {
    head_groups: HeadGroups,
    groups: Groups,
    names: [&'static str; 3],
    /// Of each group, the most rows.
    most: [usize; 3],
    /// None for a group without rows.
    spaces: [Option<Workspace>; 3],
    width: usize,
    /// (N, D), the groups' rows one after the other, and their gradients.
    x: Floats,
    dx: Floats,
    /// (N) The index of a batch row among those; [`NONE`] if it has no target.
    places: Vec<u32>,
    /// (N) In the order of the groups.
    nats: Vec<f64>,
}

impl Heads {
    pub fn new(
        config: &ModelConfig,
        tokens: &TokenLayout,
        rows: usize,
        length: usize,
        products: Products,
        learn: bool,
    ) -> Heads {
        let head_groups = HeadGroups::of(config, tokens);
        let most = head_groups.most_rows(length).map(|most| most * (rows / length));
        let steps = head_groups.steps().map(|previous_frames| previous_frames.steps()).unwrap_or_default();
        let [ids, circular, clamped] = [tokens.vocabulary, steps.circular, steps.up_and_down()];
        let space = |group: usize, columns| {
            (most[group] > 0).then(|| Workspace::new(most[group], config.head_width(), columns, products, learn))
        };
        let room = |n: usize| Floats::new(n * config.head_width());
        let mut groups = Groups::default();
        for (group, most) in groups.iter_mut().zip(most) {
            group.rows.reserve_exact(most);
            group.targets.reserve_exact(most);
        }
        Heads {
            groups,
            names: [config.ids_table(), STEPS[0], STEPS[1]],
            spaces: [space(0, ids), space(1, circular), space(2, clamped)],
            most,
            width: config.head_width(),
            x: room(rows),
            dx: room(if learn { rows } else { 0 }),
            places: vec![NONE; rows],
            nats: vec![0.0; if learn { 0 } else { rows }],
            head_groups,
        }
    }

    /// Takes the rows of windows in their sequences whose target (B, T) counts.
    ///
    /// # Errors
    /// As [`HeadGroups::sort`].
    pub fn set_targets(&mut self, sequences: &Sequences, targets: &[u32]) -> Result<()> {
        self.head_groups.sort(sequences.iter(), targets, &mut self.groups)?;
        self.places.fill(NONE);
        let rows = self.groups.iter().flat_map(|g| &g.rows);
        (0..).zip(rows).for_each(|(place, &row)| self.places[row as usize] = place);
        Ok(())
    }

    /// Sum of -ln p of the targets, in nats, of the rows `last` (N, D). `dx` (N, D) becomes the gradient of `last`, those of
    /// the norm and the heads go to `gradients`, times `scale`.
    pub fn loss(&mut self, model: &Fast, last: &[f32], scale: f32, dx: &mut [f32], gradients: &mut [Floats]) -> f64 {
        let d = self.width;
        let index = |name: &str| model.find(name);
        let tables = self.names.map(index);
        let [Some(bias), Some(weight)] = ["norm.bias", "norm.weight"].map(index) else { panic!("a model has a norm") };
        for i in tables.into_iter().flatten().chain([bias, weight]) {
            gradients[i].fill(0.0);
        }
        let (mut nats, mut first) = (0.0, 0);
        for (group, table) in tables.into_iter().enumerate() {
            // groups without rows are skipped below: `first` counts the rows of those that have some
            let rows = &self.groups[group].rows;
            let (Some(table), Some(space), false) = (table, &mut self.spaces[group], rows.is_empty()) else { continue };
            // disjoint slices in the groups' order, which `places` counts too
            let part = first * d..(first + rows.len()) * d;
            first += rows.len();
            collect(&mut self.x[part.clone()], d, last, rows);
            let Ok([bias, weight, of_table]) = gradients.get_disjoint_mut([bias, weight, table]) else {
                panic!("{} gradients for a model of {}", gradients.len(), model.parameters.len());
            };
            let norm = Norm { weight: &mut **weight, bias: &mut **bias };
            let mut to = head::Gradients { dx: &mut self.dx[part.clone()], norm, head: of_table };
            let targets = Targets { targets: &self.groups[group].targets, smoothing: model.smoothing.as_ref(), scale };
            let x = &self.x[part];
            nats += head::loss(x, model.norm(), &model.weights[table], targets, &mut to, Store::Add, space);
        }
        // back in batch order; rows without a target have NONE, so their gradient is 0
        collect(dx, d, &self.dx, &self.places);
        nats
    }

    /// `out` (N) becomes -ln p of the target of each of the rows `last` (N, D), in nats, 0 where there is none.
    pub fn nats(&mut self, model: &Fast, last: &[f32], out: &mut [f32]) {
        let (d, mut first) = (self.width, 0);
        for (group, name) in self.names.into_iter().enumerate() {
            let (rows, targets) = (&self.groups[group].rows, &self.groups[group].targets);
            let (Some(space), false) = (&mut self.spaces[group], rows.is_empty()) else { continue };
            let part = first * d..(first + rows.len()) * d;
            let nats = &mut self.nats[first..first + rows.len()];
            first += rows.len();
            collect(&mut self.x[part.clone()], d, last, rows);
            head::logits(&self.x[part], model.norm(), model.weight(name), space, &mut |first, logits| {
                let columns = model.weight(name).len() / d;
                let targets = targets[first..].par_chunks(ROWS);
                let nats = nats[first..][..logits.len() / columns].par_chunks_mut(ROWS);
                let parts = (logits.par_chunks(ROWS * columns), targets, nats).into_par_iter();
                parts.for_each(|(logits, targets, nats)| cross_entropy::row_nats(nats, logits, &targets[..nats.len()]));
            });
        }
        for (out, &place) in out.iter_mut().zip(&self.places) {
            *out = self.nats.get(place as usize).map_or(0.0, |nats| *nats as f32);
        }
    }

    /// `out` (N, V) becomes the logits of the rows `last` (N, D) of windows (B, T), T = `length`, in their sequences.
    pub fn logits(&mut self, model: &Fast, last: &[f32], sequences: &Sequences, length: usize, out: &mut [f32]) {
        let (d, vocabulary) = (self.width, model.tokens.vocabulary);
        let basis = |row: usize| self.head_groups.basis(&sequences.get(row / length), row % length);
        let bases: Vec<Basis> = (0..sequences.iter().len() * length).map(basis).collect();
        // a relative head reaches the bins of one slot: all other ids stay impossible
        out.fill(f32::NEG_INFINITY);
        for (group, name) in self.names.into_iter().enumerate() {
            let rows: Vec<u32> = (0..).zip(&bases).filter(|(_, b)| b.group() == group).map(|(row, _)| row).collect();
            let Some(space) = &mut self.spaces[group] else { continue };
            // inputs after `<mask>` or `<pad>` have no bin to count from: more rows than can have a target
            for rows in rows.chunks(self.most[group]) {
                let x = &mut self.x[..rows.len() * d];
                collect(x, d, last, rows);
                let columns = model.weight(name).len() / d;
                head::logits(x, model.norm(), model.weight(name), space, &mut |first, logits| {
                    for (&row, logits) in rows[first..].iter().zip(logits.chunks(columns)) {
                        let out = &mut out[row as usize * vocabulary..][..vocabulary];
                        match (bases[row as usize], self.head_groups.steps()) {
                            (Basis::Steps { bins, from }, Some(previous_frames)) => {
                                let out = &mut out[bins.first as usize..][..bins.count as usize];
                                let column = |bin| previous_frames.steps().column(bins, from, bin);
                                out.iter_mut().enumerate().for_each(|(bin, out)| *out = logits[column(bin)]);
                            }
                            _ => out.copy_from_slice(logits),
                        }
                    }
                });
            }
        }
    }
}

/// `out` (n, D) becomes the rows `rows` (n) of `x`, D = `width`; [`NONE`] is a row of zeros.
fn collect(out: &mut [f32], width: usize, x: &[f32], rows: &[u32]) {
    embed(out, width, &[Lookup { table: x, ids: rows }]);
}
