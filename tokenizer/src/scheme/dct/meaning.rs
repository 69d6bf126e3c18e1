//! What the numbers and characters of a tile stand for.

use super::DctTiles;
use super::config::Steps;
use crate::channel::Channels;
use crate::meaning::{Legend, Meaning, Number, Series, Unit};
use crate::scheme::runs::Part;
use crate::scheme::series;

impl DctTiles {
    pub(super) fn legend_of(&self, channels: &Channels) -> Legend {
        let unit = if self.config.steps == Steps::LeverArm { Unit::Metres } else { Unit::Radians };
        let closed = series::closed_count(channels);
        let of_root = |(i, channel)| Series::of(channel, "", if i < 3 { Unit::Metres } else { Unit::Radians });
        let mut all: Vec<Series> = channels.iter().take(closed).enumerate().map(of_root).collect();
        match self.mix.mixes() {
            true => all.extend(self.mix.series(&series::open_joints(channels), unit)),
            false => all.extend(channels.iter().skip(closed).map(|channel| Series::of(channel, "", Unit::Radians))),
        }
        let n = self.config.tile as usize;
        let numbers = (0..all.len() * n).map(|i| Number { series: i / n, coefficient: Some(i % n) }).collect();
        Legend { word: "tile", series: all, numbers }
    }

    pub(super) fn meanings_of(&self, channels: &Channels, word: &[u16]) -> Vec<Meaning> {
        let (n, runs, most) = (self.config.tile as usize, self.config.runs(), self.numbers_in_tile(channels));
        let closed = series::closed_count(channels);
        let per_unit = |series: usize| match series {
            0..3 => 1.0,
            _ if series < closed => self.config.turn_weight(),
            _ if self.mix.mixes() => 1.0,
            _ => self.mix.weight(series - closed),
        };
        let value = |number: usize, code| {
            let table = self.tables().find(|(range, _)| range.contains(&number)).map(|(_, table)| table)?;
            // the transform is orthonormal: over the tile, a coefficient's mean square is its own square by L
            let value = table.value(code) / (n as f64).sqrt() / per_unit(number / n);
            Some(Meaning::Value { number, value })
        };
        let mut at = 0;
        let meaning = |&code: &u16| {
            let place = at;
            match runs.part(code) {
                Part::Value(code) => {
                    at += 1;
                    value(place, code).unwrap_or(Meaning::Nothing)
                }
                Part::Zeros(count) => {
                    at += count;
                    Meaning::zeros(place, count, most)
                }
            }
        };
        word.iter().map(meaning).collect()
    }
}
