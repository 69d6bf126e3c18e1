//! Masked models as windows are read by them: the fast form, or the plain one.

use crate::Result;
use crate::sampler::check_f32;
use kinelm_model::fast::{Fast, Windows};
use kinelm_model::{Compute, Gpt, LoadedRun, ReaderOptions, Scores};

/// A model that sees a whole window at once.
pub trait MaskedModel: Send {
    /// T, the tokens that one window holds, conditioning tokens included.
    fn context(&self) -> usize;

    /// (n, V) the logits of each of a window's n tokens, of its own id.
    ///
    /// # Errors
    /// More tokens than the context holds; what the tensor library fails with.
    fn logits(&mut self, window: &[u32]) -> Result<Vec<f32>>;
}

impl MaskedModel for Fast {
    fn context(&self) -> usize {
        self.config().context
    }

    fn logits(&mut self, window: &[u32]) -> Result<Vec<f32>> {
        let (length, mask) = (window.len(), self.mask());
        Fast::logits(self, Windows { inputs: window, targets: window, length, mask, history: &[], conditioning: None })
    }
}

impl MaskedModel for Gpt {
    fn context(&self) -> usize {
        self.config().context
    }

    fn logits(&mut self, window: &[u32]) -> Result<Vec<f32>> {
        Ok(self.predict(&self.ids(window, window.len())?)?.flatten_all()?.to_vec1::<f32>()?)
    }
}

/// The masked model of a run in the form that `compute` selects.
///
/// # Errors
/// Weights that don't fit the configuration; a device that isn't there; number formats that are for reading token by token.
pub(crate) fn masked_model(run: &LoadedRun, compute: Compute, reading: ReaderOptions) -> Result<Box<dyn MaskedModel>> {
    check_f32(reading, "a masked model reads whole windows, in F32 alone; leave them out")?;
    if compute.is_fast() {
        return Ok(Box::new(Fast::from_weights(&run.config, &run.tokens, &run.weights)?));
    }
    Ok(Box::new(run.plain(compute.device)?))
}
