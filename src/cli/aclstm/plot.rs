//! `kinelm aclstm plot`.

use crate::baselines::aclstm::evaluate::{Curves, SeedLengths, charts, seed_charts};
use crate::cli::{ForceArgs, Say, draw_charts, picture, view::stem};
use anyhow::Result;
use kinelm_store::counted;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Reports that `kinelm aclstm evaluate --json` printed; NAME-1.json, NAME-2.json are runs of one row, whose mean
    /// is plotted
    #[arg(required = true, value_name = "REPORT.json")]
    reports: Vec<PathBuf>,
    /// The horizontal axis
    #[arg(long, value_enum, default_value = "time")]
    over: Over,
    /// Where the plot goes (.png .svg)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    force: ForceArgs,
}

/// The horizontal axis of a plot.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Over {
    /// The predicted time, after the longest seeds: errors, and the share of dances that stand still
    Time,
    /// The seeds' lengths: errors of the next 20 frames, with a standard deviation over runs
    SeedFrames,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let outputs = args.force.outputs(&args.reports);
    picture(&args.out, &outputs)?;
    let charts = match args.over {
        Over::Time => charts(&named(&args.reports, Curves::load)?),
        Over::SeedFrames => seed_charts(&named(&args.reports, SeedLengths::load)?),
    };
    draw_charts(&args.out, &charts, &outputs)?;
    say.line(format_args!("{}: {}", args.out.display(), counted(args.reports.len(), "reports")));
    Ok(())
}

/// What is loaded of each report, by its row.
fn named<T>(reports: &[PathBuf], load: fn(&Path) -> crate::Result<T>) -> Result<Vec<(String, T)>> {
    reports.iter().map(|path| Ok((row(path), load(path)?))).collect()
}

/// A report's name without the number of its run.
fn row(path: &Path) -> String {
    let name = stem(path);
    let number = |(row, number): (&str, &str)| number.parse::<u32>().is_ok().then(|| row.to_string());
    name.rsplit_once('-').and_then(number).unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_a_row_have_its_name() {
        let of = |name: &str| row(Path::new(name));
        assert_eq!([of("out/euler-5-12.json"), of("gpt.json"), of("a-b.json")], ["euler-5", "gpt", "a-b"]);
    }
}
