//! Training files: `[model]`, `[train]`, `[augment]`, and the paths of corpus and run.

use super::augment::AugmentConfig;
use super::config::TrainConfig;
use super::data::CorpusPart;
use crate::{Error, Result};
use kinelm_model::ModelConfig;
use kinelm_store::{Subject, input, part, presets};
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
        let folder = part::folder_of(path);
        let corpora = file.corpora.iter_mut().map(|c| &mut c.path);
        for place in [&mut file.corpus, &mut file.run].into_iter().flatten().chain(corpora) {
            *place = folder.join(&place);
        }
        Ok(file)
    }

    /// An error of settings that don't fit a corpus, with their file.
    pub(crate) fn located(&self, error: Error) -> Error {
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
                return Err(Error::invalid_parameter("set", pair, expected));
            }
            if table.trim() == "model" {
                // a placeholder: the value is only known once the whole file is parsed again below
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
            Error::in_text(path, text, e.span(), in_words(e.message()), "a training file", help)
        };
        let mut file: TrainFile = toml::from_str(text).map_err(wrong)?;
        let table: toml::Table = toml::from_str(text).map_err(wrong)?;
        file.given = table.get("model").and_then(toml::Value::as_table).cloned().unwrap_or_default();
        file.validate().map_err(|e| in_file(path, e))?;
        Ok(file)
    }
}

/// An error of a key, with its file.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Schedule;
    use kinelm_model::HeadKind;

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
        assert!(said("[train]\nhistory_dropout = -1").contains("train.history_dropout is -1; expected 0 to 1"));
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
