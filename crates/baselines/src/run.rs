//! The run folder of an LSTM: `config.toml`, and the weights of a checkpoint.

use crate::{Error, Result};
use kinelm_engine::arena::Floats;
use kinelm_model::checkpoint::{CheckpointChoice, Checkpoints, Keep};
use kinelm_model::layout::Parameter;
use kinelm_model::run::{CONFIG, WEIGHTS};
use kinelm_model::weights;
use kinelm_store::presets::{self, Presets};
use kinelm_store::{FileRecord, files, input};
use kinelm_train::Branch;
use kinelm_train::folder::RunFolder;
use kinelm_train::run::Origin;
use kinelm_train::train_file::{in_file, in_set};
use kinelm_train::trainer::check_steps;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// A kind of run.
#[derive(Debug, Clone, Copy)]
pub struct Kind {
    /// `kind` in `config.toml`.
    pub name: &'static str,
    /// For messages, such as "one of an auto-conditioned LSTM".
    pub one_of: &'static str,
    /// The command that makes such runs.
    pub command: &'static str,
    /// The layout of `config.toml` that this program writes and reads.
    pub version: u32,
}

/// Settings of a network, in a file or built in.
pub trait Settings: Serialize + DeserializeOwned + Clone + PartialEq {
    /// The built-in settings.
    const PRESETS: &'static Presets;
    /// Their folder in configs/, and what they are.
    const FOLDER: (&'static str, &'static str);
    /// The keys that a run may change when it is resumed.
    const RESUMABLE: &'static [&'static str];

    /// Checks every key.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] for the first key outside its limits.
    fn validate(&self) -> Result<()>;

    /// The built-in settings of a name, else those of a TOML file.
    ///
    /// # Errors
    /// Neither of them; a file that can't be read; keys that are unknown or outside their limits.
    fn find(name_or_path: &Path) -> Result<Self> {
        let (folder, what) = Self::FOLDER;
        let settings: Self = presets::read(Self::PRESETS, name_or_path, folder, what)?;
        settings.validate().map_err(|e| in_file(name_or_path, e))?;
        Ok(settings)
    }

    /// The settings with keys set over their own, each written as `KEY=VALUE`.
    ///
    /// # Errors
    /// Keys that are unknown, values of another type or outside their limits.
    fn with_keys(&self, set: &[String]) -> Result<Self> {
        let settings = presets::with_keys(self, set, "checkpoint_every=500")?;
        Self::validate(&settings).map_err(in_set)?;
        Ok(settings)
    }
}

/// Checks that a key is within its limits.
///
/// # Errors
/// [`kinelm_store::Error::Invalid`] if it isn't.
pub(crate) fn within<T: PartialOrd + Display>(key: &'static str, found: T, limits: RangeInclusive<T>) -> Result<()> {
    match limits.contains(&found) {
        true => Ok(()),
        false => Err(Error::invalid(key, found, format!("{} to {}", limits.start(), limits.end()))),
    }
}

/// Checks that a key is a number above 0.
///
/// # Errors
/// [`kinelm_store::Error::Invalid`] if it isn't.
pub(crate) fn positive(key: &'static str, found: f64) -> Result<()> {
    match found > 0.0 && found.is_finite() {
        true => Ok(()),
        false => Err(Error::invalid(key, found, "a number above 0")),
    }
}

/// Checks the number of checkpoints that stay.
///
/// # Errors
/// [`kinelm_store::Error::Invalid`] for none.
pub(crate) fn keep(found: Keep) -> Result<()> {
    match found.is_valid() {
        true => Ok(()),
        false => Err(Error::invalid("keep", found, "1 or more, or \"all\"")),
    }
}

/// Checks the weight of a part of a loss.
///
/// # Errors
/// [`kinelm_store::Error::Invalid`] for one below 0, or no number.
pub(crate) fn weight(key: &'static str, found: f64) -> Result<()> {
    match found >= 0.0 && found.is_finite() {
        true => Ok(()),
        false => Err(Error::invalid(key, found, "0 or a number above it")),
    }
}

/// What changes when a run is resumed.
#[derive(Debug, Clone, Default)]
pub struct Changes {
    /// Keys of its settings, each as `learning_rate=1e-4`; those of [`Settings::RESUMABLE`].
    pub set: Vec<String>,
    /// Updates in all, over those of `set`.
    pub steps: Option<u64>,
    /// The earlier checkpoint that it goes on from, as a new run.
    pub branch: Option<Branch>,
}

/// Why other settings stay.
const WHY: &str = "weights, optimizer and sequences depend on it, so a resumed run keeps it; begin a new run";

/// `config.toml` of a run.
pub trait RunConfig: Serialize + DeserializeOwned + Clone {
    /// Its settings.
    type Config: Settings;

    /// The kind of run.
    const KIND: Kind;

    /// The same with other paths.
    fn with_paths(&self, path: &dyn Fn(&Path) -> PathBuf) -> Self;

    /// The settings.
    fn config(&mut self) -> &mut Self::Config;

    /// Updates in all.
    fn steps(config: &mut Self::Config) -> &mut u64;

    /// The run that it goes on from.
    fn from(&mut self) -> &mut Option<Origin>;

    /// A run to continue with changes, as they say in its folder or in a new one, and what `load` reads for its training.
    /// Nothing is written before that.
    ///
    /// # Errors
    /// No run there, or a folder of the new one that exists; a key that stays, a value outside its limits, fewer updates than
    /// are done; those of `load`; what the system refuses.
    fn resume<T>(run: &Path, changes: &Changes, load: impl FnOnce(&Self) -> Result<T>) -> Result<(RunFolder, Self, T)> {
        let mut file;
        let (folder, data) = match &changes.branch {
            None => {
                let folder = RunFolder::open(run)?;
                file = Self::read(run)?;
                let differs = file.change(run, changes)?;
                let data = load(&file)?;
                if differs {
                    file.write(run)?;
                }
                (folder, data)
            }
            Some(branch) => {
                file = Self::read(run)?;
                file.change(run, changes)?;
                let data = load(&file)?;
                let (folder, origin) = branch.begin(run)?;
                *file.from() = Some(origin);
                // last: a folder with it is a run
                file.write(folder.path())?;
                (folder, data)
            }
        };
        Ok((folder, file, data))
    }

    /// Writes it; paths are relative to the run.
    ///
    /// # Errors
    /// What the system refuses.
    fn write(&self, run: &Path) -> Result<()> {
        // relative paths, so that a run can be moved together with its data
        let file = self.with_paths(&|path| files::path_from(run, path));
        let text = toml::to_string(&file).expect("a run's configuration is TOML");
        Ok(files::write_whole(&run.join(CONFIG), text.as_bytes())?)
    }

    /// Reads that of a run.
    ///
    /// # Errors
    /// A folder without one, a run of another kind, another version, keys that are wrong.
    fn read(run: &Path) -> Result<Self> {
        #[derive(Deserialize)]
        struct Head {
            kind: Option<String>,
            version: u32,
        }
        let (path, kind) = (run.join(CONFIG), Self::KIND);
        let help = format!("a run of this kind is a folder that `{} --run RUN` wrote", kind.command);
        let text = input::text(&path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => Error::file(run, format!("no {CONFIG}"), "a run folder", help.clone()),
            _ => Error::io(&path)(e),
        })?;
        let wrong =
            |e: toml::de::Error| Error::in_text(&path, &text, e.span(), e.message(), "the settings of a run", "");
        // kind and version first, or another kind's keys would be reported as unknown
        let head: Head = toml::from_str(&text).map_err(wrong)?;
        if head.kind.as_deref() != Some(kind.name) {
            let found = head.kind.map_or("a run of a GPT".into(), |kind| format!("a run of kind {kind:?}"));
            return Err(Error::file(&path, found, kind.one_of, help));
        }
        if head.version != kind.version {
            let (found, expected) = (format!("version {}", head.version), format!("version {}", kind.version));
            return Err(Error::file(&path, found, expected, "take the kinelm that wrote it"));
        }
        let mut file: Self = toml::from_str(&text).map_err(wrong)?;
        file.config().validate().map_err(|e| in_file(&path, e))?;
        Ok(file.with_paths(&|path| files::path_in(run, path)))
    }

    /// Changes the settings. Returns whether they differ.
    ///
    /// # Errors
    /// A key that stays, a value outside its limits, fewer updates than are done.
    fn change(&mut self, run: &Path, changes: &Changes) -> Result<bool> {
        presets::check_keys(&changes.set, Self::Config::RESUMABLE, WHY)?;
        let mut config = self.config().with_keys(&changes.set)?;
        let steps = Self::steps(&mut config);
        *steps = changes.steps.unwrap_or(*steps);
        match &changes.branch {
            Some(branch) => branch.check_steps(*steps)?,
            None if *steps != *Self::steps(self.config()) => check_steps(run, *steps)?,
            None => {}
        }
        config.validate()?;
        let differs = config != *self.config();
        *self.config() = config;
        Ok(differs)
    }
}

/// Weights of a run.
pub(crate) struct Checkpoint {
    /// In the order of the parameters.
    pub weights: Vec<Floats>,
    /// Updates done.
    pub step: u64,
    /// SHA-256 of their file.
    pub sha256: String,
    /// What the user should know.
    pub notes: Vec<String>,
}

/// The weights of a run at a checkpoint.
///
/// # Errors
/// No checkpoint that is whole; weights of another network.
pub(crate) fn load(run: &Path, which: CheckpointChoice, parameters: &[Parameter]) -> Result<Checkpoint> {
    let mut notes = Vec::new();
    let found = Checkpoints::of(run).find(which, &[WEIGHTS], &[], &mut |note| notes.push(note))?;
    let (path, bytes) = (found.dir.join(WEIGHTS), &found.files[WEIGHTS]);
    let tensors = weights::from_bytes(&path, bytes)?;
    let weights = weights::floats("file", parameters, &tensors, |p| p.name.clone()).map_err(|e| match e {
        Error::Weights(found) => Error::file(&path, found, "the network that config.toml describes", ""),
        other => other,
    })?;
    Ok(Checkpoint { weights, step: found.state.step, sha256: FileRecord::of(bytes).sha256, notes })
}
