//! A comparison as text and as charts.

use super::evaluate::{CLASSIFIER, Comparison, Row};
use super::fields::Field;
use super::metrics::Metrics;
use kinelm_view::plot::{Chart, Matrix};
use std::fmt;
use std::fmt::Write;

impl Comparison {
    /// The confusion by clip of the class tokens, and of these with LDA: a chart per field and row, whose title has both.
    pub fn charts(&self) -> Vec<Chart> {
        let chart = |field: &Field, row: &Row| {
            let (count, right) = (row.clips.count, 100.0 * row.clips.accuracy);
            Chart {
                title: format!("{} by {}: {right:.1} % of {count} {} clips", field.name, row.name, self.split),
                x: "predicted".into(),
                y: "true".into(),
                matrix: Some(Matrix { names: field.classes.clone(), counts: row.clips.confusion.clone() }),
                ..Chart::default()
            }
        };
        self.fields.0.iter().flat_map(|field| self.own_rows(field).map(move |row| chart(field, row))).collect()
    }

    /// The rows of a field that are the classifier's own.
    fn own_rows<'a>(&'a self, field: &'a Field) -> impl Iterator<Item = &'a Row> {
        self.rows.iter().filter(|row| row.field == field.name && CLASSIFIER.contains(&&*row.name))
    }
}

/// Tables of all fields, and the confusion by clip of the class tokens, and of these with LDA.
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
            self.rows.iter().filter(|r| r.field == *name).try_for_each(|row| f.write_str(&line(row)))?;
            self.own_rows(field).try_for_each(|row| f.write_str(&confusion(field, row)))?;
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
fn confusion(field: &Field, of: &Row) -> String {
    let wide = field.classes.iter().map(|c| c.chars().count()).max().unwrap_or(0).max(5);
    let mut text = format!("{} by clip, a row per true class, a column per predicted one\n{:>wide$}", of.name, "");
    for class in &field.classes {
        let short: String = class.chars().take(9).collect();
        let _ = write!(text, " {short:>9}");
    }
    text.push('\n');
    for (class, row) in field.classes.iter().zip(&of.clips.confusion) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Fields, Outcome};
    use kinelm_corpus::Split;

    /// A row whose clips are predicted as these classes; the first two are of class 0, the last two of class 1.
    fn row(name: &str, predicted: [usize; 4]) -> Row {
        let outcome = |clip: usize| {
            let log_p = [0, 1].map(|class| if class == predicted[clip] { 0.9f64.ln() } else { 0.1f64.ln() });
            Outcome { clip, class: clip / 2, log_p: log_p.to_vec() }
        };
        let clips = Metrics::of(&[0, 1, 2, 3].map(outcome), 2, 1).unwrap();
        Row { name: name.into(), field: "genre".into(), windows: None, clips }
    }

    #[test]
    fn each_matrix_is_that_of_the_classifier_above_it() {
        let classes = ["salsa".to_string(), "waltz".to_string()];
        let field = Field { name: "genre".into(), classes: classes.to_vec(), clips: vec![2, 2] };
        let predicted = [[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1]];
        let [plain, tokens, fused] = predicted;
        let found = Comparison {
            schema: 1,
            fields: Fields(vec![field]),
            split: Split::Test,
            clips: [4, 4],
            left_out: vec![0],
            rows: vec![row("LDA", plain), row(CLASSIFIER[0], tokens), row(CLASSIFIER[1], fused)],
        };
        let text = found.to_string();
        let matrix = |name: &str| {
            let head = format!("\n{name} by clip, a row per true class, a column per predicted one\n");
            let (_, below) = text.split_once(&head).unwrap_or_else(|| panic!("{name}: {text}"));
            below.lines().skip(1).take(2).map(|line| line.split_whitespace().skip(1).collect()).collect::<Vec<Vec<_>>>()
        };
        assert_eq!(matrix("class tokens"), [["1", "1"], ["1", "1"]]);
        assert_eq!(matrix("class tokens and LDA"), [["2", "."], [".", "2"]]);
        assert_eq!(text.matches("a row per true class").count(), 2, "{text}");
        let charts = found.charts();
        let drawn: Vec<_> = charts.iter().map(|c| (&*c.title, c.matrix.as_ref().unwrap().counts.clone())).collect();
        let expected = [
            ("genre by class tokens: 50.0 % of 4 test clips", vec![vec![1, 1], vec![1, 1]]),
            ("genre by class tokens and LDA: 100.0 % of 4 test clips", vec![vec![2, 0], vec![0, 2]]),
        ];
        assert_eq!(drawn, expected);
    }
}
