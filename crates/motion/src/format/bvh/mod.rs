//! BVH: a hierarchy of joints and rows of numbers, as docs/motion-files.md defines them.
//!
//! [`parse_header`] parses everything before the rows, [`Header::rows`] the numbers, [`read`] makes a [`Motion`] of both.
//! The [`BvhSource`] stores what a clip doesn't, so that a file can be written back as it was.

mod added;
mod channels;
mod compose;
mod default_rig;
mod frame_time;
mod grammar;
mod header;
mod interpret;
mod numbers;
mod positions;
mod print;
mod rows;
mod splice;
mod text;
mod unit;
mod write;

pub use super::source::bvh::{BvhRig, BvhSource, Channel, Header, Node, NodeKind};
pub use compose::Piece;
pub use frame_time::USUAL_FPS;
pub use positions::positions;
pub use write::{to_bytes, to_bytes_in};

use crate::format::{Axes, BvhPosition, ReadOptions};
use crate::{Clip, Motion, Result, Source, Warning};
use interpret::Frames;
use std::path::Path;
use text::Text;

/// Position channels of one joint below the clip's root, for `inspect`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PositionChannels {
    /// The joint of the clip.
    pub joint: usize,
    /// Mean over the frames of | |channels| - |OFFSET| |, metres.
    pub off_m: f64,
    /// Largest distance from the mean, metres: the stretch that the clip drops.
    pub stretch_m: f64,
    /// The channels are under 10 % of an OFFSET that is not short itself (1 % of the chain from root to tip): they may be
    /// meant to be added to it.
    pub looks_added: bool,
}

/// Parses everything before the rows.
///
/// # Errors
/// [`crate::Error::File`] with its position, as listed in docs/motion-files.md.
pub fn parse_header(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Header> {
    Ok(grammar::parse(&Text::new(path, bytes), options.lenient)?)
}

impl Header {
    /// Parses the rows (F, C) of this header's file; with warnings.
    ///
    /// # Errors
    /// [`crate::Error::File`] with its position: a bad number, a row of another width, fewer rows than declared.
    pub fn rows(&self, path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<(Vec<f64>, Vec<Warning>)> {
        let rows = rows::parse(&Text::new(path, bytes), self, options.lenient)?;
        Ok((rows.numbers, rows.warnings))
    }
}

/// The header and rows of a file, after `skip`.
struct Parsed {
    head: Header,
    numbers: Vec<f64>,
    frames: usize,
    warnings: Vec<Warning>,
}

fn parse(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Parsed> {
    let text = Text::new(path, bytes);
    let mut head = grammar::parse(&text, options.lenient)?;
    let rows::Rows { mut numbers, mut frames, warnings: more } = rows::parse(&text, &head, options.lenient)?;
    let mut warnings = std::mem::take(&mut head.warnings);
    warnings.extend(more);
    if options.skip > 0 {
        crate::format::options::check_skip(path, options.skip, frames)?;
        numbers.drain(..options.skip * head.width);
        frames -= options.skip;
    }
    Ok(Parsed { head, numbers, frames, warnings })
}

impl Parsed {
    fn frames(&self, position: BvhPosition) -> Frames<'_> {
        let (nodes, width) = (&self.head.nodes, self.head.width);
        Frames { nodes, width, frames: self.frames, numbers: &self.numbers, position }
    }

    fn fps(&self, options: &ReadOptions) -> f64 {
        options.fps_source.unwrap_or_else(|| self.head.fps())
    }
}

/// Reads a motion from the bytes of a file; `path` is used in messages.
///
/// Applies `options.skip` and `options.fps_source`, but not `options.rest`, which [`crate::format::read`] applies to all
/// formats.
///
/// # Errors
/// [`crate::Error::File`] with its position, as listed in docs/motion-files.md, including `unit_unknown` if the legs fit no
/// unit; [`crate::Error::Clip`] for numbers beyond a finite clip, or when no frame is left after `skip`.
pub fn read(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
    motion(path, parse(path, bytes, options)?, options)
}

fn motion(path: &Path, parsed: Parsed, options: &ReadOptions) -> Result<Motion> {
    let fps = parsed.fps(options);
    let decided = interpret::decide(path, &parsed.head, &parsed.frames(options.bvh_position), fps, options)?;
    let interpret::Decided { mut rig, clip, found, warnings: more } = decided;
    let Parsed { head, numbers, frames, mut warnings } = parsed;
    warnings.extend(more);
    let (axes, doubt) = Axes::of(&clip, options.up, found.as_ref());
    warnings.extend(doubt);
    let clip = axes.to_y_up(clip)?;
    (rig.axes, rig.skeleton) = (axes.mirrored(options.mirror_axis), clip.skeleton().clone());
    let source = BvhSource { head, numbers, frames, read_fps: fps, rig, floor_m: None };
    // after the axes: the doubt needs heights, which exist only with y up
    warnings.extend(added::doubt(&source, &clip));
    Ok(Motion::read(path, clip, Source::Bvh(Box::new(source)), warnings, found))
}

impl BvhSource {
    fn as_frames(&self) -> Frames<'_> {
        let (nodes, width) = (&self.head.nodes, self.head.width);
        Frames { nodes, width, frames: self.frames, numbers: &self.numbers, position: self.rig.position }
    }

    /// The clip of the numbers at a rate, y up.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) for numbers beyond a finite clip, or a rate that is not positive.
    pub fn clip(&self, fps: f64) -> Result<Clip> {
        let skeleton = self.rig.axes.skeleton_from_y_up(&self.rig.skeleton)?;
        self.rig.axes.to_y_up(interpret::clip(&self.rig, skeleton, &self.as_frames(), fps)?)
    }

    /// Frames per second by the frame time in the file, whatever rate the clip was read at.
    pub fn fps(&self) -> f64 {
        self.head.fps()
    }

    /// Whether a clip still equals the numbers: joints, positions and rotations, at any rate.
    pub fn is_untouched(&self, clip: &Clip) -> bool {
        clip.frames() == self.frames
            && **clip.skeleton() == *self.rig.skeleton
            && self.clip(clip.fps()).is_ok_and(|own| own.root() == clip.root() && own.rotations() == clip.rotations())
    }

    /// The longest chain of OFFSETs from the clip's root to a tip, metres: about half a body's height in any rest pose.
    fn reach_m(&self) -> f64 {
        let nodes = &self.head.nodes;
        let mut ways = vec![0.0; nodes.len()];
        let mut longest: f64 = 0.0;
        for n in self.body().skip(1) {
            let Some(parent) = nodes[n].parent else { break };
            ways[n] = ways[parent] + crate::Vec3::from_array(nodes[n].offset).length();
            longest = longest.max(ways[n]);
        }
        longest * self.rig.unit_m
    }

    /// The joints below the clip's root with position channels, and what these do.
    pub(crate) fn position_channels(&self) -> Vec<PositionChannels> {
        let frames = self.as_frames();
        let (metres, f) = (self.rig.unit_m, self.frames.max(1) as f64);
        let reach = self.reach_m();
        let of = |(joint, &node): (usize, &usize)| {
            let n = &frames.nodes[node];
            let has = n.channels.iter().any(|c| matches!(c, Channel::Position(_)));
            if joint == 0 || !has {
                return None;
            }
            let channels = |row: &[f64]| {
                let squares = n.channels.iter().zip(&row[n.column..]).map(|(c, v)| match c {
                    Channel::Position(_) => v * v,
                    Channel::Rotation(_) => 0.0,
                });
                squares.sum::<f64>().sqrt()
            };
            let offset = crate::Vec3::from_array(n.offset).length();
            let lengths = || (0..self.frames).map(|i| channels(frames.row(i)));
            let mean = lengths().sum::<f64>() / f;
            Some(PositionChannels {
                joint,
                off_m: lengths().map(|l| (l - offset).abs()).sum::<f64>() / f * metres,
                stretch_m: self.rig.stretch.iter().find(|(j, _)| *j == joint).map_or(0.0, |s| s.1),
                looks_added: offset * metres > 0.01 * reach && mean < 0.1 * offset,
            })
        };
        self.rig.joints.iter().enumerate().filter_map(of).collect()
    }
}
