//! Weights on disk: one safetensors file, tensors under the names of [`super::layout`], whole or not there.

use crate::{Error, Result};
use candle_core::{DType, Device, Tensor};
use safetensors::SafeTensors;
use safetensors::tensor::TensorView;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// The entry of the file's metadata that identifies the format.
const FORMAT: (&str, &str) = ("kinelm", "weights 1");

/// The bytes of a safetensors file: `tensors` in f32 under their names, the same bytes for the same tensors.
///
/// # Errors
/// Tensors that are not f32.
pub fn to_bytes<'a>(tensors: impl IntoIterator<Item = (&'a str, &'a Tensor)>) -> Result<Vec<u8>> {
    serialize(tensors, FORMAT)
}

/// A safetensors file with one entry of metadata.
pub(super) fn serialize<'a>(
    tensors: impl IntoIterator<Item = (&'a str, &'a Tensor)>,
    (key, value): (&str, &str),
) -> Result<Vec<u8>> {
    let mut raw = BTreeMap::new();
    for (name, tensor) in tensors {
        let numbers = tensor.flatten_all()?.to_vec1::<f32>()?;
        let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        // sorted by name, so that the same tensors give the same bytes
        raw.insert(name, (tensor.dims().to_vec(), bytes));
    }
    let views: std::result::Result<Vec<_>, _> = raw
        .iter()
        .map(|(n, (shape, bytes))| TensorView::new(safetensors::Dtype::F32, shape.clone(), bytes).map(|v| (*n, v)))
        .collect();
    let metadata = HashMap::from([(key.to_string(), value.to_string())]);
    let written = views.and_then(|v| safetensors::serialize(v, Some(metadata)));
    Ok(written.map_err(candle_core::Error::from)?)
}

/// [`to_bytes`] for a checkpoint, which isn't written with numbers that aren't finite.
///
/// # Errors
/// [`Error::NotFinite`] with the first of them; `file` is for the message. Tensors that are not f32.
pub fn finite_bytes(file: &str, tensors: &BTreeMap<String, Tensor>) -> Result<Vec<u8>> {
    for (name, tensor) in tensors {
        let odd = tensor.flatten_all()?.to_vec1::<f32>()?.into_iter().find(|x| !x.is_finite());
        if let Some(odd) = odd {
            return Err(Error::NotFinite(format!("{file} would hold {odd} in {name}, and is not written")));
        }
    }
    to_bytes(tensors.iter().map(|(n, t)| (n.as_str(), t)))
}

/// The tensors of a file that [`to_bytes`] made; `path` is only for messages.
///
/// # Errors
/// Bytes that are cut short or no such file.
pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<BTreeMap<String, Tensor>> {
    let wrong = |found: String| Error::file(path, found, "weights as kinelm writes them", "");
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| wrong(format!("no safetensors file: {e}")))?;
    let format = metadata.metadata().as_ref().and_then(|m| m.get(FORMAT.0).cloned());
    if format.as_deref() != Some(FORMAT.1) {
        return Err(wrong(format!("format {:?}", format.unwrap_or_default())));
    }
    let file = SafeTensors::deserialize(bytes).map_err(|e| wrong(format!("no safetensors file: {e}")))?;
    let mut tensors = BTreeMap::new();
    for (name, view) in file.iter() {
        if view.dtype() != safetensors::Dtype::F32 {
            return Err(wrong(format!("tensor {name} of {:?}", view.dtype())));
        }
        let tensor = Tensor::from_raw_buffer(view.data(), DType::F32, view.shape(), &Device::Cpu)?;
        tensors.insert(name.to_string(), tensor);
    }
    Ok(tensors)
}

/// The tensors of `all` on `device`.
///
/// # Errors
/// Errors of the device.
pub fn to_device(all: &BTreeMap<String, Tensor>, device: &Device) -> Result<BTreeMap<String, Tensor>> {
    all.iter().map(|(name, tensor)| Ok((name.clone(), tensor.to_device(device)?))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Gpt, ModelConfig, TokenLayout};

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
        let bytes_of = |gpt: &Gpt| to_bytes(gpt.vars().iter().map(|(n, v)| (n.as_str(), v.as_tensor()))).unwrap();
        let bytes = bytes_of(&gpt);
        let load = |config| Gpt::from_tensors(config, &tokens, from_bytes(path, &bytes)?);
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
}
