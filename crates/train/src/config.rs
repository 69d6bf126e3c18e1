//! Training files: `[model]`, `[train]`, `[augment]`, and the paths of corpus and run.

use super::augment::AugmentConfig;
use super::data::CorpusPart;
use super::precision::Precision;
use super::schedule::Schedule;
use super::stages::{self, Stage};
use super::trainer::Cadence;
use crate::{Error, Result};
use kinelm_corpus::SpanMasking;
use kinelm_corpus::conditions::in_order;
use kinelm_model::{ModelConfig, ModelKind, TokenLayout};
use kinelm_store::{Subject, input, presets};
use kinelm_tokenizer::Tokenizer;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The built-in training files.
pub const TRAIN: &kinelm_store::presets::Presets = &[
    ("tiny", include_str!("../configs/tiny.toml")),
    ("small", include_str!("../configs/small.toml")),
    ("two-level", include_str!("../configs/two-level.toml")),
    ("thesis-26m", include_str!("../configs/thesis-26m.toml")),
    ("gpt2", include_str!("../configs/gpt2.toml")),
    ("finetune", include_str!("../configs/finetune.toml")),
    ("goal", include_str!("../configs/goal.toml")),
    ("tune", include_str!("../configs/tune.toml")),
    ("labels", include_str!("../configs/labels.toml")),
    ("demo", include_str!("../configs/demo.toml")),
    ("demo-music", include_str!("../configs/demo-music.toml")),
];

/// A key as a call sets it.
const EXAMPLE: &str = "train.batch=4";

/// A training TOML.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainFile {
    /// The corpus folder; in a file, relative to the file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub corpus: Option<PathBuf>,
    /// Several corpora instead, `[[corpora]]`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub corpora: Vec<CorpusPart>,
    /// The run folder; in a file, relative to the file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<PathBuf>,
    /// The model.
    pub model: ModelConfig,
    /// How it is trained.
    pub train: TrainConfig,
    /// How the motion is augmented.
    pub augment: AugmentConfig,
    /// The file, for messages.
    #[serde(skip)]
    pub path: Option<PathBuf>,
    /// The keys of `[model]` that the file gives.
    #[serde(skip)]
    pub given: toml::Table,
}

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
    /// Checkpoints that stay beside the best, 1 or more. Default 2.
    pub keep: usize,
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
    /// What is hidden in the windows of a masked model. Default `tokens`.
    #[serde(skip_serializing_if = "Masking::is_tokens")]
    pub masking: Masking,
    /// The shorter windows of the first steps. Default none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<Stage>,
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

/// What is hidden in the windows of a masked model.
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
    pub fn spans(self, tokenizer: &Tokenizer) -> Result<Option<SpanMasking>> {
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
            keep: 2,
            accumulate: 1,
            patience: 0,
            ema: 0.0,
            sample_every: 0,
            conditions: Vec::new(),
            label_dropout: 0.1,
            loss: Loss::CrossEntropy,
            ordinal_width: 0.75,
            precision: Precision::F32,
            gaps: 0.0,
            masking: Masking::Tokens,
            stages: Vec::new(),
        }
    }
}

impl TrainFile {
    /// The built-in training file of a name ([`TRAIN`]), else that of a path.
    ///
    /// # Errors
    /// Neither of them; those of [`TrainFile::load`].
    ///
    /// ```
    /// let file = kinelm_train::TrainFile::find("tiny".as_ref())?;
    /// assert_eq!(file.train.accumulate, 1);
    /// # kinelm_train::Result::Ok(())
    /// ```
    pub fn find(name_or_path: &Path) -> Result<TrainFile> {
        match presets::find(TRAIN, name_or_path, "training file")? {
            Some(text) => TrainFile::parse(text, name_or_path),
            None => TrainFile::load(name_or_path),
        }
    }

    /// Reads a training file. Its paths are relative to its folder.
    ///
    /// # Errors
    /// A file that can't be read; keys that are unknown (with line and column) or outside their limits.
    pub fn load(path: &Path) -> Result<TrainFile> {
        let text = input::text(path).map_err(|e| match e.kind() {
            std::io::ErrorKind::InvalidData => Error::file(path, "bytes that are no text", "a training TOML", ""),
            _ => Error::io(path)(e),
        })?;
        let mut file = TrainFile { path: Some(path.to_owned()), ..TrainFile::parse(&text, path)? };
        let folder = kinelm_store::files::folder_of(path);
        let corpora = file.corpora.iter_mut().map(|c| &mut c.path);
        for place in [&mut file.corpus, &mut file.run].into_iter().flatten().chain(corpora) {
            *place = folder.join(&place);
        }
        Ok(file)
    }

    /// An error of settings that don't fit a corpus, with the file that they stand in.
    pub fn located(&self, error: Error) -> Error {
        match &self.path {
            Some(path) => in_file(path, error),
            None => error,
        }
    }

    /// The corpora of the file, from `corpus` or `[[corpora]]`.
    ///
    /// # Errors
    /// Both of them.
    pub fn corpora(&self) -> Result<Vec<CorpusPart>> {
        match &self.corpus {
            Some(corpus) if self.corpora.is_empty() => Ok(vec![CorpusPart::once(corpus)]),
            Some(_) => Err(Error::unsupported("corpus and [[corpora]]", "a file has one of them")),
            None => Ok(self.corpora.clone()),
        }
    }

    /// The file with keys set over its own, each written as `TABLE.KEY=VALUE`: `train.batch=4`, `model.layers=6`.
    ///
    /// # Errors
    /// Another table than `model`, `train` and `augment`; an unknown key; a value of another type or outside its limits.
    ///
    /// ```
    /// # use kinelm_train::TrainFile;
    /// let file = TrainFile::find("tiny".as_ref())?.with_keys(&["train.batch=4".into(), "model.dropout=0".into()])?;
    /// assert_eq!((file.train.batch, file.model.dropout), (4, 0.0));
    /// # kinelm_train::Result::Ok(())
    /// ```
    pub fn with_keys(&self, set: &[String]) -> Result<TrainFile> {
        if set.is_empty() {
            return Ok(self.clone());
        }
        let mut given = self.given.clone();
        for pair in set {
            let (table, key) = pair.split('=').next().unwrap_or_default().split_once('.').unwrap_or_default();
            if !["model", "train", "augment"].contains(&table.trim()) {
                let expected = format!("a key of [model], [train] or [augment], such as {EXAMPLE}");
                return Err(Error::invalid("`set`", pair, expected));
            }
            if table.trim() == "model" {
                given.insert(key.split('.').next().unwrap_or_default().trim().into(), true.into());
            }
        }
        let file: TrainFile = presets::with_keys(self, set, EXAMPLE)?;
        file.validate().map_err(in_set)?;
        let model = toml::Table::try_from(&file.model).unwrap_or_default();
        given
            .iter_mut()
            .filter_map(|(key, value)| Some((value, model.get(key)?)))
            .for_each(|(value, own)| *value = own.clone());
        Ok(TrainFile { path: self.path.clone(), given, ..file })
    }

    /// Checks every key.
    fn validate(&self) -> Result<()> {
        self.model.validate()?;
        self.train.validate()?;
        self.augment.validate()?;
        self.corpora()?.iter().try_for_each(CorpusPart::validate)
    }

    /// Parses the text of a training file; `path` is for messages. Paths stay as they are.
    ///
    /// # Errors
    /// As [`TrainFile::load`].
    ///
    /// ```
    /// # use kinelm_train::TrainFile;
    /// let file = TrainFile::parse("[train]\nsteps = 500\nbatch = 8", "small.toml".as_ref())?;
    /// assert_eq!((file.train.steps, file.train.batch), (500, 8));
    /// assert!(TrainFile::parse("[train]\nstep = 500", "small.toml".as_ref()).is_err());
    /// # kinelm_train::Result::Ok(())
    /// ```
    pub fn parse(text: &str, path: &Path) -> Result<TrainFile> {
        let wrong = |e: toml::de::Error| {
            let help = "configs/train/ has examples with every key";
            Error::in_text((path, text), e.span(), in_words(e.message()), "a training file", help)
        };
        let mut file: TrainFile = toml::from_str(text).map_err(wrong)?;
        let table: toml::Table = toml::from_str(text).map_err(wrong)?;
        file.given = table.get("model").and_then(toml::Value::as_table).cloned().unwrap_or_default();
        file.validate().map_err(|e| in_file(path, e))?;
        Ok(file)
    }
}

/// An error of a key, with the file that it stands in.
pub fn in_file(path: &Path, error: Error) -> Error {
    about(error, |key| key.in_file(path))
}

/// An error of a key that a call sets, which is at fault then.
pub fn in_set(error: Error) -> Error {
    about(error, |key| Subject::of_parameter("set").with(key))
}

/// An error about something else.
fn about(error: Error, subject: impl FnOnce(Subject) -> Subject) -> Error {
    use kinelm_store::Error as Store;
    match error {
        Error::Store(Store::Invalid { name, found, expected }) => Error::invalid(subject(name), found, expected),
        Error::Store(Store::Unsupported { what, why }) => Error::unsupported(subject(what), why),
        error => error,
    }
}

/// The TOML parser's names of types without Rust's.
fn in_words(message: &str) -> String {
    let whole = ["usize", "u64", "u32"].iter().fold(message.to_string(), |text, kind| {
        text.replace(&format!("expected {kind}"), "expected a whole number, 0 or more")
    });
    whole.replace("expected f64", "expected a number")
}

impl TrainConfig {
    /// How often the training loop measures and saves.
    pub(crate) fn cadence(&self) -> Cadence {
        let TrainConfig { steps, eval_every, checkpoint_every, keep, .. } = *self;
        Cadence { steps, eval_every, checkpoint_every, keep }
    }

    /// Whether `train.patience` measurements up to `step` were no better than that after step `best`.
    pub fn is_patience_out(&self, step: u64, best: Option<u64>) -> bool {
        let measured = |step: u64| step / self.eval_every.max(1);
        self.patience > 0 && best.is_some_and(|best| measured(step) >= measured(best) + self.patience)
    }

    /// Deviation of smoothed targets, in bins; `None`: targets aren't smoothed.
    pub fn smoothing(&self) -> Option<f64> {
        (self.loss == Loss::Ordinal).then_some(self.ordinal_width)
    }

    /// Checks every key, alone and against the model and its tokens.
    ///
    /// # Errors
    /// As [`Self::validate`]; `ordinal` for words whose slots have no bins of one kind each; those of
    /// [`stages::validate_for`].
    pub fn validate_for(&self, model: &ModelConfig, tokens: &TokenLayout) -> Result<()> {
        self.validate()?;
        stages::validate_for(&self.stages, model, tokens)?;
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
        number(self.learning_rate > 0.0, "learning_rate", self.learning_rate, "a number above 0")?;
        number((0.0..=1.0).contains(&self.final_share), "final_share", self.final_share, "0 to 1")?;
        for beta in self.betas {
            number((0.0..1.0).contains(&beta), "betas", beta, "0 up to below 1")?;
        }
        number(self.epsilon > 0.0, "epsilon", self.epsilon, "a number above 0")?;
        number(self.weight_decay >= 0.0, "weight_decay", self.weight_decay, "0 or more")?;
        let table_rate = self.table_rate > 0.0 && self.table_rate <= 100.0;
        number(table_rate, "table_rate", self.table_rate, "a number above 0 and at most 100")?;
        stages::validate(&self.stages)?;
        number(self.clip_norm >= 0.0, "clip_norm", self.clip_norm, "0 (no limit) or more")?;
        let width = (0.0..=100.0).contains(&self.ordinal_width) && self.ordinal_width > 0.0;
        number(width, "ordinal_width", self.ordinal_width, "a number above 0 and at most 100")?;
        // TOML has no larger integers
        check(self.seed <= i64::MAX as u64, "seed", self.seed.to_string(), "at most 9223372036854775807")?;
        check(self.keep >= 1, "keep", self.keep.to_string(), "1 or more")?;
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
        number((0.0..=1.0).contains(&self.label_dropout), "label_dropout", self.label_dropout, "0 to 1")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;
    use kinelm_model::HeadKind;

    #[test]
    fn ordinal_loss_needs_bins_with_neighbours() {
        let train: TrainConfig = toml::from_str("loss = \"ordinal\"").unwrap();
        assert_eq!((train.smoothing(), TrainConfig::default().smoothing()), (Some(0.75), None));
        let model = ModelConfig::default();
        let without = TokenLayout { places: Vec::new(), ..fixture::TOKENS };
        assert!(train.validate_for(&model, &without).unwrap_err().to_string().contains("train.loss is ordinal"));
        TrainConfig::default().validate_for(&model, &without).unwrap();
    }

    #[test]
    fn built_in_files_are_valid_and_have_the_promised_sizes() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
        let load = |name: &str| TrainFile::load(&folder.join(name)).unwrap().model;
        let [tiny, small, thesis, gpt2] = ["tiny.toml", "small.toml", "thesis-26m.toml", "gpt2.toml"].map(load);
        assert_eq!((tiny.previous_frame, tiny.head), (None, None));
        assert_eq!((thesis.previous_frame, thesis.head), (Some(false), Some(HeadKind::Absolute)));
        assert_eq!((gpt2.layers, gpt2.width, gpt2.heads, gpt2.context), (12, 768, 12, 1024));
        assert_eq!((gpt2.previous_frame, gpt2.head), (Some(false), Some(HeadKind::Absolute)));
        assert_eq!((tiny.layers, tiny.width, tiny.heads, tiny.context), (4, 128, 4, 256));
        assert_eq!((small.layers, small.width, small.heads, small.context), (6, 256, 8, 1024));
        let fine = TrainFile::load(&folder.join("finetune.toml")).unwrap();
        assert_eq!((fine.train.patience, fine.augment.mirror), (5, 0.5));
        assert_eq!((thesis.layers, thesis.width, thesis.heads, thesis.context), (8, 512, 8, 1024));
    }

    #[test]
    fn wrong_keys_are_named_where_they_stand() {
        let said = |text: &str| TrainFile::parse(text, Path::new("a.toml")).unwrap_err().to_string();
        let message = said("[train]\nbatch = 4\nstep = 3\n");
        assert!(message.starts_with("a.toml:3:1: found unknown field `step`"), "{message}");
        assert!(said("[train]\nlearning_rate = nan").contains("train.learning_rate is NaN; expected a number above 0"));
        assert!(said("[train]\nbetas = [0.9, 1.0]").contains("train.betas is 1; expected 0 up to below 1"));
        assert!(said("[train]\npatience = 2\neval_every = 0").contains("train.patience is 2; expected 0 where"));
        assert!(said("[train]\nema = 1.0").contains("train.ema is 1; expected 0 (none) up to below 1"));
        assert!(said("[train]\naccumulate = 0").contains("train.accumulate is 0; expected 1 to 65536"));
        assert!(
            said("[train]\nconditions = [\"a\", \"a\"]")
                .contains("train.conditions is a, a; expected every field once")
        );
        assert!(said("[train]\ngaps = -0.5").contains("train.gaps is -0.5; expected 0 to 1"));
        assert!(said("[train]\nlabel_dropout = 2").contains("train.label_dropout is 2; expected 0 to 1"));
        assert!(said("[model]\nlayers = 0").contains("model.layers is 0"));
        let message = said("[train]\nordinal_width = 0.0");
        assert!(message.contains("train.ordinal_width is 0; expected a number above 0 and at most 100"), "{message}");
        assert!(said("[model").starts_with("a.toml:1:"));
        assert!(said("[augment]\nmirror = 1.5").contains("augment.mirror is 1.5; expected 0 to 1"));
        assert!(said("[augment]\nspeed = nan").contains("augment.speed is NaN; expected 0 to 0.5"));
        assert!(said("corpus = \"a\"\n[[corpora]]\npath = \"b\"").contains("corpus and [[corpora]]"));
        assert!(said("[[corpora]]\npath = \"b\"\nweight = 0").contains("the weight of b is 0; expected 0.001 to 1000"));
    }

    #[test]
    fn keys_are_set_over_those_of_a_file() {
        let file = TrainFile::parse("[model]\nlayers = 2\n[train]\nbatch = 8\nsteps = 9", Path::new("a.toml")).unwrap();
        let set = |pairs: &[&str]| file.with_keys(&pairs.iter().map(|pair| pair.to_string()).collect::<Vec<_>>());
        let found = set(&["train.batch=4", "train.schedule=constant", "model.width=64", "augment.mirror=0.5"]).unwrap();
        assert_eq!((found.train.batch, found.train.steps, found.train.schedule), (4, 9, Schedule::Constant));
        assert_eq!((found.model.layers, found.model.width, found.augment.mirror), (2, 64, 0.5));
        // what finetune holds to the weights' shape
        let given: Vec<_> = found.given.iter().map(|(key, value)| (&**key, value.as_integer().unwrap())).collect();
        assert_eq!(given, [("layers", 2), ("width", 64)]);
        assert_eq!(set(&[]).unwrap(), file);
        for (pair, says) in [
            ("train.batch=0", "`set` train.batch is 0; expected 1 to 65536"),
            ("train.batch=many", "`set` train.batch=many: invalid type: string"),
            ("train.stepz=5", "`set` train.stepz=5: unknown field stepz, expected one of batch"),
            ("train.batch", "`set` is train.batch; expected KEY=VALUE, such as train.batch=4"),
            ("batch=4", "`set` is batch=4; expected a key of [model], [train] or [augment]"),
            ("run=x", "`set` is run=x; expected a key of"),
        ] {
            let e = set(&[pair]).unwrap_err();
            assert!(e.to_string().starts_with(says) && e.kind() == kinelm_store::Kind::Call, "{e}");
        }
    }

    #[test]
    fn paths_are_relative_to_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.toml");
        std::fs::write(&path, "[[corpora]]\npath = \"a\"\n[[corpora]]\npath = \"/b\"\nweight = 0.5").unwrap();
        let parts = [(dir.path().join("a"), 1.0), ("/b".into(), 0.5)];
        let parts = parts.map(|(path, weight)| CorpusPart { path, weight });
        assert_eq!(TrainFile::load(&path).unwrap().corpora().unwrap(), parts);
        std::fs::write(&path, "corpus = \"c\"\nrun = \"/r\"\n").unwrap();
        let file = TrainFile::load(&path).unwrap();
        assert_eq!(file.corpora().unwrap(), [CorpusPart::once(dir.path().join("c"))]);
        assert_eq!(file.corpus.unwrap(), dir.path().join("c"));
        assert_eq!(file.run.unwrap(), Path::new("/r"));
    }
}
