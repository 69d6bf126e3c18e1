//! What every call of `generate` may state of its dances.

use super::at_model_rate;
use super::best::BestArgs;
use crate::cli::draw::DrawArgs;
use crate::cli::values::{length, length_in_frames, rate, run_folder, time};
use crate::cli::{CheckpointArg, ComputeArgs, ForceArgs, ReadingArgs, extension, writable_into, wrong_call};
use crate::generate::masked::{MOST_PASSES, PASSES};
use crate::generate::open::{
    FEATURE_GUIDANCE, FPS, GOAL_GUIDANCE, LABEL_GUIDANCE, MOST_CANDIDATES, MUSIC_GUIDANCE, SEED,
};
use crate::generate::request::{
    Computing, Edit, FootMode, LeadInKind, Length, MusicRequest, PromptRequest, Request, Rig, TimedLabel, UncodedJoints,
};
use crate::generate::sampler::{FIRST_FRAMES, GUESSES};
use crate::generate::score::BLOCK_S;
use anyhow::Result;
use kinelm_motion::moment::Moment;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct DanceArgs {
    /// The run folder of a trained model [default: ready, kinelm's own]
    #[arg(long, value_name = "RUN", value_parser = run_folder())]
    run: Option<PathBuf>,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    /// Where the dance goes (.bvh .npz .json .glb .vrma); with --variations to FILE-1, FILE-2, ... before the extension. A sidecar,
    /// FILE.bvh.kinelm.json, records how it was made
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// A label that the dance is conditioned on, of the whole dance or of a part of it (genre=salsa@0s:10s); may be repeated
    /// for other fields, or for parts that don't overlap. Fields that are left out are unknown to the model
    #[arg(long = "label", value_name = "FIELD=VALUE[@FROM:TO]")]
    labels: Vec<TimedLabel>,
    /// Music to dance to (.mp3 .ogg .flac .wav .m4a .aac), for a model conditioned on music (model.music) or tempo
    /// (conditions = ["tempo"]). By default the dance is as long as the music
    #[arg(long, value_name = "FILE")]
    music: Option<PathBuf>,
    /// The time in the music at which the dance starts: 12.5s, 12.5 or 250f (frames of the model) [default: 0s]
    #[arg(long, value_name = "SECONDS", value_parser = time)]
    music_from: Option<Moment>,
    #[arg(long, value_name = "G", help = format!("Guidance towards labels and music: 1 as trained, 2 to 3 stronger, at twice \
        the time [default: {MUSIC_GUIDANCE} where the model is conditioned on beats, {FEATURE_GUIDANCE} on sound, {LABEL_GUIDANCE} with labels, else 1]"))]
    guidance: Option<f64>,
    #[arg(long, value_name = "G", value_parser = goal_guidance, allow_hyphen_values = true, help = format!(
        "Guidance of gaps (--given, --free) towards what is given after them: 0 none, 1 as trained, up to 10, at twice the \
        time [default: {GOAL_GUIDANCE} where the model was trained for it (model.goal)]"))]
    goal_guidance: Option<f64>,
    /// Frames to generate at the model's rate, or a time such as 12s [default: the prompt's length, or the music's]
    #[arg(long, value_name = "N", value_parser = length_in_frames,
        required_unless_present_any = ["prompt", "onto", "path", "seconds", "music"])]
    frames: Option<Moment>,
    /// Seconds to generate, instead of --frames: 12, 12s or 240f
    #[arg(long, value_name = "S", conflicts_with = "frames", value_parser = length)]
    seconds: Option<Moment>,
    #[arg(long, value_parser = rate, help = format!("Frames per second of the file, on a smooth curve through the model's \
        frames [default: the prompt's, else {FPS}]"))]
    fps: Option<f64>,
    /// Dances to generate side by side, which is faster than one by one; the first is the one without this flag
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16))]
    variations: u8,
    /// Random seed; the same seed gives the same dance
    #[arg(long, default_value_t = SEED)]
    seed: u64,
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..), help = format!(
        "First-frame candidates, where later joints of the first frame are given: the dance continues from the one under \
        which these are most likely. No truncation applies to them [default: {FIRST_FRAMES}; 1 where --tries chooses among \
        whole dances]"))]
    first_frames: Option<u8>,
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=MOST_CANDIDATES as i64), help = format!(
        "Continuations that are sampled of every {BLOCK_S} seconds, of which the dance goes on with the one that keeps its \
        balance, its feet and its pace best; 1 to {MOST_CANDIDATES} [default: 1, no choice]"))]
    look_ahead: Option<u8>,
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..), help = format!("Passes of a masked model \
        over each window: the most certain characters stay, the others are sampled again; 1 to {MOST_PASSES} \
        [default: {PASSES}]"))]
    passes: Option<u8>,
    /// The second that an unprompted dance continues from, and that is left out of it [default: train, where the run has some]
    #[arg(long, value_enum)]
    lead_in: Option<LeadInKind>,
    /// The rig that the dance is written on: the model's (SMPL-24) or the prompt's [default: prompt with --given, --free or
    /// --loop, else model]
    #[arg(long, value_enum)]
    rig: Option<Rig>,
    /// The motion of joints that the model doesn't code [default: follow with a prompt, else training]
    #[arg(long, value_enum)]
    uncoded_joints: Option<UncodedJoints>,
    /// Lock the feet while they are in contact with the floor, and keep the body on it, or leave all as decoded [default: lock
    /// where no leg is given]
    #[arg(long, value_enum)]
    feet: Option<FootMode>,
    /// Seconds of cross-fade where generated frames meet given ones: 0.2s, 0.2 or 12f (frames of the file); 0 to 60
    #[arg(long, value_name = "S", default_value_t = Moment::Seconds(Edit::BLEND_S), value_parser = time)]
    pub blend: Moment,
    /// Samples of a gap, of which the one that ends nearest to the given frames is used
    #[arg(long, value_name = "N", default_value_t = Edit::TRIES, value_parser = clap::value_parser!(u8).range(1..=64))]
    pub tries: u8,
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(..=64), hide_short_help = true, help = format!(
        "Tokens that are guessed from the previous word and verified in one pass, which changes no token [default: {GUESSES} \
        with --greedy, else 0]"))]
    pub guesses: Option<u8>,
    #[command(flatten)]
    pub best: BestArgs,
    #[command(flatten)]
    pub force: ForceArgs,
    #[command(flatten)]
    draw: DrawArgs,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    compute: ComputeArgs,
}

fn goal_guidance(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|scale| (0.0..=10.0).contains(scale));
    number.ok_or("expected a number from 0 (not at all) to 10; 1 is as trained".into())
}

impl DanceArgs {
    /// The run folder: the one given, else the ready model's.
    pub fn run(&self) -> Result<PathBuf> {
        self.run.clone().map_or_else(|| Ok(kinelm_ready::run()?), Ok)
    }

    /// Whether the prompt's own rig is requested by name.
    pub fn is_on_own_rig(&self) -> bool {
        self.rig == Some(Rig::Prompt)
    }

    /// Requests the prompt's own rig.
    pub fn put_on_own_rig(&mut self) {
        self.rig = Some(Rig::Prompt);
    }

    /// Whether the ready model is meant without being named.
    pub fn is_ready(&self) -> bool {
        self.run.is_none()
    }

    /// The request for a dance with this prompt and these labels besides those of the call.
    pub fn request(&self, prompt: Option<PromptRequest>, mut timed_labels: Vec<TimedLabel>) -> Result<Request> {
        let (always, timed): (Vec<&TimedLabel>, Vec<_>) = self.labels.iter().partition(|label| label.is_always());
        let mut labels = BTreeMap::new();
        for TimedLabel { field, value, .. } in always {
            if labels.insert(field.clone(), value.clone()).is_some() {
                wrong_call!("--label {field}={value}: {field} is given twice; give it once");
            }
        }
        timed_labels.splice(0..0, timed.into_iter().cloned());
        let music_from = self.music_from.map(|at| at_model_rate(&self.run()?, at)).transpose()?;
        let reading = self.reading.get(1);
        Ok(Request {
            prompt,
            labels,
            timed_labels,
            music: self.music.clone().map(|path| MusicRequest::of(path, music_from.map(|(from_s, _)| from_s))),
            guidance: self.guidance,
            goal_guidance: self.goal_guidance,
            length: self.frames.or(self.seconds).map(|length| match length {
                Moment::Seconds(seconds) => Length::Seconds(seconds),
                frames => Length::Frames(frames.number() as usize),
            }),
            fps: self.fps,
            lead_in: self.lead_in,
            first_frames: self.first_frames.map(usize::from),
            look_ahead: self.look_ahead.map(usize::from),
            passes: self.passes.map(usize::from),
            seed: Some(self.seed),
            sampling: self.draw.requested()?,
            rig: self.rig,
            uncoded_joints: self.uncoded_joints,
            feet: self.feet,
            computing: Some(Computing::new(self.compute.get(), reading.weights, reading.kv)),
            checkpoint: self.checkpoint.get(),
            ..Request::of(self.run()?)
        })
    }

    /// The files to write. Refuses, before anything is read, what can't be written: `edited` is whether a clip is edited,
    /// `embed` whether the dance goes into its prompt.
    pub fn outs(&self, edited: bool, prompt: Option<&Path>, embed: bool) -> Result<Vec<PathBuf>> {
        let Some(out) = &self.out else { wrong_call!("no --out FILE; expected where the dance goes") };
        let extension = writable_into(out, embed)?;
        if let Some(best) = self.best.best.filter(|best| *best < self.variations) {
            wrong_call!("--variations {} of --best {best}; expected as many at most", self.variations);
        }
        if self.draw.get()?.greedy && self.variations > 1 {
            wrong_call!("--variations with --greedy: the likeliest dance is always the same; leave one of them out");
        }
        if let Some(fps) = self.fps.filter(|fps| *fps < 1.0 && extension == "bvh") {
            wrong_call!("--fps {fps} with a .bvh: its frame time is a second at most; write .npz or .json");
        }
        let is_amass = |prompt: &Path| ["npz", "pkl"].contains(&self::extension(prompt).as_str());
        if edited && self.rig.is_none() && extension == "npz" && !prompt.is_some_and(is_amass) {
            wrong_call!(
                "an .npz of an edited clip, which is on its own rig: AMASS files are on the model's; write .bvh or .json, or add \
                 --rig model"
            );
        }
        if self.is_on_own_rig() && extension == "npz" {
            wrong_call!(
                "--rig prompt (--onto) with an .npz: AMASS files are on the model's rig; write .bvh, .json or .glb"
            );
        }
        let numbered = |i: u8| {
            let mut name = out.file_stem().unwrap_or_default().to_owned();
            name.push(format!("-{i}."));
            name.push(out.extension().unwrap_or_default());
            out.with_file_name(name)
        };
        Ok(match self.best.written(self.variations) {
            1 => vec![out.clone()],
            n => (1..=n).map(numbered).collect(),
        })
    }
}
