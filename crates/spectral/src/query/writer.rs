//! Writes the files of a part, as a stream: memory doesn't grow with the number of windows.

use super::part::{BYTES, CLIPS, FEATURES, ORDER, SCALES, SIZES};
use super::quantize::{Ranges, Size, widths};
use super::record::{ClipEntry, FileChecksum, PartRecord};
use crate::{Error, Result};
use kinelm_store::FileRecord;
use kinelm_store::files::PendingFolder;
use rayon::prelude::*;
use std::fs::File;
use std::io::{BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// Bytes of features that are read back at a time.
const BLOCK: usize = 4 << 20;

/// Writes a part; dropped before it is finished, it leaves nothing.
pub struct PartWriter {
    name: String,
    folder: PendingFolder,
    numbers: usize,
    features: Stream,
    ranges: Ranges,
    clips: Vec<u8>,
    windows: usize,
}

impl PartWriter {
    /// An empty part that will be the folder `place`, of features of D = `numbers`.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`].
    pub fn create(place: &Path, numbers: usize) -> Result<PartWriter> {
        let folder = PendingFolder::create(place)?;
        Ok(PartWriter {
            numbers,
            features: Stream::create(folder.path().join(FEATURES))?,
            ranges: Ranges::new(numbers),
            name: place.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
            folder,
            clips: Vec::new(),
            windows: 0,
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
            // the ranges, and with them every byte of the part, need finite numbers
            if !norm.is_finite() {
                return Err(Error::unsupported(clip.name.clone(), "a window's feature is not finite"));
            }
            self.ranges.add(feature, norm);
        }
        self.features.write(bytemuck::cast_slice(features))?;
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

    /// Rounds the features to bytes, now that their scales are known, syncs the part and gives it its name.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`].
    pub fn finish(mut self) -> Result<PartRecord> {
        self.folder.write(CLIPS, &self.clips)?;
        let scales = self.ranges.scales();
        let features = self.features.finish()?;
        let stream = |name: &str| Stream::create(self.folder.path().join(name));
        let [mut heads, mut rests] = [stream(BYTES[0])?, stream(BYTES[1])?];
        let [mut sizes, mut scale, mut order] = [stream(SIZES)?, stream(SCALES)?, stream(ORDER)?];
        scale.write(bytemuck::cast_slice(&scales.scales))?;
        order.write(bytemuck::cast_slice(&scales.order))?;
        // read back: the scales are only known once all features have been seen
        let path = self.folder.path().join(FEATURES);
        let mut file = File::open(&path).map_err(Error::io(&path))?;
        let [head, rest] = widths(self.numbers);
        let rows = (BLOCK / size_of::<f32>() / self.numbers.max(1)).clamp(1, self.windows.max(1));
        let mut block = vec![0.0f32; rows * self.numbers];
        let (mut quantized, mut stated) =
            ([head, rest].map(|width| vec![0i8; rows * width]), vec![Size::default(); rows]);
        for first in (0..self.windows).step_by(rows) {
            let rows = rows.min(self.windows - first);
            let block = &mut block[..rows * self.numbers];
            file.read_exact(bytemuck::cast_slice_mut(block)).map_err(Error::io(&path))?;
            let [all_heads, all_rests] = &mut quantized;
            let (all_heads, all_rests) = (&mut all_heads[..rows * head], &mut all_rests[..rows * rest]);
            let stated = &mut stated[..rows];
            let halves = all_heads.par_chunks_mut(head).zip(all_rests.par_chunks_mut(rest));
            let all = halves.zip(block.par_chunks(self.numbers)).zip(&mut *stated);
            all.for_each(|(((head, rest), feature), size)| {
                *size = scales.quantize(feature, Size::of(feature).norm, [head, rest]);
            });
            heads.write(bytemuck::cast_slice(all_heads))?;
            rests.write(bytemuck::cast_slice(all_rests))?;
            sizes.write(bytemuck::cast_slice(stated))?;
        }
        let record = PartRecord {
            name: self.name,
            windows: self.windows,
            features,
            bytes: [heads.finish()?, rests.finish()?],
            order: order.finish()?,
            scales: scale.finish()?,
            sizes: sizes.finish()?,
            clips: FileRecord::of(&self.clips),
        };
        self.folder.commit("build again to add to the index")?;
        Ok(record)
    }
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
