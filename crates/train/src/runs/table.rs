//! The list of runs as a table, and their names on a chart.

use super::Listed;
use crate::progress::time;
use comfy_table::{CellAlignment, Table, presets};
use kinelm_model::checkpoint::Measured;
use std::path::PathBuf;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// The runs' last names, or their paths where two have the same.
pub fn names(runs: &[PathBuf]) -> Vec<String> {
    let last = |run: &PathBuf| run.file_name().map(|n| n.to_string_lossy().into_owned());
    let mut seen = std::collections::BTreeSet::new();
    let all_differ = runs.iter().all(|run| last(run).is_some_and(|name| seen.insert(name)));
    let path = |run: &PathBuf| run.display().to_string();
    runs.iter().map(|run| last(run).filter(|_| all_differ).unwrap_or_else(|| path(run))).collect()
}

/// A row for each run; empty without any.
pub fn table(runs: &[Listed]) -> String {
    if runs.is_empty() {
        return String::new();
    }
    let mut table = Table::new();
    table.load_style(presets::NOTHING);
    table.set_header(["run", "status", "step", "loss", "best bits/frame", "tokens", "written", "model", "parameters"]);
    for run in runs {
        let pseudo = if run.model.starts_with("masked") { "pseudo " } else { "" };
        let best = run.best.map(|best| match best.measured {
            Measured::BitsPerFrame(bits) => format!("{pseudo}{bits:.2} at {}", best.step),
            Measured::Loss(loss) => format!("loss {loss:.4} at {}", best.step),
        });
        table.add_row([
            run.run.display().to_string(),
            run.status.name().into(),
            format!("{}/{}", run.step, run.steps),
            run.loss.map(|l| format!("{l:.4}")).unwrap_or_default(),
            best.unwrap_or_default(),
            run.tokens.map(|n| short(n as f64)).unwrap_or_default(),
            run.written.map(ago).unwrap_or_default(),
            run.model.clone(),
            run.parameters.map(|n| short(n as f64)).unwrap_or_default(),
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
    format!("{} ago", time(Duration::from_secs(now.saturating_sub(written))))
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
