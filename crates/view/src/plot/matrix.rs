//! Confusion matrices.

use super::Chart;
use super::heat::colour;
use super::text::{Drawn, GREY, LETTER, style};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// The most letters of a name.
const LETTERS: usize = 22;
/// Pixels above the cells, right of them, and for the axes' titles.
const ABOVE: i32 = 44;
const RIGHT: i32 = 16;
const TITLE: i32 = 30;
/// Least size of a cell with its count, pixels.
const READABLE: i32 = 14;

/// Rows are classes, columns predictions; a cell is coloured by its share of the row.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Matrix {
    /// n classes.
    pub names: Vec<String>,
    /// (n, n), `[class][predicted]`.
    pub counts: Vec<Vec<usize>>,
}

impl Matrix {
    /// Whether there is nothing to draw.
    pub(crate) fn is_empty(&self) -> bool {
        self.counts.iter().flatten().sum::<usize>() == 0
    }
}

/// Draws cells, counts and names; `chart.x` and `chart.y` are the titles of columns and rows.
pub fn draw<B: DrawingBackend>(area: &DrawingArea<B, Shift>, chart: &Chart, matrix: &Matrix) -> Drawn<B> {
    let (width, height) = area.dim_in_pixel();
    let cut = |name: &String| name.chars().take(LETTERS).collect::<String>();
    let longest = matrix.names.iter().map(|n| cut(n).chars().count()).max().unwrap_or(0);
    let names = (longest as f64 * LETTER) as i32 + 12;
    let (n, top) = (matrix.names.len() as i32, ABOVE);
    let wide = width as i32 - TITLE - names - RIGHT;
    // square cells; names need the same room below as on the left
    let cell = (wide.min(height as i32 - top - names - TITLE) / n.max(1)).max(1);
    // centred
    let spare = (wide - n * cell).max(0) / 2;
    let left = spare + TITLE + names;
    let size = (cell - 4).clamp(9, 15) as u32;
    for (row, counts) in matrix.counts.iter().enumerate() {
        let all = counts.iter().sum::<usize>().max(1) as f64;
        for (column, &count) in counts.iter().enumerate() {
            let (x, y) = (left + column as i32 * cell, top + row as i32 * cell);
            let share = count as f64 / all;
            area.draw(&Rectangle::new([(x, y), (x + cell, y + cell)], colour(share).filled()))?;
            if count == 0 || cell < READABLE {
                continue;
            }
            // viridis is light from there on
            let ink = if share > 0.6 { BLACK } else { WHITE };
            let middle = style(size, HPos::Center, VPos::Center).color(&ink);
            area.draw(&Text::new(count.to_string(), (x + cell / 2, y + cell / 2), middle))?;
        }
    }
    let end = |i: i32| i * cell + cell / 2;
    let (right, bottom) = (left + n * cell, top + n * cell);
    let turned = |size: u32, h: HPos, v: VPos| {
        let font = ("sans-serif", size).into_font().transform(FontTransform::Rotate270);
        TextStyle::from(font).color(&GREY).pos(Pos::new(h, v))
    };
    for (i, name) in (0..).zip(&matrix.names) {
        area.draw(&Text::new(cut(name), (left - 7, top + end(i)), style(13, HPos::Right, VPos::Center)))?;
        area.draw(&Text::new(cut(name), (left + end(i), bottom + 7), turned(13, HPos::Right, VPos::Center)))?;
    }
    area.draw(&Text::new(chart.title.clone(), ((left + right) / 2, 14), style(18, HPos::Center, VPos::Top)))?;
    let along = style(15, HPos::Center, VPos::Top);
    area.draw(&Text::new(chart.x.clone(), ((left + right) / 2, bottom + names + 6), along))?;
    let up = turned(15, HPos::Center, VPos::Top);
    area.draw(&Text::new(chart.y.clone(), (spare + 8, (top + bottom) / 2), up))
}
