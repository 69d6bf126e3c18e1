//! A trunk in which every frame is a row, and a decoder inside the frame.
//!
//! Letters: B windows, F frames, N = B F, W tokens of a word, C characters, T = F W, D width of the trunk, d of the decoder,
//! e numbers of a character.

use super::Added;
use super::keys::Keys;
use super::stack::{Blocks, Stack};
use super::tables::{add_rows, embed, into_table};
use super::{Fast, Windows};
use crate::forecast::NUMBERS;
use crate::frames::{BACK, Frames, SPELT, TrunkRow, spelt_tables, trunk_row};
use crate::goal;
use crate::goal::Conditioning;
use crate::layout::{CLASS, FORECAST, GOAL, LABEL, MUSIC, SPELL, SPELT_LABEL, TRUNK};
use crate::sequence::Sequences;
use kinelm_engine::arena::Floats;
use kinelm_engine::block::{Linear, Norm, Rules, Shape};
use kinelm_engine::dense;
use kinelm_engine::linear::Products;
use kinelm_engine::op::attention::Mask;
use kinelm_engine::op::embedding::{Lookup, NONE};
use kinelm_engine::op::layer_norm::Saved;
use rayon::prelude::*;

/// Bias and weight of the trunk's input projection, of its norm, and of its projection to the decoder.
const JOIN: [&str; 2] = ["frame.join.bias", "frame.join.weight"];
pub(super) const NORM: [&str; 2] = ["trunk.norm.bias", "trunk.norm.weight"];
const TO_DECODER: [&str; 2] = ["spell.frame.bias", "spell.frame.weight"];

/// A character sees those before it in its frame.
const SPELLING: Rules<'static> = Rules { mask: Mask::Causal, dropout: None, rope: None };

/// The buffers of one shape.
pub(super) struct TwoLevel {
    frames: Frames,
    /// K - 1: tokens of a window before the one after which frames begin; all but the first are labels.
    skipped: usize,
    /// T.
    length: usize,
    /// F.
    number: usize,
    /// e.
    character: usize,
    /// (N, 2 C) rows of the table of characters.
    seen: Vec<u32>,
    /// (N) rows of the table of positions.
    positions: Vec<u32>,
    /// n, and (N) rows of their table.
    class_rows: usize,
    classes: Vec<u32>,
    /// The tables of the decoder's rows, (N W) each of [`SPELT`] their rows, and those of the frames' vectors.
    tables: &'static [&'static str],
    spelt: [Vec<u32>; 5],
    own: Vec<u32>,
    /// (N) each of the K - 1: rows of the tables of labels.
    labels: Vec<Vec<u32>>,
    /// (B T, d), where K > 1: what the decoder gave, and 0 for tokens that predict nothing.
    rows: Floats,
    /// (N, 2 C e) The input of the trunk.
    read: Floats,
    join: dense::Workspace,
    trunk: Stack,
    /// (N, 2), (N, D), (N, d).
    stats: Floats,
    normed: Floats,
    conditioning: Floats,
    to_decoder: dense::Workspace,
    decoder: Stack,
    /// (N W, P) the numbers of the slots' forecasts, and their projection, where there is a forecast.
    forecast: Option<(Floats, Matrix)>,
    /// The conditioning of frames: goals, and music.
    projections: Vec<Projection>,
    back: Option<Back>,
}

/// The projection of conditioning numbers.
struct Projection {
    /// Which conditioning.
    numbers: fn(&Conditioning) -> &[f32],
    /// The matrices.
    names: [&'static str; 2],
    /// From P numbers to the trunk's rows (N, D), and to the decoder's, by frames (N, d).
    trunk: Matrix,
    decoder: Matrix,
}

/// A matrix (P, n) without a bias.
struct Matrix {
    space: dense::Workspace,
    /// (N, n).
    out: Floats,
    /// (n), zeros, and their gradient, which nothing reads.
    bias: Floats,
    d_bias: Floats,
}

impl Matrix {
    fn new(n: usize, conditioning: usize, out: usize, products: Products, learn: bool) -> Matrix {
        Matrix {
            space: dense::Workspace::new(n, conditioning, out, products, learn),
            out: Floats::new(n * out),
            bias: Floats::new(out),
            d_bias: Floats::new(out),
        }
    }

    /// Adds what `numbers` (N, P) times `weight` are to `x` (N, n).
    fn add(&mut self, x: &mut [f32], numbers: &[f32], weight: &[f32]) {
        dense::forward(&mut self.out, numbers, Linear { weight, bias: &self.bias }, &mut self.space);
        x.iter_mut().zip(&*self.out).for_each(|(x, y)| *x += y);
    }

    /// The gradient of `weight` from that of what it was added to, `dx` (N, n).
    fn backward(&mut self, dx: &[f32], numbers: &[f32], weight: &[f32], gradient: &mut [f32]) {
        let to = Linear { weight: gradient, bias: &mut *self.d_bias };
        dense::backward(None, dx, numbers, weight, to, &mut self.space);
    }
}

/// Gradients on their way.
struct Back {
    d_read: Floats,
    d_conditioning: Floats,
    d_normed: Floats,
    d_trunk: Floats,
    /// (N W, d), where K > 1.
    d_rows: Floats,
    /// (V, the larger of D and d), where K > 1: a table's gradient from one label.
    d_label: Floats,
}

impl TwoLevel {
    pub fn new(model: &Fast, rows: usize, length: usize, products: Products, learn: bool) -> TwoLevel {
        let (config, frames) = (&model.config, Frames::of(&model.tokens));
        let (word, decoder, trunk) = (frames.word(), config.decoder(), config.width);
        let skipped = model.tokens.front - 1;
        let (batch, number) = (rows / length, (length - skipped) / word);
        let (n, d, of_frame) = (batch * number, decoder.width, BACK * frames.characters());
        let wide = of_frame * decoder.character_width;
        let shape = |batch, tokens, width, heads| Shape { batch, tokens, width, heads, hidden: 4 * width };
        let stack =
            |prefix, layers, shape| Stack::new(&model.parameters, Blocks { prefix, layers }, shape, products, learn);
        // without labels the decoder's rows are the model's rows, and need no copy
        let where_labelled = |n: usize| Floats::new(if skipped > 0 { n } else { 0 });
        TwoLevel {
            skipped,
            length,
            number,
            character: decoder.character_width,
            seen: vec![0; n * of_frame],
            positions: (0..n).map(|row| (row % number) as u32).collect(),
            class_rows: config.classes,
            classes: vec![NONE; n],
            tables: spelt_tables(config.forecast()),
            spelt: std::array::from_fn(|_| vec![0; n * word]),
            own: (0..n * word).map(|row| (row / word) as u32).collect(),
            labels: vec![vec![0; n]; skipped],
            rows: where_labelled(rows * d),
            read: Floats::new(n * wide),
            join: dense::Workspace::new(n, wide, trunk, products, learn),
            trunk: stack(TRUNK, config.layers, shape(batch, number, trunk, config.heads)),
            stats: Floats::new(2 * n),
            normed: Floats::new(n * trunk),
            conditioning: Floats::new(n * d),
            to_decoder: dense::Workspace::new(n, trunk, d, products, learn),
            forecast: config.forecast().then(|| {
                let rows = n * word;
                (Floats::new(rows * NUMBERS), Matrix::new(rows, NUMBERS, d, products, learn))
            }),
            // a frame is a sequence of its own to the decoder, so its attention ends at the frame
            decoder: stack(SPELL, decoder.layers, shape(n, word, d, decoder.heads)),
            projections: {
                let projection = |numbers: fn(&Conditioning) -> &[f32], names, p| {
                    let matrix = |out| Matrix::new(n, p, out, products, learn);
                    Projection { numbers, names, trunk: matrix(trunk), decoder: matrix(d) }
                };
                let [frame, spell, ..] = GOAL;
                let p = goal::numbers(frames.characters());
                let goal = config.goal.then(|| projection(|conditioning| &conditioning.numbers, [frame, spell], p));
                let m = config.music.numbers();
                let music = (m > 0).then(|| projection(|conditioning| &conditioning.music, MUSIC, m));
                goal.into_iter().chain(music).collect()
            },
            back: learn.then(|| Back {
                d_read: Floats::new(n * wide),
                d_conditioning: Floats::new(n * d),
                d_normed: Floats::new(n * trunk),
                d_trunk: Floats::new(n * trunk),
                d_rows: where_labelled(n * word * d),
                d_label: where_labelled(model.tokens.vocabulary * trunk.max(d)),
            }),
            frames,
        }
    }

    /// Finds the rows that windows (B, T) take of all tables.
    fn look(&mut self, inputs: &[u32], length: usize, sequences: &Sequences) {
        let (frames, number, word, skipped) = (&self.frames, self.number, self.frames.word(), self.skipped);
        for (k, labels) in self.labels.iter_mut().enumerate() {
            labels.iter_mut().enumerate().for_each(|(row, label)| *label = inputs[row / number * length + 1 + k]);
        }
        let of_frame = BACK * frames.characters();
        let window = |frame: usize| &inputs[frame / number * length + skipped..][..length - skipped];
        let rows = self.positions.chunks_mut(number).zip(self.classes.chunks_mut(number)).enumerate();
        for (i, (positions, classes)) in rows.filter(|_| self.class_rows > 0) {
            let shown = frames.shown(window(i * number));
            for (row, (position, class)) in positions.iter_mut().zip(classes).enumerate() {
                TrunkRow { position: *position, class: *class, .. } = trunk_row(row, shown, self.class_rows);
            }
        }
        // a class row reads the same two frames as the first row after the window's frames
        let read = |row: usize| match self.classes[row] {
            NONE => row % number,
            class => row % number - class as usize,
        };
        // frames before the window's first
        let before = sequences.layout.history() / word;
        self.seen.par_chunks_mut(of_frame).enumerate().for_each(|(i, rows)| {
            frames.seen(sequences.get(i / number).ids, before + read(i), rows);
        });
        let [last, place, character, step, innovation] = self.spelt.each_mut().map(|rows| rows.par_chunks_mut(word));
        let tables = (last, place, character, step, innovation).into_par_iter().enumerate();
        tables.for_each(|(i, (last, place, character, step, innovation))| {
            let sequence = sequences.get(i / number);
            for k in 0..word {
                [last[k], place[k], character[k], step[k], innovation[k]] =
                    frames.spelt(&sequence, (before + i % number) * word + k);
            }
        });
        if let Some((numbers, _)) = &mut self.forecast {
            numbers.par_chunks_mut(NUMBERS).enumerate().for_each(|(row, numbers)| {
                let (i, k) = (row / word, row % word);
                let (sequence, at) = (sequences.get(i / number), (before + i % number) * word + k);
                frames.forecast_numbers(sequence.ids, at, sequence.forecast(at), numbers);
            });
        }
    }

    /// The trunk alone, for [`TwoLevel::vectors`].
    pub fn forward_trunk(&mut self, model: &Fast, windows: Windows, sequences: &Sequences, keys: Option<&Keys>) {
        self.look(windows.inputs, windows.length, sequences);
        let seen = [Lookup { table: model.weight("frame.character.weight"), ids: &self.seen }];
        embed(&mut self.read, self.character, &seen);
        dense::forward(self.trunk.input(), &self.read, linear(model, JOIN), &mut self.join);
        let width = model.config.width;
        add_rows(self.trunk.input(), width, model.weight("frame.position.weight"), &self.positions);
        if self.class_rows > 0 {
            add_rows(self.trunk.input(), width, model.weight(CLASS), &self.classes);
        }
        for labels in &self.labels {
            add_rows(self.trunk.input(), width, model.weight(LABEL), labels);
        }
        for (projection, numbers) in conditioning(&mut self.projections, windows.conditioning) {
            projection.trunk.add(self.trunk.input(), numbers, model.weight(projection.names[0]));
        }
        self.trunk.forward(&model.weights, between_frames(windows.mask), keys);
    }

    /// The output of the trunk's last block (N, D).
    pub fn vectors(&self) -> &[f32] {
        self.trunk.last()
    }

    pub fn forward(&mut self, model: &Fast, windows: Windows, sequences: &Sequences, keys: Option<&Keys>) {
        self.forward_trunk(model, windows, sequences, keys);
        let norm = Norm { weight: model.weight(NORM[1]), bias: model.weight(NORM[0]) };
        dense::norm(&mut self.normed, &mut self.stats, self.trunk.last(), norm);
        dense::forward(&mut self.conditioning, &self.normed, linear(model, TO_DECODER), &mut self.to_decoder);
        for labels in &self.labels {
            add_rows(&mut self.conditioning, self.decoder.shape().width, model.weight(SPELT_LABEL), labels);
        }
        for (projection, numbers) in conditioning(&mut self.projections, windows.conditioning) {
            projection.decoder.add(&mut self.conditioning, numbers, model.weight(projection.names[1]));
        }
        let mut lookups = [Lookup { table: &self.conditioning, ids: &self.own }; SPELT.len() + 3];
        let goal = windows.conditioning.filter(|conditioning| !conditioning.rows[0].is_empty());
        let goal = goal.iter().flat_map(|conditioning| GOAL[2..].iter().copied().zip(&conditioning.rows));
        let mut used = 1;
        for (lookup, (name, ids)) in
            lookups[1..].iter_mut().zip(self.tables.iter().copied().zip(&self.spelt).chain(goal))
        {
            *lookup = Lookup { table: model.weight(name), ids };
            used += 1;
        }
        let d = self.decoder.shape().width;
        embed(self.decoder.input(), d, &lookups[..used]);
        if let Some((numbers, matrix)) = &mut self.forecast {
            matrix.add(self.decoder.input(), numbers, model.weight(FORECAST));
        }
        // no dropout in the decoder: keys exist for the trunk's blocks alone, as in the plain form
        self.decoder.forward(&model.weights, SPELLING, None);
        if self.skipped > 0 {
            let (length, skipped) = (self.length * d, self.skipped * d);
            for (rows, given) in self.rows.chunks_mut(length).zip(self.decoder.last().chunks(length - skipped)) {
                rows[skipped..].copy_from_slice(given);
            }
        }
    }

    /// The output of the decoder (B T, d); 0 for the tokens of the front but its last.
    pub fn last(&self) -> &[f32] {
        if self.skipped > 0 { &self.rows } else { self.decoder.last() }
    }

    /// From the gradient `dx` (B T, d) of [`TwoLevel::last`], which is used up, those of all tensors before it; `added` adds to
    /// that of [`TwoLevel::vectors`].
    pub fn backward(
        &mut self,
        model: &Fast,
        windows: Windows,
        keys: Option<&Keys>,
        dx: &mut [f32],
        gradients: &mut [Floats],
        added: Added,
    ) {
        let Some(Back { d_read, d_conditioning, d_normed, d_trunk, d_rows, d_label }) = &mut self.back else {
            panic!("buffers for the forward pass only")
        };
        let d = self.decoder.shape().width;
        let dx = if self.skipped > 0 {
            let (length, skipped) = (self.length * d, self.skipped * d);
            for (dx, rows) in dx.chunks(length).zip(d_rows.chunks_mut(length - skipped)) {
                rows.copy_from_slice(&dx[skipped..]);
            }
            &mut **d_rows
        } else {
            dx
        };
        self.decoder.backward(&model.weights, gradients, dx, SPELLING, None);
        for (name, ids) in self.tables.iter().zip(&self.spelt) {
            into_table(&mut gradients[model.index(name)], d, ids, dx);
        }
        if let Some((numbers, matrix)) = &mut self.forecast {
            matrix.backward(dx, numbers, model.weight(FORECAST), &mut gradients[model.index(FORECAST)]);
        }
        // the frame's vector was added to all its W rows, so its gradient is their sum
        into_table(d_conditioning, d, &self.own, dx);
        into_labels(model, gradients, SPELT_LABEL, d_label, &self.labels, d_conditioning);
        for name in GOAL.iter().chain(&MUSIC) {
            if let Some(i) = model.find(name) {
                // a batch without goals or music must not leave the gradients of the one before
                gradients[i].fill(0.0);
            }
        }
        if let Some(rows) =
            windows.conditioning.map(|conditioning| &conditioning.rows).filter(|rows| !rows[0].is_empty())
        {
            for (name, rows) in GOAL[2..].iter().zip(rows) {
                into_table(&mut gradients[model.index(name)], d, rows, dx);
            }
        }
        for (projection, numbers) in conditioning(&mut self.projections, windows.conditioning) {
            let name = projection.names[1];
            projection.decoder.backward(d_conditioning, numbers, model.weight(name), &mut gradients[model.index(name)]);
        }
        let to = gradients_of(model, gradients, TO_DECODER);
        dense::backward(
            Some(d_normed),
            d_conditioning,
            &self.normed,
            model.weight(TO_DECODER[1]),
            to,
            &mut self.to_decoder,
        );
        let Linear { weight, bias } = gradients_of(model, gradients, NORM);
        let saved = Saved { x: self.trunk.last(), stats: &self.stats, weight: model.weight(NORM[1]) };
        dense::norm_backward(d_trunk, d_normed, saved, Norm { weight, bias });
        added(model, self.trunk.last(), d_trunk, gradients);
        self.trunk.backward(&model.weights, gradients, d_trunk, between_frames(windows.mask), keys);
        for (projection, numbers) in conditioning(&mut self.projections, windows.conditioning) {
            let name = projection.names[0];
            projection.trunk.backward(d_trunk, numbers, model.weight(name), &mut gradients[model.index(name)]);
        }
        let width = model.config.width;
        into_table(&mut gradients[model.index("frame.position.weight")], width, &self.positions, d_trunk);
        if self.class_rows > 0 {
            into_table(&mut gradients[model.index(CLASS)], width, &self.classes, d_trunk);
        }
        // a label's vector has reached both levels, through two tables
        into_labels(model, gradients, LABEL, d_label, &self.labels, d_trunk);
        let to = gradients_of(model, gradients, JOIN);
        dense::backward(Some(d_read), d_trunk, &self.read, model.weight(JOIN[1]), to, &mut self.join);
        into_table(&mut gradients[model.index("frame.character.weight")], self.character, &self.seen, d_read);
    }
}

/// The projections that have numbers, with them.
fn conditioning<'a>(
    projections: &'a mut [Projection],
    conditioning: Option<&'a Conditioning>,
) -> impl Iterator<Item = (&'a mut Projection, &'a [f32])> {
    let with = move |projection: &'a mut Projection| {
        conditioning.map(|conditioning| ((projection.numbers)(conditioning), projection))
    };
    projections
        .iter_mut()
        .filter_map(with)
        .filter(|(numbers, _)| !numbers.is_empty())
        .map(|(numbers, projection)| (projection, numbers))
}

/// The gradient of the table `name` (V, n), of which every frame takes the rows of all `labels` (N), from that of what they are
/// added to, `dx` (N, n); `room` holds what one label gives.
fn into_labels(model: &Fast, gradients: &mut [Floats], name: &str, room: &mut [f32], labels: &[Vec<u32>], dx: &[f32]) {
    let Some(table) = model.find(name) else { return };
    let gradient = &mut gradients[table];
    gradient.fill(0.0);
    for ids in labels {
        let room = &mut room[..gradient.len()];
        into_table(room, dx.len() / ids.len(), ids, dx);
        // a sum over the labels, of which `into_table` sets one
        gradient.iter_mut().zip(room).for_each(|(g, d)| *g += *d);
    }
}

/// A frame sees those before it, or what `mask` (F, F) or (B, F, F) lets it.
fn between_frames(mask: Mask<'_>) -> Rules<'_> {
    Rules { mask, dropout: None, rope: None }
}

fn linear<'a>(model: &'a Fast, [bias, weight]: [&str; 2]) -> Linear<&'a [f32]> {
    Linear { weight: model.weight(weight), bias: model.weight(bias) }
}

/// The gradients of a layer.
fn gradients_of<'a>(model: &Fast, all: &'a mut [Floats], names: [&str; 2]) -> Linear<&'a mut [f32]> {
    let Ok([bias, weight]) = all.get_disjoint_mut(names.map(|name| model.index(name))) else {
        panic!("a model has its tensors")
    };
    Linear { weight: &mut **weight, bias: &mut **bias }
}
