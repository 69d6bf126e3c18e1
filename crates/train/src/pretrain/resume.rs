//! A run that exists, and what may change when it is resumed.

use super::PretrainOptions;
use crate::config::TrainConfig;
use crate::data::Data;
use crate::precision::Precision;
use crate::run::RunFile;
use crate::train_file::TrainFile;
use crate::trainer::check_steps;
use crate::{Error, Result};
use kinelm_store::presets;
use std::path::Path;

/// The keys that a resumed run may change: the rate and what else an update reads anew, and how often the run measures,
/// saves and samples. Weights, optimizer, and the order of the windows go on as they are.
pub const RESUMABLE: [&str; 14] = [
    "train.steps",
    "train.learning_rate",
    "train.schedule",
    "train.warmup",
    "train.final_share",
    "train.table_rate",
    "train.weight_decay",
    "train.clip_norm",
    "train.precision",
    "train.eval_every",
    "train.patience",
    "train.checkpoint_every",
    "train.keep",
    "train.sample_every",
];

/// Why all others stay.
const WHY: &str = "weights, optimizer, windows and measurements depend on it, so a resumed run keeps it; begin a new run, or \
                   finetune this one";

/// The configuration and the data of a run that exists, and whether it differs from its file. Nothing is written.
pub(super) fn resumed(options: &PretrainOptions, run: &Path) -> Result<(RunFile, Data, bool)> {
    let mut file = RunFile::read(run)?;
    let corpora = match (&options.file, options.corpora.is_empty()) {
        (Some(given), true) => given.corpora()?,
        _ => options.corpora.clone(),
    };
    let data = file.data(run, &corpora, options.opening)?;
    // after `data` has compared hashes: only a corpus that is the same one has a new path
    let mut differs = file.found_at(&data)?;
    if let Some(given) = &options.file {
        let mut train = given.train.clone();
        // steps may have been raised by an earlier resume, and don't count as another configuration
        (train.steps, train.seed) = (file.train.steps, options.seed.unwrap_or(train.seed));
        if options.precision.is_some() || train.precision == Precision::Auto {
            train.precision = file.train.precision;
        }
        let (given_model, own) = (given.model.resolved(&file.tokens), file.model.resolved(&file.tokens));
        if given_model != own || train != file.train || given.augment != file.augment {
            let why = format!("{} was begun with another configuration; leave it out", run.display());
            return Err(Error::unsupported_parameter("config", why));
        }
    }
    if let Some(seed) = options.seed.filter(|s| *s != file.train.seed) {
        return Err(Error::invalid_parameter(
            "seed",
            seed,
            format!("{}, which the run was begun with", file.train.seed),
        ));
    }
    let train = changed(&file.train, options)?;
    match &options.branch {
        Some(branch) => branch.check_steps(train.steps)?,
        None if train.steps != file.train.steps => check_steps(run, train.steps)?,
        None => {}
    }
    let precision = match train.precision == file.train.precision {
        true => train.precision,
        false => train.precision.decide(options.compute, file.model.width)?.0,
    };
    let train = TrainConfig { precision, ..train };
    differs |= train != file.train;
    file.train = train;
    Ok((file, data, differs))
}

/// A run's settings with what the call changes.
fn changed(own: &TrainConfig, options: &PretrainOptions) -> Result<TrainConfig> {
    presets::check_keys(&options.set, &RESUMABLE, WHY)?;
    let file = TrainFile { train: own.clone(), ..TrainFile::default() };
    let train = file.with_keys(&options.set)?.train;
    let steps = options.steps.unwrap_or(train.steps);
    let train = TrainConfig { steps, precision: options.precision.unwrap_or(train.precision), ..train };
    train.validate()?;
    Ok(train)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pretrain::tests::StopAt;
    use crate::{CorpusPart, NoProgress, fixture, pretrain};
    use kinelm_corpus::Split;
    use kinelm_model::run::WEIGHTS;
    use kinelm_store::Kind;
    use std::sync::atomic::AtomicBool;

    const CONFIG: &str = "[model]\nlayers = 1\nheads = 2\nwidth = 16\ncontext = 24\n[train]\nbatch = 3\nsteps = 8\n\
                          warmup = 2\nlearning_rate = 1e-2\neval_every = 4\nkeep = 9\n";

    fn begun(dir: &Path, name: &str) -> PretrainOptions {
        let options = PretrainOptions {
            file: Some(TrainFile::parse(CONFIG, Path::new("config.toml")).unwrap()),
            set: vec!["train.checkpoint_every=3".into()],
            corpora: vec![CorpusPart::once(dir.join("corpus"))],
            run: Some(dir.join(name)),
            ..Default::default()
        };
        let stop = AtomicBool::new(false);
        assert_eq!(pretrain(&options, &stop, &mut StopAt(3, &stop, Vec::new())).unwrap().step, 3);
        PretrainOptions { run: options.run, resume: true, ..Default::default() }
    }

    #[test]
    fn what_a_resumed_run_changes_stands_in_it_and_all_else_stays() {
        let dir = tempfile::tempdir().unwrap();
        fixture::corpus(dir.path(), &[(40, Split::Train), (12, Split::Valid)]);
        let [whole, parts] = ["whole", "parts"].map(|name| begun(dir.path(), name));
        let set = ["train.learning_rate=1e-3", "train.eval_every=2", "train.steps=9"].map(String::from).to_vec();
        let changes = |options: &PretrainOptions| PretrainOptions { set: set.clone(), ..options.clone() };
        let whole = pretrain(&changes(&whole), &AtomicBool::new(false), &mut NoProgress).unwrap();
        let stop = AtomicBool::new(false);
        assert_eq!(pretrain(&changes(&parts), &stop, &mut StopAt(5, &stop, Vec::new())).unwrap().step, 5);
        let run = parts.run.clone().unwrap();
        let file = RunFile::read(&run).unwrap();
        let train = &file.train;
        assert_eq!((train.learning_rate, train.eval_every, train.steps, train.checkpoint_every), (1e-3, 2, 9, 3));
        let second = pretrain(&parts, &AtomicBool::new(false), &mut NoProgress).unwrap();
        let weights = |summary: &crate::Summary| std::fs::read(summary.checkpoint.join(WEIGHTS)).unwrap();
        assert!(whole.step == 9 && second.step == 9 && weights(&whole) == weights(&second));
        for (pair, says) in [
            ("model.width=32", "`set` model.width: weights, optimizer, windows and measurements depend on it"),
            ("train.seed=2", "`set` train.seed: weights,"),
            ("train.batch=4", "what may change: train.steps, train.learning_rate,"),
            ("augment.mirror=0.5", "`set` augment.mirror:"),
            ("steps=9", "`set` steps:"),
            ("train.keep=0", "`set` train.keep is 0; expected 1 or more"),
        ] {
            let options = PretrainOptions { set: vec![pair.into()], ..parts.clone() };
            let e = pretrain(&options, &AtomicBool::new(false), &mut NoProgress).unwrap_err();
            assert!(e.to_string().contains(says) && e.kind() == Kind::Call, "{e}");
        }
        assert_eq!(RunFile::read(&run).unwrap(), file);
    }
}
