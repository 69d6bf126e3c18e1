//! The codes of clips, without spaces: what the static floors are measured on.

use super::sample::{Extent, MOST_FRAMES, Stretch, stretches};
use crate::{Error, Result};
use kinelm_corpus::{Corpus, Split};
use kinelm_store::memory;
use kinelm_tokenizer::WordLength;
use npyz::NpyFile;
use std::fs::File;
use std::io::BufReader;
use std::ops::Range;
use std::path::Path;
use zip::ZipArchive;
use zip::read::ZipFile;

/// Clips of codes, frame after frame: a clip is (F, C), the channel running fastest.
pub(crate) type CodeClips = Vec<Vec<u16>>;

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
    /// Frames that both splits have, of which these may be a sample.
    pub of: [usize; 2],
}

impl CodeSplits {
    /// Reads what `order0.py --dump` writes: `train` and `test` (F, C) uint16, `train_len` and `test_len`, the frames of
    /// each clip. What a sample leaves out is read past and never held.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] when an array is missing, of another shape, larger than the free memory holds, or holds a
    /// code of `bins` or more.
    pub fn load_npz(path: &Path, bins: usize, extent: Extent) -> Result<Self> {
        let bad =
            |found: String, expected: &str| Error::file(path, found, expected, "`order0.py --dump` writes such files");
        let file = kinelm_store::input::open(path).map_err(Error::io(path))?;
        let mut archive = ZipArchive::new(BufReader::new(file)).map_err(|e| bad(e.to_string(), "an npz archive"))?;
        let read = |archive: &mut _, name| read_split(archive, name, bins, extent).map_err(|(f, e)| bad(f, e));
        let ((train, train_frames, channels), (test, test_frames, test_channels)) =
            (read(&mut archive, "train")?, read(&mut archive, "test")?);
        if test_channels != channels {
            return Err(bad(format!("{channels} channels in train, {test_channels} in test"), "as many in both"));
        }
        Ok(CodeSplits { bins, channels, train, test, of: [train_frames, test_frames] })
    }

    /// The codes of a corpus whose words are frames of so many characters each: without the space, and as they were before
    /// any were merged. `measured` is the split that stands for `test`; the one for `train` is that of `fitted`, a corpus of the
    /// same tokenizer.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] for a corpus of other words; [`kinelm_store::Error::File`] when an id stands where it may not.
    pub fn of_corpora(fitted: &Corpus, corpus: &Corpus, measured: Split, extent: Extent) -> Result<Self> {
        let Some(channels) = channels(corpus) else {
            return Err(Error::unsupported(
                "static floors of channels",
                "words are tiles of frames or differ in length, so a channel has no code of its own",
            ));
        };
        let bins = corpus.tokenizer().vocabulary().characters() as usize;
        let read = |corpus: &Corpus, split| -> Result<CodeClips> {
            let codes = |of: Stretch| Ok(corpus.some_words(of.clip, of.words)?.codes().to_vec());
            stretches(corpus, split, extent).into_iter().map(codes).collect()
        };
        let (train, test) = (read(fitted, Split::Train)?, read(corpus, measured)?);
        Ok(CodeSplits { bins, channels, train, test, of: [frames(fitted, Split::Train), frames(corpus, measured)] })
    }
}

/// Frames of a split.
pub fn frames(corpus: &Corpus, split: Split) -> usize {
    corpus.split(split).map(|clip| clip.frames).sum()
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
/// Clips of an array at most, 16 MB of lengths.
const MOST_CLIPS: u64 = 1 << 21;

const SHAPE: &str = "uint16 arrays (frames, channels) `train`, `test` and their clips' lengths `*_len`";
const C_ORDER: &str = "an array that numpy wrote in C order, uint16 codes, int64 lengths";

/// What is taken of a split, its frames in all, and C.
fn read_split(
    archive: &mut ZipArchive<BufReader<File>>,
    name: &'static str,
    bins: usize,
    extent: Extent,
) -> std::result::Result<(CodeClips, usize, usize), Fault> {
    let lengths_of = format!("{name}_len");
    let file = npy(archive, &lengths_of)?;
    if file.len() > MOST_CLIPS {
        return Err((format!("{} clips in {lengths_of}", file.len()), "2,097,152 clips at most"));
    }
    let lengths: Vec<i64> = file.into_vec().map_err(|e| unread(&lengths_of, e))?;
    let mut starts = vec![0_usize];
    for &length in &lengths {
        let end = usize::try_from(length).ok().and_then(|length| starts[starts.len() - 1].checked_add(length));
        starts.push(end.ok_or_else(|| (format!("{lengths_of} with {length}"), SHAPE))?);
    }
    let lengths: Vec<usize> = starts.windows(2).map(|pair| pair[1] - pair[0]).collect();

    let file = npy(archive, name)?;
    let (frames, channels) = match *file.shape() {
        [frames, channels] if channels > 0 => (frames, channels),
        ref shape => return Err((format!("{name} of shape {shape:?}"), SHAPE)),
    };
    let held = if extent == Extent::All { frames } else { frames.min(MOST_FRAMES as u64) };
    let held = held.saturating_mul(channels).saturating_mul(size_of::<u16>() as u64);
    if held > MOST_BYTES || memory::free().is_some_and(|free| held > free / 2) {
        let what = "arrays of which 1 GiB and half of the free memory are held at most; a sample holds less";
        return Err((format!("{name} of shape {:?}", file.shape()), what));
    }
    let (frames, channels) = (frames as usize, channels as usize);
    let stated = starts[lengths.len()];
    if stated != frames {
        return Err((format!("{frames} frames in {name}, {stated} in {lengths_of}"), SHAPE));
    }
    let mut codes = file.data::<u16>().map_err(|e| unread(name, e))?;
    let mut read = |frames: Range<usize>, mut keep: Option<&mut Vec<u16>>| {
        for frame in frames {
            for channel in 0..channels {
                let code = codes.next().unwrap_or(Err(std::io::ErrorKind::UnexpectedEof.into()));
                let code = code.map_err(|e| unread(name, e))?;
                if usize::from(code) >= bins {
                    let found = format!("{name}[{frame}, {channel}] = {code}");
                    return Err((found, "codes below the number of bins"));
                }
                keep.iter_mut().for_each(|keep| keep.push(code));
            }
        }
        Ok(())
    };
    let (mut clips, mut done) = (Vec::new(), 0);
    for (clip, taken) in extent.stretches(&lengths, 1) {
        let (first, end) = (starts[clip] + taken.start, starts[clip] + taken.end);
        read(done..first, None)?;
        let mut kept = Vec::new();
        read(first..end, Some(&mut kept))?;
        clips.push(kept);
        done = end;
    }
    read(done..frames, None)?;
    Ok((clips, frames, channels))
}

fn unread(name: &str, e: impl std::fmt::Display) -> Fault {
    (format!("{name}.npy: {e}"), C_ORDER)
}

/// An array of an archive, in C order.
fn npy<'a>(
    archive: &'a mut ZipArchive<BufReader<File>>,
    name: &str,
) -> std::result::Result<NpyFile<BufReader<ZipFile<'a, BufReader<File>>>>, Fault> {
    let entry = archive.by_name(&format!("{name}.npy")).map_err(|e| (format!("{name}.npy: {e}"), C_ORDER))?;
    let file = NpyFile::new(BufReader::new(entry)).map_err(|e| unread(name, e))?;
    match file.order() {
        npyz::Order::C => Ok(file),
        npyz::Order::Fortran => Err((format!("{name}.npy: Fortran order"), C_ORDER)),
    }
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

    #[derive(Clone)]
    enum Array {
        Codes(Vec<u16>),
        Lengths(Vec<i64>),
    }

    fn write<T: npyz::AutoSerialize + Copy>(bytes: &mut Vec<u8>, shape: &[u64], values: &[T]) {
        let mut writer = npyz::WriteOptions::new().default_dtype().shape(shape).writer(bytes).begin_nd().unwrap();
        writer.extend(values.iter().copied()).unwrap();
        writer.finish().unwrap();
    }

    const ONE: &[u64] = &[1];
    const TWO: &[u64] = &[2];

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
        let says = || CodeSplits::load_npz(&path, 6, Extent::All).unwrap_err().to_string();
        write(vec![5, 5], vec![1]);
        let codes = CodeSplits::load_npz(&path, 6, Extent::All).unwrap();
        assert_eq!(codes.train, [vec![0, 1], vec![2, 3, 4, 5]]);
        assert_eq!((codes.test.len(), codes.channels), (1, 2));
        write(vec![5, 6], vec![1]);
        assert!(says().contains("test[0, 1] = 6, expected codes below"), "{}", says());
        for lengths in [vec![2], vec![-1], vec![], vec![i64::MAX]] {
            write(vec![5, 5], lengths);
            assert!(says().contains("test_len"), "{}", says());
        }
        let lengths = || ("train_len", ONE, Array::Lengths(vec![3]));
        npz(&path, &[lengths(), ("train", &[3, 2], Array::Lengths(vec![0; 6]))]);
        assert!(says().contains("train.npy"), "{}", says());
        // a header that promises more than fits
        npz(&path, &[lengths()]);
        let mut zip = zip::ZipWriter::new_append(File::options().read(true).write(true).open(&path).unwrap()).unwrap();
        zip.start_file("train.npy", zip::write::SimpleFileOptions::default()).unwrap();
        let text = format!("{:<117}\n", "{'descr': '<u2', 'fortran_order': False, 'shape': (4294967296, 2), }");
        zip.write_all(&[b"\x93NUMPY\x01\x00\x76\x00", text.as_bytes()].concat()).unwrap();
        zip.finish().unwrap();
        assert!(says().contains("[4294967296, 2], expected arrays of which 1 GiB"), "{}", says());
        // of a large one a sample is held, and all of it is looked at
        let frames = 3 * MOST_FRAMES;
        let mut codes: Vec<u16> = (0..frames).map(|frame| (frame % 6) as u16).collect();
        let write = |codes: &[u16]| {
            let (n, lengths) = (frames as u64, Array::Lengths(vec![(frames / 2) as i64; 2]));
            let of = |name| (name, TWO, lengths.clone());
            let array = |name, codes: &[u16]| (name, [n, 1], Array::Codes(codes.to_vec()));
            let (train, test) = (array("train", codes), array("test", codes));
            npz(&path, &[of("train_len"), of("test_len"), (train.0, &train.1, train.2), (test.0, &test.1, test.2)]);
        };
        write(&codes);
        let found = CodeSplits::load_npz(&path, 6, Extent::Sample).unwrap();
        let held: usize = found.train.iter().map(Vec::len).sum();
        assert_eq!((held, found.of), (MOST_FRAMES, [frames; 2]));
        assert_eq!(found.test[7][..3], [0, 1, 2], "frames from 21,000 on");
        codes[1_500] = 6;
        write(&codes);
        let fault = CodeSplits::load_npz(&path, 6, Extent::Sample).unwrap_err().to_string();
        assert!(fault.contains("train[1500, 0] = 6"), "{fault}");
        std::fs::write(&path, "PK").unwrap();
        assert!(says().contains("an npz archive"), "{}", says());
    }
}
