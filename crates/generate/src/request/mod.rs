//! What decides a dance, as values that files can hold: a [`Request`] as a caller makes it, and a [`Resolved`] one, in
//! which nothing is left open.

mod computing;
mod edit;
mod floor_path;
mod labels;
mod options;
mod prompt;
mod resolved;
mod span;
pub(crate) mod timeline;

pub use computing::Computing;
pub use edit::{Edit, Loop, LoopKind};
pub use floor_path::FloorPath;
pub use labels::TimedLabel;
pub use options::{FootMode, LeadInKind, Length, Placement, Rig, Seeding, UncodedJoints};
pub use prompt::{MusicRequest, PromptRequest};
pub use resolved::Resolved;
pub use span::Span;
pub use timeline::{At, Segment, Timeline, TimelineClip};

use crate::sampling::Sampling;
use kinelm_model::CheckpointChoice;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A request to a model. [`crate::open::OpenRequest::open`] decides every option that is `None`.
///
/// ```
/// use kinelm_generate::request::{Length, Request};
///
/// let request = Request { length: Some(Length::Seconds(10.0)), seed: Some(7), ..Request::of("run") };
/// assert_eq!((request.seed, request.guidance), (Some(7), None));
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Request {
    /// The run folder of the model.
    pub run: PathBuf,
    /// Which of its checkpoints; the sidecar of a dance has its step.
    pub checkpoint: CheckpointChoice,
    /// A clip of which something is given, or which lends its rig and its rate.
    pub prompt: Option<PromptRequest>,
    /// A path over the floor, along which the dance is led. A prompt beside it may lend its rig or give joints other than the
    /// root.
    pub path: Option<FloorPath>,
    /// Values of label fields for the whole dance. Fields that are left out are unknown to the model.
    pub labels: BTreeMap<String, String>,
    /// Values of label fields for a part of the dance.
    pub timed_labels: Vec<TimedLabel>,
    /// Music to dance to.
    pub music: Option<MusicRequest>,
    /// Scale of classifier-free guidance by labels and music; 1 is the model as trained. `None`: with music the scale that
    /// suits the model's music conditioning ([`crate::open::MUSIC_GUIDANCE`] with beats), with labels
    /// [`crate::open::LABEL_GUIDANCE`] where the model was taught without some of them too, else 1.
    pub guidance: Option<f64>,
    /// Scale of guidance towards the goals after gaps, 0 to 10; 1 is the model as trained. `None`:
    /// [`crate::open::GOAL_GUIDANCE`] where the model is goal-conditioned and a gap ends, else 0.
    pub goal_guidance: Option<f64>,
    /// Length of the dance. `None`: that of the given part of the prompt, else of the music, else of the prompt.
    pub length: Option<Length>,
    /// Frames per second of the file that is written, on a smooth curve through the model's frames. `None`: the prompt's, else
    /// [`crate::open::FPS`]. An edit at the rate of its file keeps the file's numbers.
    pub fps: Option<f64>,
    /// The lead-in of an unprompted dance. `None`: a second of a train clip where the run stores some.
    pub lead_in: Option<LeadInKind>,
    /// Candidates for the first frame. `None`: [`crate::sampler::FIRST_FRAMES`] where some joints of it are given after
    /// free ones.
    pub first_frames: Option<usize>,
    /// Continuations of every block of two seconds, of which the most believable is kept, at most
    /// [`crate::open::MOST_CANDIDATES`]; 1: none. `None`: 1.
    pub look_ahead: Option<usize>,
    /// Passes of a masked model over a window, at most [`crate::masked::MOST_PASSES`]. `None`:
    /// [`crate::masked::PASSES`].
    pub passes: Option<usize>,
    /// Seed of the random streams: the same request with the same seed gives the same dance. `None`: [`crate::open::SEED`].
    pub seed: Option<u64>,
    /// Inputs of the random streams beside the seed. `None`: [`Seeding::Inputs`].
    pub seeding: Option<Seeding>,
    /// How free characters are sampled. Where none of its rules truncates, `top_p` is chosen:
    /// [`crate::sampling::default_top_p`], or [`crate::open::GIVEN_TOP_P`] where joints are given from end to end, or
    /// [`crate::open::GAP_TOP_P`] where the model is goal-conditioned, a gap ends and its guidance isn't 0.
    pub sampling: Sampling,
    /// The rig that the dance is written on. `None`: the prompt's own where a clip is edited, else the model's.
    pub rig: Option<Rig>,
    /// What the joints do that the model doesn't code. `None`: they follow the prompt if something of it is given, else hold
    /// the mean of the training clips.
    pub uncoded_joints: Option<UncodedJoints>,
    /// Foot locking. `None`: locked unless a leg is given.
    pub feet: Option<FootMode>,
    /// The device and the form that compute the model. `None`: [`Computing::default`].
    pub computing: Option<Computing>,
}

impl Request {
    /// The run and the files that are read.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        let prompt = self.prompt.iter().flat_map(PromptRequest::files);
        prompt.chain(self.music.iter().map(|music| music.path.clone())).chain([self.run.clone()])
    }

    /// A request of the model in the folder `run`, everything else left open.
    pub fn of(run: impl Into<PathBuf>) -> Request {
        Request { run: run.into(), ..Request::default() }
    }
}
