//! Panels beside the dancers: curves, colours and stick figures over time, moments to jump to, small tables. They take
//! plain data and know no measure. All share the page's time: a playhead runs through them, and a click seeks.

use crate::data::base64;
use crate::words::Words;
use crate::{Error, Figure, Result};
use serde_json::{Value, json};

/// A panel of a page.
#[derive(Debug, Clone, PartialEq)]
pub enum Panel {
    /// Curves over time.
    Lines(Lines),
    /// Rows of colours over time.
    Bands(Bands),
    /// Moments to jump to.
    Moments(Moments),
    /// A small table.
    Facts(Facts),
    /// A dancer as a row of stick figures.
    Strip(Strip),
    /// One of several groups of panels, by a menu.
    Choice(Choice),
    /// The words that a dancer decodes from.
    Words(Words),
}

/// A number over time.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Track {
    /// Its name.
    pub name: String,
    /// The index of the figure whose colour it has; `None`: no figure's.
    pub figure: Option<usize>,
    /// Values a second, above 0.
    pub fps: f64,
    /// The time of the first value, seconds of the page.
    pub from_s: f64,
    /// The values; NaN and infinities are gaps.
    pub values: Vec<f64>,
}

/// Curves over time on one scale, which spans all values and 0 if it is near.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Lines {
    /// The title.
    pub title: String,
    /// The unit of the values; may be empty.
    pub unit: String,
    /// The curves.
    pub tracks: Vec<Track>,
}

/// Rows of colours over time on one scale.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Bands {
    /// The title.
    pub title: String,
    /// The unit of the values; may be empty.
    pub unit: String,
    /// The rows, from top to bottom.
    pub tracks: Vec<Track>,
    /// The values of the first and the last colour; `None`: the least and the greatest.
    pub range: Option<[f64; 2]>,
}

/// Buttons that seek.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Moments {
    /// The title.
    pub title: String,
    /// The moments, in the order of the buttons.
    pub moments: Vec<Moment>,
}

/// A moment to jump to.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Moment {
    /// What is to be seen there.
    pub label: String,
    /// Seconds of the page.
    pub at_s: f64,
    /// The index of the figure whose colour it has.
    pub figure: Option<usize>,
}

/// A small table.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Facts {
    /// The title.
    pub title: String,
    /// The columns' names; may be empty.
    pub head: Vec<String>,
    /// The rows.
    pub rows: Vec<Vec<String>>,
}

/// A dancer as a row of stick figures, seen from the front.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Strip {
    /// The title.
    pub title: String,
    /// The figure's index.
    pub figure: usize,
    /// Seconds from one to the next, above 0; fewer are drawn where there is no room.
    pub every_s: f64,
}

/// Groups of panels, of which a menu shows one.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Choice {
    /// The menu's label.
    pub title: String,
    /// The groups' names and panels; the first is shown at the start.
    pub options: Vec<(String, Vec<Panel>)>,
}

impl Panel {
    /// Whether it or a part of it is of words.
    pub(crate) fn has_words(&self) -> bool {
        match self {
            Panel::Words(_) => true,
            Panel::Choice(Choice { options, .. }) => {
                options.iter().flat_map(|(_, panels)| panels).any(Panel::has_words)
            }
            _ => false,
        }
    }

    /// The JSON for the page's script.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a figure that the page doesn't have, and for rates and times that are no positive numbers.
    pub(crate) fn json(&self, figures: &[Figure]) -> Result<Value> {
        Ok(match self {
            Panel::Lines(Lines { title, unit, tracks }) => {
                json!({ "kind": "lines", "title": title, "unit": unit, "tracks": of_tracks(title, tracks, figures)? })
            }
            Panel::Bands(Bands { title, unit, tracks, range }) => {
                let tracks = of_tracks(title, tracks, figures)?;
                json!({ "kind": "bands", "title": title, "unit": unit, "tracks": tracks, "range": range })
            }
            Panel::Moments(Moments { title, moments }) => {
                let one = |moment: &Moment| {
                    check_figure(title, moment.figure, figures)?;
                    check(title, "a moment", moment.at_s, moment.at_s.is_finite())?;
                    Ok(json!({ "label": moment.label, "at": rounded(moment.at_s), "figure": moment.figure }))
                };
                let moments = moments.iter().map(one).collect::<Result<Vec<_>>>()?;
                json!({ "kind": "moments", "title": title, "moments": moments })
            }
            Panel::Facts(Facts { title, head, rows }) => {
                json!({ "kind": "facts", "title": title, "head": head, "rows": rows })
            }
            Panel::Strip(Strip { title, figure, every_s }) => {
                check_figure(title, Some(*figure), figures)?;
                check(title, "seconds between figures", *every_s, every_s.is_finite() && *every_s > 0.0)?;
                json!({ "kind": "strip", "title": title, "figure": figure, "every": every_s })
            }
            Panel::Choice(Choice { title, options }) => {
                let group = |panels: &Vec<Panel>| panels.iter().map(|p| p.json(figures)).collect::<Result<Vec<_>>>();
                let one = |(name, panels): &(String, Vec<Panel>)| Ok(json!({ "name": name, "panels": group(panels)? }));
                let options = options.iter().map(one).collect::<Result<Vec<_>>>()?;
                json!({ "kind": "choice", "title": title, "options": options })
            }
            Panel::Words(words) => {
                check_figure(&words.title, Some(words.figure), figures)?;
                words.json(figures[words.figure].clip)?
            }
        })
    }
}

/// Values as 16-bit numbers between the least and the greatest of the track; the last number is a gap.
fn of_tracks(title: &str, tracks: &[Track], figures: &[Figure]) -> Result<Vec<Value>> {
    let one = |track: &Track| {
        let Track { name, figure, fps, from_s, values } = track;
        check_figure(title, *figure, figures)?;
        check(title, "values a second", *fps, fps.is_finite() && *fps > 0.0)?;
        check(title, "the time of the first value", *from_s, from_s.is_finite())?;
        let finite = || values.iter().copied().filter(|x| x.is_finite());
        let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        // a track without values, or of one value, needs a step all the same
        let low = if low.is_finite() { low } else { 0.0 };
        let step = ((high - low) / 65534.0).max(f64::MIN_POSITIVE);
        let number = |x: &f64| if x.is_finite() { ((x - low) / step).round() as u16 } else { u16::MAX };
        let bytes: Vec<u8> = values.iter().map(number).flat_map(u16::to_le_bytes).collect();
        let (step, data) = (if high > low { step } else { 0.0 }, base64(&bytes));
        Ok(json!({ "name": name, "figure": figure, "fps": fps, "from": rounded(*from_s), "count": values.len(),
            "low": low, "step": step, "data": data }))
    };
    tracks.iter().map(one).collect()
}

/// Seconds to a tenth of a millisecond.
fn rounded(seconds: f64) -> f64 {
    (seconds * 1e4).round() / 1e4
}

fn check_figure(title: &str, figure: Option<usize>, figures: &[Figure]) -> Result<()> {
    match figure.filter(|figure| *figure >= figures.len()) {
        None => Ok(()),
        Some(n) => {
            let why = format!("figure {n} of {}; expected one of the page", figures.len());
            Err(Error::unsupported(format!("the panel {title:?}"), why))
        }
    }
}

fn check(title: &str, what: &str, found: f64, holds: bool) -> Result<()> {
    match holds {
        true => Ok(()),
        false => {
            let why = format!("{what}: {found}; expected a number above 0, or a time");
            Err(Error::unsupported(format!("the panel {title:?}"), why))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::synth;

    #[test]
    fn values_come_back_within_a_step_and_gaps_stay_gaps() {
        let clip = synth::corpus(1, 1, 1.0, 30.0).unwrap().remove(0).clip;
        let figures = [Figure::new("a", &clip)];
        let values = vec![-2.0, f64::NAN, 0.5, 6.0, f64::INFINITY];
        let track = Track { name: "speed".into(), figure: Some(0), fps: 30.0, from_s: 0.5, values: values.clone() };
        let lines = Lines { title: "t".into(), unit: "m/s".into(), tracks: vec![track.clone()] };
        let json = Panel::Lines(lines.clone()).json(&figures).unwrap();
        let found = &json["tracks"][0];
        let (low, step) = (found["low"].as_f64().unwrap(), found["step"].as_f64().unwrap());
        // -2 is the first number, 6 the last but one, and both gaps the last
        assert_eq!((low, (step * 65534.0 * 1e9).round()), (-2.0, 8e9));
        assert_eq!(found["data"], "AAD///9P/v///w==");
        let flat = Track { values: vec![3.0; 2], ..track.clone() };
        let json = Panel::Lines(Lines { tracks: vec![flat], ..lines.clone() }).json(&figures).unwrap();
        assert_eq!((&json["tracks"][0]["low"], &json["tracks"][0]["step"]), (&json!(3.0), &json!(0.0)));
        let said = |track: Track| {
            let panel = Panel::Bands(Bands { title: "b".into(), tracks: vec![track], ..Bands::default() });
            panel.json(&figures).unwrap_err().to_string()
        };
        assert!(said(Track { figure: Some(1), ..track.clone() }).contains("the panel \"b\": figure 1 of 1"));
        assert!(said(Track { fps: 0.0, ..track.clone() }).contains("values a second: 0"));
        assert!(said(Track { from_s: f64::NAN, ..track }).contains("first value: NaN"));
    }
}
