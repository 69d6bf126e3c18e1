//! Composition of one file from rows of several files with the same hierarchy, keeping the text of their numbers.

use super::print::print_head;
use super::splice::words;
use crate::format::source::bvh::{BvhSource, Node};
use std::ops::Range;

/// A file to take rows from: its source, with no frame dropped on reading, and its bytes.
pub type Piece<'a> = (&'a BvhSource, &'a [u8]);

impl BvhSource {
    /// Whether the file of `other` has the same hierarchy, so that its numbers mean the same: names, offsets, channels, unit
    /// and axes. Layout and line ends may differ.
    pub fn is_alike(&self, other: &BvhSource) -> bool {
        let (own, others) = (&self.head, &other.head);
        own.width == others.width
            && own.nodes.len() == others.nodes.len()
            // all but `at`, which depends on the layout
            && own.nodes.iter().zip(&others.nodes).all(|(a, b)| *a == Node { at: a.at, ..b.clone() })
            && self.rig.joints == other.rig.joints
            && self.rig.chain == other.rig.chain
            && self.rig.unit_m == other.rig.unit_m
            && self.rig.position == other.rig.position
            && self.rig.axes == other.rig.axes
    }

    /// The bytes of a file with this header and `frames` rows. `from(frame, joint)` gives the piece and its row from which the
    /// channels of a joint of the clip are copied; what is above and beside it comes with joint 0. `None` gives zeros, as do
    /// nodes of other roots.
    ///
    /// # Panics
    /// If a piece has another number of channels, or too few rows.
    pub fn composed(
        &self,
        pieces: &[Piece],
        frames: usize,
        from: impl Fn(usize, usize) -> Option<(usize, usize)>,
    ) -> Vec<u8> {
        let width = self.head.width;
        let words: Vec<Vec<Range<usize>>> =
            pieces.iter().map(|(source, text)| words(text, source.head.rows_at, source.numbers.len())).collect();
        let joint_of = self.joint_of_columns();
        let mut out = print_head(&self.head, &self.head.frame_time, frames, frames * width);
        for frame in 0..frames {
            for (column, joint) in joint_of.iter().enumerate() {
                if column > 0 {
                    out.push(b' ');
                }
                match joint.and_then(|joint| from(frame, joint)) {
                    Some((piece, row)) => {
                        out.extend_from_slice(&pieces[piece].1[words[piece][row * width + column].clone()])
                    }
                    None => out.push(b'0'),
                }
            }
            out.extend_from_slice(self.head.style.line_end.as_bytes());
        }
        out
    }

    /// The joint of the clip that each channel belongs to (C).
    fn joint_of_columns(&self) -> Vec<Option<usize>> {
        let mut joint_of = vec![None; self.head.width];
        let own = self.rig.joints.iter().enumerate().map(|(joint, &node)| (node, joint));
        for (node, joint) in own.chain(self.rig.chain.iter().copied().chain(self.beside()).map(|node| (node, 0))) {
            let node = &self.head.nodes[node];
            joint_of[node.column..node.column + node.channels.len()].fill(Some(joint));
        }
        joint_of
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Source;
    use crate::format::{ReadOptions, Unit, bvh};
    use std::path::Path;

    const HEAD: &str = "HIERARCHY\nROOT a\n{\n  OFFSET 0 1 0\n  CHANNELS 6 Xposition Yposition Zposition Zrotation \
                        Xrotation Yrotation\n  JOINT b\n  {\n    OFFSET 0 2 0\n    CHANNELS 3 Zrotation Xrotation Yrotation\n    \
                        End Site\n    {\n      OFFSET 0 1 0\n    }\n  }\n}\nMOTION\n";

    fn read(text: &str) -> BvhSource {
        let options = ReadOptions { unit: Unit::METRE, ..Default::default() };
        match bvh::read(Path::new("x.bvh"), text.as_bytes(), &options).unwrap().source {
            Source::Bvh(source) => *source,
            _ => panic!("a BVH"),
        }
    }

    #[test]
    fn joints_stand_in_the_words_of_the_files_that_they_come_from() {
        let one = format!("{HEAD}Frames: 2\nFrame Time: 0.05\n1 2.50 3 4 5 6 7 8 9.0\n11 12 13 14 15 16 17 18 19\n");
        let two = format!("{HEAD}Frames: 1\nFrame Time: 0.050\n-1 -2 -3 -4 -5 -6  -7 -8e0 -9\n");
        let (a, b) = (read(&one), read(&two));
        assert!(a.is_alike(&b));
        let pieces = [(&a, one.as_bytes()), (&b, two.as_bytes())];
        let from = |frame: usize, joint: usize| match (frame, joint) {
            (0, _) => Some((0, 0)),
            (1, 0) => Some((0, 1)),
            (1, _) => Some((1, 0)),
            _ => None,
        };
        let text = String::from_utf8(a.composed(&pieces, 3, from)).unwrap();
        let (head, rows) = text.split_once("0.05\n").unwrap();
        assert!(head.ends_with("Frames: 3\nFrame Time: "), "{head}");
        assert_eq!(rows, "1 2.50 3 4 5 6 7 8 9.0\n11 12 13 14 15 16 -7 -8e0 -9\n0 0 0 0 0 0 0 0 0\n");
        assert_eq!(read(&text).frames, 3);
        let longer = read(&one.replace("OFFSET 0 2 0", "OFFSET 0 2.5 0"));
        assert!(!a.is_alike(&longer), "another length");
    }
}
