//! What the commands of the baselines have in common: training that can be resumed, dances that are made.

use super::read::ReadArgs;
use super::{BranchArgs, ForceArgs, Say, progress, training, wrong_call};
use crate::baselines::data::Sources;
use crate::baselines::sidecar::{Request, Sidecar};
use crate::baselines::train::{Event, Summary};
use crate::baselines::{Changes, Settings};
use crate::corpus::labels::LabelFilter;
use crate::model::CheckpointChoice;
use crate::store::{self, sidecar};
use anyhow::Result;
use kinelm_motion::format::RestFrame;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// What a new run learns from, and its settings.
#[derive(Debug, clap::Args)]
pub struct TrainArgs {
    /// Motion files or folders of them, all of one rig
    #[arg(value_name = "DATA", required = true)]
    data: Vec<PathBuf>,
    /// The run folder to create
    #[arg(long, value_name = "RUN")]
    pub run: PathBuf,
    /// Splits, takes, true rates and music of the DATA, as for kinelm tokenize: a CSV or a pattern
    #[arg(long, value_name = "FILE.csv|PATTERN")]
    labels: Vec<String>,
    /// Use only clips with this label; may be repeated
    #[arg(long, value_name = "FIELD=VALUE")]
    only: Vec<LabelFilter>,
    /// Settings: a name that kinelm config show knows, or a TOML file
    #[arg(long, value_name = "NAME|FILE")]
    config: Option<PathBuf>,
    /// Another value for one of its keys: steps=500, width=64; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    read: ReadArgs,
}

impl TrainArgs {
    /// The settings with what the call changes in them.
    pub fn settings<S: Settings + Default>(&self) -> crate::Result<S> {
        let settings: S = self.config.as_deref().map(S::find).transpose()?.unwrap_or_default();
        settings.with_keys(&self.set)
    }

    /// The motion and its labels, as the run stores them.
    pub fn sources(&self) -> Result<Sources> {
        let label = |text: &String| match Path::new(text).is_file() {
            true => Ok(stored(Path::new(text))?.to_string_lossy().into_owned()),
            false => Ok::<_, anyhow::Error>(text.clone()),
        };
        let data = self.data.iter().map(|path| stored(path)).collect::<Result<_>>()?;
        let labels = self.labels.iter().map(label).collect::<Result<_>>()?;
        // the margin leaves out what precedes the motion
        Ok(Sources { data, labels, only: self.only.clone(), read: self.read.options(RestFrame::Keep) })
    }
}

#[derive(Debug, clap::Args)]
pub struct ResumeArgs {
    /// The run folder
    pub run: PathBuf,
    #[command(flatten)]
    branch: BranchArgs,
    /// Total updates, instead of the run's
    #[arg(long, value_name = "N")]
    pub steps: Option<u64>,
    /// A key of the run's settings that changes from here on: learning_rate, steps, eval_every,
    /// sample_every, checkpoint_every, keep, of a music LSTM also clip; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

impl ResumeArgs {
    /// What the call changes.
    pub fn changes(&self) -> Changes {
        Changes { set: self.set.clone(), steps: self.steps, branch: self.branch.clone().get() }
    }
}

/// The dance of a baseline.
pub trait BaselineDance: Request {
    /// The files and folders that it is made from.
    fn inputs(&self) -> Vec<PathBuf>;
    /// Its sidecar and its bytes as a file named `out`.
    fn make(&self, which: CheckpointChoice, out: &Path, say: Say) -> Result<(Sidecar<Self>, Vec<u8>)>;
}

/// Generates a dance into `out`, with a checkpoint of the run.
pub fn make(
    request: &impl BaselineDance,
    which: CheckpointChoice,
    out: &Path,
    force: ForceArgs,
    say: Say,
) -> Result<()> {
    let inputs = request.inputs();
    if let Some(path) = inputs.iter().find(|path| path.to_str().is_none()) {
        wrong_call!("{}: expected a path in UTF-8, which a sidecar can hold", path.display());
    }
    let outputs = force.outputs(inputs);
    outputs.check([out])?;
    outputs.check_replaceable(out, None)?;
    outputs.check_replaceable(&sidecar::path_of(out), None)?;
    let (sidecar, bytes) = request.make(which, out, say)?;
    Ok(sidecar.write(out, &bytes, &outputs)?)
}

/// Trains with a progress bar and reports how it ended; `command resume RUN` continues it.
///
/// # Errors
/// The training's, or that the user stopped it.
pub fn follow(
    command: &str,
    run: &Path,
    say: Say,
    train: impl FnOnce(&AtomicBool, &mut dyn FnMut(Event)) -> crate::Result<Summary>,
) -> Result<()> {
    let stop = training::stop_on_ctrl_c()?;
    let mut bar: Option<_> = None;
    let done = train(&stop, &mut |event| match event {
        Event::Note(text) => say.line(text),
        Event::Valid(step, found, is_best) => {
            let best = if is_best { ", the best so far" } else { "" };
            say.line(format_args!("step {step}  validation loss {:.4}{best}", found.loss));
        }
        Event::Step(metrics, steps) => {
            let bar = bar.get_or_insert_with(|| progress::bar(steps, "updates", say));
            bar.set_position(metrics.step);
            if metrics.step.is_multiple_of(100) {
                let (step, loss, seconds) = (metrics.step, metrics.loss, metrics.seconds);
                say.line(format_args!("step {step}/{steps}  loss {loss:.4}  {:.0} ms an update", 1000.0 * seconds));
            }
        }
    });
    drop(bar);
    let done = done?;
    let (step, seconds) = (done.step, done.seconds);
    say.line(format_args!("{}: {step} updates in all, {seconds:.0} s now", done.checkpoint.display()));
    if let Some(loss) = done.loss {
        say.line(format_args!("mean loss of the last 100: {loss:.4}"));
    }
    if done.stopped {
        let what = format!("stopped after update {step}; to go on: {command} resume {}", run.display());
        return Err(store::Error::stopped(what).into());
    }
    Ok(())
}

/// An absolute path, as a run stores it: the run may be resumed from another folder.
pub fn stored(path: &Path) -> Result<PathBuf> {
    match std::path::absolute(path) {
        Ok(path) if path.to_str().is_some() => Ok(path),
        _ => wrong_call!("{}: expected a path in UTF-8, which a run can store", path.display()),
    }
}
