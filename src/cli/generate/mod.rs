//! `kinelm generate`.

mod best;
mod dance;
mod edit;
pub mod make;

use super::read::ReadArgs;
use super::values::length_in_frames;
use super::{Say, extension, print, wrong_call};
use crate::generate::request::{FloorPath, PromptRequest, Request, Timeline};
use crate::generate::timeline::chart;
use crate::model::run::TOKENIZER;
use crate::train::run::RunFile;
use anyhow::Result;
use dance::DanceArgs;
use edit::EditArgs;
use kinelm_motion::format::{self, ReadOptions, RestFrame};
use kinelm_motion::moment::Moment;
use kinelm_tokenizer::Tokenizer;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Args {
    #[command(subcommand)]
    command: Option<Command>,
    /// A clip of which the dance takes joints (--joints), its beginning (--from-frame), or both, or which is edited (--given,
    /// --free, --loop). Of a new dance it lends the rig and the rate (--rig prompt). Without one, the dance is free
    #[arg(long, value_name = "CLIP")]
    prompt: Option<PathBuf>,
    /// A new dance on the rig of this file, as --prompt FILE --rig prompt. A .glb or .vrm with a mesh is a character: the
    /// .glb that is written is that file with one more animation, named as --out is. A .vrma animates the avatar of a .vrm
    #[arg(long, value_name = "FILE", conflicts_with_all = ["prompt", "joints", "from_frame", "given", "free", "loop", "rig"])]
    onto: Option<PathBuf>,
    /// A path over the floor that is danced along: a .csv of seconds, x and z in metres, or of x, z and speed, and heading in
    /// degrees if it isn't that of the way
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = ["from_frame", "given", "free", "loop"])]
    path: Option<PathBuf>,
    /// The animation of a character, by name, whose place the dance takes in the .glb that is written
    #[arg(long, value_name = "NAME")]
    replace_animation: Option<String>,
    /// Write a .vrm, that of the rig with the dance inside, which players of VRM ignore (docs/engines.md)
    #[arg(long)]
    embed: bool,
    /// Joints that are taken from the prompt: groups (root, right_arm, hands, feet, spine, ...), names (SMPL's or the prompt
    /// rig's) and ids, separated by commas. root includes the translation; of it path, height and tilt can be given alone
    #[arg(long, value_name = "LIST")]
    joints: Option<String>,
    /// Continue the prompt from this frame at the model's rate, or from a time such as 3s: earlier frames are taken from it,
    /// as far as they fill whole words
    #[arg(long, value_name = "N", value_parser = length_in_frames)]
    from_frame: Option<Moment>,
    #[command(flatten)]
    edit: EditArgs,
    #[command(flatten)]
    dance: DanceArgs,
    #[command(flatten)]
    read: ReadArgs,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Generate what a timeline of clips leaves free; --check shows what that is
    Timeline(Box<TimelineArgs>),
}

#[derive(Debug, clap::Args)]
struct TimelineArgs {
    /// A file with a timeline of clips, docs/timelines.md
    #[arg(id = "prompt", value_name = "TIMELINE.toml")]
    timeline: PathBuf,
    /// Draw the timeline as text instead: what each clip gives, and what would be generated
    #[arg(long, conflicts_with_all = ["out", "run", "frames", "seconds", "fps", "variations", "seed", "best"])]
    check: bool,
    #[command(flatten)]
    dance: DanceArgs,
}

pub fn run(mut args: Args, say: Say) -> Result<()> {
    match &args.command {
        Some(Command::Timeline(args)) => return timeline(args, say),
        None => {}
    }
    if let Some(character) = args.onto.take() {
        args.prompt = Some(character);
        args.dance.put_on_own_rig();
    }
    let outs = args.dance.outs(args.edit.is_requested(), args.prompt.as_deref(), args.embed)?;
    let has_no_animations = |out: &&PathBuf| !["glb", "vrm"].contains(&extension(out).as_str());
    if let Some((name, out)) = args.replace_animation.as_ref().zip(outs.iter().find(has_no_animations)) {
        wrong_call!(
            "--replace-animation {name} with {}: only a .glb has several animations; write .glb",
            out.display()
        );
    }
    let prompt = args.prompt.as_ref().map(|path| prompt(&args, path, say)).transpose()?;
    let path = args.path.as_deref().map(FloorPath::read).transpose()?;
    let request = Request { path, ..args.dance.request(prompt, Vec::new())? };
    make::make(&args.dance, request, &outs, args.path.as_deref(), None, say)
}

fn timeline(args: &TimelineArgs, say: Say) -> Result<()> {
    if args.check {
        let (_, layout) = Timeline::load(&args.timeline)?;
        layout.notes.iter().for_each(|note| say.line(note));
        return print(&chart(&layout));
    }
    let outs = args.dance.outs(true, None, false)?;
    let (prompt, layout) = edit::of_timeline(&args.timeline, &args.dance, say)?;
    let request = args.dance.request(Some(prompt), layout.labels.clone())?;
    make::make(&args.dance, request, &outs, Some(&args.timeline), Some(layout), say)
}

/// The prompt, and what is taken from it.
fn prompt(args: &Args, path: &Path, say: Say) -> Result<PromptRequest> {
    let run = args.dance.run()?;
    let read = read_as(&args.read, &run, path, say);
    let from_frame = args.from_frame.map(|at| at_model_rate(&run, at)).transpose()?.map(|(_, frame)| frame as usize);
    let edit = args.edit.get(&args.dance, &|| Ok(format::read(path, &read)?.clip.fps()))?;
    let (replace_animation, embed) = (args.replace_animation.clone(), args.embed);
    let joints = args.joints.clone();
    let prompt = PromptRequest { read, joints, from_frame, edit, replace_animation, embed, ..PromptRequest::of(path) };
    if embed && prompt.edit.is_none() && !args.dance.is_on_own_rig() {
        wrong_call!("--embed of a dance on the model's rig; add --rig prompt, for one on that of {}", path.display());
    }
    if prompt.lends() && !args.dance.is_on_own_rig() {
        wrong_call!(
            "--prompt alone; say what is taken from it (--joints LIST, --from-frame N, or both), what of it is generated \
             (--free, --given), or --rig prompt for a new dance on its rig"
        );
    }
    Ok(prompt)
}

/// How a prompt is read: as requested, as its sidecar says, or as a corpus of the run's training has read it.
fn read_as(read: &ReadArgs, run: &Path, path: &Path, say: Say) -> ReadOptions {
    // what is wrong with the run is reported when the model is loaded
    let corpora = RunFile::read(run).map_or(Vec::new(), |file| file.corpora);
    let corpora: Vec<PathBuf> = corpora.into_iter().map(|corpus| corpus.path).collect();
    read.of_files_known(&[path], RestFrame::Drop, &corpora, say).remove(0)
}

/// A time in seconds, and in frames at the rate of the run's model.
fn at_model_rate(run: &Path, time: Moment) -> Result<(f64, f64)> {
    let fps = Tokenizer::load(run.join(TOKENIZER))?.fps();
    Ok((time.seconds(fps), time.frames(fps)))
}
