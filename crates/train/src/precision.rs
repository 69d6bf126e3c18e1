//! The numbers that products are computed in, as requested and as the machine supports.

use crate::{Error, Result};
use kinelm_engine::linear::Products;
use kinelm_model::Compute;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// How many times as fast bf16 has to be: products aren't all of a step, and its rounding costs some bits.
const PAYS: f64 = 1.3;
/// Rows of the product that is timed, the pieces that threads take of it, and how often it is.
const TIMED_ROWS: usize = 512;
const TIMED_PIECES: usize = 8;
const TIMED: usize = 9;

/// The numbers that the products of training are computed in. Weights, optimizer, sums, softmax, norms and measurements are
/// always f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// f32.
    #[default]
    F32,
    /// Factors are rounded to bf16; sums are f32.
    Bf16,
    /// bf16 where its products are clearly faster on this machine ([`Precision::decide`]), else f32.
    Auto,
}

impl std::str::FromStr for Precision {
    type Err = Error;

    fn from_str(name: &str) -> Result<Precision> {
        match name {
            "f32" => Ok(Precision::F32),
            "bf16" => Ok(Precision::Bf16),
            "auto" => Ok(Precision::Auto),
            other => Err(Error::invalid_parameter("precision", format!("{other:?}"), "f32, bf16 or auto")),
        }
    }
}

/// A precision on this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Resolved {
    /// The kernels.
    pub products: Products,
    /// Notes for the user.
    pub notes: Vec<String>,
}

impl Precision {
    /// The precision of a new run of a model of this width: [`Precision::Auto`] becomes that of the quicker products, which
    /// are timed for it. With what the user should know.
    ///
    /// # Errors
    /// bf16 for a form or a device that computes only in f32.
    pub fn decide(self, compute: Compute, width: usize) -> Result<(Precision, Option<String>)> {
        self.check(compute)?;
        if self != Precision::Auto {
            return Ok((self, None));
        }
        let best = Products::bf16();
        if !compute.is_fast() || best != Products::Bf16 {
            return Ok((Precision::F32, Some("train.precision = auto: f32".into())));
        }
        // timed rather than assumed: how much faster bf16 is differs between processors
        let ratio = seconds(Products::F32, width) / seconds(best, width);
        let chosen = if ratio > PAYS { Precision::Bf16 } else { Precision::F32 };
        let name = if chosen == Precision::Bf16 { "bf16" } else { "f32" };
        let note = format!("train.precision = auto: {name}; bf16 by {} is {ratio:.1} times as fast here", best.name());
        Ok((chosen, Some(note)))
    }

    /// Refuses bf16 where a form or a device computes only in f32.
    fn check(self, compute: Compute) -> Result<()> {
        if !compute.is_fast() && self == Precision::Bf16 {
            let expected = "f32, which this form computes in, or the CPU's fast form";
            return Err(Error::invalid("train.precision", "bf16", expected));
        }
        Ok(())
    }

    /// The kernels of this machine, for a run whose checkpoint was computed by the kernels named `ran`, if there is one.
    /// [`Precision::Auto`] that nobody decided is f32.
    ///
    /// # Errors
    /// bf16 for a form or a device that computes only in f32.
    pub fn resolve(self, ran: Option<&str>, compute: Compute) -> Result<Resolved> {
        self.check(compute)?;
        let products = match self {
            Precision::Bf16 => Products::bf16(),
            _ => Products::F32,
        };
        let mut notes = Vec::new();
        if products == Products::Rounded {
            notes
                .push("this processor doesn't multiply bf16: products are rounded alike but slower than in f32".into());
        }
        if let Some(ran) = ran.filter(|ran| *ran != products.name()) {
            notes.push(format!(
                "products were computed by {ran} so far, now by {}: from here on the run is no longer bit-equal",
                products.name()
            ));
        }
        Ok(Resolved { products, notes })
    }

    /// The name of the kernels for a checkpoint; `None` where f32 was requested.
    pub(crate) fn recorded(self, products: Products) -> Option<String> {
        // a state without the field means f32
        (self != Precision::F32).then(|| products.name().into())
    }
}

/// Seconds of the product of a layer of this width and of the layout of its weight, the least of several.
fn seconds(products: Products, width: usize) -> f64 {
    let (rows, k, n) = (TIMED_ROWS, width, 4 * width);
    let (a, weight) = (vec![0.5; rows * k], vec![0.5; k * n]);
    let mut panels = vec![0.0; products.panels_len(k, n)];
    let mut out = vec![0.0; rows * n];
    let mut once = || {
        let begun = Instant::now();
        products.pack_parallel(&mut panels, &weight, k, n);
        out.par_chunks_mut(n * rows / TIMED_PIECES).zip(a.par_chunks(k * rows / TIMED_PIECES)).for_each(|(out, a)| {
            products.times(out, a, k, &panels, n);
        });
        begun.elapsed().as_secs_f64()
    };
    // the least: whatever else runs on the machine only adds time
    (0..TIMED).map(|_| once()).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_model::Form;

    #[test]
    fn auto_is_decided_once() {
        let cpu = Compute::default();
        let (chosen, note) = Precision::Auto.decide(cpu, 128).unwrap();
        assert!(chosen != Precision::Auto && note.unwrap().contains("train.precision = auto: "));
        if Products::bf16() == Products::Rounded {
            assert_eq!(chosen, Precision::F32);
        }
        for own in [Precision::F32, Precision::Bf16] {
            assert_eq!(own.decide(cpu, 128).unwrap(), (own, None));
        }
    }

    #[test]
    fn another_machines_kernels_are_said() {
        let cpu = Compute::default();
        let best = Products::bf16();
        let chosen = |requested: Precision, ran| requested.resolve(ran, cpu).unwrap();
        assert_eq!(chosen(Precision::F32, None), Resolved { products: Products::F32, notes: Vec::new() });
        assert_eq!(chosen(Precision::Bf16, None).products, best);
        let same = chosen(Precision::Bf16, Some(best.name()));
        assert!(same.products == best && !same.notes.join("").contains("so far"));
        let other = if best.name() == "amx" { "emulated" } else { "amx" };
        let said = chosen(Precision::Bf16, Some(other)).notes.join("\n");
        assert!(
            said.contains(&format!("computed by {other} so far")) && said.contains("no longer bit-equal"),
            "{said}"
        );
        assert_eq!(Precision::F32.recorded(Products::F32), None);
    }

    #[test]
    fn the_plain_form_has_no_bf16() {
        let plain = Compute { form: Form::Plain, ..Default::default() };
        for said in [Precision::Bf16.resolve(None, plain).unwrap_err(), Precision::Bf16.decide(plain, 8).unwrap_err()] {
            assert!(said.to_string().contains("train.precision is bf16; expected f32"), "{said}");
        }
        assert_eq!(Precision::Auto.decide(plain, 128).unwrap().0, Precision::F32);
    }
}
