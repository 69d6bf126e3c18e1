//! What the characters of words stand for.

use crate::channel::Channel;
use std::ops::Range;

/// The unit of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Unit {
    /// Radians.
    Radians,
    /// Metres.
    Metres,
    /// Radians per frame.
    RadiansPerFrame,
    /// Metres per frame.
    MetresPerFrame,
}

/// A series of numbers over time: a channel, or a component of a joint transform.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Its name, such as `right_wrist z` or `component 5`.
    pub name: String,
    /// The unit of its values.
    pub unit: Unit,
    /// The SMPL joints that it moves, largest share first: each joint's share of the squared movement, up to nine tenths
    /// in all. The root's translation counts as the pelvis's.
    pub joints: Vec<(usize, f64)>,
}

impl Series {
    /// The series of a channel; `what` says more of its values, if it isn't empty.
    pub(crate) fn of(channel: Channel, what: &str, unit: Unit) -> Series {
        let comma = if what.is_empty() { "" } else { ", " };
        Series { name: format!("{channel}{comma}{what}"), unit, joints: vec![(channel.joint(), 1.0)] }
    }
}

/// A number of a word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Number {
    /// The index of its series.
    pub series: usize,
    /// The frequency of the coefficient: half waves in a word, 0 for the mean; `None` when a word is a frame.
    pub coefficient: Option<usize>,
}

/// What the numbers of every word are.
#[derive(Debug, Clone, PartialEq)]
pub struct Legend {
    /// What a word is: `frame`, `tile` or `hop`.
    pub word: &'static str,
    /// The series.
    pub series: Vec<Series>,
    /// The numbers in the order in which a word has them.
    pub numbers: Vec<Number>,
}

impl Legend {
    /// The legend of words whose numbers are a frame's channels or components, one of each.
    pub(crate) fn of_frames(series: Vec<Series>) -> Self {
        let numbers = (0..series.len()).map(|series| Number { series, coefficient: None }).collect();
        Legend { word: "frame", series, numbers }
    }
}

/// What a character stands for.
#[derive(Debug, Clone, PartialEq)]
pub enum Meaning {
    /// The value of a number in its series' unit. A coefficient's is signed, in root mean square over the word's
    /// frames.
    Value {
        /// The index of the number in [`Legend::numbers`].
        number: usize,
        /// The decoded value.
        value: f64,
    },
    /// A digit of the number whose value a later character completes.
    Digit {
        /// The index of the number.
        number: usize,
    },
    /// Numbers that are zero.
    Zeros(Range<usize>),
    /// Nothing: the word's numbers ended before it.
    Nothing,
}

impl Meaning {
    /// The meaning of zeros from a place on in words of `most` numbers.
    pub(crate) fn zeros(place: usize, count: usize, most: usize) -> Meaning {
        if place < most { Meaning::Zeros(place..place.saturating_add(count).min(most)) } else { Meaning::Nothing }
    }
}

/// The joints of a series and their shares, from the movement of each of its channels per unit: (joint, movement).
pub(crate) fn shares(movements: impl IntoIterator<Item = (usize, f64)>) -> Vec<(usize, f64)> {
    let mut squares = [0.0; 24];
    movements.into_iter().for_each(|(joint, movement)| squares[joint] += movement * movement);
    // a component that moves nothing has no joints
    let sum = squares.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let mut joints: Vec<(usize, f64)> = squares.iter().map(|x| x / sum).enumerate().filter(|(_, x)| *x > 0.0).collect();
    joints.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut before = 0.0;
    joints.retain(|(_, share)| {
        let needed = before < 0.9;
        before += share;
        needed
    });
    joints
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_of_squares_up_to_nine_tenths() {
        // 16, 9 + 0, 1 of 26: the two largest are 25/26
        let all = shares([(3, 4.0), (7, 3.0), (9, 1.0), (7, 0.0)]);
        assert_eq!(all.iter().map(|(j, _)| *j).collect::<Vec<_>>(), [3, 7]);
        assert!((all[0].1 - 16.0 / 26.0).abs() < 1e-12 && (all[1].1 - 9.0 / 26.0).abs() < 1e-12);
        assert_eq!((shares([(5, -2.0)]), shares([(5, 0.0)])), (vec![(5, 1.0)], vec![]));
    }
}
