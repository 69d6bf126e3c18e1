//! Folders that are written and read back, and those that are refused.

use super::*;
use crate::{DeviceName, HeadKind, ModelKind, Positions};
use kinelm_tokenizer::TokenizerConfig;
use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

struct Made {
    dir: tempfile::TempDir,
    run: LoadedRun,
}

impl Made {
    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn export(&self, format: Format, name: &str) -> PathBuf {
        export(&self.run, format, &self.path(name)).unwrap();
        self.path(name)
    }
}

/// A model that GPT-2 can express.
fn gpt2(positions: Positions, tied_head: bool) -> ModelConfig {
    ModelConfig {
        layers: 2,
        heads: 2,
        width: 8,
        context: 30,
        positions,
        tied_head,
        previous_frame: Some(false),
        head: Some(HeadKind::Absolute),
        dropout: 0.125,
        ..Default::default()
    }
}

/// Models that it can't.
fn beyond() -> [ModelConfig; 4] {
    let of = |positions| gpt2(positions, true);
    [
        ModelConfig { previous_frame: Some(true), ..of(Positions::FrameJoint) },
        ModelConfig { head: Some(HeadKind::Relative), ..of(Positions::Absolute) },
        of(Positions::Rope),
        ModelConfig { kind: ModelKind::Masked, ..of(Positions::FrameJoint) },
    ]
}

/// A run of made-up weights.
fn made(config: ModelConfig) -> Made {
    let dir = tempfile::tempdir().unwrap();
    let walk = kinelm_corpus::samples::walk(5);
    let tokenizer = Tokenizer::fit([&walk], TokenizerConfig::uniform(&[0], 20.0, 10)).unwrap();
    tokenizer.save(dir.path().join(TOKENIZER)).unwrap();
    let tokens = TokenLayout::of(&tokenizer);
    let mut weights = weights::initial(&config, &tokens, 3);
    // numbers whose sums are rounded
    crate::fixtures::scale(&mut weights, 37.3);
    let run = LoadedRun {
        config,
        tokens,
        conditions: Vec::new(),
        label_dropout: None,
        weights,
        tokenizer: dir.path().join(TOKENIZER),
        tokenizer_sha256: tokenizer.hash(),
        checkpoint: dir.path().to_owned(),
        state: State::new(70, 0, 0, 0, None),
        notes: Vec::new(),
    };
    Made { dir, run }
}

fn numbers(array: &Array) -> (Vec<usize>, Vec<u32>) {
    (array.shape().to_vec(), array.numbers().iter().map(|x| x.to_bits()).collect())
}

fn all(run: &LoadedRun) -> BTreeMap<&str, (Vec<usize>, Vec<u32>)> {
    run.weights.iter().map(|(name, array)| (name.as_str(), numbers(array))).collect()
}

fn logits(run: &LoadedRun) -> Vec<f32> {
    let gpt = run.plain(DeviceName::Cpu).unwrap();
    let ids: Vec<u32> = (0..run.config.context).map(|i| if i == 0 { 1 } else { 5 + (i * i % 11) as u32 }).collect();
    let logits = gpt.predict(&gpt.ids(&ids, ids.len()).unwrap()).unwrap();
    logits.flatten_all().unwrap().to_vec1().unwrap()
}

const FORMS: [(Positions, bool); 3] =
    [(Positions::FrameJoint, true), (Positions::Absolute, true), (Positions::Absolute, false)];

#[test]
fn our_own_form_comes_back_bit_by_bit() {
    for config in FORMS.map(|(positions, tied)| gpt2(positions, tied)).into_iter().chain(beyond()) {
        let made = made(config);
        let folder = made.export(Format::Kinelm, "out");
        let again = load(&folder, CheckpointChoice::Auto).unwrap();
        assert_eq!(all(&again), all(&made.run));
        assert_eq!((&again.config, &again.tokens, again.state.step), (&made.run.config, &made.run.tokens, 70));
        assert_eq!(fs::read(&again.tokenizer).unwrap(), fs::read(&made.run.tokenizer).unwrap());
        assert!(again.notes.is_empty());
        let names: Vec<_> = ["kinelm.json", "model.safetensors", "tokenizer.json"].to_vec();
        let mut found: Vec<String> =
            fs::read_dir(&folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        found.sort();
        assert_eq!(found, names);
    }
}

#[test]
fn gpt_2_comes_back_with_the_same_logits() {
    for (positions, tied) in FORMS {
        let made = made(gpt2(positions, tied));
        let folder = made.export(Format::Hf, "out");
        let again = load(&folder, CheckpointChoice::Auto).unwrap();
        assert_eq!((again.config.positions, again.config.tied_head), (Positions::Absolute, tied));
        assert_eq!((again.config.dropout, &again.tokens, again.state.step), (0.125, &made.run.tokens, 70));
        assert_eq!(logits(&again), logits(&made.run), "{positions:?}");
        let noted = again.notes.iter().any(|n| n.contains("positions become absolute"));
        assert_eq!(noted, positions == Positions::FrameJoint);
        if positions == Positions::Absolute {
            assert_eq!(all(&again), all(&made.run));
        }
        // without our own description
        fs::remove_file(folder.join(own::ABOUT)).unwrap();
        let plain = load(&folder, CheckpointChoice::Auto).unwrap();
        assert_eq!(all(&plain), all(&again));
        assert_eq!((&plain.config, &plain.tokens, plain.state.step), (&again.config, &again.tokens, 0));
    }
}

#[test]
fn a_gpt_2_folder_holds_what_transformers_reads() {
    let made = made(gpt2(Positions::FrameJoint, false));
    let folder = made.export(Format::Hf, "out");
    let json =
        |name: &str| -> serde_json::Value { serde_json::from_slice(&fs::read(folder.join(name)).unwrap()).unwrap() };
    let config = json("config.json");
    for (key, expected) in [("n_positions", 30), ("n_embd", 8), ("n_layer", 2), ("n_head", 2), ("vocab_size", 16)] {
        assert_eq!(config[key], expected, "{key}");
    }
    assert_eq!((&config["activation_function"], &config["tie_word_embeddings"]), (&"gelu_new".into(), &false.into()));
    let ids = ["bos_token_id", "eos_token_id", "pad_token_id"].map(|key| config[key].as_u64().unwrap());
    assert_eq!(ids, [1, 2, 0]);
    let tokenizer = json("tokenizer_config.json");
    assert_eq!((&tokenizer["bos_token"], &tokenizer["model_max_length"]), (&"<bos>".into(), &30.into()));
    let found = read(&folder.join(WEIGHTS)).unwrap();
    let shape = |name: &str| found[name].shape().to_vec();
    assert_eq!(shape("transformer.wpe.weight"), [30, 8]);
    assert_eq!(shape("transformer.h.1.attn.c_attn.weight"), [8, 24]);
    assert_eq!((shape("transformer.h.0.mlp.c_proj.weight"), shape("lm_head.weight")), (vec![32, 8], vec![16, 8]));
    assert_eq!(found.len(), 2 + 2 * 12 + 2 + 1);
    // place 0 of word 2 of 7 tokens, after the front
    let row = |name: &str, i: usize| made.run.weights[name].rows().nth(i).unwrap();
    let (frame, place) = (row("position.frame.weight", 2), row("position.place.weight", 0));
    let sum: Vec<f32> = frame.iter().zip(place).map(|(a, b)| a + b).collect();
    let found = |i: usize| found["transformer.wpe.weight"].rows().nth(i).unwrap();
    assert_eq!(found(15), sum);
    assert_eq!(found(0), row("position.front.weight", 0));
}

/// The error of loading a folder of `format` after a change to it.
fn said(format: Format, change: &dyn Fn(&Path)) -> String {
    let made = made(gpt2(Positions::Absolute, true));
    let folder = made.export(format, "out");
    change(&folder);
    load(&folder, CheckpointChoice::Auto).err().unwrap().to_string()
}

fn edit(folder: &Path, name: &str, from: &str, to: &str) {
    let text = fs::read_to_string(folder.join(name)).unwrap();
    assert!(text.contains(from), "{from} in {text}");
    fs::write(folder.join(name), text.replacen(from, to, 1)).unwrap();
}

/// Writes the weights again, changed.
fn reweigh(folder: &Path, change: &dyn Fn(&mut Weights)) {
    let mut all = read(&folder.join(WEIGHTS)).unwrap();
    change(&mut all);
    let bytes = crate::weights::to_bytes(&all).unwrap();
    fs::write(folder.join(WEIGHTS), bytes).unwrap();
    // without the hash, so that the tensors themselves are checked
    let about = fs::read_to_string(folder.join(own::ABOUT)).unwrap();
    let mut about: serde_json::Value = serde_json::from_str(&about).unwrap();
    about.as_object_mut().unwrap().remove("weights_sha256");
    fs::write(folder.join(own::ABOUT), about.to_string()).unwrap();
}

#[test]
fn a_flipped_bit_of_the_weights_is_told_by_their_hash() {
    let flip = |folder: &Path| {
        let mut bytes = fs::read(folder.join(WEIGHTS)).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        fs::write(folder.join(WEIGHTS), bytes).unwrap();
    };
    let message = said(Format::Kinelm, &flip);
    assert!(message.contains("model.safetensors: found SHA-256") && message.contains("kinelm.json"), "{message}");
    // folders that say nothing of it are read as they are
    let made = made(gpt2(Positions::Absolute, true));
    for (format, name) in [(Format::Kinelm, "own"), (Format::Hf, "hf")] {
        let folder = made.export(format, name);
        reweigh(&folder, &|_| ());
        flip(&folder);
        load(&folder, CheckpointChoice::Auto).unwrap();
    }
}

#[test]
fn odd_configurations_are_refused_by_their_key() {
    let hf = |from: &str, to: &str| said(Format::Hf, &|f| edit(f, "config.json", from, to));
    let message = hf("gelu_new", "relu");
    assert!(message.ends_with("config.json: found activation_function \"relu\", expected \"gelu_new\""), "{message}");
    assert!(hf("\"gpt2\"", "\"bert\"").contains("found model_type \"bert\", expected \"gpt2\""));
    assert!(hf("0.00001", "0.000001").contains("found layer_norm_epsilon 1e-6, expected 1e-5"));
    assert!(hf("\"n_inner\": null", "\"n_inner\": 31").contains("found n_inner 31, expected 32"));
    assert!(
        hf("\"vocab_size\": 16", "\"vocab_size\": 17").contains("found vocab_size 17, expected the tokenizer's 16")
    );
    assert!(hf("\"n_head\": 2", "\"n_head\": 3").contains("model.heads 3"));
    let own = |from: &str, to: &str| said(Format::Kinelm, &|f| edit(f, "kinelm.json", from, to));
    assert!(own("\"schema\": 2", "\"schema\": 1").contains("found schema 1, expected schema 2; use its kinelm"));
    assert!(own("\"conditions\": []", "\"conditions\": [\"genre\"]").contains("1 tokens in front and 1 conditions"));
    assert!(own("\"vocabulary\": 16", "\"vocabulary\": 18").contains("found a tokenizer of 16 ids"));
    assert!(own("\"layers\": 2", "\"layer\": 2").contains("unknown field `layer`"));
    assert!(own("tokenizer_sha256\": \"", "tokenizer_sha256\": \"0").contains("found a tokenizer with hash"));
    let nothing = said(Format::Kinelm, &|f| fs::remove_file(f.join("kinelm.json")).unwrap());
    assert!(nothing.contains("found no config.toml, kinelm.json or config.json"), "{nothing}");
    assert!(said(Format::Hf, &|f| fs::remove_file(f.join(TOKENIZER)).unwrap()).contains("tokenizer.json"));
}

fn odd() -> Array {
    Array::full(&[2, 3], 0.0)
}

#[test]
fn odd_tensors_are_refused_by_their_name() {
    type Change = dyn Fn(&mut Weights);
    let hf = |change: &Change| said(Format::Hf, &|f| reweigh(f, change));
    let own = |change: &Change| said(Format::Kinelm, &|f| reweigh(f, change));
    let message = hf(&|t| drop(t.remove("transformer.h.1.ln_2.bias")));
    assert!(message.contains("model.safetensors: found no tensor transformer.h.1.ln_2.bias"), "{message}");
    assert!(hf(&|t| drop(t.insert("x".into(), odd()))).contains("a tensor x that a GPT-2 has no place for"));
    assert!(hf(&|t| drop(t.insert("lm_head.weight".into(), odd()))).contains("to which config.json ties it"));
    assert!(own(&|t| drop(t.remove("norm.bias"))).contains("no tensor norm.bias"));
    let message = own(&|t| drop(t.insert("norm.bias".into(), odd())));
    assert!(message.contains("norm.bias has shape [2, 3]; this model expects [8]"), "{message}");
    let infinite = |t: &mut Weights| {
        let bias = Array::new(&[8], vec![0.0, 1.0, f32::NAN, 0.0, 0.0, 0.0, 0.0, 0.0]);
        t.insert("norm.bias".into(), bias);
    };
    assert!(own(&infinite).contains("found NaN in the tensor norm.bias"));
    let cut = |f: &Path| {
        let bytes = fs::read(f.join(WEIGHTS)).unwrap();
        fs::write(f.join(WEIGHTS), &bytes[..bytes.len() - 1]).unwrap();
    };
    assert!(said(Format::Kinelm, &cut).contains("found no safetensors file"));
}

#[test]
fn what_transformers_saves_again_is_read() {
    let made = made(gpt2(Positions::Absolute, true));
    let folder = made.export(Format::Hf, "out");
    reweigh(&folder, &|all| {
        // a GPT2Model's names, the tied head beside them
        let mut changed: Weights =
            all.iter().map(|(name, t)| (name.replacen("transformer.", "", 1), t.clone())).collect();
        changed.insert("lm_head.weight".into(), changed["wte.weight"].clone());
        *all = changed;
    });
    assert_eq!(all(&load(&folder, CheckpointChoice::Auto).unwrap()), all(&made.run));
    // it has one model
    let message = load(&folder, CheckpointChoice::Latest).err().unwrap().to_string();
    assert!(message.contains("`checkpoint`") && message.contains("an exported folder"), "{message}");
}

#[test]
fn weights_in_other_forms_are_called_by_their_name() {
    let told = |change: &dyn Fn(&Path)| {
        let text = said(Format::Hf, change);
        assert!(text.contains("model.safetensors; let transformers save it anew"), "{text}");
        assert!(text.contains("save_pretrained(\"NEW\", max_shard_size"), "{text}");
        text
    };
    // as `save_pretrained(DIR, max_shard_size="1MB")` leaves a folder
    let text = told(&|folder| {
        fs::rename(folder.join(WEIGHTS), folder.join("model-00001-of-00002.safetensors")).unwrap();
        fs::write(folder.join("model.safetensors.index.json"), r#"{"metadata": {}, "weight_map": {}}"#).unwrap();
    });
    assert!(
        text.contains("model.safetensors.index.json: found the list of weights that are in several files"),
        "{text}"
    );
    for (file, what) in [
        ("pytorch_model.bin", "pytorch_model.bin: found weights in PyTorch's own form"),
        (
            "pytorch_model.bin.index.json",
            "pytorch_model.bin.index.json: found the list of weights that are in several files",
        ),
    ] {
        let text = told(&|folder| fs::rename(folder.join(WEIGHTS), folder.join(file)).unwrap());
        assert!(text.contains(what), "{text}");
        // whatever the folder lacks besides: that is said first
        let text = told(&|folder| {
            fs::rename(folder.join(WEIGHTS), folder.join(file)).unwrap();
            fs::remove_file(folder.join(TOKENIZER)).unwrap();
            fs::remove_file(folder.join(hf::CONFIG)).unwrap();
        });
        assert!(text.contains(what), "{text}");
    }
    // beside weights that are read they don't matter
    let model = made(gpt2(Positions::Absolute, true));
    let folder = model.export(Format::Hf, "hf");
    fs::write(folder.join("pytorch_model.bin"), "").unwrap();
    load(&folder, CheckpointChoice::Auto).unwrap();
    let text = load(&folder.join("pytorch_model.bin"), CheckpointChoice::Auto).err().unwrap().to_string();
    assert!(text.contains("give the folder that the file is in"), "{text}");
}

#[test]
fn half_floats_are_widened() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.safetensors");
    // 1, -2.5
    let bytes = [0x80, 0x3f, 0x20, 0xc0];
    let view = safetensors::tensor::TensorView::new(Dtype::BF16, vec![2], &bytes).unwrap();
    fs::write(&path, safetensors::serialize([("x", view)], None).unwrap()).unwrap();
    assert_eq!(read(&path).unwrap()["x"].numbers(), [1.0, -2.5]);
    let view = safetensors::tensor::TensorView::new(Dtype::I32, vec![1], &bytes).unwrap();
    fs::write(&path, safetensors::serialize([("x", view)], None).unwrap()).unwrap();
    let message = read(&path).unwrap_err().to_string();
    assert!(message.contains("found tensor x of I32, expected a safetensors file of f32, f16 or bf16"), "{message}");
}

#[test]
fn what_is_there_stays_and_what_cannot_be_is_refused() {
    let made = made(gpt2(Positions::FrameJoint, true));
    let out = made.export(Format::Kinelm, "out");
    let before = fs::read(out.join(WEIGHTS)).unwrap();
    let message = export(&made.run, Format::Hf, &out).unwrap_err().to_string();
    assert!(message.ends_with("out exists, with other contents; give a folder that isn't there"), "{message}");
    assert_eq!(fs::read(out.join(WEIGHTS)).unwrap(), before);
    let refused = |run: &LoadedRun| hf::contents(run).unwrap_err().to_string();
    let tokens = TokenLayout { varying: true, places: Vec::new(), ..made.run.tokens.clone() };
    let message = refused(&LoadedRun { tokens, ..made.run });
    assert!(
        message.starts_with("export as GPT-2: GPT-2 can't express this model: its positions are counted"),
        "{message}"
    );
    let reasons =
        ["its inputs tell of the frame before", "its head is over steps", "its positions are turns", "it is masked"];
    for (config, reason) in beyond().into_iter().zip(reasons) {
        let message = refused(&self::made(config).run);
        assert!(message.contains(reason) && message.ends_with("; the format `kinelm` can"), "{message}");
    }
}
