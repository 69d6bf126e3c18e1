//! Features of some windows: made here, or those of a part of an index.

use super::promise::{BESIDE, Extent};
use super::quantize::{Ranges, Scales, Size, widths};
use super::record::{ClipEntry, FileChecksum, PartRecord};
use crate::{Error, Result};
pub use kinelm_corpus::array_file::ArrayFile;
use kinelm_engine::arena::Floats;
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;

/// (N, D) features, f32.
pub const FEATURES: &str = "features.f32";
/// (N, [`widths`]) features over their lengths on the part's scales, signed bytes: the numbers that vary most, and the rest.
pub const BYTES: [&str; 2] = ["heads.i8", "rests.i8"];
/// (D, 2) centre and step of each coefficient, f32: [`Scales`].
pub const SCALES: &str = "scales.f32";
/// (D) the coefficient at each place of a row of bytes, u32.
pub const ORDER: &str = "order.u32";
/// (N, 5) f64: [`Size`].
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
    bytes: [Numbers<i8>; 2],
    /// Bytes of a head, and of a rest.
    pub widths: [usize; 2],
    /// Of the bytes.
    pub scales: Scales,
    /// (N).
    pub sizes: Vec<Size>,
    /// (N) [`Size::beside`].
    pub beside: Vec<[f32; BESIDE]>,
    /// Of every [`BLOCK`] windows.
    pub extents: Vec<Extent>,
}

/// Windows that a search reads at a time.
pub const BLOCK: usize = 256;
/// Windows whose ranges a thread finds at a time.
const ROWS: usize = 1024;

impl Part {
    /// Features (N, D) in memory, with bytes as a part on disk has them.
    ///
    /// # Panics
    /// When they are no whole features of `numbers`.
    pub fn held(features: Vec<f32>, numbers: usize) -> Part {
        assert!(features.len().is_multiple_of(numbers.max(1)), "features of {numbers}");
        let mut sizes: Vec<Size> = features.par_chunks_exact(numbers.max(1)).map(Size::of).collect();
        let widths = widths(numbers);
        let mut bytes = widths.map(|width| Floats::new(sizes.len() * width / size_of::<f32>()));
        let of = |(features, sizes): (&[f32], &[Size])| {
            // least and greatest don't depend on the order, so threads may take any blocks
            let mut ranges = Ranges::new(numbers);
            features.chunks_exact(numbers).zip(sizes).for_each(|(feature, size)| ranges.add(feature, size.norm));
            ranges
        };
        let blocks = features.par_chunks(ROWS * numbers.max(1)).zip(sizes.par_chunks(ROWS)).map(of);
        let scales = blocks.reduce(|| Ranges::new(numbers), Ranges::merge).scales();
        let [heads, rests] = &mut bytes;
        let [head, rest] = widths;
        let rows = bytemuck::cast_slice_mut(heads)
            .par_chunks_mut(head)
            .zip(bytemuck::cast_slice_mut(rests).par_chunks_mut(rest));
        let all = rows.zip(features.par_chunks(numbers.max(1))).zip(&mut sizes);
        all.for_each(|(((head, rest), feature), size)| *size = scales.quantize(feature, size.norm, [head, rest]));
        Part::new(Numbers::Held(features), bytes.map(Numbers::Paged), widths, scales, sizes)
    }

    fn new(
        features: Numbers<f32>,
        bytes: [Numbers<i8>; 2],
        widths: [usize; 2],
        scales: Scales,
        sizes: Vec<Size>,
    ) -> Part {
        let beside = sizes.par_iter().map(Size::beside).collect();
        let extents = sizes.par_chunks(BLOCK).map(Extent::of).collect();
        Part { features, bytes, widths, scales, sizes, beside, extents }
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

    /// The bytes of the heads (0) or the rests (1) of some rows.
    ///
    /// # Errors
    /// As [`Part::features`].
    ///
    /// # Panics
    /// When the range leaves them.
    pub fn bytes(&self, half: usize, rows: Range<usize>) -> Result<Cow<'_, [i8]>> {
        let width = self.widths[half];
        self.bytes[half].get(rows.start * width..rows.end * width)
    }

    /// Opens the files of a part after checking them.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] for files that are not as they were written.
    pub fn open(folder: &Path, record: &PartRecord, numbers: usize) -> Result<(Part, Vec<ClipEntry>)> {
        let windows = record.windows;
        let features = stored(&folder.join(FEATURES), &record.features, windows * numbers)?;
        let widths = widths(numbers);
        let half =
            |i: usize| stored(&folder.join(BYTES[i]), &record.bytes[i], windows * widths[i]).map(Numbers::Stored);
        let bytes = [half(0)?, half(1)?];
        let scales: ArrayFile<[f32; 2]> = stored(&folder.join(SCALES), &record.scales, numbers)?;
        let order: ArrayFile<u32> = stored(&folder.join(ORDER), &record.order, numbers)?;
        let (scales, order) = (scales.read(0..numbers)?.into_owned(), order.read(0..numbers)?.into_owned());
        // a place outside the feature would be read there
        if let Some(far) = order.iter().find(|i| **i as usize >= numbers) {
            let help = "put back the files of this index";
            return Err(Error::file(
                folder.join(ORDER),
                format!("coefficient {far}"),
                format!("below {numbers}"),
                help,
            ));
        }
        let scales = Scales { scales, order };
        let sizes: ArrayFile<Size> = stored(&folder.join(SIZES), &record.sizes, windows)?;
        let sizes = sizes.read(0..windows)?.into_owned();
        let clips = ClipEntry::load(&folder.join(CLIPS), &record.clips)?;
        let windows: usize = clips.iter().map(|c| c.starts.len()).sum();
        if windows != record.windows {
            let (found, expected) = (format!("{windows} windows"), format!("{}", record.windows));
            return Err(Error::file(folder.join(CLIPS), found, expected, "put back the files of this index"));
        }
        Ok((Part::new(Numbers::Stored(features), bytes, widths, scales, sizes), clips))
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
