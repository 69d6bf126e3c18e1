//! `kinelm aclstm train`.

use crate::baselines::aclstm::train::{Start, train};
use crate::cli::Say;
use crate::cli::updates::{self, ResumeArgs, TrainArgs};
use anyhow::Result;
use std::path::Path;

pub fn run(args: &TrainArgs, say: Say) -> Result<()> {
    follow(&args.run, &Start::New(args.settings()?, args.sources()?), say)
}

pub fn resume(args: &ResumeArgs, say: Say) -> Result<()> {
    follow(&args.run, &Start::Resume(args.changes()), say)
}

fn follow(run: &Path, request: &Start, say: Say) -> Result<()> {
    updates::follow("kinelm aclstm", run, say, |stop, report| train(run, request, stop, report))
}
