//! The keys and values of the tokens read so far, in one allocation.
//!
//! [layer][head][stream], each unit the keys, then the values, then the scales of both where they are bytes, (2, T). Keys
//! are stored in panels of tokens, [T / panel][d][panel], and values in panels of their numbers, [d / panel][T][panel]:
//! both are right factors of the products of attention.

use super::bytes;
use crate::arena::Floats;
use crate::element::Element;
use crate::op::matmul::panel;
use half::f16;
use half::slice::{HalfBitsSliceExt, HalfFloatSliceExt};
use pulp::{Simd, WithSimd};
use std::ops::Range;

/// The format of keys and values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum KvKind {
    /// As they are.
    #[default]
    F32,
    /// As half floats: half the memory, and half of it to read for every token.
    F16,
    /// As signed bytes with a scale for each key and value: a quarter.
    Int8,
}

/// Consecutive rows of one stream.
#[derive(Debug, Clone, Copy)]
pub struct Run {
    /// The stream.
    pub stream: usize,
    /// Place of the first row in its stream; keys and values from there on are overwritten.
    pub place: usize,
    /// How many rows.
    pub rows: usize,
}

/// A number as the cache stores it.
pub(super) trait Stored: Element {
    /// Numbers of this kind that the two scales of a token take.
    const SCALES: usize = 0;

    /// What [`Stored::store`] needs to know of all numbers of a key or a value.
    #[inline(always)]
    fn size<S: Simd>(_: S, _: &[f32]) -> f32 {
        1.0
    }

    /// `from` rounded to this, at most [`CHUNK`] numbers of a key or value of this [`Stored::size`]; returns their scale.
    fn store<S: Simd>(simd: S, to: &mut [Self], from: &[f32], size: f32) -> f32;
}

/// Numbers that are rounded at a time.
const CHUNK: usize = 32;

impl Stored for f32 {
    #[inline(always)]
    fn store<S: Simd>(_: S, to: &mut [f32], from: &[f32], _: f32) -> f32 {
        to.copy_from_slice(from);
        1.0
    }
}

impl Stored for u16 {
    #[inline(always)]
    fn store<S: Simd>(_: S, to: &mut [u16], from: &[f32], _: f32) -> f32 {
        // beyond 65,504 this is infinity, which widens to 65,536 (`element`): no score becomes NaN by it
        to.reinterpret_cast_mut::<f16>().convert_from_f32_slice(from);
        1.0
    }
}

impl Stored for i8 {
    const SCALES: usize = 2 * size_of::<f32>();

    #[inline(always)]
    fn size<S: Simd>(simd: S, numbers: &[f32]) -> f32 {
        bytes::size_of(simd, numbers)
    }

    #[inline(always)]
    fn store<S: Simd>(simd: S, to: &mut [i8], from: &[f32], size: f32) -> f32 {
        bytes::round(simd, to, from, size)
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
        // whole floats of bytes too
        let tokens = context.next_multiple_of(panel.max(size_of::<f32>()));
        Unit { tokens, d, padded: d.next_multiple_of(panel), panel }
    }

    /// Numbers of a unit.
    fn len<E: Stored>(&self) -> usize {
        self.tokens * (self.d + self.padded + E::SCALES)
    }

    /// Whole floats that it takes.
    fn floats(&self, kind: KvKind) -> usize {
        let bytes = match kind {
            KvKind::F32 => self.len::<f32>() * size_of::<f32>(),
            KvKind::F16 => self.len::<u16>() * size_of::<u16>(),
            KvKind::Int8 => self.len::<i8>(),
        };
        bytes / size_of::<f32>()
    }

    /// Where the unit of a stream lies among those of a head.
    pub fn of<E: Stored>(&self, stream: usize) -> Range<usize> {
        let len = self.len::<E>();
        stream * len..(stream + 1) * len
    }

    /// Its keys, its values, and the scales of both (T), empty where they have none.
    pub fn split<'a, E: Stored>(&self, unit: &'a [E]) -> (&'a [E], &'a [E], [&'a [f32]; 2]) {
        let (keys, rest) = unit.split_at(self.tokens * self.d);
        let (values, scales) = rest.split_at(self.tokens * self.padded);
        let scales: &[f32] = bytemuck::cast_slice(scales);
        let (of_keys, of_values) = scales.split_at(scales.len() / 2);
        (keys, values, [of_keys, of_values])
    }
}

/// Stores key and value (d) of the token at `place` of a unit.
pub(super) struct Store<'a, E> {
    pub cache: &'a mut [E],
    pub unit: Unit,
    pub place: usize,
    pub key: &'a [f32],
    pub value: &'a [f32],
}

impl<E: Stored> WithSimd for Store<'_, E> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Store { cache, unit: Unit { tokens, d, padded, panel }, place, key, value } = self;
        let (keys, rest) = cache.split_at_mut(tokens * d);
        let (values, scales) = rest.split_at_mut(tokens * padded);
        let (key_size, value_size) = (E::size(simd, key), E::size(simd, value));
        let (mut key_scale, mut value_scale) = (1.0, 1.0);
        let mut rounded = [E::zeroed(); CHUNK];
        let base = place / panel * d * panel + place % panel;
        for (c, key) in key.chunks(CHUNK).enumerate() {
            let rounded = &mut rounded[..key.len()];
            key_scale = E::store(simd, rounded, key, key_size);
            for (i, x) in rounded.iter().enumerate() {
                // a token is a column of its panel: one write here, so that reading streams
                keys[base + (c * CHUNK + i) * panel] = *x;
            }
        }
        for (p, value) in value.chunks(panel).enumerate() {
            let to = &mut values[(p * tokens + place) * panel..][..value.len()];
            value_scale = E::store(simd, to, value, value_size);
        }
        let scales: &mut [f32] = bytemuck::cast_slice_mut(scales);
        if !scales.is_empty() {
            scales[place] = key_scale;
            scales[tokens + place] = value_scale;
        }
    }
}

/// Keys and values of all layers, heads and streams.
pub(super) struct KvCache {
    kind: KvKind,
    unit: Unit,
    streams: usize,
    /// Units of a layer.
    units: usize,
    numbers: Floats,
}

impl KvCache {
    pub fn new(kind: KvKind, layers: usize, heads: usize, streams: usize, unit: Unit) -> KvCache {
        let units = heads * streams;
        KvCache { kind, unit, streams, units, numbers: Floats::new(layers * units * unit.floats(kind)) }
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
        let units = self.numbers.chunks_exact(self.unit.floats(self.kind));
        units.skip(stream).step_by(self.streams).flatten().copied().collect()
    }

    /// Gives a stream the keys and values that [`KvCache::save`] returned.
    pub fn restore(&mut self, stream: usize, saved: &[f32]) {
        assert!(stream < self.streams, "stream {stream} of {}", self.streams);
        let floats = self.unit.floats(self.kind);
        let units = self.numbers.chunks_exact_mut(floats).skip(stream).step_by(self.streams);
        units.zip(saved.chunks_exact(floats)).for_each(|(unit, saved)| unit.copy_from_slice(saved));
    }

    /// [head][stream] of a layer.
    pub fn layer<E: Stored>(&mut self, layer: usize) -> &mut [E] {
        let floats = self.units * self.unit.floats(self.kind);
        bytemuck::cast_slice_mut(&mut self.numbers[layer * floats..][..floats])
    }
}
