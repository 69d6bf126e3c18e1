//! Rates of several files, judged together: a program that exports a folder writes one rate into all of it.

use super::rate::RateDoubt;
use super::{Motion, ReadOptions};
use kinelm_store::hash;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The doubt of a file's rate, and the group that it is judged in.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FileRate {
    /// The doubt by its own fall.
    pub doubt: Option<RateDoubt>,
    /// The files that its rate is judged with; `None` for a rate that was given.
    pub group: Option<RateGroup>,
}

/// What files share whose rates are judged together: if one of them is doubted, all are.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct RateGroup {
    folder: String,
    /// The stated rate.
    fps: String,
    /// Hash of the joints' names and parents.
    rig: String,
}

impl FileRate {
    /// Of a motion as it was read with these options.
    pub fn of(motion: &Motion, options: &ReadOptions) -> FileRate {
        if options.fps_source.is_some() {
            return FileRate::default();
        }
        let rig = motion.clip.skeleton();
        let group = RateGroup {
            folder: motion.path.parent().unwrap_or(&motion.path).display().to_string(),
            fps: motion.clip.fps().to_string(),
            rig: hash::of(format!("{:?} {:?}", rig.names(), rig.parents()).as_bytes()),
        };
        FileRate { doubt: RateDoubt::in_reading(motion), group: Some(group) }
    }
}

/// Rate doubts of several files, summarised in one line.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RateDoubts {
    files: usize,
    groups: BTreeMap<RateGroup, Group>,
    /// The file that falls fastest.
    worst: Option<(String, RateDoubt)>,
}

#[derive(Debug, Clone, PartialEq, Default)]
struct Group {
    files: usize,
    /// Likely rates of the doubted files, with the number of files.
    likely: BTreeMap<u64, usize>,
}

impl Group {
    /// The likely rate of most doubted files; of several the highest.
    fn likely_fps(&self) -> Option<u64> {
        // `max_by_key` returns the last of equals, which in a sorted map is the highest rate
        self.likely.iter().max_by_key(|(_, files)| **files).map(|(fps, _)| *fps)
    }
}

impl RateDoubts {
    /// Adds a file.
    pub fn add(&mut self, name: &str, file: FileRate) {
        self.files += 1;
        let Some(group) = file.group else { return };
        let group = self.groups.entry(group).or_default();
        group.files += 1;
        let Some(doubt) = file.doubt else { return };
        *group.likely.entry(doubt.likely_fps() as u64).or_default() += 1;
        if self.worst.as_ref().is_none_or(|(_, worst)| doubt.fall_g > worst.fall_g) {
            self.worst = Some((name.to_owned(), doubt));
        }
    }

    /// The likely rate of the files of a group, frames per second, if they are doubted.
    pub fn likely_fps(&self, group: &RateGroup) -> Option<f64> {
        self.groups.get(group)?.likely_fps().map(|fps| fps as f64)
    }

    /// The summary; `None` if no rate is doubted.
    pub fn line(&self) -> Option<String> {
        let (name, worst) = self.worst.as_ref()?;
        let (files, g) = (self.files, worst.fall_g);
        let mut all = Group::default();
        for group in self.groups.values().filter(|group| !group.likely.is_empty()) {
            all.files += group.files;
            group.likely.iter().for_each(|(fps, files)| *all.likely.entry(*fps).or_default() += files);
        }
        let (likely, falling) = (all.likely_fps()?, all.likely.values().sum::<usize>());
        let way_out = format!("if all were exported alike, `--fps-source {likely}` is for all");
        Some(match all.files {
            _ if files == 1 => format!("{name}: {}", worst.warning()),
            1 => format!("1 of {files} files doubts its rate: {name} falls at {g:.1} g; {way_out}"),
            n if n == falling => {
                format!("{n} of {files} files doubt their rates, {name} most: it falls at {g:.1} g; {way_out}")
            }
            n => format!(
                "{n} of {files} files doubt their rates: {falling} by how they fall, {name} most, at {g:.1} g, the others \
                 because they state the same rate, in the same folder and on the same rig; {way_out}"
            ),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::rate::tests::{falling, height};
    use super::*;
    use crate::Clip;

    fn motion(path: &str, clip: Clip) -> Motion {
        let warnings = RateDoubt::of(&clip).map(|doubt| doubt.warning()).into_iter().collect();
        let mut motion = Motion::new(path, clip);
        motion.warnings = warnings;
        motion
    }

    fn file(fall_g: Option<f64>, folder: &str) -> FileRate {
        let group = RateGroup { folder: folder.into(), fps: "120".into(), rig: "a".into() };
        FileRate { doubt: fall_g.map(|fall_g| RateDoubt { fall_g, fps: 120.0 }), group: Some(group) }
    }

    #[test]
    fn files_of_a_folder_are_doubted_together() {
        let still = || falling(60.0, |_| 1.0).with_fps(120.0).unwrap();
        let falls = || falling(60.0, height).with_fps(120.0).unwrap();
        let options = ReadOptions::default();
        let of = |path: &str, clip: Clip| FileRate::of(&motion(path, clip), &options);
        let mut doubts = RateDoubts::default();
        let same = of("a/2.bvh", still());
        let others = [of("b/1.bvh", still()), of("a/3.bvh", still().with_fps(60.0).unwrap())];
        let stated =
            FileRate::of(&motion("a/4.bvh", still()), &ReadOptions { fps_source: Some(120.0), ..options.clone() });
        doubts.add("1", of("a/1.bvh", falls()));
        doubts.add("2", same.clone());
        others.iter().for_each(|other| doubts.add("x", other.clone()));
        doubts.add("4", stated.clone());
        assert_eq!(doubts.likely_fps(&same.group.unwrap()), Some(60.0));
        assert!(others.iter().all(|other| doubts.likely_fps(other.group.as_ref().unwrap()).is_none()));
        assert_eq!(stated, FileRate::default(), "a rate that was given is not doubted");
        let line = doubts.line().unwrap();
        assert!(line.starts_with("2 of 5 files doubt their rates: 1 by how they fall, 1 most, at 4.0 g"), "{line}");
    }

    #[test]
    fn doubts_are_told_in_one_line() {
        let mut doubts = RateDoubts::default();
        doubts.add("a.bvh", file(None, "other"));
        assert_eq!(doubts.line(), None);
        doubts.add("b.bvh", file(Some(3.2), "a"));
        let line = "1 of 2 files doubts its rate: b.bvh falls at 3.2 g; if all were exported alike, `--fps-source 60` is for all";
        assert_eq!(doubts.line().as_deref(), Some(line));
        doubts.add("c.bvh", file(Some(2.0), "a"));
        assert!(doubts.line().unwrap().starts_with("2 of 3 files doubt their rates, b.bvh most: it falls at 3.2 g;"));
        // an outlier doesn't change the summary's rate
        doubts.add("d.bvh", file(Some(9.5), "a"));
        let line = doubts.line().unwrap();
        assert!(
            line.starts_with("3 of 4 files doubt their rates, d.bvh most") && line.contains("`--fps-source 60`"),
            "{line}"
        );
        let mut one = RateDoubts::default();
        one.add("b.bvh", file(Some(3.2), "a"));
        assert!(one.line().unwrap().starts_with("b.bvh: rate_doubted: the body falls at 3.2 g"));
    }
}
