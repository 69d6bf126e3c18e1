//! Features of some windows: made here, or those of a part of an index.

use super::record::{ClipEntry, FileChecksum, PartRecord};
use crate::{Error, Result};
pub use kinelm_corpus::array_file::ArrayFile;
use kinelm_engine::op::dots;
use kinelm_store::FileRecord;
use kinelm_store::files::PendingFolder;
use rayon::prelude::*;
use std::borrow::Cow;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// (N, D) features, f32.
pub const FEATURES: &str = "features.f32";
/// (N, D padded) features over their lengths times [`SCALE`], half floats.
pub const HALVES: &str = "halves.f16";
/// (N, 2) length of a feature, and how far its half floats are off, f64.
pub const SIZES: &str = "sizes.f64";
/// A [`ClipEntry`] a line.
pub const CLIPS: &str = "clips.jsonl";

/// What unit vectors are multiplied with before they are rounded, so that few of their numbers are too small for half floats.
pub const SCALE: f32 = 32768.0;

/// Length of a feature, and the length of what its half floats leave out of the feature over its length.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Size {
    /// Length.
    pub norm: f64,
    /// At most so far off.
    pub error: f64,
}

impl Size {
    /// Of a feature without half floats.
    pub fn of(feature: &[f32]) -> Size {
        Size { norm: dot(feature, feature).sqrt(), error: 0.0 }
    }
}

/// Numbers that were made here, or those of a file.
enum Numbers<T> {
    Held(Vec<T>),
    Stored(ArrayFile<T>),
}

impl<T: bytemuck::Pod + Send + Sync> Numbers<T> {
    fn len(&self) -> usize {
        match self {
            Numbers::Held(numbers) => numbers.len(),
            Numbers::Stored(stored) => stored.len(),
        }
    }

    fn get(&self, range: Range<usize>) -> Result<Cow<'_, [T]>> {
        match self {
            Numbers::Held(numbers) => Ok(Cow::Borrowed(&numbers[range])),
            Numbers::Stored(stored) => Ok(stored.read(range)?),
        }
    }
}

/// N windows of D numbers.
pub struct Part {
    features: Numbers<f32>,
    halves: Numbers<u16>,
    /// (N).
    pub sizes: Vec<Size>,
}

impl Part {
    /// Features (N, D) in memory, without half floats.
    ///
    /// # Panics
    /// When they are no whole features of `numbers`.
    pub fn held(features: Vec<f32>, numbers: usize) -> Part {
        assert!(features.len().is_multiple_of(numbers.max(1)), "features of {numbers}");
        let sizes = features.chunks_exact(numbers.max(1)).map(Size::of).collect();
        Part { features: Numbers::Held(features), halves: Numbers::Held(Vec::new()), sizes }
    }

    /// The same with half floats, as a part on disk has them.
    ///
    /// # Errors
    /// Features of a file that can't be read any more.
    pub fn with_halves(mut self, numbers: usize) -> Result<Part> {
        let padded = numbers.next_multiple_of(dots::PAD);
        let mut halves = vec![0; self.sizes.len() * padded];
        let features = self.features.get(0..self.features.len())?;
        let all = halves.par_chunks_mut(padded).zip(features.par_chunks(numbers)).zip(&mut self.sizes);
        all.for_each_init(
            || vec![0.0; numbers],
            |unit, ((row, feature), size)| size.error = round(feature, size.norm, unit, row),
        );
        drop(features);
        self.halves = Numbers::Held(halves);
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

    /// Some of the half floats (N, D padded), counted in numbers.
    ///
    /// # Errors
    /// As [`Part::features`].
    ///
    /// # Panics
    /// When the range leaves them, or there are none.
    pub fn halves(&self, range: Range<usize>) -> Result<Cow<'_, [u16]>> {
        self.halves.get(range)
    }

    /// Opens the files of a part after checking them.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] for files that are not as they were written.
    pub fn open(folder: &Path, record: &PartRecord, numbers: usize) -> Result<(Part, Vec<ClipEntry>)> {
        let windows = record.windows;
        let features = stored(&folder.join(FEATURES), &record.features, windows * numbers)?;
        let halves = stored(&folder.join(HALVES), &record.halves, windows * numbers.next_multiple_of(dots::PAD))?;
        let sizes: ArrayFile<[f64; 2]> = stored(&folder.join(SIZES), &record.sizes, windows)?;
        let sizes = sizes.read(0..windows)?.iter().map(|&[norm, error]| Size { norm, error }).collect();
        let clips = ClipEntry::load(&folder.join(CLIPS), &record.clips)?;
        let windows: usize = clips.iter().map(|c| c.starts.len()).sum();
        if windows != record.windows {
            let (found, expected) = (format!("{windows} windows"), format!("{}", record.windows));
            return Err(Error::file(folder.join(CLIPS), found, expected, "put back the files of this index"));
        }
        Ok((Part { features: Numbers::Stored(features), halves: Numbers::Stored(halves), sizes }, clips))
    }
}

/// A file of so many numbers.
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

/// Writes a part; dropped before it is finished, it leaves nothing.
pub struct PartWriter {
    name: String,
    folder: PendingFolder,
    numbers: usize,
    features: Stream,
    halves: Stream,
    sizes: Stream,
    clips: Vec<u8>,
    windows: usize,
    /// One feature over its length, and as half floats.
    unit: Vec<f32>,
    row: Vec<u16>,
}

impl PartWriter {
    /// An empty part that will be the folder `place`, of features of D = `numbers`.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`].
    pub fn create(place: &Path, numbers: usize) -> Result<PartWriter> {
        let folder = PendingFolder::create(place)?;
        let stream = |name: &str| Stream::create(folder.path().join(name));
        Ok(PartWriter {
            numbers,
            features: stream(FEATURES)?,
            halves: stream(HALVES)?,
            sizes: stream(SIZES)?,
            name: place.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
            folder,
            clips: Vec::new(),
            windows: 0,
            unit: vec![0.0; numbers],
            row: vec![0; numbers.next_multiple_of(dots::PAD)],
        })
    }

    /// Adds a clip and the features (N, D) of its windows.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::Invalid`] for features that are not finite.
    ///
    /// # Panics
    /// When there is not a feature for each window of the clip.
    pub fn push(&mut self, clip: &ClipEntry, features: &[f32]) -> Result<()> {
        assert_eq!(features.len(), clip.starts.len() * self.numbers, "a feature a window");
        for feature in features.chunks_exact(self.numbers) {
            let norm = Size::of(feature).norm;
            if !norm.is_finite() {
                return Err(Error::unsupported(clip.name.clone(), "a window's feature is not finite"));
            }
            let error = round(feature, norm, &mut self.unit, &mut self.row);
            self.features.write(bytemuck::cast_slice(feature))?;
            self.halves.write(bytemuck::cast_slice(&self.row))?;
            self.sizes.write(bytemuck::cast_slice(&[norm, error]))?;
        }
        self.windows += clip.starts.len();
        serde_json::to_writer(&mut self.clips, clip).map_err(|e| {
            Error::unsupported(
                clip.path.display().to_string(),
                format!("{e}, which an index can't name; rename the file"),
            )
        })?;
        self.clips.push(b'\n');
        Ok(())
    }

    /// Windows so far.
    pub fn windows(&self) -> usize {
        self.windows
    }

    /// Syncs the part and gives it its name.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`].
    pub fn finish(mut self) -> Result<PartRecord> {
        self.folder.write(CLIPS, &self.clips)?;
        let record = PartRecord {
            name: self.name,
            windows: self.windows,
            features: self.features.finish()?,
            halves: self.halves.finish()?,
            sizes: self.sizes.finish()?,
            clips: FileRecord::of(&self.clips),
        };
        self.folder.commit("build again to add to the index")?;
        Ok(record)
    }
}

/// `row` becomes the half floats of a feature over its length; how far they are off, as a length, rounded up.
fn round(feature: &[f32], norm: f64, unit: &mut [f32], row: &mut [u16]) -> f64 {
    let over = if norm > 0.0 { 1.0 / norm } else { 0.0 };
    let scale = f64::from(SCALE);
    unit.iter_mut().zip(feature).for_each(|(u, x)| *u = (f64::from(*x) * over * scale) as f32);
    dots::round(row, unit);
    let off = |(half, x): (f32, &f32)| (f64::from(half) / scale - f64::from(*x) * over).powi(2);
    let sum: f64 = dots::widen(row).zip(feature).map(off).sum();
    sum.sqrt() * (1.0 + 1e-9) + 1e-15
}

/// Dot product in f64, always in the same order.
pub fn dot(a: &[f32], b: &[f32]) -> f64 {
    sum_of(a, b, |a, b| a * b)
}

/// The square of the distance, always in the same order.
pub fn squared_distance(a: &[f32], b: &[f32]) -> f64 {
    sum_of(a, b, |a, b| (a - b) * (a - b))
}

fn sum_of(a: &[f32], b: &[f32], term: impl Fn(f64, f64) -> f64) -> f64 {
    // eight sums side by side: one alone waits for each of its additions
    let (a8, a_rest) = a.as_chunks::<8>();
    let (b8, b_rest) = b.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for (a, b) in a8.iter().zip(b8) {
        for (s, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *s += term(f64::from(*a), f64::from(*b));
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| term(f64::from(*a), f64::from(*b))).sum();
    sums.iter().sum::<f64>() + rest
}

/// A file that is written from front to back, with the checksum of what was written.
struct Stream {
    path: PathBuf,
    file: BufWriter<File>,
    crc32c: u32,
    bytes: u64,
}

impl Stream {
    fn create(path: PathBuf) -> Result<Stream> {
        let file = BufWriter::with_capacity(1 << 20, File::create(&path).map_err(Error::io(&path))?);
        Ok(Stream { path, file, crc32c: 0, bytes: 0 })
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.crc32c = crc32c::crc32c_append(self.crc32c, bytes);
        self.bytes += bytes.len() as u64;
        self.file.write_all(bytes).map_err(Error::io(&self.path))
    }

    fn finish(&mut self) -> Result<FileChecksum> {
        let written = self.file.flush().and_then(|()| self.file.get_ref().sync_all());
        written.map_err(Error::io(&self.path))?;
        Ok(FileChecksum { bytes: self.bytes, crc32c: self.crc32c })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::tests::noise;

    #[test]
    fn half_floats_are_as_near_as_is_said() {
        let mut row = vec![0; 1152];
        for size in [1e-12, 1.0, 1e12] {
            let feature: Vec<f32> = noise(3, 1152).iter().map(|&x| (x * size) as f32).collect();
            let norm = Size::of(&feature).norm;
            let error = round(&feature, norm, &mut vec![0.0; 1152], &mut row);
            // half of the last of eleven bits, at most
            assert!(error > 1e-5 && error < 0.5f64.powi(11), "{error:e}");
        }
        assert_eq!(Size::of(&[0.0; 5]).norm, 0.0);
        let mut row = vec![7; 32];
        assert!(round(&[0.0; 5], 0.0, &mut [0.0; 5], &mut row) < 1e-14 && row.iter().all(|&x| x == 0));
    }

    #[test]
    fn sums_are_those_of_the_definition() {
        let numbers = |seed| noise(seed, 67).iter().map(|&x| x as f32).collect::<Vec<f32>>();
        let (a, b) = (numbers(1), numbers(2));
        for n in [0, 1, 7, 8, 67] {
            let pairs = || a[..n].iter().zip(&b[..n]).map(|(&a, &b)| (f64::from(a), f64::from(b)));
            let expected: f64 = pairs().map(|(a, b)| a * b).sum();
            assert!((dot(&a[..n], &b[..n]) - expected).abs() < 1e-13);
            let expected: f64 = pairs().map(|(a, b)| (a - b).powi(2)).sum();
            assert!((squared_distance(&a[..n], &b[..n]) - expected).abs() < 1e-13);
        }
    }
}
