//! Clips that share frames: the same recording cut twice, or a clip that stands under two names.

use super::record::{ClipRecord, Split};
use kinelm_tokenizer::Words;
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
    /// Frames of the second that stand in the first too.
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
/// the frames differ) tell nothing and are passed over; so are pairs inside the groups of `same`. Each clip is paired
/// with the first that has its frames. Sorted by frames, most first.
pub(super) fn shared_runs(
    clips: &[ClipRecord],
    words: &[Words],
    translation: Range<usize>,
    fps: f64,
    same: &[Vec<usize>],
) -> Vec<SharedRun> {
    let run = (fps.round() as usize).max(2);
    let group: HashMap<usize, usize> = same.iter().flat_map(|g| g.iter().map(|&i| (i, g[0]))).collect();
    let mut first: HashMap<u64, (usize, usize)> = HashMap::new();
    let mut pairs: BTreeMap<(usize, usize), (HashSet<usize>, [usize; 2])> = BTreeMap::new();
    for (c, words) in words.iter().enumerate() {
        if group.get(&c).is_some_and(|&head| head != c) {
            continue; // what it shares, the head of its group shares
        }
        let frames: Vec<u64> = words.iter().map(|word| hash_but(word, &translation)).collect();
        for (start, window) in frames.windows(run).enumerate() {
            if window.iter().collect::<HashSet<_>>().len() * 2 < run {
                continue;
            }
            let (other, at) = *first.entry(hash(window)).or_insert((c, start));
            if other != c {
                let (shared, _) = pairs.entry((other, c)).or_insert_with(|| (HashSet::new(), [at, start]));
                shared.extend(start..start + run);
            }
        }
    }
    let mut found: Vec<SharedRun> = (pairs.into_iter())
        .map(|((a, b), (frames, at))| SharedRun {
            clips: [a, b].map(|i| clips[i].name.clone()),
            splits: [a, b].map(|i| clips[i].split),
            frames: frames.len(),
            at,
        })
        .collect();
    found.sort_by(|a, b| b.frames.cmp(&a.frames).then_with(|| a.clips.cmp(&b.clips)));
    found
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
            sound: None,
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
        let found = shared_runs(&clips, &clip, 0..1, 10.0, &[]);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!((&found[0].clips, found[0].frames, found[0].at), (&["a".into(), "b".into()], 15, [10, 5]));
        assert_eq!(found[0].to_string(), "a (train) from frame 10 and b (test) from frame 5: 15 frames");
        assert_eq!(shared_runs(&clips, &clip, 0..1, 10.0, &[vec![0, 1]]), []);
    }
}
