//! The `[train]` table of a training file.

use super::precision::Precision;
use super::trainer::Cadence;
use crate::{Error, Result};
use kinelm_corpus::SpanMasking;
use kinelm_corpus::conditions::in_order;
use kinelm_model::{Keep, ModelConfig, ModelKind, TokenLayout};
use kinelm_tokenizer::Tokenizer;
use serde::{Deserialize, Serialize};

/// The `[train]` table. Where the defaults come from: docs/training.md.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainConfig {
    /// B: windows of a step, 1..=65536. Default 8.
    pub batch: usize,
    /// Steps in all, at which the schedule ends. Default 1,000.
    pub steps: u64,
    /// Highest learning rate, above 0. Default 2e-4.
    pub learning_rate: f64,
    /// How the rate moves after the warm-up. Default `cosine`.
    pub schedule: Schedule,
    /// Steps in which the rate rises from 0. Default 100.
    pub warmup: u64,
    /// Where `cosine` ends, as a share of the rate, 0..=1. Default 0.1.
    pub final_share: f64,
    /// AdamW's decay of the two moments, each 0 up to below 1. Default 0.9 and 0.95.
    pub betas: [f64; 2],
    /// AdamW's epsilon, above 0. Default 1e-8.
    pub epsilon: f64,
    /// Decoupled decay of the matrices that are no embeddings, 0 or more. Default 0.1.
    pub weight_decay: f64,
    /// Largest norm of the gradient; 0 means no limit. Default 1.
    pub clip_norm: f64,
    /// Factor of the learning rate for tables whose rows are looked up, above 0 and at most 100. Default 1.
    pub table_rate: f64,
    /// The seed of all random numbers. Default 1.
    pub seed: u64,
    /// Steps between measurements on the validation clips; 0 means only at the end. Default 250.
    pub eval_every: u64,
    /// Largest number of validation windows of a measurement, evenly spread; 0 means all. Default 128.
    pub eval_windows: usize,
    /// Steps between checkpoints; 0 means only at the end and where validation is best. Default 250.
    pub checkpoint_every: u64,
    /// Checkpoints that stay beside the best, 1 or more, or `"all"`. Default 2.
    pub keep: Keep,
    /// Batches of a step, computed one after the other in the memory of one, 1..=65536. Default 1.
    pub accumulate: usize,
    /// Measurements without improvement after which the run ends; 0 means never. Default 0.
    pub patience: u64,
    /// Decay of the moving average of the weights, which is then measured, loaded and exported in their place, 0 up to below
    /// 1; 0 means no average. Default 0.
    pub ema: f64,
    /// Measurements between dances that are generated into the run's `samples/`; 0 means none. Default 0.
    pub sample_every: u64,
    /// Label fields that the model is conditioned on, one token each before a window. Default none.
    pub conditions: Vec<String>,
    /// Share of the labels that are hidden in training, independently, so that the model works without them too, 0..=1.
    /// Default 0.1.
    pub label_dropout: f64,
    /// Share of the windows that are read without the frames before them, as a clip's first ones are, by a model that reads
    /// such frames, 0..=1. Default 0.1.
    pub history_dropout: f64,
    /// The loss whose gradients are taken. Default `cross_entropy`.
    pub loss: Loss,
    /// Deviation of the targets of `ordinal`, in bins, above 0 and at most 100. Default 0.75.
    pub ordinal_width: f64,
    /// Numbers that products are computed in: `f32`, `bf16` or `auto`. Default `f32`.
    pub precision: Precision,
    /// Share of the windows with gaps, in which the model is conditioned on the goals after them, 0..=1.
    /// Needs `model.goal`. Default 0.
    #[serde(skip_serializing_if = "is_none")]
    pub gaps: f64,
    /// The tokens that are hidden in the windows of a masked model. Default `tokens`.
    #[serde(skip_serializing_if = "Masking::is_tokens")]
    pub masking: Masking,
    /// The shorter windows of the first steps. Default none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<Stage>,
}

/// How the rate moves after the warm-up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Schedule {
    /// Constant.
    Constant,
    /// Half a cosine down to `final_share` of the rate at the last step.
    Cosine,
}

/// The windows of a run up to a share of its steps. After the last stage they are the model's, `train.batch` at a time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stage {
    /// The share of all steps at which it ends, above that of the previous stage and below 1.
    pub until: f64,
    /// Frames of a window, at most the model's.
    pub frames: usize,
    /// Windows of a batch, 1..=65536.
    pub batch: usize,
}

fn is_none(share: &f64) -> bool {
    *share == 0.0
}

/// The loss whose gradients are taken. The reported loss is always the cross-entropy with the target itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Loss {
    /// Cross-entropy with the target.
    CrossEntropy,
    /// Cross-entropy with the target smoothed over neighbouring bins by a Gaussian, which wraps around for angles.
    Ordinal,
}

/// The tokens that are hidden in the windows of a masked model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Masking {
    /// 15 % of the tokens, at random.
    Tokens,
    /// In half of the windows some joints over a run of words, as where a gap is filled; see [`SpanMasking`].
    Spans,
}

impl Masking {
    fn is_tokens(&self) -> bool {
        *self == Masking::Tokens
    }

    /// The spans of a tokenizer's words, where any are hidden.
    ///
    /// # Errors
    /// As [`SpanMasking::of`].
    pub(crate) fn spans(self, tokenizer: &Tokenizer) -> Result<Option<SpanMasking>> {
        (self == Masking::Spans).then(|| Ok(SpanMasking::of(tokenizer)?)).transpose()
    }
}

impl Default for TrainConfig {
    fn default() -> Self {
        TrainConfig {
            batch: 8,
            steps: 1000,
            learning_rate: 2e-4,
            schedule: Schedule::Cosine,
            warmup: 100,
            final_share: 0.1,
            betas: [0.9, 0.95],
            epsilon: 1e-8,
            weight_decay: 0.1,
            clip_norm: 1.0,
            table_rate: 1.0,
            seed: 1,
            eval_every: 250,
            eval_windows: 128,
            checkpoint_every: 250,
            keep: Keep::Last(2),
            accumulate: 1,
            patience: 0,
            ema: 0.0,
            sample_every: 0,
            conditions: Vec::new(),
            label_dropout: 0.1,
            history_dropout: 0.1,
            loss: Loss::CrossEntropy,
            ordinal_width: 0.75,
            precision: Precision::F32,
            gaps: 0.0,
            masking: Masking::Tokens,
            stages: Vec::new(),
        }
    }
}

impl TrainConfig {
    /// How often the training loop measures and saves.
    pub(crate) fn cadence(&self) -> Cadence {
        let TrainConfig { steps, eval_every, checkpoint_every, keep, .. } = *self;
        Cadence { steps, eval_every, checkpoint_every, keep }
    }

    /// Whether `train.patience` measurements up to `step` were no better than that after step `best`.
    pub(crate) fn is_patience_out(&self, step: u64, best: Option<u64>) -> bool {
        let measured = |step: u64| step / self.eval_every.max(1);
        self.patience > 0 && best.is_some_and(|best| measured(step) >= measured(best) + self.patience)
    }

    /// Deviation of smoothed targets, in bins; `None`: targets aren't smoothed.
    pub(crate) fn smoothing(&self) -> Option<f64> {
        (self.loss == Loss::Ordinal).then_some(self.ordinal_width)
    }

    /// Checks every key, alone and against the model and its tokens.
    ///
    /// # Errors
    /// As [`Self::validate`]; `ordinal` for words whose slots have no bins of one kind each; those of
    /// [`validate_stages_for`].
    pub(crate) fn validate_for(&self, model: &ModelConfig, tokens: &TokenLayout) -> Result<()> {
        self.validate()?;
        validate_stages_for(&self.stages, model, tokens)?;
        if self.gaps > 0.0 && !model.goal {
            return Err(Error::invalid("train.gaps", self.gaps, "0, or a goal-conditioned model (model.goal = true)"));
        }
        if self.masking == Masking::Spans && model.kind != ModelKind::Masked {
            let expected = "tokens, or a masked model (model.kind = \"masked\")";
            return Err(Error::invalid("train.masking", "spans", expected));
        }
        if self.loss == Loss::Ordinal && tokens.places.is_empty() {
            let why =
                "the slots of this tokenizer's words have no bins of one kind each, so that no bin has neighbours";
            return Err(Error::invalid("train.loss", "ordinal", format!("cross_entropy: {why}")));
        }
        Ok(())
    }

    /// Checks every key.
    ///
    /// # Errors
    /// The first key outside its limits, with both.
    pub fn validate(&self) -> Result<()> {
        let check = |holds: bool, key: &str, found: String, limits: &str| match holds {
            true => Ok(()),
            false => Err(Error::invalid(format!("train.{key}"), found, limits)),
        };
        let number =
            |holds: bool, key, found: f64, limits| check(holds && found.is_finite(), key, found.to_string(), limits);
        check((1..=65_536).contains(&self.batch), "batch", self.batch.to_string(), "1 to 65536")?;
        check(self.steps <= 1 << 40, "steps", self.steps.to_string(), "at most 2^40")?;
        // `number` refuses what is not finite, which comparisons with infinity let pass
        number(self.learning_rate > 0.0, "learning_rate", self.learning_rate, "a number above 0")?;
        number((0.0..=1.0).contains(&self.final_share), "final_share", self.final_share, "0 to 1")?;
        for beta in self.betas {
            number((0.0..1.0).contains(&beta), "betas", beta, "0 up to below 1")?;
        }
        number(self.epsilon > 0.0, "epsilon", self.epsilon, "a number above 0")?;
        number(self.weight_decay >= 0.0, "weight_decay", self.weight_decay, "0 or more")?;
        let table_rate = self.table_rate > 0.0 && self.table_rate <= 100.0;
        number(table_rate, "table_rate", self.table_rate, "a number above 0 and at most 100")?;
        validate_stages(&self.stages)?;
        number(self.clip_norm >= 0.0, "clip_norm", self.clip_norm, "0 (no limit) or more")?;
        // `contains` alone lets 0 pass, a Gaussian without a width
        let width = (0.0..=100.0).contains(&self.ordinal_width) && self.ordinal_width > 0.0;
        number(width, "ordinal_width", self.ordinal_width, "a number above 0 and at most 100")?;
        // TOML has no larger integers
        check(self.seed <= i64::MAX as u64, "seed", self.seed.to_string(), "at most 9223372036854775807")?;
        check(self.keep.is_valid(), "keep", self.keep.to_string(), "1 or more, or \"all\"")?;
        check((1..=65_536).contains(&self.accumulate), "accumulate", self.accumulate.to_string(), "1 to 65536")?;
        number((0.0..1.0).contains(&self.ema), "ema", self.ema, "0 (none) up to below 1")?;
        let measured = |key, found: u64| {
            let limits = "0 where eval_every is 0: only the last step is measured";
            check(found == 0 || self.eval_every > 0, key, found.to_string(), limits)
        };
        measured("patience", self.patience)?;
        let once = in_order(&self.conditions).len() == self.conditions.len();
        check(once, "conditions", self.conditions.join(", "), "every field once")?;
        number((0.0..=1.0).contains(&self.gaps), "gaps", self.gaps, "0 to 1")?;
        number((0.0..=1.0).contains(&self.label_dropout), "label_dropout", self.label_dropout, "0 to 1")?;
        number((0.0..=1.0).contains(&self.history_dropout), "history_dropout", self.history_dropout, "0 to 1")
    }
}

/// Checks the keys of stages, and their order.
///
/// # Errors
/// The first key outside its limits, with the stage's number.
pub(super) fn validate_stages(stages: &[Stage]) -> Result<()> {
    let mut before = 0.0;
    for (i, stage) in stages.iter().enumerate() {
        let wrong = |key: &str, found: String, limits: String| {
            Err(Error::invalid(format!("train.stages: `{key}` of stage {}", i + 1), found, limits))
        };
        // negated, so that NaN is refused
        if !(stage.until > before && stage.until < 1.0) {
            return wrong("until", stage.until.to_string(), format!("more than {before} and less than 1"));
        }
        if stage.frames == 0 {
            return wrong("frames", "0".into(), "1 or more".into());
        }
        if !(1..=65_536).contains(&stage.batch) {
            return wrong("batch", stage.batch.to_string(), "1 to 65536".into());
        }
        before = stage.until;
    }
    Ok(())
}

/// Checks that the model's window holds those of all stages.
///
/// # Errors
/// Words that differ in length, whose windows have no number of frames; more frames than the model's window holds.
pub(super) fn validate_stages_for(stages: &[Stage], model: &ModelConfig, tokens: &TokenLayout) -> Result<()> {
    for (i, stage) in stages.iter().enumerate() {
        let frames = format!("train.stages: `frames` of stage {}", i + 1);
        if tokens.varying {
            let why =
                "the words of this tokenizer differ in length, so that windows have no number of frames; leave it out";
            return Err(Error::unsupported(frames, why));
        }
        let most = model.frames(tokens);
        if stage.frames > most {
            return Err(Error::invalid(
                frames,
                stage.frames,
                format!("{most} or less, the frames of the model's window"),
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn ordinal_loss_needs_bins_with_neighbours() {
        let train: TrainConfig = toml::from_str("loss = \"ordinal\"").unwrap();
        assert_eq!((train.smoothing(), TrainConfig::default().smoothing()), (Some(0.75), None));
        let model = ModelConfig::default();
        let without = TokenLayout { places: Vec::new(), ..fixture::TOKENS };
        assert!(train.validate_for(&model, &without).unwrap_err().to_string().contains("train.loss is ordinal"));
        TrainConfig::default().validate_for(&model, &without).unwrap();
    }
}
