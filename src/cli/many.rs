//! Clips, and the outputs of a command on each of them.

use crate::corpus::in_out::{Pair, into_folder, is_folder, written_for};
use anyhow::Result;
use std::path::PathBuf;

/// Clips, and where what is made of each of them goes.
#[derive(Debug, clap::Args)]
pub struct InOut {
    #[arg(required = true, value_name = "CLIP", help = super::with_extensions("Motion files (READ), or folders of them"))]
    clips: Vec<PathBuf>,
    /// The file to write (.bvh .npz .json), or a folder, which is created: files keep their names, those of a folder
    /// their paths below it
    #[arg(long, value_name = "FILE|DIR")]
    out: PathBuf,
}

impl InOut {
    /// Where each clip goes: to `out` itself, or into it under its own path. A .pkl, which isn't written, becomes an .npz, an .fbx a .bvh.
    pub fn pairs(&self) -> Result<Vec<Pair>> {
        let InOut { clips, out } = self;
        let pairs = match is_folder(clips, out) {
            true => into_folder(clips, out, |own| written_for(own).into())?,
            false => vec![Pair { input: clips[0].clone(), output: out.to_owned() }],
        };
        for Pair { output, .. } in &pairs {
            super::writable(output)?;
        }
        Ok(pairs)
    }
}
