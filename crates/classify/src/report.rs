//! A comparison as text and as a picture.

use super::baselines::{Comparison, Row};
use super::fields::{Field, Fields};
use super::measures::Figures;
use kinelm_view::plot::{Chart, Matrix};
use std::fmt::Write;

/// The confusion of the class tokens by clip, a chart a field.
pub fn charts(found: &Comparison, fields: &Fields) -> Vec<Chart> {
    let chart = |field: &Field| {
        let row = found.rows.iter().rfind(|r| r.field == field.name)?;
        let (count, right) = (row.clips.count, 100.0 * row.clips.accuracy);
        Some(Chart {
            title: format!("{}: {right:.1} % of {count} {} clips", field.name, found.split),
            x: "named".into(),
            y: "is".into(),
            matrix: Some(Matrix { names: field.classes.clone(), counts: row.clips.confusion.clone() }),
            ..Chart::default()
        })
    };
    fields.0.iter().filter_map(chart).collect()
}

/// Tables of all fields, and the confusion of the class tokens by clip.
pub fn text(found: &Comparison, fields: &Fields) -> String {
    let [train, clips] = found.clips;
    let mut text = format!("{clips} {} clips; learned from {train} train clips\n", found.split);
    for (field, left_out) in fields.0.iter().zip(&found.left_out) {
        let many: Vec<String> = field.classes.iter().zip(&field.clips).map(|(c, n)| format!("{c} {n}")).collect();
        let (name, classes) = (&field.name, field.classes.len());
        let _ = writeln!(text, "\n{name}: {classes} classes; training clips: {}", many.join(", "));
        if *left_out > 0 {
            let _ = writeln!(text, "{left_out} clips have no {name} that training had, and count nowhere");
        }
        let _ = writeln!(
            text,
            "{:<27} {:>9} {:>15} {:>9} {:>9} {:>6} {:>7}   {:>9} {:>15}",
            "by clip", "right %", "95 %", "balanced", "macro F1", "ECE", "nats", "windows %", "95 %"
        );
        for row in found.rows.iter().filter(|r| r.field == *name) {
            text += &line(row);
        }
        let own = found.rows.iter().rfind(|r| r.field == *name);
        text += &own.map_or_else(String::new, |row| confusion(field, &row.clips));
    }
    text
}

fn line(row: &Row) -> String {
    let percent = |x: f64| format!("{:.1}", 100.0 * x);
    let interval = |f: &Figures| format!("{} to {}", percent(f.accuracy_95[0]), percent(f.accuracy_95[1]));
    let c = &row.clips;
    let (windows, of_windows) =
        row.windows.as_ref().map_or_else(Default::default, |w| (percent(w.accuracy), interval(w)));
    format!(
        "{:<27} {:>9} {:>15} {:>9} {:>9} {:>6.3} {:>7.3}   {:>9} {:>15}\n",
        row.name,
        percent(c.accuracy),
        interval(c),
        percent(c.balanced_accuracy),
        percent(c.macro_f1),
        c.calibration_error,
        c.nats,
        windows,
        of_windows
    )
}

/// A row a class, a column a name that was given.
fn confusion(field: &Field, figures: &Figures) -> String {
    let wide = field.classes.iter().map(|c| c.chars().count()).max().unwrap_or(0).max(5);
    let mut text = format!("class tokens by clip, a row a class, a column a name\n{:>wide$}", "");
    for class in &field.classes {
        let short: String = class.chars().take(9).collect();
        let _ = write!(text, " {short:>9}");
    }
    text.push('\n');
    for (class, row) in field.classes.iter().zip(&figures.confusion) {
        let _ = write!(text, "{class:>wide$}");
        for count in row {
            let _ = match count {
                0 => write!(text, " {:>9}", "."),
                n => write!(text, " {n:>9}"),
            };
        }
        text.push('\n');
    }
    text
}
