//! `kinelm classify predict`.

use crate::classify::Classifier;
use crate::cli::read::ReadArgs;
use crate::cli::{Odd, Say, print};
use anyhow::Result;
use kinelm_motion::format::RestFrame;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The folder of `kinelm classify train`
    #[arg(long, value_name = "DIR")]
    classifier: PathBuf,
    /// Motion files of any rig; one in the classifier's corpus is read as it was for that, unless the call says
    /// otherwise
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// Print a JSON object per file instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    let mut classifier = Classifier::load(&args.classifier)?;
    let corpus = std::slice::from_ref(&classifier.manifest.corpus);
    let (options, odd) = (args.read.of_files_known(&args.files, RestFrame::Drop, corpus, say), Odd::new(say));
    crate::cli::each_file(&args.files, say, |i, file| {
        let (motion, found) = classifier.predict(file, &options[i])?;
        odd.warn(&motion, &options[i]);
        match args.json {
            true => print(&(serde_json::to_string(&found)? + "\n")),
            false => print(&found.to_string()),
        }
    })?;
    Ok(())
}
