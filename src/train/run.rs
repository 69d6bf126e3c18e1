//! The run folder: configuration, tokenizer and corpus description of a training run.

use super::augment::AugmentConfig;
use super::config::TrainConfig;
use super::data::{CorpusPart, Data, Part};
use crate::corpus::Corpus;
use crate::model::ahead::Ahead;
use crate::model::run::{CONFIG, LoadedRun, TOKENIZER, check_kind, load_tokenizer};
use crate::model::{ModelConfig, TokenLayout};
use crate::{Error, Result, files};
use kinelm_motion::format::input;
use kinelm_music::feature::rate_of;
use kinelm_tokenizer::Tokenizer;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The layout of `config.toml` that this program writes and reads.
const VERSION: u32 = 2;

/// `config.toml` of a run folder: every option resolved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunFile {
    /// The layout's version.
    pub version: u32,
    /// The version of kinelm that began the run.
    pub kinelm: String,
    /// The tokenizer's hash.
    pub tokenizer_sha256: String,
    /// The corpora, as they were.
    pub corpora: Vec<RunCorpus>,
    /// The model.
    pub model: ModelConfig,
    /// How it is trained.
    pub train: TrainConfig,
    /// How the motion is changed on the way.
    #[serde(default)]
    pub augment: AugmentConfig,
    /// What the tokenizer decided.
    pub tokens: TokenLayout,
    /// Where its first weights are from, if they weren't drawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<Origin>,
}

/// Where the first weights of a run are from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// The run's or exported folder.
    pub path: PathBuf,
    /// How many updates they had there.
    pub step: u64,
    /// SHA-256 of the weights as kinelm writes them.
    #[serde(default)]
    pub sha256: String,
}

/// A corpus of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunCorpus {
    /// Its folder.
    pub path: PathBuf,
    /// Its hash.
    pub sha256: String,
    /// How often a pass takes each of its windows.
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
        if model.ahead {
            Ahead::of(data.tokenizer())?;
        }
        let model = told_music(model, data)?;
        Ok(RunFile {
            version: VERSION,
            kinelm: env!("CARGO_PKG_VERSION").into(),
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
    pub fn imported(run: &LoadedRun, tokenizer: &Tokenizer) -> RunFile {
        RunFile {
            version: VERSION,
            kinelm: env!("CARGO_PKG_VERSION").into(),
            tokenizer_sha256: tokenizer.hash(),
            corpora: Vec::new(),
            augment: AugmentConfig::default(),
            model: run.config.resolved(&run.tokens),
            // it is done with what it was trained for elsewhere
            train: TrainConfig {
                conditions: run.conditions.clone(),
                steps: run.state.step.max(1),
                ..Default::default()
            },
            tokens: run.tokens.clone(),
            from: None,
        }
    }

    /// Puts the tokenizer and the descriptions of the corpora into the run folder: `corpus.json`, `corpus-2.json`, ...
    ///
    /// # Errors
    /// What the system refuses.
    pub fn put_beside(&self, run: &Path, data: &Data) -> Result<()> {
        for (i, part) in data.parts().iter().enumerate() {
            let from = part.corpus.dir().join("corpus.json");
            let description = input::bytes(&from).map_err(Error::io(&from))?;
            let name = if i == 0 { "corpus.json".into() } else { format!("corpus-{}.json", i + 1) };
            files::write_whole(&run.join(name), &description)?;
        }
        files::write_whole(&run.join(TOKENIZER), data.tokenizer().to_json().as_bytes())
    }

    /// Writes `config.toml`.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn write(&self, run: &Path) -> Result<()> {
        let text = toml::to_string(self).map_err(|e| Error::Call(format!("{CONFIG} can't be written: {e}")))?;
        files::write_whole(&run.join(CONFIG), text.as_bytes())
    }

    /// Reads the configuration of a run.
    ///
    /// # Errors
    /// No run there, another version, wrong keys.
    pub fn read(run: &Path) -> Result<RunFile> {
        let path = run.join(CONFIG);
        let text = input::text(&path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => {
                Error::file(run, "no config.toml", "a run folder", "leave --resume out to begin a run")
            }
            _ => Error::io(&path)(e),
        })?;
        let wrong = |e: toml::de::Error| {
            Error::in_text((&path, &text), e.span(), e.message(), "the configuration of a run", "")
        };
        check_kind(&path, &text)?;
        let head: Versioned = toml::from_str(&text).map_err(wrong)?;
        match head.version {
            VERSION => toml::from_str(&text).map_err(wrong),
            1 => of_version_1(&text).map_err(wrong),
            other => Err(Error::file(&path, format!("version {other}"), format!("version 1 or {VERSION}"), "")),
        }
    }

    /// Opens what the run at `run` was begun on; `corpora` are the folders if they lie elsewhere now.
    ///
    /// # Errors
    /// A run that was imported, which has none; another number of corpora, other corpora or weights, each with both; a tokenizer
    /// that is gone, damaged or another.
    pub fn data(&self, run: &Path, corpora: &[CorpusPart]) -> Result<Data> {
        if self.corpora.is_empty() {
            let (run, what) = (run.display(), "was imported, and has no training to go on with");
            return Err(Error::Call(format!(
                "{run} {what}; begin a run with its weights: finetune or pretrain --from it"
            )));
        }
        let own: Vec<CorpusPart> =
            self.corpora.iter().map(|c| CorpusPart { path: c.path.clone(), weight: c.weight }).collect();
        let parts = if corpora.is_empty() { &own } else { corpora };
        if parts.len() != own.len() || parts.iter().zip(&own).any(|(p, own)| p.weight != own.weight) {
            let weights = |p: &[CorpusPart]| p.iter().map(|p| p.weight.to_string()).collect::<Vec<_>>().join(", ");
            let (found, expected) = (weights(parts), weights(&own));
            let what =
                format!("corpora of the weights {found}; the run was begun on corpora of the weights {expected}");
            return Err(Error::Call(what));
        }
        let tokenizer = load_tokenizer(&run.join(TOKENIZER), &self.tokenizer_sha256)?;
        let open = |(p, own): (&CorpusPart, &RunCorpus)| {
            let corpus = Corpus::open(&p.path)?;
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

/// What tells how to read the rest.
#[derive(Deserialize)]
struct Versioned {
    version: u32,
}

/// A model that is told music its training clips have; what is told of its sound standardised by them, or as the weights that it
/// begins with have learned it.
fn told_music(model: ModelConfig, data: &Data) -> Result<ModelConfig> {
    let none = |what: &str| {
        let help = "and no training clip of the corpora has any; kinelm tokenize --music FOLDER keeps it";
        Err(Error::Call(format!("model.music asks for {what}, {help}")))
    };
    if model.music.has_beats() && !data.has_music() {
        return none("music");
    }
    if !model.music.has_features() {
        return Ok(ModelConfig { music_scale: None, ..model });
    }
    // a corpus of another rate has heard beats alone
    let rate = rate_of(data.tokenizer().fps());
    rate.map_err(|e| Error::Call(format!("model.music asks for what music sounds like: {e}")))?;
    let of_data = data.music_scale()?;
    match of_data {
        Some(_) => Ok(ModelConfig { music_scale: model.music_scale.or(of_data), ..model }),
        None => none("what music sounds like"),
    }
}

/// Version 1 knew one corpus.
fn of_version_1(text: &str) -> std::result::Result<RunFile, toml::de::Error> {
    let mut table: toml::Table = toml::from_str(text)?;
    let mut corpus = toml::Table::new();
    for (old, new) in [("corpus", "path"), ("corpus_sha256", "sha256")] {
        corpus.extend(table.remove(old).map(|value| (new.to_string(), value)));
    }
    corpus.insert("weight".into(), 1.0.into());
    table.insert("corpora".into(), vec![corpus].into());
    table.insert("version".into(), VERSION.into());
    table.try_into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::corpus::Split;
    use crate::train::fixture;
    use std::fs;

    #[test]
    fn a_run_of_one_corpus_of_the_layout_before_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let data = Data::one(fixture::corpus(dir.path(), &[(9, Split::Train)])).unwrap();
        let file = RunFile::new(&ModelConfig::default(), &TrainConfig::default(), &data).unwrap();
        file.write(dir.path()).unwrap();
        assert_eq!(RunFile::read(dir.path()).unwrap(), file);
        let path = dir.path().join(CONFIG);
        let text = fs::read_to_string(&path).unwrap();
        let (head, corpora) = text.split_once("[[corpora]]\n").unwrap();
        let (corpora, rest) = corpora.split_once("\n\n").unwrap();
        let corpora = corpora.replace("path", "corpus").replace("sha256", "corpus_sha256").replace("weight = 1.0", "");
        let old = format!("{corpora}\n{}\n{rest}", head.replace("version = 2", "version = 1"));
        fs::write(&path, old).unwrap();
        assert_eq!(RunFile::read(dir.path()).unwrap(), file);
        fs::write(&path, text.replace("version = 2", "version = 3")).unwrap();
        let message = RunFile::read(dir.path()).unwrap_err().to_string();
        assert!(message.ends_with("found version 3, expected version 1 or 2"), "{message}");
        fs::write(&path, text.replace("weight", "wait")).unwrap();
        let message = RunFile::read(dir.path()).unwrap_err().to_string();
        assert!(message.contains("config.toml:") && message.contains("wait"), "{message}");
    }
}
