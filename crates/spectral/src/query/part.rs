//! Features of some windows: made here, or those of a part of an index.

use super::quantize::{Ranges, Scales, Size};
use super::record::{ClipEntry, FileChecksum, PartRecord};
use crate::{Error, Result};
pub use kinelm_corpus::array_file::ArrayFile;
use kinelm_engine::arena::Floats;
use kinelm_engine::op::dots;
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;

/// (N, D) features, f32.
pub const FEATURES: &str = "features.f32";
/// (N, D padded) features over their lengths on the part's scales, signed bytes.
pub const BYTES: &str = "bytes.i8";
/// (D, 2) centre and step of each coefficient, f32: [`Scales`].
pub const SCALES: &str = "scales.f32";
/// (N, 4) f64: [`Size`].
pub const SIZES: &str = "sizes.f64";
/// A [`ClipEntry`] a line.
pub const CLIPS: &str = "clips.jsonl";

/// Numbers that were made here, or those of a file.
enum Numbers<T> {
    Held(Vec<T>),
    /// In large pages.
    Paged(Floats),
    Stored(ArrayFile<T>),
}

impl<T: bytemuck::Pod + Send + Sync> Numbers<T> {
    fn len(&self) -> usize {
        match self {
            Numbers::Held(numbers) => numbers.len(),
            Numbers::Paged(numbers) => size_of_val(&**numbers) / size_of::<T>(),
            Numbers::Stored(stored) => stored.len(),
        }
    }

    fn get(&self, range: Range<usize>) -> Result<Cow<'_, [T]>> {
        match self {
            Numbers::Held(numbers) => Ok(Cow::Borrowed(&numbers[range])),
            Numbers::Paged(numbers) => Ok(Cow::Borrowed(&bytemuck::cast_slice(numbers)[range])),
            Numbers::Stored(stored) => Ok(stored.read(range)?),
        }
    }
}

/// N windows of D numbers.
pub struct Part {
    features: Numbers<f32>,
    bytes: Numbers<i8>,
    /// Of the bytes.
    pub scales: Scales,
    /// (N).
    pub sizes: Vec<Size>,
}

/// Windows whose ranges a thread finds at a time.
const ROWS: usize = 1024;

impl Part {
    /// Features (N, D) in memory, without bytes.
    ///
    /// # Panics
    /// When they are no whole features of `numbers`.
    pub fn held(features: Vec<f32>, numbers: usize) -> Part {
        assert!(features.len().is_multiple_of(numbers.max(1)), "features of {numbers}");
        let sizes = features.par_chunks_exact(numbers.max(1)).map(Size::of).collect();
        let scales = Scales(Vec::new());
        Part { features: Numbers::Held(features), bytes: Numbers::Held(Vec::new()), scales, sizes }
    }

    /// The same with bytes, as a part on disk has them.
    ///
    /// # Errors
    /// Features of a file that can't be read any more.
    pub fn with_bytes(mut self, numbers: usize) -> Result<Part> {
        let padded = numbers.next_multiple_of(dots::PAD);
        let mut bytes = Floats::new(self.sizes.len() * padded / size_of::<f32>());
        let features = self.features.get(0..self.features.len())?;
        let of = |(features, sizes): (&[f32], &[Size])| {
            // least and greatest don't depend on the order, so threads may take any blocks
            let mut ranges = Ranges::new(numbers);
            features.chunks_exact(numbers).zip(sizes).for_each(|(feature, size)| ranges.add(feature, size.norm));
            ranges
        };
        let blocks = features.par_chunks(ROWS * numbers).zip(self.sizes.par_chunks(ROWS)).map(of);
        let scales = blocks.reduce(|| Ranges::new(numbers), Ranges::merge).scales();
        let rows = bytemuck::cast_slice_mut(&mut bytes).par_chunks_mut(padded);
        let all = rows.zip(features.par_chunks(numbers)).zip(&mut self.sizes);
        all.for_each(|((row, feature), size)| *size = scales.quantize(feature, size.norm, row));
        // a borrow of the part, whose fields are set below
        drop(features);
        (self.bytes, self.scales) = (Numbers::Paged(bytes), scales);
        Ok(self)
    }

    /// Numbers of all features, N D.
    pub fn numbers(&self) -> usize {
        self.features.len()
    }

    /// Some of the features (N, D), counted in numbers.
    ///
    /// # Errors
    /// A file that was cut while it was in use.
    ///
    /// # Panics
    /// When the range leaves them.
    pub fn features(&self, range: Range<usize>) -> Result<Cow<'_, [f32]>> {
        self.features.get(range)
    }

    /// Some of the bytes (N, D padded).
    ///
    /// # Errors
    /// As [`Part::features`].
    ///
    /// # Panics
    /// When the range leaves them, or there are none.
    pub fn bytes(&self, range: Range<usize>) -> Result<Cow<'_, [i8]>> {
        self.bytes.get(range)
    }

    /// Opens the files of a part after checking them.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] for files that are not as they were written.
    pub fn open(folder: &Path, record: &PartRecord, numbers: usize) -> Result<(Part, Vec<ClipEntry>)> {
        let windows = record.windows;
        let features = stored(&folder.join(FEATURES), &record.features, windows * numbers)?;
        let bytes = stored(&folder.join(BYTES), &record.bytes, windows * numbers.next_multiple_of(dots::PAD))?;
        let scales: ArrayFile<[f32; 2]> = stored(&folder.join(SCALES), &record.scales, numbers)?;
        let scales = Scales(scales.read(0..numbers)?.into_owned());
        let sizes: ArrayFile<Size> = stored(&folder.join(SIZES), &record.sizes, windows)?;
        let sizes = sizes.read(0..windows)?.into_owned();
        let clips = ClipEntry::load(&folder.join(CLIPS), &record.clips)?;
        let windows: usize = clips.iter().map(|c| c.starts.len()).sum();
        if windows != record.windows {
            let (found, expected) = (format!("{windows} windows"), format!("{}", record.windows));
            return Err(Error::file(folder.join(CLIPS), found, expected, "put back the files of this index"));
        }
        Ok((Part { features: Numbers::Stored(features), bytes: Numbers::Stored(bytes), scales, sizes }, clips))
    }
}

/// A file of `numbers` numbers.
fn stored<T: bytemuck::Pod + Send + Sync>(
    path: &Path,
    checksum: &FileChecksum,
    numbers: usize,
) -> Result<ArrayFile<T>> {
    let expected = (numbers * size_of::<T>()) as u64;
    if checksum.bytes != expected {
        let help = "put back the index.json of this index";
        let found = format!("{} bytes by index.json", checksum.bytes);
        return Err(Error::file(path, found, format!("{expected} bytes"), help));
    }
    checksum.open(path)
}
