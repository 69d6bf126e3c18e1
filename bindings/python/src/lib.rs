//! The extension module of the `kinelm` package for Python: the library as Python objects, and the program.
//!
//! Long work runs without the interpreter's lock; what may use the pool of threads goes through `pool::detach`. Arrays go in
//! as numpy's of f64, as copies; what is computed for a call comes out as an array without one.

mod classifier;
mod clip;
mod compare;
mod corpus;
mod error;
mod evaluate;
mod index;
mod interrupt;
mod json;
mod model;
mod options;
mod pool;
mod tokenizer;
mod training;

use pyo3::prelude::*;
use std::ffi::OsString;

#[global_allocator]
static MEMORY: mimalloc::MiMalloc = mimalloc::MiMalloc;

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
    module.add_class::<corpus::Corpus>()?;
    module.add_class::<corpus::Sequences>()?;
    module.add_class::<model::Model>()?;
    module.add_class::<model::Frames>()?;
    module.add_class::<index::Index>()?;
    module.add_class::<classifier::Classifier>()?;
    module.add_function(wrap_pyfunction!(training::pretrain, module)?)?;
    module.add_function(wrap_pyfunction!(training::finetune, module)?)?;
    module.add_function(wrap_pyfunction!(training::resume, module)?)?;
    module.add_function(wrap_pyfunction!(clip::read_many, module)?)?;
    module.add_function(wrap_pyfunction!(compare::compare, module)?)?;
    module.add_function(wrap_pyfunction!(evaluate::evaluate, module)?)?;
    module.add_function(wrap_pyfunction!(main, module)?)
}
