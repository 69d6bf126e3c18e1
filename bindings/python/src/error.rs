//! The library's errors as a Python exception with the library's kind.

use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(kinelm, Error, PyException, "What kinelm could not do: its text says what, where, and what to do.");

/// The exception of an error; its `kind` is one of io, file, call, limit, stopped, failed.
pub fn raised(text: String, kind: kinelm::store::Kind) -> PyErr {
    let error = Error::new_err(text);
    let kind = format!("{kind:?}").to_lowercase();
    Python::attach(|py| {
        // an attribute that can't be set takes nothing from the message
        let _ = error.value(py).setattr("kind", kind);
    });
    error
}

/// The exception of an error of motion files and clips.
pub fn motion(e: kinelm::motion::Error) -> PyErr {
    raised(e.to_string(), e.kind())
}

/// The exception of any other error of the library.
pub fn library(e: impl Into<kinelm::Error>) -> PyErr {
    let e = e.into();
    raised(e.to_string(), e.kind())
}
