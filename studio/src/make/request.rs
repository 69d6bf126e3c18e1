//! What a page may request, as the library's request.

use super::model::Model;
use crate::library::{Library, Source};
use crate::timeline::{Laid, Timelines};
use crate::{Error, Result};
use kinelm_generate::request::{
    Computing, Edit, FloorPath, FootMode, Length, Loop, LoopKind, MusicRequest, PromptRequest, Request, Rig, Span,
};
use kinelm_generate::sampling::Sampling;
use kinelm_generate::timeline::TimelineLayout;
use kinelm_model::{KvKind, WeightKind};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Dances side by side.
pub const MOST_VARIATIONS: usize = 8;
/// Dances among which the best are chosen.
const MOST_BEST: usize = 16;
/// The longest dance, seconds.
const LONGEST_S: f64 = 600.0;
/// The highest rate that may be requested, frames a second.
const MOST_FPS: f64 = 240.0;
/// Continuations of every two seconds of a dance from nothing, over all its variations.
const LOOK_AHEAD: usize = 8;
/// Seconds of a dance from nothing.
const FREE_S: f64 = 8.0;

/// What a dance is made of.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Nothing.
    #[default]
    Free,
    /// Joints of a clip, throughout.
    Given,
    /// A clip, of which some joints are freed for a time.
    Edit,
    /// A clip, whose end leads into its beginning.
    Loop,
    /// The timeline.
    Timeline,
}

/// A page's request.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Make {
    /// What the dance is made of.
    pub kind: Kind,
    /// A clip or a dance: a new dance has its rig and its rate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clip: Option<String>,
    /// The joints that are given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joints: Option<String>,
    /// What is freed: `left_arm@4s:8s`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub free: Vec<Span>,
    /// The length.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Frames per second of the file; by itself as the library decides.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fps: Option<f64>,
    /// Values of label fields.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub labels: BTreeMap<String, String>,
    /// The seed; by itself a random one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u32>,
    /// The temperature.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature: Option<f64>,
    /// Top-p.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub top_p: Option<f64>,
    /// Guidance by labels and music.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub guidance: Option<f64>,
    /// Feet.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub feet: Option<FootMode>,
    /// Dances side by side.
    #[serde(default = "one")]
    pub variations: usize,
    /// Dances among which they are chosen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub best: Option<usize>,
    /// A path over the floor that a new dance goes along.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<FloorPath>,
    /// What comes back in a loop.
    #[serde(default, rename = "loop", skip_serializing_if = "Option::is_none")]
    pub looping: Option<LoopKind>,
    /// Seconds at the end of a loop that are generated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loop_over: Option<f64>,
    /// Music of the library to dance to, for a model that is conditioned on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub music: Option<String>,
    /// The time of the music when the dance begins.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub music_from_s: Option<f64>,
}

fn one() -> usize {
    1
}

/// A request of the library, and what it is of.
pub struct Prepared {
    /// The request.
    pub request: Request,
    /// Its timeline, laid out.
    pub layout: Option<TimelineLayout>,
    /// The clip or dance that it is made from.
    pub source: Option<Source>,
    /// The one that lends its rig to a new dance.
    pub rig: Option<String>,
}

impl Make {
    /// A dance of eight seconds from nothing.
    pub fn free() -> Make {
        Make { variations: 1, ..Make::default() }
    }

    /// Refuses numbers outside their ranges.
    ///
    /// # Errors
    /// The number and its range.
    pub fn check(&self) -> Result<()> {
        if !(1..=MOST_VARIATIONS).contains(&self.variations) {
            return Err(Error::invalid_parameter("variations", self.variations, format!("1 to {MOST_VARIATIONS}")));
        }
        // the best of one is no choice
        if let Some(best) = self.best.filter(|best| !(self.variations.max(2)..=MOST_BEST).contains(best)) {
            let expected = format!("{} to {MOST_BEST}, at least as many as variations", self.variations.max(2));
            return Err(Error::invalid_parameter("best", best, expected));
        }
        let limits = [
            ("seconds", self.seconds, 0.05, LONGEST_S),
            ("fps", self.fps, 1.0, MOST_FPS),
            ("guidance", self.guidance, 0.0, 10.0),
            ("loop_over", self.loop_over, 0.1, 60.0),
            ("music_from_s", self.music_from_s, 0.0, 24.0 * 3600.0),
        ];
        for (name, number, least, most) in limits {
            if let Some(number) = number.filter(|number| !(least..=most).contains(number)) {
                return Err(Error::invalid_parameter(name, number, format!("{least} to {most}")));
            }
        }
        let sampling = self.sampling();
        Ok(sampling.validate()?)
    }

    fn sampling(&self) -> Sampling {
        let temperature = self.temperature.unwrap_or(Sampling::default().temperature);
        Sampling { top_p: self.top_p, ..Sampling::temperature(temperature) }
    }

    /// The request of the library.
    ///
    /// # Errors
    /// Those of [`Library::source`]; nothing to make it of.
    pub fn prepare(&self, model: &Model, library: &Library, timelines: &Timelines) -> Result<Prepared> {
        self.check()?;
        let mut request = Request {
            labels: self.labels.clone(),
            guidance: self.guidance,
            length: self.seconds.map(Length::Seconds),
            fps: self.fps,
            seed: self.seed.map(u64::from),
            sampling: self.sampling(),
            feet: self.feet,
            path: self.path.clone(),
            // shown while they are sampled: twice the speed, at a cost in bits that is hardly measurable
            computing: Some(Computing { weights: WeightKind::Int8, kv: KvKind::Int8, ..Computing::default() }),
            checkpoint: model.checkpoint,
            ..Request::of(&model.run)
        };
        if let Some(music) = &self.music {
            request.music = Some(MusicRequest::of(library.sound(music)?, self.music_from_s));
        }
        let (mut layout, mut source, mut rig) = (None, None, None);
        match self.kind {
            Kind::Free => {
                // the same work whatever the number of dances
                let dances = self.best.unwrap_or(self.variations);
                request.look_ahead = model.is_causal.then_some((LOOK_AHEAD / dances).max(1));
                // with music the dance is as long as the music, along a path as long as that
                if request.music.is_none() && request.path.is_none() {
                    request.length = request.length.or(Some(Length::Seconds(FREE_S)));
                }
                if let Some(clip) = &self.clip {
                    let found = library.source(clip)?;
                    request.prompt = Some(of_file(&found));
                    request.rig = Some(Rig::Prompt);
                    rig = Some(found.id);
                }
            }
            Kind::Timeline => {
                let (text, _) = timelines.project().timeline()?;
                let none = || Error::Conflict("the timeline is empty: use a clip first".into());
                let Laid { timeline, layout: laid } = timelines.lay_out(&text.ok_or_else(none)?)?;
                request.timed_labels.clone_from(&laid.labels);
                source = timelines.sources().into_iter().find(|source| source.path == laid.path());
                request.prompt = Some(laid.prompt(timeline, None, None));
                layout = Some(laid);
            }
            Kind::Given | Kind::Edit | Kind::Loop => {
                let clip = self.clip.clone().or_else(|| rig_of(timelines));
                let clip = clip.ok_or_else(|| Error::missing("`clip`", "name the one that the dance is made of"))?;
                let found = library.source(&clip)?;
                request.prompt = Some(self.prompt(&found)?);
                request.rig = Some(Rig::Prompt);
                source = Some(found);
            }
        }
        Ok(Prepared { request, layout, source, rig })
    }

    /// The prompt that is made of a clip.
    fn prompt(&self, source: &Source) -> Result<PromptRequest> {
        let prompt = of_file(source);
        Ok(match self.kind {
            Kind::Edit if self.free.is_empty() => {
                return Err(Error::missing("`free`", "say which joints are free, and when: left_arm@4s:8s"));
            }
            Kind::Edit => PromptRequest { edit: Some(Edit::of(self.free.clone())), ..prompt },
            Kind::Loop => {
                let looping = Some(Loop { kind: self.looping.unwrap_or_default(), over_s: self.loop_over });
                PromptRequest { edit: Some(Edit { looping, ..Edit::default() }), ..prompt }
            }
            _ => {
                let joints = self.joints.clone().unwrap_or_else(|| "root,torso".into());
                PromptRequest { joints: Some(joints), ..prompt }
            }
        })
    }

    /// A name for dances of it.
    pub fn name(&self, source: Option<&Source>) -> String {
        let of = source.map_or("dance", |source| &source.name);
        match self.kind {
            Kind::Free => "free dance".into(),
            Kind::Given => format!("{of} followed"),
            Kind::Edit => {
                let joints: Vec<String> = self.free.iter().map(|span| span.joints.replace('_', " ")).collect();
                format!("{of}, another {}", joints.join(" and "))
            }
            Kind::Loop => format!("{of} looped"),
            Kind::Timeline => source.map_or_else(|| "timeline".into(), |source| format!("{} anew", source.name)),
        }
    }
}

/// A clip or a dance, of which nothing is given yet.
fn of_file(source: &Source) -> PromptRequest {
    PromptRequest { read: source.read.clone(), ..PromptRequest::of(&source.path) }
}

/// The id of the clip that lends the timeline its rig.
fn rig_of(timelines: &Timelines) -> Option<String> {
    let (view, _) = timelines.view().ok()?;
    let rig = view["rig"].as_str()?;
    view["clips"][rig]["clip"].as_str().map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> std::result::Result<Make, String> {
        let make: Make = serde_json::from_str(text).map_err(|e| e.to_string())?;
        make.check().map(|()| make).map_err(|e| e.to_string())
    }

    #[test]
    fn a_request_is_read_strictly() {
        let make = parsed(r#"{"kind": "edit", "clip": "c1", "free": ["left_arm@4s:8s"], "variations": 4}"#).unwrap();
        assert_eq!((make.free[0].joints.as_str(), make.variations, make.best), ("left_arm", 4, None));
        for (text, expected) in [
            (r#"{"kind": "edit", "file": "/etc/passwd"}"#, "unknown field `file`"),
            (r#"{"kind": "free", "variations": 9}"#, "1 to 8"),
            (r#"{"kind": "free", "variations": 0}"#, "1 to 8"),
            (r#"{"kind": "free", "variations": 4, "best": 3}"#, "4 to 16"),
            (r#"{"kind": "free", "seconds": 1e9}"#, "0.05 to 600"),
            (r#"{"kind": "free", "fps": 0.5}"#, "1 to 240"),
            (r#"{"kind": "free", "seconds": -1}"#, "0.05 to 600"),
            (r#"{"kind": "free", "temperature": 0}"#, "a number above 0"),
            (r#"{"kind": "free", "top_p": 2}"#, "up to 1"),
            (r#"{"kind": "edit", "free": ["@1:2"]}"#, "names no joints"),
            (r#"{"kind": "free", "path": [[0, 0, 0]]}"#, "fewer than 2 places"),
            (r#"{"kind": "dance"}"#, "unknown variant"),
        ] {
            let said = parsed(text).unwrap_err();
            assert!(said.contains(expected), "{text}: {said}");
        }
    }
}
