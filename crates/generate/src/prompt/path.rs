//! A path that was drawn on the floor, as a clip to be followed.
//!
//! ```csv
//! seconds,x,z
//! 0,0,0
//! 2,0,1.5
//! 4,1.5,1.5
//! ```
//! Places are metres; `heading`, degrees from +z towards +x, is that of the way where there is no such column. Instead of
//! `seconds` a column `speed`, metres a second from each place to the next, says how fast it is walked.

use crate::{Error, Result};
use kinelm_motion::format;
use kinelm_motion::{Clip, Motion, Quat, Vec3, smpl};
use std::path::{Path, PathBuf};

/// Places of a path, at most.
const MOST: usize = 100_000;
/// The longest path, seconds.
const LONGEST_S: f64 = 3600.0;
/// Over how many seconds a heading that isn't given looks ahead and back.
const AROUND_S: f64 = 0.25;

/// A place of a path.
#[derive(Debug, Clone, Copy)]
struct Place {
    time_s: f64,
    at: [f64; 2],
    heading: Option<f64>,
}

/// Whether a prompt is a path, by its name.
pub(crate) fn is_path(file: &Path) -> bool {
    file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv"))
}

/// What a path's clip is called.
pub(crate) fn name(file: &Path) -> PathBuf {
    file.with_extension("json")
}

/// A path's file as a clip in kinelm's JSON, at the model's rate: SMPL's body goes along it, upright, with all joints at rest.
///
/// # Errors
/// [`kinelm_store::Error::Invalid`] and faults of the file with their line: columns that are missing, what is no number, times
/// that don't ascend.
pub(crate) fn to_json(file: &Path, bytes: &[u8], fps: f64) -> Result<Vec<u8>> {
    let places = places(file, bytes)?;
    let last = places[places.len() - 1].time_s;
    let frames = (last * fps + 1e-9) as usize + 1;
    let rest = smpl::neutral();
    // the pelvis as high as the legs are long
    let height = -rest.offsets()[1].y - rest.offsets()[4].y - rest.offsets()[7].y - rest.offsets()[10].y.min(0.0);
    let heading = |time_s: f64| match given_heading(&places, time_s) {
        Some(heading) => heading,
        None => {
            let [a, b] = [-AROUND_S, AROUND_S].map(|by| at(&places, (time_s + by).clamp(0.0, last)));
            (b[0] - a[0]).atan2(b[1] - a[1])
        }
    };
    let times = (0..frames).map(|frame| frame as f64 / fps);
    let root = times.clone().map(|time| at(&places, time)).map(|[x, z]| Vec3::new(x, height, z)).collect();
    let joints = rest.joints();
    let pose = |time| (0..joints).map(move |j| (j, time));
    let turned = |(j, time)| if j == 0 { Quat::from_rotation_y(heading(time)) } else { Quat::IDENTITY };
    let rotations = times.flat_map(pose).map(turned).collect();
    let clip = Clip::new(rest, fps, root, rotations)?;
    Ok(format::to_bytes(&name(file), &Motion::new(file, clip))?)
}

/// The segment around a time, and how far it is along it.
fn around(places: &[Place], time_s: f64) -> (usize, f64) {
    let next = places.partition_point(|place| place.time_s <= time_s).clamp(1, places.len() - 1);
    let (a, b) = (places[next - 1].time_s, places[next].time_s);
    (next - 1, ((time_s - a) / (b - a)).clamp(0.0, 1.0))
}

/// Where a path is at a time: along a curve through its places that bends no further than the next ones do (a cubic Hermite
/// curve with the tangents of finite differences).
fn at(places: &[Place], time_s: f64) -> [f64; 2] {
    let (n, u) = around(places, time_s);
    let (a, b) = (places[n], places[n + 1]);
    let long = b.time_s - a.time_s;
    let tangent = |i: usize, k: usize| {
        let (before, after) = (places[i.saturating_sub(1)], places[(i + 1).min(places.len() - 1)]);
        (after.at[k] - before.at[k]) / (after.time_s - before.time_s)
    };
    let (u2, u3) = (u * u, u * u * u);
    std::array::from_fn(|k| {
        (2.0 * u3 - 3.0 * u2 + 1.0) * a.at[k]
            + (u3 - 2.0 * u2 + u) * long * tangent(n, k)
            + (3.0 * u2 - 2.0 * u3) * b.at[k]
            + (u3 - u2) * long * tangent(n + 1, k)
    })
}

/// The heading at a time, radians, the shorter way round from one place to the next.
fn given_heading(places: &[Place], time_s: f64) -> Option<f64> {
    use std::f64::consts::{PI, TAU};
    let (n, u) = around(places, time_s);
    let (a, b) = (places[n].heading?, places[n + 1].heading?);
    Some(a + u * ((b - a + PI).rem_euclid(TAU) - PI))
}

fn places(file: &Path, bytes: &[u8]) -> Result<Vec<Place>> {
    let fault = |line: usize, found: String, expected: &str| {
        Error::file(file, format!("line {line}: {found}"), expected, "x, z and seconds or speed, docs/generation.md")
    };
    let text = std::str::from_utf8(bytes).map_err(|e| fault(1, e.to_string(), "text"))?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let columns = "a line of columns: seconds,x,z or x,z,speed, and heading if it is given";
    let Some((first, names)) = lines.next() else { return Err(fault(1, "nothing".into(), columns)) };
    let names: Vec<&str> = names.split(',').map(str::trim).collect();
    let known = ["seconds", "x", "z", "speed", "heading"];
    if let Some(other) = names.iter().find(|name| !known.contains(name)) {
        return Err(fault(first + 1, format!("the column {other:?}"), columns));
    }
    let [seconds, x, z, speed, heading] = known.map(|name| names.iter().position(|own| *own == name));
    let (Some(x), Some(z)) = (x, z) else { return Err(fault(first + 1, names.join(","), columns)) };
    if seconds.is_some() == speed.is_some() {
        return Err(fault(first + 1, names.join(","), "seconds, or else speed"));
    }
    let (mut places, mut pace): (Vec<Place>, f64) = (Vec::new(), 0.0);
    for (n, line) in lines {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let number = |column: usize| -> Result<f64> {
            let text = cells.get(column).copied().unwrap_or_default();
            let number = text.parse::<f64>().ok().filter(|x| x.is_finite() && x.abs() < 1e6);
            number.ok_or_else(|| fault(n + 1, format!("{text:?} as {}", names[column]), "a number"))
        };
        let (at, heading) = ([number(x)?, number(z)?], heading.map(number).transpose()?.map(f64::to_radians));
        let time_s = match (seconds, places.last()) {
            (Some(column), _) => number(column)?,
            (None, None) => 0.0,
            (None, Some(last)) => last.time_s + (at[0] - last.at[0]).hypot(at[1] - last.at[1]) / pace,
        };
        if let Some(column) = speed {
            pace = number(column)?;
            if pace <= 0.0 {
                return Err(fault(n + 1, format!("a speed of {pace}"), "metres a second above 0"));
            }
        }
        if places.last().is_some_and(|last| time_s <= last.time_s) {
            return Err(fault(n + 1, format!("{time_s} s after as many or more"), "a later time, at another place"));
        }
        places.push(Place { time_s, at, heading });
        if places.len() > MOST {
            return Err(fault(n + 1, format!("more than {MOST} places"), "fewer"));
        }
    }
    if places.len() < 2 {
        return Err(fault(first + 1, "fewer than 2 places".into(), "a way from one place to another"));
    }
    let begin = places[0].time_s;
    places.iter_mut().for_each(|place| place.time_s -= begin);
    match places[places.len() - 1].time_s {
        long if long > LONGEST_S => Err(fault(first + 1, format!("{long} s"), "an hour at most")),
        _ => Ok(places),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::format::{self, ReadOptions};

    fn clip(text: &str) -> std::result::Result<Clip, String> {
        let json = to_json(Path::new("walk.csv"), text.as_bytes(), 60.0).map_err(|e| e.to_string())?;
        Ok(format::parse(Path::new("walk.json"), &json, &ReadOptions::default()).unwrap().clip)
    }

    #[test]
    fn a_body_goes_along_a_path() {
        let square = clip("seconds,x,z\n0,0,0\n2,0,2\n4,2,2\n").unwrap();
        assert_eq!((square.frames(), square.fps()), (241, 60.0));
        for (frame, [x, z]) in [(0, [0.0, 0.0]), (120, [0.0, 2.0]), (240, [2.0, 2.0])] {
            let at = square.root()[frame];
            assert!((at.x - x).abs() < 1e-9 && (at.z - z).abs() < 1e-9, "{frame}: {at}");
        }
        let heading = |frame: usize| kinelm_motion::rotation::heading(square.pose(frame)[0]).unwrap().to_degrees();
        assert!(heading(10).abs() < 10.0 && (heading(120) - 45.0).abs() < 5.0 && (heading(230) - 90.0).abs() < 10.0);
        // at 1 m/s, the way is as long as its seconds; a heading of its own
        let crab = clip("x,z,speed,heading\n0,0,1,90\n0,3,2,90\n0,5,1,-170\n").unwrap();
        assert_eq!(crab.frames(), 241);
        let facing = kinelm_motion::rotation::heading(crab.pose(60)[0]).unwrap();
        assert!((facing.to_degrees() - 90.0).abs() < 1e-6);
    }

    #[test]
    fn what_is_no_path_is_refused_with_its_line() {
        for (text, expected) in [
            ("", "line 1: nothing"),
            ("seconds,x\n0,1\n", "line 1: seconds,x"),
            ("x,z\n0,0\n1,1\n", "seconds, or else speed"),
            ("seconds,x,y\n", "the column \"y\""),
            ("seconds,x,z\n0,0,0\n1,a,0\n", "line 3: \"a\" as x"),
            ("seconds,x,z\n0,0,0\n0,1,0\n", "line 3: 0 s after"),
            ("seconds,x,z\n0,0,0\n", "fewer than 2"),
            ("x,z,speed\n0,0,0\n1,0,1\n", "a speed of 0"),
            ("seconds,x,z\n0,0,0\n9999,1,0\n", "an hour"),
            ("seconds,x,z\n0,0,0\n1,nan,0\n", "a number"),
        ] {
            let said = clip(text).unwrap_err();
            assert!(said.contains(expected), "{text:?}: {said}");
        }
    }
}
