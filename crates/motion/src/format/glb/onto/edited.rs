//! An edit of an animation that the file has: new keys in the frames that are new, the others as they are.

use super::super::file::take::Take;
use super::super::file::track::Track;
use super::keys::{of_place, of_quat};
use super::{Animation, Character};
use crate::format::source::Changed;
use crate::format::source::glb::Played;
use crate::{Clip, Result};
use glam::DAffine3;
use std::collections::BTreeSet;
use std::ops::Range;

/// When the frames of an edit are, in the seconds of the animation that it edits.
struct Times {
    first: f64,
    fps: f64,
    frames: usize,
    /// Of the written animation: how many times as long a second is.
    longer: f64,
    /// The seconds that are written; infinite where all are.
    from: f64,
    to: f64,
}

impl Times {
    fn of(clip: &Clip, changed: &Changed, played: Played) -> Times {
        let frames = clip.frames();
        let first = played.begin_s + changed.before as f64 / played.fps;
        // another rate was stated for the file's frames
        let longer = played.fps / clip.fps();
        let is_cut = changed.before + frames < played.frames;
        Times {
            first,
            fps: played.fps,
            frames,
            longer: if (longer - 1.0).abs() < 1e-9 { 1.0 } else { longer },
            from: if changed.before > 0 { first } else { f64::NEG_INFINITY },
            to: if is_cut { first + (frames - 1) as f64 / played.fps } else { f64::INFINITY },
        }
    }

    fn at(&self, frame: usize) -> f64 {
        self.first + frame as f64 / self.fps
    }

    /// The seconds of the frames around new ones, which are not new.
    fn around(&self, new: &Range<usize>) -> (f64, f64) {
        let before = new.start.checked_sub(1).map_or(f64::NEG_INFINITY, |frame| self.at(frame));
        (before, if new.end < self.frames { self.at(new.end) } else { f64::INFINITY })
    }

    /// Whether keys are written as the file has them.
    fn are_own(&self) -> bool {
        self.longer == 1.0 && self.from.is_infinite() && self.to.is_infinite()
    }

    /// The part of a track that is written, in the time of the written animation.
    fn written(&self, track: Track) -> Track {
        if self.are_own() {
            return track;
        }
        let begin = if self.from.is_finite() { self.from } else { 0.0 };
        track.part(self.from, self.to).retimed(begin, self.longer)
    }
}

impl Character<'_> {
    /// Adds the keys of an edit of `played`, whose channels have these `targets`.
    ///
    /// # Errors
    /// Keys that can't be read.
    pub fn edit(
        &self,
        clip: &Clip,
        (changed, played): (&Changed, Played),
        targets: &[&str],
        animation: &mut Animation,
    ) -> Result<()> {
        let own = &self.document.json.animations[played.animation];
        let times = Times::of(clip, changed, played);
        // what is above the root may move in the animation
        let above: BTreeSet<usize> = self.tree.upwards(self.source.nodes[0]).skip(1).collect();
        let take = Take::new(self.document, played.animation, &above)?;
        let joints = clip.joints();
        // what is new, and isn't added yet: a joint's node and property with its frames
        let new = |is_new: &dyn Fn(usize) -> bool| runs(times.frames, is_new);
        let mut edits: Vec<(usize, &str, Vec<Range<usize>>)> = (0..joints)
            .map(|joint| (joint, "rotation", new(&|f| changed.joints[f * joints + joint])))
            .chain([(0, "translation", new(&|f| changed.root[f]))])
            .filter(|(_, _, runs)| !runs.is_empty())
            .collect();
        for (channel, target) in own.channels.iter().zip(targets) {
            let what = &channel.target;
            animation.moved.extend(what.node.map(|node| (node, what.path.clone())));
            let at = edits
                .iter()
                .position(|(joint, path, _)| what.node == Some(self.source.nodes[*joint]) && what.path == *path);
            match at.map(|n| edits.swap_remove(n)) {
                Some((joint, path, runs)) => {
                    let track = Take::track(self.document, own, channel)?;
                    let track = self.with_new(track, (joint, path), clip, (&runs, &times), &take);
                    animation.add_keys((target, path), &times.written(track));
                }
                None if times.are_own() => {
                    let sampler = Take::sampler(self.document, own, channel)?;
                    let between = sampler.interpolation.as_deref().unwrap_or("LINEAR");
                    animation.share(target, sampler.input, sampler.output, between);
                }
                None => {
                    let track = Take::track(self.document, own, channel)?;
                    animation.add_keys((target, &what.path), &times.written(track));
                }
            }
        }
        for (joint, path, runs) in edits {
            let (turn, place) = self.local.own[joint];
            let own = if path == "rotation" { of_quat(turn) } else { of_place(place) };
            let track = self.with_new(Track::still(own), (joint, path), clip, (&runs, &times), &take);
            animation.add(self.source.nodes[joint], path, &times.written(track));
        }
        Ok(())
    }

    /// A track with the keys of new frames.
    fn with_new(
        &self,
        mut track: Track,
        (joint, path): (usize, &str),
        clip: &Clip,
        (new, times): (&[Range<usize>], &Times),
        take: &Take,
    ) -> Track {
        let root = self.source.nodes[0];
        let above = |second: f64| match self.tree.parents[root] {
            Some(above) if joint == 0 => self.tree.world(Some((take, second)))[above],
            _ => DAffine3::IDENTITY,
        };
        for frames in new {
            let key = |frame: usize| {
                let second = times.at(frame);
                let numbers = match path {
                    "rotation" => of_quat(self.local.turn(joint, clip.pose(frame)[joint], &above(second))),
                    _ => of_place(self.local.place(clip.root()[frame], &above(second))),
                };
                (second, numbers)
            };
            let keys: Vec<_> = frames.clone().map(key).collect();
            track = track.with(times.around(frames), &keys);
        }
        track
    }
}

/// Runs of frames that are new.
fn runs(frames: usize, is_new: &dyn Fn(usize) -> bool) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for frame in (0..frames).filter(|&frame| is_new(frame)) {
        match runs.last_mut().filter(|run| run.end == frame) {
            Some(run) => run.end += 1,
            None => runs.push(frame..frame + 1),
        }
    }
    runs
}
