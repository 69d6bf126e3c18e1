//! Keyword arguments that several calls share.

use crate::error::wrong;
use kinelm::model::CheckpointChoice;
use kinelm::motion::format::{ReadOptions, RestFrame, Unit, Up};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyCFunction, PyDict, PyTuple};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// How a motion file is read.
#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Reading {
    pub fps_source: Option<f64>,
    pub skip: usize,
    pub up: Option<String>,
    pub unit: Option<String>,
    pub map: Option<String>,
    pub root: Option<String>,
    pub take: Option<String>,
    pub mirror_axis: Option<String>,
}

impl Reading {
    /// The library's options; what is done with a rest frame where a motion begins with one is the call's.
    pub fn options(self, rest: RestFrame) -> PyResult<ReadOptions> {
        let up = self.up.as_deref().map(|up| named(up, "up", &["x", "y", "z", "-x", "-y", "-z"])).transpose()?;
        let unit = self
            .unit
            .as_deref()
            .map(|unit| unit.parse::<Unit>().map_err(|expected| wrong(format!("unit is {unit:?}; {expected}"))));
        let (up, unit) = (up.unwrap_or(Up::Auto), unit.transpose()?.unwrap_or(Unit::Auto));
        let mirror = self.mirror_axis.as_deref();
        let mirror_axis = mirror.map(|axis| named(axis, "mirror_axis", &["x", "y", "z"])).transpose()?;
        let Reading { fps_source, skip, map, root, take, .. } = self;
        Ok(ReadOptions { fps_source, skip, up, unit, map, root, take, mirror_axis, rest, ..ReadOptions::default() })
    }

    /// The options of a call that has no other keyword arguments.
    pub fn of(kwargs: Option<&Bound<'_, PyDict>>, rest: RestFrame) -> PyResult<ReadOptions> {
        parsed::<Reading>(kwargs)?.options(rest)
    }
}

/// Which checkpoint of a run: a step, "latest" or "best".
///
/// # Errors
/// ValueError for anything else.
pub fn choice(checkpoint: Option<Bound<'_, PyAny>>) -> PyResult<CheckpointChoice> {
    let Some(given) = checkpoint else { return Ok(CheckpointChoice::Auto) };
    let text = given.str()?.to_string();
    text.parse().map_err(|expected| wrong(format!("checkpoint is {text:?}; {expected}")))
}

/// Keyword arguments as a struct, by way of JSON; paths, numpy's numbers and arrays may stand among them.
///
/// # Errors
/// TypeError for a name that `T` doesn't have, or a value of another type.
pub fn parsed<T: Default + DeserializeOwned>(kwargs: Option<&Bound<'_, PyDict>>) -> PyResult<T> {
    let Some(kwargs) = kwargs else { return Ok(T::default()) };
    let py = kwargs.py();
    let plain = |args: &Bound<'_, PyTuple>, _: Option<&Bound<'_, PyDict>>| -> PyResult<Py<PyAny>> {
        let value = args.get_item(0)?;
        // numpy's numbers and arrays have `tolist`; `fspath` takes paths, and raises for all else
        let plain = match value.hasattr("tolist")? {
            true => value.call_method0("tolist")?,
            false => value.py().import("os")?.call_method1("fspath", (value,))?,
        };
        Ok(plain.unbind())
    };
    let options = PyDict::new(py);
    options.set_item("default", PyCFunction::new_closure(py, None, None, plain)?)?;
    let text: String = py.import("json")?.call_method("dumps", (kwargs,), Some(&options))?.extract()?;
    let whole = |e: serde_json::Error| {
        let text = e.to_string();
        // a position in JSON that the caller never sees
        let place = text.find(" at line ").unwrap_or(text.len());
        PyTypeError::new_err(text[..place].to_owned())
    };
    serde_json::from_str(&text).map_err(whole)
}

/// A value of the library's by its name; `known` are those that a parameter takes.
///
/// # Errors
/// `kinelm.Error` that lists them.
pub fn named<T: DeserializeOwned>(name: &str, parameter: &str, known: &[&str]) -> PyResult<T> {
    let unknown = || {
        let (last, others) = known.split_last().unwrap_or((&"", &[]));
        wrong(format!("{parameter} is {name:?}; expected {} or {last}", others.join(", ")))
    };
    // only those that are listed: serde knows more
    let value = known.contains(&name).then(|| serde_json::from_value(name.into()).ok()).flatten();
    value.ok_or_else(unknown)
}

/// A number that becomes a size, such as of a window.
///
/// # Errors
/// `kinelm.Error` for one outside the range.
pub fn size(parameter: &str, number: usize, range: RangeInclusive<usize>) -> PyResult<usize> {
    if range.contains(&number) {
        return Ok(number);
    }
    Err(wrong(format!("{parameter} is {number}; expected {} to {}", range.start(), range.end())))
}

/// Refuses a path that is taken, unless it may be replaced.
pub fn free(path: &Path, force: bool) -> PyResult<()> {
    if !force && path.exists() {
        return Err(wrong(format!("{} is there; force=True replaces it", path.display())));
    }
    Ok(())
}

/// One path or several.
#[derive(FromPyObject)]
pub enum Paths {
    /// One.
    One(PathBuf),
    /// Several.
    Many(Vec<PathBuf>),
}

impl From<Paths> for Vec<PathBuf> {
    fn from(paths: Paths) -> Self {
        match paths {
            Paths::One(path) => vec![path],
            Paths::Many(paths) => paths,
        }
    }
}
