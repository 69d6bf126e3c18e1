//! What reads bytes that others wrote, each as a function that must come back from any of them: with what was read, or with
//! an error. Memory that a few bytes ask for is bounded by the readers themselves.
//!
//! `cargo +nightly fuzz run NAME` drives one of them, guided by what they cover; `tests/fuzz.rs` of the workspace drives all
//! for a moment, on stable Rust.

use kinelm::corpus::music::beats;
use kinelm::corpus::settings::Settings;
use kinelm::corpus::{Corpus, labels};
use kinelm::evaluate::{CodeSplits, Extent};
use kinelm::generate::provenance::Provenance;
use kinelm::model::{CheckpointChoice, load_run, weights};
use kinelm::spectral::query::Index;
use kinelm::train::TrainFile;
use kinelm_motion::format::body_model::BodyModel;
use kinelm_motion::format::npz::Npz;
use kinelm_motion::format::pickle::Pickle;
use kinelm_motion::format::{ReadOptions, aist, amass, bvh, json};
use kinelm_motion::joints::THIRTEEN;
use kinelm_motion::rig::SkeletonMap;
use kinelm_motion::{Clip, joints, synth};
use kinelm_tokenizer::{LappedConfig, SchemeConfig, Tokenizer, TokenizerConfig, UncodedPose};
use std::path::Path;
use std::sync::LazyLock;

/// A reader by its name.
pub type Target = (&'static str, fn(&[u8]));

/// All of them; a file of `fuzz_targets/` has the name of each.
pub const TARGETS: [Target; 18] = [
    ("bvh", bvh),
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
    ("codes", codes),
    ("sidecar", sidecar),
    ("folders", folders),
    ("music", music),
    ("beats", beats),
];

/// A BVH, read strictly or leniently, its places too; what was read is written and read again.
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

/// An `.npz` and AMASS in it.
pub fn amass(data: &[u8]) {
    let path = Path::new("a.npz");
    let _ = amass::read(path, data, &ReadOptions::default());
    if let Ok(npz) = Npz::open(path, data) {
        npz.keys().iter().for_each(|key| drop(npz.array(key)));
    }
}

/// A body model, and the body of a shape.
pub fn body_model(data: &[u8]) {
    if let Ok(model) = BodyModel::parse(Path::new("b.npz"), data) {
        let _ = model.body(&[0.5; 10]);
    }
}

/// A pickle and AIST++ in it.
pub fn aist(data: &[u8]) {
    let path = Path::new("a.pkl");
    let _ = Pickle::parse(path, data);
    let _ = aist::read(path, data, &ReadOptions::default());
}

/// A clip as JSON.
pub fn json(data: &[u8]) {
    let _ = json::read(Path::new("a.json"), data, &ReadOptions::default());
}

/// The TOML of a skeleton map.
pub fn skeleton_map(data: &[u8]) {
    with_text(data, |text| drop(SkeletonMap::parse(text, Path::new("map.toml"))));
}

/// What `--joints` takes.
pub fn joint_list(data: &[u8]) {
    with_text(data, |text| drop(joints::parse(text)));
}

/// A `tokenizer.json`; one that is read codes and decodes.
pub fn tokenizer(data: &[u8]) {
    with_text(data, |text| {
        if let Ok(tokenizer) = Tokenizer::from_json(text) {
            let words = tokenizer.words_of_ids(&[6, 7, 5, 8, 5]).words;
            let _ = tokenizer.decode(&words, UncodedPose::Identity);
        }
    });
}

/// Words as text, of words of one length and of any.
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

/// The TOML of a tokenizer's settings.
pub fn settings(data: &[u8]) {
    with_text(data, |text| {
        if let Ok(settings) = Settings::parse(text, Path::new("tokenizer.toml")) {
            let _ = settings.config();
        }
    });
}

/// A CSV of labels.
pub fn labels(data: &[u8]) {
    let _ = labels::Table::parse(Path::new("labels.csv"), data);
}

/// The TOML of a training.
pub fn train_file(data: &[u8]) {
    with_text(data, |text| drop(TrainFile::parse(text, Path::new("train.toml"))));
}

/// Tensors as safetensors.
pub fn weights(data: &[u8]) {
    let _ = weights::from_bytes(Path::new("model.safetensors"), data);
}

/// Codes of `evaluate baselines --tokens`.
pub fn codes(data: &[u8]) {
    in_folder("codes.npz", data, |folder| drop(CodeSplits::load_npz(&folder.join("codes.npz"), 360, Extent::Sample)));
}

/// What stands beside a dance.
pub fn sidecar(data: &[u8]) {
    in_folder("a.bvh.kinelm.json", data, |folder| {
        drop(Provenance::load(&folder.join("a.bvh.kinelm.json")));
        drop(kinelm::corpus::sidecar::reading_of(&folder.join("a.bvh")));
    });
}

/// The first file that is read of a corpus, an index and a run.
pub fn folders(data: &[u8]) {
    in_folder("corpus.json", data, |folder| drop(Corpus::open(folder)));
    in_folder("index.json", data, |folder| drop(Index::open(folder)));
    in_folder("config.toml", data, |folder| drop(load_run(folder, CheckpointChoice::Auto)));
}

/// A music file, whatever it is of, heard for its beats.
pub fn music(data: &[u8]) {
    in_folder("song", data, |folder| {
        if let Ok(found) = kinelm_music::beat::beats(&folder.join("song")) {
            assert!(found.times_s.windows(2).all(|pair| pair[0] < pair[1]), "beats rise");
            assert!(found.times_s.iter().all(|time| (0.0..=found.seconds).contains(time)), "and are within the music");
        }
    });
}

/// Beats as text.
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

/// Calls `read` with a folder that holds `data` under a name.
fn in_folder(name: &str, data: &[u8], read: impl FnOnce(&Path)) {
    let folder = tempfile::tempdir().expect("a folder for temporary files");
    std::fs::write(folder.path().join(name), data).expect("room for a temporary file");
    read(folder.path());
}
