//! Charts as PNG and SVG, without fonts of the system.

mod axes;
mod heat;
mod matrix;
mod picture;

pub use heat::Heat;
pub use matrix::Matrix;

use crate::{Error, Result};
use kinelm_store::files;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use std::path::Path;
use std::sync::OnceLock;

/// Width of a chart with its legend and height of a picture, pixels.
const SIZE: (u32, u32) = (860, 600);
/// And of one in rows of charts.
const SMALL: (u32, u32) = (520, 360);
/// Stands in every PNG: a text chunk that says who made it.
pub const PNG_MARK: [u8; 19] = *b"tEXtSoftware\0kinelm";
/// Stands in every SVG and in tables: who made it.
pub const TEXT_MARK: &str = "<!-- made by kinelm -->";
/// DejaVu Sans, cut down to what charts say; the licence stands beside it.
const FONT: &[u8] = include_bytes!("font/DejaVuSans-subset.ttf");

/// How an axis goes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Scale {
    /// By powers; numbers that are not above 0 are left out.
    #[default]
    Log,
    /// Evenly.
    Linear,
}

impl Scale {
    /// Whether a number has a place on the axis.
    fn holds(self, v: f64) -> bool {
        v.is_finite() && (self == Scale::Linear || v > 0.0)
    }
}

/// How a series looks.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Look {
    /// A mark a point.
    #[default]
    Marks,
    /// Marks, joined by a line in their order.
    Joined,
    /// A line without marks.
    Line,
    /// A thin line, paler than the colour.
    Faint,
    /// A grey line: what theory says.
    Reference,
}

/// Points under one name.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Series {
    /// Stands in the legend, cut if it is long; nothing stands there if it is empty.
    pub name: String,
    /// The points; those that have no place on the axes are left out.
    pub points: Vec<(f64, f64)>,
    /// How it looks.
    pub look: Look,
    /// The number of its colour, so that series that belong together share one; by itself the next one.
    pub colour: Option<usize>,
}

/// An upright line at a place of the horizontal axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Rule {
    /// Where it stands.
    pub x: f64,
    /// Stands at its head.
    pub name: String,
}

/// One chart.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Chart {
    /// Above it.
    pub title: String,
    /// Along the horizontal axis, with the unit.
    pub x: String,
    /// Along the vertical axis, with the unit.
    pub y: String,
    /// How the horizontal and the vertical axis go.
    pub scales: (Scale, Scale),
    /// What is drawn.
    pub series: Vec<Series>,
    /// Upright lines; those outside the points' range are left out.
    pub rules: Vec<Rule>,
    /// A picture of numbers beneath; the axes are then its own.
    pub heat: Option<Heat>,
    /// Counts by class instead of all that; the axes are then their own.
    pub matrix: Option<Matrix>,
}

impl Chart {
    /// Whether there is anything to draw.
    pub fn is_empty(&self) -> bool {
        let empty = self.heat.as_ref().is_none_or(Heat::is_empty) && self.matrix.as_ref().is_none_or(Matrix::is_empty);
        empty && self.series.iter().all(|s| self.drawable(s).next().is_none())
    }

    /// The points of a series that have a place.
    fn drawable<'a>(&self, series: &'a Series) -> impl Iterator<Item = (f64, f64)> + use<'a> {
        let (x, y) = self.scales;
        series.points.iter().copied().filter(move |p| x.holds(p.0) && y.holds(p.1))
    }
}

/// Draws charts side by side, many of them in rows, into `path.png` and `path.svg`; empty ones are left out, and nothing is written when all are.
///
/// # Errors
/// When a file can't be written.
pub fn draw(path: &Path, charts: &[Chart]) -> Result<()> {
    draw_as(&path.with_extension("svg"), charts)?;
    draw_as(&path.with_extension("png"), charts)
}

/// The same into one file, as its extension says.
///
/// # Errors
/// Another extension than `png` and `svg`; when the file can't be written.
pub fn draw_as(path: &Path, charts: &[Chart]) -> Result<()> {
    to_bytes(path, charts)?.map_or(Ok(()), |bytes| files::write_whole(path, &bytes))
}

/// The bytes that [`draw_as`] writes, with our mark inside; `None` where there is nothing to draw.
///
/// # Errors
/// Another extension than `png` and `svg`.
pub fn to_bytes(path: &Path, charts: &[Chart]) -> Result<Option<Vec<u8>>> {
    let kind = kind(path)?;
    let charts: Vec<&Chart> = charts.iter().filter(|c| !c.is_empty()).collect();
    if charts.is_empty() {
        return Ok(None);
    }
    with_font();
    let failed = |e: String| Error::io(path)(std::io::Error::other(format!("the chart could not be drawn: {e}")));
    let (rows, columns) = picture::grid_of(charts.len());
    let one = if rows > 1 { SMALL } else { SIZE };
    let size = (one.0 * columns as u32, one.1 * rows as u32);
    match kind {
        Kind::Svg => {
            let mut text = String::new();
            picture::all(SVGBackend::with_string(&mut text, size).into_drawing_area(), &charts).map_err(failed)?;
            let at = text.find('>').map_or(0, |i| i + 1); // behind the first tag, which an XML file begins with
            text.insert_str(at, TEXT_MARK);
            Ok(Some(text.into_bytes()))
        }
        Kind::Png => {
            let mut pixels = vec![0; 3 * (size.0 * size.1) as usize];
            picture::all(BitMapBackend::with_buffer(&mut pixels, size).into_drawing_area(), &charts).map_err(failed)?;
            Ok(Some(png(size, &pixels).map_err(|e| failed(e.to_string()))?))
        }
    }
}

/// Pixels of red, green and blue as PNG.
fn png((width, height): (u32, u32), pixels: &[u8]) -> std::result::Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.add_text_chunk("Software".into(), "kinelm".into())?;
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels)?;
    writer.finish()?;
    Ok(bytes)
}

/// Refuses a file that no chart can be drawn into, before there is one.
///
/// # Errors
/// Another extension than `png` and `svg`.
pub fn check(path: &Path) -> Result<()> {
    kind(path).map(|_| ())
}

/// What a picture is written as.
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
