//! Charts as PNG and SVG, with a built-in font.
//!
//! ```
//! use kinelm_view::plot::{Chart, Look, Series, to_bytes};
//!
//! let series = Series { name: "loss".into(), points: vec![(1.0, 4.0), (10.0, 2.0)], look: Look::Line, ..Series::default() };
//! let chart = Chart { title: "training".into(), series: vec![series], ..Chart::default() };
//! let svg = to_bytes("loss.svg".as_ref(), &[chart])?.unwrap();
//! assert!(String::from_utf8(svg).unwrap().contains("training"));
//! # Ok::<(), kinelm_view::Error>(())
//! ```

mod axes;
mod heat;
mod matrix;
mod picture;
mod text;

pub use heat::Heat;
pub(crate) use heat::SHADES;
pub use matrix::Matrix;

use crate::{Error, Result};
use kinelm_store::files;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use std::path::Path;
use std::sync::OnceLock;

/// Size of a single chart with its legend, pixels.
const SIZE: (u32, u32) = (860, 600);
/// Size of a chart in several rows, pixels.
const SMALL: (u32, u32) = (520, 360);
/// The generator mark in every PNG: a text chunk.
pub const PNG_MARK: [u8; 19] = *b"tEXtSoftware\0kinelm";
/// The generator mark in every SVG and in tables.
pub const TEXT_MARK: &str = "<!-- made by kinelm -->";
/// A subset of DejaVu Sans; its licence is beside it.
const FONT: &[u8] = include_bytes!("font/DejaVuSans-subset.ttf");

/// The scale of an axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Scale {
    /// Logarithmic; numbers that are not positive are left out.
    #[default]
    Log,
    /// Linear.
    Linear,
}

impl Scale {
    /// Whether the axis can show a number.
    fn holds(self, v: f64) -> bool {
        v.is_finite() && (self == Scale::Linear || v > 0.0)
    }
}

/// The look of a series.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Look {
    /// Marks.
    #[default]
    Marks,
    /// Marks joined by a line.
    Joined,
    /// A line without marks.
    Line,
    /// A thin, pale line.
    Faint,
    /// A grey reference line.
    Reference,
}

/// A series of points.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Series {
    /// Label in the legend, truncated if it is long; no label if it is empty.
    pub name: String,
    /// The points; those that the axes can't show are left out.
    pub points: Vec<(f64, f64)>,
    /// Its look.
    pub look: Look,
    /// Index of its colour, to share one between series; default the next one.
    pub colour: Option<usize>,
}

/// A vertical line.
#[derive(Debug, Clone, PartialEq)]
pub struct Rule {
    /// Position on the horizontal axis.
    pub x: f64,
    /// Label at its top; may be empty.
    pub name: String,
}

/// One chart.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Chart {
    /// The title.
    pub title: String,
    /// Label of the horizontal axis, with the unit.
    pub x: String,
    /// Label of the vertical axis, with the unit.
    pub y: String,
    /// Scales of the horizontal and the vertical axis.
    pub scales: (Scale, Scale),
    /// The series.
    pub series: Vec<Series>,
    /// Vertical lines; those outside the points' range are left out.
    pub rules: Vec<Rule>,
    /// A heat map below the series, which then determines the axes.
    pub heat: Option<Heat>,
    /// A confusion matrix instead of everything else.
    pub matrix: Option<Matrix>,
}

impl Chart {
    /// Whether there is nothing to draw.
    pub fn is_empty(&self) -> bool {
        let empty = self.heat.as_ref().is_none_or(Heat::is_empty) && self.matrix.as_ref().is_none_or(Matrix::is_empty);
        empty && self.series.iter().all(|s| self.drawable(s).next().is_none())
    }

    /// The points of a series that the axes can show.
    fn drawable<'a>(&self, series: &'a Series) -> impl Iterator<Item = (f64, f64)> + use<'a> {
        let (x, y) = self.scales;
        series.points.iter().copied().filter(move |p| x.holds(p.0) && y.holds(p.1))
    }
}

/// Names of series, each once, in the order of their first mention.
///
/// ```
/// assert_eq!(kinelm_view::plot::each_once(["b", "a", "b"]), ["b", "a"]);
/// ```
pub fn each_once<T: PartialEq>(all: impl IntoIterator<Item = T>) -> Vec<T> {
    let mut once = Vec::new();
    for one in all {
        if !once.contains(&one) {
            once.push(one);
        }
    }
    once
}

/// Draws charts side by side, many of them in rows, as `path.png` and `path.svg`. Empty charts are left out; if all are empty,
/// nothing is written.
///
/// # Errors
/// I/O errors.
pub fn draw(path: &Path, charts: &[Chart]) -> Result<()> {
    draw_as(&path.with_extension("svg"), charts)?;
    draw_as(&path.with_extension("png"), charts)
}

/// As [`draw`], as one file, by its extension.
///
/// # Errors
/// Another extension than `png` and `svg`; I/O errors.
pub(crate) fn draw_as(path: &Path, charts: &[Chart]) -> Result<()> {
    to_bytes(path, charts)?.map_or(Ok(()), |bytes| files::write_whole(path, &bytes))
}

/// The bytes that `draw_as` writes, with the generator mark; `None` when there is nothing to draw.
///
/// # Errors
/// Another extension than `png` and `svg`.
pub fn to_bytes(path: &Path, charts: &[Chart]) -> Result<Option<Vec<u8>>> {
    in_columns(path, charts, charts.iter().filter(|c| !c.is_empty()).count().min(4))
}

/// As [`to_bytes`], in rows of `columns`.
///
/// # Errors
/// As [`to_bytes`].
pub fn in_columns(path: &Path, charts: &[Chart], columns: usize) -> Result<Option<Vec<u8>>> {
    let kind = kind(path)?;
    let charts: Vec<&Chart> = charts.iter().filter(|c| !c.is_empty()).collect();
    if charts.is_empty() {
        return Ok(None);
    }
    with_font();
    let failed = |e: String| Error::io(path)(std::io::Error::other(format!("the chart could not be drawn: {e}")));
    let columns = columns.max(1);
    let rows = charts.len().div_ceil(columns);
    let one = if rows > 1 { SMALL } else { SIZE };
    let size = (one.0 * columns as u32, one.1 * rows as u32);
    match kind {
        Kind::Svg => {
            let mut text = String::new();
            picture::all(SVGBackend::with_string(&mut text, size).into_drawing_area(), &charts, (rows, columns))
                .map_err(failed)?;
            let at = text.find('>').map_or(0, |i| i + 1); // after the first tag, with which an XML file must begin
            text.insert_str(at, TEXT_MARK);
            Ok(Some(text.into_bytes()))
        }
        Kind::Png => {
            let mut pixels = vec![0; 3 * (size.0 * size.1) as usize];
            let area = BitMapBackend::with_buffer(&mut pixels, size).into_drawing_area();
            picture::all(area, &charts, (rows, columns)).map_err(failed)?;
            Ok(Some(png(size, &pixels).map_err(|e| failed(e.to_string()))?))
        }
    }
}

/// RGB pixels as PNG.
fn png((width, height): (u32, u32), pixels: &[u8]) -> std::result::Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    // `PNG_MARK` is this chunk's type and content
    encoder.add_text_chunk("Software".into(), "kinelm".into())?;
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels)?;
    writer.finish()?;
    Ok(bytes)
}

/// Refuses, before the work, a file name with an unsupported extension.
///
/// # Errors
/// Another extension than `png` and `svg`.
pub fn check(path: &Path) -> Result<()> {
    kind(path).map(|_| ())
}

/// The format of a picture.
enum Kind {
    Png,
    Svg,
}

fn kind(path: &Path) -> Result<Kind> {
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("png") => Ok(Kind::Png),
        Some("svg") => Ok(Kind::Svg),
        _ => Err(Error::unsupported(path.display().to_string(), "expected a name ending in .png or .svg")),
    }
}

/// Registers the built-in font, once.
fn with_font() {
    static REGISTERED: OnceLock<()> = OnceLock::new();
    REGISTERED.get_or_init(|| {
        // built in, as a machine without fonts (a container) would draw none
        register_font("sans-serif", FontStyle::Normal, FONT).unwrap_or_else(|_| panic!("the built-in font is valid"))
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(series: Vec<Series>) -> Chart {
        Chart { title: "a <title>".into(), x: "bins".into(), y: "error, degrees".into(), series, ..Chart::default() }
    }

    #[test]
    fn both_pictures_are_written_whole() {
        let dir = tempfile::tempdir().unwrap();
        let points = vec![(60.0, 3.0), (f64::NAN, 1.0), (360.0, 0.5), (0.0, 1.0), (1080.0, 0.17)];
        let theory = vec![(60.0, 3.0), (1080.0, 0.1667)];
        let theory = Series { name: "1/n".into(), points: theory, look: Look::Reference, ..Series::default() };
        let mean = Series { name: "mean".into(), points, look: Look::Joined, ..Series::default() };
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
    fn a_picture_is_what_its_name_says() {
        let dir = tempfile::tempdir().unwrap();
        let line =
            Series { name: "a run of a very long name that ends nowhere, or does it end".into(), ..Series::default() };
        let line = Series { points: vec![(0.0, -1.0), (10.0, 4.0)], look: Look::Line, ..line };
        let marks = Series { points: vec![(5.0, 1.0)], colour: Some(0), ..Series::default() };
        let scales = (Scale::Linear, Scale::Linear);
        let rules = vec![Rule { x: 5.0, name: "turn".into() }, Rule { x: 50.0, name: "outside".into() }];
        let chart = Chart { scales, rules, ..chart(vec![line, marks]) };
        let path = dir.path().join("p.svg");
        draw_as(&path, std::slice::from_ref(&chart)).unwrap();
        let svg = std::fs::read_to_string(&path).unwrap();
        assert!(svg.contains("turn\n") && !svg.contains("outside"));
        assert!(svg.contains("a run of a very long name that") && !svg.contains("ends nowhere"));
        assert_eq!(svg.matches("<circle").count(), 1, "a series without a name is not in the legend");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        let message = draw_as(&dir.path().join("p.gif"), &[chart]).unwrap_err().to_string();
        assert!(message.ends_with("p.gif: expected a name ending in .png or .svg"), "{message}");
    }

    #[test]
    fn numbers_as_colours() {
        let dir = tempfile::tempdir().unwrap();
        let values = (0..12).map(f64::from).collect();
        let heat = Heat { x: [0.0, 2.0], y: [0.0, 30.0], columns: 4, values, limits: [0.0, 11.0], label: "dB".into() };
        let (scales, rules) = ((Scale::Linear, Scale::Linear), vec![Rule { x: 1.0, name: "here".into() }]);
        let chart = Chart { scales, rules, heat: Some(heat), ..chart(Vec::new()) };
        assert!(!chart.is_empty());
        draw(&dir.path().join("p.png"), std::slice::from_ref(&chart)).unwrap();
        let svg = std::fs::read_to_string(dir.path().join("p.svg")).unwrap();
        for colour in ["#440154", "#FDE725"] {
            assert!(svg.contains(colour), "{colour}, the lowest and the highest");
        }
        assert!(svg.contains("dB\n") && svg.contains("here\n"));
    }

    #[test]
    fn one_point_has_a_picture_too() {
        let dir = tempfile::tempdir().unwrap();
        let one = || Series { name: "one".into(), points: vec![(3.0, 7.0)], ..Series::default() };
        let linear = Chart { scales: (Scale::Linear, Scale::Linear), ..chart(vec![one()]) };
        draw(&dir.path().join("p.png"), &[chart(vec![one()]), linear]).unwrap();
    }
}
