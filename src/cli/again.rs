//! `kinelm again`: a dance made again from its sidecar, whatever model made it.

use super::generate::make;
use super::updates::BaselineDance;
use super::{ForceArgs, Say, convert, extension, writable_into, wrong_call};
use crate::baselines::aclstm::dance::Request as Continued;
use crate::baselines::music_lstm::dance::Request as ToMusic;
use crate::baselines::sidecar::{Request, Sidecar};
use crate::generate::make::Making;
use crate::generate::provenance::{Moved, Provenance};
use crate::model::CheckpointChoice;
use anyhow::Result;
use kinelm_store::output::{Outputs, is_same};
use kinelm_store::sidecar;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The sidecar of the dance
    #[arg(value_name = "FILE.bvh.kinelm.json")]
    sidecar: PathBuf,
    /// Where the dance goes, in the format that it had [default: beside the sidecar, under its name]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Where the run is now, if it was moved
    #[arg(long, value_name = "RUN")]
    run: Option<PathBuf>,
    /// Where the prompt is now, or the clip that an auto-conditioned LSTM goes on from, if it was moved
    #[arg(long, value_name = "CLIP")]
    prompt: Option<PathBuf>,
    /// A timeline that names the same clips where they are now, if they were moved
    #[arg(long, value_name = "TIMELINE.toml", conflicts_with = "prompt")]
    timeline: Option<PathBuf>,
    /// Where the music is now, if it was moved
    #[arg(long, value_name = "FILE")]
    music: Option<PathBuf>,
    /// Tokens that are guessed from the previous word and verified in one pass, which changes no token
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(..=64), hide_short_help = true)]
    guesses: Option<u8>,
    #[command(flatten)]
    force: ForceArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    let is_of = |key: &str| sidecar::is_of_kind(&args.sidecar, &[key]);
    if is_of(<Continued as Request>::KEY) {
        args.only("an auto-conditioned LSTM", &["prompt"])?;
        return args.baseline(|request: &mut Continued| [&mut request.run, &mut request.clip], say);
    }
    if is_of(<ToMusic as Request>::KEY) {
        args.only("a music LSTM", &["music"])?;
        return args.baseline(|request: &mut ToMusic| [&mut request.run, &mut request.music], say);
    }
    args.gpt(say)
}

impl Args {
    /// Refuses what a dance of a model doesn't have.
    fn only(&self, model: &str, its: &[&str]) -> Result<()> {
        let has = [
            ("prompt", self.prompt.is_some()),
            ("timeline", self.timeline.is_some()),
            ("music", self.music.is_some()),
            ("guesses", self.guesses.is_some()),
        ];
        if let Some((name, _)) = has.iter().find(|(name, given)| *given && !its.contains(name)) {
            wrong_call!("--{name}: a dance of {model} has none; leave it out");
        }
        Ok(())
    }

    /// Where the dance is written, whose sidecar states its `name`: to --out, or beside the sidecar.
    fn out(&self, name: &str) -> Result<PathBuf> {
        let out = self.out.clone().unwrap_or_else(|| self.sidecar.with_file_name(name));
        writable_into(&out, extension(Path::new(name)) == "vrm")?;
        if extension(&out) != extension(Path::new(name)) {
            wrong_call!("{}: the dance was {name}; other formats hold other bytes", out.display());
        }
        Ok(out)
    }

    /// Refuses, before the dance is made, an output that may not be written: also one that its sidecar was to replace, unless
    /// it is to be written over. `sha256` is that of the dance.
    fn check(&self, outputs: &Outputs, out: &Path, sha256: &str) -> Result<()> {
        outputs.check([out])?;
        outputs.check_replaceable(out, Some(sha256))?;
        if !self.force.force {
            sidecar::check_finished(out)?;
        }
        Ok(())
    }

    /// Whether the dance has its sidecar already.
    fn has_sidecar(&self, out: &Path) -> bool {
        is_same(&sidecar::path_of(out), &self.sidecar)
    }

    /// Makes the dance of a GPT.
    fn gpt(&self, say: Say) -> Result<()> {
        let first = Provenance::load(&self.sidecar)?;
        let out = self.out(&first.output.file)?;
        let (run, prompt) = (self.run.clone(), self.prompt.clone());
        let (timeline, music) = (self.timeline.clone(), self.music.clone());
        let request = first.request_at(&Moved { run, prompt, timeline, music })?;
        let named = request.request();
        let outputs = self.force.outputs(named.files().chain([self.sidecar.clone()]).chain(self.timeline.clone()));
        self.check(&outputs, &out, &first.output.sha256)?;
        let open = first.open(request)?;
        make::report(&open, say)?;
        let outs = [out.clone()];
        let making = Making { guesses: self.guesses.map(usize::from), ..Making::of(&outs) };
        let mut dances = make::with_bar(say, |watch| open.make(&making, watch))?;
        let generated = dances.chosen.remove(0).decode(&open)?.generated;
        // a GLB names its animation as the file of before
        let bytes = generated.bytes(Path::new(&first.output.file))?;
        first.check_bytes(&bytes)?;
        // the sidecar describes these very bytes
        match self.has_sidecar(&out) {
            true => outputs.write(&out, &bytes).map(|_| ())?,
            false => first.copied_to(&out, &open, generated.motion.clip.fps()).write(&out, &bytes, &outputs)?,
        }
        convert::report_written(&out, &generated.motion, say);
        Ok(())
    }

    /// Makes the dance of a baseline, from its run and its input, the two `paths` of a request, where they are now, and compares
    /// its hash with the first.
    fn baseline<R: BaselineDance>(&self, paths: fn(&mut R) -> [&mut PathBuf; 2], say: Say) -> Result<()> {
        let first = Sidecar::<R>::load(&self.sidecar)?;
        let out = self.out(&first.output.file)?;
        let mut request = first.request.clone();
        let input = self.prompt.as_ref().or(self.music.as_ref());
        for (path, moved) in paths(&mut request).into_iter().zip([self.run.as_ref(), input]) {
            if let Some(moved) = moved {
                path.clone_from(moved);
            }
        }
        let outputs = self.force.outputs(request.inputs().into_iter().chain([self.sidecar.clone()]));
        self.check(&outputs, &out, &first.output.sha256)?;
        let (sidecar, bytes) = request.make(CheckpointChoice::Step(first.step), &out, say)?;
        first.check(&sidecar)?;
        match self.has_sidecar(&out) {
            true => outputs.write(&out, &bytes).map(|_| ())?,
            false => sidecar.write(&out, &bytes, &outputs)?,
        }
        Ok(())
    }
}
