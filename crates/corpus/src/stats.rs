//! The contents of a corpus, and what looks wrong in it.

use super::record::{ClipRecord, Count, Split};
use super::shared_runs::{SharedRun, shared_runs};
use super::store::Corpus;
use crate::Result;
use kinelm_motion::Clip;
use kinelm_motion::rotation::angle_between;
use kinelm_tokenizer::UncodedPose;
use rayon::prelude::*;
use serde::Serialize;
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, HashMap};
use std::fmt;

/// A root faster than this is a glitch if it stands out, metres a second: 17 cm in a frame at 20 fps. Sprints reach it,
/// but not from one frame to the next and back.
pub(crate) const ROOT_GLITCH_M_S: f64 = 3.0;

/// A joint that turns faster than this is a glitch if it stands out, degrees a second: 60 degrees in a frame at 20 fps.
pub(crate) const JOINT_GLITCH_DEG_S: f64 = 1200.0;

/// The places of the translation in a word.
const TRANSLATION: std::ops::Range<usize> = 0..3;

/// How many times the steps two frames before and after it a glitch is: a fast movement has fast neighbours.
const STANDS_OUT: f64 = 3.0;

/// A step that no body makes, in the decoded clip at the tokenizer's rate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Glitch {
    /// The clip.
    pub clip: String,
    /// The frame that the step leads to.
    pub frame: usize,
    /// `root` for its translation, else the joint.
    pub what: String,
    /// Centimetres (root) or degrees (joint) in this one step.
    pub step: f64,
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
    /// Words: one a frame, or one a tile of frames.
    pub words: usize,
    /// Tokens of the longest word, its space included.
    pub longest_word: usize,
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
    /// Root steps above `ROOT_GLITCH_M_S` and joint steps above `JOINT_GLITCH_DEG_S` that stand out, largest first.
    pub glitches: Vec<Glitch>,
    /// Clips in which some step is a glitch.
    pub clips_with_glitches: usize,
    /// Groups of clips with the same tokens.
    pub duplicates: Vec<Vec<String>>,
    /// Pairs of clips that share a second or more of poses, and are no duplicates; `None` where a word stands for several
    /// frames, since a pose is coded otherwise at another place of its tile.
    pub shared_runs: Option<Vec<SharedRun>>,
    /// Translation values clipped to the tokenizer's range, and clips that have some.
    pub clipped: [usize; 2],
    /// Rotations that took a second code.
    pub second_codes: usize,
    /// Files that could not be taken when the corpus was made.
    pub failed: usize,
}

/// The findings in a clip.
struct Seen {
    glitches: Vec<Glitch>,
    /// Of its words, which it stands for.
    hash: [u8; 32],
    words: usize,
}

fn look(corpus: &Corpus, record: &ClipRecord) -> Result<Seen> {
    let words = corpus.clip_words(record)?;
    // the last word may decode to more frames than the clip has
    let clip = corpus.tokenizer().decode(&words, UncodedPose::Identity)?.slice(0..record.frames);
    let glitches = glitches(&record.name, &clip, &corpus.tokenizer().config().joints);
    let mut hash = Sha256::new();
    for word in words.iter() {
        // with its length, so that the same codes in other words differ
        hash.update((word.len() as u64).to_le_bytes());
        hash.update(bytemuck::cast_slice::<u16, u8>(word));
    }
    Ok(Seen { glitches, hash: hash.finalize().into(), words: words.len() })
}

/// Looks through a corpus; decodes every clip, a clip a thread at a time.
///
/// # Errors
/// [`kinelm_store::Error::File`] when an id stands where it may not.
pub fn stats(corpus: &Corpus) -> Result<Stats> {
    let mut seen: Vec<Seen> = corpus.clips().par_iter().map(|c| look(corpus, c)).collect::<Result<_>>()?;
    let clips_with_glitches = seen.iter().filter(|seen| !seen.glitches.is_empty()).count();
    let mut glitches: Vec<Glitch> = seen.iter_mut().flat_map(|seen| std::mem::take(&mut seen.glitches)).collect();
    // metres and degrees side by side: each by how many times its limit it is
    // steps are per frame and limits per second, which scales both kinds alike
    let size = |g: &Glitch| g.step / if g.what == "root" { ROOT_GLITCH_M_S * 100.0 } else { JOINT_GLITCH_DEG_S };
    glitches.sort_by(|a, b| size(b).total_cmp(&size(a)));

    let (m, clips) = (corpus.manifest(), corpus.clips());
    let mut frames: Vec<usize> = clips.iter().map(|c| c.frames).collect();
    frames.sort_unstable();
    let at = |i: usize| frames.get(i).copied().unwrap_or(0);
    let takes = splits_of_takes(clips);
    let names = |group: &Vec<usize>| group.iter().map(|&i| clips[i].name.clone()).collect();
    let same = same_words(&seen);
    let shared = || shared_runs(clips, &|c| corpus.clip_words(&clips[c]), TRANSLATION, m.fps, &same);
    let longest = |c: &ClipRecord| {
        let words = corpus.words(c);
        (0..words.len()).map(|i| words.start(i + 1) - words.start(i)).max().unwrap_or(0)
    };
    Ok(Stats {
        schema: 1,
        count: m.count,
        hours: m.count.frames as f64 / m.fps / 3600.0,
        fps: m.fps,
        tokens: corpus.tokens().len(),
        words: seen.iter().map(|seen| seen.words).sum(),
        longest_word: clips.iter().map(longest).max().unwrap_or(0),
        vocabulary: m.vocabulary,
        clip_frames: [at(0), at(frames.len() / 2), at(frames.len().saturating_sub(1))],
        splits: m.splits.clone(),
        labels: by_label(clips),
        unlabelled: clips.iter().filter(|c| c.labels.is_empty()).count(),
        takes: takes.len(),
        takes_in_two_splits: takes.into_iter().filter(|(_, s)| s.len() > 1).map(|(t, _)| t.to_owned()).collect(),
        glitches,
        clips_with_glitches,
        duplicates: same.iter().map(names).collect(),
        shared_runs: (m.frames_per_word == 1).then(shared).transpose()?,
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

/// Groups of clips whose words are the same, each in the order of the corpus. Clips without frames are in none.
fn same_words(seen: &[Seen]) -> Vec<Vec<usize>> {
    let mut first: HashMap<[u8; 32], usize> = HashMap::new();
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, clip) in seen.iter().enumerate().filter(|(_, c)| c.words > 0) {
        let head = *first.entry(clip.hash).or_insert(i);
        groups.entry(head).or_default().push(i);
    }
    groups.into_values().filter(|g| g.len() > 1).collect()
}

/// The glitches of a clip, the root's first, then joint by joint. Only `joints` are looked at; in a decoded clip the others
/// follow them.
pub fn glitches(name: &str, clip: &Clip, joints: &[usize]) -> Vec<Glitch> {
    let glitch = |frame: usize, what: &str, step: f64| Glitch { clip: name.into(), frame, what: what.into(), step };
    let steps: Vec<f64> = clip.root().windows(2).map(|w| w[0].distance(w[1])).collect();
    let mut found: Vec<Glitch> =
        standing_out(&steps, ROOT_GLITCH_M_S / clip.fps()).map(|f| glitch(f, "root", steps[f - 1] * 100.0)).collect();
    for &j in joints {
        let step = |f: usize| angle_between(clip.pose(f - 1)[j], clip.pose(f)[j]).to_degrees();
        let steps: Vec<f64> = (1..clip.frames()).map(step).collect();
        let names = clip.skeleton().names();
        found.extend(standing_out(&steps, JOINT_GLITCH_DEG_S / clip.fps()).map(|f| glitch(f, &names[j], steps[f - 1])));
    }
    found
}

/// Frames whose step (`steps[0]` leads to frame 1) is above `limit` and stands out from those two steps away.
fn standing_out(steps: &[f64], limit: f64) -> impl Iterator<Item = usize> + '_ {
    // two steps away, because one bad frame makes two large steps in a row: there and back
    let far = |i: usize| {
        let before = i.checked_sub(2).map_or(0.0, |k| steps[k]);
        before.max(steps.get(i + 2).copied().unwrap_or(0.0))
    };
    (0..steps.len()).filter(move |&i| steps[i] > limit && steps[i] > STANDS_OUT * far(i)).map(|i| i + 1)
}

impl fmt::Display for Stats {
    /// A page of text, without a line end after the last line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Count { clips, frames } = self.count;
        write!(f, "{clips} clips, {frames} frames at {} fps, {:.3} hours", self.fps, self.hours)?;
        write!(f, "\n{} tokens of {} ids", self.tokens, self.vocabulary)?;
        write!(f, " in {} words, the longest of {}", self.words, self.longest_word)?;
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
/// Names of a group that are printed.
const GROUP: usize = 4;

impl Stats {
    fn fmt_doubts(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.unlabelled > 0 {
            write!(f, "\n{} clips have no label", self.unlabelled)?;
        }
        let torn = &self.takes_in_two_splits;
        list(f, &format!("{} takes stand in two splits", torn.len()), torn.iter().cloned())?;
        let roots = self.glitches.iter().filter(|g| g.what == "root").count();
        let (joints, in_clips) = (self.glitches.len() - roots, self.clips_with_glitches);
        let line = |g: &Glitch| {
            let unit = if g.what == "root" { "cm" } else { "degrees" };
            format!("{} frame {}: {} {:.0} {unit} in one frame", g.clip, g.frame, g.what, g.step)
        };
        let head = format!("glitches: {roots} steps of a root, {joints} of joints, in {in_clips} clips");
        list(f, &head, self.glitches.iter().map(line))?;
        if self.glitches.is_empty() {
            write!(f, "\nglitches: none")?;
        }
        let groups = self.duplicates.iter().map(|group| match group.get(GROUP..).unwrap_or_default().len() {
            0 => group.join(" = "),
            more => format!("{} = {more} more", group[..GROUP].join(" = ")),
        });
        list(f, &format!("exact duplicates: {} groups of clips with the same tokens", self.duplicates.len()), groups)?;
        if self.duplicates.is_empty() {
            write!(f, "\nexact duplicates: none")?;
        }
        match &self.shared_runs {
            Some(runs) => {
                let head = format!("{} pairs of clips share a second or more of poses", runs.len());
                list(f, &head, runs.iter().map(SharedRun::to_string))?;
            }
            None => write!(f, "\nshared poses: n/a, words are tiles of frames")?,
        }
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
    use crate::CorpusWriter;
    use crate::samples::{clip, walk};
    use kinelm_motion::{Quat, Vec3, smpl};
    use kinelm_tokenizer::{Tokenizer, TokenizerConfig};

    /// A body that turns and bends so that no two frames are alike, with 17 cm at frame 30 and a knee that snaps at 40.
    fn dance(glitches: bool) -> Clip {
        let mut rotations = Vec::new();
        let mut root = Vec::new();
        for f in 0..60 {
            let t = f as f64 / 20.0;
            let mut pose = [Quat::IDENTITY; 24];
            pose[0] = Quat::from_rotation_y(0.3 * t);
            pose[4] = Quat::from_rotation_x(0.5 + 0.4 * (2.0 * t).sin());
            if glitches && f == 40 {
                pose[4] = Quat::from_rotation_x(2.5);
            }
            rotations.extend(pose);
            let jump = if glitches && f >= 30 { 0.17 } else { 0.0 };
            root.push(Vec3::new(jump, 0.97, 0.2 * t));
        }
        Clip::new(smpl::neutral(), 20.0, root, rotations).unwrap()
    }

    #[test]
    fn a_corpus_is_described_and_its_faults_are_found() {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("c");
        let clips = [
            ("odd", dance(true), Split::Train),
            ("fine", dance(false), Split::Train),
            ("copy", dance(false), Split::Test),
        ];
        let config = TokenizerConfig::uniform(&[0, 4], 20.0, 360);
        let tokenizer = Tokenizer::fit(clips.iter().map(|c| &c.1), config).unwrap();
        let mut w = CorpusWriter::create(&dir, &tokenizer, &["d".to_string()], None, false).unwrap();
        for (key, (name, motion, split)) in clips.iter().enumerate() {
            let ids = tokenizer.ids_of_words(&tokenizer.encode(motion).unwrap().words).unwrap();
            w.push(clip(name, key, *split, 60), &ids).unwrap();
        }
        w.finish().unwrap();
        let s = stats(&Corpus::open(&dir).unwrap()).unwrap();
        assert_eq!((s.count, s.clip_frames, s.takes), (Count { clips: 3, frames: 180 }, [60; 3], 3));
        assert!((s.hours - 180.0 / 20.0 / 3600.0).abs() < 1e-12);
        assert_eq!(s.labels["genre"]["salsa"][&Split::Train], Count { clips: 2, frames: 120 });
        assert_eq!(s.clipped, [6, 3]);

        let mut found: Vec<_> = s.glitches.iter().map(|g| (g.frame, g.clip.as_str(), g.what.as_str())).collect();
        found.sort(); // there and back are of one size
        assert_eq!(found, [(30, "odd", "root"), (40, "odd", "left_knee"), (41, "odd", "left_knee")]);
        assert!((s.glitches[2].step - 17.0).abs() < 1.5, "{:?}", s.glitches);
        assert_eq!(s.clips_with_glitches, 1);
        assert_eq!(s.duplicates, [["fine", "copy"]]);
        // the odd one is the fine one up to the knee at frame 40, and after it
        let runs = s.shared_runs.as_ref().unwrap();
        assert_eq!((runs.len(), runs[0].frames, runs[0].at), (1, 40, [0, 0]));
        assert_eq!((s.words, s.longest_word), (180, 10));

        let crowd = Stats { duplicates: vec![(0..100).map(|i| format!("n{i}")).collect()], ..s.clone() };
        assert!(crowd.to_string().contains("\n  n0 = n1 = n2 = n3 = 96 more\n"), "{crowd}");
        let text = s.to_string();
        for line in ["3 clips, 180 frames at 20 fps, 0.003 hours", "odd frame 30: root 17 cm", "fine = copy", "salsa"] {
            assert!(text.contains(line), "{text}");
        }
        assert_eq!(serde_json::to_value(&s).unwrap()["splits"]["train"]["clips"], 2);
    }

    #[test]
    fn a_walk_is_no_glitch() {
        let fast = walk(20).with_fps(60.0).unwrap(); // 3 m/s, steadily
        assert_eq!(glitches("w", &fast, &[0]), []);
    }
}
