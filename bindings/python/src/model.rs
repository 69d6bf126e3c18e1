//! Models.

use crate::clip::{Clip, Prompt, positions};
use crate::corpus::{Corpus, split_of};
use crate::error::{library, wrong};
use crate::interrupt::Interrupt;
use crate::json::python;
use crate::options::{Reading, choice, named, parsed};
use crate::pool::detach;
use kinelm::generate::make::{Making, Preview};
use kinelm::generate::open::OpenRequest;
use kinelm::generate::request::{
    Edit, FloorPath, FootMode, Length, Loop, MusicRequest, PromptRequest, Request, Rig, Span,
};
use kinelm::generate::sampler::{NextToken, Sampler};
use kinelm::generate::sampling::Sampling;
use kinelm::model::{CheckpointChoice, Compute, load_run};
use kinelm::motion::format::RestFrame;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Deserialize;
use serde_json::json;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// A trained model: its run folder.
#[pyclass(frozen, module = "kinelm")]
pub struct Model {
    run: PathBuf,
    checkpoint: CheckpointChoice,
}

/// Options of a dance, besides its prompt.
#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct DanceOptions {
    joints: Option<String>,
    from_frame: Option<usize>,
    free: Vec<String>,
    r#loop: bool,
    path: Option<DrawnPath>,
    seconds: Option<f64>,
    frames: Option<usize>,
    fps: Option<f64>,
    labels: BTreeMap<String, String>,
    guidance: Option<f64>,
    look_ahead: Option<usize>,
    music: Option<PathBuf>,
    seed: Option<u64>,
    temperature: Option<f64>,
    top_p: Option<f64>,
    rig: Option<String>,
    lock_feet: Option<bool>,
    // as in `Reading`
    fps_source: Option<f64>,
    skip: usize,
    up: Option<String>,
    unit: Option<String>,
    map: Option<String>,
    root: Option<String>,
    take: Option<String>,
    mirror_axis: Option<String>,
}

/// A path over the floor: a file of it, or its places.
#[derive(Deserialize)]
#[serde(untagged)]
enum DrawnPath {
    File(PathBuf),
    Places(Vec<Vec<f64>>),
}

impl DrawnPath {
    fn get(self) -> PyResult<FloorPath> {
        let path = match self {
            DrawnPath::File(file) => FloorPath::read(&file),
            DrawnPath::Places(rows) => FloorPath::of(&rows),
        };
        path.map_err(library)
    }
}

impl Model {
    /// The model of a run folder that is one.
    pub fn of(run: PathBuf) -> Model {
        Model { run, checkpoint: CheckpointChoice::Auto }
    }

    /// Which checkpoint of the run it is.
    pub fn checkpoint(&self) -> CheckpointChoice {
        self.checkpoint
    }

    /// The request of a call.
    fn request(&self, prompt: Option<Prompt>, kwargs: Option<&Bound<'_, PyDict>>) -> PyResult<Request> {
        let options: DanceOptions = parsed(kwargs)?;
        let DanceOptions { fps_source, skip, up, unit, map, root, take, mirror_axis, .. } = options;
        let read = Reading { fps_source, skip, up, unit, map, root, take, mirror_axis }.options(RestFrame::Drop)?;
        let free = options.free.iter().map(|span| span.parse::<Span>()).collect::<Result<Vec<_>, _>>();
        let free = free.map_err(|e| wrong(e.to_string()))?;
        let looping = options.r#loop.then(Loop::default);
        let is_edited = !free.is_empty() || looping.is_some();
        let edit = is_edited.then(|| Edit { looping, ..Edit::of(free) });
        let rig = options.rig.as_deref().map(|rig| named(rig, "rig", &["model", "prompt"])).transpose()?;
        let (joints, from_frame) = (options.joints, options.from_frame);
        if prompt.is_none() && (joints.is_some() || from_frame.is_some() || is_edited || rig == Some(Rig::Prompt)) {
            return Err(wrong("joints, from_frame, free, loop and rig=\"prompt\" are of a prompt; give one".into()));
        }
        let usual = Sampling::default();
        let prompt = prompt.map(|prompt| prompt.request(read)).transpose()?;
        Ok(Request {
            prompt: prompt.map(|prompt| PromptRequest { joints, from_frame, edit, ..prompt }),
            path: options.path.map(DrawnPath::get).transpose()?,
            labels: options.labels,
            guidance: options.guidance,
            look_ahead: options.look_ahead,
            length: options.frames.map(Length::Frames).or(options.seconds.map(Length::Seconds)),
            fps: options.fps,
            music: options.music.map(|path| MusicRequest::of(path, None)),
            seed: options.seed,
            sampling: Sampling { top_p: options.top_p, ..options.temperature.map_or(usual, Sampling::temperature) },
            rig,
            feet: options.lock_feet.map(|lock| if lock { FootMode::Lock } else { FootMode::Off }),
            checkpoint: self.checkpoint,
            ..Request::of(&self.run)
        })
    }
}

#[pymethods]
impl Model {
    /// The model of a run folder; `checkpoint` is a step, "latest" or "best", by default the best, or the latest where none
    /// was validated.
    #[staticmethod]
    #[pyo3(signature = (run, *, checkpoint=None))]
    fn open(run: PathBuf, checkpoint: Option<Bound<'_, PyAny>>) -> PyResult<Model> {
        if !run.join("config.toml").is_file() {
            return Err(wrong(format!("{}: no config.toml; expected a run folder", run.display())));
        }
        Ok(Model { run, checkpoint: choice(checkpoint)? })
    }

    /// kinelm's own model; the first call writes it to the user's cache folder.
    #[staticmethod]
    fn ready() -> PyResult<Model> {
        kinelm::ready::run().map(Model::of).map_err(library)
    }

    /// The run folder.
    #[getter(run)]
    pub fn run(&self) -> PathBuf {
        self.run.clone()
    }

    /// A dance. Of `prompt`, a motion file or a clip, `joints` are given throughout, all joints before `from_frame`, or all but
    /// `free` (a list such as ["left_arm@4s:8s"]); `loop` makes its end lead to its beginning. With `rig` "prompt" alone it lends its
    /// rig and its rate. `path`, places on the floor as rows of seconds, x and z (and heading, degrees), or a .csv of them, is danced
    /// along. `seconds` or `frames` (of the model) say how long the dance is, `fps` its rate: by default the prompt's,
    /// else 30. `labels`, `guidance`, `look_ahead`, `music`, `seed`, `temperature`, `top_p`, `rig` ("model" or "prompt") and `lock_feet` as the
    /// program's flags; `fps_source`, `skip`, `up`, `unit`, `map`, `root`, `take` and `mirror_axis` as in
    /// `Clip.read`. `callback` gets a dictionary, `frames` sampled `of` all, after each word, and may return False to stop.
    #[pyo3(signature = (prompt=None, *, callback=None, **options))]
    fn generate(
        &self,
        py: Python<'_>,
        prompt: Option<Prompt>,
        callback: Option<Py<PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Clip> {
        Ok(self.variations(py, 1, prompt, callback, options)?.remove(0))
    }

    /// `count` dances of one call, sampled side by side, which is quicker than one after the other.
    #[pyo3(signature = (count, prompt=None, *, callback=None, **options))]
    fn variations(
        &self,
        py: Python<'_>,
        count: usize,
        prompt: Option<Prompt>,
        callback: Option<Py<PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Vec<Clip>> {
        let request = self.request(prompt, options)?;
        if !(1..=256).contains(&count) {
            return Err(wrong(format!("count is {count}; expected 1 to 256")));
        }
        detach(py, || {
            let open = OpenRequest::open(&request).map_err(library)?;
            let (mut interrupt, stop) = (Interrupt::default(), AtomicBool::new(false));
            // nothing is written: a name for each dance, whose extension is that of a format
            let outs = vec![PathBuf::from("dance.bvh"); count];
            let dances = open.make(&Making::of(&outs), &mut |progress| {
                let (frames, of) = (progress.frames, progress.of);
                interrupt.tell(callback.as_ref(), &stop, |py| python(py, &json!({ "frames": frames, "of": of })));
                if stop.load(Ordering::SeqCst) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            });
            let chosen = interrupt.result(dances)?.chosen.into_iter();
            chosen.map(|dance| Ok(Clip(dance.decode(&open).map_err(library)?.generated.motion))).collect()
        })
    }

    /// The frames of a dance while they are sampled: an iterator of (24, 3) positions of SMPL's joints, metres, at the
    /// model's rate. It can be dropped at any frame. Feet are not locked, ends of gaps not closed, and of several tries
    /// through a gap it shows the first.
    #[pyo3(signature = (prompt=None, **options))]
    fn frames(&self, py: Python<'_>, prompt: Option<Prompt>, options: Option<&Bound<'_, PyDict>>) -> PyResult<Frames> {
        let request = self.request(prompt, options)?;
        detach(py, || {
            let open = OpenRequest::open(&request).map_err(library)?;
            let sampler = open.sampler(1).map_err(library)?;
            let preview = Preview::new(&open);
            Ok(Frames(Mutex::new(SamplingState { open, sampler, preview, new: None, yielded: 0 })))
        })
    }

    /// Bits per frame of a motion file: how surprising it is to the model.
    #[pyo3(signature = (path, **reading))]
    fn bits_per_frame(&self, py: Python<'_>, path: PathBuf, reading: Option<&Bound<'_, PyDict>>) -> PyResult<f64> {
        let read = Reading::of(reading, RestFrame::Drop)?;
        // a prompt gives something; the bits are of all its words
        let prompt = PromptRequest { read, joints: Some("root".into()), ..PromptRequest::of(path) };
        let request = Request { prompt: Some(prompt), checkpoint: self.checkpoint, ..Request::of(&self.run) };
        detach(py, || {
            let open = OpenRequest::open(&request).map_err(library)?;
            let Some(prompt) = &open.prompt else { return Err(wrong("no motion".into())) };
            Ok(open.bits_per_frame(&[&prompt.clip.words]).map_err(library)?[0])
        })
    }

    /// The likelihood of a split of a corpus: a dictionary with `bits_per_frame`, `nats_per_token`, `tokens`, `frames`.
    #[pyo3(signature = (corpus, split="test"))]
    fn likelihood<'py>(&self, py: Python<'py>, corpus: &Corpus, split: &str) -> PyResult<Bound<'py, PyAny>> {
        let split = split_of(split)?;
        let measure = || load_run(&self.run, self.checkpoint)?.likelihood(&corpus.0, split, Compute::default());
        python(py, &detach(py, || measure().map_err(library))?)
    }

    fn __repr__(&self) -> String {
        format!("<kinelm.Model: {}>", self.run.display())
    }
}

/// A dance while it is sampled.
#[pyclass(frozen, module = "kinelm")]
pub struct Frames(Mutex<SamplingState>);

/// What has been sampled of it.
struct SamplingState {
    open: OpenRequest,
    sampler: Sampler<Box<dyn NextToken>>,
    preview: Preview,
    /// The frames that were decoded last, and how many of them were yielded.
    new: Option<kinelm::motion::Clip>,
    yielded: usize,
}

impl SamplingState {
    /// The next frame, as a clip of one.
    fn next(&mut self) -> kinelm::Result<Option<kinelm::motion::Clip>> {
        loop {
            if let Some(clip) = self.new.as_ref().filter(|clip| clip.frames() > self.yielded) {
                self.yielded += 1;
                return Ok(Some(clip.slice(self.yielded - 1..self.yielded)));
            }
            let Some(word) = self.sampler.next() else { return Ok(None) };
            self.preview.push(&self.open.tokenizer, &word?[0]);
            (self.new, self.yielded) = (self.preview.next(&self.open)?, 0);
        }
    }
}

#[pymethods]
impl Frames {
    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let next = || self.0.lock().unwrap_or_else(PoisonError::into_inner).next().map_err(library);
        detach(py, next)?.map(|frame| positions(py, &frame).as_any().get_item(0)).transpose()
    }
}
