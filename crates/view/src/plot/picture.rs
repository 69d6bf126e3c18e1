//! Draws charts on any backend.

use super::axes::{Axes, number};
use super::text::{Drawn, GREY, LETTER, style};
use super::{Chart, Look, Rule, heat, matrix};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Colours that are distinct with red-green blindness, too (Okabe and Ito 2008), then darker ones.
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(150, 100, 0),
    RGBColor(60, 60, 60),
    RGBColor(230, 159, 0),
];
const FAINT: RGBColor = RGBColor(225, 225, 225);
/// For reference lines.
const REFERENCE: RGBColor = RGBColor(150, 150, 150);
/// Margins left, above, right and below, without the legend, pixels.
const AROUND: [i32; 4] = [74, 44, 12, 58];
/// The most letters of a name in the legend.
const LETTERS: usize = 30;

/// Draws charts side by side on the whole area, in rows and columns.
pub fn all<B: DrawingBackend>(
    area: DrawingArea<B, Shift>,
    charts: &[&Chart],
    grid: (usize, usize),
) -> Result<(), String> {
    area.fill(&WHITE).map_err(|e| e.to_string())?;
    for (part, chart) in area.split_evenly(grid).iter().zip(charts) {
        one(part, chart).map_err(|e| e.to_string())?;
    }
    area.present().map_err(|e| e.to_string())
}

fn one<B: DrawingBackend>(area: &DrawingArea<B, Shift>, chart: &Chart) -> Drawn<B> {
    if let Some(matrix) = &chart.matrix {
        return matrix::draw(area, chart, matrix);
    }
    let (width, height) = area.dim_in_pixel();
    let [left, top, right, bottom] = AROUND;
    let longest = chart.series.iter().map(|s| s.name.chars().count().min(LETTERS)).max().unwrap_or(0);
    let scale = if chart.heat.is_some() { heat::WIDTH } else { 36 };
    let right = width as i32 - right - scale - (longest as f64 * LETTER) as i32;
    let axes = Axes::of(chart, [left, top, right, height as i32 - bottom]);
    grid(area, chart, &axes)?;
    if let Some(heat) = &chart.heat {
        heat::draw(area, heat, &axes)?;
    }
    let (mut next, mut legend) = (0, Vec::new());
    for series in &chart.series {
        let points: Vec<(i32, i32)> = chart.drawable(series).map(|p| axes.at(p)).collect();
        if points.is_empty() {
            continue;
        }
        let colour = series.colour.unwrap_or(next);
        // references are grey and take no colour from the others
        next += usize::from(series.colour.is_none() && series.look != Look::Reference);
        draw_series(area, &points, series.look, colour)?;
        if !series.name.is_empty() {
            legend.push((series.name.as_str(), series.look, colour));
        }
    }
    let rules = chart.rules.iter().filter(|rule| axes.x.reaches(rule.x));
    // each name a line lower, so that neighbours don't overlap
    rules.enumerate().try_for_each(|(line, rule)| draw_rule(area, rule, line as i32, &axes))?;
    draw_legend(area, &legend, &axes)
}

fn grid<B: DrawingBackend>(area: &DrawingArea<B, Shift>, chart: &Chart, axes: &Axes) -> Drawn<B> {
    let [left, top, right, bottom] = axes.frame;
    let write = |text: &str, at: (i32, i32), size: u32, h: HPos, v: VPos| {
        area.draw(&Text::new(text.to_string(), at, style(size, h, v)))
    };
    for v in axes.x.ticks() {
        let (px, _) = axes.at((v, axes.y.low));
        area.draw(&PathElement::new([(px, top), (px, bottom)], FAINT))?;
        write(&number(v), (px, bottom + 6), 13, HPos::Center, VPos::Top)?;
    }
    for v in axes.y.ticks() {
        let (_, py) = axes.at((axes.x.low, v));
        area.draw(&PathElement::new([(left, py), (right, py)], FAINT))?;
        write(&number(v), (left - 7, py), 13, HPos::Right, VPos::Center)?;
    }
    area.draw(&PathElement::new([(left, top), (left, bottom), (right, bottom)], GREY))?;
    write(&chart.title, ((left + right) / 2, 14), 18, HPos::Center, VPos::Top)?;
    write(&chart.x, ((left + right) / 2, bottom + 28), 15, HPos::Center, VPos::Top)?;
    let turned = TextStyle::from(("sans-serif", 15).into_font().transform(FontTransform::Rotate270)).color(&GREY);
    let middle = turned.pos(Pos::new(HPos::Center, VPos::Top));
    area.draw(&Text::new(chart.y.clone(), (8, (top + bottom) / 2), middle))
}

fn draw_series<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    points: &[(i32, i32)],
    look: Look,
    colour: usize,
) -> Drawn<B> {
    let paint = COLOURS[colour % COLOURS.len()];
    let path = |style: ShapeStyle| blunt(points).into_iter().try_for_each(|p| area.draw(&PathElement::new(p, style)));
    match look {
        Look::Reference => path(REFERENCE.stroke_width(1)),
        Look::Faint => path(paint.mix(0.35).stroke_width(1)),
        Look::Line => path(paint.stroke_width(2)),
        Look::Joined => {
            path(paint.stroke_width(2))?;
            points.iter().try_for_each(|&p| mark(area, p, colour))
        }
        Look::Marks => points.iter().try_for_each(|&p| mark(area, p, colour)),
    }
}

/// Splits a line at turns of more than a right angle, where the backend would draw long pointed corners that look like data.
fn blunt(points: &[(i32, i32)]) -> Vec<Vec<(i32, i32)>> {
    let mut pieces: Vec<Vec<(i32, i32)>> = vec![Vec::new()];
    for &(x, y) in points {
        let last = pieces.len() - 1;
        let piece = &mut pieces[last];
        match piece[..] {
            // two equal points have no direction, and the next turn would be missed
            [.., b] if b == (x, y) => continue,
            // a scalar product below 0; in i64, as pixels of a wild axis may be near the ends of i32
            [.., a, b] if i64::from(b.0 - a.0) * i64::from(x - b.0) + i64::from(b.1 - a.1) * i64::from(y - b.1) < 0 => {
                pieces.push(vec![b, (x, y)]);
            }
            _ => piece.push((x, y)),
        }
    }
    pieces
}

/// A mark; its shape changes when the colours repeat.
fn mark<B: DrawingBackend>(area: &DrawingArea<B, Shift>, (x, y): (i32, i32), colour: usize) -> Drawn<B> {
    let paint = COLOURS[colour % COLOURS.len()].filled();
    match colour / COLOURS.len() % 3 {
        0 => area.draw(&Circle::new((x, y), 4, paint)),
        1 => area.draw(&Rectangle::new([(x - 4, y - 4), (x + 4, y + 4)], paint)),
        _ => area.draw(&TriangleMarker::new((x, y), 6, paint)),
    }
}

fn draw_rule<B: DrawingBackend>(area: &DrawingArea<B, Shift>, rule: &Rule, line: i32, axes: &Axes) -> Drawn<B> {
    let [_, top, _, bottom] = axes.frame;
    let (x, _) = axes.at((rule.x, axes.y.low));
    area.draw(&PathElement::new([(x, top), (x, bottom)], GREY))?;
    if rule.name.is_empty() {
        return Ok(());
    }
    area.draw(&Text::new(rule.name.clone(), (x + 4, top + 2 + 17 * line), style(13, HPos::Left, VPos::Top)))
}

fn draw_legend<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    names: &[(&str, Look, usize)],
    axes: &Axes,
) -> Drawn<B> {
    let [_, top, right, _] = axes.frame;
    for (i, (name, look, colour)) in names.iter().enumerate() {
        let y = top + 9 + 19 * i as i32;
        match look {
            Look::Marks | Look::Joined => mark(area, (right + 18, y), *colour)?,
            line => draw_series(area, &[(right + 9, y), (right + 27, y)], *line, *colour)?,
        }
        let name: String = name.chars().take(LETTERS).collect();
        area.draw(&Text::new(name, (right + 34, y), style(13, HPos::Left, VPos::Center)))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_cut_where_they_turn_back() {
        let needle = [(0, 0), (5, 0), (6, 90), (6, 90), (7, 0), (12, 0)];
        let expected = [vec![(0, 0), (5, 0), (6, 90)], vec![(6, 90), (7, 0), (12, 0)]];
        assert_eq!(blunt(&needle), expected);
        assert_eq!(blunt(&[(0, 0), (1, 0), (1, 1)]), [vec![(0, 0), (1, 0), (1, 1)]]);
        assert_eq!(blunt(&[(3, 3)]), [vec![(3, 3)]]);
    }
}
