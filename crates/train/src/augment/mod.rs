//! Augmentation: every window is changed independently, from its own random streams.
//!
//! A window's words are decoded, the motion is changed and encoded again. A window in the middle of a clip is decoded after a
//! neutral word (no step, no turn) and the words before it, which are dropped again: its first step then begins as in the
//! whole clip. So an unchanged window keeps its words: exactly where each word is a frame (uniform and quantile bins), up to
//! rounding in tiles.

mod drop_joints;
mod heading;
mod history;
mod mirror;
mod speed;

use super::window::{WindowId, WindowSpan};
use crate::{Error, Result};
use drop_joints::Droppable;
use history::History;
use kinelm_corpus::{ClipRecord, Corpus};
use kinelm_motion::{Clip, smpl};
use kinelm_store::random;
use kinelm_tokenizer::{Tokenizer, UncodedPose, Words};
use serde::{Deserialize, Serialize};

/// The `[augment]` table. Labels aren't changed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AugmentConfig {
    /// Share of the windows that are mirrored, 0..=1. Default 0.
    pub mirror: f64,
    /// Whether every window gets a random heading. Default false.
    pub heading: bool,
    /// Largest change of speed: 0.1 is 0.9 to 1.1 times as fast, 0..=0.5. Default 0.
    pub speed: f64,
    /// Share of the windows in which some joints, never the root, are neither inputs nor targets, 0..=1. Default 0.
    pub drop_joints: f64,
    /// Largest deviation, in bins, of Gaussian noise on the input codes of 70 % of the windows, 0..=16; each window has its
    /// own deviation, and targets stay. Default 0.
    pub history_noise: f64,
}

impl AugmentConfig {
    /// Checks every key.
    ///
    /// # Errors
    /// The first key outside its limits.
    pub fn validate(&self) -> Result<()> {
        let keys = [
            ("mirror", self.mirror, 1.0),
            ("speed", self.speed, 0.5),
            ("drop_joints", self.drop_joints, 1.0),
            ("history_noise", self.history_noise, history::MOST),
        ];
        match keys.into_iter().find(|(_, value, most)| !(0.0..=*most).contains(value)) {
            Some((key, value, most)) => Err(Error::invalid(format!("augment.{key}"), value, format!("0 to {most}"))),
            None => Ok(()),
        }
    }

    fn moves(&self) -> bool {
        self.mirror > 0.0 || self.heading || self.speed > 0.0
    }
}

/// Changes windows.
#[derive(Debug)]
pub struct Augment {
    config: AugmentConfig,
    seed: u64,
    tokenizer: Tokenizer,
    droppable: Droppable,
    history: Option<History>,
}

impl Augment {
    /// The augmentation of `config`; `None` if it changes nothing.
    ///
    /// # Errors
    /// Keys outside their limits; dropped joints where tokens don't belong to one joint each; headings where words don't code
    /// the heading.
    pub fn new(config: &AugmentConfig, tokenizer: &Tokenizer, seed: u64) -> Result<Option<Augment>> {
        config.validate()?;
        if *config == AugmentConfig::default() {
            return Ok(None);
        }
        if config.heading && tokenizer.channels().has_turn() {
            let why =
                "the tokenizer codes the pelvis's turns as steps, so that its words are the same for every heading";
            return Err(Error::unsupported("augment.heading", format!("{why}; leave it out")));
        }
        let droppable = match config.drop_joints > 0.0 {
            true => Droppable::of(tokenizer)?,
            false => Droppable::default(),
        };
        let most = config.history_noise;
        let history = (most > 0.0).then(|| History::of(tokenizer, most)).transpose()?;
        Ok(Some(Augment { config: *config, seed, tokenizer: tokenizer.clone(), droppable, history }))
    }

    /// The changed ids of a window, at most `room`; `None` where it is unchanged: by chance, because it starts inside a word, or
    /// because its changed motion can't be coded.
    pub fn ids(
        &self,
        corpus: &Corpus,
        clip: &ClipRecord,
        span: &WindowSpan,
        window: WindowId,
        room: usize,
    ) -> Option<Changed> {
        let words = corpus.words(clip);
        // half a word can't be decoded
        if !self.config.moves() || words.start(span.word) != span.start {
            return None;
        }
        let random =
            // a stream per purpose: switching one change on leaves the numbers of the others as they were
            |purpose: &str| random::unit(&mut random::stream(self.seed, purpose, window.round, window.number as u64));
        let factor = 1.0 + self.config.speed * (2.0 * random("speed") - 1.0);
        let mirrored = random("mirror") < self.config.mirror;
        let turn = if self.config.heading { std::f64::consts::TAU * random("heading") } else { 0.0 };
        if factor == 1.0 && !mirrored && turn == 0.0 {
            return None;
        }
        let shown = words.before(span.start + span.tokens) - span.word;
        let piece = Piece { corpus, clip, first: span.word, words: shown, factor };
        let change = |clip: Clip| {
            let clip = if mirrored { mirror::mirrored(&clip)? } else { clip };
            if turn == 0.0 { Ok(clip) } else { heading::turned(&clip, turn) }
        };
        // where words have one length, the window keeps its end
        let most = if corpus.manifest().tokens_per_word.is_some() { span.tokens } else { room };
        let mut ids = piece.recoded(&self.tokenizer, &change).ok()?;
        ids.truncate(most);
        Some(Changed { ids, first: piece.first_frame(&self.tokenizer), factor })
    }

    /// Adds noise to the inputs of a window, from its first word on.
    pub fn disturb(&self, window: WindowId, inputs: &mut [u32]) {
        let rng = || random::stream(self.seed, "history noise", window.round, window.number as u64);
        self.history.iter().for_each(|history| history.disturb(inputs, &mut rng()));
    }

    /// The places of a word that are hidden in a window, ascending.
    pub fn dropped(&self, window: WindowId) -> Vec<usize> {
        let mut rng = random::stream(self.seed, "drop joints", window.round, window.number as u64);
        match random::unit(&mut rng) < self.config.drop_joints {
            true => self.droppable.sample(&mut rng),
            false => Vec::new(),
        }
    }
}

/// A changed window.
#[derive(Debug, Clone, PartialEq)]
pub struct Changed {
    /// Its ids.
    pub ids: Vec<u32>,
    /// Its first frame in the clip's frames, which may be fractional.
    pub first: f64,
    /// Frames of the clip per frame of the window.
    pub factor: f64,
}

/// Words of a clip that are decoded and encoded again.
struct Piece<'a> {
    corpus: &'a Corpus,
    clip: &'a ClipRecord,
    first: usize,
    words: usize,
    /// The factor of speed.
    factor: f64,
}

impl Piece<'_> {
    /// The first word that is read: words depend on their neighbours.
    fn from(&self, tokenizer: &Tokenizer) -> usize {
        let reach = tokenizer.scheme().reach().div_ceil(tokenizer.frames_per_word());
        // one more than the scheme's reach: steps of the root count from the word before
        self.first.saturating_sub(1 + reach)
    }

    /// The first frame in the clip's frames: all words that are read are `factor` times as fast.
    fn first_frame(&self, tokenizer: &Tokenizer) -> f64 {
        let l = tokenizer.frames_per_word();
        let from = self.from(tokenizer);
        (from * l) as f64 + ((self.first - from) * l) as f64 * self.factor
    }

    /// The ids of the words after `change`; fewer words where a faster clip ends early.
    fn recoded(&self, tokenizer: &Tokenizer, change: &dyn Fn(Clip) -> Result<Clip>) -> Result<Vec<u32>> {
        let (l, scheme) = (tokenizer.frames_per_word(), tokenizer.scheme());
        let reach = scheme.reach().div_ceil(l);
        let from = self.from(tokenizer);
        // the last words of a decoded stretch still lack their successors' share, and are cut off below
        let after = reach + scheme.unsettled_words();
        let lead = self.first - from;
        let needed =
            // + 1: interpolation needs the frame after the last one
            ((lead + self.words + after) as f64 * self.factor).ceil() as usize + usize::from(self.factor != 1.0);
        let to = (from + needed).min(self.corpus.words(self.clip).len());
        let mut words = Words::new();
        let before = usize::from(from > 0);
        if before > 0 {
            words.push(&tokenizer.neutral());
        }
        let read = tokenizer.words_of_ids(&self.corpus.word_ids(self.clip, from..to)?).words;
        read.iter().for_each(|word| words.push(word));
        let clip = tokenizer.decode(&words, UncodedPose::Identity)?;
        // the neutral word keeps its length, so that the words after it still begin where they did
        let clip = if self.factor == 1.0 { clip } else { speed_up_after(&clip, before * l, self.factor)? };
        let coded = tokenizer.encode(&change(clip)?)?.words;
        let mut taken = Words::new();
        coded.iter().skip(before + lead).take(self.words).for_each(|word| taken.push(word));
        Ok(tokenizer.ids_of_words(&taken)?)
    }
}

/// A clip whose frames after the first `start` are `factor` times as fast.
fn speed_up_after(clip: &Clip, start: usize, factor: f64) -> Result<Clip> {
    let body = speed::stretched(&clip.slice(start..clip.frames()), factor)?;
    let head = clip.slice(0..start);
    let root = [head.root(), body.root()].concat();
    let rotations = [head.rotations(), body.rotations()].concat();
    Ok(Clip::new(smpl::neutral(), clip.fps(), root, rotations)?)
}

#[cfg(test)]
mod tests;
