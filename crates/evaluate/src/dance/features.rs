//! Dances and real ones as clouds of features, and the distances between them: docs/referee.md.

use super::coded::Dance;
use super::frechet::{Rows, SetDistance, Standardizer};
use super::reference::Reference;
use crate::Result;
use crate::number::number;
use kinelm_corpus::Split;
use kinelm_motion::metric::features::{COMPAT_FPS, Formulas, JointPositions, geometric, kinetic};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::{Clip, Vec3};
use kinelm_store::random;
use rayon::prelude::*;
use serde::Serialize;
use std::fmt;

/// Length of a window and the hop to the next, seconds.
const WINDOW_S: f64 = 5.0;
const HOP_S: f64 = 2.5;
/// Frames of a clip that published code reads, at most.
const COMPAT_FRAMES: usize = 1200;
/// Standard deviation of the noise of the worst control set, metres.
const NOISE_M: f64 = 0.05;
/// The seed of noise and of random subsets.
const SEED: u64 = 1;

/// One kind of features in one form.
#[derive(Debug, Clone, Serialize)]
pub struct Features {
    /// `kinetic` or `geometric`.
    pub kind: &'static str,
    /// `fixed` or `compat`.
    pub form: &'static str,
    /// Features that don't vary over the real train clips and are left out.
    pub left_out: Vec<usize>,
    /// Diversity of the real train clips.
    pub real_diversity: Option<f64>,
    /// Sets compared with the real train clips: other real ones, altered real ones, the dances.
    pub sets: Vec<(String, SetDistance)>,
    /// The size to which larger sets were sampled, spread evenly; `None` where none is larger.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub most_vectors: Option<usize>,
}

/// Vectors of a set at most, of larger ones a sample that is spread evenly: one vector is of 5 s, or of a clip.
const MOST: usize = 4_000;

/// What is done to clips before their features are taken.
#[derive(Clone, Copy, PartialEq)]
enum Alteration {
    Nothing,
    Reversed,
    Noise,
}

/// The four tables: kinetic and geometric features, `fixed` and `compat`. The real train clips, the other real ones, and sets
/// by their names.
///
/// # Errors
/// Words that can't be decoded; what resampling and features fail with.
pub fn features(reference: &Reference, sets: &[(&str, &[Dance])]) -> Result<Vec<Features>> {
    let mut tables = Vec::new();
    for (form, form_name) in [(Formulas::Fixed, "fixed"), (Formulas::Compat, "compat")] {
        let of_split = |split| {
            let corpus = reference.corpus();
            Pieces::of(corpus.split(split).map(|clip| clip.frames), corpus.tokenizer().fps(), form)
        };
        let pieces = of_split(Split::Train);
        let all_done = |i, dance: &Dance| -> Result<[Vec<Vector>; 3]> {
            let [real, reversed, noise] = [Alteration::Nothing, Alteration::Reversed, Alteration::Noise]
                .map(|done| pieces.vectors(i, dance, done));
            Ok([real?, reversed?, noise?])
        };
        let mut train: [Vec<(usize, Vector)>; 3] = Default::default();
        let mut clip = 0;
        reference.fold(Split::Train, all_done, |found| {
            train.iter_mut().zip(found).for_each(|(all, found)| all.extend(found.into_iter().map(|v| (clip, v))));
            clip += 1;
        })?;
        let [real, reversed, noise] = train;
        // halves by clip: windows of one clip overlap, so halves by window would be too alike
        let half = |odd: usize| clouds(real.iter().filter(|(clip, _)| clip % 2 == odd).map(|(_, v)| v.clone()));
        let [even, odd] = [half(0), half(1)];
        let [real, reversed, noise] = [real, reversed, noise].map(|all| clouds(all.into_iter().map(|(_, v)| v)));
        let (spoilt, mut sampled) = ([reversed, noise], pieces.sampled);
        let mut named = Vec::new();
        for split in [Split::Valid, Split::Test] {
            let pieces = of_split(split);
            sampled |= pieces.sampled;
            let all = reference.each(split, |i, dance| pieces.vectors(i, dance, Alteration::Nothing))?;
            named.push((split.to_string(), clouds(all.into_iter().flatten())));
        }
        for (name, set) in sets {
            // an empty set has no pieces at any rate
            let fps = set.first().map_or(1.0, |dance| dance.clip.fps());
            let pieces = Pieces::of(set.iter().map(|dance| dance.clip.frames()), fps, form);
            sampled |= pieces.sampled;
            let all = set.par_iter().enumerate().map(|(i, dance)| pieces.vectors(i, dance, Alteration::Nothing));
            named.push(((*name).to_owned(), clouds(all.collect::<Result<Vec<_>>>()?.into_iter().flatten())));
        }
        for (at, kind) in ["kinetic", "geometric"].into_iter().enumerate() {
            let scale = Standardizer::of(&real[at], form == Formulas::Compat);
            let scaled = |rows: &Rows| scale.apply(rows);
            let all = scaled(&real[at]);
            let mut compared = vec![(
                "one half of train to the other".into(),
                SetDistance::between(&scaled(&odd[at]), &scaled(&even[at]), SEED)?,
            )];
            for (name, set) in &named {
                compared.push((name.clone(), SetDistance::between(&scaled(&set[at]), &all, SEED)?));
            }
            for (name, set) in ["train, backwards", "train with 5 cm of noise"].into_iter().zip(&spoilt) {
                compared.push((name.into(), SetDistance::between(&scaled(&set[at]), &all, SEED)?));
            }
            tables.push(Features {
                kind,
                form: form_name,
                left_out: scale.left_out(),
                real_diversity: super::frechet::diversity(&all),
                sets: compared,
                most_vectors: sampled.then_some(MOST),
            });
        }
    }
    Ok(tables)
}

/// Kinetic and geometric features of a window (`fixed`) or a clip (`compat`).
type Vector = [Vec<f64>; 2];

/// Kinetic and geometric features, a row a vector.
fn clouds(vectors: impl Iterator<Item = Vector>) -> [Rows; 2] {
    let (kinetic, geometric) = vectors.map(|[kinetic, geometric]| (kinetic, geometric)).unzip();
    [kinetic, geometric]
}

/// The pieces that are taken of a set's clips.
struct Pieces {
    form: Formulas,
    /// Of each clip.
    taken: Vec<Vec<usize>>,
    sampled: bool,
}

impl Pieces {
    /// Of clips with these frames at `fps`: all pieces, or [`MOST`] of them.
    fn of(clips: impl Iterator<Item = usize>, fps: f64, form: Formulas) -> Pieces {
        let (window, hop) = window_of(fps);
        let count = |frames: usize| match form {
            // features are of speeds, which need two frames
            _ if frames < 2 => 0,
            Formulas::Compat => 1,
            Formulas::Fixed => (frames + 1).saturating_sub(window).div_ceil(hop),
        };
        let counts: Vec<usize> = clips.map(count).collect();
        let all: usize = counts.iter().sum();
        let most = all.min(MOST);
        let (mut taken, mut before, mut next) = (Vec::with_capacity(counts.len()), 0, 0);
        for count in counts {
            let mut of_clip = Vec::new();
            // the n-th taken piece is number `n * all / most`, counted through all clips
            while next < most && next * all / most < before + count {
                of_clip.push(next * all / most - before);
                next += 1;
            }
            taken.push(of_clip);
            before += count;
        }
        Pieces { form, taken, sampled: most < all }
    }

    /// The features of a clip's.
    fn vectors(&self, clip: usize, dance: &Dance, done: Alteration) -> Result<Vec<Vector>> {
        if self.taken[clip].is_empty() {
            return Ok(Vec::new());
        }
        let places = done.apply(&places(&dance.clip, self.form)?, clip);
        let (window, hop) = window_of(places.fps());
        let vector = |&piece: &usize| {
            let frames = match self.form {
                Formulas::Compat => 0..places.frames().min(COMPAT_FRAMES),
                Formulas::Fixed => piece * hop..piece * hop + window,
            };
            let piece = places.slice(frames);
            [kinetic(&piece, self.form).to_vec(), geometric(&piece, self.form).to_vec()]
        };
        Ok(self.taken[clip].iter().map(vector).collect())
    }
}

/// Positions at the rate of a form; `compat` has the root's first position at 0.
fn places(clip: &Clip, form: Formulas) -> Result<JointPositions> {
    if form == Formulas::Fixed {
        return Ok(JointPositions::of(clip)?);
    }
    let first = clip.root().first().copied().unwrap_or_default();
    Ok(JointPositions::of(&resample(clip, COMPAT_FPS, Method::Slerp)?)?.changed(|place| place - first))
}

/// Frames of a window of five seconds, and to the next, which has half of it.
fn window_of(fps: f64) -> (usize, usize) {
    let [window, hop] = [WINDOW_S, HOP_S].map(|s| ((s * fps).round() as usize).max(2));
    (window, hop)
}

impl Alteration {
    fn apply(self, places: &JointPositions, clip: usize) -> JointPositions {
        match self {
            Alteration::Nothing => places.clone(),
            Alteration::Reversed => places.reversed(),
            Alteration::Noise => {
                let mut rng = random::stream(SEED, "noise", clip as u64, 0);
                let mut one = || NOISE_M * random::normal(&mut rng);
                places.changed(|place| place + Vec3::new(one(), one(), one()))
            }
        }
    }
}

impl fmt::Display for Features {
    /// A table, without a line end after the last row.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = |x: Option<f64>| number(x, 2);
        let name = format!("{} features, {}", self.kind, self.form);
        write!(f, "{name:<32} {:>8} {:>10} {:>12} {:>10}", "vectors", "Fréchet", "of infinity", "diversity")?;
        write!(f, "\n{:<32} {:>8} {:>10} {:>12} {:>10}", "train", "", "", "", number(self.real_diversity))?;
        for (name, set_distance) in &self.sets {
            let SetDistance { vectors, distance, at_infinity, diversity, too_few } = set_distance;
            let few = if *too_few { "  too few" } else { "" };
            let [distance, at_infinity, diversity] = [*distance, *at_infinity, *diversity].map(number);
            write!(f, "\n{name:<32} {vectors:>8} {distance:>10} {at_infinity:>12} {diversity:>10}{few}")?;
        }
        if let Some(most) = self.most_vectors {
            write!(f, "\nof sets with more than {most} vectors so many were taken, spread evenly")?;
        }
        if !self.left_out.is_empty() {
            write!(f, "\nleft out, since they don't vary over train: {:?}", self.left_out)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_are_five_seconds_half_in_the_next() {
        let pieces = |clips: &[usize], form| Pieces::of(clips.iter().copied(), 20.0, form);
        // of 220 frames the windows of 100 begin at 0, 50 and 100
        assert_eq!(pieces(&[220, 99, 100], Formulas::Fixed).taken, [vec![0, 1, 2], vec![], vec![0]]);
        assert_eq!(pieces(&[220, 1, 2], Formulas::Compat).taken, [vec![0], vec![], vec![0]]);
        assert_eq!(window_of(20.0), (100, 50));
        // of ten hours a sample
        let many = pieces(&[7_200; 100], Formulas::Fixed);
        let taken: usize = many.taken.iter().map(Vec::len).sum();
        // 143 pieces a clip, 14,300 in all, of which 4,000 are taken: about every 3.6th
        assert_eq!((taken, many.sampled, &many.taken[99][..2]), (MOST, true, &[0, 3][..]));
        assert!(many.taken.iter().all(|of_clip| of_clip.iter().all(|piece| piece * 50 + 100 <= 7_200)));
    }
}
