//! A run's `config.toml`, and a trained network out of its folder.

use super::SPECTRUM;
use super::config::{Config, Shape};
use super::data::{MusicClips, MusicSources};
use super::network::{Dropout, Network, list, standardise};
use crate::data::{Hashes, Recording, Recordings, check_files};
use crate::form::{Coder, Form, check_finite};
use crate::rig::Rig;
use crate::run::{self, Checkpoint, Kind, RunConfig};
use crate::{Error, FPS, Result};
use kinelm_engine::arena::Floats;
use kinelm_engine::lstm::TeacherForcing;
use kinelm_model::checkpoint::CheckpointChoice;
use kinelm_model::run::CONFIG;
use kinelm_motion::skeleton::EndSite;
use kinelm_motion::{Clip, Skeleton, Vec3};
use kinelm_train::run::Origin;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Steps that are computed at a time.
const AT_ONCE: usize = 50;

/// The body of generated dances: that of the first clip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// (3) the fixed position of the root, metres.
    pub place: [f64; 3],
    /// (J, 3) from a joint's parent to it, metres.
    pub offsets: Vec<[f64; 3]>,
    /// (E, 3) from a joint to the end site on it.
    pub ends: Vec<[f64; 3]>,
}

impl Body {
    /// The body of a clip: its bones, and the mean height of its root.
    pub(crate) fn of(clip: &Clip) -> Body {
        let skeleton = clip.skeleton();
        let height = clip.root().iter().map(|p| p.y).sum::<f64>() / clip.frames().max(1) as f64;
        Body {
            place: [0.0, height, 0.0],
            offsets: skeleton.offsets().iter().map(|o| o.to_array()).collect(),
            ends: skeleton.ends().iter().map(|end| end.offset.to_array()).collect(),
        }
    }

    /// The body as a skeleton of the rig.
    ///
    /// # Errors
    /// Another number of joints or ends than the rig's, or what makes no skeleton.
    pub fn skeleton(&self, rig: &Rig) -> Result<Arc<Skeleton>> {
        if self.offsets.len() != rig.joints()
            || self.ends.len() != rig.ends.len()
            || rig.parents.len() + 1 != rig.joints()
        {
            let found = format!("of {} joints and {} ends", self.offsets.len(), self.ends.len());
            let expected = format!("the rig's {} and {}", rig.joints(), rig.ends.len());
            return Err(Error::invalid(format!("{CONFIG}: the body"), found, expected));
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
    pub clips_sha256: String,
    /// The settings.
    pub config: Config,
    /// The rig.
    pub rig: Rig,
    /// The body of generated dances.
    pub body: Body,
    /// Where the motion and the music are; in the file, relative to the run's folder.
    pub sources: MusicSources,
    /// SHA-256 of each file of both.
    pub files: Hashes,
    /// The run that it goes on from, and its checkpoint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<Origin>,
}

impl RunFile {
    /// The configuration of a new run.
    pub(crate) fn new(config: &Config, sources: &MusicSources, recordings: &Recordings, clips: &MusicClips) -> RunFile {
        RunFile {
            kind: Self::KIND.name.into(),
            version: Self::KIND.version,
            clips_sha256: clips.sha256.clone(),
            config: config.clone(),
            rig: recordings.rig.clone(),
            body: Body::of(&recordings.all[0].clip),
            sources: sources.clone(),
            files: clips.files.clone(),
            from: None,
        }
    }

    /// The clips that `run` learns from and is measured on; `is_used` selects those whose music is read.
    ///
    /// # Errors
    /// What reading fails with; files that have changed since it was begun.
    pub fn clips(&self, run: &Path, is_used: impl Fn(&Recording) -> bool) -> Result<(Recordings, MusicClips)> {
        let (config, sources) = (&self.config, &self.sources);
        let recordings = Recordings::load(&sources.motion, config.margin, Some(&self.rig))?;
        let clips = MusicClips::load(&recordings, sources, config.audio, config.margin, is_used)?;
        check_files(run, [&self.clips_sha256, &clips.sha256], [&self.files, &clips.files])?;
        Ok((recordings, clips))
    }
}

impl RunConfig for RunFile {
    type Config = Config;

    const KIND: Kind =
        Kind { name: "music-lstm", one_of: "one of a music LSTM", command: "kinelm music-lstm train", version: 3 };

    fn with_paths(&self, path: &dyn Fn(&Path) -> PathBuf) -> RunFile {
        let from = self.from.clone().map(|from| Origin { path: path(&from.path), ..from });
        RunFile { sources: self.sources.with_paths(path), from, ..self.clone() }
    }

    fn config(&mut self) -> &mut Config {
        &mut self.config
    }

    fn from(&mut self) -> &mut Option<Origin> {
        &mut self.from
    }

    fn steps(config: &mut Config) -> &mut u64 {
        &mut config.steps
    }
}

/// A trained network.
pub struct Trained {
    /// Its run folder.
    pub run: PathBuf,
    /// The configuration of its run.
    pub file: RunFile,
    /// Quaternions on its rig.
    pub coder: Coder,
    /// Its body.
    pub skeleton: Arc<Skeleton>,
    /// Its shape.
    pub shape: Shape,
    /// Its weights, in the order of `list`.
    pub weights: Vec<Floats>,
    /// Updates done.
    pub step: u64,
    /// SHA-256 of the file of the weights.
    pub sha256: String,
    /// What the user should know.
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
        let Checkpoint { weights, step, sha256, notes } = run::load(run, which, &list(&shape))?;
        Ok(Trained { run: run.into(), coder, skeleton, shape, weights, step, sha256, notes, file })
    }

    /// A dance from the zero state.
    pub fn dancer(&self) -> Dancer<'_> {
        let mut network = Network::new(&self.shape, 1, AT_ONCE, false);
        network.pack(&self.weights);
        Dancer { trained: self, network, spectra: Vec::new(), channels: Vec::new(), frames: 0 }
    }

    /// The dance to spectra (F, N).
    ///
    /// # Errors
    /// Those of [`Dancer::finish`].
    pub fn dance(&self, spectra: &[f32]) -> Result<Clip> {
        let mut dancer = self.dancer();
        spectra.chunks_exact(SPECTRUM).for_each(|frame| dancer.push(frame));
        dancer.finish()
    }
}

/// A dance that is generated a few frames at a time, from a stream of spectra.
pub struct Dancer<'a> {
    trained: &'a Trained,
    network: Network,
    /// Spectra that are not yet read.
    spectra: Vec<f32>,
    /// (F, 3 + 4J) frames so far.
    channels: Vec<f64>,
    frames: usize,
}

impl Dancer<'_> {
    /// Takes the spectrum (N) of the next frame.
    pub fn push(&mut self, frame: &[f32]) {
        self.spectra.extend_from_slice(frame);
        self.frames += 1;
        if self.spectra.len() == AT_ONCE * SPECTRUM {
            self.step();
        }
    }

    fn step(&mut self) {
        let new = self.spectra.len() / SPECTRUM;
        // later frames don't change earlier ones
        self.spectra.resize(AT_ONCE * SPECTRUM, 0.0);
        standardise(&self.trained.weights, &mut self.spectra);
        let no_dropout = Dropout { share: 0.0, keys: &[] };
        let outputs = self.network.forward(&self.trained.weights, &self.spectra, TeacherForcing::NONE, no_dropout);
        for frame in outputs.chunks_exact(self.trained.shape.channels()).take(new) {
            self.channels.extend(self.trained.file.body.place);
            self.channels.extend(frame.iter().map(|x| f64::from(*x)));
        }
        self.network.carry();
        self.spectra.clear();
    }

    /// Frames so far.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// The dance.
    ///
    /// # Errors
    /// [`crate::Error::NotFinite`] for a network that diverges, with the frame and the channel.
    pub fn finish(mut self) -> Result<Clip> {
        if !self.spectra.is_empty() {
            self.step();
        }
        let coder = &self.trained.coder;
        check_finite(&self.channels, coder.channels())?;
        coder.clip(&self.channels, &self.trained.skeleton, FPS)
    }
}
