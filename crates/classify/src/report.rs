//! A comparison as text and as charts.

use super::evaluate::{Comparison, Row};
use super::fields::Field;
use super::metrics::Metrics;
use kinelm_view::plot::{Chart, Matrix};
use std::fmt;
use std::fmt::Write;

impl Comparison {
    /// The confusion of the class tokens by clip, a chart per field.
    pub fn charts(&self) -> Vec<Chart> {
        let chart = |field: &Field| {
            let row = self.rows.iter().rfind(|r| r.field == field.name)?;
            let (count, right) = (row.clips.count, 100.0 * row.clips.accuracy);
            Some(Chart {
                title: format!("{}: {right:.1} % of {count} {} clips", field.name, self.split),
                x: "predicted".into(),
                y: "true".into(),
                matrix: Some(Matrix { names: field.classes.clone(), counts: row.clips.confusion.clone() }),
                ..Chart::default()
            })
        };
        self.fields.0.iter().filter_map(chart).collect()
    }
}

/// Tables of all fields, and the confusion of the class tokens by clip.
impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [train, clips] = self.clips;
        writeln!(f, "{clips} {} clips; learned from {train} train clips", self.split)?;
        for (field, left_out) in self.fields.0.iter().zip(&self.left_out) {
            let counts: Vec<String> = field.classes.iter().zip(&field.clips).map(|(c, n)| format!("{c} {n}")).collect();
            let (name, classes) = (&field.name, field.classes.len());
            writeln!(f, "\n{name}: {classes} classes; training clips: {}", counts.join(", "))?;
            if *left_out > 0 {
                writeln!(f, "{left_out} clips have no {name} that training had, and are left out")?;
            }
            writeln!(
                f,
                "{:<27} {:>9} {:>15} {:>9} {:>9} {:>6} {:>7}   {:>9} {:>15}",
                "by clip", "right %", "95 %", "balanced", "macro F1", "ECE", "nats", "windows %", "95 %"
            )?;
            let mut rows = self.rows.iter().filter(|r| r.field == *name);
            rows.clone().try_for_each(|row| f.write_str(&line(row)))?;
            if let Some(row) = rows.next_back() {
                f.write_str(&confusion(field, &row.clips))?;
            }
        }
        Ok(())
    }
}

fn line(row: &Row) -> String {
    let percent = |x: f64| format!("{:.1}", 100.0 * x);
    let interval = |f: &Metrics| format!("{} to {}", percent(f.accuracy_95[0]), percent(f.accuracy_95[1]));
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

/// A row per true class, a column per predicted one.
fn confusion(field: &Field, figures: &Metrics) -> String {
    let wide = field.classes.iter().map(|c| c.chars().count()).max().unwrap_or(0).max(5);
    let mut text = format!("class tokens by clip, a row per true class, a column per predicted one\n{:>wide$}", "");
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
