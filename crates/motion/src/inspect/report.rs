//! The report of a motion: as text for readers, as JSON for scripts.

use super::stats::{ClipStats, clip_stats};
use crate::format::bvh::{BvhSource, NodeKind};
use crate::format::{Axes, BvhPosition, Up, UpSource};
use crate::rig::map::REQUIRED;
use crate::rig::{MapFit, SkeletonMap};
use crate::{Motion, Skeleton, Source, Vec3, Warning, smpl};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write;

/// The report that `kinelm inspect` prints of one file.
#[derive(Debug, Clone)]
pub struct Report<'a> {
    motion: &'a Motion,
    /// The floor, metres; `None` on a rig that no map fits.
    floor_m: Option<f64>,
    stats: ClipStats,
    doubts: Vec<Warning>,
    /// The skeleton map, and how well it fits; `None` on a rig that no map fits.
    map: Option<(&'a SkeletonMap, MapFit)>,
}

/// Makes the report of a motion as it was read, with the given or detected floor, metres.
pub fn report(motion: &Motion, floor_m: Option<f64>) -> Report<'_> {
    let stats = clip_stats(&motion.clip);
    // findings have lines of their own in the report; they are no doubts
    let is_doubt = |w: &&Warning| !matches!(w.kind, "up_axis" | "rig_recognised" | "joints_beside");
    let mut doubts: Vec<Warning> = motion.warnings.iter().filter(is_doubt).cloned().collect();
    doubts.extend(doubts_of(&stats, motion.clip.skeleton()));
    let map = motion.known().map(|humanoid| (humanoid.map(), humanoid.fit(&motion.clip)));
    Report { motion, floor_m, stats, doubts, map }
}

impl Report<'_> {
    /// The report as lines of text.
    pub fn text(&self) -> String {
        let mut t = String::new();
        let (f, clip, skeleton) = (&self.stats, &self.motion.clip, self.motion.clip.skeleton());
        let (format, source) = source_lines(&self.motion.source);
        let recognised = self.motion.warnings.iter().find(|w| w.kind == "rig_recognised");
        let rig = match (recognised, self.rig()) {
            (Some(found), _) => format!("recognised: {}", found.what),
            (None, Some(name)) => name.to_owned(),
            (None, None) => "unknown (give `map` to retarget it)".into(),
        };
        let _ = writeln!(t, "{}: {format}", self.motion.path.display());
        let _ = writeln!(t, "  {} frames at {} fps, {:.2} s", clip.frames(), round(clip.fps(), 6), clip.duration_s());
        let _ = writeln!(t, "  {} joints, {} end sites; rig {rig}", skeleton.joints(), skeleton.ends().len());
        if let Some((map, fit)) = &self.map {
            let _ = writeln!(t, "  map {}: {}", map.name, fit_line(fit));
        }
        for line in source {
            let _ = writeln!(t, "  {line}");
        }
        for beside in self.motion.warnings.iter().filter(|w| w.kind == "joints_beside") {
            let _ = writeln!(t, "  {}", beside.what);
        }
        let _ = writeln!(t, "  {}", axes_line(&self.motion.source.axes()));
        let [low, high] = f.root_range;
        let _ = writeln!(t, "  height {:.2} m (median over frames of highest minus lowest point)", f.height_m);
        let axis = |name, l: f64, h: f64| format!("{name} {l:.2}..{h:.2}");
        let ranges = [axis("x", low.x, high.x), axis("y", low.y, high.y), axis("z", low.z, high.z)].join(", ");
        let _ = writeln!(t, "  root {ranges} m; fastest joint {:.1} m/s, fastest fall {:.1} g", f.speed_m_s, f.fall_g);
        if let Some(floor) = self.floor_m {
            let _ = writeln!(t, "  floor at y = {floor:.3} m");
        }
        if f.root_vector_flips > 0 {
            let n = f.root_vector_flips;
            let _ = writeln!(t, "  root vector changes sign, its angle passing 180 degrees, {n} times");
        }
        let still = self.still();
        if !still.is_empty() {
            let _ = writeln!(t, "  {} joints never turn: {}", still.len(), still.join(" "));
        }
        for line in tree(skeleton) {
            let _ = writeln!(t, "    {line}");
        }
        if self.doubts.is_empty() {
            let _ = writeln!(t, "  no doubts");
        }
        for doubt in &self.doubts {
            let _ = writeln!(t, "  doubt: {doubt}");
        }
        t
    }

    /// The report as one line of JSON, without a line end.
    pub fn json(&self) -> String {
        let (f, clip, skeleton) = (&self.stats, &self.motion.clip, self.motion.clip.skeleton());
        let (format, source) = source_lines(&self.motion.source);
        let offsets: Vec<[f64; 3]> = skeleton.offsets().iter().map(|o| o.to_array()).collect();
        let unit_m = match &self.motion.source {
            Source::Bvh(bvh) => Some(bvh.rig.unit_m),
            _ => None,
        };
        let doubts: Vec<Value> = self.doubts.iter().map(|d| json!({"kind": d.kind, "what": d.what})).collect();
        json!({
            "schema": 1, "file": self.motion.path.display().to_string(), "format": format, "source": source,
            "fps": clip.fps(), "frames": clip.frames(), "duration_s": clip.duration_s(),
            "joints": skeleton.joints(), "end_sites": skeleton.ends().len(), "names": skeleton.names(),
            "parents": skeleton.parents(), "offsets_m": offsets, "unit_m": unit_m, "up": self.motion.source.axes().up,
            "rig": self.rig(), "map": self.map.as_ref().map(|(_, fit)| fit_json(fit, skeleton)), "tree": tree(skeleton), "height_m": f.height_m, "floor_m": self.floor_m,
            "root_min_m": f.root_range[0].to_array(), "root_max_m": f.root_range[1].to_array(),
            "speed_m_s": f.speed_m_s, "fall_g": f.fall_g, "fps_for_free_fall": f.fps_for_free_fall,
            "root_jumps": f.root_jumps.len(), "joint_jumps": f.joint_jumps.len(),
            "root_vector_flips": f.root_vector_flips, "still_joints": self.still(), "doubts": doubts,
        })
        .to_string()
    }

    /// The name of the map that fits.
    fn rig(&self) -> Option<&str> {
        self.map.as_ref().map(|(map, _)| map.name.as_str())
    }

    /// The names of the joints that never rotate.
    fn still(&self) -> Vec<&str> {
        self.stats.still_joints.iter().map(|&j| self.motion.clip.skeleton().names()[j].as_str()).collect()
    }
}

/// The line about how well a map fits the file.
fn fit_line(fit: &MapFit) -> String {
    let names = |ids: &[usize]| ids.iter().map(|&id| smpl::NAMES[id]).collect::<Vec<_>>().join(", ");
    let missing: Vec<usize> = (0..24).filter(|&id| fit.joints[id].is_none()).collect();
    let (required, others): (Vec<_>, Vec<_>) = missing.iter().partition(|id| REQUIRED.contains(id));
    let mut line = format!("{} of SMPL's 24 joints", 24 - missing.len());
    if !others.is_empty() {
        line += &format!(", without {}", names(&others));
    }
    line += &match (&fit.stands, required.is_empty()) {
        (_, false) => format!("; missing {}, which a map must have", names(&required)),
        (Ok(()), true) => "; a body stands in its reference pose".into(),
        (Err(e), true) => format!("; no body stands in its reference pose: {e}"),
    };
    if let Some(degrees) = fit.trunk_error_deg {
        line += &format!("; on SMPL's body pelvis to neck is {degrees:.1} degrees off in the mean");
    }
    line
}

fn fit_json(fit: &MapFit, skeleton: &Skeleton) -> Value {
    let joints = (0..24).filter_map(|id| Some((smpl::NAMES[id], &skeleton.names()[fit.joints[id]?])));
    let missing: Vec<&str> =
        REQUIRED.iter().filter(|&&id| fit.joints[id].is_none()).map(|&id| smpl::NAMES[id]).collect();
    json!({
        "joints": joints.collect::<BTreeMap<_, _>>(), "missing": missing,
        "stands": fit.stands.is_ok(), "why_not": fit.stands.as_ref().err(),
        "trunk_error_deg": fit.trunk_error_deg, "toes_ahead": fit.toes_ahead,
    })
}

fn round(x: f64, digits: i32) -> f64 {
    let k = 10f64.powi(digits);
    (x * k).round() / k
}

/// Doubts that follow from the statistics.
fn doubts_of(f: &ClipStats, skeleton: &Skeleton) -> Vec<Warning> {
    let mut doubts = Vec::new();
    let mut doubt = |kind, what| doubts.push(Warning { kind, what });
    if let Some(&(frame, length)) = f.root_jumps.iter().max_by(|a, b| a.1.total_cmp(&b.1)) {
        let n = f.root_jumps.len();
        doubt(
            "root_jumps",
            standing_out(
                n,
                "step of the root",
                "steps of the root",
                "longest",
                &format!("{:.1} cm", 100.0 * length),
                frame,
            ),
        );
    }
    if let Some(&(frame, joint, angle)) = f.joint_jumps.iter().max_by(|a, b| a.2.total_cmp(&b.2)) {
        let (n, name) = (f.joint_jumps.len(), &skeleton.names()[joint]);
        let most = format!("{:.0} degrees of {name}", angle.to_degrees());
        doubt("joint_jumps", standing_out(n, "turn of a joint", "turns of joints", "widest", &most, frame));
    }
    doubts
}

/// The doubt that `n` values stand out, with the largest.
fn standing_out(n: usize, one: &str, many: &str, most: &str, how_much: &str, frame: usize) -> String {
    match n {
        1 => format!("1 {one} stands out: {how_much} into frame {frame}"),
        n => format!("{n} {many} stand out, the {most} {how_much} into frame {frame}"),
    }
}

fn source_lines(source: &Source) -> (&'static str, Vec<String>) {
    match source {
        Source::Bvh(bvh) => ("BVH", bvh_lines(bvh)),
        Source::Amass { model, gender, rest_pelvis, body_model, .. } => {
            ("AMASS", vec![format!("model {model}, gender {gender}"), body_line(*rest_pelvis, *body_model)])
        }
        Source::Aist { scaling, rest_pelvis, body_model, .. } => {
            ("AIST++", vec![format!("scaling {scaling}"), body_line(*rest_pelvis, *body_model)])
        }
        Source::Glb(_) => ("GLB", vec!["a mesh: a dance on this rig is written into the file".to_owned()]),
        Source::Vrma(_) => ("VRM animation", Vec::new()),
        Source::Json(_) | Source::Turned(_) | Source::Retargeted { .. } | Source::Plain => ("clip", Vec::new()),
    }
}

/// The up axis of the file, and how it was determined.
fn axes_line(axes: &Axes) -> String {
    let why = match axes.by {
        UpSource::Given => "",
        UpSource::Inferred => ", by the rest pose and the motion",
        UpSource::Feet => ", by the feet and the motion",
        UpSource::Ambiguous => ", for want of agreement",
        UpSource::Unknown => ", unjudged: no skeleton map knows the joints",
    };
    let turned = if axes.up == Up::Y { "" } else { " in the file; turned to y up here" };
    let mirrored = axes.mirror.map(|axis| format!("; mirrored along {axis} in the file, not here")).unwrap_or_default();
    format!("up {}{turned}{why}{mirrored}", axes.up)
}

/// The origin of the bones and of the rest pelvis.
fn body_line(rest_pelvis: Vec3, body_model: bool) -> String {
    let body = if body_model { "the body model's" } else { "the neutral skeleton's, not the subject's" };
    let Vec3 { x, y, z } = rest_pelvis;
    format!("bones are {body}; pelvis = trans + J0 with J0 = ({x:.3}, {y:.3}, {z:.3}) m in the file's axes")
}

/// Unit, frame time, position channels and roots of a BVH.
fn bvh_lines(bvh: &BvhSource) -> Vec<String> {
    let rig = &bvh.rig;
    let how = if rig.unit_judged { "judged by the leg" } else { "as given" };
    let mut lines =
        vec![format!("unit {} m ({how}); frame time {} s as printed", rig.unit_m, bvh.head.frame_time.trim())];
    let in_file = bvh.head.nodes.iter().filter(|n| n.kind != NodeKind::End).count();
    let in_clip = rig.skeleton.joints();
    if in_file != in_clip {
        let why = "what is above the body is composed into its root, what is beside it is left out";
        lines.push(format!("{in_file} joints in the file, {in_clip} in the clip: {why}"));
    }
    let roots: Vec<&str> =
        bvh.head.nodes.iter().filter(|n| n.kind == NodeKind::Root).map(|n| n.unique.as_str()).collect();
    let chain: Vec<&str> = rig.chain.iter().map(|&n| bvh.head.nodes[n].unique.as_str()).collect();
    lines.push(format!("roots {}; the motion's root is {}", roots.join(" "), chain.join(" > ")));
    let below = bvh.position_channels();
    let convention = match rig.position {
        BvhPosition::Replace => "replace the OFFSET",
        BvhPosition::Add => "are added to the OFFSET",
    };
    if below.is_empty() {
        lines.push(format!("position channels at the root only; they {convention}"));
        return lines;
    }
    let name = |joint: usize| rig.skeleton.names()[joint].as_str();
    let off = below.iter().map(|c| c.off_m).fold(0.0, f64::max);
    lines.push(format!(
        "position channels of {} joints below the root {convention}; |channels| are off |OFFSET| by up to {:.2} mm in the mean: {}",
        below.len(),
        1000.0 * off,
        below.iter().map(|c| name(c.joint)).collect::<Vec<_>>().join(" ")
    ));
    for c in below.iter().filter(|c| c.stretch_m > 0.0005) {
        lines.push(format!("stretch left out at {}: {:.1} mm at most", name(c.joint), 1000.0 * c.stretch_m));
    }
    lines
}

/// The tree of joints, one per line, with offsets in centimetres.
fn tree(skeleton: &Skeleton) -> Vec<String> {
    let mut lines = Vec::with_capacity(skeleton.joints());
    // (joint, prefix of its line, prefix of its children's lines)
    // a stack, not recursion: a file decides how deep a tree is
    let mut stack = vec![(0, String::new(), String::new())];
    while let Some((joint, lead, below)) = stack.pop() {
        let o = skeleton.offsets()[joint] * 100.0;
        lines.push(format!("{lead}{} ({:.1} {:.1} {:.1} cm)", skeleton.names()[joint], o.x, o.y, o.z));
        let children: Vec<usize> = skeleton.children(joint).collect();
        for (i, &child) in children.iter().enumerate().rev() {
            let last = i + 1 == children.len();
            let (branch, line) = if last { ("`- ", "   ") } else { ("|- ", "|  ") };
            stack.push((child, format!("{below}{branch}"), format!("{below}{line}")));
        }
    }
    lines
}
