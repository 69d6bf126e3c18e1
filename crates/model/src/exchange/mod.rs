//! Models in folders that other programs read and write: our own form (`own`) and that of Hugging Face's GPT-2 (`hf`).

mod hf;
mod own;
#[cfg(test)]
mod tests;

use super::checkpoint::{CheckpointChoice, State};
use super::run::{CONFIG, LoadedRun, TOKENIZER, WEIGHTS, load_run};
use super::{ModelConfig, TokenLayout};
use crate::weights::{self, Array, Weights};
use crate::{Error, Result};
use candle_core::{DType, Device, Tensor};
use kinelm_store::{FileRecord, files, input};
use kinelm_tokenizer::Tokenizer;
use own::About;
use safetensors::{Dtype, SafeTensors};
use std::path::Path;

/// How a model is written for other programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Format {
    /// Under our own names, any model.
    Kinelm,
    /// As `transformers` loads a `GPT2LMHeadModel` and a `PreTrainedTokenizerFast`; models that GPT-2 can express.
    Hf,
}

/// Writes a model to the new folder `out`, which is whole or not there; one that holds the same already stays.
///
/// # Errors
/// A folder that holds something else; a model that the format can't express, with the reasons; weights that don't fit the
/// configuration; a tokenizer that isn't the model's; what the system refuses.
pub fn export(run: &LoadedRun, format: Format, out: &Path) -> Result<()> {
    check(&run.config, &run.tokens, &run.weights, &run.checkpoint)?;
    let tokenizer = run.load_tokenizer()?;
    check_tokenizer(&run.tokens, &tokenizer, &run.tokenizer)?;
    let mut about = About::of(run, &tokenizer);
    let mut contents = match format {
        Format::Kinelm => own::contents(run)?,
        Format::Hf => hf::contents(run)?,
    };
    if format == Format::Kinelm {
        let weights = contents.iter().find(|(name, _)| *name == WEIGHTS);
        about.weights_sha256 = weights.map(|(_, bytes)| FileRecord::of(bytes).sha256);
    }
    contents.push((own::ABOUT, about.to_json()));
    contents.push((TOKENIZER, tokenizer.to_json().into_bytes()));
    Ok(files::write_folder(out, &contents)?)
}

/// Loads a model from a checkpoint of a run folder, or from a folder that [`export`] or another program wrote. A run's
/// tokenizer and checkpoint are then the folder's.
///
/// # Errors
/// A checkpoint of a folder that is no run; a folder that is none of these, or whose weights are in shards or pickled; files that are missing, cut short or something else; tensors that are missing, odd or
/// not finite: each is named.
pub fn load(folder: &Path, which: CheckpointChoice) -> Result<LoadedRun> {
    let has = |name: &str| folder.join(name).is_file();
    // a run has its weights under `checkpoints`, so a stray `pytorch_model.bin` beside them says nothing
    if !has(CONFIG) {
        check_form(folder)?;
    }
    match (has(CONFIG), has(hf::CONFIG), has(own::ABOUT)) {
        (true, ..) => load_run(folder, which),
        (_, true, _) | (_, _, true) if which != CheckpointChoice::Auto => {
            let why = format!("{} is an exported folder, which has one model; leave it out", folder.display());
            Err(Error::unsupported_parameter("checkpoint", why))
        }
        (_, true, _) => hf::load(folder),
        (_, _, true) => own::load(folder),
        _ => {
            let expected = "a run, or a folder that `kinelm export` or `transformers` wrote";
            Err(Error::file(folder, format!("no {CONFIG}, {} or {}", own::ABOUT, hf::CONFIG), expected, ""))
        }
    }
}

/// A run of the model that `about` and `weights` of a folder describe; both are checked.
fn loaded(folder: &Path, about: About, weights: Weights, notes: Vec<String>) -> Result<LoadedRun> {
    let About { model: config, tokens, conditions, tokenizer_sha256, step, .. } = about;
    check(&config, &tokens, &weights, &folder.join(WEIGHTS))?;
    Ok(LoadedRun {
        config,
        tokens,
        conditions,
        label_dropout: None,
        weights,
        tokenizer: folder.join(TOKENIZER),
        tokenizer_sha256,
        checkpoint: folder.to_owned(),
        state: State::new(step, 0, 0, 0, None),
        notes,
    })
}

/// Forms of weights of `transformers` that are not read: the file that identifies each, and what it is.
const OTHER_FORMS: [(&str, &str); 3] = [
    ("model.safetensors.index.json", "the list of weights that are in several files (shards)"),
    (
        "pytorch_model.bin.index.json",
        "the list of weights that are in several files of PyTorch's (pickles, which can hold code)",
    ),
    ("pytorch_model.bin", "weights in PyTorch's own form (a pickle, which can hold code)"),
];

/// # Errors
/// A file; weights in another form of `transformers` and none in ours.
fn check_form(folder: &Path) -> Result<()> {
    if folder.is_file() {
        return Err(Error::file(
            folder,
            "a file",
            "a folder with a model in it",
            "give the folder that the file is in",
        ));
    }
    let other = OTHER_FORMS.iter().find(|(name, _)| folder.join(name).is_file());
    match other.filter(|_| !folder.join(WEIGHTS).is_file()) {
        None => Ok(()),
        Some((name, what)) => Err(Error::file(
            folder.join(name),
            *what,
            format!("all of them in one {WEIGHTS}"),
            format!(
                "let transformers save it anew, AutoModelForCausalLM.from_pretrained({:?}).save_pretrained(\"NEW\", \
                 max_shard_size=\"1000GB\"), copy {TOKENIZER} and {} into NEW, and import that",
                folder.display().to_string(),
                own::ABOUT
            ),
        )),
    }
}

/// # Errors
/// Weights that a model of this shape hasn't got or has no place for, or of another shape, or that are not finite.
fn check(config: &ModelConfig, tokens: &TokenLayout, weights: &Weights, path: &Path) -> Result<()> {
    let wrong = |found: String| Error::file(path, found, "the weights of the model that is described beside them", "");
    weights::checked(config, tokens, weights).map_err(|e| match e {
        Error::Weights(found) => wrong(found),
        other => other,
    })?;
    for (name, array) in weights {
        if let Some(odd) = array.numbers().iter().find(|x| !x.is_finite()) {
            return Err(wrong(format!("{odd} in the tensor {name}")));
        }
    }
    Ok(())
}

/// # Errors
/// A tokenizer with other ids or words than the model's.
fn check_tokenizer(tokens: &TokenLayout, tokenizer: &Tokenizer, path: &Path) -> Result<()> {
    let found = TokenLayout::of(tokenizer);
    let describe = |t: &TokenLayout| {
        let varying = if t.varying { "at most " } else { "" };
        format!("{} ids and words of {varying}{} tokens", t.vocabulary, t.word)
    };
    let places = tokens.places.is_empty() || tokens.places == found.places;
    match found.vocabulary == tokens.vocabulary && found.reads(tokens) && places {
        true => Ok(()),
        false => Err(Error::file(
            path,
            format!("a tokenizer of {}", describe(&found)),
            format!("the model's, of {}", describe(tokens)),
            "",
        )),
    }
}

/// The weights in a safetensors file of any program; half floats are widened.
///
/// # Errors
/// A file that isn't there, is cut short or is something else; tensors of other numbers.
fn read(path: &Path) -> Result<Weights> {
    let bytes = input::bytes(path).map_err(Error::io(path))?;
    let wrong = |found: String| Error::file(path, found, "a safetensors file of f32, f16 or bf16", "");
    let file = SafeTensors::deserialize(&bytes).map_err(|e| wrong(format!("no safetensors file: {e}")))?;
    let mut weights = Weights::new();
    for (name, view) in file.iter() {
        let dtype = match view.dtype() {
            Dtype::F32 => DType::F32,
            Dtype::F16 => DType::F16,
            Dtype::BF16 => DType::BF16,
            // buffers of GPT-2's first implementations, which are no weights
            Dtype::BOOL | Dtype::U8 if hf::is_buffer(name) => continue,
            other => return Err(wrong(format!("tensor {name} of {other:?}"))),
        };
        let tensor = Tensor::from_raw_buffer(view.data(), dtype, view.shape(), &Device::Cpu)?;
        weights.insert(name.to_string(), Array::of(&tensor)?);
    }
    Ok(weights)
}
