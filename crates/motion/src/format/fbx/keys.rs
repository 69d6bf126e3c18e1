//! Length and rate of a take, as the file states them or by its keys.

use crate::format::keys;
use crate::format::options::is_rate;
use std::collections::BTreeSet;
use ufbx::{AnimCurve, AnimStack};

/// Keys are denser than the stated rate if theirs is higher by this factor.
const DENSER: f64 = 1.01;

/// First and last time of a take, seconds: as it states them, else of the keys of the elements `moving`. Cinema 4D states
/// none.
pub(super) fn span(take: &AnimStack, moving: &BTreeSet<u32>) -> (f64, f64) {
    if take.time_end > take.time_begin {
        return (take.time_begin, take.time_end);
    }
    let times = times(take, moving).into_iter();
    times.map(|t| (t, t)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or((take.time_begin, take.time_begin))
}

/// Frames per second of a take: `stated`, or the rate of the figure's keys where they are evenly spaced and denser.
pub(super) fn rate(take: &AnimStack, moving: &BTreeSet<u32>, stated: f64) -> f64 {
    keys::rate(times(take, moving)).filter(|keys| is_rate(*keys) && *keys > DENSER * stated).unwrap_or(stated)
}

/// The times of all keys that a take has for a figure.
fn times(take: &AnimStack, moving: &BTreeSet<u32>) -> Vec<f64> {
    let times = |curve: &AnimCurve| -> Vec<f64> {
        curve.keyframes.iter().map(|key| key.time).filter(|time| time.is_finite()).collect()
    };
    keys::times(curves(take, moving).map(times))
}

/// The curves that a take has for the elements `moving`.
pub(super) fn curves<'a>(take: &'a AnimStack, moving: &'a BTreeSet<u32>) -> impl Iterator<Item = &'a AnimCurve> {
    let props = take.layers.iter().flat_map(|layer| layer.anim_props.iter());
    let props = props.filter(|prop| moving.contains(&prop.element.element_id));
    props.flat_map(|prop| prop.anim_value.curves.iter().flatten()).map(|curve| &**curve)
}

#[cfg(test)]
mod tests {
    use crate::Clip;
    use crate::format::{self, ReadOptions};
    use std::f64::consts::PI;
    use std::path::Path;

    /// KTime's ticks a second.
    const TICKS: f64 = 46_186_158_000.0;

    /// A hip and a knee that turns by 10 degrees a second, with keys at these times: an FBX as text that states 30 frames
    /// per second.
    fn file(times: &[f64], span: Option<(f64, f64)>) -> Clip {
        let list = |numbers: Vec<String>| format!("*{} {{ a: {} }}", numbers.len(), numbers.join(","));
        let ticks = |t: f64| (t * TICKS).round() as i64;
        let stated = span.map_or(String::new(), |(from, to)| {
            let line = |name: &str, t: f64| format!("P: \"{name}\", \"KTime\", \"Time\", \"\",{}\n", ticks(t));
            format!("Properties70: {{\n{}{}}}\n", line("LocalStart", from), line("LocalStop", to))
        });
        let bone = |id: usize, name: &str, y: f64| {
            format!(
                "NodeAttribute: {}, \"NodeAttribute::{name}\", \"LimbNode\" {{\nTypeFlags: \"Skeleton\"\n}}\n\
                 Model: {id}, \"Model::{name}\", \"LimbNode\" {{\nProperties70: {{\n\
                 P: \"Lcl Translation\", \"Lcl Translation\", \"\", \"A\",0,{y},0\n}}\n}}\n",
                id + 10
            )
        };
        let text = format!(
            "; FBX 7.4.0 project file\nFBXHeaderExtension: {{\nFBXHeaderVersion: 1003\nFBXVersion: 7400\n}}\n\
             GlobalSettings: {{\nVersion: 1000\nProperties70: {{\n\
             P: \"UpAxis\", \"int\", \"Integer\", \"\",1\nP: \"UpAxisSign\", \"int\", \"Integer\", \"\",1\n\
             P: \"FrontAxis\", \"int\", \"Integer\", \"\",2\nP: \"FrontAxisSign\", \"int\", \"Integer\", \"\",1\n\
             P: \"CoordAxis\", \"int\", \"Integer\", \"\",0\nP: \"CoordAxisSign\", \"int\", \"Integer\", \"\",1\n\
             P: \"UnitScaleFactor\", \"double\", \"Number\", \"\",1\nP: \"TimeMode\", \"enum\", \"\", \"\",6\n}}\n}}\n\
             Objects: {{\n{}{}\
             AnimationStack: 40, \"AnimStack::Take 001\", \"\" {{\n{stated}}}\n\
             AnimationLayer: 41, \"AnimLayer::Base\", \"\" {{\n}}\n\
             AnimationCurveNode: 42, \"AnimCurveNode::R\", \"\" {{\n}}\n\
             AnimationCurve: 43, \"AnimCurve::\", \"\" {{\nDefault: 0\nKeyVer: 4008\nKeyTime: {}\nKeyValueFloat: {}\n\
             KeyAttrFlags: *1 {{ a: 4 }}\nKeyAttrDataFloat: *4 {{ a: 0,0,0,0 }}\nKeyAttrRefCount: *1 {{ a: {} }}\n}}\n}}\n\
             Connections: {{\nC: \"OO\",1,0\nC: \"OO\",11,1\nC: \"OO\",2,1\nC: \"OO\",12,2\nC: \"OO\",41,40\nC: \"OO\",42,41\n\
             C: \"OP\",42,2, \"Lcl Rotation\"\nC: \"OP\",43,42, \"d|Z\"\n}}\n",
            bone(1, "hip", 90.0),
            bone(2, "knee", -40.0),
            list(times.iter().map(|t| ticks(*t).to_string()).collect()),
            list(times.iter().map(|t| (10.0 * t).to_string()).collect()),
            times.len(),
        );
        format::parse(Path::new("a.fbx"), text.as_bytes(), &ReadOptions::default()).unwrap().clip
    }

    /// Degrees by which the knee is turned.
    fn knee(clip: &Clip, frame: usize) -> f64 {
        clip.pose(frame)[1].to_axis_angle().1 * 180.0 / PI
    }

    #[test]
    fn a_take_without_start_and_stop_ends_with_its_keys() {
        let times: Vec<f64> = (15..=60).map(|f| f64::from(f) / 30.0).collect();
        let clip = file(&times, None);
        assert_eq!((clip.frames(), clip.fps()), (46, 30.0));
        assert!((knee(&clip, 0) - 5.0).abs() < 1e-3 && (knee(&clip, 45) - 20.0).abs() < 1e-3);
        // one that states them keeps them
        assert_eq!(file(&times, Some((0.0, 1.0))).frames(), 31);
    }

    #[test]
    fn keys_denser_than_the_stated_rate_are_frames() {
        let times = |fps: f64| (0..=120).map(|f| f64::from(f) / fps).collect::<Vec<f64>>();
        for (keys, fps, frames) in [(120.0, 120.0, 121), (60.0, 60.0, 121), (15.0, 30.0, 241)] {
            let times = times(keys);
            let clip = file(&times, Some((0.0, times[120])));
            assert_eq!((clip.frames(), clip.fps()), (frames, fps), "{keys}");
            assert!((knee(&clip, frames - 1) - 10.0 * times[120]).abs() < 1e-3, "{keys}");
        }
        let uneven: Vec<f64> = [0.0, 0.013, 0.029, 0.1, 0.105, 0.3].into();
        assert_eq!(file(&uneven, None).fps(), 30.0);
    }
}
