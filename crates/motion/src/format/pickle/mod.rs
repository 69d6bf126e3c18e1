//! Python pickles of plain values and numpy arrays, read without executing anything.
//!
//! A pickle is a program for a small stack machine that may call any function of any Python module. [`Pickle`] executes
//! protocols 0 to 5, but knows only the calls with which numpy rebuilds arrays, types and scalars. Names outside
//! `ALLOWED` are refused; no name is ever looked up.
//!
//! Values are stored in one list and refer to each other by index, so that nesting takes no call depth and shared or
//! circular values are not copied. The sizes of the list, the stack and the memo, the number of open marks and the bytes
//! of decoded values are limited ([`MAX_VALUES`] and the others), so that a small file takes little memory.
//!
//! Source: Python's `pickletools`, which describes every opcode.

mod machine;
mod numpy;

use super::array::{Array, Dtype, Order};
use crate::error::{FaultKind, FileError};
use crate::{Error, Result};
use kinelm_store::SourcePos;
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// Names that a pickle may use, as module and name.
pub(crate) const ALLOWED: [(&str, &str); 9] = [
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "scalar"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("numpy.core.numeric", "_frombuffer"),
    ("numpy._core.numeric", "_frombuffer"),
    ("numpy", "dtype"),
    ("numpy", "ndarray"),
    ("_codecs", "encode"),
];
/// Most values in one pickle.
pub const MAX_VALUES: usize = 1 << 18;
/// Most values on the stack and most memo entries.
pub const MAX_STACK: usize = 1 << 18;
/// Most open marks.
pub const MAX_MARKS: usize = 1 << 10;

/// Most texts taken from a list, and most bytes of each, because shared values could multiply them.
const MAX_TEXTS: usize = 1 << 12;

/// Index of a value.
type Id = u32;

/// The values of a pickle.
#[derive(Debug)]
pub struct Pickle<'a> {
    path: PathBuf,
    values: Vec<Object<'a>>,
    top: Id,
}

#[derive(Debug, Clone)]
enum Object<'a> {
    None,
    Bool(bool),
    Int(i64),
    Float(f64),
    Bytes(Cow<'a, [u8]>),
    Text(Cow<'a, str>),
    List(Vec<Id>),
    Tuple(Vec<Id>),
    Dict(Vec<(Id, Id)>),
    Global(&'static str),
    Dtype(Dtype),
    Array(ArrayParts),
}

#[derive(Debug, Clone)]
enum ArrayParts {
    /// Made by `_reconstruct`; its state is still missing.
    Blank,
    /// The elements are the bytes of another value.
    Plain { dtype: Dtype, shape: Vec<usize>, order: Order, bytes: Id },
    /// The elements are the values of a list.
    Objects { list: Id },
}

impl<'a> Pickle<'a> {
    /// Reads a pickle; bytes after its end are ignored. `path` is used in messages.
    ///
    /// # Errors
    /// [`FaultKind::PickleRefused`] for a name outside `ALLOWED` or an opcode that makes or calls anything else;
    /// [`FaultKind::PickleBad`] for a damaged pickle, with the byte offset; [`FaultKind::TooLarge`] above a limit;
    /// [`FaultKind::NotThisFormat`] for one that joblib compressed.
    pub fn parse(path: &Path, bytes: &'a [u8]) -> Result<Self> {
        if let Some(method) = compression(bytes) {
            let found = format!("data compressed by {method}, as joblib writes pickles");
            let e = FileError::new(SourcePos::file(path), FaultKind::NotThisFormat, found, "a plain pickle");
            return Err(e.help(FROM_JOBLIB).into());
        }
        let (values, top) = machine::run(bytes).map_err(|stop| stop.at(path))?;
        Ok(Pickle { path: path.to_owned(), values, top })
    }

    /// The pickled value.
    pub fn top(&self) -> Value<'_, 'a> {
        Value { pickle: self, id: self.top }
    }
}

/// How a plain pickle is made of one by joblib.
const FROM_JOBLIB: &str =
    "save it again in Python: import joblib, pickle; pickle.dump(joblib.load(\"in.pkl\"), open(\"out.pkl\", \"wb\"))";

/// The method by which joblib compressed a file.
fn compression(bytes: &[u8]) -> Option<&'static str> {
    let methods: [(&[u8], &str); 10] = [
        // the second byte is zlib's level: fastest, fast, default, best
        (b"\x78\x01", "zlib"),
        (b"\x78\x5e", "zlib"),
        (b"\x78\x9c", "zlib"),
        (b"\x78\xda", "zlib"),
        (b"\x1f\x8b", "gzip"),
        (b"BZh", "bz2"),
        (b"\xfd7zXZ\0", "xz"),
        (b"\x5d\0\0", "lzma"),
        (b"\x04\x22\x4d\x18", "lz4"),
        // joblib up to 0.9: `ZF`, then the length as Python's `hex` writes it
        (b"ZF0x", "zlib"),
    ];
    methods.into_iter().find(|(start, _)| bytes.starts_with(start)).map(|(_, method)| method)
}

/// Why execution stopped.
struct Stop {
    kind: FaultKind,
    at: usize,
    found: String,
    expected: &'static str,
}

impl Stop {
    fn at(self, path: &Path) -> Error {
        let found = format!("{} at byte {}", self.found, self.at);
        let e = FileError::new(SourcePos::file(path), self.kind, found, self.expected);
        match self.kind {
            FaultKind::PickleRefused if e.found.contains("joblib.") => e.help(FROM_JOBLIB).into(),
            FaultKind::PickleRefused => e.help("pickles are read, never run").into(),
            _ => e.into(),
        }
    }
}

/// A value of a pickle.
#[derive(Debug, Clone, Copy)]
pub struct Value<'p, 'a> {
    pickle: &'p Pickle<'a>,
    id: Id,
}

impl<'p, 'a> Value<'p, 'a> {
    fn object(&self) -> &'p Object<'a> {
        &self.pickle.values[self.id as usize]
    }

    /// The value of a dict's key; `None` if it is missing or this is no dict. Keys are text or, from Python 2, bytes.
    pub fn get(&self, key: &str) -> Option<Value<'p, 'a>> {
        let Object::Dict(items) = self.object() else { return None };
        // the last of equal keys wins, as in Python
        let (_, id) = items.iter().rev().find(|(k, _)| self.at(*k).text().as_deref() == Some(key))?;
        Some(self.at(*id))
    }

    /// The text keys of a dict, in file order; `None` if this is no dict.
    pub fn keys(&self) -> Option<Vec<String>> {
        let Object::Dict(items) = self.object() else { return None };
        Some(items.iter().take(MAX_TEXTS).filter_map(|(k, _)| self.at(*k).text()).map(Cow::into_owned).collect())
    }

    /// Short text, or bytes as Latin-1 (Python 2); for a numpy scalar or an array of one text, that text.
    pub fn text(&self) -> Option<Cow<'p, str>> {
        match self.object() {
            Object::Text(t) if t.len() <= MAX_TEXTS => Some(Cow::Borrowed(t)),
            Object::Bytes(b) if b.len() <= MAX_TEXTS => Some(b.iter().map(|&c| c as char).collect::<String>().into()),
            Object::Array(_) => self.array("text")?.ok()?.text().ok().map(Cow::Owned),
            _ => None,
        }
    }

    /// The texts of a list or an array of objects; `None` if this is neither or has other elements.
    pub fn texts(&self) -> Option<Vec<Cow<'p, str>>> {
        match self.object() {
            Object::List(items) | Object::Tuple(items) if items.len() <= MAX_TEXTS => items
                .iter()
                .map(|&id| match self.at(id).object() {
                    Object::Text(_) | Object::Bytes(_) => self.at(id).text(),
                    _ => None,
                })
                .collect(),
            Object::Array(ArrayParts::Objects { list }) => self.at(*list).texts(),
            _ => None,
        }
    }

    /// An array; a Python number becomes a 0-d array. `None` for anything else. `key` is used in messages.
    pub fn array(&self, key: &str) -> Option<Result<Array<'p>>> {
        let path = &self.pickle.path;
        let number = |descr, bytes: [u8; 8]| {
            let dtype = Dtype::parse(descr).expect("a type of ours");
            Array::new(path, key, dtype, vec![], Order::C, Cow::Owned(bytes.to_vec()))
        };
        match self.object() {
            Object::Int(n) => Some(number("<i8", n.to_le_bytes())),
            Object::Float(x) => Some(number("<f8", x.to_le_bytes())),
            Object::Array(ArrayParts::Plain { dtype, shape, order, bytes }) => {
                let Object::Bytes(bytes) = self.at(*bytes).object() else { return None };
                Some(Array::new(path, key, *dtype, shape.clone(), order.clone(), Cow::Borrowed(bytes)))
            }
            Object::Array(ArrayParts::Objects { .. }) => {
                let found = format!("{key}: an array of Python objects");
                Some(Err(
                    FileError::new(SourcePos::file(path), FaultKind::ObjectArray, found, "an array of numbers").into()
                ))
            }
            _ => None,
        }
    }

    /// The kind of value, for messages.
    pub fn kind(&self) -> &'static str {
        match self.object() {
            Object::None => "None",
            Object::Bool(_) => "a bool",
            Object::Int(_) => "an int",
            Object::Float(_) => "a float",
            Object::Bytes(_) => "bytes",
            Object::Text(_) => "text",
            Object::List(_) => "a list",
            Object::Tuple(_) => "a tuple",
            Object::Dict(_) => "a dict",
            Object::Global(name) => name,
            Object::Dtype(_) => "a numpy dtype",
            Object::Array(_) => "an array",
        }
    }

    fn at(&self, id: Id) -> Value<'p, 'a> {
        Value { pickle: self.pickle, id }
    }
}
