//! A model and its class heads as they learn, on the CPU.

use super::fields::Fields;
use crate::Result;
use candle_core::Tensor;
use kinelm_engine::arena::Floats;
use kinelm_engine::op::adamw::{self, Step};
use kinelm_model::fast::{ClassRow, Fast, Losses, Windows, named};
use kinelm_model::layout::{CLASS, Init, Parameter, Role};
use kinelm_model::{Architecture, Dropout, Scores};
use kinelm_train::TrainConfig;
use kinelm_train::adamw::MOMENTS;
use kinelm_train::fast::fill;
use kinelm_train::learner::{clip_share, in_order, not_finite};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A class head's name among the tensors.
pub(super) fn head_name(field: &str) -> String {
    format!("classes.{field}.weight")
}

/// Heads before training: normal numbers of the model's own spread, (classes, D) each.
pub(super) fn first_heads(fields: &Fields, width: usize, seed: u64) -> Vec<Floats> {
    fields.0.iter().map(|field| Floats::of(&head(field, width).initial(seed))).collect()
}

/// A field's head among the parameters.
fn head(field: &super::Field, width: usize) -> Parameter {
    let (name, shape) = (head_name(&field.name), vec![field.classes.len(), width]);
    Parameter { name, shape, init: Init::Normal(0.02), role: Role::Matrix }
}

/// What learns: the model's tensors at one rate, the heads and the class tokens, which begin with nothing, at another.
pub(super) struct Learner {
    pub model: Fast,
    pub heads: Vec<Floats>,
    /// Of the model's tensors, then of the heads.
    gradients: [Vec<Floats>; 2],
    first: [Vec<Floats>; 2],
    second: [Vec<Floats>; 2],
    /// The tensor that holds what stands for class tokens or rows, and where that begins in it.
    class_rows: (usize, usize),
    /// Which of the model's tensors decay.
    decays: Vec<bool>,
    updates: u64,
}

/// A batch: its windows, its class rows and the names for a message.
pub(super) struct Batch<'a> {
    pub windows: Windows<'a>,
    pub rows: &'a [ClassRow],
    pub clips: &'a [String],
}

impl Learner {
    /// `class_token` is the first class token's id in a flat model.
    pub fn new(model: Fast, heads: Vec<Floats>, class_token: u32) -> Learner {
        let config = Scores::config(&model);
        let (table, row) = match config.architecture {
            Architecture::Flat => ("token.weight", class_token as usize * config.width),
            Architecture::TwoLevel => (CLASS, 0),
        };
        let table = model.parameters().iter().position(|p| p.name == table).unwrap_or_default();
        let like = |heads: &[Floats]| heads.iter().map(|h| Floats::new(h.len())).collect::<Vec<_>>();
        let room = || [model.like_weights(), like(&heads)];
        let (gradients, first, second) = (room(), room(), room());
        Learner {
            gradients,
            first,
            second,
            class_rows: (table, row),
            decays: model.parameters().iter().map(|p| p.role == Role::Matrix).collect(),
            model,
            heads,
            updates: 0,
        }
    }

    /// One update: the gradients of the batch, clipped, then AdamW at `rate`, and at `head_rate` where nothing was learnt before.
    ///
    /// # Errors
    /// A loss that is not finite, with the clips; what the model refuses.
    pub fn step(
        &mut self,
        batch: Batch,
        dropout: Option<&Dropout>,
        train: &TrainConfig,
        rates: [f64; 2],
    ) -> Result<Losses> {
        let [of_model, of_heads] = &mut self.gradients;
        let classes = (self.heads.as_slice(), batch.rows);
        let found = self.model.gradients_with_classes(batch.windows, dropout, of_model, classes, of_heads)?;
        let sum = found.tokens + found.classes;
        if !sum.is_finite() {
            return Err(not_finite(sum, batch.clips));
        }
        let norm = of_model.iter().chain(of_heads.iter()).map(|g| adamw::norm_squared(g)).sum::<f64>().sqrt();
        if !norm.is_finite() {
            return Err(not_finite(norm, batch.clips));
        }
        self.updates += 1;
        let share = clip_share(norm, train.clip_norm);
        let step = |rate, decay| Step::new(self.updates, rate, train.betas, train.epsilon, decay, share);
        let [slow, fast] = rates;
        let (kept, decayed, fresh) = (step(slow, 0.0), step(slow, train.weight_decay), step(fast, train.weight_decay));
        let (token, row) = self.class_rows;
        let [m, m_heads] = &mut self.first;
        let [v, v_heads] = &mut self.second;
        let all = (self.model.weights_mut(), m, v, &*of_model, &self.decays).into_par_iter().enumerate();
        all.for_each(|(i, (x, m, v, g, &decays))| {
            let step = if decays { &decayed } else { &kept };
            if i != token {
                return adamw::update(x, m, v, g, step);
            }
            let ((x, new), (m, new_m)) = (x.split_at_mut(row), m.split_at_mut(row));
            let ((v, new_v), (g, new_g)) = (v.split_at_mut(row), g.split_at(row));
            adamw::update(x, m, v, g, step);
            // embeddings don't decay
            adamw::update(new, new_m, new_v, new_g, &Step { keep: 1.0, ..fresh });
        });
        let all = (&mut self.heads, m_heads, v_heads, &*of_heads).into_par_iter();
        all.for_each(|(x, m, v, g)| adamw::update(x, m, v, g, &fresh));
        Ok(found)
    }

    /// The tensors by name, the heads among them.
    ///
    /// # Errors
    /// None in practice.
    pub fn tensors(&self, fields: &Fields) -> Result<BTreeMap<String, Tensor>> {
        let mut all = self.model.tensors()?;
        all.extend(self.of_heads(fields, &self.heads)?);
        Ok(all)
    }

    /// The optimizer's moments by name.
    ///
    /// # Errors
    /// None in practice.
    pub fn moments(&self, fields: &Fields) -> Result<BTreeMap<String, Tensor>> {
        let mut all = BTreeMap::new();
        for (prefix, [of_model, of_heads]) in MOMENTS.iter().zip([&self.first, &self.second]) {
            let mut tensors = named(self.model.parameters(), of_model)?;
            tensors.extend(self.of_heads(fields, of_heads)?);
            all.extend(tensors.into_iter().map(|(name, tensor)| (format!("{prefix}.{name}"), tensor)));
        }
        Ok(all)
    }

    /// Takes back what [`Learner::moments`] gave after so many updates.
    ///
    /// # Errors
    /// Tensors that are missing or of another shape.
    pub fn restore(&mut self, fields: &Fields, moments: &BTreeMap<String, Tensor>, updates: u64) -> Result<()> {
        let width = Scores::config(&self.model).width;
        let heads: Vec<Parameter> = fields.0.iter().map(|field| head(field, width)).collect();
        for (prefix, [of_model, of_heads]) in MOMENTS.iter().zip([&mut self.first, &mut self.second]) {
            let name = |p: &Parameter| format!("{prefix}.{}", p.name);
            fill(of_model, &in_order("optimizer", self.model.parameters(), moments, name)?)?;
            fill(of_heads, &in_order("optimizer", &heads, moments, name)?)?;
        }
        self.updates = updates;
        Ok(())
    }

    fn of_heads(&self, fields: &Fields, numbers: &[Floats]) -> Result<BTreeMap<String, Tensor>> {
        let width = Scores::config(&self.model).width;
        let heads: Vec<Parameter> = fields.0.iter().map(|field| head(field, width)).collect();
        named(&heads, numbers)
    }
}
