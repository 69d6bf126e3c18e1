//! The keys and values of the tokens read so far, in one allocation.
//!
//! [layer][head][stream], each unit the keys, then the values. Keys are stored in panels of tokens,
//! [T / panel][d][panel], and values in panels of their numbers, [d / panel][T][panel]: both are right factors of the
//! products of attention.

use crate::arena::Floats;
use crate::element::Element;
use crate::op::matmul::panel;
use half::f16;
use half::slice::{HalfBitsSliceExt, HalfFloatSliceExt};

/// The format of keys and values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum KvKind {
    /// As they are.
    #[default]
    F32,
    /// As half floats: half the memory, and half of it to read for every token.
    F16,
}

/// A number as the cache stores it.
pub(super) trait Stored: Element {
    /// `from` rounded to this, at most [`CHUNK`] numbers.
    fn store(to: &mut [Self], from: &[f32]);
}

/// Numbers that are rounded at a time.
const CHUNK: usize = 32;

impl Stored for f32 {
    fn store(to: &mut [f32], from: &[f32]) {
        to.copy_from_slice(from);
    }
}

impl Stored for u16 {
    fn store(to: &mut [u16], from: &[f32]) {
        // beyond 65,504 this is infinity, which widens to 65,536 (`element`): no score becomes NaN by it
        to.reinterpret_cast_mut::<f16>().convert_from_f32_slice(from);
    }
}

/// The layout of a unit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Unit {
    /// T, whole panels.
    pub tokens: usize,
    /// d.
    pub d: usize,
    /// d, whole panels.
    pub padded: usize,
    pub panel: usize,
}

impl Unit {
    pub fn new(context: usize, d: usize) -> Unit {
        let panel = panel();
        Unit { tokens: context.next_multiple_of(panel), d, padded: d.next_multiple_of(panel), panel }
    }

    /// Numbers of a unit.
    pub fn len(&self) -> usize {
        self.tokens * (self.d + self.padded)
    }

    /// Its keys and its values.
    pub fn split<'a, E>(&self, unit: &'a [E]) -> (&'a [E], &'a [E]) {
        unit.split_at(self.tokens * self.d)
    }

    /// Stores key and value (d) of the token at `place`.
    pub fn store<E: Stored>(&self, unit: &mut [E], place: usize, key: &[f32], value: &[f32]) {
        let (keys, values) = unit.split_at_mut(self.tokens * self.d);
        let mut rounded = [E::zeroed(); CHUNK];
        let base = place / self.panel * self.d * self.panel + place % self.panel;
        for (c, key) in key.chunks(CHUNK).enumerate() {
            let rounded = &mut rounded[..key.len()];
            E::store(rounded, key);
            for (i, x) in rounded.iter().enumerate() {
                // a token is a column of its panel: one write here, so that reading streams
                keys[base + (c * CHUNK + i) * self.panel] = *x;
            }
        }
        for (p, value) in value.chunks(self.panel).enumerate() {
            E::store(&mut values[(p * self.tokens + place) * self.panel..][..value.len()], value);
        }
    }
}

/// Keys and values of all layers, heads and streams.
pub(super) struct KvCache {
    kind: KvKind,
    unit: Unit,
    streams: usize,
    /// Numbers of a layer.
    layer: usize,
    numbers: Floats,
}

impl KvCache {
    pub fn new(kind: KvKind, layers: usize, heads: usize, streams: usize, unit: Unit) -> KvCache {
        let layer = heads * streams * unit.len();
        let numbers = layers * layer;
        // a panel has an even number of columns, so units of half floats are whole floats too
        let floats = if kind == KvKind::F16 { numbers / 2 } else { numbers };
        KvCache { kind, unit, streams, layer, numbers: Floats::new(floats) }
    }

    pub fn kind(&self) -> KvKind {
        self.kind
    }

    pub fn unit(&self) -> Unit {
        self.unit
    }

    /// The keys and values of a stream, unit after unit.
    pub fn save(&self, stream: usize) -> Vec<f32> {
        assert!(stream < self.streams, "stream {stream} of {}", self.streams);
        let units = self.numbers.chunks_exact(self.unit_floats());
        units.skip(stream).step_by(self.streams).flatten().copied().collect()
    }

    /// Gives a stream the keys and values that [`KvCache::save`] returned.
    pub fn restore(&mut self, stream: usize, saved: &[f32]) {
        assert!(stream < self.streams, "stream {stream} of {}", self.streams);
        let floats = self.unit_floats();
        let units = self.numbers.chunks_exact_mut(floats).skip(stream).step_by(self.streams);
        units.zip(saved.chunks_exact(floats)).for_each(|(unit, saved)| unit.copy_from_slice(saved));
    }

    /// Whole floats that a unit takes.
    fn unit_floats(&self) -> usize {
        match self.kind {
            KvKind::F32 => self.unit.len(),
            KvKind::F16 => self.unit.len() / 2,
        }
    }

    /// [head][stream] of a layer.
    pub fn layer<E: Stored>(&mut self, layer: usize) -> &mut [E] {
        let all: &mut [E] = bytemuck::cast_slice_mut(&mut self.numbers);
        &mut all[layer * self.layer..][..self.layer]
    }
}
