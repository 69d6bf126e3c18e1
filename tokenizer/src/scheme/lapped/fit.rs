//! Fits the transform over the joints, the zero thresholds, and the order of a word's numbers.

use super::{HIGHEST, Lapped, LappedConfig, LappedMix, Layout, multiply, open_rows};
use crate::channel::Channels;
use crate::scheme::series::set_pose;
use crate::{Error, Result};
use kinelm_linalg::{product, symmetric_eigen};
use kinelm_motion::{Clip, GlobalPose, Quat, Vec3, smpl};

/// The most poses at which the metric is measured.
const POSES: usize = 2048;

/// Half the step of a difference quotient, radians or metres.
const SMALL: f64 = 1e-5;

/// The least weight of a channel, metres per unit, so that matrices can be inverted.
const LIGHTEST: f64 = 1e-4;

impl Lapped {
    /// Fits to training clips.
    ///
    /// # Errors
    /// [`Error::Nothing`] without a frame, or when motion is out of range.
    pub(crate) fn fit(config: &LappedConfig, channels: &Channels, clips: &[Clip]) -> Result<Lapped> {
        config.validate()?;
        let clips: Vec<&Clip> = clips.iter().filter(|c| c.frames() > 0).collect();
        if clips.is_empty() {
            return Err(Error::Nothing("no frame of motion".into()));
        }
        let layout = Layout::new(config, channels);
        let rows: Vec<Vec<f64>> = clips.iter().map(|c| open_rows(channels, c, c.frames())).collect();
        let mean = mean(layout.open, &rows);
        let (metric, turn_arm) = metric(config, channels, &clips, &rows);
        let (forward, inverse) = mix(config, layout.open, &metric, &mean, &rows)?;
        // as for larger numbers, until the thresholds are fitted to the words that it gives
        let plain = ((500.0 + 1600.0 * config.thrift) as u16).min(HIGHEST);
        let mut scheme = Lapped {
            config: config.clone(),
            mean,
            forward,
            inverse,
            turn_arm,
            thresholds: vec![plain; layout.numbers()],
            order: (0..layout.numbers() as u32).collect(),
        };
        scheme.thresholds = scheme.fit_thresholds(channels, layout, &clips);
        scheme.order = scheme.fit_order(channels, layout, &clips);
        Ok(scheme)
    }

    /// Zero thresholds: half a step, plus `thrift` for each bit that a 1 costs more than a 0.
    fn fit_thresholds(&self, channels: &Channels, layout: Layout, clips: &[&Clip]) -> Vec<u16> {
        // add-one counts of three symbols, so that no logarithm is infinite
        let (mut zeros, mut ones) = (vec![1.0; layout.numbers()], vec![2.0; layout.numbers()]);
        self.for_each_word(channels, layout, clips, |word| {
            for (i, number) in word.iter().enumerate() {
                match number {
                    0 => zeros[i] += 1.0,
                    1 | -1 => ones[i] += 1.0,
                    _ => {}
                }
            }
        });
        let threshold = |(z, o): (&f64, &f64)| {
            // a 1 and a -1 share the count, and each has its own character
            let bits = (z / (0.5 * o)).log2().max(0.0);
            (500.0 + 1000.0 * self.config.thrift * bits).round().min(HIGHEST.into()) as u16
        };
        zeros.iter().zip(&ones).map(threshold).collect()
    }

    /// The numbers by their frequency of being non-zero, highest first.
    fn fit_order(&self, channels: &Channels, layout: Layout, clips: &[&Clip]) -> Vec<u32> {
        let mut others = vec![0u64; layout.numbers()];
        self.for_each_word(channels, layout, clips, |word| {
            others.iter_mut().zip(word).for_each(|(n, x)| *n += u64::from(*x != 0));
        });
        let mut order: Vec<u32> = (0..layout.numbers() as u32).collect();
        // stable: of equals, the lower frequency first
        order.sort_by_key(|&i| std::cmp::Reverse(others[i as usize]));
        order
    }

    fn for_each_word(&self, channels: &Channels, layout: Layout, clips: &[&Clip], mut look: impl FnMut(&[i32])) {
        for clip in clips {
            self.quantise(channels, clip, &mut 0).chunks_exact(layout.numbers()).for_each(&mut look);
        }
    }
}

/// (K) means of rows (K, n) each.
fn mean(k: usize, rows: &[Vec<f64>]) -> Vec<f64> {
    let frames: usize = rows.iter().map(|r| r.len() / k).sum();
    let mut sum = vec![0.0; k];
    for clip in rows {
        let n = clip.len() / k;
        sum.iter_mut().zip(clip.chunks_exact(n)).for_each(|(s, row)| *s += row.iter().sum::<f64>());
    }
    sum.iter().map(|s| s / frames as f64).collect()
}

/// The metric of joint positions: (K, K), the mean over poses and joints of J'J, where J is the displacement of a joint per unit
/// of each channel, square metres; and the RMS displacement per radian of turn, metres.
fn metric(config: &LappedConfig, channels: &Channels, clips: &[&Clip], rows: &[Vec<f64>]) -> (Vec<f64>, f64) {
    let k = Layout::new(config, channels).open;
    let frames: usize = clips.iter().map(|c| c.frames()).sum();
    let every = frames.div_ceil(POSES);
    let (mut sum, mut turn, mut poses, mut next) = (vec![0.0; k * k], 0.0, 0, 0);
    for (clip, rows) in clips.iter().zip(rows) {
        let n = clip.frames();
        while next < n {
            let moves = moves(channels, clip, rows, n, next);
            let (open, turned) = moves.split_at(k * 72);
            let more = product([k, 72, k], open, open, true);
            sum.iter_mut().zip(&more).for_each(|(s, m)| *s += m);
            turn += turned.iter().map(|x| x * x).sum::<f64>();
            (poses, next) = (poses + 1, next + every);
        }
        // poses are evenly spaced over all clips together, so short clips count by their length
        next -= n;
    }
    let scale = 1.0 / (24 * poses) as f64;
    sum.iter_mut().for_each(|s| *s *= scale);
    for c in 0..k {
        let tip = if c + 1 < k { config.tip_m * config.tip_m / 24.0 } else { 0.0 };
        sum[c * k + c] += tip + LIGHTEST * LIGHTEST;
    }
    (sum, (turn * scale).sqrt().max(LIGHTEST))
}

/// The displacement of the 24 joints per unit of each channel and of the turn, in one frame: (K + 1, 72), metres.
fn moves(channels: &Channels, clip: &Clip, rows: &[f64], n: usize, frame: usize) -> Vec<f64> {
    let k = rows.len() / n;
    let mut values: Vec<f64> = (0..k).map(|c| rows[c * n + frame]).collect();
    let mut world = GlobalPose::default();
    let mut places = |values: &[f64]| {
        let mut pose: Vec<Quat> = clip.pose(frame).to_vec();
        set_pose(channels, 0.0, values, 1, 0, &mut pose);
        world.set(&smpl::neutral(), Vec3::Y * values[k - 1], &pose);
        world.positions.clone()
    };
    let mut out = Vec::with_capacity((k + 1) * 72);
    for c in 0..k {
        let value = values[c];
        values[c] = value + SMALL;
        let after = places(&values);
        values[c] = value - SMALL;
        let before = places(&values);
        values[c] = value;
        // central differences: the error falls with the square of the step
        after.iter().zip(&before).for_each(|(a, b)| out.extend(((*a - *b) / (2.0 * SMALL)).to_array()));
    }
    let (at, root) = (places(&values), values[k - 1]);
    // the derivative of a turn about the vertical through the root
    at.iter().for_each(|p| out.extend(Vec3::Y.cross(*p - Vec3::Y * root).to_array()));
    out
}

/// The matrices (K, K) from channels to components and back.
fn mix(
    config: &LappedConfig,
    k: usize,
    metric: &[f64],
    mean: &[f64],
    rows: &[Vec<f64>],
) -> Result<(Vec<f64>, Vec<f64>)> {
    let diagonal = |f: &dyn Fn(usize) -> f64| {
        let mut m = vec![0.0; k * k];
        (0..k).for_each(|i| m[i * k + i] = f(i));
        m
    };
    if config.joint_transform == (LappedMix::None {}) {
        // `LIGHTEST` is in the diagonal, so no arm is 0
        let arm = |i: usize| metric[i * k + i].sqrt();
        return Ok((diagonal(&arm), diagonal(&|i| 1.0 / arm(i))));
    }
    let eigen = |m: &[f64]| {
        symmetric_eigen(k, m)
            .ok_or_else(|| Error::Nothing("the training motion is out of range; are the units right?".into()))
    };
    // the symmetric root of the metric, and its inverse
    let (values, vectors) = eigen(metric)?;
    let power = |p: f64| {
        let scaled: Vec<f64> =
            (0..k * k).map(|i| values[i / k].max(LIGHTEST * LIGHTEST).powf(p) * vectors[i]).collect();
        let transposed: Vec<f64> = (0..k * k).map(|i| vectors[i % k * k + i / k]).collect();
        product([k, k, k], &transposed, &scaled, false)
    };
    let (root, unroot) = (power(0.5), power(-0.5));
    let mut covariance = vec![0.0; k * k];
    for clip in rows {
        let n = clip.len() / k;
        let off: Vec<f64> = clip.iter().enumerate().map(|(i, x)| x - mean[i / n]).collect();
        let weighed = multiply(&root, n, &off);
        let more = product([k, n, k], &weighed, &weighed, true);
        covariance.iter_mut().zip(&more).for_each(|(s, m)| *s += m);
    }
    let (_, mut directions) = eigen(&covariance)?;
    // fixed signs, so that the same motion gives the same bytes
    for d in directions.chunks_exact_mut(k) {
        let largest = d.iter().fold(0.0f64, |a, x| if x.abs() > a.abs() * (1.0 + 1e-6) { *x } else { a });
        d.iter_mut().for_each(|x| *x *= 1f64.copysign(largest));
    }
    Ok((product([k, k, k], &directions, &root, false), product([k, k, k], &unroot, &directions, true)))
}
