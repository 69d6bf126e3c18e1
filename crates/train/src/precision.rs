//! The numbers that products are computed in, as requested and as the machine supports.

use crate::{Error, Result};
use kinelm_engine::linear::Products;
use kinelm_model::Compute;
use serde::{Deserialize, Serialize};

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
    /// bf16 on processors with bf16 tiles (AMX), else f32. A resumed run keeps its numbers.
    Auto,
}

impl std::str::FromStr for Precision {
    type Err = Error;

    fn from_str(name: &str) -> Result<Precision> {
        match name {
            "f32" => Ok(Precision::F32),
            "bf16" => Ok(Precision::Bf16),
            "auto" => Ok(Precision::Auto),
            other => Err(Error::invalid("`precision`", format!("{other:?}"), "f32, bf16 or auto")),
        }
    }
}

/// A precision on this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Resolved {
    /// The kernels.
    pub products: Products,
    /// What the user should know.
    pub notes: Vec<String>,
}

impl Precision {
    /// The kernels of this machine, for a run whose checkpoint was computed by the kernels named `ran`, if there is one.
    ///
    /// # Errors
    /// bf16 for a form or a device that computes only in f32.
    pub fn resolve(self, ran: Option<&str>, compute: Compute) -> Result<Resolved> {
        if !compute.is_fast() {
            return match self {
                Precision::Bf16 => Err(Error::invalid(
                    "train.precision",
                    "bf16",
                    "f32, which this form computes in, or the CPU's fast form",
                )),
                _ => Ok(Resolved { products: Products::F32, notes: Vec::new() }),
            };
        }
        let products = match (self, ran) {
            (Precision::F32, _) => Products::F32,
            (Precision::Auto, Some("f32")) => Products::F32,
            (Precision::Auto, None) if Products::bf16() != Products::Tiles => Products::F32,
            _ => Products::bf16(),
        };
        let mut notes = Vec::new();
        if products == Products::Rounded {
            notes
                .push("this machine has no bf16 tiles (AMX): products are rounded alike but slower than in f32".into());
        }
        match ran.filter(|ran| *ran != products.name()) {
            Some(ran) => notes.push(format!(
                "products were computed by {ran} so far, now by {}: from here on the run is no longer bit-equal",
                products.name()
            )),
            None if self == Precision::Auto && ran.is_none() => {
                notes.push(format!("train.precision = auto: products by {}", products.name()));
            }
            None => (),
        }
        Ok(Resolved { products, notes })
    }

    /// The name of the kernels for a checkpoint; `None` where f32 was requested.
    pub fn recorded(self, products: Products) -> Option<String> {
        (self != Precision::F32).then(|| products.name().into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_model::Form;

    #[test]
    fn a_checkpoints_kernels_decide_auto() {
        let cpu = Compute::default();
        let best = Products::bf16();
        let auto = if best == Products::Tiles { Products::Tiles } else { Products::F32 };
        let chosen = |requested: Precision, ran| requested.resolve(ran, cpu).unwrap();
        assert_eq!(chosen(Precision::F32, None), Resolved { products: Products::F32, notes: Vec::new() });
        assert_eq!(chosen(Precision::Bf16, None).products, best);
        let first = chosen(Precision::Auto, None);
        assert_eq!((first.products, first.notes.len()), (auto, 1));
        // auto keeps its kernels, and notes nothing on the same ones
        assert_eq!(chosen(Precision::Auto, Some("f32")), Resolved { products: Products::F32, notes: Vec::new() });
        assert_eq!(chosen(Precision::Auto, Some(best.name())).products, best);
        let other = if best == Products::Tiles { "emulated" } else { "amx" };
        let said = chosen(Precision::Bf16, Some(other)).notes.join("\n");
        assert!(
            said.contains(&format!("computed by {other} so far")) && said.contains("no longer bit-equal"),
            "{said}"
        );
        assert_eq!(Precision::F32.recorded(Products::F32), None);
        assert_eq!(Precision::Auto.recorded(Products::F32).as_deref(), Some("f32"));
    }

    #[test]
    fn the_plain_form_has_no_bf16() {
        let plain = Compute { form: Form::Plain, ..Default::default() };
        let said = Precision::Bf16.resolve(None, plain).unwrap_err().to_string();
        assert!(said.contains("train.precision is bf16; expected f32"), "{said}");
        assert_eq!(Precision::Auto.resolve(None, plain).unwrap().products, Products::F32);
    }
}
