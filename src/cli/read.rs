//! The reading options, the same on every command that reads motion.

use super::Say;
use crate::corpus::sidecar;
use crate::corpus::store::read_options_in;
use kinelm_motion::format::{BvhPosition, MirrorAxis, ReadOptions, RestFrame, Unit, Up};
use kinelm_store::hash;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// How motion files are read.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Reading motion")]
pub struct ReadArgs {
    /// The files' true frame rate, where they state a wrong one
    #[arg(long, value_name = "FPS", value_parser = super::values::rate)]
    pub fps_source: Option<f64>,
    /// The unit of the file's lengths, where it states none or a wrong one: m, dm, cm, mm, in, ft, cmu or metres as
    /// "0.0725 m"; auto takes what the file states, and for a BVH what the length of the legs tells [default: auto]
    #[arg(long, value_name = "UNIT")]
    pub unit: Option<Unit>,
    /// The axis that points up in the file; auto takes the one that its format has, and for BVH and AMC, which have none,
    /// the one that rest pose, motion and feet show [default: auto]
    #[arg(long, value_enum, allow_hyphen_values = true, value_name = "AXIS")]
    pub up: Option<Up>,
    /// The skeleton map, for rigs whose joint names no built-in map knows: a built-in name or a TOML file
    #[arg(long, value_name = "NAME|FILE")]
    pub map: Option<String>,
    /// Whether position channels of a joint replace its OFFSET or are added to it [default: replace]
    #[arg(long, value_enum)]
    pub bvh_position: Option<BvhPosition>,
    /// What to read of a file: one of several figures, by its root or armature, or a joint to be the root
    #[arg(long, value_name = "NAME")]
    pub root: Option<String>,
    /// The animation to read of a GLB or FBX with several [default: the longest that moves the figure]
    #[arg(long, value_name = "NAME")]
    pub take: Option<String>,
    /// Read the whole rows of a file that ends early
    #[arg(long)]
    pub lenient: bool,
    /// Keep a leading rest-pose frame, the default of inspect, convert and view
    #[arg(long, conflicts_with = "drop_rest")]
    pub keep_rest: bool,
    /// Drop a leading rest-pose frame, the default of tokenizers, corpora and prompts
    #[arg(long)]
    pub drop_rest: bool,
    /// Source frames to drop at the start; with N > 0 no rest-pose frame is looked for
    #[arg(long, value_name = "N")]
    pub skip: Option<usize>,
    /// Your own SMPL_*.npz, whose rest offsets and shape replace those of the neutral skeleton (AMASS, AIST++)
    #[arg(long, value_name = "FILE")]
    pub body_model: Option<PathBuf>,
    /// The height of the floor in metres, for tokenizers that code heights above it; auto estimates it from the feet
    /// [default: auto]
    #[arg(long, value_name = "auto|METRES", value_parser = floor, allow_negative_numbers = true)]
    pub floor: Option<FloorArg>,
    /// Undo a mirror along this axis of the file's world, as of an export from a left-handed program; the file's own axes
    /// are written back
    #[arg(long, value_enum, value_name = "AXIS")]
    pub mirror_axis: Option<MirrorAxis>,
}

/// `--floor`: by the feet, or a height.
#[derive(Debug, Clone, Copy)]
pub struct FloorArg(Option<f64>);

/// `auto`, or a height in metres.
fn floor(text: &str) -> Result<FloorArg, String> {
    if text == "auto" {
        return Ok(FloorArg(None));
    }
    text.parse()
        .ok()
        .filter(|x: &f64| x.is_finite())
        .map(|x| FloorArg(Some(x)))
        .ok_or("expected auto or a height in metres".into())
}

impl ReadArgs {
    /// The files that are read besides the motion.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        self.map.iter().map(PathBuf::from).chain(self.body_model.clone())
    }

    /// The options of the call; `rest` is the command's default for rest-pose frames.
    pub fn options(&self, rest: RestFrame) -> ReadOptions {
        self.over(&ReadOptions { rest, ..ReadOptions::default() })
    }

    /// The options of the call, and those of `read` where the call gives none.
    fn over(&self, read: &ReadOptions) -> ReadOptions {
        ReadOptions {
            fps_source: self.fps_source.or(read.fps_source),
            unit: self.unit.unwrap_or(read.unit),
            up: self.up.unwrap_or(read.up),
            map: self.map.clone().or(read.map.clone()),
            bvh_position: self.bvh_position.unwrap_or(read.bvh_position),
            root: self.root.clone().or(read.root.clone()),
            take: self.take.clone().or(read.take.clone()),
            // a flag can only switch it on
            lenient: self.lenient || read.lenient,
            rest: match (self.keep_rest, self.drop_rest) {
                (true, _) => RestFrame::Keep,
                (_, true) => RestFrame::Drop,
                _ => read.rest,
            },
            skip: self.skip.unwrap_or(read.skip),
            body_model: self.body_model.clone().or(read.body_model.clone()),
            floor: self.floor.map_or(read.floor, |floor| floor.0),
            mirror_axis: self.mirror_axis.or(read.mirror_axis),
        }
    }

    /// How each file of a call is read. Options of the call win; else a dance is read as its sidecar says, which is
    /// reported, and any other file by the command's defaults. With several files, options of the call apply to those
    /// without a sidecar.
    pub fn of_files<P: AsRef<Path>>(&self, files: &[P], rest: RestFrame, say: Say) -> Vec<ReadOptions> {
        self.of_files_known(files, rest, &[], say)
    }

    /// [`ReadArgs::of_files`] for a single file.
    pub fn of_file(&self, file: &Path, rest: RestFrame, say: Say) -> ReadOptions {
        self.of_files(&[file], rest, say).remove(0)
    }

    /// [`ReadArgs::of_files`] for a model trained on `corpora`: a file without a sidecar that is in one of them is read
    /// as it was read for that corpus.
    pub fn of_files_known<P: AsRef<Path>>(
        &self,
        files: &[P],
        rest: RestFrame,
        corpora: &[PathBuf],
        say: Say,
    ) -> Vec<ReadOptions> {
        let (mut all, mut words, mut gone) = (Vec::new(), Vec::new(), BTreeSet::new());
        for file in files.iter().map(AsRef::as_ref) {
            let own = sidecar::read_options(file).unwrap_or_else(|e| {
                say.line(e);
                None
            });
            let Some(own) = own else {
                // the error of hashing is that of reading
                let sha256 = if corpora.is_empty() { None } else { hash::of_file(file).ok() };
                let known = sha256.and_then(|sha256| corpora.iter().find_map(|c| known_to(c, &sha256, &mut gone)));
                let read = self.over(known.as_ref().unwrap_or(&ReadOptions { rest, ..ReadOptions::default() }));
                if let Some(how) = known.and_then(|known| how(&known, &read)) {
                    say.line(format_args!("{}: read as the model's corpus read it: {how}", file.display()));
                }
                all.push(read);
                continue;
            };
            let read = match files.len() {
                1 => self.over(&own),
                _ => sidecar::combined(own.clone(), &self.options(rest)),
            };
            words.extend(sidecar::describe(&own, &read).map(|words| (file.display().to_string(), words)));
            all.push(read);
        }
        sidecar::describe_all(&words).iter().for_each(|line| say.line(line));
        if !gone.is_empty() {
            let gone: Vec<String> = gone.iter().map(|corpus| corpus.display().to_string()).collect();
            let what =
                "the model's corpus can't be read: whether it has these files, and how it read them, isn't known";
            say.line(format_args!("{}: {what}", gone.join(", ")));
        }
        all
    }
}

/// How a corpus read the file with this hash, if it contains it. A corpus that can't be read is added to `gone`.
fn known_to<'a>(corpus: &'a Path, sha256: &str, gone: &mut BTreeSet<&'a Path>) -> Option<ReadOptions> {
    // without the error: all such corpora are reported together, and the file is read all the same
    read_options_in(corpus, sha256).unwrap_or_else(|_| {
        gone.insert(corpus);
        None
    })
}

/// The options that were taken over from `known`, as text.
fn how(known: &ReadOptions, read: &ReadOptions) -> Option<String> {
    let fps = known.fps_source.filter(|_| known.fps_source == read.fps_source).map(|fps| format!("{fps} fps"));
    let words: Vec<String> = fps.into_iter().chain(sidecar::describe(known, read)).collect();
    (!words.is_empty()).then(|| words.join(", "))
}
