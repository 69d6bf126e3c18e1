//! What the numbers and characters of a hop stand for.

use super::root::Root;
use super::word::Written;
use super::{Lapped, LappedMix, Layout, lifted};
use crate::channel::{Channel, Channels};
use crate::meaning::{Legend, Meaning, Number, Series, Unit, shares};
use crate::scheme::series::{closed_count, lever_arms, open_joints};
use kinelm_motion::rotation::Axis;

/// The closed series of the legend after the open ones: turn, x and z, each as the hop's displacement and as a velocity;
/// then the jump of the turn.
const CLOSED: [Channel; 3] = [Channel::Turn, Channel::Translation(Axis::X), Channel::Translation(Axis::Z)];

impl Lapped {
    /// The legend's index of a closed series, counted from the turn.
    fn closed_at(layout: Layout, series: usize, frequency: usize) -> usize {
        // without a turn, the ground's series come first
        let series = series - layout.open + usize::from(!layout.turn);
        layout.open + 2 * series + usize::from(frequency > 0)
    }

    pub(super) fn legend_of(&self, channels: &Channels) -> Legend {
        let layout = Layout::new(&self.config, channels);
        let arms = lever_arms();
        let joints = open_joints(channels);
        let closed = closed_count(channels);
        let open = |c: usize| match self.config.joint_transform {
            LappedMix::Klt {} => {
                let column = self.inverse.iter().skip(c).step_by(layout.open);
                // displacements, so that a height and rotations are comparable
                let moved = joints.iter().map(|&j| (j, arms[j])).chain([(0, 1.0)]).zip(column);
                let joints = shares(moved.map(|((joint, arm), x)| (joint, arm * x)));
                Series { name: format!("component {c}"), unit: Unit::Metres, joints }
            }
            // the height is the last, after the channels
            LappedMix::None {} => channels.at(closed + c).map_or_else(
                || Series::of(Channel::Translation(Axis::Y), "height", Unit::Metres),
                |channel| Series::of(channel, "", Unit::Radians),
            ),
        };
        let mut series: Vec<Series> = (0..layout.open).map(open).collect();
        for channel in CLOSED {
            let [sum, rate] = match channel {
                Channel::Turn => [Unit::Radians, Unit::RadiansPerFrame],
                _ => [Unit::Metres, Unit::MetresPerFrame],
            };
            series.extend([Series::of(channel, "over the hop", sum), Series::of(channel, "velocity", rate)]);
        }
        series.push(Series::of(Channel::Turn, "at the first frame", Unit::Radians));
        let number = |&at: &u32| {
            let (frequency, own) = (at as usize / layout.series(), at as usize % layout.series());
            match at as usize == layout.facing() {
                true => Number { series: series.len() - 1, coefficient: Some(0) },
                false if own < layout.open => Number { series: own, coefficient: Some(frequency) },
                false => Number { series: Lapped::closed_at(layout, own, frequency), coefficient: Some(frequency) },
            }
        };
        Legend { word: "hop", numbers: self.order.iter().map(number).collect(), series }
    }

    pub(super) fn meanings_of(&self, channels: &Channels, word: &[u16]) -> Vec<Meaning> {
        let layout = Layout::new(&self.config, channels);
        let root = Root::new(self, channels);
        let rms = 1.0 / (layout.hop as f64).sqrt();
        let value = |at: usize, number: i32| {
            let (frequency, own) = (at / layout.series(), at % layout.series());
            let closed = f64::from(number) * root.displacement_step();
            let (turn, _) = layout.closed();
            let per_unit = if layout.turn && own == turn { self.turn_arm } else { 1.0 };
            match (at == layout.facing(), own < layout.open, frequency) {
                (true, ..) => closed / self.turn_arm,
                (_, true, _) => {
                    let component = lifted(number) * self.config.step() * rms;
                    match self.config.joint_transform {
                        LappedMix::Klt {} => component,
                        LappedMix::None {} => component * self.inverse[own * layout.open + own],
                    }
                }
                (_, _, 0) => closed / per_unit,
                (.., f) => lifted(number) * root.step(f) * rms / per_unit,
            }
        };
        let meaning = |written| match written {
            Written::Digit { place } if place < self.order.len() => Meaning::Digit { number: place },
            Written::Zeros { place, count } => Meaning::zeros(place, count, self.order.len()),
            Written::Number { place, number } => match self.order.get(place) {
                Some(&at) => Meaning::Value { number: place, value: value(at as usize, number) },
                None => Meaning::Nothing,
            },
            Written::Digit { .. } => Meaning::Nothing,
        };
        self.writing().parse(word).map(meaning).collect()
    }
}
