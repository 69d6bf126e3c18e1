//! The model that dances, as a page needs to know it.

use crate::Result;
use kinelm_generate::open::FPS;
use kinelm_model::{CheckpointChoice, ModelKind, load_run};
use kinelm_motion::joints::{self, GROUPS};
use kinelm_motion::smpl;
use kinelm_tokenizer::root_path::RootPath;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The model of a studio.
#[derive(Debug, Clone)]
pub struct Model {
    /// Its run folder.
    pub run: PathBuf,
    /// Which of its checkpoints.
    pub checkpoint: CheckpointChoice,
    /// The name that is shown.
    pub name: String,
    /// Its rate, frames per second.
    pub fps: f64,
    /// Whether it dances word by word, so that it can look ahead.
    pub is_causal: bool,
    /// Whether it can be led along a path.
    paths: bool,
    labels: BTreeMap<String, Vec<String>>,
    coded: Vec<usize>,
}

impl Model {
    /// Reads a checkpoint of a run: its name, rate, labels and joints; without a run, those of the ready model.
    ///
    /// # Errors
    /// A run that can't be read.
    pub fn open(run: Option<&Path>, checkpoint: CheckpointChoice) -> Result<Model> {
        let path = run.map_or_else(kinelm_ready::run, |run| Ok(run.to_owned()))?;
        let path = path.canonicalize().unwrap_or(path);
        let loaded = load_run(&path, checkpoint)?;
        let tokenizer = loaded.load_tokenizer()?;
        let conditions = loaded.load_conditions()?;
        let values = |field: &String| conditions.values(field).into_iter().map(str::to_owned).collect();
        let labels = conditions.fields().iter().map(|field| (field.clone(), values(field))).collect();
        let name = match run {
            None => kinelm_ready::NAME.to_owned(),
            Some(_) => {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                let step = format!(" after step {}", loaded.state.step);
                format!("{name}{}", if checkpoint == CheckpointChoice::Auto { "" } else { &step })
            }
        };
        let coded = tokenizer.channels().joints().to_vec();
        let is_causal = loaded.config.kind == ModelKind::Causal;
        let paths = is_causal && RootPath::of(&tokenizer).is_ok();
        Ok(Model { run: path, checkpoint, name, fps: tokenizer.fps(), is_causal, paths, labels, coded })
    }

    /// As a page has it.
    pub fn view(&self) -> Value {
        let joint = |id: &usize| json!({ "name": joints::list_of(&[*id]), "smpl": id, "label": smpl::NAMES[*id], "group": joints::part_of(*id) });
        json!({
            "name": self.name, "fps": self.fps, "new_fps": FPS, "labels": self.labels,
            "paths": self.paths,
            "joints": self.coded.iter().map(joint).collect::<Vec<_>>(),
            "groups": GROUPS.iter().map(|(name, _)| name).collect::<Vec<_>>(),
        })
    }
}
