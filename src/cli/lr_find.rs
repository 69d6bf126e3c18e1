//! `kinelm lr-find`.

use super::pretrain::config_help;
use super::{ComputeArgs, ForceArgs, Say, TrustArgs, print};
use crate::train::lr_find::{LrFindOptions, RangeTest, lr_find};
use crate::train::{CorpusPart, TrainFile};
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[arg(long, value_name = "NAME|FILE", help = format!("{}; their rate, schedule, steps and run aren't used", config_help()))]
    config: PathBuf,
    /// A corpus folder; may be repeated. The windows of each corpus come WEIGHT times an epoch [default weight: 1]
    #[arg(long, value_name = "CORPUS[=WEIGHT]")]
    corpus: Vec<CorpusPart>,
    /// Where the plot goes (.png .svg)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Steps; more give a smoother curve
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u64).range(2..))]
    steps: u64,
    /// The first rate
    #[arg(long, value_name = "RATE", default_value_t = 1e-7, value_parser = super::values::positive)]
    from: f64,
    /// The last rate, if the loss doesn't diverge before
    #[arg(long, value_name = "RATE", default_value_t = 1.0, value_parser = super::values::positive)]
    to: f64,
    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    compute: ComputeArgs,
    #[command(flatten)]
    trust: TrustArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let corpora = args.corpus.iter().map(|part| part.path.clone());
    let outputs = args.force.outputs(corpora.chain([args.config.clone()]));
    super::picture(&args.out, &outputs)?;
    let options = LrFindOptions {
        file: TrainFile::find(&args.config)?,
        corpora: args.corpus,
        steps: args.steps,
        from: args.from,
        to: args.to,
        compute: args.compute.get(),
        opening: args.trust.opening(),
    };
    let stop = crate::shell::training::stop_on_ctrl_c()?;
    // after the corpora are opened, which reports its own progress
    let mut bar = None;
    let found = lr_find(&options, &stop, &mut |tried| {
        bar.get_or_insert_with(|| super::progress::bar(args.steps, "steps", say)).set_position(tried.step);
    });
    // the bar goes before an error is printed
    drop(bar);
    let found = found?;
    super::draw_charts(&args.out, &[found.chart()], &outputs)?;
    say.line(format_args!("{}: {} steps", args.out.display(), found.steps.len()));
    if args.json {
        #[derive(serde::Serialize)]
        struct Line<'a> {
            schema: u32,
            #[serde(flatten)]
            found: &'a RangeTest,
        }
        return print(&(serde_json::to_string(&Line { schema: 1, found: &found })? + "\n"));
    }
    print(&found.table())
}
