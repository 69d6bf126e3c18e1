//! `kinelm demo`: dances of kinelm's own model, or the whole way on dances made up for it, with no data and no network.

mod music;
mod ready;

use crate::corpus::build::{self, BuildOptions};
use crate::corpus::{Corpus, Dataset, Split};
use crate::evaluate::{ChannelFloors, CodeSplits, Extent};
use crate::generate::open::OpenRequest;
use crate::generate::output::RootGiven;
use crate::generate::prompt::PromptClip;
use crate::generate::request::{Computing, Length, Placement, PromptRequest, Request, Seeding};
use crate::generate::sampling::Sampling;
use crate::model::{CheckpointChoice, load_run};
use crate::shell::{ComputeArgs, Say, WrongCall};
use crate::train::{CorpusPart, PretrainOptions, TrainFile};
use crate::view::{Figure, write_page};
use anyhow::{Context, Result};
use kinelm_model::{KvKind, WeightKind};
use kinelm_motion::format::{self, ReadOptions, RestFrame};
use kinelm_motion::synth::Dance;
use kinelm_motion::{Clip, Motion, joints, synth};
use kinelm_store::files::write_whole;
use kinelm_tokenizer::{Tokenizer, TokenizerConfig, UncodedPose};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The name of the demo's training settings.
const SETTINGS: &str = "demo";
/// The joints that the generated dance follows.
const FOLLOWED: &str = "root,right_arm";
const CLIPS: usize = 72;
const SECONDS: f64 = 12.0;
const FPS: f64 = 30.0;
const FRAMES: usize = 200;
/// `--top-p`: a model that has learned for a minute is surer of what it does where less is left to chance.
const CALM: f64 = 0.9;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The folder to make
    #[arg(long, value_name = "DIR", default_value = "demo")]
    out: PathBuf,
    /// Replace what an earlier demo left in the folder
    #[arg(long)]
    force: bool,
    /// The seed of the dances, the model and the draws
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Makes up dances, and trains and measures a small model on them
    #[arg(long)]
    train: bool,
    /// With a training: its steps, over the demo's own
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// Dances to music: trains a model with music conditioning, and dances to a tempo outside its training data
    #[arg(long)]
    music: bool,
    #[command(flatten)]
    compute: ComputeArgs,
}

impl Args {
    /// The device and form of its model.
    fn computing(&self) -> Computing {
        Computing::new(self.compute.get(), WeightKind::F32, KvKind::F32)
    }
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let started = Instant::now();
    // first: a device that isn't there must not cost the user a folder
    args.compute.get().device.open()?;
    if !(args.train || args.music || args.steps.is_some()) {
        return ready::run(&args, started, say);
    }
    make_room(&args)?;
    if args.music {
        return music::run(&args, started, say);
    }
    let at = |name: &str| args.out.join(name);
    say.line(format_args!("1/5 {CLIPS} dances of {SECONDS} s are made up"));
    compose(&args)?;
    say.line("2/5 they become words");
    let tokenizer = tokenize(&args, None)?;
    say.line("3/5 a small model learns the language");
    train(&args, SETTINGS, say)?;
    let run = load_run(&at("run"), CheckpointChoice::Auto)?;
    let corpus = Corpus::open(at("corpus"))?;
    say.line("4/5 it dances: to a root and a right arm that it has not seen, and on from a first second");
    let test = corpus.split(Split::Test).next().context("the demo's corpus has no test clip")?;
    // the corpus names clips without their extension
    let path = at("motion").join(&test.name).with_extension("bvh");
    let prompt = PromptClip::load(&path, &ReadOptions::default(), &tokenizer)?;
    let (frames, second) = (FRAMES.min(prompt.frames()), tokenizer.fps() as usize);
    let given = |joints: Option<&str>, from_frame| PromptRequest {
        read: ReadOptions::default(),
        joints: joints.map(str::to_owned),
        from_frame,
        ..PromptRequest::of(&path)
    };
    let follows = generate(&args, given(Some(FOLLOWED), None), frames)?;
    let goes_on = generate(&args, given(None, Some(second)), frames)?;
    for (name, dance) in [("dance.bvh", &follows), ("free.bvh", &goes_on)] {
        format::write(&at(name), &Motion::new(at(name), dance.clone()))?;
    }
    say.line("5/5 page and report");
    let seen = tokenizer.decode(&prompt.words, UncodedPose::Clip(&prompt.clip))?;
    let seen = put(&seen, &prompt)?.slice(0..frames);
    page(&at("page.html"), &test.name, &seen, &follows, &goes_on)?;
    let model = run.likelihood(&corpus, Split::Test, args.compute.get())?;
    let model = model.context("the demo's corpus has no test frame")?;
    let floors = ChannelFloors::measure(&CodeSplits::of_corpora(&corpus, &corpus, Split::Test, Extent::Sample)?)?;
    let report = report(&args, model.bits_per_frame, &floors, started.elapsed().as_secs_f64());
    write_whole(&at("report.md"), report.as_bytes())?;
    crate::shell::print(&report)?;
    let [page, dance, free] = ["page.html", "dance.bvh", "free.bvh"].map(|name| at(name).display().to_string());
    say.line(format_args!("done: open {page} in a browser; the dances are {dance} and {free}"));
    Ok(())
}

/// The first line of a demo's report, which marks a folder as a demo's.
const MARK: &str = "# kinelm demo";

/// A folder at `--out` that is empty but for an earlier demo.
fn make_room(args: &Args) -> Result<()> {
    let (out, report) = (args.out.display(), args.out.join("report.md"));
    let holds_files = std::fs::read_dir(&args.out).is_ok_and(|mut entries| entries.next().is_some());
    if holds_files || args.out.is_file() {
        // files that are no demo's aren't replaced, even with --force
        if !kinelm_store::input::peek_bytes(&report).is_ok_and(|text| text.starts_with(MARK.as_bytes())) {
            let what = format!("{out} holds files that are no demo's; give a new or an empty folder with --out");
            return Err(WrongCall(what).into());
        }
        if !args.force {
            let what = format!("{out} holds a demo; give --force to replace it, or another --out");
            return Err(WrongCall(what).into());
        }
    }
    let run = args.out.join("run");
    if run.exists() {
        // a training begins in a new folder; the old one goes if it holds nothing but what a training writes
        crate::train::folder::remove(&run)?;
    }
    for (folder, extensions) in [("motion", &["bvh"][..]), ("music", &["wav"])] {
        sweep(&args.out.join(folder), extensions)?;
    }
    std::fs::create_dir_all(&args.out).with_context(|| out.to_string())?;
    // the mark first: a demo that is interrupted can be recognised, and replaced
    Ok(write_whole(&report, format!("{MARK}, seed {}\n\nIt isn't done.\n", args.seed).as_bytes())?)
}

/// Removes the files of these kinds that another demo has left in a folder: its dances would be taken for this one's.
fn sweep(folder: &Path, extensions: &[&str]) -> Result<()> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Ok(()) };
    for entry in entries {
        let path = entry.with_context(|| folder.display().to_string())?.path();
        if path.is_dir() {
            sweep(&path, extensions)?;
        } else if extensions.contains(&crate::shell::extension(&path).as_str()) && is_made_up(&path) {
            std::fs::remove_file(&path).with_context(|| path.display().to_string())?;
        }
    }
    Ok(())
}

/// Whether a file has the name of a made-up dance: genre_dancer_number.
fn is_made_up(path: &Path) -> bool {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let parts: Vec<&str> = stem.split('_').collect();
    let [genre, dancer, number] = parts[..] else { return false };
    synth::genres().any(|g| g == genre) && synth::dancers().any(|d| d == dancer) && number.parse::<u32>().is_ok()
}

/// The dances as BVH files, and their labels. Of every genre and dancer the last take is for test, the one before for
/// validation.
fn compose(args: &Args) -> Result<()> {
    write_dances(&args.out, &synth::corpus(args.seed, CLIPS, SECONDS, FPS)?)
}

fn write_dances(out: &Path, dances: &[Dance]) -> Result<()> {
    // `synth::corpus` goes through all pairs before the next take
    let pairs = synth::genres().count() * synth::dancers().count();
    let mut labels = "clip,split,genre,dancer,take\n".to_string();
    for (i, dance) in dances.iter().enumerate() {
        let folder = out.join("motion").join(dance.genre);
        std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let name = dance.name();
        let path = folder.join(&name).with_extension("bvh");
        format::write(&path, &Motion::new(&path, dance.clip.clone()))?;
        let split = match (dances.len() - 1 - i) / pairs {
            0 => "test",
            1 => "valid",
            _ => "train",
        };
        labels += &format!("{}/{name},{split},{},{},{name}\n", dance.genre, dance.genre, dance.dancer);
    }
    Ok(write_whole(&out.join("labels.csv"), labels.as_bytes())?)
}

fn tokenize(args: &Args, music: Option<PathBuf>) -> Result<Tokenizer> {
    let labels = args.out.join("labels.csv").display().to_string();
    let dataset = Dataset::find(&[args.out.join("motion")], &[labels])?;
    let read = ReadOptions { rest: RestFrame::Drop, ..ReadOptions::default() };
    let options = BuildOptions { read, strict: true, force: args.force, music, ..BuildOptions::default() };
    let quiet = &mut |_: build::BuildEvent<'_>| std::ops::ControlFlow::Continue(());
    // on the train split alone: the test dances must not decide the bins
    let (tokenizer, _) = build::fit(&dataset, TokenizerConfig::default(), &options, quiet)?;
    tokenizer.save(args.out.join("tokenizer.json"))?;
    build::tokenize(&dataset, &tokenizer, &args.out.join("corpus"), &options, quiet)?;
    Ok(tokenizer)
}

fn train(args: &Args, settings: &str, say: Say) -> Result<()> {
    let options = PretrainOptions {
        file: Some(TrainFile::find(Path::new(settings))?),
        corpora: vec![CorpusPart::once(args.out.join("corpus"))],
        run: Some(args.out.join("run")),
        steps: args.steps,
        seed: Some(args.seed),
        compute: args.compute.get(),
        ..PretrainOptions::default()
    };
    let summary = crate::shell::training::watched(&options, say)?;
    anyhow::ensure!(!summary.stopped, "stopped in training; run the demo again with --force");
    Ok(())
}

/// A dance of the model to a prompt, a part of a test dance.
fn generate(args: &Args, prompt: PromptRequest, frames: usize) -> Result<Clip> {
    let request = Request {
        prompt: Some(prompt),
        length: Some(Length::Frames(frames)),
        seed: Some(args.seed),
        seeding: Some(Seeding::Seed),
        sampling: Sampling { top_p: Some(CALM), ..Sampling::default() },
        computing: Some(args.computing()),
        ..Request::of(args.out.join("run"))
    };
    Ok(OpenRequest::open(&request)?.make_one(Path::new("dance.bvh"))?.generated.motion.clip)
}

/// The clip moved so that it begins in the prompt's place and heading.
fn put(clip: &Clip, prompt: &PromptClip) -> Result<Clip> {
    let placement = Placement::of(&prompt.clip).context("the prompt has no frames")?;
    Ok(placement.put(clip, RootGiven { path: true, heading: true })?)
}

/// The prompt as the model reads it, beside the dances that follow its root and right arm, and its first second.
fn page(path: &Path, name: &str, seen: &Clip, follows: &Clip, goes_on: &Clip) -> Result<()> {
    let followed = joints::parse(FOLLOWED)?.joints;
    let figures = [
        Figure::new(name, seen)
            .note("a test dance, never trained on; orange is what the next one follows")
            .given(&followed),
        Figure::new("follows", follows)
            .note("its root and right arm (orange); the rest is the model's")
            .given(&followed),
        Figure::new("goes on", goes_on).note("from its first second, by itself"),
    ];
    write_page(path, &figures)?;
    Ok(())
}

fn report(args: &Args, model: f64, floors: &ChannelFloors, seconds: f64) -> String {
    let order0 = floors.bits_per_frame[0];
    format!(
        "{MARK}, seed {}\n\n\
         {CLIPS} made-up dances of {SECONDS} s at {FPS} fps; 18 joints at 20 fps, 58 tokens a frame.\n\n\
         | bits/frame on the test dances | |\n|---|---|\n\
         | every character equally likely | {:.1} |\n\
         | order 0 | {order0:.1} |\n\
         | best static model | {:.1} |\n\
         | **the trained model** | **{model:.1}** |\n\n\
         {}\n\n\
         `dance.bvh` follows the root and the right arm of a test dance, `free.bvh` goes on from its first second; `page.html` \
         shows all. {seconds:.0} s in all.\n",
        args.seed,
        floors.uniform(),
        floors.best(),
        if model < floors.best() {
            "The model is below the best static model: it has learned more than habits of single characters."
        } else if model < order0 {
            "The model is below order 0, not below the best static model: more steps (--steps) would help."
        } else {
            "The model is not below order 0: it has learned nothing yet; give it more steps (--steps)."
        },
    )
}
