//! Small grey text, and the result type of drawing.

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// The result of drawing.
pub type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

pub const GREY: RGBColor = RGBColor(90, 90, 90);
/// Width of a letter of the legend, pixels.
pub const LETTER: f64 = 7.3;

/// Small grey text.
pub fn style(size: u32, h: HPos, v: VPos) -> TextStyle<'static> {
    TextStyle::from(("sans-serif", size).into_font()).color(&GREY).pos(Pos::new(h, v))
}
