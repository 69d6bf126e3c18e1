//! `kinelm runs list` and `plot`.

use super::{ForceArgs, Say, print};
use crate::train::runs::{Listed, Log, Metric, XAxis, charts, list, names, table};
use crate::view::plot::Chart;
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// List the runs in folders: their progress, results, and whether they are running
    List {
        /// Folders to search [default: the current one]
        #[arg(value_name = "DIR")]
        folders: Vec<PathBuf>,
        /// Print one JSON object per run instead of a table
        #[arg(long)]
        json: bool,
    },
    /// Plot curves of runs, running ones too: lines for training, marks for validation; a chart of GPTs, and one of each form
    /// of LSTMs, whose losses can't be compared
    Plot {
        /// Run folders
        #[arg(required = true, value_name = "RUN")]
        runs: Vec<PathBuf>,
        /// Where the plot goes (.png .svg)
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// The metric to plot
        #[arg(long, value_enum, default_value = "loss")]
        metric: Metric,
        /// The horizontal axis; time is that of the training steps
        #[arg(long, value_enum, default_value = "step")]
        over: XAxis,
        #[command(flatten)]
        force: ForceArgs,
    },
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::List { folders, json } => {
            let folders = if folders.is_empty() { vec![".".into()] } else { folders };
            let runs = list(&folders, &mut |note| say.line(note))?;
            if runs.is_empty() {
                say.line("no runs there");
            }
            print(&if json { lines(&runs)? } else { table(&runs) })
        }
        Command::Plot { runs, out, metric, over, force } => {
            let outputs = force.outputs(&runs);
            super::picture(&out, &outputs)?;
            let mut logs = Vec::new();
            for (run, name) in runs.iter().zip(names(&runs)) {
                let log = Log::read(run)?;
                // the last line of a run that is being written may be half there
                if log.incomplete > 1 {
                    say.line(format_args!(
                        "{}: {} lines of metrics.jsonl can't be read",
                        run.display(),
                        log.incomplete
                    ));
                }
                logs.push((name, log));
            }
            let charts = charts(&logs, metric, over);
            if charts.iter().all(Chart::is_empty) {
                anyhow::bail!("none of the runs has a figure to draw yet");
            }
            charts.iter().filter(|chart| chart.is_empty()).for_each(|chart| {
                say.line(format_args!("{}: no figure to draw over this axis", chart.title));
            });
            super::draw_charts(&out, &charts, &outputs)?;
            let many = if runs.len() == 1 { "run" } else { "runs" };
            say.line(format_args!("{}: {} {many}", out.display(), runs.len()));
            Ok(())
        }
    }
}

fn lines(runs: &[Listed]) -> Result<String> {
    #[derive(serde::Serialize)]
    struct Line<'a> {
        schema: u32,
        #[serde(flatten)]
        run: &'a Listed,
    }
    let line = |run| Ok(serde_json::to_string(&Line { schema: 1, run })? + "\n");
    runs.iter().map(line).collect()
}
