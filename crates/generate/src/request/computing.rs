//! The device and the form that compute a model.

use crate::Result;
use kinelm_model::{Compute, ReaderOptions};
use kinelm_model::{KvKind, WeightKind};
use serde::{Deserialize, Serialize};

/// Where and how the model computes. The number of threads changes no bit; another device, form or number format may.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Computing {
    /// `cpu` or `cuda:N`.
    pub device: String,
    /// `auto` or `plain`.
    pub form: String,
    /// Number format of the weights: `f32` or `int8`.
    #[serde(with = "WeightName")]
    pub weights: WeightKind,
    /// Number format of keys and values: `f32` or `f16`.
    #[serde(with = "KvName")]
    pub kv: KvKind,
    /// The processor instructions that the engine's kernels used: recorded, not requested.
    #[serde(default)]
    pub kernels: String,
}

/// [`WeightKind`] by its name: the engine knows no files.
#[derive(Serialize, Deserialize)]
#[serde(remote = "WeightKind", rename_all = "lowercase")]
enum WeightName {
    F32,
    Int8,
}

/// [`KvKind`] by its name.
#[derive(Serialize, Deserialize)]
#[serde(remote = "KvKind", rename_all = "lowercase")]
enum KvName {
    F32,
    F16,
    Int8,
}

impl Default for Computing {
    fn default() -> Computing {
        Computing::new(Compute::default(), WeightKind::F32, KvKind::F32)
    }
}

impl Computing {
    /// With the kernels of this processor.
    pub fn new(compute: Compute, weights: WeightKind, kv: KvKind) -> Computing {
        Computing {
            device: compute.device.to_string(),
            form: compute.form.to_string(),
            weights,
            kv,
            kernels: kinelm_engine::dispatch::name().into(),
        }
    }

    /// Device and form.
    ///
    /// # Errors
    /// A device or a form without such a name.
    pub(crate) fn compute(&self) -> Result<Compute> {
        Ok(Compute { device: self.device.parse()?, form: self.form.parse()? })
    }

    /// How the model is read with `streams` sequences side by side.
    pub(crate) fn reading(&self, streams: usize) -> ReaderOptions {
        ReaderOptions { streams, weights: self.weights, kv: self.kv }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_names_in_a_file_and_no_others_are_taken() {
        let computing = Computing::new(Compute::default(), WeightKind::Int8, KvKind::F16);
        let text = serde_json::to_string(&computing).unwrap();
        assert!(text.contains(r#""weights":"int8","kv":"f16""#), "{text}");
        assert_eq!(serde_json::from_str::<Computing>(&text).unwrap(), computing);
        let refused = serde_json::from_str::<Computing>(&text.replace("int8", "int4")).unwrap_err().to_string();
        assert!(refused.contains("`int4`") && refused.contains("f32") && refused.contains("int8"), "{refused}");
    }
}
