//! The rig that clips are put on, and how its file is read: none of the options of reading the clips.

use crate::cli::WrongCall;
use anyhow::Result;
use kinelm_motion::convert::TargetRig;
use kinelm_motion::format::{ReadOptions, Unit};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct RigArgs {
    /// The rig to retarget to: smpl, a body model (SMPL_*.npz), or a motion file with the rig
    #[arg(long, value_name = "NAME|FILE")]
    pub skeleton: Option<String>,
    /// The skeleton map of the --skeleton file [default: found by its joints]
    #[arg(long, value_name = "NAME|FILE")]
    skeleton_map: Option<String>,
    /// The unit of the --skeleton file [default: auto]
    #[arg(long, value_name = "UNIT")]
    skeleton_unit: Option<Unit>,
    /// The root to read of the --skeleton file, where it has several
    #[arg(long, value_name = "NAME")]
    skeleton_root: Option<String>,
}

impl RigArgs {
    /// The target rig, if there is one.
    pub fn load(&self) -> Result<Option<TargetRig>> {
        let options = ReadOptions {
            map: self.skeleton_map.clone(),
            unit: self.skeleton_unit.unwrap_or_default(),
            root: self.skeleton_root.clone(),
            ..ReadOptions::default()
        };
        let is_smpl = self.skeleton.as_deref() == Some("smpl");
        if is_smpl && options != ReadOptions::default() {
            let what =
                "--skeleton smpl is no file; --skeleton-map, --skeleton-unit and --skeleton-root say how one is read";
            return Err(WrongCall(what.into()).into());
        }
        Ok(self.skeleton.as_deref().map(|name| TargetRig::load(name, &options)).transpose()?)
    }

    /// The files that are read for the rig.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        self.skeleton.iter().chain(&self.skeleton_map).map(PathBuf::from)
    }

    /// Whether it is a rig of other joints than SMPL's.
    pub fn is_other(&self) -> bool {
        self.skeleton.as_deref().is_some_and(|name| name != "smpl")
    }
}
