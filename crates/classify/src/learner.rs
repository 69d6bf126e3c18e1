//! A model and its class heads as they learn, on the CPU.

use super::Field;
use super::fields::Fields;
use crate::Result;
use kinelm_engine::arena::Floats;
use kinelm_model::fast::{ClassRow, Fast, Losses, Windows};
use kinelm_model::layout::{CLASS, Init, Parameter, Role};
use kinelm_model::weights::{Weights, named};
use kinelm_model::{Architecture, Dropout, Scores};
use kinelm_train::TrainConfig;
use kinelm_train::learner::{clip_share, not_finite};
use kinelm_train::optimizer::{Adam, Optimizer, Rates};
use rayon::prelude::*;

/// The name of a field's head among the tensors.
pub(super) fn head_name(field: &str) -> String {
    format!("classes.{field}.weight")
}

/// Heads before training: normal numbers of the model's own deviation, (classes, D) each.
pub(super) fn first_heads(fields: &Fields, width: usize, seed: u64) -> Vec<Floats> {
    heads(fields, width).iter().map(|head| Floats::of(&head.initial(seed))).collect()
}

/// The heads of all fields, (classes, D) each.
pub(super) fn heads(fields: &Fields, width: usize) -> Vec<Parameter> {
    let head = |field: &Field| {
        let (name, shape) = (head_name(&field.name), vec![field.classes.len(), width]);
        Parameter { name, shape, init: Init::Normal(0.02), role: Role::Matrix }
    };
    fields.0.iter().map(head).collect()
}

/// What learns: the model's tensors at one rate, the heads and the class tokens, which are new, at another.
pub(super) struct Learner {
    pub model: Fast,
    pub heads: Vec<Floats>,
    head_parameters: Vec<Parameter>,
    /// Of the model's tensors, then of the heads.
    optimizer: Optimizer,
    /// The tensor with the rows of the class tokens, and the first number of these in it.
    class_rows: (usize, usize),
}

/// A batch: its windows, its class rows and the names of its clips for a message.
pub(super) struct Batch<'a> {
    pub windows: Windows<'a>,
    pub rows: &'a [ClassRow],
    pub clips: &'a [String],
}

impl Learner {
    /// `class_token` is the first class token's id in a flat model.
    pub fn new(model: Fast, fields: &Fields, head_weights: Vec<Floats>, class_token: u32) -> Learner {
        let config = Scores::config(&model);
        let (table, row) = match config.architecture {
            Architecture::Flat => ("token.weight", class_token as usize * config.width),
            Architecture::TwoLevel => (CLASS, 0),
        };
        let table = model.parameters().iter().position(|p| p.name == table).unwrap_or_default();
        let head_parameters = heads(fields, config.width);
        let optimizer = Optimizer::new([model.parameters(), &head_parameters].concat());
        Learner { optimizer, class_rows: (table, row), head_parameters, model, heads: head_weights }
    }

    /// One update by AdamW on clipped gradients, at the first of `rates` for what was pretrained, at the second for what is
    /// new.
    ///
    /// # Errors
    /// A loss that is not finite, with the clips; what the model refuses.
    pub fn step(
        &mut self,
        batch: Batch,
        dropout: Option<&Dropout>,
        train: &TrainConfig,
        [rate, new_rate]: [f64; 2],
    ) -> Result<Losses> {
        let pretrained = self.model.parameters().len();
        let (of_model, of_heads) = self.optimizer.gradients.split_at_mut(pretrained);
        let (model, heads) = (&mut self.model, &self.heads);
        let found = model.gradients_with_classes(batch.windows, dropout, of_model, heads, batch.rows, of_heads)?;
        let norm = self.optimizer.norm();
        // before the update, which would spread it over all weights
        if let Some(wrong) = [found.tokens + found.classes, norm].into_iter().find(|x| !x.is_finite()) {
            return Err(not_finite(wrong, batch.clips));
        }
        let (table, row) = self.class_rows;
        let rates = |i: usize, parameter: &Parameter| Rates {
            rate: if i < pretrained { rate } else { new_rate },
            decay: if parameter.role == Role::Matrix { train.weight_decay } else { 0.0 },
            // in their table the class tokens' rows are the last
            tail: (i == table).then_some((row, new_rate)),
        };
        let weights = self.model.weights_mut().par_iter_mut().chain(&mut self.heads);
        let adam = Adam { betas: train.betas, epsilon: train.epsilon };
        self.optimizer.update(weights, adam, clip_share(norm, train.clip_norm), rates);
        Ok(found)
    }

    /// The weights, those of the heads among them.
    pub fn weights(&self) -> Weights {
        let mut all = self.model.weights();
        all.extend(named(&self.head_parameters, &self.heads));
        all
    }

    /// The optimizer's moments by name.
    pub fn moments(&self) -> Weights {
        self.optimizer.moments()
    }

    /// Continues from the moments after `updates` updates.
    ///
    /// # Errors
    /// Tensors that are missing or of another shape.
    pub fn restore(&mut self, moments: &Weights, updates: u64) -> Result<()> {
        self.optimizer.restore(moments, updates)
    }
}
