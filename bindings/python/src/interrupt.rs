//! Ctrl-C and callbacks during long work.

use crate::error::library;
use pyo3::prelude::*;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

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

    /// Calls the callback, if there is one, with what `said` makes; sets `stop` where it returns False or raises, and
    /// at Ctrl-C.
    pub fn tell<'a>(
        &mut self,
        callback: Option<&Py<PyAny>>,
        stop: &AtomicBool,
        said: impl for<'py> FnOnce(Python<'py>) -> PyResult<Bound<'py, PyAny>> + 'a,
    ) {
        let mut goes_on = true;
        let raised = self.during(|py| {
            py.check_signals()?;
            if let Some(callback) = callback {
                let answer = callback.call1(py, (said(py)?,))?;
                // a callback that returns None goes on
                goes_on = answer.extract::<bool>(py).unwrap_or(true);
            }
            Ok(())
        });
        // a stop that was requested before stays
        stop.fetch_or(raised.is_break() || !goes_on, Ordering::SeqCst);
    }

    /// The result of the work, or what ended it.
    pub fn result<T>(self, result: Result<T, impl Into<kinelm::Error>>) -> PyResult<T> {
        match self.0 {
            // the exception itself, not the library's error that it was stopped
            Some(e) => Err(e),
            None => result.map_err(library),
        }
    }
}
