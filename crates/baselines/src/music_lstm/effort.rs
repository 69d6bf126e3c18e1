//! Laban's weight effort as a sum of angular speeds, and the error of one dance's effort against another's.
//!
//! `w_j(t) = s rotvec(q_j(t+1) conj q_j(t))`, the shorter rotation, rad/s at s frames a second; `e(t) = sum_j m_j |w_j(t)|`;
//! the loss is the mean over t of `(ln(1 + smooth e) - ln(1 + smooth e'))^2`, smoothed over 0.25 s.
//!
//! The dissertation sets omega = 2 dq conj(q) with dq = q(t+1) conj(q(t)). For unit quaternions this has length 2 for any
//! movement, and depends on orientations. From q' = omega q / 2 follows omega = 2 q' conj(q): it puts a rotation where a
//! difference is needed. [`compat`] is that form.

use crate::FPS;
use kinelm_motion::metric::angular_effort;
use kinelm_motion::{Quat, Skeleton};

/// Seconds over which effort is smoothed.
const SMOOTH_S: f64 = 0.25;
/// The least sine of half a rotation that has a direction.
const NO_TURN: f64 = 1e-9;

/// Each joint's share of the bones' lengths below it, which its rotation moves.
pub fn shares(skeleton: &Skeleton) -> Vec<f64> {
    let mut below: Vec<f64> = vec![0.0; skeleton.joints()];
    for end in skeleton.ends() {
        below[end.parent] += end.offset.length();
    }
    // parents come before their children, so from the end each joint is complete when it is added
    for joint in (0..skeleton.joints()).rev() {
        if let Some(parent) = skeleton.parents()[joint] {
            below[parent] += below[joint] + skeleton.offsets()[joint].length();
        }
    }
    let all = below.iter().fold(0.0, |most: f64, one| most.max(*one));
    below.iter().map(|one| if all > 0.0 { one / all } else { 1.0 }).collect()
}

/// The angle between two unit quaternions, radians, and its gradient by each of them.
fn turn(a: Quat, b: Quat) -> (f64, Quat, Quat) {
    let dot = a.dot(b);
    let sign = if dot < 0.0 { -1.0 } else { 1.0 };
    // the components orthogonal to the other: their length is the sine of half the angle
    let (of_a, of_b) = (b * sign - a * dot.abs(), a * sign - b * dot.abs());
    let sine = of_b.length();
    let angle = 2.0 * sine.atan2(dot.abs());
    match sine > NO_TURN {
        true => (angle, of_a * (-2.0 / sine), of_b * (-2.0 / sine)),
        // at rest the angle has a kink: 0 is one of its slopes
        false => (angle, Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), Quat::from_xyzw(0.0, 0.0, 0.0, 0.0)),
    }
}

/// Moving means over [`SMOOTH_S`], or over all numbers where there are fewer.
fn smooth(effort: &[f64]) -> (usize, Vec<f64>) {
    // 1 at least: windows of 0 panic
    let window = ((SMOOTH_S * FPS).round() as usize).clamp(1, effort.len().max(1));
    (window, effort.windows(window).map(|some| some.iter().sum::<f64>() / window as f64).collect())
}

/// The corrected loss of frames (T, J) against true ones, at 30 a second; `gradients` (T, J) gets `scale` times its
/// gradient added. 0 of fewer than two frames.
pub fn corrected(found: &[Quat], truth: &[Quat], weights: &[f64], scale: f64, gradients: &mut [Quat]) -> f64 {
    let j = weights.len();
    let (window, own) = smooth(&angular_effort(found, weights, FPS));
    let (_, theirs) = smooth(&angular_effort(truth, weights, FPS));
    let n = own.len() as f64;
    let mut loss = 0.0;
    let mut by_step = vec![0.0; (found.len() / j).saturating_sub(1)];
    for (t, (own, theirs)) in own.iter().zip(&theirs).enumerate() {
        let error = own.ln_1p() - theirs.ln_1p();
        loss += error * error / n;
        // the chain rule: 1 / (1 + x) of ln(1 + x), 1 / window of the moving mean
        let slope = 2.0 * error / (n * (1.0 + own) * window as f64);
        by_step[t..t + window].iter_mut().for_each(|step| *step += slope);
    }
    for (t, slope) in by_step.iter().enumerate() {
        for (i, weight) in weights.iter().enumerate() {
            let (a, b) = (t * j + i, (t + 1) * j + i);
            let (_, of_a, of_b) = turn(found[a], found[b]);
            let by = scale * slope * weight * FPS;
            gradients[a] += of_a * by;
            gradients[b] += of_b * by;
        }
    }
    loss
}

/// The dissertation's omega of two frames of a joint: 2 dq conj(q). A joint that jumps by 120 degrees and back in every
/// frame, about the axis of a pose's rotation, has the omega of one at rest in that pose.
pub fn omega(a: Quat, b: Quat) -> Quat {
    let back = a.conjugate();
    b * back * back * 2.0
}

/// The loss as printed: the mean square difference of [`omega`] over joints, steps and components. Otherwise as
/// [`corrected`].
pub fn compat(found: &[Quat], truth: &[Quat], joints: usize, scale: f64, gradients: &mut [Quat]) -> f64 {
    let n = 4.0 * found.len().saturating_sub(joints) as f64;
    let mut loss = 0.0;
    for b in joints..found.len() {
        let a = b - joints;
        let error = omega(found[a], found[b]) - omega(truth[a], truth[b]);
        loss += error.length_squared() / n;
        let d_omega = error * (2.0 * 2.0 * scale / n);
        // the adjoint of a product is the product with conjugates
        let (q, back) = (found[b], found[a].conjugate());
        gradients[b] += d_omega * (back * back).conjugate();
        let of_back = q.conjugate() * d_omega * back.conjugate() + (q * back).conjugate() * d_omega;
        gradients[a] += of_back.conjugate();
    }
    loss
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::Vec3;
    use kinelm_store::random;

    fn any(purpose: &str, n: usize) -> Vec<Quat> {
        let mut rng = random::stream(1, purpose, 0, 0);
        let mut number = || random::normal(&mut rng);
        (0..n).map(|_| Quat::from_xyzw(number(), number(), number(), number()).normalize()).collect()
    }

    #[test]
    fn effort_is_the_angular_speed() {
        for fps in [30.0, 60.0, 120.0] {
            for fixed in any("fixed", 5) {
                let spin = |rate: f64| -> Vec<Quat> {
                    let turned = |t: usize| Quat::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), rate * t as f64 / fps);
                    // one joint turns, the other doesn't; either sign says the same
                    (0..9).flat_map(|t| [turned(t) * fixed * if t % 2 == 0 { 1.0 } else { -1.0 }, fixed]).collect()
                };
                assert!(angular_effort(&spin(0.0), &[1.0, 1.0], fps).iter().all(|e| *e < 1e-6));
                let found = angular_effort(&spin(1.0), &[1.0, 1.0], fps);
                assert!(found.len() == 8 && found.iter().all(|e| (e - 1.0).abs() < 1e-9), "{found:?}");
            }
        }
    }

    #[test]
    fn the_printed_form_has_length_two_at_rest_and_depends_on_orientation() {
        let at = any("at rest", 2);
        for q in &at {
            assert!((omega(*q, *q).length() - 2.0).abs() < 1e-12);
        }
        assert!((omega(at[0], at[0]) - omega(at[1], at[1])).length() > 0.1);
    }

    #[test]
    fn the_printed_form_takes_jumps_of_120_degrees_for_rest() {
        for rest in any("leap", 5) {
            let axis = Vec3::new(rest.x, rest.y, rest.z).normalize();
            let [a, b] = [1.0, 2.0].map(|k| Quat::from_axis_angle(axis, k * 2.0 * std::f64::consts::TAU / 3.0) * rest);
            assert!((turn(a, b).0.to_degrees() - 120.0).abs() < 1e-6);
            let (leaps, still) = ([a, b, a, b], [rest; 4]);
            assert!(compat(&leaps, &still, 1, 1.0, &mut [Quat::IDENTITY; 4]) < 1e-20);
            assert!(corrected(&leaps, &still, &[1.0], 1.0, &mut [Quat::IDENTITY; 4]) > 10.0);
        }
    }

    #[test]
    fn bones_below_a_joint_are_its_weight() {
        let names = ["hip", "knee", "foot"].map(String::from).to_vec();
        let offsets = vec![Vec3::ZERO, Vec3::Y * -3.0, Vec3::Y * -1.0];
        let leg = Skeleton::new(names, vec![None, Some(0), Some(1)], offsets, vec![]).unwrap();
        // 4, 1 and 0 m of bones below
        assert_eq!(shares(&leg), [1.0, 0.25, 0.0]);
    }

    type Loss<'a> = &'a dyn Fn(&[Quat], &mut [Quat]) -> f64;

    fn slopes(frames: &[Quat], of: Loss) {
        let mut gradients = vec![Quat::from_xyzw(0.0, 0.0, 0.0, 0.0); frames.len()];
        of(frames, &mut gradients);
        for at in 0..frames.len() {
            for axis in 0..4 {
                let value = |by: f64| {
                    let mut moved = frames.to_vec();
                    let mut numbers = moved[at].to_array();
                    numbers[axis] += by;
                    moved[at] = Quat::from_array(numbers);
                    of(&moved, &mut gradients.clone())
                };
                let expected = (value(1e-6) - value(-1e-6)) / 2e-6;
                let found = gradients[at].to_array()[axis];
                assert!((found - expected).abs() < 1e-5 * expected.abs().max(1.0), "{at} {axis}: {found} {expected}");
            }
        }
    }

    #[test]
    fn gradients_are_finite_differences() {
        let (found, truth) = (any("found", 24), any("truth", 24));
        slopes(&found, &|x, g| compat(x, &truth, 2, 1.0, g));
        // along the sphere alone: an angle means nothing off it
        let unit = |x: &[Quat]| x.iter().map(|q| q.normalize()).collect::<Vec<_>>();
        slopes(&found, &|x, g| {
            let loss = corrected(&unit(x), &unit(&truth), &[1.0, 0.3], 1.0, g);
            for (g, q) in g.iter_mut().zip(x) {
                let along = g.dot(*q);
                *g -= *q * along;
            }
            loss
        });
    }

    #[test]
    fn the_true_dance_and_one_without_steps_cost_nothing() {
        let truth = any("truth", 20);
        let mut gradients = vec![Quat::from_xyzw(0.0, 0.0, 0.0, 0.0); 20];
        assert!(corrected(&truth, &truth, &[1.0; 2], 1.0, &mut gradients) < 1e-20);
        assert!(compat(&truth, &truth, 2, 1.0, &mut gradients) < 1e-20);
        assert_eq!(corrected(&truth[..2], &truth[..2], &[1.0; 2], 1.0, &mut gradients[..2]), 0.0);
        assert!(gradients.iter().all(|g| g.length() < 1e-9));
    }
}
