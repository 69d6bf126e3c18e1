//! Models.

use crate::clip::{Clip, wrong};
use crate::error::library;
use kinelm::generate::open::OpenRequest;
use kinelm::generate::request::{Edit, Length, Loop, LoopKind, PromptRequest, Request, Rig, Span};
use kinelm::generate::sampling::Sampling;
use kinelm::motion::format::ReadOptions;
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A trained model: its run folder.
#[pyclass(frozen, module = "kinelm")]
pub struct Model {
    run: PathBuf,
}

#[pymethods]
impl Model {
    /// The model of a run folder.
    #[staticmethod]
    fn open(run: PathBuf) -> PyResult<Model> {
        if !run.join("config.toml").is_file() {
            return Err(wrong(format!("{}: no config.toml; expected a run folder", run.display())));
        }
        Ok(Model { run })
    }

    /// kinelm's own model; the first call writes it to the user's cache folder.
    #[staticmethod]
    fn ready() -> PyResult<Model> {
        kinelm::ready::run().map(|run| Model { run }).map_err(library)
    }

    /// The run folder.
    #[getter]
    fn run(&self) -> PathBuf {
        self.run.clone()
    }

    /// A dance. Of `prompt`, a motion file, `joints` are given throughout, all joints before `from_frame`, or all but `free`
    /// (a list such as ["left_arm@4s:8s"]); `loop` makes its end lead to its beginning. `seconds` or `frames` say how long it is.
    #[pyo3(signature = (prompt=None, *, joints=None, from_frame=None, free=None, r#loop=false, seconds=None, frames=None,
        labels=None, guidance=None, seed=1, temperature=1.0, top_p=None, rig=None, fps_source=None, skip=0, map=None))]
    #[allow(clippy::too_many_arguments)]
    fn generate(
        &self,
        py: Python<'_>,
        prompt: Option<PathBuf>,
        joints: Option<String>,
        from_frame: Option<usize>,
        free: Option<Vec<String>>,
        r#loop: bool,
        seconds: Option<f64>,
        frames: Option<usize>,
        labels: Option<BTreeMap<String, String>>,
        guidance: Option<f64>,
        seed: u64,
        temperature: f64,
        top_p: Option<f64>,
        rig: Option<&str>,
        fps_source: Option<f64>,
        skip: usize,
        map: Option<String>,
    ) -> PyResult<Clip> {
        let free = free.unwrap_or_default().iter().map(|span| span.parse::<Span>()).collect::<Result<Vec<_>, _>>();
        let free = free.map_err(wrong)?;
        let looping = r#loop.then_some(Loop { kind: LoopKind::Back, over_s: 2.0 });
        let edited = !free.is_empty() || r#loop;
        let edit = edited.then(|| Edit { given: Vec::new(), free, blend_s: 0.2, tries: 8, looping });
        let rig = match rig {
            None => None,
            Some("model") => Some(Rig::Model),
            Some("prompt") => Some(Rig::Prompt),
            Some(other) => return Err(wrong(format!("rig {other:?}; expected model or prompt"))),
        };
        if prompt.is_none() && (joints.is_some() || from_frame.is_some() || edited || rig == Some(Rig::Prompt)) {
            return Err(wrong("joints, from_frame, free, loop and rig=\"prompt\" are of a prompt; give one".into()));
        }
        let read = ReadOptions { fps_source, skip, map, ..ReadOptions::default() };
        let request = Request {
            prompt: prompt.map(|path| PromptRequest { path, read, joints, from_frame, timeline: None, edit }),
            labels: labels.unwrap_or_default(),
            guidance,
            length: frames.map(Length::Frames).or(seconds.map(Length::Seconds)),
            seed,
            sampling: Sampling { temperature, top_p, ..Sampling::default() },
            rig,
            ..Request::of(&self.run)
        };
        py.detach(|| {
            let open = OpenRequest::open(&request).map_err(library)?;
            let sampled = open.sample(1, None, &mut |_| {}).map_err(library)?;
            let generated = open.motion(&open.words(&sampled, 0), Path::new("dance.bvh")).map_err(library)?;
            Ok(Clip(generated.motion))
        })
    }

    /// Bits per frame of a motion file: how surprising it is to the model.
    #[pyo3(signature = (path, *, fps_source=None, skip=0, map=None))]
    fn bits_per_frame(
        &self,
        py: Python<'_>,
        path: PathBuf,
        fps_source: Option<f64>,
        skip: usize,
        map: Option<String>,
    ) -> PyResult<f64> {
        let read = ReadOptions { fps_source, skip, map, ..ReadOptions::default() };
        let prompt = PromptRequest { read, joints: Some("root".into()), ..PromptRequest::of(path) };
        let request = Request { prompt: Some(prompt), ..Request::of(&self.run) };
        py.detach(|| {
            let open = OpenRequest::open(&request).map_err(library)?;
            let Some(prompt) = &open.prompt else { return Err(wrong("no motion".into())) };
            Ok(open.bits_per_frame(&[&prompt.clip.words]).map_err(library)?[0])
        })
    }

    fn __repr__(&self) -> String {
        format!("<kinelm.Model: {}>", self.run.display())
    }
}
