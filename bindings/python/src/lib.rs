//! The extension module of the `kinelm` package for Python: clips, tokenizers and models as Python objects, and the program.
//!
//! Long work runs without the interpreter's lock. Arrays go in and out as numpy's, f64, as copies.

mod clip;
mod error;
mod model;
mod tokenizer;

use pyo3::prelude::*;
use std::ffi::OsString;

/// Runs the program with these arguments, its name in front, and gives the exit code.
#[pyfunction]
fn main(py: Python<'_>, args: Vec<OsString>) -> u8 {
    py.detach(|| kinelm::cli::run(args))
}

#[pymodule]
fn _kinelm(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("Error", module.py().get_type::<error::Error>())?;
    module.add_class::<clip::Clip>()?;
    module.add_class::<tokenizer::Tokenizer>()?;
    module.add_class::<model::Model>()?;
    module.add_function(wrap_pyfunction!(main, module)?)
}
