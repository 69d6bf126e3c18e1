//! The model of a run as dances are sampled from it, causal or masked.

use crate::Result;
use crate::masked::{MaskedModel, fill, masked_model};
use crate::sampler::{NextToken, SampledTokens, SamplingPlan, SamplingProgress, readers, sample_side_by_side};
use kinelm_model::{Compute, LoadedRun, ModelKind, ReaderOptions};

/// A model that samples several dances side by side.
pub enum RunModel {
    /// Token by token.
    Causal(Vec<Box<dyn NextToken>>),
    /// Window by window.
    Masked {
        /// The model.
        model: Box<dyn MaskedModel>,
        /// Dances that are sampled.
        dances: usize,
    },
}

impl RunModel {
    /// The model in the form that `compute` selects; of `reading.streams` sequences every `each` belong to one dance.
    ///
    /// # Errors
    /// Those of [`readers`] and `masked_model`.
    pub fn open(run: &LoadedRun, compute: Compute, reading: ReaderOptions, each: usize) -> Result<RunModel> {
        match run.config.kind {
            ModelKind::Causal => Ok(RunModel::Causal(readers(run, compute, reading, each)?)),
            ModelKind::Masked => {
                let dances = reading.streams / each.max(1);
                Ok(RunModel::Masked { model: masked_model(run, compute, reading)?, dances })
            }
        }
    }

    /// Samples the dances of a plan.
    ///
    /// # Errors
    /// Those of [`sample_side_by_side`] and [`fill`].
    pub fn sample(&mut self, plan: &SamplingPlan, progress: &mut SamplingProgress<'_>) -> Result<SampledTokens> {
        match self {
            RunModel::Causal(models) => sample_side_by_side(models, plan, progress),
            RunModel::Masked { model, dances } => fill(&mut **model, plan, *dances, progress),
        }
    }
}
