//! The readers of foreign bytes, each as a function that must return for any input: with a value or with an error. The
//! readers themselves bound the memory that an input can take.
//!
//! `cargo +nightly fuzz run NAME` drives one of them, guided by coverage; `tests/fuzz.rs` of the workspace drives all of
//! them briefly on stable Rust.

use kinelm::corpus::music::beats;
use kinelm::corpus::settings::Settings;
use kinelm::corpus::{Corpus, label_table};
use kinelm::generate::provenance::Provenance;
use kinelm::model::{CheckpointChoice, load_run, weights};
use kinelm::spectral::query::Index;
use kinelm::train::TrainFile;
use kinelm_motion::format::body_model::BodyModel;
use kinelm_motion::format::npz::Npz;
use kinelm_motion::format::pickle::Pickle;
use kinelm_motion::format::{ReadOptions, aist, amass, amc, bvh, glb, json};
use kinelm_motion::joints::THIRTEEN;
use kinelm_motion::rig::SkeletonMap;
use kinelm_motion::{Clip, joints, synth};
use kinelm_tokenizer::{LappedConfig, SchemeConfig, Tokenizer, TokenizerConfig, UncodedPose};
use std::path::Path;
use std::sync::LazyLock;

/// The name and the function of a reader.
pub type Target = (&'static str, fn(&[u8]));

/// All readers; each has a file of its name in `fuzz_targets/`.
pub const TARGETS: [Target; 19] = [
    ("amc", amc),
    ("bvh", bvh),
    ("glb", glb),
    ("amass", amass),
    ("body_model", body_model),
    ("aist", aist),
    ("json", json),
    ("skeleton_map", skeleton_map),
    ("joint_list", joint_list),
    ("tokenizer", tokenizer),
    ("text", text),
    ("settings", settings),
    ("labels", labels),
    ("train_file", train_file),
    ("weights", weights),
    ("sidecar", sidecar),
    ("folders", folders),
    ("music", music),
    ("beats", beats),
];

/// An ASF, and behind a zero byte an AMC.
pub fn amc(data: &[u8]) {
    let mut files = data.splitn(2, |byte| *byte == 0);
    let [asf, amc] = [0; 2].map(|_| files.next().unwrap_or_default());
    let _ = amc::parse(Path::new("a.amc"), amc, Path::new("a.asf"), asf, &ReadOptions::default());
}

/// A BVH, strict or lenient, and its positions. What is read is written and read again.
pub fn bvh(data: &[u8]) {
    let path = Path::new("a.bvh");
    let options = ReadOptions { lenient: data.len().is_multiple_of(2), ..ReadOptions::default() };
    let _ = bvh::positions(path, data, &options);
    if let Ok(motion) = bvh::read(path, data, &options)
        && let Ok(bytes) = bvh::to_bytes(&motion)
    {
        let again = bvh::read(path, &bytes, &options).expect("what we write we read");
        assert_eq!(again.clip.frames(), motion.clip.frames());
    }
}

/// An `.npz`, also as AMASS.
pub fn amass(data: &[u8]) {
    let path = Path::new("a.npz");
    let _ = amass::read(path, data, &ReadOptions::default());
    if let Ok(npz) = Npz::open(path, data) {
        npz.keys().iter().for_each(|key| drop(npz.array(key)));
    }
}

/// A body model, and its body for a shape.
pub fn body_model(data: &[u8]) {
    if let Ok(model) = BodyModel::parse(Path::new("b.npz"), data) {
        let _ = model.body(&[0.5; 10]);
    }
}

/// A pickle, also as AIST++.
pub fn aist(data: &[u8]) {
    let path = Path::new("a.pkl");
    let _ = Pickle::parse(path, data);
    let _ = aist::read(path, data, &ReadOptions::default());
}

/// A GLB.
pub fn glb(data: &[u8]) {
    let _ = glb::read(Path::new("a.glb"), data, &ReadOptions::default());
}

/// A clip as JSON.
pub fn json(data: &[u8]) {
    let _ = json::read(Path::new("a.json"), data, &ReadOptions::default());
}

/// A skeleton map.
pub fn skeleton_map(data: &[u8]) {
    with_text(data, |text| drop(SkeletonMap::parse(text, Path::new("map.toml"))));
}

/// A joint list.
pub fn joint_list(data: &[u8]) {
    with_text(data, |text| drop(joints::parse(text)));
}

/// A `tokenizer.json`; a valid one decodes ids.
pub fn tokenizer(data: &[u8]) {
    with_text(data, |text| {
        if let Ok(tokenizer) = Tokenizer::from_json(text) {
            let words = tokenizer.words_of_ids(&[6, 7, 5, 8, 5]).words;
            let _ = tokenizer.decode(&words, UncodedPose::Identity);
        }
    });
}

/// Words as text, of fixed and of varying length.
pub fn text(data: &[u8]) {
    static TOKENIZERS: LazyLock<[Tokenizer; 2]> = LazyLock::new(|| {
        let dances = synth::corpus(1, 2, 4.0, 20.0).expect("made-up dances");
        let dances: Vec<Clip> = dances.into_iter().map(|dance| dance.clip).collect();
        let uniform = TokenizerConfig::uniform(&THIRTEEN, 20.0, 360);
        let lapped = TokenizerConfig { scheme: SchemeConfig::Lapped(LappedConfig::default()), ..uniform.clone() };
        [uniform, lapped].map(|config| Tokenizer::fit(&dances, config).expect("good settings"))
    });
    with_text(data, |text| {
        for tokenizer in TOKENIZERS.iter() {
            let read = tokenizer.words_of_ids(&tokenizer.ids_of_text(text)).words;
            let _ = tokenizer.decode(&read, UncodedPose::Identity);
            if let Ok(words) = tokenizer.words_of_text(text) {
                let _ = tokenizer.decode(&words, UncodedPose::Identity);
                let again = tokenizer.text(&words).and_then(|text| tokenizer.words_of_text(&text));
                assert_eq!(again.expect("its own words"), words);
            }
        }
    });
}

/// Tokenizer settings.
pub fn settings(data: &[u8]) {
    with_text(data, |text| {
        if let Ok(settings) = Settings::parse(text, Path::new("tokenizer.toml")) {
            let _ = settings.config();
        }
    });
}

/// A labels CSV.
pub fn labels(data: &[u8]) {
    let _ = label_table::LabelTable::parse(Path::new("labels.csv"), data);
}

/// A training file.
pub fn train_file(data: &[u8]) {
    with_text(data, |text| drop(TrainFile::parse(text, Path::new("train.toml"))));
}

/// A safetensors file.
pub fn weights(data: &[u8]) {
    let _ = weights::from_bytes(Path::new("model.safetensors"), data);
}

/// The sidecar of a dance.
pub fn sidecar(data: &[u8]) {
    in_folder("a.bvh.kinelm.json", data, |folder| {
        drop(Provenance::load(&folder.join("a.bvh.kinelm.json")));
        drop(kinelm::corpus::sidecar::read_options(&folder.join("a.bvh")));
    });
}

/// The first files of a corpus, an index and a run.
pub fn folders(data: &[u8]) {
    in_folder("corpus.json", data, |folder| drop(Corpus::open(folder)));
    in_folder("index.json", data, |folder| drop(Index::open(folder)));
    in_folder("config.toml", data, |folder| drop(load_run(folder, CheckpointChoice::Auto)));
}

/// A music file of any format, and its beats.
pub fn music(data: &[u8]) {
    in_folder("song", data, |folder| {
        if let Ok(found) = kinelm_music::beat::beats(&folder.join("song")) {
            assert!(found.times_s.windows(2).all(|pair| pair[0] < pair[1]), "beats rise");
            assert!(found.times_s.iter().all(|time| (0.0..=found.seconds).contains(time)), "and are within the music");
        }
    });
}

/// A beats file.
pub fn beats(data: &[u8]) {
    with_text(data, |text| {
        if let Ok(times) = beats::parse(Path::new("beats.txt"), text) {
            assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "what is read rises");
        }
    });
}

fn with_text(data: &[u8], read: impl FnOnce(&str)) {
    if let Ok(text) = std::str::from_utf8(data) {
        read(text);
    }
}

/// Calls `read` with a folder that contains `data` under a name.
fn in_folder(name: &str, data: &[u8], read: impl FnOnce(&Path)) {
    let folder = tempfile::tempdir().expect("a folder for temporary files");
    std::fs::write(folder.path().join(name), data).expect("room for a temporary file");
    read(folder.path());
}
