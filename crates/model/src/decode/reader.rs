//! A model that reads tokens incrementally.

use super::conditioning::FrameConditioning;
use super::tokens::{SavedTokens, TokenDecoder};
use super::two_level::{SavedFrames, TwoLevelDecoder};
use super::{Logits, ReaderOptions};
use crate::config::Architecture;
use crate::config::{ModelConfig, ModelKind, TokenLayout};
use crate::gpt::Gpt;
use crate::scores::{Scores, TokenWindows};
use crate::{Error, Result, goal};
use kinelm_engine::op::cross_entropy;

/// Bytes of weights a token that stay in the caches of a processor where several threads read their own: measured with 1 to
/// 19 MB on two threads of an AMD EPYC (Zen 4), up to 5 MB gain 1.3 times and more, 19 lose a little.
const CACHED: usize = 8 << 20;

/// Sequences that a model reads side by side.
///
/// ```
/// use kinelm_model::{Gpt, Logits, ModelConfig, Reader, ReaderOptions, TokenLayout};
///
/// let tokens = TokenLayout {
///     vocabulary: 16, word: 7, varying: false, front: 1, pad: 0, bos: 1, space: 5, places: Vec::new(),
/// };
/// let config = ModelConfig { layers: 1, heads: 2, width: 8, context: 15, ..Default::default() };
/// let gpt = Gpt::new(&config, &tokens, 1)?;
/// let mut reader = Reader::new(&gpt, ReaderOptions::default())?;
/// let logits = reader.read(&[&[1, 6, 7]], Logits::Last)?;
/// assert_eq!(logits.len(), 16);
/// # Ok::<(), kinelm_model::Error>(())
/// ```
pub struct Reader {
    config: ModelConfig,
    tokens: TokenLayout,
    decoder: Decoder,
}

enum Decoder {
    Flat(Box<TokenDecoder>),
    TwoLevel(Box<TwoLevelDecoder>),
}

/// What a sequence has read, with its keys and values: [`Reader::save`].
#[derive(Debug, Clone)]
pub struct SavedSequence(Saved);

#[derive(Debug, Clone)]
enum Saved {
    Flat(SavedTokens),
    TwoLevel(Box<SavedFrames>),
}

/// Calls the same method of either decoder.
macro_rules! either {
    ($decoder:expr, $name:ident($($argument:expr),*)) => {
        match $decoder {
            Decoder::Flat(decoder) => decoder.$name($($argument),*),
            Decoder::TwoLevel(decoder) => decoder.$name($($argument),*),
        }
    };
}

impl Reader {
    /// A reader with the weights of a model, packed.
    ///
    /// # Errors
    /// If there are no streams, if the model is masked, or if its weights can't be brought to the CPU.
    pub fn new(gpt: &Gpt, options: ReaderOptions) -> Result<Reader> {
        Ok(Reader::split(gpt, options, |_| vec![options.streams])?.swap_remove(0))
    }

    /// Readers of `options.streams` sequences together, of which every `each` stay in one reader: a reader for each thread
    /// where the weights that a token reads stay in the caches, so that the threads needn't meet at every product; else one
    /// reader, whose sequences share every read of a weight. All share the weights.
    ///
    /// # Errors
    /// Those of [`Reader::new`].
    ///
    /// # Panics
    /// If `each` is 0.
    pub fn side_by_side(gpt: &Gpt, options: ReaderOptions, each: usize) -> Result<Vec<Reader>> {
        Reader::split(gpt, options, |bytes| {
            let groups = options.streams / each;
            let count = groups.min(rayon::current_num_threads());
            // beyond the caches a weight comes from memory once per reader, and shared reads win
            if count < 2 || bytes > CACHED || !options.streams.is_multiple_of(each) {
                return vec![options.streams];
            }
            // groups that the threads don't divide: the first readers get one more
            (0..count).map(|i| each * (groups / count + usize::from(i < groups % count))).collect()
        })
    }

    /// Readers of the same weights, as many streams each as `split` makes of the bytes that a token reads.
    fn split(gpt: &Gpt, options: ReaderOptions, split: impl FnOnce(usize) -> Vec<usize>) -> Result<Vec<Reader>> {
        if options.streams == 0 {
            return Err(Error::invalid_parameter("streams", 0, "1 or more"));
        }
        if gpt.config().kind == ModelKind::Masked {
            let why = "a masked model sees the whole window at once, so it can't be read token by token";
            return Err(Error::unsupported("decoding", why));
        }
        let decoders: Vec<Decoder> = match gpt.config().architecture {
            Architecture::Flat => {
                TokenDecoder::several(gpt, options, split)?.into_iter().map(|d| Decoder::Flat(Box::new(d))).collect()
            }
            Architecture::TwoLevel => {
                let several = TwoLevelDecoder::several(gpt, options, split)?;
                several.into_iter().map(|d| Decoder::TwoLevel(Box::new(d))).collect()
            }
        };
        let reader = |decoder| Reader { config: gpt.config().clone(), tokens: gpt.tokens().clone(), decoder };
        Ok(decoders.into_iter().map(reader).collect())
    }

    /// T: the most tokens of a sequence.
    pub fn context(&self) -> usize {
        self.config.context
    }

    /// Sequences.
    pub fn streams(&self) -> usize {
        either!(&self.decoder, streams())
    }

    /// Bytes of weights that are read for a token; the mean over the slots of a word.
    pub fn weight_bytes(&self) -> usize {
        either!(&self.decoder, bytes())
    }

    /// A sequence forgets all but its first `length` tokens, and the conditioning of later frames.
    ///
    /// # Panics
    /// If there is no such sequence.
    pub fn truncate(&mut self, stream: usize, length: usize) {
        either!(&mut self.decoder, truncate(stream, length));
    }

    /// A sequence forgets all tokens, and comes after the frames `ids`: whole words, of which the model reads the last
    /// [`ModelConfig::history`]. A flat model reads none.
    ///
    /// # Panics
    /// If there is no such sequence.
    pub fn begin_after(&mut self, stream: usize, ids: &[u32]) {
        match &mut self.decoder {
            Decoder::Flat(decoder) => decoder.truncate(stream, 0),
            Decoder::TwoLevel(decoder) => decoder.begin_after(stream, without_padding(ids, self.tokens.pad)),
        }
    }

    /// What a sequence has read, for another to go on from without reading it.
    ///
    /// # Panics
    /// If there is no such sequence.
    pub fn save(&self, stream: usize) -> SavedSequence {
        SavedSequence(match &self.decoder {
            Decoder::Flat(decoder) => Saved::Flat(decoder.save(stream)),
            Decoder::TwoLevel(decoder) => Saved::TwoLevel(Box::new(decoder.save(stream))),
        })
    }

    /// A sequence has read what another had, of this reader or of one made with the same weights and options.
    ///
    /// # Panics
    /// If there is no such sequence, or of a sequence of another model.
    pub fn restore(&mut self, stream: usize, saved: &SavedSequence) {
        match (&mut self.decoder, &saved.0) {
            (Decoder::Flat(decoder), Saved::Flat(saved)) => decoder.restore(stream, saved),
            (Decoder::TwoLevel(decoder), Saved::TwoLevel(saved)) => decoder.restore(stream, saved),
            _ => panic!("a sequence of another architecture"),
        }
    }

    /// Sets the conditioning of a frame of a sequence, its goals and its music (M), before the last token before the
    /// frame is read; `None` and empty: none. A flat model has no conditioning.
    ///
    /// # Errors
    /// If the model has no such conditioning, or takes other numbers or rows.
    ///
    /// # Panics
    /// If there is no such sequence or frame.
    pub fn condition(
        &mut self,
        stream: usize,
        frame: usize,
        goal: Option<FrameConditioning>,
        music: &[f32],
    ) -> Result<()> {
        if let Some(FrameConditioning { numbers, rows }) = goal {
            if !self.config.goal {
                return Err(Error::unsupported("goal conditioning", "this model has model.goal = false"));
            }
            let (p, word) = (goal::numbers(self.tokens.word - 1), self.tokens.word);
            if numbers.len() != p || rows.iter().any(|rows| rows.len() != word) {
                let found = format!("{} numbers and {:?} rows", numbers.len(), rows.map(<[u32]>::len));
                return Err(Error::invalid("the goal of a frame", found, format!("{p} numbers and {word} rows")));
            }
        }
        let m = self.config.music.numbers();
        if !music.is_empty() && music.len() != m {
            return Err(Error::invalid("the music of a frame", format!("{} numbers", music.len()), m.to_string()));
        }
        if let Decoder::TwoLevel(decoder) = &mut self.decoder {
            decoder.condition(stream, frame, goal, music);
        }
        Ok(())
    }

    /// Reads a block of tokens per sequence, which may be empty; returns logits (rows, V), the rows in the order of the
    /// sequences, minus infinity for ids that can't follow. Blocks cut otherwise give the same bits.
    ///
    /// # Errors
    /// If there isn't a block for every sequence, the context has no room for them, or ids are outside the vocabulary.
    pub fn read(&mut self, blocks: &[&[u32]], logits: Logits) -> Result<&[f32]> {
        if blocks.len() != self.streams() {
            return Err(Error::invalid(
                "the number of blocks",
                blocks.len(),
                format!("{}, one per sequence", self.streams()),
            ));
        }
        let (context, vocabulary) = (self.config.context, self.tokens.vocabulary);
        for (stream, block) in blocks.iter().enumerate() {
            let read = either!(&self.decoder, len(stream));
            if read + block.len() > context {
                let (needs, limit) = (format!("{} tokens", read + block.len()), format!("{context} tokens"));
                return Err(Error::limit(
                    "the sequence",
                    needs,
                    limit,
                    "shorten it, or start anew with its last tokens",
                ));
            }
            if let Some(id) = block.iter().find(|&&id| id as usize >= vocabulary) {
                return Err(Error::invalid("a token", format!("id {id}"), format!("ids below {vocabulary}")));
            }
        }
        Ok(either!(&mut self.decoder, read(blocks, logits)))
    }

    #[cfg(test)]
    pub(super) fn two_level(&self) -> &TwoLevelDecoder {
        let Decoder::TwoLevel(decoder) = &self.decoder else { panic!("a flat model") };
        decoder
    }
}

/// The words after the padding.
fn without_padding(ids: &[u32], pad: u32) -> &[u32] {
    &ids[ids.iter().take_while(|&&id| id == pad).count()..]
}

impl Scores for Reader {
    fn config(&self) -> &ModelConfig {
        &self.config
    }

    fn tokens(&self) -> &TokenLayout {
        &self.tokens
    }

    fn nats(&mut self, windows: TokenWindows, out: &mut [f32]) -> Result<()> {
        let TokenWindows { inputs, targets, length, history, conditioning } = windows;
        if conditioning.is_some() {
            let why = "it is given to whole windows; measure with weights and keys in f32";
            return Err(Error::unsupported("conditioning on goals or music", why));
        }
        assert_eq!((inputs.len(), targets.len()), (out.len(), out.len()), "a target for every input and its nats");
        let pad = self.tokens.pad;
        let mut nats = vec![0.0; length];
        self.config.check_history(&self.tokens, inputs.len() / length.max(1), history)?;
        let windows = inputs.chunks(length).zip(targets.chunks(length)).zip(out.chunks_mut(length));
        let before = self.config.history() * self.tokens.word;
        for (i, ((inputs, targets), out)) in windows.enumerate() {
            (0..self.streams()).for_each(|stream| self.truncate(stream, 0));
            self.begin_after(0, history.get(i * before..(i + 1) * before).unwrap_or_default());
            let mut blocks = vec![&[][..]; self.streams()];
            // the other streams stay empty: windows are scored one after the other
            blocks[0] = inputs;
            let logits = self.read(&blocks, Logits::All)?;
            cross_entropy::nats(&mut nats[..out.len()], logits, targets, pad);
            out.iter_mut().zip(&nats).for_each(|(out, nats)| *out = *nats as f32);
        }
        Ok(())
    }
}
