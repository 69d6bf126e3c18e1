//! Models that the sampler reads: the fast form, or the plain one.

use crate::{Error, Result};
use kinelm_model::{Cache, Compute, LoadedRun, ModelKind, Reader, ReaderOptions};
use kinelm_model::{FrameConditioning, KvKind, Logits, SavedSequence, WeightKind};
use kinelm_store::Subject;

/// An autoregressive model that reads several sequences side by side.
pub trait NextToken: Send {
    /// T, the tokens that one window holds, conditioning tokens included.
    fn context(&self) -> usize;

    /// The number of sequences.
    fn streams(&self) -> usize;

    /// Whether a token has the same logits, bit for bit, however the blocks are cut. Tokens may be guessed ahead then.
    fn is_exact(&self) -> bool;

    /// A sequence forgets all but its first `length` tokens, and the conditioning of later frames.
    fn truncate(&mut self, stream: usize, length: usize);

    /// A sequence forgets all tokens, and comes after the words `ids`, of which models read what they can.
    fn begin_after(&mut self, stream: usize, _ids: &[u32]) {
        self.truncate(stream, 0);
    }

    /// What a sequence has read, for another to go on from; `None` where the model can't say, and its window is read again.
    fn save(&self, _stream: usize) -> Option<SavedSequence> {
        None
    }

    /// A sequence has read what another had.
    fn restore(&mut self, _stream: usize, _saved: &SavedSequence) {}

    /// Conditions a frame of a sequence, counted from its window's first, on its goals and on (M) its music, before the token
    /// is read that comes right before the frame. Models without such conditioning do nothing.
    ///
    /// # Errors
    /// Conditioning of another size than the model's.
    fn condition(
        &mut self,
        _stream: usize,
        _frame: usize,
        _goals: Option<FrameConditioning>,
        _music: &[f32],
    ) -> Result<()> {
        Ok(())
    }

    /// Reads a block of tokens for every sequence, which may be empty. Puts (rows, V) logits of the next tokens into
    /// `logits`: after the last token of each block or after every token, in the order of the sequences.
    ///
    /// # Errors
    /// More tokens than the context holds; what the tensor library fails with.
    fn read(&mut self, blocks: &[&[u32]], wanted: Logits, logits: &mut Vec<f32>) -> Result<()>;
}

impl NextToken for Reader {
    fn context(&self) -> usize {
        Reader::context(self)
    }

    fn streams(&self) -> usize {
        Reader::streams(self)
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn truncate(&mut self, stream: usize, length: usize) {
        Reader::truncate(self, stream, length);
    }

    fn begin_after(&mut self, stream: usize, ids: &[u32]) {
        Reader::begin_after(self, stream, ids);
    }

    fn save(&self, stream: usize) -> Option<SavedSequence> {
        Some(Reader::save(self, stream))
    }

    fn restore(&mut self, stream: usize, saved: &SavedSequence) {
        Reader::restore(self, stream, saved);
    }

    fn condition(
        &mut self,
        stream: usize,
        frame: usize,
        goals: Option<FrameConditioning>,
        music: &[f32],
    ) -> Result<()> {
        Reader::condition(self, stream, frame, goals, music)
    }

    fn read(&mut self, blocks: &[&[u32]], wanted: Logits, logits: &mut Vec<f32>) -> Result<()> {
        logits.clear();
        logits.extend_from_slice(Reader::read(self, blocks, wanted)?);
        Ok(())
    }
}

/// The plain form: one cache per sequence, read one after the other.
impl NextToken for Vec<Cache> {
    fn context(&self) -> usize {
        self.first().map_or(0, Cache::context)
    }

    fn streams(&self) -> usize {
        self.len()
    }

    fn is_exact(&self) -> bool {
        false
    }

    fn truncate(&mut self, stream: usize, length: usize) {
        self[stream].truncate(length);
    }

    fn read(&mut self, blocks: &[&[u32]], wanted: Logits, logits: &mut Vec<f32>) -> Result<()> {
        logits.clear();
        // an empty block has no logits, as of a [`Reader`]
        for (cache, block) in self.iter_mut().zip(blocks).filter(|(_, block)| !block.is_empty()) {
            match wanted {
                Logits::Last => logits.extend(cache.read(block)?),
                Logits::All => logits.extend(cache.read_all(block)?.flatten_all()?.to_vec1::<f32>()?),
            }
        }
        Ok(())
    }
}

/// The model of a run as one reader of all sequences; see [`readers`].
///
/// # Errors
/// Those of [`readers`].
pub fn reader(run: &LoadedRun, compute: Compute, reading: ReaderOptions) -> Result<Box<dyn NextToken>> {
    let mut one = readers(run, compute, reading, reading.streams.max(1))?;
    Ok(one.swap_remove(0))
}

/// The model of a run in the form that `compute` selects, ready to read. Of `reading.streams` sequences every `each` belong to
/// one dance; dances of different models can be sampled at the same time.
///
/// # Errors
/// A masked model, which isn't read token by token (see [`crate::RunModel`]); weights that don't fit the configuration; a device that isn't
/// there; number formats that the plain form doesn't have.
pub fn readers(
    run: &LoadedRun,
    compute: Compute,
    reading: ReaderOptions,
    each: usize,
) -> Result<Vec<Box<dyn NextToken>>> {
    if run.config.kind == ModelKind::Masked {
        let why = "a masked model fills what is free of whole windows; give a run of a causal model \
                   (model.kind = \"causal\")";
        return Err(Error::unsupported(format!("{}: reading token by token", run.checkpoint.display()), why));
    }
    if compute.is_fast() {
        let readers = run.readers(reading, each)?;
        return Ok(readers.into_iter().map(|reader| Box::new(reader) as Box<dyn NextToken>).collect());
    }
    check_f32(reading, "the plain form of the model has F32 alone; leave them out, or use the form auto on the cpu")?;
    let model = run.plain(compute.device)?;
    let caches = (0..reading.streams).map(|_| model.cache()).collect::<Result<Vec<Cache>>>()?;
    Ok(vec![Box::new(caches)])
}

/// Refuses number formats of a model that has none but F32, for the reason `why`.
pub(crate) fn check_f32(reading: ReaderOptions, why: &str) -> Result<()> {
    if (reading.weights, reading.kv) == (WeightKind::F32, KvKind::F32) {
        return Ok(());
    }
    let formats = format!("as {:?}, `kv` as {:?}", reading.weights, reading.kv);
    Err(Error::unsupported(Subject::of_parameter("weights").with(formats), why))
}
