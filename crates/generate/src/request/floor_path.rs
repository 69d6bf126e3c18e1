//! A path drawn on the floor, along which a dance is led.
//!
//! ```csv
//! seconds,x,z
//! 0,0,0
//! 2,0,1.5
//! 4,1.5,1.5
//! ```
//! Places are metres; `heading`, degrees from +z towards +x, is that of the way where there is no such column. Instead of
//! `seconds` a column `speed`, metres a second from each place to the next, says how fast it is walked; where it is empty the
//! speed stays.

use crate::{Error, Result};
use kinelm_motion::{Clip, Quat, Vec3, smpl};
use kinelm_store::{Subject, input};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Places of a path, at most.
const MOST: usize = 20_000;
/// The longest path, seconds.
const LONGEST_S: f64 = 3600.0;
/// The farthest a place may be from the middle of the floor, metres.
const FARTHEST_M: f64 = 1e6;
/// Over how many seconds a heading that isn't given looks ahead and back.
const AROUND_S: f64 = 0.25;

/// A path on the floor: two or more places, each with its time. In files it is a list of `[seconds, x, z]`, or of
/// `[seconds, x, z, heading]`.
///
/// ```
/// use kinelm_generate::request::FloorPath;
///
/// let path: FloorPath = serde_json::from_str("[[0, 0, 0], [3, 0, 2], [6, 2, 2]]")?;
/// assert_eq!(path.seconds(), 6.0);
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Vec<f64>>", into = "Vec<Vec<f64>>")]
pub struct FloorPath(Vec<Place>);

/// A place of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Place {
    time_s: f64,
    /// x and z, metres.
    at: [f64; 2],
    /// Degrees.
    heading: Option<f64>,
}

impl FloorPath {
    /// Reads a path from a `.csv`.
    ///
    /// # Errors
    /// Those of reading; faults with their line: columns that are missing, what is no number, times that don't ascend.
    pub fn read(file: &Path) -> Result<FloorPath> {
        FloorPath::parse(file, &input::bytes(file).map_err(Error::io(file))?)
    }

    /// A path of `[seconds, x, z]` or `[seconds, x, z, heading]`, beginning at any time.
    ///
    /// # Errors
    /// Rows of other lengths, numbers outside their ranges, times that don't ascend, fewer than two places.
    pub fn of(rows: &[Vec<f64>]) -> Result<FloorPath> {
        let fault = |n: usize, found: String, expected: &str| {
            Error::invalid(Subject::about(format!("place {n} of the `path`"), "path"), found, expected)
        };
        let with_heading = rows.first().is_some_and(|row| row.len() == 4);
        let mut places: Vec<Place> = Vec::new();
        for (n, row) in rows.iter().enumerate() {
            let (&[time_s, x, z], heading) = match (row.split_first_chunk::<3>(), with_heading) {
                (Some((first, [])), false) => (first, None),
                (Some((first, &[heading])), true) => (first, Some(heading)),
                _ => {
                    let expected = "seconds, x, z, and a heading in each or in none";
                    return Err(fault(n, format!("{} numbers", row.len()), expected));
                }
            };
            if let Some(wrong) = row.iter().find(|x| !is_near(**x)) {
                return Err(fault(n, wrong.to_string(), "a number below a million"));
            }
            if places.last().is_some_and(|last| time_s <= last.time_s) {
                return Err(fault(n, format!("{time_s} s after as many or more"), "a later time"));
            }
            places.push(Place { time_s, at: [x, z], heading });
        }
        FloorPath::whole(places, |found, expected| {
            Error::invalid(Subject::about("the `path`", "path"), found, expected)
        })
    }

    /// A path of places in their order, its time from 0.
    fn whole(mut places: Vec<Place>, fault: impl Fn(String, &str) -> Error) -> Result<FloorPath> {
        let [first, .., last] = &places[..] else {
            let found = if places.is_empty() { "no places" } else { "fewer than 2 places" };
            return Err(fault(found.into(), "a way from one place to another"));
        };
        let (begin, long) = (first.time_s, last.time_s - first.time_s);
        if places.len() > MOST {
            return Err(fault(format!("{} places", places.len()), &format!("{MOST} at most")));
        }
        if long > LONGEST_S {
            return Err(fault(format!("a way of {} s", compact(long)), "an hour at most"));
        }
        places.iter_mut().for_each(|place| place.time_s -= begin);
        Ok(FloorPath(places))
    }

    /// How long it lasts, seconds.
    pub fn seconds(&self) -> f64 {
        self.0.last().map_or(0.0, |last| last.time_s)
    }

    /// SMPL's body going along it, upright, with all joints at rest, `scale` times as far.
    ///
    /// # Errors
    /// A rate that is none.
    pub(crate) fn clip(&self, fps: f64, scale: f64) -> Result<Clip> {
        let (places, last) = (&*self.0, self.seconds());
        // 1e-9: a whole number may come out just below itself
        let frames = (last * fps + 1e-9) as usize + 1;
        let rest = smpl::neutral();
        // the pelvis as high as the legs are long
        let height = -rest.offsets()[1].y - rest.offsets()[4].y - rest.offsets()[7].y - rest.offsets()[10].y.min(0.0);
        let heading = |time_s: f64| match given_heading(places, time_s) {
            Some(heading) => heading,
            None => {
                let [a, b] = [-AROUND_S, AROUND_S].map(|by| at(places, (time_s + by).clamp(0.0, last)));
                (b[0] - a[0]).atan2(b[1] - a[1])
            }
        };
        let times = (0..frames).map(|frame| frame as f64 / fps);
        let place = |[x, z]: [f64; 2]| Vec3::new(scale * x, height, scale * z);
        let root = times.clone().map(|time| place(at(places, time))).collect();
        let joints = rest.joints();
        let turned = |(j, time)| if j == 0 { Quat::from_rotation_y(heading(time)) } else { Quat::IDENTITY };
        let rotations = times.flat_map(|time| (0..joints).map(move |j| (j, time))).map(turned).collect();
        Ok(Clip::new(rest, fps, root, rotations)?)
    }

    fn parse(file: &Path, bytes: &[u8]) -> Result<FloorPath> {
        let fault = |line: usize, found: String, expected: &str| {
            Error::file(
                file,
                format!("line {line}: {found}"),
                expected,
                "x, z and seconds or speed, docs/generation.md",
            )
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
            let cell = |column: usize| cells.get(column).copied().unwrap_or_default();
            let number = |column: usize| -> Result<f64> {
                let number = cell(column).parse::<f64>().ok().filter(|x| is_near(*x));
                number.ok_or_else(|| {
                    fault(n + 1, format!("{:?} as {}", cell(column), names[column]), "a number below a million")
                })
            };
            let (at, heading) = ([number(x)?, number(z)?], heading.map(number).transpose()?);
            let time_s = match (seconds, places.last()) {
                (Some(column), _) => number(column)?,
                (None, None) => 0.0,
                (None, Some(last)) => last.time_s + (at[0] - last.at[0]).hypot(at[1] - last.at[1]) / pace,
            };
            // an empty cell: as fast as before
            if let Some(column) = speed.filter(|column| places.is_empty() || !cell(*column).is_empty()) {
                pace = number(column)?;
                if pace <= 0.0 {
                    return Err(fault(n + 1, format!("a speed of {pace}"), "metres a second above 0"));
                }
            }
            if let Some(last) = places.last().filter(|last| time_s <= last.time_s) {
                return Err(match speed {
                    Some(_) => {
                        fault(n + 1, "the place of the row before".into(), "another one; who stands needs `seconds`")
                    }
                    None => fault(n + 1, format!("{time_s} s after {} s", last.time_s), "a later time"),
                });
            }
            places.push(Place { time_s, at, heading });
        }
        FloorPath::whole(places, |found, expected| fault(first + 1, found, expected))
    }
}

impl TryFrom<Vec<Vec<f64>>> for FloorPath {
    type Error = Error;

    fn try_from(rows: Vec<Vec<f64>>) -> Result<FloorPath> {
        FloorPath::of(&rows)
    }
}

impl From<FloorPath> for Vec<Vec<f64>> {
    fn from(path: FloorPath) -> Vec<Vec<f64>> {
        let row = |place: &Place| [place.time_s, place.at[0], place.at[1]].into_iter().chain(place.heading).collect();
        path.0.iter().map(row).collect()
    }
}

/// Whether a number of a path is one, and not too far out.
fn is_near(number: f64) -> bool {
    // false of NaN and infinities, too
    number.abs() < FARTHEST_M
}

/// A number as a message has it.
fn compact(number: f64) -> String {
    if number < 1e6 { format!("{number:.1}") } else { format!("{number:.1e}") }
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
    let (n, u) = around(places, time_s);
    let (a, b) = (places[n].heading?, places[n + 1].heading?);
    Some((a + u * ((b - a + 180.0).rem_euclid(360.0) - 180.0)).to_radians())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(text: &str) -> std::result::Result<FloorPath, String> {
        FloorPath::parse(Path::new("walk.csv"), text.as_bytes()).map_err(|e| e.to_string())
    }

    #[test]
    fn a_body_goes_along_a_path() {
        let square = path("seconds,x,z\n0,0,0\n2,0,2\n4,2,2\n").unwrap().clip(60.0, 1.0).unwrap();
        assert_eq!((square.frames(), square.fps()), (241, 60.0));
        for (frame, [x, z]) in [(0, [0.0, 0.0]), (120, [0.0, 2.0]), (240, [2.0, 2.0])] {
            let at = square.root()[frame];
            assert!((at.x - x).abs() < 1e-9 && (at.z - z).abs() < 1e-9, "{frame}: {at}");
        }
        let heading = |frame: usize| kinelm_motion::rotation::heading(square.pose(frame)[0]).unwrap().to_degrees();
        assert!(heading(10).abs() < 10.0 && (heading(120) - 45.0).abs() < 5.0 && (heading(230) - 90.0).abs() < 10.0);
        // at 1 m/s, the way is as long as its seconds; a heading of its own
        let crab = path("x,z,speed,heading\n0,0,1,90\n0,3,2,90\n0,5,,-170\n").unwrap().clip(60.0, 1.0).unwrap();
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
            ("seconds,x,z\n0,0,0\n0,1,0\n", "line 3: 0 s after 0 s"),
            ("x,z,speed\n0,0,1\n0,0,1\n", "who stands needs"),
            ("x,z,speed\n0,0,1e-300\n1,0,1\n", "1.0e300 s"),
            ("seconds,x,z\n0,0,0\n", "fewer than 2"),
            ("seconds,x,z\n", "no places"),
            ("x,z,speed\n0,0\n1,0\n", "line 2: \"\" as speed"),
            ("x,z,speed\n0,0,0\n1,0,1\n", "a speed of 0"),
            ("seconds,x,z\n0,0,0\n9999,1,0\n", "an hour"),
            ("seconds,x,z\n0,0,0\n1,nan,0\n", "a number"),
        ] {
            let said = path(text).unwrap_err();
            assert!(said.contains(expected), "{text:?}: {said}");
        }
    }

    #[test]
    fn a_path_in_a_file_is_a_list_of_places() {
        let of = |text: &str| serde_json::from_str::<FloorPath>(text).map_err(|e| e.to_string());
        let crab = of("[[1, 0, 0, 90], [3, 0, 2, 90]]").unwrap();
        assert_eq!(serde_json::to_string(&crab).unwrap(), "[[0.0,0.0,0.0,90.0],[2.0,0.0,2.0,90.0]]");
        assert_eq!(crab, path("seconds,x,z,heading\n1,0,0,90\n3,0,2,90\n").unwrap());
        let far = crab.clip(20.0, 0.5).unwrap();
        assert_eq!((far.frames(), far.root()[40].z), (41, 1.0), "on a body half as large, half as far");
        for (text, expected) in [
            ("[]", "no places"),
            ("[[0, 0, 0]]", "fewer than 2"),
            ("[[0, 0], [1, 1]]", "place 0 of the `path` is 2 numbers"),
            ("[[0, 0, 0], [1, 1, 1, 90]]", "place 1 of the `path` is 4 numbers"),
            ("[[0, 0, 0], [0, 1, 1]]", "place 1 of the `path` is 0 s after"),
            ("[[0, 0, 0], [1, 1e9, 1]]", "below a million"),
            ("[[0, 0, 0], [4000, 1, 1]]", "an hour"),
        ] {
            let said = of(text).unwrap_err();
            assert!(said.contains(expected), "{text}: {said}");
        }
    }
}
