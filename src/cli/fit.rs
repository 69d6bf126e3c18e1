//! `kinelm tokenizer fit`.

use super::data::DataArgs;
use super::{ForceArgs, Say, WrongCall, read::ReadArgs};
use crate::corpus::{self, Settings};
use anyhow::Result;
use kinelm_motion::format::RestFrame;
use kinelm_tokenizer::{Tokenizer, TokenizerConfig, WordLength};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    data: DataArgs,
    /// Where the tokenizer goes
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    settings: SettingsArgs,
    #[command(flatten)]
    read: ReadArgs,
}

/// A file of settings, and flags that win over it. A key that the scheme doesn't have is refused by name.
#[derive(Debug, Clone, clap::Args)]
pub struct SettingsArgs {
    /// Settings: uniform, thesis, quantile, dct-pca, lapped, or a TOML file. The flags below override them
    #[arg(long, value_name = "NAME|FILE")]
    config: Option<PathBuf>,
    /// Joints to code: 13, 18, 24, or a list of groups, names and ids [default: 18]
    #[arg(long, value_name = "13|18|24|LIST")]
    joints: Option<String>,
    /// Frames per second of the words [default: 20]
    #[arg(long, value_parser = super::values::positive)]
    fps: Option<f64>,
    /// How the rotation of the root is coded: in the world, or its heading as steps and its tilt [default:
    /// heading_delta]
    #[arg(long, value_parser = ["absolute", "heading_delta"])]
    root_rotation: Option<String>,
    /// Byte-pair merges of characters that often occur together [default: 0]
    #[arg(long)]
    merges: Option<u32>,
    /// How numbers become characters [default: uniform]
    #[arg(long, value_parser = ["uniform", "quantile", "dct", "lapped"])]
    scheme: Option<String>,
    /// Bins per number [default: 360]
    #[arg(long)]
    bins: Option<u32>,
    /// Uniform scheme: whether a bin is centred on 0 or has an edge there [default: centred]
    #[arg(long, value_parser = ["centred", "edge"])]
    form: Option<String>,
    /// Uniform scheme: the translation of the root as steps relative to its heading, or as positions in metres
    /// [default: velocity]
    #[arg(long, value_parser = ["velocity", "absolute"])]
    translation: Option<String>,
    /// The height of the root: above the clip's floor, as steps (not lapped), or in the world (uniform, lapped)
    /// [default: floor]
    #[arg(long, value_parser = ["floor", "velocity", "absolute"])]
    height: Option<String>,
    /// Any other key of the scheme, as in its file: tile=60, keep=0.1, joint_transform.type=pca; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl SettingsArgs {
    /// The settings of the file with the flags on top; the flags alone make a wrong call, the file is named otherwise.
    pub fn config(&self) -> Result<TokenizerConfig> {
        let mut settings = match &self.config {
            Some(path) => Settings::find(path)?,
            None => Settings::default(),
        };
        let own = settings.clone().config();
        if let Some(kind) = &self.scheme {
            settings.set_scheme(kind);
        }
        self.joints.iter().for_each(|list| settings.set("joints", list.as_str()));
        self.fps.iter().for_each(|&fps| settings.set("fps", fps));
        self.merges.iter().for_each(|&n| settings.set("merges", i64::from(n)));
        self.root_rotation.iter().for_each(|kind| settings.set("root_rotation", kind.as_str()));
        self.bins.iter().for_each(|&n| settings.set_in_scheme("bins", i64::from(n)));
        self.form.iter().for_each(|form| settings.set_in_scheme("form", form.as_str()));
        self.translation.iter().for_each(|t| settings.set_in_scheme("translation", t.as_str()));
        self.height.iter().for_each(|t| settings.set_in_scheme("height", t.as_str()));
        for pair in &self.set {
            settings.set_pair(pair)?;
        }
        let Some(path) = &self.config else { return settings.config().map_err(|e| WrongCall(e.to_string()).into()) };
        if own.is_err() {
            return Ok(settings.config()?);
        }
        // a file that holds by itself is not at fault
        let flags = match self.set.is_empty() {
            true => "the flags".into(),
            false => self.set.iter().map(|pair| format!("--set {pair}")).collect::<Vec<_>>().join(" "),
        };
        let over = |e| WrongCall(format!("{flags} over {}: {e}", path.display())).into();
        settings.of_no_file().config().map_err(over)
    }
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let config = args.settings.config()?;
    let dataset = args.data.find(say)?;
    let inputs = args.data.files(&dataset).chain(args.settings.config.clone()).chain(args.read.files());
    let outputs = args.force.outputs(inputs);
    outputs.check([&*args.out])?;
    let options = args.data.build_options(args.read.options(RestFrame::Drop));
    let (tokenizer, summary) =
        corpus::build::fit(&dataset, config, &options, &mut *super::progress::watch(say, "fitting the tokenizer"))?;
    outputs.write(&args.out, tokenizer.to_json().as_bytes())?;
    for line in summary.lines() {
        say.line(line);
    }
    say.line(format_args!("{}: {}", args.out.display(), described(&tokenizer)));
    Ok(())
}

/// What its words are, in a line.
fn described(tokenizer: &Tokenizer) -> String {
    let frames = match tokenizer.frames_per_word() {
        1 => "a frame".to_owned(),
        n => format!("{n} frames"),
    };
    let vocabulary = tokenizer.vocabulary();
    let merged = match vocabulary.merged() {
        0 => String::new(),
        n => format!(", {n} merged tokens"),
    };
    let length = match tokenizer.word_length() {
        WordLength::Fixed(c) => format!("{c} characters"),
        WordLength::Varying { most } => format!("up to {most} characters"),
    };
    let tokens = match tokenizer.tokens_per_word() {
        Some(w) => format!("{w} tokens"),
        None => format!("at most {} tokens in training", tokenizer.longest_word()),
    };
    format!("words of {length}, {tokens} {frames}, {} characters{merged}", vocabulary.characters())
}
