//! Bins of coefficients.

use super::config::{DctConfig, Quantizer};
use crate::scheme::bins::Bins;
use crate::scheme::line::{Line, Scale};
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// The bins of a group of coefficients.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub(super) enum Table {
    Uniform(Line),
    Quantile(Bins),
}

/// Smaller coefficients are rounding errors, and zero.
const ZERO: f64 = 1e-9;

impl Table {
    /// Fits bins to kept coefficients of training tiles.
    pub(super) fn fitted(config: &DctConfig, mut kept: Vec<f64>) -> Table {
        match (config.quantizer, config.step) {
            (Quantizer::Uniform, Some(width)) => {
                Table::Uniform(Line { width, zero: (config.bins / 2) as u16, offset: 0.0, bins: config.bins })
            }
            (Quantizer::Uniform, None) => {
                let low = kept.iter().copied().fold(0.0, f64::min);
                let high = kept.iter().copied().fold(0.0, f64::max);
                Table::Uniform(Line::fitted(low, high, config.bins))
            }
            (Quantizer::Quantile, _) => {
                // zeros are run-length coded, so bins would be wasted on them
                kept.retain(|x| x.abs() >= ZERO);
                kept.sort_by(f64::total_cmp);
                Table::Quantile(if kept.is_empty() { Bins::at_zero() } else { Bins::fitted(&kept, config.bins) })
            }
        }
    }

    /// The code of a coefficient, `None` for zero, and whether it is clipped.
    pub(super) fn code(&self, value: f64) -> (Option<u16>, bool) {
        let (code, clipped) = match self {
            Table::Uniform(line) => line.code(value),
            Table::Quantile(bins) => bins.code(value),
        };
        ((value.abs() >= ZERO && self.value(code).abs() >= ZERO).then_some(code), clipped)
    }

    pub(super) fn value(&self, code: u16) -> f64 {
        match self {
            Table::Uniform(line) => line.value(code),
            Table::Quantile(bins) => bins.value(code),
        }
    }

    /// The quantised number for order-0 tables: 0 for zero.
    pub(super) fn number(&self, code: Option<u16>) -> i32 {
        match (self, code) {
            (_, None) => 0,
            (Table::Uniform(line), Some(code)) => i32::from(code) - i32::from(line.zero),
            (Table::Quantile(_), Some(code)) => i32::from(code) + 1,
        }
    }

    /// Numbers that decoding needs.
    pub(super) fn numbers(&self) -> u64 {
        match self {
            Table::Uniform(line) => u64::from(line.bins),
            Table::Quantile(bins) => bins.values().len() as u64,
        }
    }

    pub(super) fn validate(&self, config: &DctConfig) -> Result<()> {
        match (self, config.quantizer) {
            (Table::Uniform(line), Quantizer::Uniform) => line.validate(config.bins),
            (Table::Quantile(bins), Quantizer::Quantile) => bins.validate("coefficients", config.bins),
            _ => Err(Error::setting("quantizer", "bins of the other kind", format!("{:?} bins", config.quantizer))),
        }
    }
}
