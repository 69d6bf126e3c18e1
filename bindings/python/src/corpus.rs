//! Corpora.

use crate::error::{library, wrong};
use crate::interrupt::Interrupt;
use crate::json::python;
use crate::options::{Paths, Reading, size};
use crate::pool::detach;
use crate::tokenizer::Tokenizer;
use kinelm::corpus::conditions::in_order;
use kinelm::corpus::windows::{EvalWindow, each_eval_window, fill_sequence};
use kinelm::corpus::{BuildOptions, Conditions, Dataset, Shard, Split, tokenize};
use kinelm::motion::format::RestFrame;
use kinelm::store::memory;
use kinelm::tokenizer::Special;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::Arc;

/// A corpus folder: the tokens of many clips, with labels and splits.
#[pyclass(frozen, module = "kinelm")]
pub struct Corpus(pub Arc<kinelm::corpus::Corpus>);

/// The split of this name.
pub fn split_of(name: &str) -> PyResult<Split> {
    name.parse().map_err(|e: kinelm::corpus::Error| wrong(e.to_string()))
}

#[pymethods]
impl Corpus {
    /// Opens a corpus folder.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Corpus> {
        py.detach(|| kinelm::corpus::Corpus::open(path)).map(|corpus| Corpus(Arc::new(corpus))).map_err(library)
    }

    /// Tokenizes files and folders into a corpus folder at `out`. `labels` are CSV files or patterns of file names, such as
    /// "{genre}_{dancer}_*". With `shard` (i, n) every n-th file from the i-th on, for `merge`. Bad files are `failed`.
    #[staticmethod]
    #[pyo3(signature = (data, out, *, tokenizer, labels=None, shard=None, force=false, **reading))]
    #[allow(clippy::too_many_arguments, reason = "keyword arguments")]
    fn build(
        py: Python<'_>,
        data: Paths,
        out: PathBuf,
        tokenizer: &Tokenizer,
        labels: Option<Vec<String>>,
        shard: Option<(usize, usize)>,
        force: bool,
        reading: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Corpus> {
        let read = Reading::of(reading, RestFrame::Drop)?;
        let shard = shard.map(|(index, of)| Shard::new(index, of)).transpose().map_err(library)?;
        let options = BuildOptions { read, shard, force, ..BuildOptions::default() };
        let data: Vec<PathBuf> = data.into();
        detach(py, || {
            let dataset = Dataset::find(&data, &labels.unwrap_or_default()).map_err(library)?;
            let mut interrupt = Interrupt::default();
            let built = tokenize(&dataset, &tokenizer.0, &out, &options, &mut |_| interrupt.check());
            interrupt.result(built)?;
            kinelm::corpus::Corpus::open(&out).map(|corpus| Corpus(Arc::new(corpus))).map_err(library)
        })
    }

    /// Puts the shards of a corpus together, in any order: the same bytes as a build without shards.
    #[staticmethod]
    #[pyo3(signature = (shards, out, *, force=false))]
    fn merge(py: Python<'_>, shards: Vec<PathBuf>, out: PathBuf, force: bool) -> PyResult<Corpus> {
        detach(py, || {
            kinelm::corpus::merge(&shards, &out, force).map_err(library)?;
            kinelm::corpus::Corpus::open(&out).map(|corpus| Corpus(Arc::new(corpus))).map_err(library)
        })
    }

    /// The files that are not in it: dictionaries with key, name and why.
    #[getter]
    fn failed<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        python(py, &self.0.manifest().failed)
    }

    /// The folder.
    #[getter]
    fn path(&self) -> PathBuf {
        self.0.dir().to_owned()
    }

    /// The tokenizer, with the labels of the corpus.
    #[getter]
    fn tokenizer(&self) -> Tokenizer {
        Tokenizer(self.0.tokenizer().clone())
    }

    /// The clips of a split, or all: dictionaries with name, offset and tokens (of `tokens`), frames, labels, split, take.
    #[pyo3(signature = (split=None))]
    fn clips<'py>(&self, py: Python<'py>, split: Option<&str>) -> PyResult<Bound<'py, PyAny>> {
        let split = split.map(split_of).transpose()?;
        let clips: Vec<_> =
            self.0.clips().iter().filter(|clip| split.is_none_or(|split| clip.split == split)).collect();
        python(py, &clips)
    }

    /// All tokens, clip after clip: a read-only numpy memmap of the corpus's file, u2 or u4.
    #[getter]
    fn tokens<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let kind = self.0.manifest().token_type;
        let options = PyDict::new(py);
        options.set_item("dtype", format!("<u{}", kind.width()))?;
        options.set_item("mode", "r")?;
        py.import("numpy")?.call_method("memmap", (self.0.dir().join(kind.file_name()),), Some(&options))
    }

    /// Sequences of `context` tokens to train or measure a model of your own on: an indexable of dictionaries with
    /// `input_ids` and `labels`, i64, ready for torch's DataLoader. Windows hold whole words. Each begins with <bos> and the
    /// labels of the `conditions`; places that don't count have the label -100.
    #[pyo3(signature = (split="train", *, context, conditions=None))]
    fn sequences(&self, split: &str, context: usize, conditions: Option<Vec<String>>) -> PyResult<Sequences> {
        let split = split_of(split)?;
        let context = size("context", context, 1..=MOST_CONTEXT)?;
        let fields = in_order(&conditions.unwrap_or_default());
        let conditions = Conditions::new(&fields, self.0.tokenizer().vocabulary());
        let clips: Vec<usize> = (0..self.0.clips().len()).filter(|&i| self.0.clips()[i].split == split).collect();
        // one more than the context: the last label needs no input
        let places = (context + 1).saturating_sub(conditions.len());
        let words = clips.iter().map(|&i| self.0.words(&self.0.clips()[i]));
        let windows = each_eval_window(words, places).map_err(library)?;
        let windows = windows.map(|window| EvalWindow { clip: clips[window.clip], ..window }).collect();
        Ok(Sequences { corpus: self.0.clone(), conditions, context, windows })
    }

    fn __len__(&self) -> usize {
        self.0.clips().len()
    }

    fn __repr__(&self) -> String {
        let count = &self.0.manifest().count;
        format!("<kinelm.Corpus: {} clips, {} frames, {}>", count.clips, count.frames, self.0.dir().display())
    }
}

/// Sequences of a corpus.
#[pyclass(frozen, module = "kinelm", sequence)]
pub struct Sequences {
    corpus: Arc<kinelm::corpus::Corpus>,
    conditions: Conditions,
    context: usize,
    /// Each of a clip by its number in the corpus.
    windows: Vec<EvalWindow>,
}

/// Sequences as one array.
type Rows<'py> = Bound<'py, PyArray2<i64>>;

/// Tokens of the longest sequence.
const MOST_CONTEXT: usize = 1 << 20;

/// What losses skip, by the convention of transformers.
const IGNORED: i64 = -100;

impl Sequences {
    /// The inputs and labels of a window.
    fn row(&self, window: &EvalWindow) -> PyResult<(Vec<i64>, Vec<i64>)> {
        let clip = &self.corpus.clips()[window.clip];
        let ids = self.corpus.ids(clip, window.start..window.start + window.tokens).map_err(library)?;
        let (pad, front) = (Special::Pad.id(), self.conditions.front(&clip.labels));
        let (mut input, mut target) = (vec![pad; self.context], vec![pad; self.context]);
        fill_sequence(&ids, &front, pad, &mut input, &mut target);
        // labels are one ahead of inputs; tokens before the scored ones are context, and count in an earlier window
        let first = front.len() - 1 + window.scored.start;
        let counts = |(at, id): (usize, u32)| if at < first || id == pad { IGNORED } else { id.into() };
        Ok((input.into_iter().map(i64::from).collect(), target.into_iter().enumerate().map(counts).collect()))
    }
}

#[pymethods]
impl Sequences {
    fn __len__(&self) -> usize {
        self.windows.len()
    }

    fn __getitem__<'py>(&self, py: Python<'py>, index: isize) -> PyResult<Bound<'py, PyDict>> {
        // from the end, as Python counts
        let at = if index < 0 { index + self.windows.len() as isize } else { index };
        let Some(window) = usize::try_from(at).ok().and_then(|at| self.windows.get(at)) else {
            let text = format!("sequence {index} of {}", self.windows.len());
            return Err(pyo3::exceptions::PyIndexError::new_err(text));
        };
        let (input, labels) = self.row(window)?;
        let item = PyDict::new(py);
        item.set_item("input_ids", PyArray1::from_vec(py, input))?;
        item.set_item("labels", PyArray1::from_vec(py, labels))?;
        Ok(item)
    }

    /// All sequences as two arrays, (N, context): `input_ids` and `labels`.
    fn arrays<'py>(&self, py: Python<'py>) -> PyResult<(Rows<'py>, Rows<'py>)> {
        let needed = (2 * size_of::<i64>() * self.context) as u128 * self.windows.len() as u128;
        let what = format!("{} sequences of {} tokens as arrays", self.windows.len(), self.context);
        memory::check(needed, &what, "take them one by one, or with a smaller context").map_err(library)?;
        let (mut input, mut labels) = (Vec::new(), Vec::new());
        for window in &self.windows {
            let row = self.row(window)?;
            input.extend(row.0);
            labels.extend(row.1);
        }
        let whole = |flat: Vec<i64>| PyArray1::from_vec(py, flat).reshape([self.windows.len(), self.context]);
        Ok((whole(input)?, whole(labels)?))
    }
}
