//! `kinelm runs list` and `plot`.

use super::{ForceArgs, Say, print};
use crate::train::runs::{Listed, Log, Metric, Over, chart, list};
use anyhow::Result;
use comfy_table::{CellAlignment, Table, presets};
use std::path::PathBuf;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// The runs below some folders: how far they are, how well they do, whether they are running
    List {
        /// Folders to look through; by itself the present one
        #[arg(value_name = "DIR")]
        folders: Vec<PathBuf>,
        /// One JSON object a run instead of a table
        #[arg(long)]
        json: bool,
    },
    /// Curves of runs on one chart, also of those that are running: lines for training, marks for validation
    Plot {
        /// Run folders
        #[arg(required = true, value_name = "RUN")]
        runs: Vec<PathBuf>,
        /// Where the chart goes (.png .svg)
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// What is drawn
        #[arg(long, value_enum, default_value = "loss")]
        metric: Metric,
        /// What it is drawn over; time is that of the training steps
        #[arg(long, value_enum, default_value = "step")]
        over: Over,
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
                if log.odd > 1 {
                    say.line(format_args!("{}: {} lines of metrics.jsonl can't be read", run.display(), log.odd));
                }
                logs.push((name, log));
            }
            let chart = chart(&logs, metric, over);
            if chart.is_empty() {
                anyhow::bail!("none of the runs has a figure to draw yet");
            }
            super::draw_charts(&out, &[chart], &outputs)?;
            let many = if runs.len() == 1 { "run" } else { "runs" };
            say.line(format_args!("{}: {} {many}", out.display(), runs.len()));
            Ok(())
        }
    }
}

/// The runs' last names, or their paths where two have the same.
fn names(runs: &[PathBuf]) -> Vec<String> {
    let last = |run: &PathBuf| run.file_name().map(|n| n.to_string_lossy().into_owned());
    let mut seen = std::collections::BTreeSet::new();
    let all_differ = runs.iter().all(|run| last(run).is_some_and(|name| seen.insert(name)));
    let path = |run: &PathBuf| run.display().to_string();
    runs.iter().map(|run| last(run).filter(|_| all_differ).unwrap_or_else(|| path(run))).collect()
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

fn table(runs: &[Listed]) -> String {
    if runs.is_empty() {
        return String::new();
    }
    let mut table = Table::new();
    table.load_style(presets::NOTHING);
    table.set_header(["run", "status", "step", "loss", "best bits/frame", "tokens", "written", "model", "parameters"]);
    for run in runs {
        let pseudo = if run.model.starts_with("masked") { "pseudo " } else { "" };
        let best = run.best.map(|b| format!("{pseudo}{:.2} at {}", b.bits_per_frame, b.step));
        table.add_row([
            run.run.display().to_string(),
            run.status.name().into(),
            format!("{}/{}", run.step, run.steps),
            run.loss.map(|l| format!("{l:.4}")).unwrap_or_default(),
            best.unwrap_or_default(),
            short(run.tokens as f64),
            run.written.map(ago).unwrap_or_default(),
            run.model.clone(),
            short(run.parameters as f64),
        ]);
    }
    for column in [2, 3, 4, 5, 6, 8] {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table.lines().map(|line| line.trim_end().to_owned() + "\n").collect()
}

/// Three digits and a unit.
fn short(n: f64) -> String {
    match n {
        n if n >= 1e9 => format!("{:.2} G", n / 1e9),
        n if n >= 1e6 => format!("{:.2} M", n / 1e6),
        n if n >= 1e3 => format!("{:.1} k", n / 1e3),
        n => n.to_string(),
    }
}

/// How long ago some second since 1970 is.
fn ago(written: u64) -> String {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
    format!("{} ago", crate::train::progress::time(Duration::from_secs(now.saturating_sub(written))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_runs_apart() {
        let of = |runs: &[&str]| names(&runs.iter().map(PathBuf::from).collect::<Vec<_>>());
        assert_eq!(of(&["a/x", "a/y"]), ["x", "y"]);
        assert_eq!(of(&["a/x", "b/x"]), ["a/x", "b/x"]);
        assert_eq!(of(&["."]), ["."]);
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([7.0, 1500.0, 25_990_144.0, 3.1e9].map(short), ["7", "1.5 k", "25.99 M", "3.10 G"]);
    }
}
