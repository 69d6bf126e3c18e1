//! Dances and real ones as clouds of features, and how far these are apart: docs/referee.md.

use super::coded::Dance;
use super::frechet::{Held, Rows, Scale, held};
use crate::{Result, random};
use kinelm_motion::metric::features::{COMPAT_FPS, Form, Places, geometric, kinetic};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::{Clip, Vec3};
use rayon::prelude::*;
use serde::Serialize;
use std::fmt;

/// Length of a window and the way from one to the next, seconds.
const WINDOW_S: f64 = 5.0;
const HOP_S: f64 = 2.5;
/// Published code looks at so many frames of a clip.
const COMPAT_FRAMES: usize = 1200;
/// Noise of the set that is worse than any, metres.
const NOISE_M: f64 = 0.05;
/// The seed of noise and of draws.
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
    /// Sets held to the real train clips: what is real, what is real and spoilt, the dances.
    pub sets: Vec<(String, Held)>,
}

/// What is done to clips before their features are taken.
#[derive(Clone, Copy, PartialEq)]
enum Done {
    Nothing,
    Reversed,
    Noise,
}

/// The four tables: kinetic and geometric features, `fixed` and `compat`. The real train clips, and sets by their names.
///
/// # Errors
/// What resampling and features fail with.
pub fn features(train: &[Dance], sets: &[(&str, &[Dance])]) -> Result<Vec<Features>> {
    let mut tables = Vec::new();
    for (form, form_name) in [(Form::Fixed, "fixed"), (Form::Compat, "compat")] {
        let clouds = |dances: &[Dance], done: Done| clouds(dances, form, done);
        let real = clouds(train, Done::Nothing)?;
        let [even, odd] = [0, 1].map(|odd| -> Vec<Dance> { train.iter().skip(odd).step_by(2).cloned().collect() });
        let [even, odd] = [clouds(&even, Done::Nothing)?, clouds(&odd, Done::Nothing)?];
        let spoilt = [clouds(train, Done::Reversed)?, clouds(train, Done::Noise)?];
        let named = sets.iter().map(|(name, set)| Ok((*name, clouds(set, Done::Nothing)?)));
        let named = named.collect::<Result<Vec<_>>>()?;
        for (at, kind) in ["kinetic", "geometric"].into_iter().enumerate() {
            let scale = Scale::of(&real[at], form == Form::Compat);
            let scaled = |rows: &Rows| scale.apply(rows);
            let all = scaled(&real[at]);
            let mut held_to =
                vec![("one half of train to the other".into(), held(&scaled(&odd[at]), &scaled(&even[at]), SEED)?)];
            for (name, set) in &named {
                held_to.push(((*name).into(), held(&scaled(&set[at]), &all, SEED)?));
            }
            for (name, set) in ["train, backwards", "train with 5 cm of noise"].into_iter().zip(&spoilt) {
                held_to.push((name.into(), held(&scaled(&set[at]), &all, SEED)?));
            }
            tables.push(Features {
                kind,
                form: form_name,
                left_out: scale.left_out(),
                real_diversity: super::frechet::diversity(&all),
                sets: held_to,
            });
        }
    }
    Ok(tables)
}

/// Kinetic and geometric features, a row a window (`fixed`) or a clip (`compat`).
fn clouds(dances: &[Dance], form: Form, done: Done) -> Result<[Rows; 2]> {
    let pieces = |(i, dance): (usize, &Dance)| -> Result<Vec<Places>> {
        let places = done.apply(&places(&dance.clip, form)?, i);
        Ok(match form {
            Form::Compat => vec![places.slice(0..places.frames().min(COMPAT_FRAMES))],
            Form::Fixed => windows(&places),
        })
    };
    let long = dances.iter().enumerate().filter(|(_, dance)| dance.clip.frames() > 1);
    let pieces: Vec<Vec<Places>> = long.collect::<Vec<_>>().into_par_iter().map(pieces).collect::<Result<_>>()?;
    let pieces = pieces.concat();
    let rows = |of: &(dyn Fn(&Places) -> Vec<f64> + Sync)| pieces.par_iter().map(of).collect::<Rows>();
    Ok([rows(&|p| kinetic(p, form).to_vec()), rows(&|p| geometric(p, form).to_vec())])
}

/// Places at the rate that a form is of; `compat` has the root's first place at 0.
fn places(clip: &Clip, form: Form) -> Result<Places> {
    if form == Form::Fixed {
        return Ok(Places::of(clip)?);
    }
    let first = clip.root().first().copied().unwrap_or_default();
    Ok(Places::of(&resample(clip, COMPAT_FPS, Method::Slerp)?)?.changed(|place| place - first))
}

/// Windows of five seconds, half of each in the next; of a shorter clip none.
fn windows(places: &Places) -> Vec<Places> {
    let [window, hop] = [WINDOW_S, HOP_S].map(|s| ((s * places.fps()).round() as usize).max(2));
    let starts = (0..(places.frames() + 1).saturating_sub(window)).step_by(hop);
    starts.map(|start| places.slice(start..start + window)).collect()
}

impl Done {
    fn apply(self, places: &Places, clip: usize) -> Places {
        match self {
            Done::Nothing => places.clone(),
            Done::Reversed => places.reversed(),
            Done::Noise => {
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
        let number = |x: Option<f64>| x.map_or("n/a".into(), |x| format!("{x:.2}"));
        let name = format!("{} features, {}", self.kind, self.form);
        write!(f, "{name:<32} {:>8} {:>10} {:>12} {:>10}", "vectors", "Fréchet", "of infinity", "diversity")?;
        write!(f, "\n{:<32} {:>8} {:>10} {:>12} {:>10}", "train", "", "", "", number(self.real_diversity))?;
        for (name, held) in &self.sets {
            let Held { vectors, distance, at_infinity, diversity, too_few } = held;
            let few = if *too_few { "  too few" } else { "" };
            let [distance, at_infinity, diversity] = [*distance, *at_infinity, *diversity].map(number);
            write!(f, "\n{name:<32} {vectors:>8} {distance:>10} {at_infinity:>12} {diversity:>10}{few}")?;
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
    use kinelm_motion::synth;

    #[test]
    fn windows_are_five_seconds_half_in_the_next() {
        let clip = synth::corpus(4, 1, 11.0, 20.0).unwrap().remove(0).clip;
        let pieces = windows(&Places::of(&clip).unwrap());
        assert_eq!((pieces.len(), pieces[0].frames()), (3, 100));
        assert!(windows(&Places::of(&clip.slice(0..99)).unwrap()).is_empty());
    }
}
