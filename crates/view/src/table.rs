//! Tables for a terminal and in Markdown.

use comfy_table::{CellAlignment, ContentArrangement, Table, presets};

/// A table below its title, with the first column aligned left and the others right.
pub fn terminal<S: ToString>(title: &str, head: &[S], rows: &[Vec<String>]) -> String {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_content_arrangement(ContentArrangement::Disabled).set_header(head.iter().map(ToString::to_string));
    rows.iter().for_each(|row| {
        table.add_row(row);
    });
    table.column_iter_mut().skip(1).for_each(|c| c.set_cell_alignment(CellAlignment::Right));
    format!("{title}\n{table}\n")
}

/// A table of a report: the first column names, the others numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct ReportTable {
    /// Stands above it.
    pub title: String,
    /// The columns.
    pub head: Vec<String>,
    /// As many cells a row.
    pub rows: Vec<Vec<String>>,
}

impl ReportTable {
    /// For a terminal.
    pub fn terminal(&self) -> String {
        terminal(&self.title, &self.head, &self.rows)
    }

    /// Head and rows in Markdown, without the title.
    pub fn markdown(&self) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let rule: Vec<String> = (0..self.head.len()).map(|i| if i == 0 { "---" } else { "---:" }.into()).collect();
        let rows: Vec<String> = self.rows.iter().map(|row| line(row)).collect();
        format!("{}{}{}", line(&self.head), line(&rule), rows.concat())
    }
}
