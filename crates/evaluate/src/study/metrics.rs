//! What is measured of a row.

use super::row::Row;
use kinelm_motion::metric::{BorderJerk, GeodesicError, Mpjpe, VectorAngle};
use kinelm_tokenizer::Tokenizer;
use kinelm_tokenizer::rate::{Bytes, TextCounts, seconds_in_context, seconds_in_context_compat};
use kinelm_tokenizer::scheme::quantile::Quantile;
use serde::{Deserialize, Serialize};

/// Tokens of the context whose length is given in seconds.
pub const CONTEXT: usize = 1024;

/// All figures of a row. Angles in radians, places in millimetres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RowMetrics {
    /// What was fitted.
    pub row: Row,
    /// The text.
    pub text: Text,
    /// Bytes, of train and test together.
    pub bytes: Sizes,
    /// What a model without a context pays.
    pub order0: Order0,
    /// Angles between the coded joints' rotations.
    pub angle: Angle,
    /// Position error of all 24 joints after forward kinematics on the neutral skeleton.
    pub mpjpe: PositionError,
    /// Jumps between words.
    pub border_jerk: Border,
    /// How fast it went: not the same twice.
    pub speed: Speed,
}

/// Words and tokens of the test clips.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Text {
    /// Frames that a word stands for.
    pub frames_per_word: usize,
    /// Test frames at the row's rate.
    pub frames: u64,
    /// Words.
    pub words: u64,
    /// Tokens of a word without its space, mean and most.
    pub word_mean: f64,
    /// The longest.
    pub word_max: u64,
    /// Characters of a word without its space, mean: the tokens before merging.
    pub characters_mean: f64,
    /// Tokens a second of motion, spaces counted.
    pub tokens_per_second: f64,
    /// Seconds of motion in 1,024 tokens, spaces not counted (compat) and counted.
    pub seconds_compat: f64,
    /// With spaces.
    pub seconds: f64,
    /// Values that took the last bin; rotations near half a turn that took a second code; frames added to fill tiles.
    pub clipped: u64,
    /// See there.
    pub second_codes: u64,
    /// See there.
    pub padded: u64,
    /// Quantile bins that are left in the channel with the fewest and the one with the most, equal edges merged.
    pub bins_left: Option<(usize, usize)>,
}

/// What the texts of all clips take, and what they were made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sizes {
    /// 75 f32 numbers a frame of the files.
    pub smpl: u64,
    /// Characters with spaces.
    pub characters: u64,
    /// Bytes in UTF-8.
    pub utf8: u64,
    /// The alphabet's bytes, 4 for each bin value and fitted number.
    pub alphabet: u64,
    /// smpl / (characters + alphabet).
    pub factor_chars: f64,
    /// smpl / (utf8 + alphabet).
    pub factor_utf8: f64,
    /// smpl / (order-0 bits / 8 + alphabet).
    pub factor_entropy: f64,
}

/// Bits a test frame under static tables fitted on train.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Order0 {
    /// A table a number of the word.
    pub bits_per_frame: f64,
    /// The same, a second.
    pub bits_per_second: f64,
    /// Characters or tokens as they are written.
    pub written_bits_per_frame: f64,
    /// Differences to the frame before; frame words alone.
    pub difference_bits_per_frame: Option<f64>,
}

/// Angles, radians.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Angle {
    /// Over coded joints and frames.
    pub mean: f64,
    /// Root of the mean square.
    pub rms: f64,
    /// 99 % are no larger.
    pub percentile_99: f64,
    /// The largest.
    pub max: f64,
    /// Mean over frames of the sum over joints.
    pub sum_joints: f64,
    /// Between rotation vectors, a joint (compat).
    pub vector_joint: f64,
    /// Between a frame's whole vectors (compat).
    pub vector_frame: f64,
    /// Pairs of joints and of frames without a direction.
    pub vector_skipped: [u64; 2],
}

/// Distances, mm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionError {
    /// In the world.
    pub global: f64,
    /// Both pelvises at 0.
    pub root: f64,
    /// The largest, in the world.
    pub max: f64,
}

/// Jerk at borders over jerk elsewhere; `None` where words are three frames or fewer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Border {
    /// Decoded over original: 1 can't be seen.
    pub ratio: Option<f64>,
    /// Of the decoded motion alone.
    pub decoded: Option<f64>,
    /// Of the original alone.
    pub original: Option<f64>,
}

/// Frames and tokens a second of computing, on as many threads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Speed {
    /// Threads.
    pub threads: usize,
    /// Frames a second into words.
    pub encode_frames: f64,
    /// Frames a second out of words.
    pub decode_frames: f64,
    /// Tokens a second made.
    pub encode_tokens: f64,
    /// Tokens a second read.
    pub decode_tokens: f64,
}

/// Errors of decoded test clips, added up.
#[derive(Debug, Clone)]
pub struct Errors {
    angle: GeodesicError,
    vector: VectorAngle,
    places: Mpjpe,
    borders: BorderJerk,
}

impl Errors {
    /// Over a tokenizer's joints and words.
    pub fn new(tokenizer: &Tokenizer) -> Self {
        let joints = tokenizer.config().joints.clone();
        Errors {
            angle: GeodesicError::new(joints.clone()),
            vector: VectorAngle::new(joints),
            places: Mpjpe::default(),
            borders: BorderJerk::new(tokenizer.frames_per_word()),
        }
    }

    /// Adds a clip and what it was decoded to.
    ///
    /// # Errors
    /// When frames or joints differ.
    pub fn add(&mut self, original: &kinelm_motion::Clip, decoded: &kinelm_motion::Clip) -> crate::Result<()> {
        self.angle.add(original, decoded)?;
        self.vector.add(original, decoded)?;
        let (a, b) = (original.positions(), decoded.positions());
        self.places.add_positions(&a, &b, original.joints())?;
        Ok(self.borders.add_positions(&a, &b, original.joints())?)
    }

    /// Adds errors that were measured separately, of the same tokenizer.
    pub fn merge(&mut self, other: &Errors) {
        self.angle.merge(&other.angle);
        self.vector.merge(&other.vector);
        self.places.merge(&other.places);
        self.borders.merge(&other.borders);
    }
}

impl RowMetrics {
    /// The figures of a row from what was counted on both parts of the data.
    pub(crate) fn new(
        row: Row,
        t: &Tokenizer,
        train: &TextCounts,
        test: &TextCounts,
        errors: &Errors,
        speed: Speed,
    ) -> Self {
        let bits_per_frame = test.order0_bits_per_frame(train);
        let mut all = train.clone();
        all.merge(test);
        RowMetrics {
            text: Text::new(t, test),
            bytes: Sizes::new(&all.bytes(t), bits_per_frame * all.frames as f64),
            order0: Order0 {
                bits_per_frame,
                bits_per_second: bits_per_frame * t.fps(),
                written_bits_per_frame: test.written_bits_per_frame(train, t),
                difference_bits_per_frame: test.difference_bits_per_frame(train, t),
            },
            angle: Angle {
                mean: errors.angle.mean(),
                rms: errors.angle.rms(),
                percentile_99: errors.angle.percentile_99(),
                max: errors.angle.max(),
                sum_joints: errors.angle.sum_joints(),
                vector_joint: errors.vector.mean_joint(),
                vector_frame: errors.vector.mean_frame(),
                vector_skipped: errors.vector.skipped(),
            },
            mpjpe: PositionError {
                global: errors.places.global_mm(),
                root: errors.places.root_mm(),
                max: errors.places.max_mm(),
            },
            border_jerk: Border {
                ratio: errors.borders.ratio(),
                decoded: errors.borders.decoded(),
                original: errors.borders.original(),
            },
            speed,
            row,
        }
    }

    /// The row's name.
    pub fn name(&self) -> &str {
        &self.row.name
    }

    /// The row's frames per second.
    pub fn fps(&self) -> f64 {
        self.row.config.fps
    }
}

impl Text {
    fn new(t: &Tokenizer, test: &TextCounts) -> Self {
        let (word_mean, words_per_second) = (test.mean_word(), t.fps() / t.frames_per_word() as f64);
        let seconds = test.frames as f64 / t.fps();
        Text {
            frames_per_word: t.frames_per_word(),
            frames: test.frames,
            words: test.words,
            word_mean,
            word_max: test.longest_word,
            characters_mean: test.characters as f64 / test.words.max(1) as f64,
            tokens_per_second: (test.tokens + test.words) as f64 / seconds,
            seconds_compat: seconds_in_context_compat(CONTEXT, word_mean, words_per_second),
            seconds: seconds_in_context(CONTEXT, word_mean, words_per_second),
            clipped: test.clipped,
            second_codes: test.second_codes,
            padded: test.padded,
            bins_left: t.quantile().map(Quantile::bins_left),
        }
    }
}

impl Sizes {
    fn new(bytes: &Bytes, bits: f64) -> Self {
        let Bytes { smpl, characters, utf8, alphabet } = *bytes;
        let (factor_chars, factor_utf8) = (bytes.factor_chars(), bytes.factor_utf8());
        Sizes {
            smpl,
            characters,
            utf8,
            alphabet,
            factor_chars,
            factor_utf8,
            factor_entropy: bytes.factor_entropy(bits),
        }
    }
}
