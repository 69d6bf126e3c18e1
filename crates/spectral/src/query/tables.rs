//! The tables of an evaluation.

use super::evaluate::{Report, Row};
use super::exclude::Exclude;
use kinelm_view::table::ReportTable;

/// A table a label: a row a transform and distance; the main exclusion with its interval and entropy at both phases, then
/// the accuracy under the others.
pub fn tables(report: &Report) -> Vec<ReportTable> {
    report
        .shares
        .iter()
        .map(|shares| {
            let of_field = |r: &&Row| r.field == shares.field;
            let main = |r: &&Row| r.exclude == report.exclude && r.phase == 0;
            let mut others: Vec<Exclude> = Vec::new();
            for row in report.rows.iter().filter(of_field).filter(|r| r.phase == 0) {
                if row.exclude != report.exclude && !others.contains(&row.exclude) {
                    others.push(row.exclude);
                }
            }
            let phase = report.queries.get(1).map(|q| q.0);
            let mut head = vec![String::new(), "accuracy %".into(), "+-".into(), "entropy, bans".into()];
            if phase.is_some() {
                head.extend(["half a hop on: %".into(), "bans".into()]);
            }
            head.extend(others.iter().map(|e| format!("exclude {}: %", e.name())));
            let mut rows = Vec::new();
            for row in report.rows.iter().filter(of_field).filter(main) {
                let like = |exclude: Exclude, phase: usize| {
                    report.rows.iter().find(|r| {
                        (&r.field, &r.transform, r.distance) == (&row.field, &row.transform, row.distance)
                            && (r.exclude, r.phase) == (exclude, phase)
                    })
                };
                let name = match row.distance {
                    Some(distance) => format!("{}, {}", row.transform, distance.name()),
                    None => format!("{} at random", report.k),
                };
                let mut cells = vec![name, percent(row.accuracy), percent(row.half_interval), bans(row.entropy_bans)];
                if let Some(phase) = phase {
                    let other = like(report.exclude, phase);
                    cells.extend([percent(other.and_then(|r| r.accuracy)), bans(other.and_then(|r| r.entropy_bans))]);
                }
                cells.extend(others.iter().map(|&e| percent(like(e, 0).and_then(|r| r.accuracy))));
                rows.push(cells);
            }
            // chance comes last, under the rows that are compared with it
            rows.sort_by_key(|cells| cells[0].ends_with("at random"));
            let largest = shares.shares.iter().max_by(|a, b| a.1.total_cmp(b.1));
            let largest = largest.map_or(String::new(), |(v, s)| {
                format!("; the most frequent, {v}, has {:.1} % of the windows", 100.0 * s)
            });
            let title =
                format!("{}: {} values{largest}; exclude {}", shares.field, shares.shares.len(), report.exclude.name());
            ReportTable { title, head, rows }
        })
        .collect()
}

/// Notes for the reader, before the tables.
pub fn notes(report: &Report) -> Vec<String> {
    let Report { clips, short, takes, k, windows, .. } = report;
    let queries: Vec<String> = report.queries.iter().map(|(phase, n)| format!("{n} from frame {phase} on")).collect();
    let mut notes = vec![format!(
        "{clips} clips of {takes} recordings; windows of {} frames at {} frames per second, hop {}: {}; k = {k}",
        windows.frames,
        windows.fps,
        windows.hop,
        queries.join(", ")
    )];
    if *short > 0 {
        notes.push(format!("{short} clips are shorter than a window of {:.3} s and are left out", windows.seconds()));
    }
    notes.push("+-: half of the 95 % interval over recordings; at random: neighbours drawn from those allowed".into());
    notes
}

/// The whole report in Markdown.
pub fn markdown(report: &Report) -> String {
    let lines: Vec<String> = notes(report).iter().map(|l| format!("- {l}\n")).collect();
    let tables: Vec<String> = tables(report).iter().map(|t| format!("**{}**\n\n{}", t.title, t.markdown())).collect();
    format!("{}\n{}", lines.concat(), tables.join("\n"))
}

fn percent(x: Option<f64>) -> String {
    x.map_or("n/a".into(), |x| format!("{:.1}", 100.0 * x))
}

fn bans(x: Option<f64>) -> String {
    x.map_or("n/a".into(), |x| format!("{x:.3}"))
}
