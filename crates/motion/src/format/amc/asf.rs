//! The skeleton file.

use super::about_fixed;
use super::words::{Line, lines};
use crate::rotation::Axis;
use crate::{FaultKind, FileError, Quat, Result, Vec3};
use kinelm_store::SourcePos;
use std::path::Path;

/// Most bones, and the deepest nesting of them.
const MOST_BONES: usize = 4096;
const DEEPEST: usize = 512;

/// The effect of a number of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Channel {
    Turn(Axis),
    Move(Axis),
    /// `l`: along the bone.
    Length,
}

/// A skeleton. Bones are ordered parents first; bone n is joint n + 1.
pub(super) struct Asf {
    /// The factor of lengths: 0.45 in CMU's files.
    pub length: f64,
    /// Whether the file's own angles are in degrees.
    pub degrees: bool,
    pub root: Root,
    pub bones: Vec<Bone>,
    /// Numbers a frame.
    pub width: usize,
}

pub(super) struct Root {
    pub channels: Vec<Channel>,
    place: Vec3,
    turn: Quat,
}

pub(super) struct Bone {
    pub name: String,
    /// Its parent joint.
    pub parent: usize,
    /// From its beginning to its end, in the file's unit.
    pub way: Vec3,
    /// Its own axes in the world, in the base pose.
    axes: Quat,
    pub channels: Vec<Channel>,
    /// Where its numbers begin in a frame.
    pub column: usize,
}

impl Root {
    /// Place and rotation of a frame; angles are multiplied with `angle`.
    pub fn pose(&self, row: &[f64], angle: f64) -> (Vec3, Quat) {
        let mut place = self.place;
        for (channel, x) in self.channels.iter().zip(row) {
            if let Channel::Move(axis) = channel {
                place += axis.vector() * *x;
            }
        }
        (place, self.turn * turned(&self.channels, row, angle))
    }
}

impl Bone {
    /// The local rotation of a frame, `C M C^-1`; angles are multiplied with `angle`.
    pub fn turn(&self, row: &[f64], angle: f64) -> Quat {
        // channels rotate about the bone's own axes: into them, rotate, and back out
        self.axes * turned(&self.channels, row, angle) * self.axes.inverse()
    }
}

fn turned(channels: &[Channel], row: &[f64], angle: f64) -> Quat {
    about_fixed(channels.iter().zip(row).filter_map(|(channel, x)| match channel {
        Channel::Turn(axis) => Some((*axis, x * angle)),
        _ => None,
    }))
}

/// A bone as it stands in the file, before the hierarchy is known.
#[derive(Default)]
struct Raw {
    name: String,
    direction: [f64; 3],
    length: f64,
    axis: ([f64; 3], Vec<Axis>),
    channels: Vec<Channel>,
}

impl Asf {
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Asf> {
        let text = String::from_utf8_lossy(bytes);
        let whole = |found: String, expected: &str| -> crate::Error {
            FileError::new(SourcePos::file(path), FaultKind::UnexpectedWord, found, expected).into()
        };
        let mut parser = Parser::default();
        for line in lines(path, &text) {
            parser.line(&line)?;
        }
        if !parser.root_seen {
            return Err(whole("no :root".into(), "an ASF: :root, :bonedata, :hierarchy"));
        }
        if parser.raw.is_empty() || parser.raw.len() > MOST_BONES {
            let found = format!("{} bones", parser.raw.len());
            return Err(FileError::new(SourcePos::file(path), FaultKind::TooLarge, found, "1 to 4,096").into());
        }
        parser.finish(path)
    }
}

#[derive(Default)]
struct Parser {
    section: String,
    root_seen: bool,
    length: Option<f64>,
    radians: bool,
    channels: Vec<Channel>,
    root_axis: Vec<Axis>,
    place: [f64; 3],
    orientation: [f64; 3],
    raw: Vec<Raw>,
    open: Option<Raw>,
    /// Parent and child, with the line that says so.
    links: Vec<(String, String, usize)>,
}

impl Parser {
    fn line(&mut self, line: &Line) -> Result<()> {
        let key = line.key();
        if let Some(section) = key.strip_prefix(':') {
            section.clone_into(&mut self.section);
            self.root_seen |= section == "root";
            return Ok(());
        }
        match self.section.as_str() {
            "units" if key == "length" => self.length = Some(line.number(1)?),
            "units" if key == "angle" => {
                self.radians = line.rest().next().is_some_and(|w| w.to_ascii_lowercase().starts_with("rad"));
            }
            "root" => self.root(&key, line)?,
            "bonedata" => self.bone(&key, line)?,
            "hierarchy" if key != "begin" && key != "end" => {
                for child in line.rest() {
                    self.links.push((line.words[0].1.to_owned(), child.to_owned(), line.number));
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn root(&mut self, key: &str, line: &Line) -> Result<()> {
        match key {
            "order" => self.channels = channels(line)?,
            "axis" => self.root_axis = axes(line, 1)?,
            "position" => self.place = line.three(1)?,
            "orientation" => self.orientation = line.three(1)?,
            _ => {}
        }
        Ok(())
    }

    fn bone(&mut self, key: &str, line: &Line) -> Result<()> {
        match (key, &mut self.open) {
            ("begin", open) => *open = Some(Raw::default()),
            ("end", open) => self.raw.extend(open.take()),
            ("name", Some(bone)) => line.rest().next().unwrap_or_default().clone_into(&mut bone.name),
            ("direction", Some(bone)) => bone.direction = line.three(1)?,
            ("length", Some(bone)) => bone.length = line.number(1)?,
            ("axis", Some(bone)) => bone.axis = (line.three(1)?, axes(line, 4)?),
            ("dof", Some(bone)) => bone.channels = channels(line)?,
            _ => {}
        }
        Ok(())
    }

    fn finish(self, path: &Path) -> Result<Asf> {
        let angle = if self.radians { 1.0 } else { std::f64::consts::PI / 180.0 };
        let preset = |angles: [f64; 3], order: &[Axis]| {
            about_fixed(order.iter().map(|axis| (*axis, angles[axis.index()] * angle)))
        };
        let fault = |line: usize, kind, found: String, expected: &str| -> crate::Error {
            let at = SourcePos { path: path.to_owned(), line, column: 1 };
            FileError::new(at, kind, found, expected).into()
        };
        let root = Root {
            place: Vec3::from_array(self.place),
            turn: preset(self.orientation, &self.root_axis),
            channels: self.channels,
        };
        let mut width = root.channels.len();
        let mut raw: Vec<Option<Raw>> = self.raw.into_iter().map(Some).collect();
        let mut bones: Vec<Bone> = Vec::new();
        let mut depths = vec![0];
        // each pass finds the children of the bones that the passes before found, so any order of lines is fine
        let mut joint = 0;
        while joint <= bones.len() {
            let name = if joint == 0 { "root" } else { &bones[joint - 1].name }.to_owned();
            for (_, child, line) in self.links.iter().filter(|(parent, ..)| parent.eq_ignore_ascii_case(&name)) {
                let is_child = |r: &Option<Raw>| r.as_ref().is_some_and(|r| r.name.eq_ignore_ascii_case(child));
                let Some(found) = raw.iter_mut().find(|r| is_child(r)).and_then(Option::take) else {
                    let expected = "a bone of :bonedata that hangs from one other";
                    return Err(fault(*line, FaultKind::UnexpectedWord, child.clone(), expected));
                };
                if depths[joint] >= DEEPEST {
                    return Err(fault(
                        *line,
                        FaultKind::TooDeep,
                        format!("{child}, {DEEPEST} bones deep"),
                        "512 at most",
                    ));
                }
                depths.push(depths[joint] + 1);
                let column = width;
                width += found.channels.len();
                bones.push(Bone {
                    parent: joint,
                    way: Vec3::from_array(found.direction).normalize_or_zero() * found.length,
                    axes: preset(found.axis.0, &found.axis.1),
                    name: found.name,
                    channels: found.channels,
                    column,
                });
            }
            joint += 1;
        }
        let is_reached =
            |name: &str| name.eq_ignore_ascii_case("root") || bones.iter().any(|b| b.name.eq_ignore_ascii_case(name));
        // a limb below a misspelt name would be missing, and nothing else would tell
        if let Some((parent, _, line)) = self.links.iter().find(|(parent, ..)| !is_reached(parent)) {
            let expected = "root, or a bone of :bonedata that hangs from it";
            return Err(fault(*line, FaultKind::UnexpectedWord, parent.clone(), expected));
        }
        if bones.is_empty() {
            return Err(fault(1, FaultKind::UnexpectedWord, "no bone below root".into(), "a :hierarchy"));
        }
        // rows of no numbers can't be split into frames
        if width == 0 {
            return Err(fault(1, FaultKind::NoMotion, "no channels".into(), "an order of :root, or a dof of a bone"));
        }
        Ok(Asf { length: self.length.filter(|l| *l > 0.0).unwrap_or(1.0), degrees: !self.radians, root, bones, width })
    }
}

/// `TX RY l ..`, after the first word.
fn channels(line: &Line) -> Result<Vec<Channel>> {
    let channel = |(n, word): (usize, &str)| {
        let word = word.to_ascii_lowercase();
        let mut letters = word.chars();
        let kind = letters.next();
        match (kind, letters.next().and_then(axis), letters.next()) {
            (Some('r'), Some(axis), None) => Ok(Channel::Turn(axis)),
            (Some('t'), Some(axis), None) => Ok(Channel::Move(axis)),
            (Some('l'), None, None) => Ok(Channel::Length),
            _ => Err(line.fault(n + 1, FaultKind::ChannelUnknown, word, "rx, ry, rz, tx, ty, tz or l")),
        }
    };
    line.rest().enumerate().map(channel).collect()
}

/// `XYZ` at the word `n`.
fn axes(line: &Line, n: usize) -> Result<Vec<Axis>> {
    let word = line.words.get(n).map_or("", |w| w.1);
    let found: Option<Vec<Axis>> = word.chars().map(|c| axis(c.to_ascii_lowercase())).collect();
    let given = found.filter(|axes| axes.len() == 3);
    given.ok_or_else(|| line.fault(n, FaultKind::UnexpectedWord, word, "three axes such as XYZ"))
}

fn axis(letter: char) -> Option<Axis> {
    match letter {
        'x' => Some(Axis::X),
        'y' => Some(Axis::Y),
        'z' => Some(Axis::Z),
        _ => None,
    }
}
