//! `kinelm aclstm plot`.

use crate::baselines::aclstm::evaluate::{Curves, charts};
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
    /// Where the plot goes (.png .svg)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    force: ForceArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let outputs = args.force.outputs(&args.reports);
    picture(&args.out, &outputs)?;
    let load = |path: &PathBuf| Ok((row(path), Curves::load(path)?));
    let all = args.reports.iter().map(load).collect::<Result<Vec<_>>>()?;
    draw_charts(&args.out, &charts(&all), &outputs)?;
    say.line(format_args!("{}: {}", args.out.display(), counted(all.len(), "reports")));
    Ok(())
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
