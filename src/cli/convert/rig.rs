//! The rig that clips are put on, and how its file is read: none of the options of reading the clips.

use crate::cli::{Say, WrongCall, warn};
use anyhow::Result;
use kinelm_motion::Motion;
use kinelm_motion::convert::TargetRig;
use kinelm_motion::format::{ReadOptions, Unit};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct RigArgs {
    /// The rig to retarget to: smpl, a body model (SMPL_*.npz), or a motion file with the rig. A .glb or .vrm with a mesh
    /// is a character: a .glb that is written is that file with one more animation. A .vrma animates the avatar of a .vrm
    #[arg(long, value_name = "NAME|FILE")]
    pub onto: Option<String>,
    /// The skeleton map of the --onto file [default: found by its joints]
    #[arg(long, value_name = "NAME|FILE")]
    onto_map: Option<String>,
    /// The unit of the --onto file [default: auto]
    #[arg(long, value_name = "UNIT")]
    onto_unit: Option<Unit>,
    /// The root to read of the --onto file, where it has several
    #[arg(long, value_name = "NAME")]
    onto_root: Option<String>,
    /// The animation of a character, by name, whose place the new one takes
    #[arg(long, value_name = "NAME")]
    pub replace_animation: Option<String>,
    /// Write a .vrm, that of --onto with the dance inside, which players of VRM ignore (docs/engines.md)
    #[arg(long)]
    pub embed: bool,
}

impl RigArgs {
    /// The target rig, if there is one; reports what is odd in its file.
    pub fn load(&self, say: Say) -> Result<Option<TargetRig>> {
        let options = ReadOptions {
            map: self.onto_map.clone(),
            unit: self.onto_unit.unwrap_or_default(),
            root: self.onto_root.clone(),
            ..ReadOptions::default()
        };
        let is_smpl = self.onto.as_deref() == Some("smpl");
        if is_smpl && options != ReadOptions::default() {
            let what = "--onto smpl is no file; --onto-map, --onto-unit and --onto-root say how one is read";
            return Err(WrongCall(what.into()).into());
        }
        let rig = self.onto.as_deref().map(|name| TargetRig::load(name, &options)).transpose()?;
        let motion = rig.as_ref().and_then(TargetRig::motion);
        motion.iter().for_each(|motion| warn(motion, say));
        match &self.replace_animation {
            Some(name) if !motion.is_some_and(Motion::has_character) => {
                let what = format!("--replace-animation {name}: --onto is no .glb or .vrm with a mesh, and has none");
                Err(WrongCall(what).into())
            }
            _ => Ok(rig),
        }
    }

    /// Refuses a character for what is written without it; `what` says what that is.
    pub fn check_no_character(&self, rig: Option<&TargetRig>, what: &str) -> Result<()> {
        if !rig.and_then(TargetRig::motion).is_some_and(Motion::has_character) {
            return Ok(());
        }
        let name = self.onto.as_deref().unwrap_or_default();
        let what =
            format!("--onto {name}, a character, with {what}: its mesh would be left out; leave one of them out");
        Err(WrongCall(what).into())
    }

    /// The files that are read for the rig.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        self.onto.iter().chain(&self.onto_map).map(PathBuf::from)
    }

    /// Whether it is a rig of other joints than SMPL's.
    pub fn is_other(&self) -> bool {
        self.onto.as_deref().is_some_and(|name| name != "smpl")
    }
}
