//! The run folder: configuration, tokenizer and corpus description of a training run.

use super::augment::AugmentConfig;
use super::config::TrainConfig;
use super::data::{CorpusPart, Data, Part};
use crate::{Error, Result};
use kinelm_corpus::{Corpus, CorpusOptions};
use kinelm_model::goal::GoalEncoder;
use kinelm_model::run::{CONFIG, LoadedRun, TOKENIZER, check_kind, load_tokenizer};
use kinelm_model::{ModelConfig, TokenLayout, weights};
use kinelm_music::feature::rate_of;
use kinelm_store::output::is_same;
use kinelm_store::{FileRecord, files, input};
use kinelm_tokenizer::Tokenizer;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The layout of `config.toml` that this program writes and reads.
const VERSION: u32 = 6;

/// `config.toml` of a run folder: every option resolved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunFile {
    /// The layout's version.
    pub version: u32,
    /// The tokenizer's hash.
    pub tokenizer_sha256: String,
    /// The corpora.
    pub corpora: Vec<RunCorpus>,
    /// The model.
    pub model: ModelConfig,
    /// How it is trained.
    pub train: TrainConfig,
    /// How the motion is augmented.
    #[serde(default)]
    pub augment: AugmentConfig,
    /// The layout of its tokens.
    pub tokens: TokenLayout,
    /// The origin of its first weights, unless they are random.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<Origin>,
}

/// The origin of a run's first weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// A run or an exported folder; in the file, relative to the run.
    pub path: PathBuf,
    /// Their updates.
    pub step: u64,
    /// SHA-256 of the weights as kinelm writes them.
    #[serde(default)]
    pub sha256: String,
}

/// A corpus of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunCorpus {
    /// Its folder; in the file, relative to the run.
    pub path: PathBuf,
    /// Its hash.
    pub sha256: String,
    /// How many times a pass takes each of its windows.
    pub weight: f64,
}

impl RunCorpus {
    fn of(part: &Part) -> Result<RunCorpus> {
        let dir = part.corpus.dir();
        let path = std::path::absolute(dir).map_err(Error::io(dir))?;
        Ok(RunCorpus { path, sha256: part.corpus.hash().into(), weight: part.weight })
    }
}

impl RunFile {
    /// The configuration of a new run on `data`.
    ///
    /// # Errors
    /// Keys outside their limits, a context too short for the corpora's words, a corpus path that can't be made absolute.
    pub fn new(model: &ModelConfig, train: &TrainConfig, data: &Data) -> Result<RunFile> {
        let tokens = data.tokens();
        model.validate()?;
        let model = model.resolved(&tokens);
        model.validate_for(&tokens)?;
        train.validate_for(&model, &tokens)?;
        if model.goal {
            GoalEncoder::of(data.tokenizer())?;
        }
        let model = with_music_scale(model, data)?;
        Ok(RunFile {
            version: VERSION,
            tokenizer_sha256: data.tokenizer().hash(),
            corpora: data.parts().iter().map(RunCorpus::of).collect::<Result<_>>()?,
            model,
            train: train.clone(),
            augment: AugmentConfig::default(),
            tokens,
            from: None,
        })
    }

    /// The configuration of a run whose model was trained elsewhere: it has no corpora.
    pub(crate) fn imported(run: &LoadedRun, tokenizer: &Tokenizer) -> RunFile {
        RunFile {
            version: VERSION,
            tokenizer_sha256: tokenizer.hash(),
            corpora: Vec::new(),
            augment: AugmentConfig::default(),
            model: run.config.resolved(&run.tokens),
            // its steps are done
            train: TrainConfig {
                conditions: run.conditions.clone(),
                steps: run.state.step.max(1),
                ..Default::default()
            },
            tokens: run.tokens.clone(),
            from: None,
        }
    }

    /// Sets the corpora's present paths. Returns whether one of them has moved.
    ///
    /// # Errors
    /// A corpus path that can't be made absolute.
    pub(crate) fn found_at(&mut self, data: &Data) -> Result<bool> {
        let found = data.parts().iter().map(RunCorpus::of).collect::<Result<Vec<_>>>()?;
        let elsewhere = |(old, new): (&RunCorpus, &RunCorpus)| !is_same(&old.path, &new.path);
        let moved = self.corpora.iter().zip(&found).any(elsewhere);
        self.corpora = found;
        Ok(moved)
    }

    /// Copies the tokenizer and the manifests of the corpora into the run folder: `corpus.json`, `corpus-2.json`, ...
    ///
    /// # Errors
    /// I/O errors.
    pub(crate) fn put_beside(&self, run: &Path, data: &Data) -> Result<()> {
        for (i, part) in data.parts().iter().enumerate() {
            let from = part.corpus.dir().join("corpus.json");
            let description = input::bytes(&from).map_err(Error::io(&from))?;
            let name = if i == 0 { "corpus.json".into() } else { format!("corpus-{}.json", i + 1) };
            files::write_whole(&run.join(name), &description)?;
        }
        Ok(files::write_whole(&run.join(TOKENIZER), data.tokenizer().to_json().as_bytes())?)
    }

    /// With other paths of corpora and origin.
    fn with_paths(&self, path: impl Fn(&Path) -> PathBuf) -> RunFile {
        let mut file = self.clone();
        let origin = file.from.iter_mut().map(|from| &mut from.path);
        file.corpora.iter_mut().map(|corpus| &mut corpus.path).chain(origin).for_each(|one| *one = path(one));
        file
    }

    /// Writes `config.toml`.
    ///
    /// # Errors
    /// I/O errors.
    pub fn write(&self, run: &Path) -> Result<()> {
        let file = self.with_paths(|path| files::path_from(run, path));
        let text = toml::to_string(&file).expect("a run's configuration is TOML");
        Ok(files::write_whole(&run.join(CONFIG), text.as_bytes())?)
    }

    /// Reads the configuration of a run.
    ///
    /// # Errors
    /// No run there, another version, wrong keys.
    pub fn read(run: &Path) -> Result<RunFile> {
        let path = run.join(CONFIG);
        let text = input::text(&path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => Error::file(run, "no config.toml", "a run folder", "start one first"),
            _ => Error::io(&path)(e),
        })?;
        let wrong =
            |e: toml::de::Error| Error::in_text(&path, &text, e.span(), e.message(), "the configuration of a run", "");
        check_kind(&path, &text)?;
        // the version first, since keys of another one would be refused as unknown
        let head: Versioned = toml::from_str(&text).map_err(wrong)?;
        if head.version != VERSION {
            let help = "take the kinelm that wrote it, or begin a new run";
            return Err(Error::file(&path, format!("version {}", head.version), format!("version {VERSION}"), help));
        }
        let file: RunFile = toml::from_str(&text).map_err(wrong)?;
        Ok(file.with_paths(|path| files::path_in(run, path)))
    }

    /// Opens the data that the run at `run` was begun on; `corpora` are the folders if they have moved.
    ///
    /// # Errors
    /// An imported run, which has none; another number of corpora, other corpora or weights; a tokenizer that is gone, damaged
    /// or another.
    pub fn data(&self, run: &Path, corpora: &[CorpusPart], opening: CorpusOptions) -> Result<Data> {
        if self.corpora.is_empty() {
            let why = "was imported, and has no training to resume; begin a new run `from` it";
            return Err(Error::unsupported_parameter("resume", format!("{} {why}", run.display())));
        }
        let own: Vec<CorpusPart> =
            self.corpora.iter().map(|c| CorpusPart { path: c.path.clone(), weight: c.weight }).collect();
        let parts = if corpora.is_empty() { &own } else { corpora };
        if parts.len() != own.len() || parts.iter().zip(&own).any(|(p, own)| p.weight != own.weight) {
            let weights = |p: &[CorpusPart]| p.iter().map(|p| p.weight.to_string()).collect::<Vec<_>>().join(", ");
            let found = format!("of the weights {}", weights(parts));
            let expected = format!("the weights {}, as the run was begun", weights(&own));
            return Err(Error::invalid_parameter("corpora", found, expected));
        }
        let tokenizer = load_tokenizer(&run.join(TOKENIZER), &self.tokenizer_sha256)?;
        let open = |(p, own): (&CorpusPart, &RunCorpus)| {
            let corpus = Corpus::open_with(&p.path, opening)?;
            match corpus.hash() == own.sha256 {
                true => Ok(Part { corpus, weight: p.weight }),
                false => Err(Error::file(
                    corpus.dir(),
                    format!("a corpus with hash {}", corpus.hash()),
                    format!("the run's, {}", own.sha256),
                    "begin a new run on another corpus",
                )),
            }
        };
        let parts = parts.iter().zip(&self.corpora).map(open).collect::<Result<_>>()?;
        let data = Data::of(parts, Some(&tokenizer), &self.train.conditions)?;
        match data.tokenizer().hash() == self.tokenizer_sha256 {
            true => Ok(data),
            false => Err(Error::file(
                run,
                format!("labels that make tokenizer {}", data.tokenizer().hash()),
                format!("those of the run's, {}", self.tokenizer_sha256),
                "put back the files that the run was begun with",
            )),
        }
    }
}

/// The version of a configuration.
#[derive(Deserialize)]
struct Versioned {
    version: u32,
}

/// The model with its music features standardised over the training clips, or as the weights that it begins with.
fn with_music_scale(model: ModelConfig, data: &Data) -> Result<ModelConfig> {
    let none = |what: &str| {
        let help = "model.music needs it, and no training clip of the corpora has any; kinelm tokenize with `music`";
        Err(Error::missing(what, help))
    };
    if model.music.has_beats() && !data.has_music() {
        return none("music");
    }
    if !model.music.has_features() {
        return Ok(ModelConfig { music_scale: None, ..model });
    }
    // corpora of other rates store beats alone
    rate_of(data.tokenizer().fps())?;
    let of_data = data.music_scale()?;
    match of_data {
        // a fine-tuned model stays with the scale that its weights have learned
        Some(_) => Ok(ModelConfig { music_scale: model.music_scale.or(of_data), ..model }),
        None => none("music features"),
    }
}

/// The origin of weights out of a run or an exported folder.
///
/// # Errors
/// A path that can't be made absolute.
pub(crate) fn origin(from: &Path, source: &LoadedRun) -> Result<Origin> {
    let bytes = weights::to_bytes(&source.weights)?;
    let path = std::path::absolute(from).map_err(Error::io(from))?;
    Ok(Origin { path, step: source.state.step, sha256: FileRecord::of(&bytes).sha256 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;
    use kinelm_corpus::Split;
    use std::fs;

    #[test]
    fn a_run_and_its_corpus_can_be_moved_together() {
        let dir = tempfile::tempdir().unwrap();
        let (old, new) = (dir.path().join("old"), dir.path().join("new"));
        fs::create_dir_all(old.join("run")).unwrap();
        let data = Data::one(fixture::corpus(&old, &[(9, Split::Train)])).unwrap();
        let file = RunFile::new(&ModelConfig::default(), &TrainConfig::default(), &data).unwrap();
        file.write(&old.join("run")).unwrap();
        assert_eq!(RunFile::read(&old.join("run")).unwrap().corpora[0].sha256, file.corpora[0].sha256);
        let text = fs::read_to_string(old.join("run").join(CONFIG)).unwrap();
        assert!(!text.contains("old") && text.contains("path = \"../"), "{text}");
        fs::rename(&old, &new).unwrap();
        let moved = RunFile::read(&new.join("run")).unwrap();
        assert!(Corpus::open(&moved.corpora[0].path).is_ok(), "{moved:?}");
        moved.write(&new.join("run")).unwrap();
        assert_eq!(fs::read_to_string(new.join("run").join(CONFIG)).unwrap(), text);
    }

    #[test]
    fn another_version_and_wrong_keys_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let data = Data::one(fixture::corpus(dir.path(), &[(9, Split::Train)])).unwrap();
        let file = RunFile::new(&ModelConfig::default(), &TrainConfig::default(), &data).unwrap();
        file.write(dir.path()).unwrap();
        let path = dir.path().join(CONFIG);
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, text.replace("version = 6", "version = 2")).unwrap();
        let message = RunFile::read(dir.path()).unwrap_err().to_string();
        assert!(message.contains("found version 2, expected version 6"), "{message}");
        fs::write(&path, text.replace("weight", "wait")).unwrap();
        let message = RunFile::read(dir.path()).unwrap_err().to_string();
        assert!(message.contains("config.toml:") && message.contains("wait"), "{message}");
    }
}
