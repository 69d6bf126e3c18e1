//! A page of dances: beside them strips, colours of a joint's rotation, and measures over time, each with the moment that
//! is worth a look. docs/measures.md, "A page".

use super::coded::Dance;
use super::copying::{HOP_S, WINDOW_S};
use super::freeze::{ROUNDING_CM_S, energy};
use super::positions::JointPositions;
use super::reference::Reference;
use super::report::Copied;
use crate::Result;
use kinelm_corpus::Split;
use kinelm_motion::metric::BalanceFrame;
use kinelm_motion::metric::angular::angular_motion;
use kinelm_view::panel::{Bands, Choice, Lines, Moment, Moments, Panel, Strip, Track};
use kinelm_view::{Figure, Page};
use std::path::Path;

/// Seconds from one figure of a strip to the next.
const EVERY_S: f64 = 0.5;
/// The last colour is of this percentile of all dances: a single step would leave the rest dark.
const BRIGHTEST: f64 = 0.98;
/// What the colours show, with the unit.
const ROTATION: [(&str, &str); 3] =
    [("Angular velocity", "°/s"), ("Angular acceleration", "°/s²"), ("Angular jerk", "°/s³")];

/// A dance's measures over time.
struct Series {
    energy_cm_s: Vec<f64>,
    still: Vec<bool>,
    balance: Vec<BalanceFrame>,
    nearest_cm: Vec<f64>,
}

impl Reference<'_> {
    /// The real dance to show beside another, as far as that lasts: the corpus's clip of the file with this hash, else its
    /// first validation clip, else its first training clip.
    ///
    /// # Errors
    /// Words that can't be decoded.
    pub fn beside(&self, other: &Dance, sha256: Option<&str>) -> Result<Dance> {
        let own = self.corpus.clips().iter().find(|record| Some(&*record.sha256) == sha256);
        let split = |split| self.corpus.split(split).next();
        let record = own.or_else(|| split(Split::Valid)).or_else(|| split(Split::Train));
        // `check` has refused a corpus without a training frame
        let record = record.expect("a corpus with a training clip");
        let dance = Dance::of_corpus(self.corpus, record)?;
        let frames = dance.clip.frames().min(other.clip.frames());
        Ok(Dance { name: format!("{} (real)", dance.name), clip: dance.clip.slice(0..frames), ..dance })
    }

    /// A page that plays dances as they are measured, decoded, with panels of measures over time; `copied`: of the first of
    /// them.
    ///
    /// # Errors
    /// Those of [`Page::html`].
    pub fn page(&self, dances: &[&Dance], copied: Option<&Copied>) -> Result<String> {
        let figures: Vec<Figure> = dances.iter().map(|dance| Figure::new(label(dance), &dance.clip)).collect();
        Ok(Page::new(&figures).panels(&self.panels(dances, copied)).html()?)
    }

    fn panels(&self, dances: &[&Dance], copied: Option<&Copied>) -> Vec<Panel> {
        let series = |(i, dance): (usize, &&Dance)| {
            let energy_cm_s = energy(&JointPositions::of(&dance.clip, &self.joints));
            let nearest_cm = copied.and_then(|copied| copied.nearest_cm.get(i)).cloned().unwrap_or_default();
            Series {
                still: energy_cm_s.iter().map(|e| *e <= self.thresholds[0] + ROUNDING_CM_S).collect(),
                energy_cm_s,
                balance: BalanceFrame::of(&self.legs, &dance.clip),
                nearest_cm,
            }
        };
        let all: Vec<Series> = dances.iter().enumerate().map(series).collect();
        let limit_cm = copied.and_then(|copied| copied.limit_cm);
        let mut panels: Vec<Panel> = (0..dances.len())
            .map(|figure| Panel::Strip(Strip { title: label(dances[figure]), figure, every_s: EVERY_S }))
            .collect();
        panels.push(Panel::Moments(Moments { title: "Moments".into(), moments: self.moments(&all, limit_cm) }));
        panels.push(self.rotation(dances));
        let names: Vec<String> = dances.iter().map(|dance| label(dance)).collect();
        panels.extend(self.over_time(&all, &names, limit_cm));
        panels
    }

    /// Colours of a joint's rotation in all dances, one joint after the other by a menu.
    fn rotation(&self, dances: &[&Dance]) -> Panel {
        let of_joint = |joint: usize| {
            let each: Vec<_> = dances.iter().map(|dance| angular_motion(&dance.clip, joint)).collect();
            let bands = ROTATION.iter().enumerate().map(|(order, (title, unit))| {
                let degrees = |values: &[f64]| values.iter().map(|x| x.to_degrees()).collect::<Vec<f64>>();
                let values: Vec<Vec<f64>> = each.iter().map(|motion| degrees(&motion[order])).collect();
                let mut sorted = values.concat();
                sorted.sort_by(f64::total_cmp);
                let most = super::percentile(&sorted, BRIGHTEST).unwrap_or(0.0);
                // a difference of frames belongs to the time between them
                let from_s = 0.5 * (order + 1) as f64 / self.fps;
                let tracks = values.into_iter().enumerate().map(|(i, x)| self.track(dances[i], i, from_s, x)).collect();
                let range = (most > 0.0).then_some([0.0, most]);
                Panel::Bands(Bands { title: (*title).into(), unit: (*unit).into(), tracks, range })
            });
            (kinelm_motion::smpl::NAMES[joint].replace('_', " "), bands.collect())
        };
        Panel::Choice(Choice { title: "Joint".into(), options: self.joints.iter().map(|&j| of_joint(j)).collect() })
    }

    fn track(&self, dance: &Dance, figure: usize, from_s: f64, values: Vec<f64>) -> Track {
        Track { name: label(dance), figure: Some(figure), fps: self.fps, from_s, values }
    }

    fn over_time(&self, all: &[Series], names: &[String], limit_cm: Option<f64>) -> Vec<Panel> {
        let tracks = |what: &str, of: &dyn Fn(&Series) -> Vec<f64>| -> Vec<Track> {
            let one = |(figure, series): (usize, &Series)| Track {
                name: format!("{}{what}", names[figure]),
                figure: Some(figure),
                fps: self.fps,
                from_s: 0.0,
                values: of(series),
            };
            all.iter().enumerate().map(one).collect()
        };
        // a line that no figure has, over the longest dance
        let line = |name: &str, value: f64| {
            let frames = all.iter().map(|series| series.energy_cm_s.len()).max().unwrap_or(0);
            Track { name: name.into(), figure: None, fps: self.fps, from_s: 0.0, values: vec![value; frames] }
        };
        let is = |is: bool| f64::from(u8::from(is));
        let flags =
            |of: &dyn Fn(&BalanceFrame) -> bool, s: &Series| s.balance.iter().map(|frame| is(of(frame))).collect();
        let speed = tracks("", &|s| s.energy_cm_s.clone());
        let outside = tracks("", &|s| s.balance.iter().map(|f| f.outside_m.map_or(f64::NAN, |m| 100.0 * m)).collect());
        let mut contacts = tracks(", left", &|s| flags(&|frame| frame.contacts[0], s));
        contacts.extend(tracks(", right", &|s| flags(&|frame| frame.contacts[1], s)));
        contacts.sort_by_key(|track| track.figure);
        let lines =
            |title: &str, unit: &str, tracks| Panel::Lines(Lines { title: title.into(), unit: unit.into(), tracks });
        let bands = |title: &str, tracks| {
            Panel::Bands(Bands { title: title.into(), unit: String::new(), tracks, range: Some([0.0, 1.0]) })
        };
        let with_line = |mut tracks: Vec<Track>, name: &str, value: Option<f64>| {
            tracks.extend(value.map(|value| line(name, value)));
            tracks
        };
        let mut panels = vec![
            lines("Speed", "cm/s", with_line(speed, "stands still", Some(self.thresholds[0]))),
            bands("Stands still", tracks("", &|s| s.still.iter().map(|still| is(*still)).collect())),
            lines("Centre of mass outside the feet", "cm", outside),
            bands("Feet on the floor", contacts),
        ];
        if all.iter().any(|series| !series.nearest_cm.is_empty()) {
            let mut nearest = tracks("", &|s| s.nearest_cm.clone());
            // a window's distance stands at its middle
            nearest.retain(|track| !track.values.is_empty());
            nearest.iter_mut().for_each(|track| (track.fps, track.from_s) = (1.0 / self.hop_s(), WINDOW_S / 2.0));
            panels.push(lines("Distance to the nearest training clip", "cm", with_line(nearest, "a copy", limit_cm)));
        }
        panels
    }

    /// Seconds from one window of the search for copies to the next: whole frames.
    fn hop_s(&self) -> f64 {
        (HOP_S * self.fps).round().max(1.0) / self.fps
    }

    fn moments(&self, all: &[Series], limit_cm: Option<f64>) -> Vec<Moment> {
        let seconds = |frame: usize| frame as f64 / self.fps;
        let mut moments = Vec::new();
        for (figure, series) in all.iter().enumerate() {
            let mut add = |at_s: f64, label: String| moments.push(Moment { label, at_s, figure: Some(figure) });
            if let Some((frame, speed)) = highest(series.energy_cm_s.iter().copied().enumerate()) {
                add(seconds(frame), format!("fastest: {speed:.0} cm/s"));
            }
            let mut at = 0;
            let runs = series.still.chunk_by(|a, b| a == b).map(|run| {
                at += run.len();
                (at - run.len(), if run[0] { run.len() as f64 } else { 0.0 })
            });
            if let Some((frame, frames)) = highest(runs.collect::<Vec<_>>().into_iter()).filter(|run| run.1 > 0.0) {
                add(seconds(frame), format!("stands still for {:.1} s", frames / self.fps));
            }
            let outside = series.balance.iter().enumerate().filter_map(|(f, frame)| Some((f, frame.outside_m?)));
            if let Some((frame, metres)) = highest(outside).filter(|(_, metres)| *metres > 0.0) {
                add(seconds(frame), format!("least balanced: {:.0} cm outside", 100.0 * metres));
            }
            if let Some((window, near)) = highest(series.nearest_cm.iter().map(|cm| -cm).enumerate()) {
                let what = if limit_cm.is_some_and(|limit| -near < limit) { "a copy" } else { "nearest to training" };
                add(window as f64 * self.hop_s(), format!("{what}: {:.1} cm", -near));
            }
        }
        moments
    }
}

/// A dance's name without folders and ending: panels have little room.
fn label(dance: &Dance) -> String {
    Path::new(&dance.name).file_stem().map_or_else(|| dance.name.clone(), |stem| stem.to_string_lossy().into_owned())
}

/// The first of the highest numbers, with its index.
fn highest(numbers: impl Iterator<Item = (usize, f64)>) -> Option<(usize, f64)> {
    numbers.fold(None, |best, (i, x)| if best.is_some_and(|(_, most)| most >= x) { best } else { Some((i, x)) })
}
