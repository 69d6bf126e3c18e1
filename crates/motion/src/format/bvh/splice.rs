//! Writing changed motion into a BVH; the text of the rest stays byte for byte.

use super::frame_time;
use super::print::{not_finite, print_head, push_number};
use crate::format::source::Changed;
use crate::format::source::bvh::{BvhSource, Channel};
use crate::rotation::Axis;
use crate::{Clip, Error, Result};
use std::ops::Range;

impl BvhSource {
    /// The bytes of `clip`, y up, on this rig. `text` is the file that this was read from, with no frame dropped on reading.
    /// Numbers that haven't `changed` keep their text, as does the frame time unless the rate differs. Angles continue from
    /// the previous frame without jumps.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when joints or the number of flags differ, a number isn't finite, or a BVH
    /// can't have the rate.
    pub fn spliced(&self, text: &[u8], clip: &Clip, changed: &Changed) -> Result<Vec<u8>> {
        let (frames, joints) = (clip.frames(), clip.joints());
        if !self.fits(clip) || changed.root.len() != frames || changed.joints.len() != frames * joints {
            let (own, flags) = (self.rig.skeleton.joints(), changed.joints.len());
            let found = format!("{frames} frames of {joints} joints with {flags} flags");
            return Err(Error::invalid("the clip to splice", found, format!("the rig's {own} joints, a flag each")));
        }
        let clip = self.rig.axes.restored(clip)?;
        let rig = self.for_clip(&clip)?;
        let (width, own) = (rig.head.width, self.head.width);
        let copied = |frame: usize| self.copied(frame, changed, &rig);
        let numbers = rig.rows_with(&clip, self, Some(changed.before), |frame, row| {
            for (number, from) in row.iter_mut().zip(copied(frame)) {
                // before the next row is made, whose angles continue from the numbers in the file
                *number = from.map_or(*number, |column| self.numbers[(changed.before + frame) * own + column]);
            }
        });
        not_finite(&rig.head, &numbers)?;
        let words = words(text, self.head.rows_at, self.numbers.len());
        let time = if self.fps() == clip.fps() { self.head.frame_time.clone() } else { frame_time::text(clip.fps())? };
        let mut out = print_head(&rig.head, &time, frames, numbers.len());
        for (frame, row) in numbers.chunks_exact(width.max(1)).enumerate() {
            let copied = copied(frame);
            let of_file = changed.before + frame;
            match words.get(of_file * own..(of_file + 1) * own) {
                // an unchanged row is copied whole, blanks included
                Some([first, .., last]) if width == own && copied.iter().all(Option::is_some) => {
                    out.extend_from_slice(&text[first.start..last.end]);
                }
                words => print_row(&mut out, row, &copied, words.unwrap_or_default(), text),
            }
            out.extend_from_slice(rig.head.style.line_end.as_bytes());
        }
        Ok(out)
    }

    /// For each column of `rig`, the unchanged column of this file that it copies (C).
    fn copied(&self, frame: usize, changed: &Changed, rig: &BvhSource) -> Vec<Option<usize>> {
        let mut copied = vec![None; rig.head.width];
        if changed.before + frame >= self.frames {
            return copied;
        }
        let joints = self.rig.joints.len();
        let mut new = vec![false; self.head.width];
        self.flag(&mut new, changed.root[frame], &changed.joints[frame * joints..][..joints]);
        for (was, is) in self.head.nodes.iter().zip(&rig.head.nodes) {
            for (i, channel) in was.channels.iter().enumerate().filter(|(i, _)| !new[was.column + i]) {
                if let Some(at) = is.channels.iter().position(|c| c == channel) {
                    copied[is.column + at] = Some(was.column + i);
                }
            }
        }
        copied
    }

    /// Marks the channels that are new in a frame (C): those of changed joints, and of what is above the clip's root the
    /// channels that carry its path.
    fn flag(&self, flags: &mut [bool], root: bool, joints: &[bool]) {
        flags.fill(false);
        for (j, (&node, &is_new)) in self.rig.joints.iter().zip(joints).enumerate() {
            let node = &self.head.nodes[node];
            for (flag, channel) in flags[node.column..].iter_mut().zip(&node.channels) {
                *flag = is_new && (j > 0 || matches!(channel, Channel::Rotation(_)));
            }
        }
        for (axis, &node) in [Axis::X, Axis::Y, Axis::Z].into_iter().zip(&self.rig.path) {
            let node = &self.head.nodes[node];
            if let Some(at) = node.channels.iter().position(|c| *c == Channel::Position(axis)) {
                flags[node.column + at] = root;
            }
        }
    }
}

/// Prints a row, with the file's text for unchanged numbers.
fn print_row(out: &mut Vec<u8>, row: &[f64], copied: &[Option<usize>], words: &[Range<usize>], text: &[u8]) {
    for (i, (&number, column)) in row.iter().zip(copied).enumerate() {
        if i > 0 {
            out.push(b' ');
        }
        match column.and_then(|column| words.get(column)) {
            Some(word) => out.extend_from_slice(&text[word.clone()]),
            None => push_number(out, number),
        }
    }
}

/// Ranges of the first `count` words of a text from a byte offset on.
pub(super) fn words(text: &[u8], from: usize, count: usize) -> Vec<Range<usize>> {
    let (mut words, mut at) = (Vec::with_capacity(count), from);
    while words.len() < count && at < text.len() {
        let start = at + text[at..].iter().take_while(|byte| byte.is_ascii_whitespace()).count();
        let end = start + text[start..].iter().take_while(|byte| !byte.is_ascii_whitespace()).count();
        words.extend((end > start).then_some(start..end));
        at = end;
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{ReadOptions, Unit, bvh};
    use crate::rotation::angle_between;
    use crate::{Source, Vec3};
    use std::path::Path;

    const TEXT: &str = "HIERARCHY\nROOT a\n{\n  OFFSET 0 1 0\n  CHANNELS 6 Xposition Yposition Zposition Zrotation \
                        Xrotation Yrotation\n  JOINT b\n  {\n    OFFSET 0 2 0\n    CHANNELS 3 Zrotation Xrotation Yrotation\n    \
                        End Site\n    {\n      OFFSET 0 1 0\n    }\n  }\n}\nMOTION\nFrames: 4\nFrame Time: 0.0083333\n\
                        0.1 0.2 0.3 370 5 6.25 11 12 13\n1 1 1 371 5 6 11 12 13\n2 1 1 372 5 6 11 12 13\n3 1 1  373 5 6 \
                        -170.123456789 12 13\n";

    #[test]
    fn only_what_changed_has_new_numbers() {
        let options = ReadOptions { unit: Unit::METRE, ..Default::default() };
        let motion = bvh::read(Path::new("x.bvh"), TEXT.as_bytes(), &options).unwrap();
        let Source::Bvh(source) = &motion.source else { panic!("a BVH") };
        let clip = &motion.clip;
        let mut changed = Changed { before: 0, root: vec![false; 4], joints: vec![false; 8] };
        assert_eq!(source.spliced(TEXT.as_bytes(), clip, &changed).unwrap(), TEXT.as_bytes());
        // with another rate only the frame time differs
        let stated = clip.clone().with_fps(60.0).unwrap();
        let stated = source.spliced(TEXT.as_bytes(), &stated, &changed).unwrap();
        assert_eq!(String::from_utf8(stated).unwrap(), TEXT.replace("0.0083333", "0.0166666667"));
        // the root changes in frame 1, the other joint in frame 2, and one frame is added
        let (mut root, mut rotations) = (clip.root().to_vec(), clip.rotations().to_vec());
        root[1] += Vec3::X;
        rotations[2] = Axis::Z.turn(0.2) * rotations[2];
        rotations[5] = Axis::X.turn(0.3) * rotations[5];
        root.push(Vec3::Y);
        rotations.extend_from_slice(clip.pose(0));
        let new = Clip::new(clip.skeleton().clone(), 120.0, root, rotations).unwrap();
        changed.root = vec![false, true, false, false, true];
        changed.joints = [[false, false], [true, false], [false, true], [false, false], [true, true]].concat();
        let bytes = source.spliced(TEXT.as_bytes(), &new, &changed).unwrap();
        let back = bvh::read(Path::new("y.bvh"), &bytes, &options).unwrap();
        let Source::Bvh(written) = &back.source else { panic!("a BVH") };
        assert_eq!((written.frames, written.head.frame_time.as_str()), (5, "0.0083333"));
        let row = |source: &crate::format::bvh::BvhSource, f: usize| source.numbers[f * 9..(f + 1) * 9].to_vec();
        assert_eq!([row(written, 0), row(written, 3)], [row(source, 0), row(source, 3)]);
        assert_eq!(row(written, 1)[6..], row(source, 1)[6..]);
        assert_eq!(row(written, 2)[..6], row(source, 2)[..6]);
        assert_eq!(row(written, 1)[0], 2.0);
        assert!((row(written, 1)[3] - 371.0).abs() < 90.0, "it runs on from 370: {:?}", row(written, 1));
        for (a, b) in new.rotations().iter().zip(back.clip.rotations()) {
            assert!(angle_between(*a, *b) < 1e-6);
        }
        changed.root.pop();
        let text = String::from_utf8(bytes).unwrap();
        assert!(text.contains("\n0.1 0.2 0.3 370 5 6.25 11 12 13\n2.0"), "{text}");
        assert!(
            text.contains(" 11 12 13\n2 1 1 372 5 6 ") && text.contains("\n3 1 1  373 5 6 -170.123456789 12 13\n"),
            "{text}"
        );
        assert!(
            source.spliced(TEXT.as_bytes(), &new, &changed).unwrap_err().to_string().contains("5 frames of 2 joints")
        );

        // starting at the file's third frame
        let short = Changed { before: 2, root: vec![false, true], joints: vec![false, false, true, false] };
        let bytes = source.spliced(TEXT.as_bytes(), &new.slice(2..4), &short).unwrap();
        let cut = String::from_utf8(bytes).unwrap();
        assert!(cut.contains("Frames: 2\n") && cut.contains("\n2 1 1 372 5 6 ") && !cut.contains(" 371 "), "{cut}");
    }
}
