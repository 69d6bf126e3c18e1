//! One row: fitted on train, measured on test.

use super::clips::{Clips, StudyClip, each};
use super::metrics::{Errors, RowMetrics, Speed};
use super::row::Row;
use crate::{Error, Result};
use kinelm_motion::metric::{GeodesicError, Mpjpe};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::{Clip, Quat};
use kinelm_tokenizer::rate::TextCounts;
use kinelm_tokenizer::{Encoded, Fit, Tokenizer, UncodedPose};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Instant;

/// How often [`measure`] goes through the train clips and through the test clips.
pub const PASSES: [usize; 2] = [2, 1];

/// Frames of test clips that coding is timed on, about: they are held at once.
const TIMED_FRAMES: usize = 50_000;
/// Coding is timed up to three times and for about a second; the best counts.
const TIMES: usize = 3;
const TIMED_S: f64 = 1.0;

/// Fits the row's tokenizer and measures it; `step` is called a clip at a time.
///
/// Errors are against the clip at the row's own rate; joints that aren't coded are the clip's own in both.
///
/// # Errors
/// Those of fitting, encoding and decoding, the file named.
pub fn measure(row: &Row, clips: &Clips, step: &mut dyn FnMut()) -> Result<(RowMetrics, Tokenizer)> {
    let tokenizer = fit(row, clips, step)?;
    let mut train = TextCounts::default();
    each(
        &clips.train,
        |known| Ok(counted(&tokenizer, clips, known)?.2),
        |one| {
            train.merge(&one);
            step();
            Ok(())
        },
    )?;
    let (mut test, mut errors) = (TextCounts::default(), Errors::new(&tokenizer));
    let work = |known: &StudyClip| {
        let (clip, encoded, counts) = counted(&tokenizer, clips, known)?;
        let mut errors = Errors::new(&tokenizer);
        errors.add(&clip, &decoded(&tokenizer, &encoded, &clip)?)?;
        Ok((counts, errors))
    };
    each(&clips.test, work, |(counts, one)| {
        test.merge(&counts);
        errors.merge(&one);
        step();
        Ok(())
    })?;
    // each word's space is a token too
    let tokens_per_frame = (test.tokens + test.words) as f64 / test.frames.max(1) as f64;
    let speed = speed(&tokenizer, clips, tokens_per_frame)?;
    Ok((RowMetrics::new(row.clone(), &tokenizer, &train, &test, &errors, speed), tokenizer))
}

fn fit(row: &Row, clips: &Clips, step: &mut dyn FnMut()) -> Result<Tokenizer> {
    let mut all = Fit::new(row.config.clone())?;
    let work = |known: &StudyClip| {
        // clips are fitted apart and merged in order, so that sums don't depend on threads
        let mut one = Fit::new(row.config.clone())?;
        one.add(&*clips.get(known, row.config.fps)?)?;
        Ok(one)
    };
    each(&clips.train, work, |one| {
        step();
        Ok(all.merge(&one)?)
    })?;
    all.finish().map_err(|e| Error::unsupported(format!("row {}", row.name), e.to_string()))
}

fn counted(tokenizer: &Tokenizer, clips: &Clips, known: &StudyClip) -> Result<(Arc<Clip>, Encoded, TextCounts)> {
    let clip = clips.get(known, tokenizer.fps())?;
    let encoded = tokenizer.encode(&clip)?;
    let mut counts = TextCounts::default();
    counts.add(tokenizer, &encoded, clip.frames() as u64, known.frames as u64)?;
    Ok((clip, encoded, counts))
}

/// What words decode to, as long as the clip they were made of.
pub fn decoded(tokenizer: &Tokenizer, encoded: &Encoded, clip: &Clip) -> Result<Clip> {
    let decoded = tokenizer.decode(&encoded.words, UncodedPose::Clip(clip))?;
    Ok(decoded.slice(0..clip.frames()))
}

/// Encoding and decoding on all threads, clips in memory.
fn speed(tokenizer: &Tokenizer, clips: &Clips, tokens_per_frame: f64) -> Result<Speed> {
    let (mut held, mut frames) = (Vec::new(), 0);
    for known in &clips.test {
        let clip = clips.get(known, tokenizer.fps())?;
        frames += clip.frames();
        held.push(clip);
        if frames > TIMED_FRAMES {
            break;
        }
    }
    let encode = || held.par_iter().map(|clip| Ok(tokenizer.encode(clip)?)).collect::<Result<Vec<Encoded>>>();
    let (encoded, encode_s) = timed(encode)?;
    let decode = || {
        let one = |(words, clip): (&Encoded, &Arc<Clip>)| {
            Ok(tokenizer.decode(&words.words, UncodedPose::Clip(clip))?.frames())
        };
        encoded.par_iter().zip(&held).map(one).sum::<Result<usize>>()
    };
    let (_, decode_s) = timed(decode)?;
    let (encode_frames, decode_frames) = (frames as f64 / encode_s, frames as f64 / decode_s);
    Ok(Speed {
        threads: rayon::current_num_threads(),
        encode_frames,
        decode_frames,
        encode_tokens: encode_frames * tokens_per_frame,
        decode_tokens: decode_frames * tokens_per_frame,
    })
}

/// What it gives, and the seconds of the fastest time.
fn timed<T>(work: impl Fn() -> Result<T>) -> Result<(T, f64)> {
    let (mut best, begin) = (f64::INFINITY, Instant::now());
    for time in 1.. {
        let start = Instant::now();
        let made = work()?;
        best = best.min(start.elapsed().as_secs_f64());
        if time == TIMES || begin.elapsed().as_secs_f64() > TIMED_S {
            // a clock that hasn't moved would give an infinite rate
            return Ok((made, best.max(1e-9)));
        }
    }
    unreachable!("the last time returns")
}

/// What rate and joints lose before anything is coded, on the test clips.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Loss {
    /// The rate.
    pub fps: f64,
    /// The coded joints.
    pub joints: Vec<usize>,
    /// By the rate: clips at the rate, brought back to the files' own by slerp, against the files. Mean angle over all 24
    /// joints, radians, and MPJPE, mm.
    pub rate_angle: f64,
    /// See there.
    pub rate_mpjpe: f64,
    /// By the joints that aren't coded: clips with those joints straight (identity), against the clips. MPJPE, mm.
    pub joints_mpjpe: f64,
}

/// Measures what a rate and a choice of joints lose.
///
/// # Errors
/// Those of reading the clips.
pub fn loss(clips: &Clips, fps: f64, joints: &[usize]) -> Result<Loss> {
    let (mut angle, mut rate, mut straight) =
        (GeodesicError::new((0..24).collect()), Mpjpe::default(), Mpjpe::default());
    let work = |known: &StudyClip| {
        let (own, at_rate) = (clips.get(known, known.fps)?, clips.get(known, fps)?);
        let back = resample(&at_rate, known.fps, Method::Slerp)?;
        // there and back may end a frame off
        let frames = back.frames().min(own.frames());
        let (own, back) = (own.slice(0..frames), back.slice(0..frames));
        let mut angle = GeodesicError::new((0..24).collect());
        angle.add(&own, &back)?;
        let (mut rate, mut straight) = (Mpjpe::default(), Mpjpe::default());
        rate.add(&own, &back)?;
        straight.add(&at_rate, &without(&at_rate, joints)?)?;
        Ok((angle, rate, straight))
    };
    each(&clips.test, work, |(a, r, s)| {
        angle.merge(&a);
        rate.merge(&r);
        straight.merge(&s);
        Ok(())
    })?;
    let (rate_angle, rate_mpjpe) = (angle.mean(), rate.global_mm());
    Ok(Loss { fps, joints: joints.to_vec(), rate_angle, rate_mpjpe, joints_mpjpe: straight.global_mm() })
}

/// The clip with all other joints straight.
fn without(clip: &Clip, joints: &[usize]) -> Result<Clip> {
    let j = clip.joints();
    let own = |(i, q): (usize, &Quat)| if joints.contains(&(i % j)) { *q } else { Quat::IDENTITY };
    let rotations = clip.rotations().iter().enumerate().map(own).collect();
    Ok(Clip::new(clip.skeleton().clone(), clip.fps(), clip.root().to_vec(), rotations)?)
}
