//! `kinelm generate`.

pub mod again;
mod best;
mod edit;
mod say;

use super::{ComputeArgs, ForceArgs, ReadingArgs, Say, WrongCall, asked, draw::DrawArgs, read::ReadArgs};
use crate::generate::best::Best;
use crate::generate::open::OpenRequest;
use crate::generate::provenance::Provenance;
use crate::generate::request::{
    Computing, FootMode, LeadInKind, Length, MusicRequest, PromptRequest, Request, Rig, TimedLabel,
};
use crate::generate::rest::RestJoints;
use crate::model::run::TOKENIZER;
use crate::train::run::RunFile;
use anyhow::{Context, Result};
use best::BestArgs;
use edit::EditArgs;
use kinelm_motion::format::{self, ReadOptions, RestFrame};
use kinelm_motion::moment::Moment;
use kinelm_store::output::Outputs;
use kinelm_store::sidecar;
use kinelm_tokenizer::{Tokenizer, Words};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run folder of a trained model
    #[arg(long, value_name = "RUN", required_unless_present = "again")]
    run: Option<PathBuf>,
    /// A clip to follow: its joints (--joints), its frames up to one (--from-frame), or both; without, the dance is free
    #[arg(long, value_name = "CLIP")]
    prompt: Option<PathBuf>,
    /// A file with a timeline of clips (docs/plans.md): what none of them gives is made anew. kinelm plan check shows it
    #[arg(long, value_name = "PLAN.toml", conflicts_with_all = ["prompt", "joints", "from_frame", "given", "free", "round",
        "fps_source", "unit", "up", "floor", "map", "bvh_position", "root", "lenient", "keep_rest", "drop_rest", "skip", "body_model"])]
    plan: Option<PathBuf>,
    /// The joints that are followed: groups (root, right_arm, hands, feet, spine, ...), names (SMPL's, or as the prompt's rig
    /// has them) and ids; root brings the translation
    #[arg(long, value_name = "LIST", requires = "prompt")]
    joints: Option<String>,
    /// Go on from this frame of the prompt, at the model's rate, or from 3s on: those before it are kept, as far as they fill
    /// whole words
    #[arg(long, value_name = "N", requires = "prompt", value_parser = super::read::length_in_frames)]
    from_frame: Option<Moment>,
    /// What the dance shall be, for every label field that the model was told of in training; once a field, or for times that
    /// don't meet (genre=salsa@0s:10s)
    #[arg(long = "label", value_name = "FIELD=VALUE[@FROM:TO]")]
    labels: Vec<TimedLabel>,
    /// Music to dance to (.mp3 .ogg .flac .wav .m4a), for a model that was told of music (model.music) or of its tempo
    /// (conditions = ["tempo"]). The dance is as long as the music unless told
    #[arg(long, value_name = "FILE")]
    music: Option<PathBuf>,
    /// The music's time when the dance begins: 12.5s, 12.5 or 250f (frames of the model); 0 if not given
    #[arg(long, value_name = "SECONDS", value_parser = super::read::time, requires = "music")]
    music_from: Option<Moment>,
    /// How far labels and music are followed: 1 as learned, above 1 more so (2 to 3), which takes twice the time. If not
    /// given, with music 3 where the model is told its beats and 2 where it is told its sound, else 1
    #[arg(long, value_name = "G")]
    guidance: Option<f64>,
    /// How far gaps (--given, --free) are led to what is given behind them: 1 as learned, above 1 more so, which takes twice
    /// the time, up to 10; 0 not at all. If not given, 2 where the model was trained for it (model.goal)
    #[arg(long, value_name = "G", value_parser = led, allow_hyphen_values = true)]
    ahead: Option<f64>,
    /// Frames to make, at the model's rate, or 12s; the prompt's length if not given
    #[arg(long, value_name = "N", value_parser = super::read::length_in_frames, required_unless_present_any = ["prompt", "plan", "again", "seconds", "music"])]
    frames: Option<Moment>,
    /// Seconds to make, instead of --frames: 12, 12s or 240f
    #[arg(long, value_name = "S", conflicts_with = "frames", value_parser = super::read::length)]
    seconds: Option<Moment>,
    /// Frames a second of the file that is written; those between the model's lie on smooth curves. The model's rate if not given
    #[arg(long, value_parser = super::read::rate)]
    fps: Option<f64>,
    /// Where the dance goes (.bvh .npz .json); with --variations, the dances go to FILE-1, FILE-2, ... before the
    /// extension. FILE.bvh.kinelm.json beside each tells where it is from
    #[arg(long, value_name = "FILE", required_unless_present = "again")]
    out: Option<PathBuf>,
    /// Make a dance again, to the same bytes, from the FILE.bvh.kinelm.json beside it; --run, --prompt, --music and --out if they
    /// are elsewhere now
    #[arg(long, value_name = "FILE.bvh.kinelm.json", conflicts_with_all = ["up", "floor", "joints", "from_frame", "given", "free", "blend", "tries", "starts", "lead_in", "labels", "music_from", "guidance", "ahead", "frames", "seconds", "fps",
        "variations", "best", "real", "keep_all", "seed", "greedy", "temperature", "top_k", "top_p", "min_p", "repetition_penalty",
        "repetition_words", "rig", "rest_joints", "feet", "weights", "kv", "device", "form", "fps_source", "unit", "map",
        "bvh_position", "root", "lenient", "keep_rest", "drop_rest", "skip", "body_model"])]
    again: Option<PathBuf>,
    /// Dances to make side by side, which costs less than one after the other; the first is the one made without this
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16))]
    variations: u8,
    /// The seed of the draws; the same gives the same dance
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// First frames to draw of a dance that is given joints behind free ones from there on; it goes on from the one under
    /// which these are likeliest. Nothing of them is cut. 64 if not given, 1 where --tries chooses among whole dances
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..))]
    starts: Option<u8>,
    /// The second that a dance from nothing goes on from, which is left out of it. If not given, train where the run keeps
    /// some, as every run does that was trained by kinelm
    #[arg(long, value_enum)]
    lead_in: Option<LeadInKind>,
    /// The rig the dance is written on: the model's (SMPL-24), or the prompt's own. If not given, the model's, and the
    /// prompt's own with --given or --free
    #[arg(long, value_enum, requires_if("prompt", "prompt"))]
    rig: Option<Rig>,
    /// What the joints do that the model doesn't know; if not given, follow with a prompt, training without
    #[arg(long, value_enum, requires_ifs([("follow", "prompt"), ("prompt", "prompt"), ("mean", "prompt")]))]
    rest_joints: Option<RestJoints>,
    /// Feet that stand are held where they stand, and the body on its floor, as far as they are not given; or all is left
    /// as it is decoded. If not given, lock where no leg is followed
    #[arg(long, value_enum)]
    feet: Option<FootMode>,
    /// Free tokens that are guessed to be those of the word before, and verified in one read; changes no token.
    /// If not given, 8 with --greedy and none without: drawn tokens are too rarely those of the word before
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(..=64), hide_short_help = true)]
    guesses: Option<u8>,
    #[command(flatten)]
    best: BestArgs,
    #[command(flatten)]
    edit: EditArgs,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    draw: DrawArgs,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    compute: ComputeArgs,
    #[command(flatten)]
    read: ReadArgs,
}

/// How far gaps are led; beyond 10 a model draws from what it hardly means.
fn led(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|ahead| (0.0..=10.0).contains(ahead));
    number.ok_or("expected a number from 0 (not at all) to 10; 1 is as learned".into())
}

pub fn run(args: Args, say: Say) -> Result<()> {
    if let Some(file) = &args.again {
        return again::again(&args, file, say);
    }
    let outs = outs(&args)?;
    check_out(&args, &outs)?;
    let request = request(&args, say)?;
    let outputs = outputs(&args, &request.run, request.prompt.as_ref(), request.music.as_ref());
    // all names, before the first frame
    outputs.check(outs.iter().map(PathBuf::as_path))?;
    for out in &outs {
        outputs.check_replaceable(out, None)?;
        outputs.check_replaceable(&sidecar::path_of(out), None)?;
    }
    // what is asked in words that the model doesn't have is a wrong call
    let ready = OpenRequest::open(&request).map_err(asked)?;
    say::opened(&ready, say)?;
    let beside = args.best.beside(&ready, say)?;
    let drawn = args.best.best.map_or(outs.len(), usize::from);
    let danced = danced(&ready, drawn, args.guesses, say)?;
    let chosen: Vec<(usize, Option<Best>)> = match beside {
        Some(beside) => {
            let best = beside.choose(&ready, &danced, outs.len(), &outs[0], say)?;
            best.into_iter().map(|(i, best)| (i, Some(best))).collect()
        }
        None => (0..drawn).map(|i| (i, None)).collect(),
    };
    for ((i, best), out) in chosen.into_iter().zip(&outs) {
        let words = &danced[i];
        let made = ready.motion(words, out)?;
        let bytes = made.bytes(out)?;
        let told = Provenance { best, ..Provenance::of(&ready, i + 1, (out, made.motion.clip.fps()), &bytes)? };
        told.write(out, &bytes, &outputs)?;
        super::convert::told(out, &made.motion, say);
        if let Some(from) = ready.lead_in(i).map(|lead_in| &lead_in.from) {
            let from_s = from.frame as f64 / ready.tokenizer.fps();
            say.line(format_args!("goes on from a second of {} (a train clip) at {from_s:.2} s", from.clip));
        }
        edit::say_left(&made.left, made.locked_fps, say);
        if let Some(edited) = ready.prompt.as_ref().and_then(|prompt| prompt.edit.as_ref()) {
            edit::say_seam(edited, &made, say);
        }
        made.locked.iter().for_each(|locked| super::filter::say_locked(locked, made.locked_fps, say));
        say::read_back(&ready, words, out, say)?;
    }
    Ok(())
}

/// What a request reads is not written over.
fn outputs(args: &Args, run: &Path, prompt: Option<&PromptRequest>, music: Option<&MusicRequest>) -> Outputs {
    let prompt = prompt.into_iter().flat_map(|prompt| {
        let map = prompt.read.map.iter().map(PathBuf::from);
        map.chain(prompt.read.body_model.clone()).chain(prompt.files())
    });
    let music = music.map(|music| music.path.clone());
    let others = music.into_iter().chain([run.to_owned()]).chain(args.again.clone()).chain(args.plan.clone());
    args.force.outputs(prompt.chain(others))
}

/// What is requested.
fn request(args: &Args, say: Say) -> Result<Request> {
    let mut labels = BTreeMap::new();
    let (always, timed): (Vec<&TimedLabel>, Vec<_>) = args.labels.iter().partition(|label| label.is_always());
    for TimedLabel { field, value, .. } in always {
        if labels.insert(field.clone(), value.clone()).is_some() {
            return Err(WrongCall(format!("--label {field}={value}: {field} is asked for twice; give it once")).into());
        }
    }
    let mut timed: Vec<TimedLabel> = timed.into_iter().cloned().collect();
    let prompt = match &args.plan {
        Some(plan) => {
            let (prompt, told) = edit::planned(plan, &args.edit, say)?;
            timed.extend(told);
            Some(prompt)
        }
        None => match args.prompt.clone() {
            None => None,
            Some(path) => {
                let read = read_as(args, &path, say);
                let from_frame = args.from_frame.map(|at| of_model(args, at)).transpose()?.map(|(_, at)| at as usize);
                let edit = args.edit.get(&|| Ok(format::read(&path, &read)?.clip.fps()))?;
                Some(PromptRequest { path, read, joints: args.joints.clone(), from_frame, plan: None, edit })
            }
        },
    };
    if prompt.as_ref().is_some_and(|p| p.joints.is_none() && p.from_frame.is_none() && p.edit.is_none()) {
        let what = "--prompt alone; say what is followed (--joints LIST, --from-frame N, or both) or what of it is made anew \
                    (--free, --given)";
        return Err(WrongCall(what.into()).into());
    }
    let music_from = args.music_from.map(|at| of_model(args, at)).transpose()?;
    let music = args.music.clone().map(|path| MusicRequest { path, from_s: music_from.unwrap_or_default().0 });
    let length = args.frames.or(args.seconds).map(|length| match length {
        Moment::Seconds(seconds) => Length::Seconds(seconds),
        frames => Length::Frames(frames.number() as usize),
    });
    let reading = args.reading.get(1);
    Ok(Request {
        prompt,
        labels,
        timed_labels: timed,
        music,
        guidance: args.guidance,
        ahead: args.ahead,
        length,
        fps: args.fps,
        lead_in: args.lead_in,
        starts: args.starts.map(usize::from),
        seed: args.seed,
        draw: args.draw.requested()?,
        rig: args.rig,
        rest_joints: args.rest_joints,
        feet: args.feet,
        computing: Computing::new(args.compute.get(), reading.weights, reading.kv),
        ..Request::of(args.run.clone().context("no run folder")?)
    })
}

/// A time in seconds and in frames of the model, whose rate is read where it is needed.
fn of_model(args: &Args, time: Moment) -> Result<(f64, f64)> {
    let run = args.run.as_ref().context("no run folder")?;
    let fps = Tokenizer::load(run.join(TOKENIZER))?.fps();
    Ok((time.seconds(fps), time.frames(fps)))
}

/// How a prompt is read: as told, as its sidecar says, or as a corpus that the run learned from has read it.
fn read_as(args: &Args, path: &Path, say: Say) -> ReadOptions {
    // what is wrong with the run, reading it says
    let corpora = args.run.as_deref().and_then(|run| RunFile::read(run).ok()).map_or(Vec::new(), |file| file.corpora);
    let corpora: Vec<PathBuf> = corpora.into_iter().map(|corpus| corpus.path).collect();
    args.read.of_files_known(&[path], RestFrame::Drop, &corpora, say).remove(0)
}

/// The words of so many dances.
fn danced(ready: &OpenRequest, variations: usize, guesses: Option<u8>, say: Say) -> Result<Vec<Words>> {
    let bar = super::progress::bar(ready.frames as u64, "frames", say);
    let danced = ready.dance(variations, guesses.map(usize::from), &mut |frames| bar.set_position(frames as u64));
    drop(bar);
    let danced = danced?;
    if danced.guessed > 0 {
        say.line(format_args!("{} of {} tokens guessed ahead were right", danced.right, danced.guessed));
    }
    Ok((0..danced.ids.len()).map(|dance| ready.words(&danced, dance)).collect())
}

/// The files that are written.
fn outs(args: &Args) -> Result<Vec<PathBuf>> {
    let out = args.out.as_ref().context("no file to write to")?;
    let numbered = |i: u8| {
        let mut name = out.file_stem().unwrap_or_default().to_owned();
        name.push(format!("-{i}."));
        name.push(out.extension().unwrap_or_default());
        out.with_file_name(name)
    };
    Ok(match args.best.written(args.variations) {
        1 => vec![out.clone()],
        n => (1..=n).map(numbered).collect(),
    })
}

fn check_out(args: &Args, outs: &[PathBuf]) -> Result<()> {
    let mut extension = String::new();
    for out in outs {
        extension = super::writable(out)?;
    }
    if let Some(best) = args.best.best.filter(|best| *best < args.variations) {
        let what = format!("--variations {} of --best {best}; expected as many at most", args.variations);
        return Err(WrongCall(what).into());
    }
    if args.draw.get()?.greedy && args.variations > 1 {
        let what = "--variations with --greedy: the likeliest dance is always the same; leave one of them out";
        return Err(WrongCall(what.into()).into());
    }
    if let Some(fps) = args.fps.filter(|fps| *fps < 1.0 && extension == "bvh") {
        let what = format!("--fps {fps} with a .bvh: its frame time is a second at most; write .npz or .json");
        return Err(WrongCall(what).into());
    }
    let is_amass = |prompt: &PathBuf| ["npz", "pkl"].contains(&super::extension(prompt).as_str());
    if (args.edit.is_asked() || args.plan.is_some())
        && args.rig.is_none()
        && extension == "npz"
        && !args.prompt.as_ref().is_some_and(is_amass)
    {
        let what = "an .npz of an edited clip, which is on its own rig: AMASS files are on the model's; write .bvh or .json, or \
                    add --rig model";
        return Err(WrongCall(what.into()).into());
    }
    if args.rig == Some(Rig::Prompt) && extension == "npz" {
        return Err(WrongCall(
            "--rig prompt with an .npz: AMASS files are on the model's rig; write .bvh or .json".into(),
        )
        .into());
    }
    Ok(())
}
