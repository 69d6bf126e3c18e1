//! A run's `config.toml`, and a trained network out of its folder.

use super::config::{Config, Shape};
use super::data::{Dances, Places};
use super::network::{Dropped, Network, list, standardise};
use super::{FPS, HEARD};
use crate::aclstm::Rig;
use crate::aclstm::data::{Hashes, Recording, Recordings, check_files};
use crate::aclstm::form::{Coder, Form, check_finite};
use crate::{Error, Result};
use kinelm_engine::arena::Floats;
use kinelm_engine::lstm::TeacherForcing;
use kinelm_model::checkpoint::{CheckpointChoice, Checkpoints};
use kinelm_model::run::{CONFIG, WEIGHTS};
use kinelm_model::weights;
use kinelm_motion::skeleton::EndSite;
use kinelm_motion::{Clip, Skeleton, Vec3};
use kinelm_store::{FileRecord, files};
use kinelm_train::parameters::numbers;
use kinelm_train::updates::Kind;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What tells such a run from others.
const KIND: Kind =
    Kind { name: "music-lstm", one_of: "one of a music LSTM", command: "kinelm music-lstm train", version: 2 };
/// Steps that are computed at a time: what the memory is for.
const AT_ONCE: usize = 50;

/// The body that dances are made on: that of the first clip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// (3) where the root stays, metres.
    pub place: [f64; 3],
    /// (J, 3) from a joint's parent to it, metres.
    pub offsets: Vec<[f64; 3]>,
    /// (E, 3) from a joint to the end site on it.
    pub ends: Vec<[f64; 3]>,
}

impl Body {
    /// Of a clip: its bones, and the mean height of its root.
    pub fn of(clip: &Clip) -> Body {
        let skeleton = clip.skeleton();
        let height = clip.root().iter().map(|p| p.y).sum::<f64>() / clip.frames().max(1) as f64;
        Body {
            place: [0.0, height, 0.0],
            offsets: skeleton.offsets().iter().map(|o| o.to_array()).collect(),
            ends: skeleton.ends().iter().map(|end| end.offset.to_array()).collect(),
        }
    }

    /// It as a skeleton of the rig.
    ///
    /// # Errors
    /// As many offsets as joints, and what makes no skeleton.
    pub fn skeleton(&self, rig: &Rig) -> Result<Arc<Skeleton>> {
        if self.offsets.len() != rig.joints()
            || self.ends.len() != rig.ends.len()
            || rig.parents.len() + 1 != rig.joints()
        {
            let what = format!("{} joints and {} ends of a body", self.offsets.len(), self.ends.len());
            return Err(Error::call(format!("{CONFIG}: {what}; the rig has {} and {}", rig.joints(), rig.ends.len())));
        }
        let parents = [None].into_iter().chain(rig.parents.iter().map(|parent| Some(*parent))).collect();
        let ends = rig.ends.iter().zip(&self.ends).map(|(parent, o)| EndSite { parent: *parent, offset: (*o).into() });
        let offsets = self.offsets.iter().map(|o| Vec3::from(*o)).collect();
        Ok(Arc::new(Skeleton::new(rig.names.clone(), parents, offsets, ends.collect())?))
    }
}

/// `config.toml` of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunFile {
    /// `music-lstm`.
    pub kind: String,
    /// The layout's version.
    pub version: u32,
    /// One hash of the clips and their music.
    pub dances_sha256: String,
    /// The settings.
    pub config: Config,
    /// The rig.
    pub rig: Rig,
    /// Whom dances are made on.
    pub body: Body,
    /// Where the motion and the music are, in the file from the run's folder on.
    pub places: Places,
    /// SHA-256 of each file of both; runs of before don't know it.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub files: Hashes,
}

impl RunFile {
    /// Of a new run.
    pub fn new(config: &Config, places: &Places, recordings: &Recordings, dances: &Dances) -> RunFile {
        RunFile {
            kind: KIND.name.into(),
            version: KIND.version,
            dances_sha256: dances.sha256.clone(),
            config: config.clone(),
            rig: recordings.rig.clone(),
            body: Body::of(&recordings.all[0].clip),
            places: places.clone(),
            files: dances.files.clone(),
        }
    }

    /// The clips and the music that `run` has learned from and is measured on; `wanted` says which are heard.
    ///
    /// # Errors
    /// What reading and hearing fail with; files that have changed since.
    pub fn dances(&self, run: &Path, wanted: impl Fn(&Recording) -> bool) -> Result<(Recordings, Dances)> {
        let (config, places) = (&self.config, &self.places);
        let recordings = Recordings::load(&places.motion, config.margin, Some(&self.rig))?;
        let dances = Dances::hear(&recordings, places, config.audio, config.margin, wanted)?;
        check_files(run, [&self.dances_sha256, &dances.sha256], [&self.files, &dances.files])?;
        Ok((recordings, dances))
    }

    /// Writes it.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn write(&self, run: &Path) -> Result<()> {
        let places = self.places.with_paths(|path| files::path_from(run, path));
        KIND.write(run, &RunFile { places, ..self.clone() })
    }

    /// Reads that of a run.
    ///
    /// # Errors
    /// A folder without one, a run of another kind, another version, keys that are wrong.
    pub fn read(run: &Path) -> Result<RunFile> {
        let mut file: RunFile = KIND.read(run)?;
        file.places = file.places.with_paths(|path| files::path_in(run, path));
        file.config.validate().map_err(|e| Error::call(format!("{}: {e}", run.join(CONFIG).display())))?;
        Ok(file)
    }
}

/// A trained network.
pub struct Trained {
    /// Its run folder.
    pub run: PathBuf,
    /// What its run is.
    pub file: RunFile,
    /// Quaternions on its rig.
    pub coder: Coder,
    /// Its body.
    pub skeleton: Arc<Skeleton>,
    /// Its shape.
    pub shape: Shape,
    /// Its weights, in the order of [`list`].
    pub weights: Vec<Floats>,
    /// Updates that they had.
    pub step: u64,
    /// SHA-256 of their file.
    pub sha256: String,
    /// What the user should be told.
    pub notes: Vec<String>,
}

impl Trained {
    /// The network of a run at a checkpoint.
    ///
    /// # Errors
    /// A folder that is no run of this kind; no checkpoint that is whole; weights of another network.
    pub fn load(run: &Path, which: CheckpointChoice) -> Result<Trained> {
        let file = RunFile::read(run)?;
        let coder = Coder::new(Form::Quaternion, &file.rig)?;
        let skeleton = file.body.skeleton(&file.rig)?;
        let shape = file.config.shape(coder.joints());
        let mut notes = Vec::new();
        let found = Checkpoints::of(run).find(which, &[WEIGHTS], &[], &mut |note| notes.push(note))?;
        let (path, bytes) = (found.dir.join(WEIGHTS), &found.files[WEIGHTS]);
        let weights = numbers(&list(&shape), &weights::from_bytes(&path, bytes)?, "").map_err(|e| match e {
            Error::Weights(found) => Error::file(&path, found, "the network that config.toml describes", ""),
            other => other,
        })?;
        let (step, sha256) = (found.state.step, FileRecord::of(bytes).sha256);
        Ok(Trained { run: run.into(), coder, skeleton, shape, weights, step, sha256, notes, file })
    }

    /// A dance that begins at rest.
    pub fn dancer(&self) -> Dancer<'_> {
        let mut network = Network::new(&self.shape, (1, AT_ONCE), false);
        network.pack(&self.weights);
        Dancer { trained: self, network, heard: Vec::new(), made: Vec::new(), frames: 0 }
    }

    /// The dance to spectra (F, N).
    ///
    /// # Errors
    /// Those of [`Dancer::finish`].
    pub fn dance(&self, heard: &[f32]) -> Result<Clip> {
        let mut dancer = self.dancer();
        heard.chunks_exact(HEARD).for_each(|frame| dancer.hear(frame));
        dancer.finish()
    }
}

/// A dance that is made as it hears, a few frames at a time.
pub struct Dancer<'a> {
    trained: &'a Trained,
    network: Network,
    heard: Vec<f32>,
    /// (F, 3 + 4J).
    made: Vec<f64>,
    frames: usize,
}

impl Dancer<'_> {
    /// Takes the spectrum (N) of its next frame.
    pub fn hear(&mut self, frame: &[f32]) {
        self.heard.extend_from_slice(frame);
        self.frames += 1;
        if self.heard.len() == AT_ONCE * HEARD {
            self.step();
        }
    }

    fn step(&mut self) {
        let new = self.heard.len() / HEARD;
        // what isn't heard yet changes nothing before it
        self.heard.resize(AT_ONCE * HEARD, 0.0);
        standardise(&self.trained.weights, &mut self.heard);
        let nothing = Dropped { share: 0.0, keys: &[] };
        let outputs = self.network.forward(&self.trained.weights, &self.heard, TeacherForcing::NONE, nothing);
        for frame in outputs.chunks_exact(self.trained.shape.channels()).take(new) {
            self.made.extend(self.trained.file.body.place);
            self.made.extend(frame.iter().map(|x| f64::from(*x)));
        }
        self.network.carry();
        self.heard.clear();
    }

    /// Frames that were heard.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// The dance.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for a network that runs away, with the frame and the channel.
    pub fn finish(mut self) -> Result<Clip> {
        if !self.heard.is_empty() {
            self.step();
        }
        let coder = &self.trained.coder;
        check_finite(&self.made, coder.channels())?;
        coder.clip(&self.made, &self.trained.skeleton, FPS)
    }
}
