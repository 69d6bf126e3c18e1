//! The library's errors as a Python exception with the library's data.

use kinelm::motion::Error as MotionError;
use kinelm::store::Error as StoreError;
use kinelm::store::error::{Kind, SourcePos};
use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(kinelm, Error, PyException, "What kinelm could not do: its text says what, where, and what to do.");

/// The exception of an error; its `kind` is one of io, file, call, limit, stopped, failed.
pub fn raised(text: String, kind: Kind) -> PyErr {
    with(text, kind, Data::default())
}

/// The call is wrong.
pub fn wrong(text: String) -> PyErr {
    raised(text, Kind::Call)
}

/// The exception of an error of motion files and clips.
pub fn motion(e: MotionError) -> PyErr {
    library(e)
}

/// The exception of any error of the library.
pub fn library(e: impl Into<kinelm::Error>) -> PyErr {
    let e = e.into();
    let data = match &e {
        // an error of the store has the same data inside an error of motion
        kinelm::Error::Store(e) | kinelm::Error::Motion(MotionError::Store(e)) => Data::of(e),
        kinelm::Error::Motion(MotionError::File(e)) => Data::at(&e.at, &e.found, &e.expected),
        _ => Data::default(),
    };
    with(e.to_string(), e.kind(), data)
}

/// What an error says by itself.
#[derive(Default)]
struct Data {
    path: Option<String>,
    line: Option<usize>,
    column: Option<usize>,
    name: Option<String>,
    found: Option<String>,
    expected: Option<String>,
}

impl Data {
    fn of(e: &StoreError) -> Data {
        let none = Data::default();
        match e {
            StoreError::Io { path, .. } | StoreError::Taken { path, .. } => {
                Data { path: Some(path.display().to_string()), ..none }
            }
            StoreError::File(fault) => Data::at(&fault.at, &fault.found, &fault.expected),
            StoreError::Invalid { name, found, expected } => {
                let name = Some(name.parameter().map_or_else(|| name.to_string(), str::to_owned));
                Data { name, found: Some(found.clone()), expected: Some(expected.clone()), ..none }
            }
            _ => none,
        }
    }

    fn at(at: &SourcePos, found: &str, expected: &str) -> Data {
        // both count from 1; 0 is no place
        let known = |n: usize| Some(n).filter(|n| *n > 0);
        Data {
            path: Some(at.path.display().to_string()),
            line: known(at.line),
            column: known(at.column),
            name: None,
            found: Some(found.to_owned()),
            expected: Some(expected.to_owned()),
        }
    }
}

fn with(text: String, kind: Kind, data: Data) -> PyErr {
    let error = Error::new_err(text);
    Python::attach(|py| {
        let value = error.value(py);
        // an attribute that can't be set takes nothing from the message
        let _ = value.setattr("kind", format!("{kind:?}").to_lowercase());
        let _ = value.setattr("path", data.path);
        let _ = value.setattr("line", data.line);
        let _ = value.setattr("column", data.column);
        let _ = value.setattr("parameter", data.name);
        let _ = value.setattr("found", data.found);
        let _ = value.setattr("expected", data.expected);
    });
    error
}
