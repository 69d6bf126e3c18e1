//! Clips that share frames: the same recording cut twice, or a clip under two names.

use super::record::{ClipRecord, Split};
use crate::Result;
use kinelm_tokenizer::Words;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::fmt;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::ops::Range;

/// Two clips that share poses.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SharedRun {
    /// The two clips.
    pub clips: [String; 2],
    /// Their splits.
    pub splits: [Split; 2],
    /// Frames of the second that the first has too.
    pub frames: usize,
    /// The first of them, in each clip.
    pub at: [usize; 2],
}

impl fmt::Display for SharedRun {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([a, b], [s, t], [i, j]) = (&self.clips, self.splits, self.at);
        write!(f, "{a} ({s}) from frame {i} and {b} ({t}) from frame {j}: {} frames", self.frames)
    }
}

/// Pairs of clips with runs of a second or more whose words, a frame each, agree but for the translation's characters (steps are coded against
/// the decoded past, so they differ where a run begins elsewhere). Runs in which a body hardly moves (fewer than half of
/// the frames differ) prove nothing and are skipped; so are pairs inside the groups of `same`. Each clip is paired
/// with the first that has its frames. Sorted by frames, most first. `words` reads a clip's.
///
/// Of a large corpus the clips are read several times, and each time only some of the runs are remembered, by their hash: memory
/// does not grow with the hours, but by four bytes for each frame that is shared.
///
/// # Errors
/// Those of `words`.
pub(super) fn shared_runs(
    clips: &[ClipRecord],
    words: &(dyn Fn(usize) -> Result<Words> + Sync),
    translation: Range<usize>,
    fps: f64,
    same: &[Vec<usize>],
) -> Result<Vec<SharedRun>> {
    let run = (fps.round() as usize).max(2);
    let group: HashMap<usize, usize> = same.iter().flat_map(|g| g.iter().map(|&i| (i, g[0]))).collect();
    // what a clip shares, the head of its group shares
    let heads: Vec<usize> = (0..clips.len()).filter(|c| group.get(c).is_none_or(|head| head == c)).collect();
    let frames: usize = heads.iter().map(|&c| clips[c].frames).sum();
    // each pass takes one residue of the hashes, so that all runs are compared and few are held at a time
    let passes = frames.div_ceil(REMEMBERED).max(1) as u64;
    let mut pairs: BTreeMap<(usize, usize), Shared> = BTreeMap::new();
    for pass in 0..passes {
        let mut first: HashMap<u64, (u32, u32)> = HashMap::new();
        for some in heads.chunks(TOGETHER) {
            let runs = |&c: &usize| Ok((c, runs_of(&words(c)?, run, &translation, |hash| hash % passes == pass)));
            let all: Vec<(usize, Vec<(u32, u64)>)> = some.par_iter().map(runs).collect::<Result<_>>()?;
            for (c, (start, hash)) in all.into_iter().flat_map(|(c, runs)| runs.into_iter().map(move |r| (c, r))) {
                let (other, at) = *first.entry(hash).or_insert((c as u32, start));
                if other as usize != c {
                    let shared = pairs.entry((other as usize, c)).or_insert_with(|| (Vec::new(), [at, start]));
                    shared.0.push(start);
                    // runs come pass by pass, by their hashes, not in the order of frames
                    shared.1 = if start < shared.1[1] { [at, start] } else { shared.1 };
                }
            }
        }
    }
    let mut found: Vec<SharedRun> = (pairs.into_iter())
        .map(|((a, b), (starts, at))| SharedRun {
            clips: [a, b].map(|i| clips[i].name.clone()),
            splits: [a, b].map(|i| clips[i].split),
            frames: covered(starts, run),
            at: at.map(|at| at as usize),
        })
        .collect();
    found.sort_by(|a, b| b.frames.cmp(&a.frames).then_with(|| a.clips.cmp(&b.clips)));
    Ok(found)
}

/// Runs that are remembered at a time, about; some 20 bytes each.
const REMEMBERED: usize = 1 << 20;
/// Clips that are read at a time.
const TOGETHER: usize = 16;

/// The beginnings of a clip's runs that another clip has too, and the first of these in both.
type Shared = (Vec<u32>, [u32; 2]);

/// The runs of a clip in which it moves, of these hashes: where they begin, and their hashes.
fn runs_of(words: &Words, run: usize, translation: &Range<usize>, is_taken: impl Fn(u64) -> bool) -> Vec<(u32, u64)> {
    let frames: Vec<u64> = words.iter().map(|word| hash_but(word, translation)).collect();
    let all = frames.windows(run).enumerate().map(|(start, window)| (start as u32, hash(window), window));
    let taken = all.filter(|(_, hash, _)| is_taken(*hash));
    let moves = |window: &[u64]| window.iter().collect::<HashSet<_>>().len() * 2 >= run;
    taken.filter(|(.., window)| moves(window)).map(|(start, hash, _)| (start, hash)).collect()
}

/// The number of frames that runs of `run` frames, which begin at `starts`, cover.
fn covered(mut starts: Vec<u32>, run: usize) -> usize {
    starts.sort_unstable();
    let gaps = starts.windows(2).map(|pair| ((pair[1] - pair[0]) as usize).min(run));
    gaps.sum::<usize>() + if starts.is_empty() { 0 } else { run }
}

fn hash_but(word: &[u16], left_out: &Range<usize>) -> u64 {
    hash((&word[..left_out.start.min(word.len())], &word[left_out.end.min(word.len())..]))
}

fn hash(value: impl Hash) -> u64 {
    // DefaultHasher::new has fixed keys: the same pairs every time
    let mut hasher = DefaultHasher::new();
    value.hash(&mut hasher);
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(name: &str, split: Split) -> ClipRecord {
        let (name, take) = (name.to_string(), name.to_string());
        ClipRecord {
            floor_m: None,
            read: Default::default(),
            beats: None,
            music: None,
            name,
            take,
            split,
            offset: 0,
            tokens: 0,
            frames: 0,
            labels: BTreeMap::new(),
            key: 0,
            source: 0,
            sha256: String::new(),
            clipped: 0,
            second_codes: 0,
        }
    }

    /// Words of two: a translation that counts up, a pose that takes `poses` in turn.
    fn codes(poses: impl IntoIterator<Item = u16>) -> Words {
        Words::fixed(poses.into_iter().enumerate().flat_map(|(i, p)| [i as u16, p]).collect(), 2)
    }

    #[test]
    fn a_run_is_found_wherever_it_stands_and_stillness_is_not() {
        let clips =
            [record("a", Split::Train), record("b", Split::Test), record("c", Split::Test), record("d", Split::Valid)];
        let clip = [
            codes((0..30).chain([7; 40])),
            codes((500..505).chain(10..25).chain([7; 40])), // frames 10..25 of a at 5..20, and the same rest
            codes(200..230),
            codes(12..20), // too short
        ];
        let found = shared_runs(&clips, &|c| Ok(clip[c].clone()), 0..1, 10.0, &[]).unwrap();
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!((&found[0].clips, found[0].frames, found[0].at), (&["a".into(), "b".into()], 15, [10, 5]));
        assert_eq!(found[0].to_string(), "a (train) from frame 10 and b (test) from frame 5: 15 frames");
        assert_eq!(shared_runs(&clips, &|c| Ok(clip[c].clone()), 0..1, 10.0, &[vec![0, 1]]).unwrap(), []);
        assert_eq!((covered(vec![3, 9, 4], 5), covered(vec![], 5)), (11, 0));
    }
}
