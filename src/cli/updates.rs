//! What commands that train small networks beside the GPT have in common.

use super::{Say, Stopped, WrongCall, asked, progress};
use crate::baselines::aclstm::data::Sources;
use crate::classify::Only;
use crate::train::updates::{Event, Summary};
use anyhow::Result;
use kinelm_motion::format::ReadOptions;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// Says how a training goes and how it ended; `command` goes on with it.
pub fn follow(
    command: &str,
    run: &Path,
    say: Say,
    train: impl FnOnce(&AtomicBool, &mut dyn FnMut(Event)) -> crate::Result<Summary>,
) -> Result<()> {
    let stop = crate::shell::training::stop_on_ctrl_c()?;
    let mut bar: Option<_> = None;
    let done = train(&stop, &mut |event| match event {
        Event::Note(text) => say.line(text),
        Event::Step(figures, steps) => {
            let bar = bar.get_or_insert_with(|| progress::bar(steps, "updates", say));
            bar.set_position(figures.step);
            if figures.step.is_multiple_of(100) {
                let (step, loss, seconds) = (figures.step, figures.loss, figures.seconds);
                say.line(format_args!("step {step}/{steps}  loss {loss:.4}  {:.0} ms an update", 1000.0 * seconds));
            }
        }
    });
    drop(bar);
    let done = done.map_err(asked)?;
    let (step, seconds) = (done.step, done.seconds);
    say.line(format_args!("{}: {step} updates in all, {seconds:.0} s now", done.checkpoint.display()));
    if let Some(loss) = done.loss {
        say.line(format_args!("mean loss of the last 100: {loss:.4}"));
    }
    if done.stopped {
        let run = run.display();
        let what = format!("stopped after update {step}; go on with: {command} --run {run} --resume");
        return Err(Stopped(what).into());
    }
    Ok(())
}

/// A path as a run keeps it: it may be gone on with from another folder.
pub fn kept(path: &Path) -> Result<PathBuf> {
    match std::path::absolute(path) {
        Ok(path) if path.to_str().is_some() => Ok(path),
        _ => Err(WrongCall(format!("{}: expected a path in UTF-8, which a run can keep", path.display())).into()),
    }
}

/// Where a run's motion is, as it keeps it.
pub fn sources(data: &[PathBuf], labels: &[String], only: &[Only], read: ReadOptions) -> Result<Sources> {
    let label = |text: &String| match Path::new(text).is_file() {
        true => Ok(kept(Path::new(text))?.to_string_lossy().into_owned()),
        false => Ok::<_, anyhow::Error>(text.clone()),
    };
    let data = data.iter().map(|path| kept(path)).collect::<Result<_>>()?;
    Ok(Sources { data, labels: labels.iter().map(label).collect::<Result<_>>()?, only: only.to_vec(), read })
}
