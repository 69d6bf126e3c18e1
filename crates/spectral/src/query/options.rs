//! The options of an index: the feature that it stores of each window.

use crate::{Error, LowDct, PcaBasis, Result, Stft, WindowSpec};
use kinelm_motion::smpl;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The feature that windows are compared by.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
pub enum FeatureKind {
    /// Magnitudes of a short-time Fourier transform: Hann windows of 16 frames, hop 8.
    Stft {
        /// Whether those at 0 Hz, which hold the mean pose, are left out.
        no_dc: bool,
    },
    /// Low coefficients of a cosine transform.
    Dct {
        /// The number of coefficients.
        keep: usize,
    },
    /// Coordinates in a basis that is fitted to all channels of the windows that an index begins with.
    Pca {
        /// Components.
        keep: usize,
    },
    /// A language model's own embedding: the mean of its final vectors over the tokens of the window.
    Model {
        /// The run's folder.
        run: PathBuf,
        /// SHA-256 of its weights.
        weights: String,
    },
}

impl FeatureKind {
    /// Its name in tables and flags.
    pub fn name(&self) -> &'static str {
        match self {
            FeatureKind::Stft { no_dc: false } => "stft",
            FeatureKind::Stft { no_dc: true } => "stft without 0 Hz",
            FeatureKind::Dct { .. } => "dct",
            FeatureKind::Pca { .. } => "pca",
            FeatureKind::Model { .. } => "model",
        }
    }

    /// The STFT as the thesis has it.
    pub fn stft() -> FeatureKind {
        FeatureKind::Stft { no_dc: false }
    }

    /// The 16 lowest coefficients.
    pub fn dct() -> FeatureKind {
        FeatureKind::Dct { keep: LowDct::KEEP }
    }

    /// 16 components.
    pub fn pca() -> FeatureKind {
        FeatureKind::Pca { keep: PcaBasis::KEEP }
    }
}

/// How windows are cut and what is held of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IndexOptions {
    /// The feature that windows are compared by.
    pub transform: FeatureKind,
    /// How series are cut into windows.
    pub windows: WindowSpec,
    /// The SMPL joints that count, ascending; all 24 if empty.
    pub joints: Vec<usize>,
    /// Rotation vectors are canonical instead of continuous (compat).
    pub raw: bool,
}

impl IndexOptions {
    /// Whole bodies in windows of 128 frames at 60 frames per second, hop 64.
    pub(crate) fn new(transform: FeatureKind) -> IndexOptions {
        IndexOptions { transform, windows: WindowSpec::default(), joints: Vec::new(), raw: false }
    }

    /// Holds the options to their limits.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] with the option and its limits.
    pub fn validate(&self) -> Result<()> {
        self.windows.validate()?;
        let frames = self.windows.frames;
        if let FeatureKind::Dct { keep } | FeatureKind::Pca { keep } = self.transform
            && !(1..=frames).contains(&keep)
        {
            return Err(Error::invalid_parameter("keep", keep, format!("1 to {frames}, a window's frames")));
        }
        if let Some(joint) = self.joints.iter().find(|&&j| j >= smpl::NAMES.len()) {
            return Err(Error::invalid("a joint", joint, format!("one of SMPL's, 0 to {}", smpl::NAMES.len() - 1)));
        }
        if matches!(self.transform, FeatureKind::Model { .. }) && (!self.joints.is_empty() || self.raw) {
            let why = "a model reads the joints of its own tokenizer; leave out `joints` and `raw`, or take another transform";
            return Err(Error::unsupported("an index by a model", why));
        }
        Ok(())
    }

    /// C.
    pub fn channels(&self) -> usize {
        3 * if self.joints.is_empty() { smpl::NAMES.len() } else { self.joints.len() }
    }

    /// The options in which `other` differs: name, here, there.
    pub(crate) fn differences(&self, other: &IndexOptions) -> Vec<(&'static str, String, String)> {
        type Shown = fn(&IndexOptions) -> String;
        let both: [(&str, Shown); 6] = [
            ("transform", |o| o.transform.shown()),
            ("window", |o| format!("{} frames", o.windows.frames)),
            ("hop", |o| format!("{} frames", o.windows.hop)),
            ("fps", |o| o.windows.fps.to_string()),
            ("joints", |o| joint_names(&o.joints)),
            ("raw", |o| o.raw.to_string()),
        ];
        let shown = both.into_iter().map(|(name, of)| (name, of(self), of(other)));
        shown.filter(|(_, a, b)| a != b).collect()
    }
}

impl FeatureKind {
    fn shown(&self) -> String {
        match self {
            FeatureKind::Stft { .. } => self.name().into(),
            FeatureKind::Dct { keep } => format!("dct of {keep} coefficients"),
            FeatureKind::Pca { keep } => format!("pca of {keep} components"),
            FeatureKind::Model { run, weights } => {
                format!("model {} with weights {}", run.display(), &weights[..weights.len().min(12)])
            }
        }
    }
}

/// Joints by name.
pub fn joint_names(joints: &[usize]) -> String {
    match joints {
        [] => "all 24".into(),
        joints => joints.iter().map(|&j| smpl::NAMES.get(j).copied().unwrap_or("?")).collect::<Vec<_>>().join(" "),
    }
}

/// The transform of a kind that needs nothing fitted.
pub(super) fn unfitted(kind: &FeatureKind, frames: usize) -> Option<crate::Transform> {
    use crate::Transform;
    match *kind {
        FeatureKind::Stft { no_dc } => Some(Transform::Stft(Stft::new(frames, no_dc))),
        FeatureKind::Dct { keep } => Some(Transform::Dct(LowDct::new(frames, keep))),
        FeatureKind::Pca { .. } | FeatureKind::Model { .. } => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_named() {
        let error = |options: IndexOptions| options.validate().unwrap_err().to_string();
        let dct = IndexOptions::new(FeatureKind::dct());
        dct.validate().unwrap();
        assert_eq!(dct.channels(), 72);
        assert!(error(IndexOptions::new(FeatureKind::Dct { keep: 129 })).contains("expected 1 to 128"));
        assert!(error(IndexOptions { joints: vec![24], ..dct.clone() }).contains("0 to 23"));
        let model = FeatureKind::Model { run: "run".into(), weights: "ab".into() };
        assert!(error(IndexOptions { raw: true, ..IndexOptions::new(model) }).contains("its own tokenizer"));
    }

    #[test]
    fn differences_are_told_by_name() {
        let one = IndexOptions::new(FeatureKind::dct());
        let two = IndexOptions { joints: vec![0, 4], ..IndexOptions::new(FeatureKind::Dct { keep: 8 }) };
        let expected = [
            ("transform", "dct of 16 coefficients".to_string(), "dct of 8 coefficients".to_string()),
            ("joints", "all 24".into(), "pelvis left_knee".into()),
        ];
        assert_eq!(one.differences(&two), expected);
        assert!(one.differences(&one).is_empty());
    }

    #[test]
    fn they_are_read_strictly() {
        let text = serde_json::to_string(&IndexOptions::new(FeatureKind::stft())).unwrap();
        assert_eq!(serde_json::from_str::<IndexOptions>(&text).unwrap(), IndexOptions::new(FeatureKind::stft()));
        assert!(serde_json::from_str::<IndexOptions>(&text.replace("raw", "row")).is_err());
    }
}
