//! What is in a corpus, and what looks wrong in it.

use super::record::{ClipRecord, Count, Jumps, Split};
use super::shared_runs::{SharedRun, shared_runs};
use super::store::Corpus;
use crate::Result;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::{BTreeMap, HashMap};
use std::fmt;

/// The places of the translation in a word.
const TRANSLATION: std::ops::Range<usize> = 0..3;

/// Steps from one source frame to the next that no body makes: a root's of more than 5 cm and three times what it does
/// two frames before and after; a joint's of more than 25 degrees and 1,500 degrees a second.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Glitch {
    /// The clip.
    pub clip: String,
    /// Its split.
    pub split: Split,
    /// Whether it is the root's place that jumps, not a joint's rotation.
    pub root: bool,
    /// How many steps; the largest, its joint and frame in the file. Centimetres for a root, degrees for a joint.
    #[serde(flatten)]
    pub jumps: Jumps,
}

impl fmt::Display for Glitch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Jumps { steps, largest, frame, joint }, clip) = (&self.jumps, &self.clip);
        let (of, unit) = if self.root { ("root", "cm") } else { ("joint", "degrees") };
        write!(f, "{clip}: {steps} {of} steps, the largest {joint} {largest:.1} {unit} at frame {frame} of the file")
    }
}

/// The figures of a corpus.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stats {
    /// Version of this object.
    pub schema: u32,
    /// Clips and frames.
    pub count: Count,
    /// Hours at the tokenizer's rate.
    pub hours: f64,
    /// Frames per second.
    pub fps: f64,
    /// Tokens, spaces included.
    pub tokens: usize,
    /// Ids.
    pub vocabulary: usize,
    /// Shortest, median and longest clip, frames.
    pub clip_frames: [usize; 3],
    /// By split.
    pub splits: BTreeMap<Split, Count>,
    /// Field to value to split.
    pub labels: BTreeMap<String, BTreeMap<String, BTreeMap<Split, Count>>>,
    /// Clips without any label.
    pub unlabelled: usize,
    /// Recordings.
    pub takes: usize,
    /// Recordings that stand in more than one split.
    pub takes_in_two_splits: Vec<String>,
    /// Glitches of the sources: those of roots, then those of joints, largest first.
    pub glitches: Vec<Glitch>,
    /// Groups of clips with the same tokens.
    pub duplicates: Vec<Vec<String>>,
    /// Pairs of clips that share a second or more of poses, and are no duplicates.
    pub shared_runs: Vec<SharedRun>,
    /// Translation values clipped to the tokenizer's range, and clips that have some.
    pub clipped: [usize; 2],
    /// Rotations that took a second code.
    pub second_codes: usize,
    /// Files that could not be taken when the corpus was made.
    pub failed: usize,
}

/// Looks through a corpus.
///
/// # Errors
/// [`crate::Error::File`] when a word holds an id that is no character.
pub fn stats(corpus: &Corpus) -> Result<Stats> {
    let codes: Vec<Vec<u16>> = corpus.clips().par_iter().map(|c| corpus.clip_codes(c)).collect::<Result<_>>()?;
    let (m, clips) = (corpus.manifest(), corpus.clips());
    let mut frames: Vec<usize> = clips.iter().map(|c| c.frames).collect();
    frames.sort_unstable();
    let at = |i: usize| frames.get(i).copied().unwrap_or(0);
    let takes = splits_of_takes(clips);
    let names = |group: &Vec<usize>| group.iter().map(|&i| clips[i].name.clone()).collect();
    let same = same_tokens(&codes);
    Ok(Stats {
        schema: 1,
        count: m.count,
        hours: m.count.frames as f64 / m.fps / 3600.0,
        fps: m.fps,
        tokens: corpus.tokens().len(),
        vocabulary: m.vocabulary,
        clip_frames: [at(0), at(frames.len() / 2), at(frames.len().saturating_sub(1))],
        splits: m.splits.clone(),
        labels: by_label(clips),
        unlabelled: clips.iter().filter(|c| c.labels.is_empty()).count(),
        takes: takes.len(),
        takes_in_two_splits: takes.into_iter().filter(|(_, s)| s.len() > 1).map(|(t, _)| t.to_owned()).collect(),
        glitches: glitches(clips),
        duplicates: same.iter().map(names).collect(),
        shared_runs: shared_runs(clips, &codes, m.tokens_per_frame - 1, TRANSLATION, m.fps, &same),
        clipped: [clips.iter().map(|c| c.clipped).sum(), clips.iter().filter(|c| c.clipped > 0).count()],
        second_codes: clips.iter().map(|c| c.second_codes).sum(),
        failed: m.failed.len(),
    })
}

fn splits_of_takes(clips: &[ClipRecord]) -> BTreeMap<&str, BTreeMap<Split, usize>> {
    let mut takes: BTreeMap<&str, BTreeMap<Split, usize>> = BTreeMap::new();
    for clip in clips {
        *takes.entry(&clip.take).or_default().entry(clip.split).or_default() += 1;
    }
    takes
}

fn by_label(clips: &[ClipRecord]) -> BTreeMap<String, BTreeMap<String, BTreeMap<Split, Count>>> {
    let mut labels: BTreeMap<String, BTreeMap<String, BTreeMap<Split, Count>>> = BTreeMap::new();
    for clip in clips {
        for (field, value) in &clip.labels {
            let values = labels.entry(field.clone()).or_default();
            values.entry(value.clone()).or_default().entry(clip.split).or_default().add(clip.frames);
        }
    }
    labels
}

/// Groups of clips whose codes are the same, each in the order of the corpus. Clips without frames are in none.
fn same_tokens(codes: &[Vec<u16>]) -> Vec<Vec<usize>> {
    let mut first: HashMap<&[u16], usize> = HashMap::new();
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, clip) in codes.iter().enumerate().filter(|(_, c)| !c.is_empty()) {
        let head = *first.entry(clip).or_insert(i);
        groups.entry(head).or_default().push(i);
    }
    groups.into_values().filter(|g| g.len() > 1).collect()
}

fn glitches(clips: &[ClipRecord]) -> Vec<Glitch> {
    let glitch = |clip: &ClipRecord, root, jumps: &Option<Jumps>| {
        let (name, split) = (clip.name.clone(), clip.split);
        jumps.clone().map(|jumps| Glitch { clip: name, split, root, jumps })
    };
    let both = |c| [glitch(c, true, &c.root_jumps), glitch(c, false, &c.joint_jumps)];
    let mut found: Vec<Glitch> = clips.iter().flat_map(both).flatten().collect();
    found.sort_by(|a, b| b.root.cmp(&a.root).then(b.jumps.largest.total_cmp(&a.jumps.largest)));
    found
}

impl fmt::Display for Stats {
    /// A page of text, without a line end after the last line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Count { clips, frames } = self.count;
        write!(f, "{clips} clips, {frames} frames at {} fps, {:.3} hours", self.fps, self.hours)?;
        write!(f, "\n{} tokens of {} ids", self.tokens, self.vocabulary)?;
        let [shortest, median, longest] = self.clip_frames;
        write!(f, "\nclips of {shortest} to {longest} frames, median {median}; {} takes", self.takes)?;
        for (split, c) in &self.splits {
            let share = 100.0 * c.frames as f64 / frames.max(1) as f64;
            write!(f, "\n{split:<6} {:>7} clips {:>10} frames {share:>6.1} %", c.clips, c.frames)?;
        }
        for (field, values) in &self.labels {
            write!(f, "\n\n{field:<26} {:>9} {:>9} {:>9}   clips (frames)", "train", "valid", "test")?;
            for (value, splits) in values {
                write!(f, "\n  {value:<24}")?;
                for split in Split::ALL {
                    write!(f, " {:>9}", splits.get(&split).map_or(0, |c| c.clips))?;
                }
                write!(f, "   ({})", splits.values().map(|c| c.frames).sum::<usize>())?;
            }
        }
        writeln!(f)?;
        self.fmt_doubts(f)
    }
}

/// Longest lists of doubts that are printed; JSON has them whole.
const LISTED: usize = 10;

impl Stats {
    fn fmt_doubts(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.unlabelled > 0 {
            write!(f, "\n{} clips have no label", self.unlabelled)?;
        }
        let torn = &self.takes_in_two_splits;
        list(f, &format!("{} takes stand in two splits", torn.len()), torn.iter().cloned())?;
        for (root, what) in [(true, "a root (above 5 cm)"), (false, "joints (above 25 degrees)")] {
            let found: Vec<&Glitch> = self.glitches.iter().filter(|g| g.root == root).collect();
            let steps: usize = found.iter().map(|g| g.jumps.steps).sum();
            let head = format!("glitches: {steps} steps of {what} in one source frame, in {} clips", found.len());
            list(f, &head, found.iter().map(|g| g.to_string()))?;
        }
        if self.glitches.is_empty() {
            write!(f, "\nglitches: none")?;
        }
        let groups = self.duplicates.iter().map(|g| g.join(" = "));
        list(f, &format!("exact duplicates: {} groups of clips with the same tokens", self.duplicates.len()), groups)?;
        if self.duplicates.is_empty() {
            write!(f, "\nexact duplicates: none")?;
        }
        let runs = self.shared_runs.iter().map(SharedRun::to_string);
        list(f, &format!("{} pairs of clips share a second or more of poses", self.shared_runs.len()), runs)?;
        let [values, clips] = self.clipped;
        write!(f, "\ntranslation values clipped: {values} in {clips} clips; second codes: {}", self.second_codes)?;
        if self.failed > 0 {
            write!(f, "\n{} files could not be taken when the corpus was made", self.failed)?;
        }
        Ok(())
    }
}

/// A head and the first few lines below it; nothing for no lines.
fn list(f: &mut fmt::Formatter<'_>, head: &str, lines: impl ExactSizeIterator<Item = String>) -> fmt::Result {
    let count = lines.len();
    if count > 0 {
        write!(f, "\n{head}")?;
    }
    for line in lines.take(LISTED) {
        write!(f, "\n  {line}")?;
    }
    if count > LISTED {
        write!(f, "\n  and {} more", count - LISTED)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::corpus::CorpusWriter;
    use crate::corpus::samples::clip;
    use kinelm_motion::{Clip, Quat, Vec3, smpl};
    use kinelm_tokenizer::{Tokenizer, TokenizerConfig};

    /// A body that turns and bends so that no two frames are alike, with a knee that snaps at frame 40.
    fn dance(snaps: bool) -> Clip {
        let pose = |f: usize| {
            let t = f as f64 / 20.0;
            let mut pose = [Quat::IDENTITY; 24];
            pose[0] = Quat::from_rotation_y(0.3 * t);
            let knee = if snaps && f == 40 { 2.5 } else { 0.5 + 0.4 * (2.0 * t).sin() };
            pose[4] = Quat::from_rotation_x(knee);
            pose
        };
        let root = (0..60).map(|f| Vec3::new(0.0, 0.97, 0.01 * f as f64)).collect();
        Clip::new(smpl::neutral(), 20.0, root, (0..60).flat_map(pose).collect()).unwrap()
    }

    #[test]
    fn a_corpus_is_described_and_its_faults_are_found() {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("c");
        let clips = [("odd", true, Split::Train), ("fine", false, Split::Train), ("copy", false, Split::Test)];
        let tokenizer = Tokenizer::fit([&dance(true)], TokenizerConfig::uniform(&[0, 4], 20.0, 360)).unwrap();
        let mut w = CorpusWriter::create(&dir, &tokenizer, &["d".to_string()], None, false).unwrap();
        for (key, (name, snaps, split)) in clips.into_iter().enumerate() {
            let ids = tokenizer.ids_of_codes(&tokenizer.encode(&dance(snaps)).unwrap().codes).unwrap();
            let jumps = |largest, joint: &str| Some(Jumps { steps: 2, largest, frame: 40, joint: joint.into() });
            let mut new = clip(name, key, split);
            new.root_jumps = jumps(6.0 + key as f64, "hip");
            new.joint_jumps = jumps(90.0, "lShin").filter(|_| snaps);
            w.push(new, &ids).unwrap();
        }
        w.finish().unwrap();
        let s = stats(&Corpus::open(&dir).unwrap()).unwrap();
        assert_eq!((s.count, s.clip_frames, s.takes), (Count { clips: 3, frames: 180 }, [60; 3], 3));
        assert!((s.hours - 180.0 / 20.0 / 3600.0).abs() < 1e-12);
        assert_eq!(s.labels["genre"]["salsa"][&Split::Train], Count { clips: 2, frames: 120 });
        assert_eq!(s.clipped, [6, 3]);
        let found: Vec<_> = s.glitches.iter().map(|g| (g.clip.as_str(), g.root, g.jumps.largest)).collect();
        assert_eq!(found, [("copy", true, 8.0), ("fine", true, 7.0), ("odd", true, 6.0), ("odd", false, 90.0)]);
        assert_eq!(s.duplicates, [["fine", "copy"]]);
        // the odd one is the fine one up to the knee at frame 40
        assert_eq!(s.shared_runs.len(), 1);
        assert_eq!((s.shared_runs[0].frames, s.shared_runs[0].at), (40, [0, 0]));

        let text = s.to_string();
        for line in [
            "3 clips, 180 frames at 20 fps, 0.003 hours",
            "glitches: 6 steps of a root (above 5 cm) in one source frame, in 3 clips",
            "odd: 2 joint steps, the largest lShin 90.0 degrees at frame 40 of the file",
            "fine = copy",
            "salsa",
        ] {
            assert!(text.contains(line), "{line}\n{text}");
        }
        let json = serde_json::to_value(&s).unwrap();
        assert_eq!((&json["splits"]["train"]["clips"], &json["glitches"][0]["frame"]), (&2.into(), &40.into()));
    }
}
