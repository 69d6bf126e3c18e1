//! Keys of an animation with new frames among them; the others stay as they are.

use super::super::file::track::{Between, Track};
use crate::rotation::nearest_sign;
use crate::{Quat, Vec3};

/// Keys nearer together than this are one, seconds.
const SAME_S: f64 = 1e-4;

impl Track {
    /// A property that never changes.
    pub fn still(value: Vec<f64>) -> Track {
        Track { times: vec![0.0], width: value.len(), values: value, between: Between::Linear }
    }

    /// Numbers of a key: its value, or tangent, value, tangent.
    fn each(&self) -> usize {
        if self.between == Between::Cubic { 3 * self.width } else { self.width }
    }

    /// The keys from one second to another, both included; where one of these has no key it gets one, which changes nothing
    /// between them.
    pub fn part(&self, from: f64, to: f64) -> Track {
        let mut part = Track { times: Vec::new(), values: Vec::new(), width: self.width, between: self.between };
        let inside = |time: &f64| (from - SAME_S..=to + SAME_S).contains(time);
        let inner: Vec<usize> = (0..self.times.len()).filter(|&key| inside(&self.times[key])).collect();
        let is_key = |time: f64, key: Option<&usize>| key.is_some_and(|&key| (self.times[key] - time).abs() <= SAME_S);
        if from.is_finite() && !is_key(from, inner.first()) {
            part.push(from, &self.key_at(from));
        }
        for &key in &inner {
            part.push(self.times[key], &self.values[key * self.each()..(key + 1) * self.each()]);
        }
        if to.is_finite() && to > from + SAME_S && !is_key(to, inner.last()) {
            part.push(to, &self.key_at(to));
        }
        part
    }

    fn push(&mut self, time: f64, numbers: &[f64]) {
        self.times.push(time);
        self.values.extend_from_slice(numbers);
    }

    /// The numbers of a key that changes nothing.
    fn key_at(&self, time: f64) -> Vec<f64> {
        match (self.between, self.width) {
            (Between::Cubic, _) => {
                let (value, slope) = (self.components(time), self.slopes(time));
                [slope.clone(), value, slope].concat()
            }
            (Between::Linear, 4) => {
                let near = Quat::from_slice(self.value(self.place(time).0));
                nearest_sign(self.rotation(time), near).to_array().to_vec()
            }
            _ => self.components(time),
        }
    }

    /// The same keys and new ones (N) at these seconds, in place of those between the seconds `from` and `to`, which stay.
    pub fn with(&self, (from, to): (f64, f64), new: &[(f64, Vec<f64>)]) -> Track {
        let none = Track { times: Vec::new(), values: Vec::new(), ..*self };
        let mut all = if from.is_finite() { self.part(f64::NEG_INFINITY, from) } else { none };
        let (each, width) = (all.each(), all.width);
        let first = all.times.len();
        // a cubic way between quaternions is the short one only between those of like sign
        let like = |numbers: &[f64], last: Option<&[f64]>| match last {
            Some(last) if width == 4 && last.iter().zip(numbers).map(|(a, b)| a * b).sum::<f64>() < 0.0 => -1.0,
            _ => 1.0,
        };
        let value = |all: &Track, key: usize| all.value(key).to_vec();
        for (time, numbers) in new {
            let last = all.times.len().checked_sub(1).map(|key| value(&all, key));
            let sign = like(numbers, last.as_deref());
            let own: Vec<f64> = numbers.iter().map(|x| sign * x).collect();
            // tangents follow below
            let tangent = vec![0.0; (each - width) / 2];
            all.push(*time, &[tangent.clone(), own, tangent].concat());
        }
        let end = all.times.len();
        if to.is_finite() {
            let rest = self.part(to, f64::INFINITY);
            let last = end.checked_sub(1).map(|key| value(&all, key));
            // all that follows: the same rotations
            let sign = if self.between == Between::Cubic { like(rest.value(0), last.as_deref()) } else { 1.0 };
            for (key, &time) in rest.times.iter().enumerate() {
                let own = &rest.values[key * each..(key + 1) * each];
                all.push(time, &own.iter().map(|x| sign * x).collect::<Vec<_>>());
            }
        }
        if self.between == Between::Cubic {
            all.straighten(first..end);
        }
        all
    }

    /// Gives keys of a cubic track the tangents with which it is linear between them.
    fn straighten(&mut self, keys: std::ops::Range<usize>) {
        for key in keys {
            for (side, [a, b]) in [(0, [key.wrapping_sub(1), key]), (2, [key, key + 1])] {
                if a < self.times.len() && b < self.times.len() {
                    let (span, each) = (self.times[b] - self.times[a], self.each());
                    for c in 0..self.width {
                        self.values[key * each + side * self.width + c] = (self.value(b)[c] - self.value(a)[c]) / span;
                    }
                }
            }
        }
    }

    /// The keys in another time: `begin` becomes 0, and seconds are `longer` times as long.
    pub fn retimed(mut self, begin: f64, longer: f64) -> Track {
        self.times.iter_mut().for_each(|time| *time = (*time - begin) * longer);
        if self.between == Between::Cubic {
            let (each, width) = (self.each(), self.width);
            let is_tangent = |n: usize| !(width..2 * width).contains(&(n % each));
            self.values.iter_mut().enumerate().filter(|(n, _)| is_tangent(*n)).for_each(|(_, x)| *x /= longer);
        }
        self
    }
}

/// The numbers of a key.
pub fn of_quat(q: Quat) -> Vec<f64> {
    q.to_array().to_vec()
}

/// The numbers of a key.
pub fn of_place(p: Vec3) -> Vec<f64> {
    p.to_array().to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One number at the seconds 0, 1, 2, 3.
    fn track(between: Between) -> Track {
        let values = [5.0, 7.0, 1.0, 2.0];
        let values = match between {
            Between::Cubic => values.iter().flat_map(|v| [0.5, *v, -0.25]).collect(),
            _ => values.to_vec(),
        };
        Track { times: vec![0.0, 1.0, 2.0, 3.0], values, width: 1, between }
    }

    #[test]
    fn new_keys_change_nothing_outside() {
        for between in [Between::Linear, Between::Step, Between::Cubic] {
            let old = track(between);
            let new: Vec<(f64, Vec<f64>)> = (1..=3).map(|n| (0.75 + 0.25 * f64::from(n), vec![f64::from(n)])).collect();
            let edited = old.with((0.75, 1.75), &new);
            for (time, value) in &new {
                assert!((edited.components(*time)[0] - value[0]).abs() < 1e-12, "{between:?} at {time}");
            }
            for n in 0..=300 {
                let time = f64::from(n) / 100.0;
                if !(0.75..1.75).contains(&time) {
                    let (a, b) = (edited.components(time)[0], old.components(time)[0]);
                    assert!((a - b).abs() < 1e-9, "{between:?} at {time}: {a} {b}");
                }
            }
            // whole keys outside are the same bits
            let each = edited.each();
            assert_eq!(edited.values[..each], old.values[..each], "{between:?}");
            assert_eq!(edited.values[edited.values.len() - each..], old.values[3 * each..], "{between:?}");
            let straight = (edited.components(1.125)[0] - 1.5).abs();
            assert!(between == Between::Step || straight < 1e-12, "{between:?}: {straight}");
        }
    }

    #[test]
    fn parts_ends_and_another_time() {
        let old = track(Between::Cubic);
        let part = old.part(0.5, 2.5);
        assert_eq!(part.times, [0.5, 1.0, 2.0, 2.5]);
        for n in 0..=20 {
            let time = 0.5 + f64::from(n) / 10.0;
            assert!((part.components(time)[0] - old.components(time)[0]).abs() < 1e-12, "{time}");
        }
        let slow = old.part(0.0, 3.0).retimed(1.0, 2.0);
        assert_eq!(slow.times, [-2.0, 0.0, 2.0, 4.0]);
        assert!((slow.components(1.0)[0] - track(Between::Cubic).components(1.5)[0]).abs() < 1e-12);
        // from the beginning, and to the end
        let linear = track(Between::Linear);
        assert_eq!(
            linear.with((f64::NEG_INFINITY, 1.0), &[(0.0, vec![9.0]), (0.5, vec![8.0])]).values,
            [9.0, 8.0, 7.0, 1.0, 2.0]
        );
        assert_eq!(linear.with((2.0, f64::INFINITY), &[(2.5, vec![9.0])]).times, [0.0, 1.0, 2.0, 2.5]);
        // what never moved, in the middle
        let still = Track::still(vec![4.0]).with((1.0, 2.0), &[(1.5, vec![9.0])]);
        assert_eq!((still.times, still.values), (vec![0.0, 1.0, 1.5, 2.0], vec![4.0, 4.0, 9.0, 4.0]));
    }

    #[test]
    fn the_way_back_to_old_keys_is_the_short_one() {
        let q = |angle: f64| of_quat(Quat::from_rotation_x(angle));
        let minus = |q: Vec<f64>| q.iter().map(|x| -x).collect::<Vec<f64>>();
        let values = [q(0.0), minus(q(0.2)), minus(q(0.3))].concat();
        let old = Track { times: vec![0.0, 1.0, 2.0], values: values.clone(), width: 4, between: Between::Linear };
        let new = [(0.0, q(0.1))];
        // which a reader takes for itself between linear keys, so that these stay
        assert_eq!(old.with((f64::NEG_INFINITY, 1.0), &new).values[4..], values[4..]);
        let tangents = values.chunks(4).flat_map(|value| [vec![0.0; 4], value.to_vec(), vec![0.0; 4]]);
        let cubic = Track { values: tangents.flatten().collect(), between: Between::Cubic, ..old };
        let edited = cubic.with((f64::NEG_INFINITY, 1.0), &new);
        assert_eq!([edited.value(0), edited.value(1), edited.value(2)].concat(), [q(0.1), q(0.2), q(0.3)].concat());
    }
}
