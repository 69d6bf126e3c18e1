//! A model's weights outside of both its forms: arrays by name, and one safetensors file of them.

use crate::config::{ModelConfig, TokenLayout};
use crate::forecast::{self, Forecast};
use crate::layout::{self, Parameter};
use crate::{Error, Result};
use candle_core::{DType, Device, Tensor};
use kinelm_engine::arena::Floats;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::Arc;

/// The entry of the file's metadata that identifies the format.
const FORMAT: (&str, &str) = ("kinelm", "weights 1");

/// The arrays of a model, an optimizer or a classifier under their names, which are those of [`super::layout`].
pub type Weights = BTreeMap<String, Array>;

/// Numbers in a shape, row by row. A clone shares the numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    shape: Vec<usize>,
    numbers: Arc<Vec<f32>>,
}

impl Array {
    /// An array of these numbers.
    ///
    /// # Panics
    /// If the shape holds another number of them.
    pub fn new(shape: &[usize], numbers: Vec<f32>) -> Array {
        assert_eq!(shape.iter().product::<usize>(), numbers.len(), "the numbers of an array of shape {shape:?}");
        Array { shape: shape.to_vec(), numbers: Arc::new(numbers) }
    }

    /// An array of one number.
    pub fn full(shape: &[usize], number: f32) -> Array {
        Array::new(shape, vec![number; shape.iter().product()])
    }

    /// A tensor's numbers, of any device, rounded to f32.
    ///
    /// # Errors
    /// Errors of the device.
    pub fn of(tensor: &Tensor) -> Result<Array> {
        let numbers = tensor.to_device(&Device::Cpu)?.to_dtype(DType::F32)?.flatten_all()?.to_vec1()?;
        Ok(Array::new(tensor.dims(), numbers))
    }

    /// A tensor of them on `device`.
    ///
    /// # Errors
    /// Errors of the device.
    pub fn tensor(&self, device: &Device) -> Result<Tensor> {
        Ok(Tensor::from_slice(&self.numbers, self.shape.as_slice(), device)?)
    }

    /// Its sides.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Its numbers, row by row.
    pub fn numbers(&self) -> &[f32] {
        &self.numbers
    }

    /// Its rows, each all numbers under one index of the first side. An array without numbers has none.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[f32]> {
        // at least 1: `chunks` of 0 panics
        let width = self.shape.iter().skip(1).product::<usize>().max(1);
        self.numbers.chunks_exact(width)
    }
}

/// The tensors of a forecast under their names.
pub fn of_forecast(forecast: &Forecast) -> Weights {
    let arrays = forecast.tensors().into_iter().zip(Forecast::shapes(forecast.slots()));
    forecast::NAMES.iter().zip(arrays).map(|(name, (x, shape))| (name.to_string(), Array::new(&shape, x))).collect()
}

/// The forecast of a model of these tokens in some weights.
///
/// # Errors
/// Tensors that are missing, of another shape, or not of whole numbers; each is named.
fn forecast_in(tokens: &TokenLayout, weights: &Weights) -> Result<Forecast> {
    let places = tokens.bins();
    let shapes = Forecast::shapes(places.len());
    let tensor = |i: usize| {
        let array = weights.get(forecast::NAMES[i]).filter(|array| array.shape == shapes[i]);
        let missing = || Error::Weights(format!("the weights have no {} of shape {:?}", forecast::NAMES[i], shapes[i]));
        array.map(Array::numbers).ok_or_else(missing)
    };
    let tensors = [tensor(0)?, tensor(1)?];
    Forecast::of_tensors(places, tensors)
}

/// The weights of a model before training, which forecasts that nothing moves.
pub fn initial(config: &ModelConfig, tokens: &TokenLayout, seed: u64) -> Weights {
    let array = |p: Parameter| (p.name.clone(), Array::new(&p.shape, p.initial(seed)));
    let forecast = config.forecast().then(|| of_forecast(&Forecast::still(tokens.bins())));
    layout::parameters(config, tokens).into_iter().map(array).chain(forecast.into_iter().flatten()).collect()
}

/// What a model learns and what it doesn't: its parameters, each with its array, and its forecast.
pub(crate) type Checked<'a> = (Vec<(Parameter, &'a Array)>, Option<Forecast>);

/// A model's parameters and its forecast in some weights.
///
/// # Errors
/// A configuration that doesn't hold; tensors that are missing, not the model's, or of another shape: each is named.
pub(crate) fn checked<'a>(config: &ModelConfig, tokens: &TokenLayout, weights: &'a Weights) -> Result<Checked<'a>> {
    config.validate_for(tokens)?;
    let forecast = config.forecast().then(|| forecast_in(tokens, weights)).transpose()?;
    let own = |p: Parameter| {
        let (name, shape) = (&p.name, &p.shape);
        let missing = || Error::Weights(format!("the weights have no tensor {name}; expected one of shape {shape:?}"));
        let array = weights.get(name).ok_or_else(missing)?;
        match array.shape() == shape {
            true => Ok((p, array)),
            false => {
                let found = format!("tensor {name} has shape {:?}", array.shape());
                Err(Error::Weights(format!("{found}; this model expects {shape:?}")))
            }
        }
    };
    let all: Vec<_> = layout::parameters(config, tokens).into_iter().map(own).collect::<Result<_>>()?;
    let is_own = |name: &String| {
        all.binary_search_by(|(p, _)| p.name.cmp(name)).is_ok() || forecast.is_some() && forecast::is_tensor(name)
    };
    match weights.keys().find(|name| !is_own(name)) {
        Some(name) => Err(Error::Weights(format!("the weights have a tensor {name} that this model has no place for"))),
        None => Ok((all, forecast)),
    }
}

/// The numbers of `parameters`, in their order, as arrays under their names.
///
/// # Panics
/// If they have other lengths than the parameters.
pub fn named(parameters: &[Parameter], numbers: &[Floats]) -> Weights {
    let array = |(p, x): (&Parameter, &Floats)| (p.name.clone(), Array::new(&p.shape, x.to_vec()));
    parameters.iter().zip(numbers).map(array).collect()
}

/// The arrays `all` in the order of the parameters, under the names that `name` gives. `what` they are is for the message.
///
/// # Errors
/// [`Error::Weights`] for an array that is missing or of another shape.
pub fn in_order<'a>(
    what: &str,
    parameters: &[Parameter],
    all: &'a Weights,
    name: impl Fn(&Parameter) -> String,
) -> Result<Vec<&'a Array>> {
    let one = |p: &Parameter| {
        let name = name(p);
        let array = all.get(&name).filter(|array| array.shape == p.shape);
        array.ok_or_else(|| Error::Weights(format!("the {what} has no {name} of shape {:?}", p.shape)))
    };
    parameters.iter().map(one).collect()
}

/// As [`in_order`], their numbers for the engine.
///
/// # Errors
/// As [`in_order`].
pub fn floats(
    what: &str,
    parameters: &[Parameter],
    all: &Weights,
    name: impl Fn(&Parameter) -> String,
) -> Result<Vec<Floats>> {
    Ok(in_order(what, parameters, all, name)?.into_iter().map(|array| Floats::of(&array.numbers)).collect())
}

/// The bytes of a safetensors file, the same for the same weights.
///
/// # Errors
/// None in practice.
pub fn to_bytes(weights: &Weights) -> Result<Vec<u8>> {
    serialize(weights, FORMAT)
}

/// A safetensors file with one entry of metadata.
pub(super) fn serialize(weights: &Weights, (key, value): (&str, &str)) -> Result<Vec<u8>> {
    let bytes = |array: &Array| array.numbers.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let raw: Vec<_> = weights.iter().map(|(name, array)| (name, &array.shape, bytes(array))).collect();
    let views: std::result::Result<Vec<_>, _> = raw
        .iter()
        .map(|(name, shape, bytes)| TensorView::new(Dtype::F32, shape.to_vec(), bytes).map(|view| (name, view)))
        .collect();
    let metadata = HashMap::from([(key.to_string(), value.to_string())]);
    let written = views.and_then(|views| safetensors::serialize(views, Some(metadata)));
    Ok(written.map_err(candle_core::Error::from)?)
}

/// [`to_bytes`] for a checkpoint, which isn't written with numbers that aren't finite.
///
/// # Errors
/// [`Error::NotFinite`] with the first of them; `file` is for the message.
pub fn finite_bytes(file: &str, weights: &Weights) -> Result<Vec<u8>> {
    for (name, array) in weights {
        if let Some(odd) = array.numbers.iter().find(|x| !x.is_finite()) {
            return Err(Error::NotFinite(format!("{file} would hold {odd} in {name}, and is not written")));
        }
    }
    to_bytes(weights)
}

/// The weights in a file that [`to_bytes`] made; `path` is only for messages.
///
/// # Errors
/// Bytes that are cut short or no such file.
pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<Weights> {
    let wrong = |found: String| Error::file(path, found, "weights as kinelm writes them", "");
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| wrong(format!("no safetensors file: {e}")))?;
    let format = metadata.metadata().as_ref().and_then(|m| m.get(FORMAT.0).cloned());
    if format.as_deref() != Some(FORMAT.1) {
        return Err(wrong(format!("format {:?}", format.unwrap_or_default())));
    }
    let file = SafeTensors::deserialize(bytes).map_err(|e| wrong(format!("no safetensors file: {e}")))?;
    let array = |(name, view): (&str, TensorView)| match view.dtype() {
        Dtype::F32 => {
            let (numbers, _) = view.data().as_chunks();
            Ok((name.into(), Array::new(view.shape(), numbers.iter().map(|&x| f32::from_le_bytes(x)).collect())))
        }
        other => Err(wrong(format!("tensor {name} of {other:?}"))),
    };
    file.iter().map(array).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DeviceName, Gpt, ModelConfig, TokenLayout, layout};

    #[test]
    fn weights_come_back_and_cut_files_are_refused() {
        let tokens = TokenLayout {
            vocabulary: 11,
            word: 4,
            varying: false,
            front: 1,
            pad: 0,
            bos: 1,
            space: 5,
            places: Vec::new(),
        };
        let config = ModelConfig { layers: 1, heads: 2, width: 8, context: 10, ..Default::default() };
        let gpt = Gpt::new(&config, &tokens, 1).unwrap();
        let path = Path::new("model.safetensors");
        let bytes_of = |gpt: &Gpt| to_bytes(&gpt.weights().unwrap()).unwrap();
        let bytes = bytes_of(&gpt);
        let load = |config| Gpt::from_weights(config, &tokens, &from_bytes(path, &bytes)?, DeviceName::Cpu);
        assert_eq!(bytes, bytes_of(&load(&config).unwrap()));
        assert_ne!(bytes, bytes_of(&Gpt::new(&config, &tokens, 2).unwrap()));
        for length in [0, 7, 100, bytes.len() - 1] {
            let message = from_bytes(path, &bytes[..length]).err().unwrap().to_string();
            assert!(message.contains("model.safetensors: found no safetensors file"), "{message}");
        }
        let other = ModelConfig { layers: 2, ..config.clone() };
        let message = load(&other).err().unwrap().to_string();
        assert!(message.contains("no tensor block.01"), "{message}");
    }

    #[test]
    fn missing_arrays_are_named() {
        let (config, tokens) = crate::fixtures::every(36)
            .into_iter()
            .find(|(config, tokens)| !config.architecture.is_flat() && tokens.front > 1)
            .unwrap();
        let parameters = layout::parameters(&config, &tokens);
        let mut weights = initial(&config, &tokens, 1);
        let mut moments: Weights = weights.iter().map(|(name, x)| (format!("first.{name}"), x.clone())).collect();
        let name = |p: &Parameter| format!("first.{}", p.name);
        for (p, array) in parameters.iter().zip(in_order("optimizer", &parameters, &moments, name).unwrap()) {
            assert_eq!(array.shape(), &*p.shape, "{}", p.name);
        }
        weights.remove(layout::LABEL).unwrap();
        let message = checked(&config, &tokens, &weights).unwrap_err().to_string();
        assert!(message.contains("no tensor frame.label.weight; expected one of shape [26, 12]"), "{message}");
        let whole = initial(&config, &tokens, 1);
        let mut missing = whole.clone();
        missing.remove(forecast::NAMES[0]);
        let message = checked(&ModelConfig { forecast: Some(true), ..config.clone() }, &tokens, &missing).unwrap_err();
        assert!(message.to_string().starts_with("the weights have no forecast.all of shape [5, 26, 5]"), "{message}");
        moments.remove("first.frame.label.weight").unwrap();
        let message = in_order("optimizer", &parameters, &moments, name).unwrap_err().to_string();
        assert!(message.contains("no first.frame.label.weight of shape [26, 12]"), "{message}");
    }
}
