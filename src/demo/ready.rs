//! The demo without a training: kinelm's own model dances.

use super::{Args, MARK, make_room};
use crate::generate::open::OpenRequest;
use crate::generate::request::{Edit, Length, Loop, LoopKind, PromptRequest, Request, Span};
use crate::shell::Say;
use crate::view::{Figure, write_page};
use anyhow::{Error, Result};
use kinelm_motion::format::{self, ReadOptions, Up};
use kinelm_motion::{joints, smpl};
use kinelm_store::files::write_whole;
use rayon::prelude::*;
use std::path::Path;
use std::time::Instant;

/// Seconds that it dances by itself.
const SECONDS: f64 = 20.0;
/// The joints that another dance follows.
const FOLLOWED: &str = "root,torso,right_arm";
/// The part of the first dance that is generated anew.
const GAP: &str = "all@8s:10s";
/// Seconds before a loop's end that lead to the pose of its beginning.
const BACK_S: f64 = 2.0;

pub fn run(args: &Args, started: Instant, say: Say) -> Result<()> {
    let run = kinelm_ready::run()?;
    make_room(args)?;
    let at = |name: &str| args.out.join(name);
    let of = |prompt| Request { prompt, seed: Some(args.seed), computing: Some(args.computing()), ..Request::of(&run) };
    let prompt = |edit: Option<Edit>| PromptRequest {
        read: ReadOptions { up: Up::Y, ..ReadOptions::default() },
        joints: edit.is_none().then(|| FOLLOWED.into()),
        edit,
        ..PromptRequest::of(at("free.bvh"))
    };
    let gap = GAP.parse::<Span>().map_err(Error::msg)?;
    let back = Loop { kind: LoopKind::Pose, over_s: Some(BACK_S) };
    say.line(format_args!("1/3 it dances by itself for {SECONDS} s"));
    let free = Request { length: Some(Length::Seconds(SECONDS)), ..of(None) };
    dance(&free, &at("free.bvh"))?;
    say.line(
        "2/3 it follows root, torso and right arm of that dance, dances two seconds of it anew, and makes a loop of it",
    );
    let three = [
        ("follows.bvh", None),
        ("gap.bvh", Some(Edit::of(vec![gap]))),
        ("loop.bvh", Some(Edit { looping: Some(back), ..Edit::of(Vec::new()) })),
    ];
    // each reads the first dance alone, and one stream of tokens doesn't fill the cores
    three.into_par_iter().try_for_each(|(name, edit)| dance(&of(Some(prompt(edit))), &at(name)))?;
    say.line("3/3 page");
    page(args)?;
    let seconds = started.elapsed().as_secs_f64();
    let report = format!(
        "{MARK}, seed {}\n\nkinelm's own model danced `free.bvh`; `follows.bvh` has its root, torso and right arm, `gap.bvh` other \
         seconds from 8 to 10, and `loop.bvh` ends in the pose that it began with. `page.html` shows all. {seconds:.0} s in all.\n",
        args.seed
    );
    write_whole(&at("report.md"), report.as_bytes())?;
    crate::shell::print(&report)?;
    say.line(format_args!(
        "done: open {} in a browser; `kinelm demo --train` trains a model",
        at("page.html").display()
    ));
    Ok(())
}

fn dance(request: &Request, out: &Path) -> Result<()> {
    Ok(OpenRequest::open(request)?.write(out)?)
}

/// The four dances side by side.
fn page(args: &Args) -> Result<()> {
    let clip = |name: &str| {
        let read = ReadOptions { up: Up::Y, ..ReadOptions::default() };
        format::read(&args.out.join(name), &read).map(|motion| motion.clip)
    };
    let [free, follows, gap, back] = ["free.bvh", "follows.bvh", "gap.bvh", "loop.bvh"].map(clip);
    let (free, follows, gap, back) = (free?, follows?, gap?, back?);
    // joints of a file have another order than SMPL's
    let named = |id: &usize| free.skeleton().find(smpl::NAMES[*id]);
    let followed: Vec<usize> = joints::parse(FOLLOWED)?.joints.iter().filter_map(named).collect();
    let figures = [
        Figure::new("free", &free).note("by itself; orange is what the next one follows").given(&followed),
        Figure::new("follows", &follows).note("root, torso and right arm (orange); the rest is new").given(&followed),
        Figure::new("gap", &gap).note("seconds 8 to 10 are new"),
        Figure::new("loop", &back).note("ends in the pose that it began with"),
    ];
    write_page(&args.out.join("page.html"), &figures)?;
    Ok(())
}
