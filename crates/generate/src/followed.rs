//! What is followed of a prompt: joints, first words, or what an edit leaves as it is.

use super::edit::Edited;
use super::prompt::{self, Prompt};
use super::request::PromptRequest;
use crate::{Error, Result};
use kinelm_motion::Source;
use kinelm_motion::joints::{self, Selection};
use kinelm_tokenizer::Tokenizer;
use std::sync::Arc;

/// What is followed of a clip.
pub struct Followed {
    /// The clip.
    pub clip: Prompt,
    /// The joints that are followed.
    pub selection: Option<Selection>,
    /// (C) places of a word; none if no joints are followed.
    pub given: Vec<bool>,
    /// Ids of the first words.
    pub beginning: Vec<u32>,
    /// Frames of which something is followed: all if joints are, else those of the first words.
    pub frames: usize,
    /// What is kept of it and what is invented, if it is edited.
    pub edit: Option<Edited>,
}

impl Followed {
    /// Reads a prompt; joints named as its rig names them get SMPL's names in the recipe.
    pub(super) fn load(recipe: &mut PromptRequest, frames: Option<usize>, tokenizer: &Tokenizer) -> Result<Followed> {
        if recipe.joints.is_none() && recipe.from_frame.is_none() && recipe.edit.is_none() {
            let path = recipe.path.display();
            return Err(Error::call(format!(
                "{path}: nothing of the prompt is followed; give joints, a frame to go on from, or both"
            )));
        }
        let bytes: Arc<[u8]> = recipe.bytes()?.into();
        let clip = Prompt::parse(&recipe.path, &bytes, &recipe.read, tokenizer)?;
        // the recipe says where the floor is and which axis is up, so that neither is judged again, least of all of the dance
        recipe.read.floor = clip.floor_m.or(recipe.read.floor);
        if let Source::Bvh(_) | Source::Json(_) = clip.motion.source {
            recipe.read.up = clip.motion.source.axes().up;
        }
        let (rig, map) = (clip.motion.clip.skeleton(), recipe.read.map.as_deref());
        let wrong = |list: &str, e: kinelm_motion::Error| Error::call(format!("--joints {list}: {e}"));
        let to_smpl_names = |list: &String| joints::to_smpl_names(list, rig, map).map_err(|e| wrong(list, e));
        recipe.joints = recipe.joints.as_ref().map(to_smpl_names).transpose()?;
        let selection = recipe.joints.as_deref().map(joints::parse).transpose()?;
        let given = match (&selection, &recipe.joints) {
            (Some(selection), Some(list)) => {
                prompt::given_places(tokenizer, selection).map_err(|e| Error::call(format!("--joints {list}: {e}")))?
            }
            _ => Vec::new(),
        };
        let beginning = recipe.from_frame.map(|n| clip.beginning(tokenizer, n));
        let beginning = beginning.transpose().map_err(|e| Error::call(format!("--from-frame: {e}")))?;
        let mut edit = recipe.edit.take();
        let round = edit.as_ref().and_then(|edit| edit.round);
        let (clip, seam) = match round.map(|round| round.lay(clip.clone(), recipe.read.map.as_deref(), tokenizer)) {
            Some(laid) => laid.map(|(clip, seam)| (clip, Some(seam)))?,
            None => (clip, None),
        };
        let load = |edit| Edited::load(edit, frames, (recipe, &bytes), (&clip, seam), tokenizer);
        let edited = edit.as_mut().map(load).transpose()?;
        recipe.edit = edit;
        let frames = match recipe.from_frame {
            Some(n) if given.is_empty() => n,
            _ => clip.frames(),
        };
        Ok(Followed { clip, selection, given, beginning: beginning.unwrap_or_default(), frames, edit: edited })
    }
}
