//! Charts on logarithmic axes, as PNG and SVG, without fonts of the system.

use crate::{Error, Result, files};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, register_font};
use std::path::Path;
use std::sync::OnceLock;

/// Width of a chart with its legend and height of a picture, pixels.
const SIZE: (u32, u32) = (860, 600);
/// DejaVu Sans, cut down to what charts say; the licence stands beside it.
const FONT: &[u8] = include_bytes!("font/DejaVuSans-subset.ttf");

/// Colours that are told apart by those who see red and green alike too (Okabe and Ito 2008), then darker ones.
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

/// Points under one name.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Series {
    /// Stands in the legend.
    pub name: String,
    /// Both coordinates above 0; others are left out.
    pub points: Vec<(f64, f64)>,
    /// Whether a line joins the points, in their order.
    pub joined: bool,
    /// Drawn as a grey line without marks: what theory says.
    pub reference: bool,
}

/// One chart, both axes logarithmic.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Chart {
    /// Above it.
    pub title: String,
    /// Along the horizontal axis, with the unit.
    pub x: String,
    /// Along the vertical axis, with the unit.
    pub y: String,
    /// What is drawn.
    pub series: Vec<Series>,
}

impl Chart {
    /// Whether there is anything to draw.
    pub fn is_empty(&self) -> bool {
        self.points().next().is_none()
    }

    fn points(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.series.iter().flat_map(|s| drawable(&s.points))
    }

    /// Limits of both axes, a little wider than the points.
    fn limits(&self) -> [(f64, f64); 2] {
        let around = |of: fn((f64, f64)) -> f64| {
            let (low, high) = self.points().map(of).fold((f64::MAX, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
            // at least a doubling, so that one point has axes too
            let wider = 1.15f64.max((2.0 * low / high).sqrt());
            (low / wider, high * wider)
        };
        [around(|p| p.0), around(|p| p.1)]
    }
}

fn drawable(points: &[(f64, f64)]) -> impl Iterator<Item = (f64, f64)> + '_ {
    let fits = |v: f64| v.is_finite() && v > 0.0;
    points.iter().copied().filter(move |p| fits(p.0) && fits(p.1))
}

/// Draws charts side by side into `path.png` and `path.svg`; empty ones are left out, and nothing is written when all are.
///
/// # Errors
/// When a file can't be written.
pub fn draw(path: &Path, charts: &[Chart]) -> Result<()> {
    let charts: Vec<&Chart> = charts.iter().filter(|c| !c.is_empty()).collect();
    if charts.is_empty() {
        return Ok(());
    }
    with_font()?;
    let size = (SIZE.0 * charts.len() as u32, SIZE.1);
    let svg = path.with_extension("svg");
    let mut text = String::new();
    all(SVGBackend::with_string(&mut text, size).into_drawing_area(), &charts).map_err(|e| failed(&svg, e))?;
    files::write_whole(&svg, text.as_bytes())?;
    // the encoder knows the format by the name's end and writes by itself
    let png = path.with_extension("png");
    let new = files::beside(&png, "new")?.with_extension("png");
    let drawn = all(BitMapBackend::new(&new, size).into_drawing_area(), &charts).map_err(|e| failed(&png, e));
    let named = drawn.and_then(|()| std::fs::rename(&new, &png).map_err(Error::io(&png)));
    if named.is_err() {
        let _ = std::fs::remove_file(&new);
    }
    named
}

fn failed(path: &Path, e: String) -> Error {
    Error::Call(format!("{}: the chart could not be drawn: {e}", path.display()))
}

/// Makes the font known, once.
fn with_font() -> Result<()> {
    static KNOWN: OnceLock<bool> = OnceLock::new();
    let known = KNOWN.get_or_init(|| register_font("sans-serif", FontStyle::Normal, FONT).is_ok());
    if *known { Ok(()) } else { Err(Error::Call("the font of the charts can't be read".into())) }
}

fn all<B: DrawingBackend>(area: DrawingArea<B, Shift>, charts: &[&Chart]) -> std::result::Result<(), String> {
    area.fill(&WHITE).map_err(|e| e.to_string())?;
    for (part, chart) in area.split_evenly((1, charts.len())).iter().zip(charts) {
        one(part, chart).map_err(|e| e.to_string())?;
    }
    area.present().map_err(|e| e.to_string())
}

type Drawn<B> = std::result::Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

const GREY: RGBColor = RGBColor(90, 90, 90);
const FAINT: RGBColor = RGBColor(225, 225, 225);
/// What theory says.
const REFERENCE: RGBColor = RGBColor(150, 150, 150);
/// Pixels left of, above, right of and below what is plotted, the legend left aside.
const AROUND: [i32; 4] = [74, 44, 12, 58];
/// Pixels that hold a letter of the legend.
const LETTER: f64 = 7.3;

/// From numbers to pixels.
struct Axes {
    limits: [(f64, f64); 2],
    /// Left, top, right, bottom.
    frame: [i32; 4],
}

impl Axes {
    fn at(&self, (x, y): (f64, f64)) -> (i32, i32) {
        let along = |v: f64, (low, high): (f64, f64)| (v / low).ln() / (high / low).ln();
        let [left, top, right, bottom] = self.frame.map(f64::from);
        let px = left + along(x, self.limits[0]) * (right - left);
        let py = bottom - along(y, self.limits[1]) * (bottom - top);
        (px.round() as i32, py.round() as i32)
    }
}

fn one<B: DrawingBackend>(area: &DrawingArea<B, Shift>, chart: &Chart) -> Drawn<B> {
    let (width, height) = area.dim_in_pixel();
    let [left, top, right, bottom] = AROUND;
    let longest = chart.series.iter().map(|s| s.name.chars().count()).max().unwrap_or(0);
    let right = width as i32 - right - 36 - (longest as f64 * LETTER) as i32;
    let axes = Axes { limits: chart.limits(), frame: [left, top, right, height as i32 - bottom] };
    grid(area, chart, &axes)?;
    let (mut colours, mut legend) = (0, Vec::new());
    for series in &chart.series {
        let points: Vec<(i32, i32)> = drawable(&series.points).map(|p| axes.at(p)).collect();
        if points.is_empty() {
            continue;
        }
        let look = if series.reference { Look::Reference } else { Look::Marks(colours) };
        colours += usize::from(!series.reference);
        draw_line(area, &points, look, series.joined)?;
        if let Look::Marks(_) = look {
            points.iter().try_for_each(|&p| mark(area, p, look))?;
        }
        legend.push((series.name.as_str(), look));
    }
    draw_legend(area, &legend, &axes)
}

/// How a series looks.
#[derive(Clone, Copy)]
enum Look {
    Reference,
    /// The colour's number; later rounds of the colours have other marks.
    Marks(usize),
}

impl Look {
    fn colour(self) -> RGBColor {
        match self {
            Look::Reference => REFERENCE,
            Look::Marks(i) => COLOURS[i % COLOURS.len()],
        }
    }
}

fn grid<B: DrawingBackend>(area: &DrawingArea<B, Shift>, chart: &Chart, axes: &Axes) -> Drawn<B> {
    let [left, top, right, bottom] = axes.frame;
    let [x, y] = axes.limits;
    let says = |text: &str, at: (i32, i32), size: u32, h: HPos, v: VPos| {
        let style = TextStyle::from(("sans-serif", size).into_font()).color(&GREY).pos(Pos::new(h, v));
        area.draw(&Text::new(text.to_string(), at, style))
    };
    for v in ticks(x) {
        let (px, _) = axes.at((v, y.0));
        area.draw(&PathElement::new([(px, top), (px, bottom)], FAINT))?;
        says(&number(v), (px, bottom + 6), 13, HPos::Center, VPos::Top)?;
    }
    for v in ticks(y) {
        let (_, py) = axes.at((x.0, v));
        area.draw(&PathElement::new([(left, py), (right, py)], FAINT))?;
        says(&number(v), (left - 7, py), 13, HPos::Right, VPos::Center)?;
    }
    area.draw(&PathElement::new([(left, top), (left, bottom), (right, bottom)], GREY))?;
    says(&chart.title, ((left + right) / 2, 14), 18, HPos::Center, VPos::Top)?;
    says(&chart.x, ((left + right) / 2, bottom + 28), 15, HPos::Center, VPos::Top)?;
    let turned = TextStyle::from(("sans-serif", 15).into_font().transform(FontTransform::Rotate270)).color(&GREY);
    let middle = turned.pos(Pos::new(HPos::Center, VPos::Top));
    area.draw(&Text::new(chart.y.clone(), (8, (top + bottom) / 2), middle))
}

fn draw_line<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    points: &[(i32, i32)],
    look: Look,
    joined: bool,
) -> Drawn<B> {
    match look {
        Look::Reference => area.draw(&PathElement::new(points.to_vec(), REFERENCE.stroke_width(1))),
        Look::Marks(_) if joined => area.draw(&PathElement::new(points.to_vec(), look.colour().stroke_width(2))),
        Look::Marks(_) => Ok(()),
    }
}

fn mark<B: DrawingBackend>(area: &DrawingArea<B, Shift>, (x, y): (i32, i32), look: Look) -> Drawn<B> {
    let colour = look.colour();
    match look {
        Look::Reference => area.draw(&PathElement::new([(x - 9, y), (x + 9, y)], colour)),
        Look::Marks(i) => match i / COLOURS.len() % 3 {
            0 => area.draw(&Circle::new((x, y), 4, colour.filled())),
            1 => area.draw(&Rectangle::new([(x - 4, y - 4), (x + 4, y + 4)], colour.filled())),
            _ => area.draw(&TriangleMarker::new((x, y), 6, colour.filled())),
        },
    }
}

fn draw_legend<B: DrawingBackend>(area: &DrawingArea<B, Shift>, names: &[(&str, Look)], axes: &Axes) -> Drawn<B> {
    let [_, top, right, _] = axes.frame;
    for (i, (name, look)) in names.iter().enumerate() {
        let y = top + 9 + 19 * i as i32;
        mark(area, (right + 18, y), *look)?;
        let style = TextStyle::from(("sans-serif", 13).into_font()).color(&GREY);
        let style = style.pos(Pos::new(HPos::Left, VPos::Center));
        area.draw(&Text::new(name.to_string(), (right + 34, y), style))?;
    }
    Ok(())
}

/// 1, 2 and 5 of every power of ten inside the limits; powers alone where these are many, more where they are few.
fn ticks((low, high): (f64, f64)) -> Vec<f64> {
    let powers = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let heads: &[f64] = match (high / low).log10() {
        wide if wide > 3.5 => &[1.0],
        narrow if narrow < 1.0 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0],
        _ => &[1.0, 2.0, 5.0],
    };
    let all = powers.flat_map(|p| heads.iter().map(move |h| h * 10f64.powi(p)));
    all.filter(|v| (low..=high).contains(v)).collect()
}

/// As few digits as say it.
fn number(v: f64) -> String {
    if v >= 10_000.0 { format!("{}k", v / 1000.0) } else { format!("{}", (v * 1e6).round() / 1e6) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(series: Vec<Series>) -> Chart {
        Chart { title: "a <title>".into(), x: "bins".into(), y: "error, degrees".into(), series }
    }

    #[test]
    fn both_pictures_are_written_whole() {
        let dir = tempfile::tempdir().unwrap();
        let points = vec![(60.0, 3.0), (f64::NAN, 1.0), (360.0, 0.5), (0.0, 1.0), (1080.0, 0.17)];
        let theory = Series {
            name: "1/n".into(),
            points: vec![(60.0, 3.0), (1080.0, 0.1667)],
            reference: true,
            ..Series::default()
        };
        let mean = Series { name: "mean".into(), points, joined: true, ..Series::default() };
        let charts = [chart(vec![theory, mean]), Chart::default()];
        draw(&dir.path().join("p.png"), &charts).unwrap();
        let svg = std::fs::read_to_string(dir.path().join("p.svg")).unwrap();
        assert_eq!(svg.matches("<circle").count(), 4, "three points and the legend's");
        assert!(svg.contains("a &lt;title&gt;") && svg.contains("1/n\n"));
        let png = std::fs::read(dir.path().join("p.png")).unwrap();
        assert!(png.starts_with(b"\x89PNG") && png.ends_with(b"IEND\xaeB`\x82"));
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2, "nothing is left beside them");
        draw(&dir.path().join("none.png"), &[Chart::default()]).unwrap();
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2, "nothing to draw, nothing drawn");
    }

    #[test]
    fn one_point_has_axes_too() {
        let dir = tempfile::tempdir().unwrap();
        let one = Series { name: "one".into(), points: vec![(3.0, 7.0)], ..Series::default() };
        let [x, y] = chart(vec![one.clone()]).limits();
        assert!(x.0 < 3.0 && 3.0 < x.1 && x.1 / x.0 > 1.9 && y.0 < 7.0 && 7.0 < y.1);
        draw(&dir.path().join("p.png"), &[chart(vec![one])]).unwrap();
    }

    #[test]
    fn marks_on_an_axis() {
        assert_eq!(ticks((0.9, 12.0)), [1.0, 2.0, 5.0, 10.0]);
        assert_eq!(ticks((2.9, 12.0)), [3.0, 4.0, 5.0, 7.0, 10.0]);
        assert_eq!(ticks((0.009, 1100.0)), [0.01, 0.1, 1.0, 10.0, 100.0, 1000.0]);
        assert_eq!([0.05, 1.0, 200.0, 20000.0].map(number), ["0.05", "1", "200", "20k"]);
    }
}
