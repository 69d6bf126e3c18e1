//! The motion that a command works on, and its labels.

use super::Say;
use crate::corpus::Dataset;
use crate::corpus::build::BuildOptions;
use anyhow::Result;
use kinelm_motion::format::ReadOptions;
use std::path::PathBuf;

/// DATA and its labels.
#[derive(Debug, Clone, clap::Args)]
pub struct DataArgs {
    /// Motion files or folders of them
    #[arg(required = true, value_name = "DATA")]
    data: Vec<PathBuf>,
    /// Labels of the DATA in the same position: a CSV (clip, split, take, fps, skip, floor and music_from are reserved
    /// columns, others are labels; fps, skip and floor override the flags) or a pattern such as '{genre}/{take}.bvh'
    /// [default: the naming patterns of known data sets]
    #[arg(long, value_name = "FILE.csv|PATTERN")]
    labels: Vec<String>,
    /// Fail if any file is bad, instead of reporting it and going on
    #[arg(long)]
    pub strict: bool,
}

impl DataArgs {
    /// The files; what was found out about them is printed.
    pub fn find(&self, say: Say) -> Result<Dataset> {
        let dataset = Dataset::find(&self.data, &self.labels)?;
        for line in &dataset.notes {
            say.line(line);
        }
        Ok(dataset)
    }

    /// The files that are read: the motion and its labels.
    pub fn files(&self, dataset: &Dataset) -> impl Iterator<Item = PathBuf> {
        let motion = dataset.items.iter().map(|item| item.file().to_owned());
        motion.chain(self.labels.iter().map(PathBuf::from)).chain(self.data.clone().into_iter().filter(|p| p.is_file()))
    }
}

impl DataArgs {
    /// How the files become a tokenizer or a corpus.
    pub fn build_options(&self, read: ReadOptions) -> BuildOptions {
        BuildOptions { read, strict: self.strict, ..BuildOptions::default() }
    }
}
