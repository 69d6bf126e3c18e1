//! `kinelm aclstm train`.

use super::FormArg;
use crate::cli::read::{ReadArgs, positive};
use crate::cli::{Say, Stopped, WrongCall, asked, progress};
use anyhow::Result;
use kinelm::aclstm::Config;
use kinelm::aclstm::data::Sources;
use kinelm::aclstm::train::{Asked, Event, Summary, train};
use kinelm::classify::Only;
use kinelm_engine::lstm::Wiring;
use kinelm_motion::format::RestFrame;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folders of motion files, or files, all of one rig
    #[arg(value_name = "DATA", required_unless_present = "resume", conflicts_with = "resume")]
    data: Vec<PathBuf>,
    /// The run folder
    #[arg(long, value_name = "RUN")]
    run: PathBuf,
    /// Splits, takes and true rates of the DATA, as for kinelm tokenize: a CSV or a pattern
    #[arg(long, value_name = "FILE.csv|PATTERN", conflicts_with = "resume")]
    labels: Vec<String>,
    /// Only clips with this label; may be given again
    #[arg(long, value_name = "FIELD=VALUE", conflicts_with = "resume")]
    only: Vec<Only>,
    /// The settings: 256, published, or a TOML; what is given beside them goes before
    #[arg(long, value_name = "NAME|FILE", conflicts_with = "resume")]
    config: Option<PathBuf>,
    /// How a pose is written
    #[arg(long, value_enum, conflicts_with = "resume")]
    representation: Option<FormArg>,
    /// The order of the root's angles, such as YXZ, instead of its file's (euler)
    #[arg(long, value_name = "ORDER", conflicts_with = "resume")]
    root_order: Option<String>,
    /// Frames of its own that the network is fed, behind every few true ones; 0: none
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    condition: Option<u16>,
    /// True frames before them
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    groundtruth: Option<u16>,
    /// Units of a layer
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    width: Option<u16>,
    /// Layers
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    layers: Option<u8>,
    /// fixed: a layer sees the one below at the same step; compat: at the step before, as the published code has it
    #[arg(long, value_name = "fixed|compat", value_parser = wiring, conflicts_with = "resume")]
    wiring: Option<Wiring>,
    /// Sequences of an update
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    batch: Option<u16>,
    /// Adam's rate
    #[arg(long, value_name = "RATE", value_parser = positive, conflicts_with = "resume")]
    rate: Option<f64>,
    /// Updates in all
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// The seed of the first weights and of the sequences
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    seed: Option<u64>,
    /// Go on with the run from its last whole checkpoint, on the same files
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    read: ReadArgs,
}

fn wiring(text: &str) -> Result<Wiring, String> {
    match text {
        "fixed" => Ok(Wiring::Fixed),
        "compat" => Ok(Wiring::Compat),
        _ => Err("expected fixed or compat".into()),
    }
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let asked_for = match args.resume {
        true => Asked::Resumed(args.steps),
        false => Asked::New(config(&args)?, sources(&args)?),
    };
    let stop = crate::cli::pretrain::stop_on_ctrl_c()?;
    let mut bar: Option<_> = None;
    let done = train(&args.run, &asked_for, &stop, &mut |event| match event {
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
    told(&done.map_err(asked)?, &args.run, say)
}

fn told(done: &Summary, run: &Path, say: Say) -> Result<()> {
    let (step, seconds) = (done.step, done.seconds);
    say.line(format_args!("{}: {step} updates in all, {seconds:.0} s now", done.checkpoint.display()));
    if let Some(loss) = done.loss {
        say.line(format_args!("mean loss of the last 100: {loss:.4}"));
    }
    if done.stopped {
        let run = run.display();
        let what = format!("stopped after update {step}; go on with: kinelm aclstm train --run {run} --resume");
        return Err(Stopped(what).into());
    }
    Ok(())
}

fn config(args: &Args) -> Result<Config> {
    let mut config = args.config.as_deref().map(Config::find).transpose().map_err(asked)?.unwrap_or_default();
    config.form = args.representation.map_or(config.form, Into::into);
    config.root_order = args.root_order.clone().or(config.root_order);
    config.condition = args.condition.map_or(config.condition, usize::from);
    config.groundtruth = args.groundtruth.map_or(config.groundtruth, usize::from);
    config.width = args.width.map_or(config.width, usize::from);
    config.layers = args.layers.map_or(config.layers, usize::from);
    config.wiring = args.wiring.unwrap_or(config.wiring);
    config.batch = args.batch.map_or(config.batch, usize::from);
    config.learning_rate = args.rate.unwrap_or(config.learning_rate);
    config.steps = args.steps.unwrap_or(config.steps);
    config.seed = args.seed.unwrap_or(config.seed);
    config.validate().map_err(asked)?;
    Ok(config)
}

/// Paths as a run keeps them: it may be gone on with from another folder.
fn sources(args: &Args) -> Result<Sources> {
    let whole = |path: &Path| match std::path::absolute(path) {
        Ok(path) if path.to_str().is_some() => Ok(path),
        _ => Err(WrongCall(format!("{}: expected a path in UTF-8, which a run can keep", path.display()))),
    };
    let data = args.data.iter().map(|path| whole(path)).collect::<Result<_, _>>()?;
    let label = |text: &String| match Path::new(text).is_file() {
        true => Ok(whole(Path::new(text))?.to_string_lossy().into_owned()),
        false => Ok::<_, WrongCall>(text.clone()),
    };
    let labels = args.labels.iter().map(label).collect::<Result<_, _>>()?;
    // the margin leaves out what stands before the motion
    Ok(Sources { data, labels, only: args.only.clone(), read: args.read.options(RestFrame::Keep) })
}
