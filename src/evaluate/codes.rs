//! The codes of clips, without spaces: what the static floors are measured on.

use crate::corpus::{Corpus, Split};
use crate::{Error, Result};
use kinelm_tokenizer::WordLength;
use npyz::NpyFile;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use zip::ZipArchive;

/// Clips of codes, frame after frame: a clip is (F, C), the channel running fastest.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CodeClips {
    /// One (F * C) each.
    pub clips: Vec<Vec<u16>>,
}

/// What the floors are fitted and measured on.
#[derive(Debug, Clone, PartialEq)]
pub struct CodeSplits {
    /// Codes are below this; at most 65,536.
    pub bins: usize,
    /// C.
    pub channels: usize,
    /// Tables and weights are fitted on it.
    pub train: CodeClips,
    /// Bits are measured on it.
    pub test: CodeClips,
}

impl CodeSplits {
    /// Reads what `order0.py --dump` writes: `train` and `test` (F, C) uint16, `train_len` and `test_len`, the frames of
    /// each clip.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::File`] when an array is missing, of another shape, or holds a code of `bins` or more.
    pub fn load_npz(path: &Path, bins: usize) -> Result<Self> {
        let bad =
            |found: String, expected: &str| Error::file(path, found, expected, "`order0.py --dump` writes such files");
        let file = kinelm_motion::format::input::open(path).map_err(Error::io(path))?;
        let mut archive = ZipArchive::new(BufReader::new(file)).map_err(|e| bad(e.to_string(), "an npz archive"))?;
        let (train, channels) = read_split(&mut archive, "train", bins).map_err(|(f, e)| bad(f, e))?;
        let (test, test_channels) = read_split(&mut archive, "test", bins).map_err(|(f, e)| bad(f, e))?;
        if test_channels != channels {
            return Err(bad(format!("{channels} channels in train, {test_channels} in test"), "as many in both"));
        }
        Ok(CodeSplits { bins, channels, train, test })
    }

    /// The codes of a corpus whose words are frames of so many characters each: without the space, and as they were before
    /// any were merged. `measured` is the split that stands for `test`.
    ///
    /// # Errors
    /// [`Error::Call`] for a corpus of other words; [`Error::File`] when an id stands where it may not.
    pub fn of_corpus(corpus: &Corpus, measured: Split) -> Result<Self> {
        let Some(channels) = channels(corpus) else {
            return Err(Error::Call(
                "words are tiles of frames, or differ in length: they have no code a channel".into(),
            ));
        };
        let bins = corpus.tokenizer().vocabulary().characters() as usize;
        let codes = |clip| Ok(corpus.clip_words(clip)?.codes().to_vec());
        let read = |split| corpus.split(split).map(codes).collect::<Result<_>>();
        let train = CodeClips { clips: read(Split::Train)? };
        Ok(CodeSplits { bins, channels, train, test: CodeClips { clips: read(measured)? } })
    }
}

/// C, where a word is a frame of C characters.
pub fn channels(corpus: &Corpus) -> Option<usize> {
    match corpus.tokenizer().word_length() {
        WordLength::Fixed(channels) if corpus.tokenizer().frames_per_word() == 1 => Some(channels),
        _ => None,
    }
}

type Fault = (String, &'static str);

/// Bytes of an array at most: codes of a week of dancing.
const MOST_BYTES: u64 = 1 << 30;

fn read_split(
    archive: &mut ZipArchive<BufReader<File>>,
    name: &'static str,
    bins: usize,
) -> std::result::Result<(CodeClips, usize), Fault> {
    const SHAPE: &str = "uint16 arrays (frames, channels) `train`, `test` and their clips' lengths `*_len`";
    let (shape, codes) = array::<u16>(archive, &format!("{name}.npy"))?;
    let &[frames, channels] = shape.as_slice() else {
        return Err((format!("{name} of shape {shape:?}"), SHAPE));
    };
    let (_, lengths) = array::<i64>(archive, &format!("{name}_len.npy"))?;
    if let Some(i) = codes.iter().position(|&c| usize::from(c) >= bins) {
        let at = (i / (channels as usize).max(1), i % (channels as usize).max(1));
        return Err((format!("{name}[{}, {}] = {}", at.0, at.1, codes[i]), "codes below the number of bins (--bins)"));
    }
    let mut rest = codes.as_slice();
    let mut clips = Vec::new();
    for &length in &lengths {
        let clip = usize::try_from(length).ok().and_then(|l| l.checked_mul(channels as usize));
        let (clip, after) =
            clip.and_then(|n| rest.split_at_checked(n)).ok_or((format!("{name}_len with {length}"), SHAPE))?;
        clips.push(clip.to_vec());
        rest = after;
    }
    if !rest.is_empty() {
        return Err((format!("{frames} frames in {name}, fewer in {name}_len"), SHAPE));
    }
    Ok((CodeClips { clips }, channels as usize))
}

fn array<T: npyz::Deserialize>(
    archive: &mut ZipArchive<BufReader<File>>,
    name: &str,
) -> std::result::Result<(Vec<u64>, Vec<T>), Fault> {
    const C_ORDER: &str = "an array that numpy wrote in C order, uint16 codes, int64 lengths";
    let fault = |e: String| (format!("{name}: {e}"), C_ORDER);
    let entry = archive.by_name(name).map_err(|e| fault(e.to_string()))?;
    let file = NpyFile::new(BufReader::new(entry)).map_err(|e| fault(e.to_string()))?;
    if file.order() != npyz::Order::C {
        return Err(fault("Fortran order".into()));
    }
    let shape = file.shape().to_vec();
    let bytes = shape.iter().try_fold(size_of::<T>() as u64, |all, &n| all.checked_mul(n));
    if bytes.is_none_or(|bytes| bytes > MOST_BYTES) {
        return Err((format!("{name} of shape {shape:?}"), "arrays of 1 GiB at most"));
    }
    Ok((shape, file.into_vec().map_err(|e| fault(e.to_string()))?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use npyz::WriterBuilder;
    use std::io::Write;

    /// An npz as numpy writes it: the arrays as named, u16 or i64.
    fn npz(path: &Path, arrays: &[(&str, &[u64], Array)]) {
        let mut zip = zip::ZipWriter::new(File::create(path).unwrap());
        for (name, shape, array) in arrays {
            zip.start_file(format!("{name}.npy"), zip::write::SimpleFileOptions::default()).unwrap();
            let mut bytes = Vec::new();
            match array {
                Array::Codes(codes) => write(&mut bytes, shape, codes),
                Array::Lengths(lengths) => write(&mut bytes, shape, lengths),
            }
            zip.write_all(&bytes).unwrap();
        }
        zip.finish().unwrap();
    }

    enum Array {
        Codes(Vec<u16>),
        Lengths(Vec<i64>),
    }

    fn write<T: npyz::AutoSerialize + Copy>(bytes: &mut Vec<u8>, shape: &[u64], values: &[T]) {
        let mut writer = npyz::WriteOptions::new().default_dtype().shape(shape).writer(bytes).begin_nd().unwrap();
        writer.extend(values.iter().copied()).unwrap();
        writer.finish().unwrap();
    }

    #[test]
    fn a_dump_is_read_and_its_faults_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.npz");
        let write = |test: Vec<u16>, lengths: Vec<i64>| {
            let n = lengths.len() as u64;
            npz(
                &path,
                &[
                    ("train", &[3, 2], Array::Codes(vec![0, 1, 2, 3, 4, 5])),
                    ("train_len", &[2], Array::Lengths(vec![1, 2])),
                    ("test", &[test.len() as u64 / 2, 2], Array::Codes(test)),
                    ("test_len", &[n], Array::Lengths(lengths)),
                ],
            );
        };
        let says = || CodeSplits::load_npz(&path, 6).unwrap_err().to_string();
        write(vec![5, 5], vec![1]);
        let codes = CodeSplits::load_npz(&path, 6).unwrap();
        assert_eq!(codes.train.clips, [vec![0, 1], vec![2, 3, 4, 5]]);
        assert_eq!((codes.test.clips.len(), codes.channels), (1, 2));
        write(vec![5, 6], vec![1]);
        assert!(says().contains("test[0, 1] = 6, expected codes below"), "{}", says());
        for lengths in [vec![2], vec![-1], vec![], vec![i64::MAX]] {
            write(vec![5, 5], lengths);
            assert!(says().contains("test_len"), "{}", says());
        }
        npz(&path, &[("train", &[3, 2], Array::Lengths(vec![0; 6]))]);
        assert!(says().contains("train.npy"), "{}", says());
        // a header that promises more than fits
        let mut zip = zip::ZipWriter::new(File::create(&path).unwrap());
        zip.start_file("train.npy", zip::write::SimpleFileOptions::default()).unwrap();
        let text = format!("{:<117}\n", "{'descr': '<u2', 'fortran_order': False, 'shape': (4294967296, 2), }");
        zip.write_all(&[b"\x93NUMPY\x01\x00\x76\x00", text.as_bytes()].concat()).unwrap();
        zip.finish().unwrap();
        assert!(says().contains("[4294967296, 2], expected arrays of 1 GiB at most"), "{}", says());
        std::fs::write(&path, "PK").unwrap();
        assert!(says().contains("an npz archive"), "{}", says());
    }
}
