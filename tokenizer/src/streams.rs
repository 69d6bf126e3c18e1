//! Any stream of ids decodes, in every scheme, and an id changes its own word alone.

use crate::contract::{bent, presets};
use crate::{SPACE, Tokenizer, UncodedPose, WordLength};
use kinelm_motion::{Clip, Quat, Vec3};
use rayon::prelude::*;

/// Ids a stream.
const LENGTH: usize = 40;

/// Random numbers below `n`; Knuth, MMIX.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % n
    }
}

fn is_finite(clip: &Clip) -> bool {
    clip.root().iter().all(|p| p.is_finite()) && clip.rotations().iter().all(|q| q.is_finite() && q.is_normalized())
}

#[test]
fn a_million_random_streams_decode() {
    let schemes = presets();
    let each = 1_000_000usize.div_ceil(schemes.len());
    schemes.iter().for_each(|(name, t)| {
        let v = t.vocabulary().len() as usize;
        (0..each).into_par_iter().for_each(|stream| {
            let mut random = Random(stream as u64);
            // of every kind: any id at all, characters and spaces alone, hardly a space
            let ids: Vec<u32> = (0..LENGTH)
                .map(|_| match stream % 3 {
                    0 => random.below(v) as u32,
                    1 => 5 + random.below(v - 5) as u32,
                    _ if random.below(15) == 0 => SPACE,
                    _ => 6 + random.below(v - 6) as u32,
                })
                .chain([SPACE])
                .collect();
            let words = t.words_of_ids(&ids).words;
            let clip =
                t.decode(&words, UncodedPose::Identity).unwrap_or_else(|e| panic!("{name}, stream {stream}: {e}"));
            assert_eq!(clip.frames(), words.len() * t.frames_per_word(), "{name}, stream {stream}");
            assert!(is_finite(&clip), "{name}, stream {stream}");
        });
    });
}

/// The invariants of a clip under a shift and a turn about the vertical: from frame to frame the pelvis's turn and its
/// step, relative to the pelvis, and its tilt.
fn relative(clip: &Clip, f: usize) -> (Vec3, Quat, f64) {
    let (q, next) = (clip.pose(f)[0], clip.pose(f + 1)[0]);
    (q.inverse() * (clip.root()[f + 1] - clip.root()[f]), q.inverse() * next, (q * Vec3::Y).y)
}

fn same_turn(a: Quat, b: Quat) -> bool {
    kinelm_motion::rotation::angle_between(a, b) < 1e-6
}

/// Frames `from..` of `a` are those of `b` `moved` frames later, but for a shift and a turn about the vertical.
fn assert_same_but_moved(name: &str, a: &Clip, b: &Clip, from: usize, moved: usize) {
    for f in from..a.frames().min(b.frames().saturating_sub(moved)).saturating_sub(1) {
        for j in 1..24 {
            let (was, is) = (a.pose(f)[j], b.pose(f + moved)[j]);
            assert!(same_turn(was, is), "{name}: joint {j} at frame {f}, from {from}: {was} {is}");
        }
        let ((step_a, turn_a, tilt_a), (step_b, turn_b, tilt_b)) = (relative(a, f), relative(b, f + moved));
        assert!((step_a - step_b).length() < 1e-6, "{name}: step of frame {f}, from {from}: {step_a} {step_b}");
        assert!(same_turn(turn_a, turn_b) && (tilt_a - tilt_b).abs() < 1e-6, "{name}: turn of frame {f}");
    }
}

#[test]
fn a_changed_character_stays_in_its_word() {
    for (name, t) in &presets() {
        let l = t.frames_per_word();
        let clip = bent(3, 9 * l + 3);
        let words = t.encode(&clip).unwrap().words;
        let whole = t.decode(&words, UncodedPose::Identity).unwrap();
        let reach = t.scheme().reach();
        for seed in 0..40 {
            let mut random = Random(seed);
            let w = random.below(words.len());
            if words.word(w).is_empty() {
                continue;
            }
            let mut word = words.word(w).to_vec();
            let at = random.below(word.len());
            word[at] = random.below(t.vocabulary().characters() as usize) as u16;
            let mut changed = words.slice(0..w);
            changed.push(&word);
            words.slice(w + 1..words.len()).iter().for_each(|w| changed.push(w));
            let changed = t.decode(&changed, UncodedPose::Identity).unwrap();
            for f in 0..(w * l).saturating_sub(reach) {
                assert!((whole.root()[f] - changed.root()[f]).length() < 1e-9, "{name}: word {w} moves frame {f}");
                assert!((0..24).all(|j| same_turn(whole.pose(f)[j], changed.pose(f)[j])), "{name}: {w} turns {f}");
            }
            for f in (w + 1) * l + reach..whole.frames() {
                let same = (1..24).all(|j| same_turn(whole.pose(f)[j], changed.pose(f)[j]));
                assert!(same, "{name}: word {w} bends frame {f}");
            }
            // the step out of the word, or a whole tile's path, starts in the changed facing
            assert_same_but_moved(name, &whole, &changed, (w + 2) * l + reach, 0);
        }
    }
}

#[test]
fn a_changed_space_moves_what_follows_in_time() {
    for (name, t) in &presets() {
        if !matches!(t.word_length(), WordLength::Varying { .. }) {
            continue;
        }
        let (l, reach) = (t.frames_per_word(), t.scheme().reach());
        let words = t.encode(&bent(5, 9 * l)).unwrap().words;
        let ids = t.ids_of_words(&words).unwrap();
        let whole = t.decode(&words, UncodedPose::Identity).unwrap();
        let spaces: Vec<usize> = (0..ids.len()).filter(|&i| ids[i] == SPACE).collect();
        for w in 0..words.len() - 3 {
            let mut joined = ids.clone();
            joined.remove(spaces[w]);
            let joined = t.decode(&t.words_of_ids(&joined).words, UncodedPose::Identity).unwrap();
            assert_eq!(joined.frames() + l, whole.frames(), "{name}");
            assert_same_but_moved(name, &joined, &whole, (w + 2) * l + reach, l);
            let mut split = ids.clone();
            split.insert(spaces[w] - (spaces[w] - if w == 0 { 0 } else { spaces[w - 1] + 1 }) / 2, SPACE);
            let split = t.decode(&t.words_of_ids(&split).words, UncodedPose::Identity).unwrap();
            assert_eq!(split.frames(), whole.frames() + l, "{name}");
            assert_same_but_moved(name, &whole, &split, (w + 2) * l + reach, l);
        }
    }
}

/// One thread and eight give the same words.
#[test]
fn threads_change_nothing() {
    let clips: Vec<Clip> = (0..8).map(|seed| bent(seed, 100)).collect();
    for (name, t) in &presets() {
        let encode = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| clips.par_iter().map(|c| t.encode(c).unwrap()).collect::<Vec<_>>())
        };
        assert_eq!(encode(1), encode(8), "{name}");
    }
}

/// An artefact reads back as it was fitted, in every scheme.
#[test]
fn every_scheme_is_read_back() {
    for (name, t) in &presets() {
        assert_eq!(&Tokenizer::from_json(&t.to_json()).unwrap(), t, "{name}");
    }
}
