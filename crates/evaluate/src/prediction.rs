//! How well a model predicts the next 400 ms: docs/measures.md, "Short-term prediction".
//!
//! Clips are cut into windows of 3 s that begin 2 s apart; of each the first 2 s are the seed and the next 0.4 s the
//! target. The model sees as many of the seed's last words as its context has room for beside the target's. Targets are
//! the clips as they are, not as they are coded.

use crate::{Error, Result};
use kinelm_corpus::Conditions;
use kinelm_generate::sampling::Sampling;
use kinelm_generate::{NextToken, SamplingPlan, sample, unwatched, variation_seed};
use kinelm_motion::metric::ShortTerm;
use kinelm_motion::metric::short_term::HorizonMetrics;
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::{Clip, Quat};
use kinelm_tokenizer::{Tokenizer, UncodedPose, Words};
use serde::Serialize;

/// Lengths of a window, its seed and its target, and the hop from one window to the next, seconds.
const WINDOW_S: f64 = 3.0;
const SEED_S: f64 = 2.0;
const TARGET_S: f64 = 0.4;
const STRIDE_S: f64 = 2.0;
/// The horizons up to which errors are summed, milliseconds.
pub(crate) const TIMES_MS: [u32; 4] = [100, 200, 300, 400];

/// A seed and what follows it.
#[derive(Debug, Clone)]
pub struct Window {
    /// Two seconds.
    pub seed: Clip,
    /// The 400 ms after it.
    pub target: Clip,
}

/// The windows of a clip; none of one that is shorter than a window.
pub fn windows(clip: &Clip) -> Vec<Window> {
    let frames = |seconds: f64| (seconds * clip.fps()).round() as usize;
    let (window, seed, target) = (frames(WINDOW_S), frames(SEED_S), frames(TARGET_S));
    let starts = (0..(clip.frames() + 1).saturating_sub(window.max(1))).step_by(frames(STRIDE_S).max(1));
    let of = |start: usize| Window {
        seed: clip.slice(start..start + seed),
        target: clip.slice(start + seed..start + seed + target),
    };
    starts.map(of).collect()
}

/// The metrics of one predictor.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Its name.
    pub name: String,
    /// Frames per second that it was measured at; sums are brought to 60.
    pub fps: f64,
    /// Windows.
    pub windows: usize,
    /// Joints, of the protocol's 15.
    pub joints: usize,
    /// Up to 100, 200, 300 and 400 ms.
    pub up_to: Vec<HorizonMetrics>,
}

impl Row {
    fn of(name: &str, fps: f64, found: &ShortTerm) -> Result<Row> {
        let up_to = found.figures(&TIMES_MS).ok_or_else(no_window)?;
        Ok(Row { name: name.into(), fps, windows: found.windows(), joints: found.joints().len(), up_to })
    }
}

fn no_window() -> Error {
    Error::missing("clip as long as a window", "short-term prediction is measured in windows of 3 s")
}

/// The last pose, for as long as the target takes.
pub(crate) fn zero_velocity(window: &Window) -> Result<Clip> {
    extrapolate(window, |_, last, _| last)
}

/// The last step of every joint, again and again.
pub(crate) fn constant_velocity(window: &Window) -> Result<Clip> {
    extrapolate(window, |before, last, n| {
        let step = before.conjugate() * last;
        // renormalised at each step: a product of many quaternions drifts off unit length
        (0..n).fold(last, |q, _| (q * step).normalize())
    })
}

/// Every joint's rotation n frames after the seed, from its last two.
fn extrapolate(window: &Window, at: impl Fn(Quat, Quat, usize) -> Quat) -> Result<Clip> {
    let (seed, target) = (&window.seed, &window.target);
    let last = seed.frames().checked_sub(1).ok_or_else(no_window)?;
    // a seed of one frame has no velocity: both are that frame
    let (a, b) = (seed.pose(last.saturating_sub(1)), seed.pose(last));
    let rotations = (1..=target.frames()).flat_map(|n| a.iter().zip(b).map(move |(a, b)| (n, *a, *b)));
    let rotations = rotations.map(|(n, a, b)| at(a, b, n)).collect();
    Ok(Clip::new(seed.skeleton().clone(), seed.fps(), vec![seed.root()[last]; target.frames()], rotations)?)
}

/// Rows of zero and of constant velocity, over those of the protocol's 15 joints that are among `joints`.
///
/// # Errors
/// No windows; none of the joints.
pub fn baselines(windows: &[Window], joints: &[usize], what: &str) -> Result<Vec<Row>> {
    let Some(first) = windows.first() else { return Err(no_window()) };
    let (fps, frames) = (first.target.fps(), first.target.frames());
    let row = |name: &str, predict: fn(&Window) -> Result<Clip>| {
        let mut found = ShortTerm::new(joints, fps, frames)?;
        windows.iter().try_for_each(|w| Ok::<_, Error>(found.add(&w.target, &predict(w)?)?))?;
        Row::of(&format!("{name}{what}"), fps, &found)
    };
    Ok(vec![row("zero velocity", zero_velocity)?, row("constant velocity", constant_velocity)?])
}

/// A model that predicts.
pub struct Predictor<'a> {
    /// Reads one sequence.
    pub greedy: &'a mut dyn NextToken,
    /// Reads k sequences; `None`: nothing is sampled.
    pub samples: Option<&'a mut dyn NextToken>,
    /// Its tokenizer.
    pub tokenizer: &'a Tokenizer,
    /// Its conditions; every label is unknown.
    pub conditions: &'a Conditions,
    /// How tokens are sampled.
    pub draw: Sampling,
    /// Their seed; every window has one of its own, made from it.
    pub seed: u64,
}

impl Predictor<'_> {
    /// How many of a seed's last words the model sees: as many as fit beside the target's.
    pub(crate) fn seen(&self, seed_words: usize, words: usize) -> usize {
        let Some(word) = self.tokenizer.tokens_per_word() else { return seed_words };
        // one more than the context: the last token is sampled and never read
        let room = (self.greedy.context() + 1).saturating_sub(self.conditions.len()) / word;
        // half of the room is the seed's, however long the target
        seed_words.min(room.saturating_sub(words - seed_words).max(room / 2).max(1))
    }

    /// Seconds of a seed that the model sees.
    pub fn context_seconds(&self) -> f64 {
        let length = self.tokenizer.frames_per_word();
        let frames = |seconds: f64| (seconds * self.tokenizer.fps()).round() as usize;
        // a seed's last words may depend on frames that the model is to predict
        let known = (frames(SEED_S) / length).saturating_sub(self.tokenizer.scheme().unsettled_words());
        let all = (frames(SEED_S) + frames(TARGET_S)).div_ceil(length);
        (self.seen(known, all) * length) as f64 / self.tokenizer.fps()
    }

    /// Rows of greedy continuation, of samples, and of the best of the samples of each window, by the angle up to 400 ms.
    /// `progress` gets the number of windows done.
    ///
    /// # Errors
    /// What coding and generating fail with; no windows.
    pub fn rows(&mut self, windows: &[Window], progress: &mut dyn FnMut(usize)) -> Result<Vec<Row>> {
        let Some(first) = windows.first() else { return Err(no_window()) };
        let (fps, frames) = (first.target.fps(), first.target.frames());
        let empty = || ShortTerm::new(self.tokenizer.channels().joints(), fps, frames);
        let (mut greedy, mut samples, mut best) = (empty()?, empty()?, empty()?);
        let k = self.samples.as_ref().map_or(0, |s| s.streams());
        for (i, window) in windows.iter().enumerate() {
            let found = self.predict(window, i, false)?;
            greedy.add(&window.target, &found[0])?;
            let found = if k > 0 { self.predict(window, i, true)? } else { Vec::new() };
            let mut errors = Vec::new();
            for clip in &found {
                let mut one = empty()?;
                one.add(&window.target, clip)?;
                errors.push(one.angles(TIMES_MS[3])[0]);
                samples.add(&window.target, clip)?;
            }
            if let Some(at) = (0..errors.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b])) {
                best.add(&window.target, &found[at])?;
            }
            progress(i + 1);
        }
        let mut rows = vec![Row::of("the model, greedy", fps, &greedy)?];
        if best.windows() > 0 {
            // each sample counts as a window there
            rows.push(Row { windows: best.windows(), ..Row::of("the model, samples", fps, &samples)? });
            rows.push(Row::of(&format!("the model, best of {k} samples"), fps, &best)?);
        }
        Ok(rows)
    }

    /// The frames of a window's target, sampled.
    fn predict(&mut self, window: &Window, index: usize, sampled: bool) -> Result<Vec<Clip>> {
        let (tokenizer, length) = (self.tokenizer, self.tokenizer.frames_per_word());
        let (seed, target) = (window.seed.frames(), window.target.frames());
        let whole = seed / length * length;
        let words = tokenizer.encode(&window.seed.slice(0..whole))?.words;
        let known = words.len().saturating_sub(tokenizer.scheme().unsettled_words());
        let all = (seed + target).div_ceil(length);
        let seen = self.seen(known, all);
        let beginning = tokenizer.ids_of_words(&words.slice(known - seen..known))?;
        let front = self.conditions.unknown().front(&Default::default());
        let (draw, model) = match (sampled, &mut self.samples) {
            (true, Some(samples)) => (self.draw, &mut **samples),
            _ => (Sampling::greedy(), &mut *self.greedy),
        };
        let plan =
            SamplingPlan::free(tokenizer.grammar(), all - (known - seen), draw, variation_seed(self.seed, index));
        let plan = SamplingPlan { beginnings: vec![beginning], fronts: vec![(0, front)], ..plan };
        let danced = sample(model, &plan, &mut unwatched)?;
        let before = tokenizer.ids_of_words(&words.slice(0..known - seen))?;
        let clip = |ids: &Vec<u32>| {
            let words: Words = tokenizer.words_of_ids(&[before.as_slice(), ids].concat()).words;
            Ok(tokenizer.decode(&words, UncodedPose::Identity)?.slice(seed..seed + target))
        };
        danced.ids.iter().map(clip).collect()
    }
}

/// Frames per second of the protocol.
pub const PROTOCOL_FPS: f64 = 60.0;

/// The windows of a clip at the model's rate, if there is a model, and at `fps` where the clip has that many frames a second
/// and the model another rate.
///
/// # Errors
/// Those of [`resample`].
pub fn windows_at(clip: &Clip, model_fps: Option<f64>, fps: f64) -> Result<[Vec<Window>; 2]> {
    let at = |fps: f64| Ok::<_, Error>(windows(&resample(clip, fps, Method::Auto)?));
    let own = model_fps.map(at).transpose()?.unwrap_or_default();
    let is_protocol = model_fps.is_none_or(|model| model != fps) && clip.fps() >= fps;
    Ok([own, if is_protocol { at(fps)? } else { Vec::new() }])
}

/// `most` of the windows, spread evenly; 0: all.
pub fn spread(all: Vec<Window>, most: usize) -> Vec<Window> {
    match most {
        0 => all,
        most if most >= all.len() => all,
        most => (0..most).map(|i| all[i * all.len() / most].clone()).collect(),
    }
}

/// A table of rows at a rate for a terminal.
pub fn table(rows: &[Row], fps: f64) -> String {
    let first = &rows[0];
    let mut text = format!("{} windows, {} of the protocol's 15 joints", first.windows, first.joints);
    if fps != PROTOCOL_FPS {
        text += &format!("; at {fps} fps, sums as {fps} fps x {:.3}", PROTOCOL_FPS / fps);
    }
    text += "\nsums up to a time: Euler angles rad (compat, and fixed: differences around the circle), global angle rad, \
             place thigh lengths; area under the curve of correct places\n";
    text += &format!("{:<42}", "ms");
    for what in ["Euler", "fixed", "angle", "place", "AUC"] {
        for ms in TIMES_MS {
            text += &format!(" {:>9}", format!("{what} {ms}"));
        }
    }
    for row in rows {
        text += &format!("\n{:<42}", row.name);
        let columns: [fn(&HorizonMetrics) -> f64; 5] =
            [|u| u.euler, |u| u.euler_fixed, |u| u.angle, |u| u.position, |u| u.auc];
        for of in columns {
            row.up_to.iter().for_each(|u| text += &format!(" {:>9.3}", of(u)));
        }
    }
    text + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_generate::NextToken;
    use kinelm_model::Logits;
    use kinelm_motion::{Vec3, smpl, synth};
    use kinelm_tokenizer::TokenizerConfig;

    /// Every joint turns at one rate about an axis of its own.
    fn turning(frames: usize, fps: f64) -> Clip {
        let rate = |j: usize| 0.2 + 0.02 * j as f64;
        let axis = |j: usize| Vec3::new(1.0, j as f64, 2.0).normalize();
        let rotations = (0..frames).flat_map(|f| (0..24).map(move |j| (f, j)));
        let rotations = rotations.map(|(f, j)| Quat::from_axis_angle(axis(j), rate(j) * f as f64 / fps)).collect();
        Clip::new(smpl::neutral(), fps, vec![Vec3::Y; frames], rotations).unwrap()
    }

    #[test]
    fn windows_are_those_of_the_protocol() {
        let found = windows(&turning(420, 60.0));
        // 420 frames: windows of 180 begin at 0, 120 and 240
        assert_eq!(found.len(), 3);
        assert!(found.iter().all(|w| (w.seed.frames(), w.target.frames()) == (120, 24)));
        assert_eq!(found[1].target.pose(0), turning(420, 60.0).pose(240));
        assert_eq!((windows(&turning(179, 60.0)).len(), windows(&turning(60, 20.0)).len()), (0, 1));
        assert_eq!(windows(&turning(60, 20.0))[0].target.frames(), 8);
    }

    #[test]
    fn constant_velocity_predicts_a_steady_turn() {
        let all: Vec<usize> = (0..24).collect();
        for fps in [60.0, 20.0] {
            let rows = baselines(&windows(&turning(400, fps)), &all, "").unwrap();
            let [still, on] = &rows[..] else { panic!() };
            assert!(on.up_to.iter().all(|u| u.angle < 1e-6 && u.euler_fixed < 1e-6 && u.auc > 0.999), "{on:?}");
            assert!(still.up_to[0].angle > 0.05 && still.up_to[3].angle > still.up_to[0].angle, "{still:?}");
            assert_eq!((still.joints, still.up_to[3].frames), (15, (0.4 * fps) as usize));
        }
        assert!(baselines(&[], &all, "").is_err());
    }

    /// Wants what stood a word before.
    struct Parrot {
        read: Vec<Vec<u32>>,
        word: usize,
        vocabulary: usize,
    }

    impl NextToken for Parrot {
        fn context(&self) -> usize {
            14 * self.word
        }

        fn streams(&self) -> usize {
            self.read.len()
        }

        fn is_exact(&self) -> bool {
            true
        }

        fn truncate(&mut self, stream: usize, length: usize) {
            self.read[stream].truncate(length);
        }

        fn read(&mut self, blocks: &[&[u32]], wanted: Logits, logits: &mut Vec<f32>) -> Result<()> {
            logits.clear();
            for (read, block) in self.read.iter_mut().zip(blocks) {
                for (i, id) in block.iter().enumerate() {
                    read.push(*id);
                    if wanted == Logits::All || i + 1 == block.len() {
                        let before = (read.len() + 1).checked_sub(self.word + 1).map(|at| read[at]);
                        logits
                            .extend((0..self.vocabulary as u32).map(|id| if Some(id) == before { 50.0 } else { 0.0 }));
                    }
                }
            }
            Ok(())
        }
    }

    #[test]
    fn a_model_that_repeats_the_last_word_stands_still() {
        let joints = [0, 1, 2, 4, 5, 16, 17, 18, 19];
        let dances: Vec<Clip> = synth::corpus(4, 2, 8.0, 20.0).unwrap().into_iter().map(|d| d.clip).collect();
        let tokenizer = Tokenizer::fit(&dances, TokenizerConfig::uniform(&joints, 20.0, 2000)).unwrap();
        let windows: Vec<Window> = dances.iter().flat_map(windows).collect();
        let word = tokenizer.tokens_per_word().unwrap();
        let parrot =
            |streams| Parrot { read: vec![vec![]; streams], word, vocabulary: tokenizer.vocabulary().len() as usize };
        let (mut one, mut three) = (parrot(1), parrot(3));
        let mut predictor = Predictor {
            greedy: &mut one,
            samples: Some(&mut three),
            tokenizer: &tokenizer,
            conditions: &Conditions::none(),
            draw: Sampling::default(),
            seed: 1,
        };
        // 14 words fit: eight of the target leave six, but the seed has half of them at least
        assert!((predictor.context_seconds() - 7.0 / 20.0).abs() < 0.051);
        let mut done = Vec::new();
        let rows = predictor.rows(&windows, &mut |n| done.push(n)).unwrap();
        let still = &baselines(&windows, &joints, "").unwrap()[0];
        assert_eq!((rows.len(), done.last(), rows[1].windows), (3, Some(&windows.len()), windows.len()));
        for row in &rows {
            for (a, b) in row.up_to.iter().zip(&still.up_to) {
                // bins of 0.18 degrees
                assert!((a.angle - b.angle).abs() < 0.02 * b.angle + 0.1, "{a:?} {b:?}");
            }
        }
    }
}
