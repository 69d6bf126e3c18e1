//! Positions of all joints and end sites by the file's own channels.

use super::interpret;
use crate::format::ReadOptions;
use crate::format::positions::Positions;
use crate::format::rest::{drops_rest_frame, has_rest_frame};
use crate::format::source::bvh::NodeKind;
use crate::{Quat, Result, Source, Vec3};
use std::collections::HashMap;
use std::path::Path;

/// Positions of all joints and end sites of the root that is read, in file order, with no joint folded or averaged; metres,
/// y up.
///
/// Applies `options.skip`, `options.fps_source` and `options.rest`.
///
/// # Errors
/// Those of [`super::read`].
pub fn positions(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Positions> {
    let mut motion = super::read(path, bytes, options)?;
    if drops_rest_frame(options) && has_rest_frame(&motion) {
        let frames = motion.clip.frames();
        motion = motion.slice(1..frames);
    }
    let fps = motion.clip.fps();
    let Source::Bvh(source) = motion.source else { return Ok(Positions::from_clip(&motion.clip)) };
    let frames = source.as_frames();
    let nodes = &source.head.nodes;
    let range = interpret::choose_root(path, &source.head, options)?.range;
    let mut all = Vec::with_capacity(source.frames * range.len());
    let mut turns = vec![Quat::IDENTITY; range.len()];
    let mut world = vec![Vec3::ZERO; range.len()];
    for f in 0..source.frames {
        let row = frames.row(f);
        for (i, node) in range.clone().enumerate() {
            let (p, q) = (frames.place(node, row), frames.turn(node, row));
            // parents precede children in the file, so theirs are done
            (world[i], turns[i]) = match nodes[node].parent {
                None => (p, q),
                Some(parent) => {
                    let up = parent - range.start;
                    (world[up] + turns[up] * p, turns[up] * q)
                }
            };
        }
        all.extend(world.iter().map(|p| source.rig.axes.position_to_y_up(*p * source.rig.unit_m)));
    }
    let parents = nodes[range.clone()].iter().map(|n| n.parent.map_or(-1, |p| (p - range.start) as i32)).collect();
    let mut seen: HashMap<String, usize> = HashMap::new();
    let names = range.map(|n| match nodes[n].kind {
        NodeKind::End => {
            let name = format!("{}_end", nodes[n].parent.map_or("", |p| &nodes[p].unique));
            let times = seen.entry(name.clone()).or_insert(0);
            *times += 1;
            if *times > 1 { format!("{name}{times}") } else { name }
        }
        _ => nodes[n].unique.clone(),
    });
    Ok(Positions { joints: names.collect(), parents, fps, positions: all })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{BvhPosition, RestFrame, Unit};

    const XYZ: &str = "Xposition Yposition Zposition";

    fn file(rows: &[&str]) -> String {
        format!(
            "HIERARCHY\nROOT a {{ OFFSET 0 0 0 CHANNELS 4 {XYZ} Zrotation JOINT b\n{{ OFFSET 0 10 0 CHANNELS 4 {XYZ} Xrotation\n\
             End Site {{ OFFSET 0 1 0 }} End {{ OFFSET 0 0 2 }} }} }}\nMOTION\nFrames: {}\nFrame Time: 0.05\n{}\n",
            rows.len(),
            rows.join("\n")
        )
    }

    fn read(text: &str, options: &ReadOptions) -> Positions {
        positions(Path::new("x.bvh"), text.as_bytes(), options).unwrap()
    }

    fn centimetres() -> ReadOptions {
        ReadOptions { unit: Unit::CENTIMETRE, ..Default::default() }
    }

    #[test]
    fn nothing_is_folded_or_averaged() {
        let text = file(&["100 0 0 90 0 10 0 90", "200 0 0 0 0 30 0 0"]);
        let p = read(&text, &centimetres());
        assert_eq!(p.joints, ["a", "b", "b_end", "b_end2"]);
        assert_eq!((p.parents.as_slice(), p.fps), (&[-1, 0, 1, 1][..], 20.0));
        let want = [
            Vec3::new(1.0, 0.0, 0.0),
            Vec3::new(0.9, 0.0, 0.0),
            Vec3::new(0.9, 0.0, 0.01),
            Vec3::new(0.92, 0.0, 0.0),
            Vec3::new(2.0, 0.0, 0.0),
            Vec3::new(2.0, 0.3, 0.0),
            Vec3::new(2.0, 0.31, 0.0),
            Vec3::new(2.0, 0.3, 0.02),
        ];
        assert_eq!(p.positions.len(), want.len());
        for (got, want) in p.positions.iter().zip(want) {
            assert!(got.distance(want) < 1e-12, "{got} {want}");
        }
        let add = read(&text, &ReadOptions { bvh_position: BvhPosition::Add, ..centimetres() });
        assert!(add.positions[5].distance(Vec3::new(2.0, 0.4, 0.0)) < 1e-12);
    }

    #[test]
    fn frames_are_left_out_as_when_reading() {
        let rows = ["0 0 0 0 0 10 0 0", "0 0 0 40 0 10 0 0", "0 0 0 41 0 10 0 0", "0 0 0 42 0 10 0 0"];
        let count = |options: ReadOptions| read(&file(&rows), &options).positions.len() / 4;
        assert_eq!(count(centimetres()), 4);
        assert_eq!(count(ReadOptions { rest: RestFrame::Drop, ..centimetres() }), 3);
        assert_eq!(count(ReadOptions { rest: RestFrame::Drop, skip: 2, ..centimetres() }), 2);
        assert!(positions(Path::new("x"), file(&rows).as_bytes(), &ReadOptions { skip: 4, ..centimetres() }).is_err());
    }
}
