//! Forward and backward through a whole model, for batches of one shape.

use super::Added;
use super::flat::Flat;
use super::head::Heads;
use super::keys::Keys;
use super::two_level::TwoLevel;
use super::{Fast, Windows};
use crate::sequence::Sequences;
use crate::{Architecture, Result};
use kinelm_engine::arena::Floats;
use kinelm_engine::linear::Products;

/// The buffers of one shape.
pub(super) struct Pass {
    rows: usize,
    length: usize,
    products: Products,
    sequences: Sequences,
    body: Body,
    heads: Heads,
    /// (N, d), d numbers of a row that the head reads.
    dx: Floats,
}

/// The part of a model that makes a row of every token.
enum Body {
    Flat(Box<Flat>),
    TwoLevel(Box<TwoLevel>),
}

impl Pass {
    pub fn new(model: &Fast, rows: usize, length: usize, products: Products, learn: bool) -> Pass {
        let config = &model.config;
        Pass {
            rows,
            length,
            products,
            sequences: Sequences::new(config, &model.tokens, rows / length, length),
            body: match config.architecture {
                Architecture::Flat => Body::Flat(Box::new(Flat::new(model, rows, length, products, learn))),
                Architecture::TwoLevel => Body::TwoLevel(Box::new(TwoLevel::new(model, rows, length, products, learn))),
            },
            heads: Heads::new(config, &model.tokens, rows, length, products, learn),
            dx: Floats::new(if learn { rows * config.head_width() } else { 0 }),
        }
    }

    pub fn fits(&self, rows: usize, length: usize, products: Products) -> bool {
        (self.rows, self.length, self.products) == (rows, length, products)
    }

    /// Takes windows, of which all else is computed.
    pub fn fill(&mut self, model: &Fast, windows: Windows) {
        self.sequences.fill(windows.inputs, windows.history, model.forecast.as_ref());
    }

    /// Takes the rows whose target counts.
    ///
    /// # Errors
    /// Targets that nothing answers.
    pub fn set_targets(&mut self, windows: Windows) -> Result<()> {
        self.heads.set_targets(&self.sequences, windows.targets)
    }

    pub fn forward(&mut self, model: &Fast, windows: Windows, keys: Option<&Keys>) {
        match &mut self.body {
            Body::Flat(flat) => flat.forward(model, windows, keys),
            Body::TwoLevel(levels) => levels.forward(model, windows, &self.sequences, keys),
        }
    }

    /// -ln p of every row's target, in nats, 0 where it has none.
    pub fn nats(&mut self, model: &Fast, out: &mut [f32]) {
        self.heads.nats(model, self.body.last(), out);
    }

    /// The logits (N, V) of all rows.
    pub fn logits(&mut self, model: &Fast, windows: Windows, out: &mut [f32]) {
        self.heads.logits(model, self.body.last(), &self.sequences, windows.length, out);
    }

    /// The input of the norm of [`Fast::final_vectors`]: (B T, D), of a two-level model the trunk's rows (B F, D).
    pub fn vectors(&mut self, model: &Fast, windows: Windows) -> &[f32] {
        match &mut self.body {
            Body::Flat(flat) => {
                flat.forward(model, windows, None);
                flat.last()
            }
            Body::TwoLevel(levels) => {
                levels.forward_trunk(model, windows, &self.sequences, None);
                levels.vectors()
            }
        }
    }

    /// Loss in nats, summed; `gradients` become those of the loss times `scale`, and of what `added` adds.
    pub fn backward(
        &mut self,
        model: &Fast,
        windows: Windows,
        scale: f32,
        keys: Option<&Keys>,
        gradients: &mut [Floats],
        added: Added,
    ) -> f64 {
        let last = self.body.last();
        let nats = self.heads.loss(model, last, scale, &mut self.dx, gradients);
        match &mut self.body {
            Body::Flat(flat) => {
                // after the heads, which set the norm's gradient, and before the body, which uses up dx
                added(model, flat.last(), &mut self.dx, gradients);
                flat.backward(model, windows, keys, &mut self.dx, gradients);
            }
            Body::TwoLevel(levels) => levels.backward(model, windows, keys, &mut self.dx, gradients, added),
        }
        nats
    }
}

impl Body {
    fn last(&self) -> &[f32] {
        match self {
            Body::Flat(flat) => flat.last(),
            Body::TwoLevel(levels) => levels.last(),
        }
    }
}
