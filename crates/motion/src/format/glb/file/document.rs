//! The parts of a glTF document that animation needs, and the numbers in its buffer.

use super::chunks::{Chunks, not_this};
use super::extensions::Extensions;
use crate::{Error, FaultKind, FileError, Result};
use kinelm_store::SourcePos;
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::collections::BTreeMap;
use std::path::Path;

/// Most zeros of an accessor that has no view.
const MOST_ZEROS: usize = 1 << 22;
/// Most numbers of an accessor.
const MOST_NUMBERS: usize = 1 << 28;
/// Extensions that compress views, of which a plain reader finds no bytes.
const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
/// Extensions that a file may require without its skeleton or animation depending on them.
const HARMLESS: [&str; 10] = [
    "KHR_materials",
    "KHR_texture",
    "KHR_lights",
    "KHR_mesh_quantization",
    // of meshes alone
    "KHR_draco",
    // may compress animations too: a view that it compresses is refused where numbers of it are needed
    MESHOPT[0],
    MESHOPT[1],
    "EXT_texture",
    "VRM",
    "MSFT_texture",
];

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Json {
    pub asset: Asset,
    extensions_required: Vec<String>,
    pub extensions: Extensions,
    pub nodes: Vec<Node>,
    pub meshes: Vec<Mesh>,
    pub skins: Vec<Skin>,
    pub animations: Vec<Animation>,
    pub accessors: Vec<Accessor>,
    pub buffer_views: Vec<View>,
    pub buffers: Vec<BufferOf>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Asset {
    version: String,
    min_version: Option<String>,
    pub generator: String,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct Node {
    pub name: Option<String>,
    pub children: Vec<usize>,
    pub translation: Option<[f64; 3]>,
    pub rotation: Option<[f64; 4]>,
    pub scale: Option<[f64; 3]>,
    pub matrix: Option<[f64; 16]>,
    pub mesh: Option<usize>,
    pub skin: Option<usize>,
    pub camera: Option<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct Mesh {
    pub primitives: Vec<Primitive>,
}

/// A part of a mesh: its accessors by name.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct Primitive {
    pub attributes: BTreeMap<String, usize>,
    extensions: BTreeMap<String, IgnoredAny>,
}

impl Primitive {
    /// Whether its numbers are in an extension's form, which its accessors don't show.
    pub fn is_compressed(&self) -> bool {
        self.extensions.keys().any(|name| name.starts_with("KHR_draco"))
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Skin {
    pub joints: Vec<usize>,
    pub inverse_bind_matrices: Option<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct Animation {
    pub name: Option<String>,
    pub channels: Vec<ChannelOf>,
    pub samplers: Vec<Sampler>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct ChannelOf {
    pub sampler: usize,
    pub target: Target,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct Target {
    pub node: Option<usize>,
    pub path: String,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct Sampler {
    pub input: usize,
    pub output: usize,
    pub interpolation: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Accessor {
    buffer_view: Option<usize>,
    byte_offset: usize,
    component_type: u32,
    count: usize,
    normalized: bool,
    #[serde(rename = "type")]
    kind: String,
    sparse: Option<serde_json::Value>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct View {
    buffer: usize,
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
    extensions: BTreeMap<String, IgnoredAny>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct BufferOf {
    pub uri: Option<String>,
}

/// A file with its binary chunk.
pub struct Document<'a> {
    path: &'a Path,
    pub json: Json,
    binary: &'a [u8],
}

impl<'a> Document<'a> {
    /// The document of a GLB.
    ///
    /// # Errors
    /// [`FaultKind::NotThisFormat`] for bytes that are no GLB of version 2, or that need an extension.
    pub fn parse(path: &'a Path, bytes: &'a [u8]) -> Result<Self> {
        Document::of(path, &Chunks::parse(path, bytes)?)
    }

    /// The document of a GLB's chunks.
    ///
    /// # Errors
    /// [`FaultKind::NotThisFormat`] for one that is damaged, or needs an extension.
    pub fn of(path: &'a Path, chunks: &Chunks<'a>) -> Result<Self> {
        let bad = |found: String, expected: &str| not_this(path, found, expected);
        let json: Json = serde_json::from_slice(chunks.json).map_err(|e| bad(e.to_string(), "a glTF document"))?;
        if !json.asset.version.starts_with("2.") {
            return Err(bad(format!("an asset of version {:?}", json.asset.version), "version 2"));
        }
        if let Some(needs) = json.asset.min_version.as_ref().filter(|needs| *needs != "2.0") {
            return Err(bad(format!("an asset for readers of version {needs:?}"), "version 2.0"));
        }
        let strange = |e: &&String| !HARMLESS.iter().any(|known| e.starts_with(known));
        if let Some(needs) = json.extensions_required.iter().find(strange) {
            return Err(bad(
                format!("a file that requires {needs}"),
                "one without it; export it without that extension",
            ));
        }
        Ok(Document { path, json, binary: chunks.binary.unwrap_or_default() })
    }

    /// Whether it has a mesh that isn't the body of capsules which kinelm gives its own files.
    pub fn has_character(&self) -> bool {
        let is_own = self.json.asset.generator.starts_with("kinelm ");
        !is_own && self.json.nodes.iter().any(|node| node.mesh.is_some())
    }

    pub fn fault(&self, found: String, expected: &str) -> Error {
        not_this(self.path, found, expected)
    }

    /// The numbers of an accessor of `width` components (N, width), whole ones normalised (section 3.11).
    pub fn numbers(&self, index: usize, width: usize) -> Result<Vec<f64>> {
        self.read(index, width, normalised)
    }

    /// The numbers of an accessor of `width` components (N, width), whole ones as they are unless it says that they are
    /// normalised.
    pub fn stored(&self, index: usize, width: usize) -> Result<Vec<f64>> {
        let is_normalised = self.json.accessors.get(index).is_some_and(|accessor| accessor.normalized);
        self.read(index, width, if is_normalised { normalised } else { plain })
    }

    fn read(&self, index: usize, width: usize, number: fn(u32, &[u8]) -> f64) -> Result<Vec<f64>> {
        let bad = |found: String, expected: &str| self.fault(format!("accessor {index}: {found}"), expected);
        let accessor = self.json.accessors.get(index).ok_or_else(|| bad("not there".into(), "an accessor"))?;
        if accessor.sparse.is_some() {
            return Err(bad("sparse".into(), "a whole one; export it without sparse accessors"));
        }
        let own = match accessor.kind.as_str() {
            "SCALAR" => 1,
            "VEC3" => 3,
            "VEC4" => 4,
            "MAT4" => 16,
            _ => 0,
        };
        if own != width {
            return Err(bad(format!("the type {:?}", accessor.kind), &format!("{width} components")));
        }
        let size = match accessor.component_type {
            5120 | 5121 => 1,
            5122 | 5123 => 2,
            5126 => 4,
            other => return Err(bad(format!("the component type {other}"), "floats or normalised numbers")),
        };
        // numbers that stand in the file are as many as it is long; those without a view cost it nothing
        let most = if accessor.buffer_view.is_some() { MOST_NUMBERS } else { MOST_ZEROS };
        if accessor.count.saturating_mul(width) > most {
            let found = format!("accessor {index} of {} elements", accessor.count);
            return Err(FileError::new(SourcePos::file(self.path), FaultKind::TooLarge, found, "fewer").into());
        }
        // by the specification, an accessor without a view is all zeros
        let Some(view) = accessor.buffer_view else { return Ok(vec![0.0; accessor.count * width]) };
        let view = self.json.buffer_views.get(view).ok_or_else(|| bad("no buffer view".into(), "one"))?;
        if let Some(name) = MESHOPT.iter().find(|&&name| view.extensions.contains_key(name)) {
            return Err(bad(format!("compressed by {name}"), "plain numbers; export animation and skin uncompressed"));
        }
        // the first buffer alone is the binary chunk (section 4.4.3.3)
        let outside = view.buffer > 0 || self.json.buffers.first().is_none_or(|b| b.uri.is_some());
        if outside {
            return Err(bad("a buffer in another file".into(), "the file's own binary chunk; export as GLB"));
        }
        let end = view.byte_offset.saturating_add(view.byte_length);
        let bytes = self.binary.get(view.byte_offset..end).ok_or_else(|| bad("beyond its buffer".into(), "inside"))?;
        let stride = view.byte_stride.unwrap_or(size * width);
        if stride < size * width {
            // with a stride of 0, a view of one element would be as many numbers as the file likes
            return Err(bad(format!("a stride of {stride} bytes"), "that of an element or more"));
        }
        let mut numbers = Vec::with_capacity(accessor.count * width);
        for n in 0..accessor.count {
            for c in 0..width {
                let at = n.saturating_mul(stride).saturating_add(accessor.byte_offset).saturating_add(c * size);
                let raw =
                    bytes.get(at..at.saturating_add(size)).ok_or_else(|| bad("beyond its view".into(), "inside"))?;
                numbers.push(number(accessor.component_type, raw));
            }
        }
        match numbers.iter().position(|x| !x.is_finite()) {
            None => Ok(numbers),
            Some(n) => {
                let found = format!("accessor {index}: {} in element {}", numbers[n], n / width);
                Err(FileError::new(SourcePos::file(self.path), FaultKind::NotFinite, found, "finite numbers").into())
            }
        }
    }
}

/// A number of a component type, whole ones as fractions of the largest.
fn normalised(kind: u32, raw: &[u8]) -> f64 {
    match (kind, raw) {
        // -128 would be below -1, so the specification clamps
        (5120, _) => (plain(kind, raw) / 127.0).max(-1.0),
        (5121, _) => plain(kind, raw) / 255.0,
        (5122, _) => (plain(kind, raw) / 32767.0).max(-1.0),
        (5123, _) => plain(kind, raw) / 65535.0,
        _ => plain(kind, raw),
    }
}

/// A number of a component type.
fn plain(kind: u32, raw: &[u8]) -> f64 {
    match (kind, raw) {
        (5120, [a]) => f64::from(*a as i8),
        (5121, [a]) => f64::from(*a),
        (5122, [a, b]) => f64::from(i16::from_le_bytes([*a, *b])),
        (5123, [a, b]) => f64::from(u16::from_le_bytes([*a, *b])),
        (_, [a, b, c, d]) => f64::from(f32::from_le_bytes([*a, *b, *c, *d])),
        _ => 0.0,
    }
}
