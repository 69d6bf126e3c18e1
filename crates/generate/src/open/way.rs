//! The path on the floor that a dance is led along, coded.

use super::PreparedPrompt;
use crate::request::{FloorPath, Request, Rig};
use crate::sampler::Way;
use crate::{Error, Result};
use kinelm_motion::Clip;
use kinelm_motion::joints::Selection;
use kinelm_store::{Subject, hash};
use kinelm_tokenizer::Tokenizer;
use std::sync::Arc;

/// A path that is danced along.
pub struct OpenWay {
    /// For the sampler.
    pub way: Arc<Way>,
    /// SMPL's body going along it, at the model's rate.
    pub clip: Clip,
    /// How much larger SMPL's legs are than those of the rig that the dance is written on.
    pub scale: f64,
    /// Steps and turns that are longer than the model codes.
    pub clipped: u64,
    /// SHA-256 of its places.
    pub sha256: String,
}

impl OpenWay {
    /// The greatest speed, metres a second on the rig that the dance is written on.
    pub(crate) fn fastest(&self) -> f64 {
        let steps = self.clip.root().windows(2).map(|two| two[0].distance(two[1]));
        steps.fold(0.0, f64::max) * self.clip.fps() / self.scale
    }

    /// Codes the path of a request.
    ///
    /// # Errors
    /// A prompt whose path is given too, or that is edited; a tokenizer that codes no steps and turns.
    pub(super) fn open(
        path: &FloorPath,
        request: &Request,
        prompt: Option<&PreparedPrompt>,
        tokenizer: &Tokenizer,
    ) -> Result<OpenWay> {
        let wrong = |why: String| Error::unsupported(Subject::about("`path`", "path"), why);
        if let Some(asked) = request.prompt.as_ref().filter(|asked| asked.edit.is_some() || asked.from_frame.is_some())
        {
            let what = format!(
                "{} is edited or continued where it is; a path is that of a whole new dance",
                asked.path.display()
            );
            return Err(wrong(what));
        }
        let has_root = |selection: &Selection| selection.joints.contains(&0) || selection.has_part_of_root();
        if prompt.and_then(|prompt| prompt.selection.as_ref()).is_some_and(has_root) {
            return Err(wrong(
                "`joints` gives the root or a part of it from the prompt too; leave it to the path".into(),
            ));
        }
        let own = prompt.filter(|_| request.rig == Some(Rig::Prompt));
        let scale = own.map(|prompt| prompt.clip.retarget()).transpose()?.map_or(1.0, |retarget| retarget.scale());
        let clip = path.clip(tokenizer.fps(), scale)?;
        let coded = tokenizer.encode(&clip)?;
        let way = Way::of(&coded.words, tokenizer)
            .map_err(|e| wrong(format!("the model's tokenizer codes no steps over the floor that can be led: {e}")))?;
        // heights are the model's own
        let clipped = coded.clipped.saturating_sub(coded.off_range);
        let sha256 = hash::of(format!("{:?}", Vec::from(path.clone())).as_bytes());
        Ok(OpenWay { way: Arc::new(way), clip, scale, clipped, sha256 })
    }
}
