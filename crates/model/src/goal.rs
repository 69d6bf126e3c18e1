//! Goal conditioning: what a frame is to lead to, where characters are given later.
//!
//! The *goal* of a free character is the next given one in its slot, l frames from the previous frame (its own frame
//! included), unless that is further than [`FARTHEST`]. Characters that are steps of the root have another goal: the step
//! per frame that leads from where the root is now to where it is in the next frame in which all of it is given, one frame
//! away.
//!
//! A frame with goals has P = 4 C + 24 *numbers* ([`numbers`]): sin a, 1 - cos a, a, and 8 a / l for every slot, where a is
//! the distance from the code one frame back to the goal, in radians for circular slots and in hundredths of a bin for
//! others, 0 without a goal; 8 for the root: its displacement in x and z, cosine and sine of its rotation, 1/l, and the
//! displacement and rotation per frame, times ten; and a 1 in one of 16 buckets for the least l of all, two per doubling.
//! It also has two *rows* of tables of steps for every slot: the step to the goal, and that divided by l.
//!
//! Training, evaluation and generation all use [`GoalTrack::encode`].
//!
//! Letters: F frames, N frames of a batch, C characters of a frame, W = C + 1 its tokens, M numbers of music.

use super::config::{ModelConfig, TokenLayout};
use super::frames::Frames;
use crate::{Error, Result};
use kinelm_engine::op::embedding::NONE;
use kinelm_tokenizer::Tokenizer;
use kinelm_tokenizer::root_path::{ROOT_SLOTS, RootPath, RootState, STEP_SLOTS};
use std::ops::Range;

/// The most frames between a free character and its goal.
pub const FARTHEST: usize = 64;
/// Numbers for the root.
const ROOT: usize = 8;
/// Buckets for the frames left.
// l is at most FARTHEST + 1 = 65, so buckets 2 to 12 are in use; P stays, as it is part of a model's shape
const BUCKETS: usize = 16;
/// The distance of neighbouring bins of a slot that isn't circular.
const CLAMPED_BIN: f64 = 0.01;

/// P: conditioning numbers of a frame of `characters`.
pub fn numbers(characters: usize) -> usize {
    4 * characters + ROOT + BUCKETS
}

/// The conditioning of the N frames of a batch, window after window: goals and music.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Conditioning {
    /// (N, P), 0 for frames without goals; empty without goal conditioning.
    pub numbers: Vec<f32>,
    /// (N, W) each: rows of the tables of steps; [`NONE`] adds nothing. Empty without goal conditioning.
    pub rows: [Vec<u32>; 2],
    /// (N, M) of [`super::music`]; empty without music.
    pub music: Vec<f32>,
}

impl Conditioning {
    /// Frames without goals.
    pub fn none(frames: usize, characters: usize) -> Conditioning {
        let rows = [(); 2].map(|()| vec![NONE; frames * (characters + 1)]);
        Conditioning { numbers: vec![0.0; frames * numbers(characters)], rows, music: Vec::new() }
    }

    /// As many frames, without goals or music.
    pub fn none_like(&self) -> Conditioning {
        let rows = [(); 2].map(|()| vec![NONE; self.rows[0].len()]);
        Conditioning { numbers: vec![0.0; self.numbers.len()], rows, music: vec![0.0; self.music.len()] }
    }

    /// Some of `all` windows.
    pub fn windows(&self, windows: Range<usize>, all: usize) -> Conditioning {
        let part = |n: usize| windows.start * (n / all)..windows.end * (n / all);
        let rows = [0, 1].map(|i| self.rows[i][part(self.rows[i].len())].to_vec());
        let [numbers, music] = [&self.numbers, &self.music].map(|all| all[part(all.len())].to_vec());
        Conditioning { numbers, rows, music }
    }

    /// Appends frames.
    pub fn extend(&mut self, other: &Conditioning) {
        self.numbers.extend_from_slice(&other.numbers);
        self.music.extend_from_slice(&other.music);
        self.rows.iter_mut().zip(&other.rows).for_each(|(rows, other)| rows.extend_from_slice(other));
    }

    /// Checks that it fits the frames of `batch` windows of `length` tokens.
    ///
    /// # Errors
    /// If the model has no such conditioning, for another number of frames, or for rows beyond the tables.
    pub fn check(&self, config: &ModelConfig, tokens: &TokenLayout, batch: usize, length: usize) -> Result<()> {
        let is_ahead = !self.numbers.is_empty() || self.rows.iter().any(|rows| !rows.is_empty());
        if is_ahead && !config.goal {
            return Err(Error::unsupported("goal conditioning", "this model has model.goal = false"));
        }
        let frames = Frames::of(tokens);
        let steps = frames.steps().all();
        let n = batch * ((length + 1).saturating_sub(tokens.front)).div_ceil(tokens.word);
        let m = n * config.music.numbers();
        if !self.music.is_empty() && m == 0 {
            return Err(Error::unsupported("music conditioning", "this model has model.music = \"none\""));
        }
        if !self.music.is_empty() && self.music.len() != m {
            let found = self.music.len();
            return Err(Error::invalid(format!("the music of {n} frames"), format!("{found} numbers"), m.to_string()));
        }
        let is = (self.numbers.len(), self.rows[0].len(), self.rows[1].len());
        let expected = (n * numbers(frames.characters()), n * tokens.word, n * tokens.word);
        if is_ahead && is != expected {
            let (found, expected) = (format!("{is:?} numbers and rows"), format!("{expected:?}"));
            return Err(Error::invalid(format!("the goals of {n} frames"), found, expected));
        }
        match self.rows.iter().flatten().find(|&&row| row != NONE && row as usize >= steps) {
            Some(row) => Err(Error::invalid("a row of steps", row, format!("a row below {steps}"))),
            None => Ok(()),
        }
    }
}

/// Reads frames of a tokenizer for goals.
#[derive(Debug, Clone)]
pub struct GoalEncoder {
    frames: Frames,
    root_path: RootPath,
}

impl GoalEncoder {
    /// For a tokenizer whose codes are steps of the root.
    ///
    /// # Errors
    /// For other tokenizers, with what is wrong.
    pub fn of(tokenizer: &Tokenizer) -> Result<GoalEncoder> {
        let root_path = RootPath::of(tokenizer).map_err(|e| Error::unsupported("model.goal = true", e.to_string()))?;
        Ok(GoalEncoder { frames: Frames::of(&TokenLayout::of(tokenizer)), root_path })
    }

    /// C: characters of a frame.
    pub fn characters(&self) -> usize {
        self.frames.characters()
    }

    /// Codes of the ids of whole words with their spaces, (F W) -> (F, C); 0 for ids that are no bin of their slot.
    pub fn codes(&self, ids: &[u32]) -> Vec<u16> {
        let (word, places) = (self.frames.word(), self.frames.places());
        let of_word = |ids: &[u32]| -> Vec<u16> {
            places.iter().zip(ids).map(|(place, &id)| place.bin(id).unwrap_or(0) as u16).collect()
        };
        ids.chunks_exact(word).flat_map(of_word).collect()
    }

    /// The root's state before the first word.
    pub(crate) fn start(&self) -> RootState {
        self.root_path.start()
    }

    /// Advances the root by a word's codes (C).
    pub(crate) fn follow(&self, stand: &mut RootState, word: &[u16]) {
        self.root_path.follow(stand, word);
    }
}

/// Frames of which some characters are given, as goals for the frames before them.
#[derive(Debug)]
pub struct GoalTrack {
    encoder: GoalEncoder,
    /// (F, C).
    codes: Vec<u16>,
    /// (F, C).
    given: Vec<bool>,
    /// (F, C): frames up to the next given character in the slot, 0 where none is near.
    next: Vec<u8>,
    /// (F): frames up to the next one in which all of the root is given, likewise.
    next_root: Vec<u8>,
    /// (F): the root's state after each frame.
    stands: Vec<RootState>,
}

/// The goal of a character.
#[derive(Clone, Copy)]
struct Goal {
    code: i64,
    /// l.
    left: f64,
}

impl GoalTrack {
    /// A track of `codes` (F, C), of which some are `given` (F, C); the first `lead_in` frames don't move the root.
    ///
    /// # Panics
    /// If there aren't as many of both, or no whole frames.
    pub fn new(encoder: GoalEncoder, codes: Vec<u16>, given: Vec<bool>, lead_in: usize) -> GoalTrack {
        let c = encoder.characters();
        assert!(codes.len() == given.len() && codes.len().is_multiple_of(c), "codes of whole frames");
        let frames = codes.len() / c;
        let mut stand = encoder.start();
        let stands = codes.chunks_exact(c).enumerate().map(|(frame, word)| {
            if frame >= lead_in {
                encoder.follow(&mut stand, word);
            }
            stand.clone()
        });
        let stands = stands.collect();
        let root = |frame: usize| given[frame * c..][..ROOT_SLOTS].iter().all(|is| *is);
        let next_root = until(frames, 1, |frame, _| root(frame));
        let next = until(frames, c, |frame, place| given[frame * c + place]);
        GoalTrack { encoder, codes, given, next, next_root, stands }
    }

    /// F.
    pub fn frames(&self) -> usize {
        self.next_root.len()
    }

    /// C.
    pub fn characters(&self) -> usize {
        self.encoder.characters()
    }

    /// Codes of the ids of whole words with their spaces, (F W) -> (F, C); 0 for ids that are no bin of their slot.
    pub fn codes(&self, ids: &[u32]) -> Vec<u16> {
        self.encoder.codes(ids)
    }

    /// Whether some character has a goal.
    pub fn has_goals(&self) -> bool {
        self.given.iter().zip(&self.next).any(|(given, next)| !given && *next > 0)
    }

    /// The root's state after a frame: the given one, else where the codes (C) lead from the state `before`; `None` if that
    /// is unknown.
    pub fn stand(&self, frame: usize, word: &[u16], before: Option<&RootState>) -> Option<RootState> {
        if frame < self.frames() && self.root_is_given(frame) {
            return Some(self.stands[frame].clone());
        }
        let mut stand = before?.clone();
        self.encoder.follow(&mut stand, word);
        Some(stand)
    }

    /// Whether all of the root is given in a frame.
    fn root_is_given(&self, frame: usize) -> bool {
        self.given[frame * self.characters()..][..ROOT_SLOTS].iter().all(|is| *is)
    }

    /// Writes the goals of a frame into `numbers` (P) and the rows (C or more); returns whether it has any. They depend on the
    /// codes of the previous frame (C), and on the root's state after it, if that is known.
    pub fn encode(
        &self,
        frame: usize,
        word: &[u16],
        stand: Option<&RootState>,
        numbers: &mut [f32],
        [steps, paces]: [&mut [u32]; 2],
    ) -> bool {
        numbers.fill(0.0);
        [&mut *steps, &mut *paces].into_iter().for_each(|rows| rows.fill(NONE));
        if frame >= self.frames() {
            return false;
        }
        let (c, root) = (self.characters(), stand.and_then(|stand| self.way(frame, stand)));
        let mut least = root.map_or(f64::INFINITY, |(_, left)| left);
        let whole = root.map(|(way, left)| self.encoder.root_path.step_codes(way.map(|way| way / left)));
        for place in 0..c {
            let step = STEP_SLOTS.iter().position(|&at| at == place);
            let Some(goal) = (match step {
                Some(step) => whole.map(|codes| Goal { code: codes[step].round_ties_even() as i64, left: 1.0 }),
                None => self.goal(frame, place).inspect(|goal| least = least.min(goal.left)),
            }) else {
                continue;
            };
            let (bins, all) = (self.encoder.frames.places()[place], self.encoder.frames.steps());
            let (d, angle) = distance(goal.code, word[place].into(), (bins.count.into(), bins.circular));
            for (i, number) in [angle.sin(), 1.0 - angle.cos(), angle, 8.0 * angle / goal.left].into_iter().enumerate()
            {
                numbers[i * c + place] = number as f32;
            }
            // d is at most half a circle or a clamped slot's bins less one, so it has a row
            steps[place] = all.row_by(bins, d) as u32;
            paces[place] = all.row_by(bins, (d as f64 / goal.left).round_ties_even() as i64) as u32;
        }
        if least.is_infinite() {
            return false;
        }
        if let Some(([x, z, turn], left)) = root {
            let all = [x, z, turn.cos(), turn.sin(), 1.0 / left, 10.0 * x / left, 10.0 * z / left, 10.0 * turn / left];
            numbers[4 * c..].iter_mut().zip(all).for_each(|(number, x)| *number = x as f32);
        }
        let bucket = ((2.0 * least.log2()) as usize).min(BUCKETS - 1);
        numbers[4 * c + ROOT + bucket] = 1.0;
        true
    }

    /// The goal of a free character.
    fn goal(&self, frame: usize, place: usize) -> Option<Goal> {
        let at = frame * self.characters() + place;
        let encoder = usize::from(self.next[at]);
        let is_goal = !self.given[at] && encoder > 0;
        is_goal.then(|| Goal { code: self.codes[at + encoder * self.characters()].into(), left: (encoder + 1) as f64 })
    }

    /// The root's displacement to where it is given next, and the frames left, where its steps are free.
    fn way(&self, frame: usize, stand: &RootState) -> Option<([f64; 3], f64)> {
        let given = &self.given[frame * self.characters()..];
        let encoder = usize::from(self.next_root[frame]);
        // a root of which one step is given can't take the even step to its goal
        let is_free = encoder > 0 && STEP_SLOTS.iter().all(|&place| !given[place]);
        is_free.then(|| (stand.step_to(&self.stands[frame + encoder]), (encoder + 1) as f64))
    }

    /// The conditioning of the first `frames` by the track's own codes; the first frame has no goals.
    pub fn conditioning(&self, frames: usize) -> Conditioning {
        let c = self.characters();
        let mut conditioning = Conditioning::none(frames, c);
        let Conditioning { numbers: all, rows: [steps, paces], .. } = &mut conditioning;
        let parts =
            all.chunks_exact_mut(numbers(c)).zip(steps.chunks_exact_mut(c + 1)).zip(paces.chunks_exact_mut(c + 1));
        for (frame, ((numbers, steps), paces)) in parts.enumerate().take(self.frames()).skip(1) {
            let before = &self.codes[(frame - 1) * c..][..c];
            self.encode(frame, before, Some(&self.stands[frame - 1]), numbers, [steps, paces]);
        }
        conditioning
    }
}

/// (F, n): frames up to the next later one in which `is` holds for the column; 0 where none is within reach.
fn until(frames: usize, n: usize, is: impl Fn(usize, usize) -> bool) -> Vec<u8> {
    let mut next = vec![0u8; frames * n];
    // backwards, so that each frame takes its successor's count plus one
    for frame in (0..frames.saturating_sub(1)).rev() {
        for column in 0..n {
            next[frame * n + column] = match next[(frame + 1) * n + column] {
                _ if is(frame + 1, column) => 1,
                far if (1..FARTHEST).contains(&usize::from(far)) => far + 1,
                _ => 0,
            };
        }
    }
    next
}

/// The distance from a code to a goal in a slot of `bins` bins: in bins, and as an angle.
fn distance(goal: i64, from: i64, (bins, circular): (i64, bool)) -> (i64, f64) {
    match circular {
        true => {
            // the short way round, -bins/2 up to below bins/2
            let d = (goal - from + bins / 2).rem_euclid(bins) - bins / 2;
            (d, d as f64 * std::f64::consts::TAU / bins as f64)
        }
        false => {
            // a root's even step may be beyond what a slot can say
            let d = goal.clamp(0, bins - 1) - from;
            (d, d as f64 * CLAMPED_BIN)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_tokenizer::{RootRotation, TokenizerConfig};
    use serde_json::Value;

    /// Of f32 against f64, of numbers up to some tens.
    const BOUND: f64 = 1e-4;

    const TOKENIZER: &str = include_str!("../tests/golden/ahead_tokenizer.json");

    fn tokenizer() -> Tokenizer {
        Tokenizer::from_json(TOKENIZER).unwrap()
    }

    fn encoder() -> GoalEncoder {
        GoalEncoder::of(&tokenizer()).unwrap()
    }

    #[test]
    fn gaps_are_told_what_numpy_tells_them() {
        let golden: Value = serde_json::from_str(include_str!("../tests/golden/ahead.json")).unwrap();
        let codes: Vec<Vec<u16>> = serde_json::from_value(golden["codes"].clone()).unwrap();
        let gaps: Vec<(usize, usize)> = serde_json::from_value(golden["gaps"].clone()).unwrap();
        let free = |frame: usize| gaps.iter().any(|(start, end)| (*start..*end).contains(&frame));
        let given = (0..codes.len()).flat_map(|frame| [!free(frame); 9]).collect();
        let conditioning = GoalTrack::new(encoder(), codes.concat(), given, 0).conditioning(codes.len());
        let p = numbers(9);
        let mut expected = 0;
        for frame in golden["frames"].as_array().unwrap() {
            let at = frame["frame"].as_u64().unwrap() as usize;
            let truth: Vec<f64> = serde_json::from_value(frame["numbers"].clone()).unwrap();
            assert_eq!(truth.len(), p);
            for (i, (found, truth)) in conditioning.numbers[at * p..][..p].iter().zip(&truth).enumerate() {
                assert!((f64::from(*found) - truth).abs() < BOUND, "frame {at}, number {i}: {found}, expected {truth}");
            }
            let rows: [Vec<u32>; 2] = serde_json::from_value(frame["rows"].clone()).unwrap();
            for (found, rows) in conditioning.rows.iter().zip(&rows) {
                assert_eq!((&found[at * 10..][..9], found[at * 10 + 9]), (&rows[..], NONE), "frame {at}");
            }
            expected += 1;
        }
        let found = conditioning.numbers.chunks(p).filter(|numbers| numbers.iter().any(|x| *x != 0.0)).count();
        assert_eq!((found, expected), (11 + 57 + 2 + 9, 79));
    }

    #[test]
    fn places_have_goals_of_their_own_and_none_too_far() {
        // the root given throughout, the knee's x free up to frame 5, its y from frame 2 on, its z up to frame 99
        let frames = 120;
        let is_given = |frame: usize, place: usize| match place {
            6 => frame == 0 || frame >= 5,
            7 => frame < 2,
            8 => frame == 0 || frame >= 99,
            _ => true,
        };
        let given: Vec<bool> = (0..frames).flat_map(|f| (0..9).map(move |p| is_given(f, p))).collect();
        let codes: Vec<u16> = (0..frames as u16).flat_map(|f| (0..9).map(move |p| (f + p) % 40)).collect();
        let course = GoalTrack::new(encoder(), codes, given, 0);
        assert!(course.has_goals());
        let conditioning = course.conditioning(frames);
        let goals = |frame: usize| -> Vec<usize> {
            (0..9).filter(|place| conditioning.rows.iter().all(|rows| rows[frame * 10 + place] != NONE)).collect()
        };
        assert_eq!((goals(0), goals(1), goals(4), goals(5)), (vec![], vec![6], vec![6], vec![]));
        assert_eq!((goals(34), goals(35), goals(98), goals(99)), (vec![], vec![8], vec![8], vec![]));
        // no root, the bucket of 2 frames
        let p = numbers(9);
        let of_frame = &conditioning.numbers[4 * p..][..p];
        assert!(of_frame[36..44].iter().all(|x| *x == 0.0) && of_frame[44 + 2] == 1.0);
        let none = GoalTrack::new(encoder(), vec![0; 27], vec![true; 27], 0);
        assert!(!none.has_goals());
        assert_eq!(none.conditioning(5), Conditioning::none(5, 9));
    }

    #[test]
    fn the_root_stands_as_given_else_where_codes_lead() {
        let codes: Vec<u16> = (0..8u16).flat_map(|f| [20 + f % 3, 20, 22, 19, 20, 20, 7, 7, 7]).collect();
        let given: Vec<bool> = (0..8).flat_map(|f| [!(3..5).contains(&f) && f > 0; 9]).collect();
        let course = GoalTrack::new(encoder(), codes.clone(), given, 1);
        let is = |stand: &RootState, frame: usize| stand.step_to(&course.stands[frame]).iter().all(|x| x.abs() < 1e-9);
        // nothing is known before something is given
        assert!(course.stand(0, &codes[..9], None).is_none());
        assert!(is(&course.stand(2, &[0; 9], None).unwrap(), 2));
        let drawn = course.stand(3, &[30; 9], Some(&course.stands[2])).unwrap();
        assert!(!is(&drawn, 3));
        assert!(is(&course.stand(3, &codes[27..36], Some(&course.stands[2])).unwrap(), 3));
        assert!(is(&course.stand(5, &[30; 9], Some(&drawn)).unwrap(), 5));
        // a gap that begins without a known root has no goal of the root
        let (mut numbers, mut rows) = (vec![0.0; numbers(9)], [vec![0; 10], vec![0; 10]]);
        let [a, b] = &mut rows;
        assert!(course.encode(3, &codes[18..27], None, &mut numbers, [a, b]));
        assert!(rows[0][0] == NONE && rows[0][1] != NONE && numbers[36..44].iter().all(|x| *x == 0.0));
    }

    #[test]
    fn batches_are_cut_and_joined() {
        let mut all = Conditioning::none(2, 2);
        let other =
            Conditioning { numbers: vec![1.0; 2 * numbers(2)], rows: [vec![3; 6], vec![4; 6]], music: Vec::new() };
        all.extend(&other);
        assert_eq!(all.windows(1..2, 2), other);
        assert_eq!((all.windows(0..1, 2), other.none_like()), (Conditioning::none(2, 2), Conditioning::none(2, 2)));
    }

    #[test]
    fn other_tokenizers_are_refused() {
        let walk = kinelm_corpus::samples::walk(5);
        let config =
            TokenizerConfig { root_rotation: RootRotation::Absolute, ..TokenizerConfig::uniform(&[0], 20.0, 10) };
        let said = GoalEncoder::of(&Tokenizer::fit([&walk], config).unwrap()).unwrap_err().to_string();
        assert!(said.contains("model.goal = true") && said.contains("heading_delta"), "{said}");
    }
}
