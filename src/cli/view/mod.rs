//! `kinelm view`.

mod music;

use super::named::{Named, named};
use super::{ForceArgs, Odd, Say, WrongCall, each_file, read::ReadArgs};
use crate::corpus::in_out;
use crate::generate::related::{ViewedFile, related};
use crate::generate::request::Span;
use crate::view::{Figure, Page};
use anyhow::Result;
use kinelm_motion::joints::{self, Selection};
use kinelm_motion::moment::{Moment, Timebase};
use kinelm_motion::{Motion, format, format::RestFrame};
use kinelm_store::counted;
use kinelm_store::output::Outputs;
use music::{beside, hits, own_music};
use std::path::{Path, PathBuf};

#[derive(Debug, Clone, clap::Args)]
pub struct Args {
    /// Motion files or folders of them, side by side. Reading options of one file follow its name, FILE:fps=60,skip=10
    /// (also up, unit, map, root, rest, position). A generated dance and its prompt are read as the sidecar says
    #[arg(required = true, value_name = "CLIP")]
    clips: Vec<PathBuf>,
    /// Where the page goes (.html), or the folder (it exists, or ends in /) for a page per clip
    #[arg(long, value_name = "FILE|DIR")]
    out: PathBuf,
    /// Joints to highlight, as they were given to generate, throughout or for a time (left_arm@4s:8s); once for all
    /// clips, or once per clip in their order
    #[arg(long, value_name = "JOINTS[@FROM:TO]")]
    forced: Vec<String>,
    /// Keep all clips in one world, as a dance and its prompt are anyway; Overlay in the page separates them
    #[arg(long)]
    together: bool,
    /// Music that plays in sync with the dances (.mp3 .ogg .flac .wav .m4a .aac), with ticks at its beats; embedded up to
    /// 8 MiB, else beside the page [default: the music a dance was generated to]
    #[arg(long, value_name = "FILE")]
    music: Option<PathBuf>,
    /// The time in the music at which the dance starts: 12.5s, 12.5 or 40f (frames of the first clip); negative if the
    /// music starts later
    #[arg(long, value_name = "SECONDS", default_value = "0s", value_parser = super::values::any_time)]
    #[arg(allow_hyphen_values = true)]
    music_from: Moment,
    /// A beat counts as hit where knees and ankles come to rest this fraction of a beat after it, to 50 ms, as evaluate
    /// dance measures it on real dances [default: where all joints move slowest, on the beat]
    #[arg(long, value_name = "PART", value_parser = part_of_a_beat, allow_hyphen_values = true)]
    lag: Option<f64>,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    read: ReadArgs,
}

fn part_of_a_beat(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|part| (-0.5..=0.5).contains(part));
    number.ok_or("expected a part of a beat, -0.5 to 0.5".into())
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let given = args.clips.iter().map(|clip| named(clip)).collect::<Result<Vec<_>>>()?;
    let paths: Vec<PathBuf> = given.iter().map(|place| place.path.clone()).collect();
    let outputs = |clips: &[PathBuf]| {
        args.force.outputs(clips.iter().cloned().chain(args.read.files()).chain(args.music.clone()))
    };
    if !args.out.is_dir() && !in_out::ends_as_folder(&args.out) {
        let mut clips = Vec::new();
        for place in &given {
            let found = in_out::files(std::slice::from_ref(&place.path))?;
            clips.extend(found.into_iter().map(|(clip, _)| place.of(clip)));
        }
        let outputs = outputs(&clips.iter().map(|clip| clip.path.clone()).collect::<Vec<_>>());
        outputs.check([&*args.out])?;
        return one(&args, &clips, &args.out, &outputs, say);
    }
    let pairs = in_out::into_folder(&paths, &args.out, |_| "html".into())?;
    let clips: Vec<PathBuf> = pairs.iter().map(|p| p.input.clone()).collect();
    let outputs = outputs(&clips);
    outputs.check(pairs.iter().map(|p| &*p.output))?;
    each_file(&clips, say, |i, clip| {
        // options after a folder's name are those of all clips in it
        let place = given.iter().find(|place| clip.starts_with(&place.path)).unwrap_or(&given[0]);
        one(&args, &[place.of(clip.into())], &pairs[i].output, &outputs, say)
    })?;
    Ok(())
}

/// How each file is read: as [`ReadArgs::of_files`] has it, as the sidecar of a dance says of its prompt, and by the options
/// that follow its name. With `together` all files are in one world.
///
/// # Errors
/// A wrong option of a file.
fn viewed(clips: &[Named], read: &ReadArgs, together: bool, say: Say) -> Result<Vec<ViewedFile>> {
    let paths: Vec<&Path> = clips.iter().map(|clip| &*clip.path).collect();
    let mut all = related(&paths, read.of_files(&paths, RestFrame::Keep, say));
    for (file, named) in all.iter_mut().zip(clips) {
        // after the sidecar's options: those of the name win
        named.set(&mut file.options)?;
        if together {
            (file.world, file.floor_m) = (Some(0), 0.0);
        }
    }
    Ok(all)
}

/// One page.
fn one(args: &Args, clips: &[Named], out: &Path, outputs: &Outputs, say: Say) -> Result<()> {
    if args.forced.len() > 1 && args.forced.len() != clips.len() {
        let (n, clips) = (args.forced.len(), clips.len());
        return Err(WrongCall(format!(
            "{n} lists of forced joints for {clips} clips; give one for all, or one a clip"
        ))
        .into());
    }
    super::page(out)?;
    let files = viewed(clips, &args.read, args.together, say)?;
    files.iter().flat_map(|file| &file.notes).for_each(|note| say.line(note));
    let paths: Vec<&Path> = files.iter().map(|file| &*file.path).collect();
    let read = each_file(&paths, say, |i, path| {
        let (motion, floor_m) = (format::read(path, &files[i].options)?, files[i].floor_m);
        let raised = (floor_m != 0.0).then(|| motion.clip.clone().raised(-floor_m));
        Ok(match raised {
            Some(clip) => motion.with_clip(clip),
            None => motion,
        })
    })?;
    let (numbers, motions): (Vec<usize>, Vec<Motion>) = read.into_iter().unzip();
    let files: Vec<ViewedFile> = numbers.iter().map(|i| files[*i].clone()).collect();
    say_times(&motions, say);
    let (mut figures, odd) = (Vec::new(), Odd::new(say));
    for (i, motion) in motions.iter().enumerate() {
        odd.warn(motion, &files[i].options);
        let list = args.forced.get(numbers[i]).or(args.forced.first().filter(|_| args.forced.len() == 1));
        let figure = figure(motion).in_world(files[i].world).regenerated(&files[i].generated_s);
        figures.push(match list.filter(|list| !list.is_empty()) {
            Some(list) => forced(figure, motion, list)?,
            None => figure,
        });
    }
    let fps = motions.first().map_or(1.0, |motion| motion.clip.fps());
    let music = args.music.clone().map(|file| (file, args.music_from.seconds(fps))).or_else(|| own_music(clips, say));
    let seconds = motions.iter().map(|motion| motion.clip.frames() as f64 / motion.clip.fps()).fold(0.0, f64::max);
    let played = music.map(|(file, from_s)| beside(&file, from_s, seconds, out, outputs, say)).transpose()?;
    match &played {
        Some(music) => {
            let all = figures.into_iter().zip(&motions);
            let lit = all.map(|(figure, motion)| figure.hits(hits(motion, music, args.lag, say)));
            figures = lit.collect();
        }
        None if args.lag.is_some() => return Err(WrongCall("--lag without music; give --music too".into()).into()),
        None => {}
    }
    let page = Page::new(&figures).music(played.as_ref()).html()?;
    outputs.write(out, page.as_bytes())?;
    say.line(format_args!(
        "{}: {}, {} KB; open it in a browser",
        out.display(),
        counted(figures.len(), "dancers"),
        page.len() / 1000
    ));
    Ok(())
}

/// A figure with the joints of `JOINTS[@FROM:TO]` marked.
fn forced<'a>(figure: Figure<'a>, motion: &Motion, list: &str) -> Result<Figure<'a>> {
    let fps = motion.clip.fps();
    let wrong = |e: String| WrongCall(format!("--forced {e}"));
    let span: Span = list.parse().map_err(wrong)?;
    let names = joints::to_smpl_names(&span.joints, motion.clip.skeleton(), motion.map());
    let selection = names.and_then(|list| joints::parse(&list)).map_err(|e| wrong(format!("{list}: {e}")))?;
    let figure = figure.given(&on_rig(motion, &selection)?);
    if span.from.is_none() && span.to.is_none() {
        return Ok(figure);
    }
    let scale = Timebase { frames: motion.clip.frames(), fps, left_out: 0, model_fps: None };
    let frames = span.frames(scale).map_err(wrong)?;
    Ok(figure.given_over(frames.start as f64 / fps..frames.end as f64 / fps))
}

/// A motion under its file's name, without a path.
fn figure(motion: &Motion) -> Figure<'_> {
    let clip = &motion.clip;
    Figure::new(stem(&motion.path), clip).note(format!("{} frames at {}", clip.frames(), times(motion)))
}

/// The rate and the length of a motion.
fn times(motion: &Motion) -> String {
    let clip = &motion.clip;
    format!("{} fps, {:.2} s", (clip.fps() * 1000.0).round() / 1000.0, clip.duration_s())
}

/// Reports that clips of different lengths or rates play each in its own time.
fn say_times(motions: &[Motion], say: Say) {
    let Some((first, others)) = motions.split_first() else { return };
    // the last frame at a slower rate may be earlier than at a faster one
    let differ = |a: &Motion, b: &Motion| {
        let frame = 1.0 / a.clip.fps().min(b.clip.fps());
        a.clip.fps() != b.clip.fps() || (a.clip.duration_s() - b.clip.duration_s()).abs() > frame
    };
    if others.iter().any(|other| differ(first, other)) {
        let all: Vec<String> =
            motions.iter().map(|motion| format!("{} {}", stem(&motion.path), times(motion))).collect();
        say.line(format_args!("each plays in its own time: {}", all.join("; ")));
    }
}

/// A file's name without its extension.
pub fn stem(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The rig's joints that stand for SMPL joints.
pub fn on_rig(motion: &Motion, selection: &Selection) -> Result<Vec<usize>> {
    let (rig, map) = (motion.clip.skeleton(), motion.humanoid()?.map());
    Ok(selection.joints.iter().filter_map(|&j| rig.find(map.joint(j)?)).collect())
}
