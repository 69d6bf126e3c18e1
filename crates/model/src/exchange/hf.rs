//! A folder that Hugging Face's `transformers` loads as `GPT2LMHeadModel` and `PreTrainedTokenizerFast`: `config.json`,
//! `model.safetensors` under GPT-2's names, `tokenizer.json`, `tokenizer_config.json`. Linear weights are (in, out) there too.

use super::own::{ABOUT, About};
use super::{check_tokenizer, loaded};
use crate::net::EPSILON;
use crate::run::{LoadedRun, TOKENIZER, WEIGHTS};
use crate::weights::{Array, Weights, serialize};
use crate::{Error, HeadKind, ModelConfig, ModelKind, Positions, Result, TokenLayout, layout};
use kinelm_store::input;
use kinelm_tokenizer::{Special, Tokenizer};
use serde::Deserialize;
use serde_json::{Value, json};
use std::path::Path;

/// The model's configuration.
pub const CONFIG: &str = "config.json";
/// The tokenizer's.
const TOKENIZER_CONFIG: &str = "tokenizer_config.json";
/// Our GELU by its name there: the tanh form.
const GELU: [&str; 2] = ["gelu_new", "gelu_pytorch_tanh"];
/// The prefix of all names but the head's.
const PREFIX: &str = "transformer.";
const HEAD: (&str, &str) = ("head.weight", "lm_head.weight");
const ABSOLUTE: (&str, &str) = ("position.absolute.weight", "wpe.weight");
/// Parts of a block: our name and theirs.
const PARTS: [(&str, &str); 6] = [
    ("norm1", "ln_1"),
    ("attention.qkv", "attn.c_attn"),
    ("attention.out", "attn.c_proj"),
    ("norm2", "ln_2"),
    ("mlp.up", "mlp.c_fc"),
    ("mlp.down", "mlp.c_proj"),
];

/// Our names of the tensors that both have, and theirs without the prefix.
fn names(layers: usize) -> Vec<(String, String)> {
    let mut all = vec![("token.weight".into(), "wte.weight".into())];
    let mut pair = |ours: &str, theirs: &str| {
        for part in ["weight", "bias"] {
            all.push((format!("{ours}.{part}"), format!("{theirs}.{part}")));
        }
    };
    pair("norm", "ln_f");
    for layer in 0..layers {
        for (ours, theirs) in PARTS {
            // GPT-2's Conv1D weights are (in, out) as ours, so nothing is transposed
            pair(&format!("{}.{ours}", layout::block_name(layer)), &format!("h.{layer}.{theirs}"));
        }
    }
    all
}

/// Whether a tensor is one of the masks that GPT-2's first implementations saved.
pub(super) fn is_buffer(name: &str) -> bool {
    name.ends_with(".attn.bias") || name.ends_with(".attn.masked_bias")
}

/// # Errors
/// A model that GPT-2 can't express: all reasons.
fn refuse(config: &ModelConfig, tokens: &TokenLayout) -> Result<()> {
    let reasons = [
        (!config.architecture.is_flat(), "it has two levels"),
        (config.kind != ModelKind::Causal, "it is masked"),
        (
            config.positions == Positions::FrameJoint && tokens.varying,
            "its positions are counted from words of any length",
        ),
        (config.positions == Positions::Rope, "its positions are turns of queries and keys"),
        (config.reads_previous(tokens), "its inputs tell of the frame before"),
        (config.head_of(tokens) == HeadKind::Relative, "its head is over steps from the frame before"),
    ];
    let reasons: Vec<&str> = reasons.into_iter().filter(|(holds, _)| *holds).map(|(_, reason)| reason).collect();
    match reasons.is_empty() {
        true => Ok(()),
        false => {
            let reasons = reasons.join(", and ");
            Err(Error::unsupported(
                "export as GPT-2",
                format!("GPT-2 can't express this model: {reasons}; the format `kinelm` can"),
            ))
        }
    }
}

/// (T, D): what is added to the token at each place of a window.
fn positions(run: &LoadedRun) -> Array {
    if run.config.positions == Positions::Absolute {
        return run.weights[ABSOLUTE.0].clone();
    }
    let rows = |name: &str| run.weights[name].rows().collect::<Vec<_>>();
    let (frames, places) = (rows("position.frame.weight"), rows("position.place.weight"));
    let mut all = run.weights["position.front.weight"].numbers().to_vec();
    for k in 0..run.config.context - run.tokens.front {
        let (frame, place) = (frames[k / run.tokens.word], places[k % run.tokens.word]);
        all.extend(frame.iter().zip(place).map(|(a, b)| a + b));
    }
    Array::new(&[run.config.context, run.config.width], all)
}

/// The files besides our own description and the tokenizer.
///
/// # Errors
/// A model that GPT-2 can't express, with the reasons.
pub(super) fn contents(run: &LoadedRun) -> Result<Vec<(&'static str, Vec<u8>)>> {
    let LoadedRun { config, tokens, .. } = run;
    refuse(config, tokens)?;
    let mut all = Weights::from([(format!("{PREFIX}{}", ABSOLUTE.1), positions(run))]);
    for (ours, theirs) in names(config.layers) {
        all.insert(format!("{PREFIX}{theirs}"), run.weights[&ours].clone());
    }
    if !config.tied_head {
        all.insert(HEAD.1.into(), run.weights[HEAD.0].clone());
    }
    Ok(vec![
        (WEIGHTS, serialize(&all, ("format", "pt"))?),
        (CONFIG, to_json(&config_json(config, tokens))),
        (TOKENIZER_CONFIG, to_json(&tokenizer_json(config))),
    ])
}

fn to_json(value: &Value) -> Vec<u8> {
    format!("{value:#}\n").into_bytes()
}

fn config_json(config: &ModelConfig, tokens: &TokenLayout) -> Value {
    json!({
        // AutoModel picks the class by this
        "architectures": ["GPT2LMHeadModel"],
        "model_type": "gpt2",
        "vocab_size": tokens.vocabulary,
        "n_positions": config.context,
        "n_embd": config.width,
        "n_layer": config.layers,
        "n_head": config.heads,
        "n_inner": null,
        "activation_function": GELU[0],
        "layer_norm_epsilon": EPSILON,
        "resid_pdrop": config.dropout,
        "embd_pdrop": config.dropout,
        "attn_pdrop": config.dropout,
        "scale_attn_weights": true,
        "scale_attn_by_inverse_layer_idx": false,
        "reorder_and_upcast_attn": false,
        "tie_word_embeddings": config.tied_head,
        "bos_token_id": tokens.bos,
        "eos_token_id": Special::Eos.id(),
        "pad_token_id": tokens.pad,
        // transformers reads `dtype` from 4.56 on, `torch_dtype` before
        "dtype": "float32",
        "torch_dtype": "float32",
        "use_cache": true,
    })
}

fn tokenizer_json(config: &ModelConfig) -> Value {
    json!({
        "tokenizer_class": "PreTrainedTokenizerFast",
        "model_max_length": config.context,
        "bos_token": Special::Bos.token(),
        "eos_token": Special::Eos.token(),
        "pad_token": Special::Pad.token(),
        "mask_token": Special::Mask.token(),
        "unk_token": Special::Unk.token(),
        // spaces end words of a dance, whatever character follows
        "clean_up_tokenization_spaces": false,
    })
}

/// The keys of `config.json` that are read, with GPT-2's defaults.
#[derive(Debug, Deserialize)]
struct Config {
    model_type: String,
    vocab_size: usize,
    n_positions: usize,
    n_embd: usize,
    n_layer: usize,
    n_head: usize,
    n_inner: Option<usize>,
    activation_function: Option<String>,
    layer_norm_epsilon: Option<f64>,
    resid_pdrop: Option<f64>,
    scale_attn_weights: Option<bool>,
    scale_attn_by_inverse_layer_idx: Option<bool>,
    add_cross_attention: Option<bool>,
    tie_word_embeddings: Option<bool>,
}

impl Config {
    fn read(folder: &Path) -> Result<Config> {
        let path = folder.join(CONFIG);
        let text = input::text(&path).map_err(Error::io(&path))?;
        let wrong = |found: String, expected: String| Error::file(&path, found, expected, "");
        let config: Config =
            serde_json::from_str(&text).map_err(|e| wrong(e.to_string(), "the configuration of a GPT-2".into()))?;
        let gelu = config.activation_function.as_deref().unwrap_or(GELU[0]);
        let odd = [
            (config.model_type != "gpt2", "model_type", format!("{:?}", config.model_type), "\"gpt2\"".to_string()),
            (!GELU.contains(&gelu), "activation_function", format!("{gelu:?}"), format!("{:?}", GELU[0])),
            (
                config.n_inner.is_some_and(|n| n != 4 * config.n_embd),
                "n_inner",
                format!("{:?}", config.n_inner.unwrap_or(0)),
                format!("{}", 4 * config.n_embd),
            ),
            (
                config.layer_norm_epsilon.is_some_and(|e| e != EPSILON),
                "layer_norm_epsilon",
                format!("{:?}", config.layer_norm_epsilon.unwrap_or(0.0)),
                format!("{EPSILON:?}"),
            ),
            (config.scale_attn_weights == Some(false), "scale_attn_weights", "false".into(), "true".into()),
            (
                config.scale_attn_by_inverse_layer_idx == Some(true),
                "scale_attn_by_inverse_layer_idx",
                "true".into(),
                "false".into(),
            ),
            (config.add_cross_attention == Some(true), "add_cross_attention", "true".into(), "false".into()),
        ];
        match odd.into_iter().find(|(odd, ..)| *odd) {
            Some((_, key, found, expected)) => Err(wrong(format!("{key} {found}"), expected)),
            None => Ok(config),
        }
    }

    fn is_tied(&self) -> bool {
        self.tie_word_embeddings.unwrap_or(true)
    }

    fn model(&self) -> ModelConfig {
        ModelConfig {
            kind: ModelKind::Causal,
            layers: self.n_layer,
            heads: self.n_head,
            width: self.n_embd,
            context: self.n_positions,
            positions: Positions::Absolute,
            previous_frame: Some(false),
            head: Some(HeadKind::Absolute),
            // GPT2Config's default, which its files may leave out
            dropout: self.resid_pdrop.unwrap_or(0.1),
            tied_head: self.is_tied(),
            ..Default::default()
        }
    }
}

/// Loads a folder of this form. Its positions are absolute: those of words and places in them were folded into one table. With
/// our `kinelm.json` beside it the tokens and conditions are those; without, the front is `<bos>` alone.
///
/// # Errors
/// As [`super::load`]; a GPT-2 that ours can't express; a tokenizer that is none of ours.
pub fn load(folder: &Path) -> Result<LoadedRun> {
    let config = Config::read(folder)?;
    let mut notes = Vec::new();
    let about = match folder.join(ABOUT).is_file() {
        true => {
            let about = About::read(folder)?;
            if about.model.positions == Positions::FrameJoint {
                let why = "GPT-2 has one table, into which those of frames and joints were folded";
                notes.push(format!("{}: positions become absolute: {why}", folder.display()));
            }
            About { model: config.model(), ..about }
        }
        false => {
            let path = folder.join(TOKENIZER);
            let tokenizer = Tokenizer::load(&path)?;
            let tokens = TokenLayout::of(&tokenizer);
            check_tokenizer(&tokens, &tokenizer, &path)?;
            About::new(config.model(), tokens, &tokenizer)
        }
    };
    let wrong = |found: String, expected: String| Err(Error::file(folder.join(CONFIG), found, expected, ""));
    // a padded table (to a multiple of 64, say) has rows that no token of ours names
    if about.tokens.vocabulary != config.vocab_size {
        return wrong(
            format!("vocab_size {}", config.vocab_size),
            format!("the tokenizer's {}", about.tokens.vocabulary),
        );
    }
    if let Err(e) = about.model.validate_for(&about.tokens) {
        return wrong(e.to_string(), "a model that can be".into());
    }
    let weights = ours(&config, super::read(&folder.join(WEIGHTS))?, &folder.join(WEIGHTS))?;
    loaded(folder, about, weights, notes)
}

/// The tensors under our names.
fn ours(config: &Config, found: Weights, path: &Path) -> Result<Weights> {
    let wrong =
        |found: String| Err(Error::file(path, found, "the weights of a GPT2LMHeadModel as config.json has it", ""));
    // a GPT2Model's names have no prefix
    let short = |name: String| name.strip_prefix(PREFIX).map(str::to_owned).unwrap_or(name);
    let mut found: Weights = found.into_iter().map(|(name, t)| (short(name), t)).collect();
    found.retain(|name, _| !is_buffer(name));
    let mut all = names(config.n_layer);
    all.push((ABSOLUTE.0.into(), ABSOLUTE.1.into()));
    let mut weights = Weights::new();
    for (ours, theirs) in all {
        match found.remove(&theirs) {
            Some(tensor) => weights.insert(ours, tensor),
            None => return wrong(format!("no tensor {PREFIX}{theirs}")),
        };
    }
    match (config.is_tied(), found.remove(HEAD.1)) {
        (false, Some(head)) => {
            weights.insert(HEAD.0.into(), head);
        }
        (false, None) => return wrong(format!("no tensor {}", HEAD.1)),
        // `save_pretrained` may write a tied head beside the embedding: the same numbers are no second table
        (true, Some(head)) if head != weights["token.weight"] => {
            return wrong(format!("a tensor {} that is not {PREFIX}wte.weight, to which config.json ties it", HEAD.1));
        }
        (true, _) => (),
    }
    match found.keys().next() {
        Some(name) => wrong(format!("a tensor {name} that a GPT-2 has no place for")),
        None => Ok(weights),
    }
}
