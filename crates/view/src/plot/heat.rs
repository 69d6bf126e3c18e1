//! Heat maps.

use super::axes::{Axes, Axis, number};
use super::text::{Drawn, GREY, style};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

/// Width of the colour scale right of the frame, pixels.
pub const WIDTH: i32 = 96;
/// Pixels from the frame to the colour bar, and the bar's width.
const BAR: [i32; 2] = [16, 16];
/// The most columns that are drawn; of more, neighbours are averaged.
const MOST_COLUMNS: usize = 400; // fewer than the pixels of a frame: narrower cells would round to none

/// Ten colours of matplotlib's viridis (Smith and van der Walt 2015): perceptually uniform, also with red-green blindness.
pub(crate) const SHADES: [[f64; 3]; 10] = [
    [68.0, 1.0, 84.0],
    [72.0, 40.0, 120.0],
    [62.0, 73.0, 137.0],
    [49.0, 104.0, 142.0],
    [38.0, 130.0, 142.0],
    [31.0, 158.0, 137.0],
    [53.0, 183.0, 121.0],
    [110.0, 206.0, 88.0],
    [181.0, 222.0, 43.0],
    [253.0, 231.0, 37.0],
];

/// A heat map that fills its axes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Heat {
    /// Start of the first column, end of the last.
    pub x: [f64; 2],
    /// Start of the lowest row, end of the highest.
    pub y: [f64; 2],
    /// Cells from left to right.
    pub columns: usize,
    /// (columns, rows), from the lowest row up; cells that are not finite stay white.
    pub values: Vec<f64>,
    /// The numbers of the darkest and the lightest colour; numbers beyond are clamped.
    pub limits: [f64; 2],
    /// Label of the colour scale, with the unit.
    pub label: String,
}

impl Heat {
    /// Whether there is no cell to draw.
    pub(crate) fn is_empty(&self) -> bool {
        self.columns == 0 || self.rows() == 0 || self.values.iter().all(|v| !v.is_finite())
    }

    fn rows(&self) -> usize {
        self.values.len() / self.columns.max(1)
    }

    /// The drawn columns and their cells, averaged over neighbours if there are too many.
    fn drawn(&self) -> (usize, Vec<f64>) {
        let (rows, together) = (self.rows(), self.columns.div_ceil(MOST_COLUMNS));
        let column = |cells: &[f64]| -> Vec<f64> {
            // the last group may have fewer columns
            let count = (cells.len() / rows) as f64;
            (0..rows).map(|r| cells.iter().skip(r).step_by(rows).sum::<f64>() / count).collect()
        };
        let cells: Vec<f64> = self.values[..rows * self.columns].chunks(rows * together).flat_map(column).collect();
        (self.columns.div_ceil(together), cells)
    }

    /// The colour of a number.
    fn colour(&self, v: f64) -> RGBColor {
        let [low, high] = self.limits;
        colour(if high > low { ((v - low) / (high - low)).clamp(0.0, 1.0) } else { 0.5 })
    }
}

/// The colour of 0 (darkest) to 1 (lightest).
pub fn colour(part: f64) -> RGBColor {
    let at = part * (SHADES.len() - 1) as f64;
    let (i, t) = ((at as usize).min(SHADES.len() - 2), at - (at as usize).min(SHADES.len() - 2) as f64);
    let mix = |k: usize| (SHADES[i][k] + t * (SHADES[i + 1][k] - SHADES[i][k])).round() as u8;
    RGBColor(mix(0), mix(1), mix(2))
}

/// Draws the cells and the colour scale.
pub fn draw<B: DrawingBackend>(area: &DrawingArea<B, Shift>, heat: &Heat, axes: &Axes) -> Drawn<B> {
    let rows = heat.rows();
    let (columns, cells) = heat.drawn();
    let between = |[low, high]: [f64; 2], i: usize, n: usize| low + (high - low) * i as f64 / n as f64;
    // the last averaged column may have fewer columns
    let together = heat.columns.div_ceil(columns);
    let x = |i: usize| between(heat.x, (i * together).min(heat.columns), heat.columns);
    for (i, &v) in cells.iter().enumerate().filter(|(_, v)| v.is_finite()) {
        let (column, row) = (i / rows, i % rows);
        let from = axes.at((x(column), between(heat.y, row + 1, rows)));
        let to = axes.at((x(column + 1), between(heat.y, row, rows)));
        area.draw(&Rectangle::new([from, to], heat.colour(v).filled()))?;
    }
    scale(area, heat, axes)
}

/// The colour scale, right of the frame.
fn scale<B: DrawingBackend>(area: &DrawingArea<B, Shift>, heat: &Heat, axes: &Axes) -> Drawn<B> {
    let [_, top, right, bottom] = axes.frame;
    let (left, right) = (right + BAR[0], right + BAR[0] + BAR[1]);
    let [low, high] = heat.limits;
    // a rectangle a pixel row: the backends have no gradients
    for py in top..bottom {
        let v = low + (high - low) * f64::from(bottom - py) / f64::from(bottom - top);
        area.draw(&Rectangle::new([(left, py), (right, py + 1)], heat.colour(v).filled()))?;
    }
    let axis = Axis::exactly([low, high]);
    for v in axis.ticks() {
        let py = bottom - (axis.along(v) * f64::from(bottom - top)).round() as i32;
        area.draw(&PathElement::new([(right, py), (right + 4, py)], GREY))?;
        area.draw(&Text::new(number(v), (right + 7, py), style(13, HPos::Left, VPos::Center)))?;
    }
    let turned = TextStyle::from(("sans-serif", 15).into_font().transform(FontTransform::Rotate270)).color(&GREY);
    let middle = turned.pos(plotters::style::text_anchor::Pos::new(HPos::Center, VPos::Top));
    area.draw(&Text::new(heat.label.clone(), (right + 42, (top + bottom) / 2), middle))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_run_from_dark_to_light() {
        let heat = Heat { limits: [-60.0, 0.0], ..Heat::default() };
        assert_eq!(heat.colour(-60.0), RGBColor(68, 1, 84));
        assert_eq!((heat.colour(0.0), heat.colour(9.0)), (RGBColor(253, 231, 37), RGBColor(253, 231, 37)));
        let light = |v: f64| {
            let RGBColor(r, g, b) = heat.colour(v);
            0.21 * f64::from(r) + 0.72 * f64::from(g) + 0.07 * f64::from(b)
        };
        assert!((-60..0).all(|v| light(f64::from(v)) < light(f64::from(v + 1))), "grey print tells them apart too");
        assert_eq!(Heat { limits: [2.0, 2.0], ..Heat::default() }.colour(2.0), heat.colour(-30.0));
    }

    #[test]
    fn more_columns_than_can_be_seen_are_means() {
        let values: Vec<f64> = (0..900).flat_map(|c| [f64::from(c), 1.0]).collect();
        let (columns, cells) = Heat { columns: 900, values, ..Heat::default() }.drawn();
        assert_eq!((columns, cells.len()), (300, 600));
        assert_eq!((cells[0], cells[1], cells[598]), (1.0, 1.0, 898.0));
        let few = Heat { columns: 2, values: vec![1.0, 2.0, 3.0, f64::NAN], ..Heat::default() };
        assert_eq!(few.drawn().1[..3], [1.0, 2.0, 3.0]);
        assert!(!few.is_empty() && Heat::default().is_empty());
        assert!(Heat { columns: 1, values: vec![f64::NAN], ..Heat::default() }.is_empty());
    }
}
