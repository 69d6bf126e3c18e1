//! Ctrl-C and callbacks during long work.

use crate::error::library;
use pyo3::prelude::*;
use std::ops::ControlFlow;

/// What ended long work from the Python side: KeyboardInterrupt, or what a callback raised.
#[derive(Default)]
pub struct Interrupt(Option<PyErr>);

impl Interrupt {
    /// `Break` when Ctrl-C was pressed.
    pub fn check(&mut self) -> ControlFlow<()> {
        self.during(|py| py.check_signals())
    }

    /// Runs what may raise; `Break` when it did.
    pub fn during(&mut self, work: impl FnOnce(Python<'_>) -> PyResult<()>) -> ControlFlow<()> {
        match Python::attach(work) {
            Ok(()) => ControlFlow::Continue(()),
            Err(e) => {
                self.0 = Some(e);
                ControlFlow::Break(())
            }
        }
    }

    /// The result of the work, or what ended it.
    pub fn result<T>(self, result: Result<T, impl Into<kinelm::Error>>) -> PyResult<T> {
        match self.0 {
            Some(e) => Err(e),
            None => result.map_err(library),
        }
    }
}
