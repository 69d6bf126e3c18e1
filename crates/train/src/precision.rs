//! In which numbers a training multiplies, as a training file asks for it and as a machine can do it.

use crate::{Error, Result};
use kinelm_engine::linear::Products;
use kinelm_model::Compute;
use serde::{Deserialize, Serialize};

/// In which numbers the products of training are computed. Weights, optimizer, sums, softmax and norms are f32 in any case,
/// and so is every measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// f32.
    #[default]
    F32,
    /// Factors are rounded to bf16 on their way into a product; sums are f32.
    Bf16,
    /// bf16 where the processor multiplies it on tiles (AMX), else f32. A run that is gone on with stays what it was.
    Auto,
}

impl std::str::FromStr for Precision {
    type Err = Error;

    fn from_str(name: &str) -> Result<Precision> {
        match name {
            "f32" => Ok(Precision::F32),
            "bf16" => Ok(Precision::Bf16),
            "auto" => Ok(Precision::Auto),
            other => Err(Error::call(format!("precision {other:?}; expected f32, bf16 or auto"))),
        }
    }
}

/// How a training multiplies from now on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chosen {
    /// The kernels.
    pub products: Products,
    /// What the user should know.
    pub notes: Vec<String>,
}

impl Precision {
    /// The kernels of this machine, after those of the name `ran`, if a checkpoint tells.
    ///
    /// # Errors
    /// bf16 of a form or a device that computes in f32 alone.
    pub fn choose(self, ran: Option<&str>, compute: Compute) -> Result<Chosen> {
        if !compute.is_fast() {
            return match self {
                Precision::Bf16 => Err(Error::call(
                    "train.precision is bf16, which the CPU's fast form computes; this form computes in f32: ask for f32 \
                     (--precision f32), or for the fast form",
                )),
                _ => Ok(Chosen { products: Products::F32, notes: Vec::new() }),
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
        Ok(Chosen { products, notes })
    }

    /// What a checkpoint says of the kernels; nothing where all is f32 because it was asked for.
    pub fn recorded(self, products: Products) -> Option<String> {
        (self != Precision::F32).then(|| products.name().into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_model::Form;

    #[test]
    fn what_ran_decides_what_runs_on() {
        let cpu = Compute::default();
        let best = Products::bf16();
        let auto = if best == Products::Tiles { Products::Tiles } else { Products::F32 };
        let chosen = |asked: Precision, ran| asked.choose(ran, cpu).unwrap();
        assert_eq!(chosen(Precision::F32, None), Chosen { products: Products::F32, notes: Vec::new() });
        assert_eq!(chosen(Precision::Bf16, None).products, best);
        let first = chosen(Precision::Auto, None);
        assert_eq!((first.products, first.notes.len()), (auto, 1));
        // what auto took once, it takes again, in silence on the same kernels
        assert_eq!(chosen(Precision::Auto, Some("f32")), Chosen { products: Products::F32, notes: Vec::new() });
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
        let said = Precision::Bf16.choose(None, plain).unwrap_err().to_string();
        assert!(said.contains("train.precision is bf16") && said.contains("--precision f32"), "{said}");
        assert_eq!(Precision::Auto.choose(None, plain).unwrap().products, Products::F32);
    }
}
