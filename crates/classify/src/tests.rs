//! Classifiers of a small corpus whose classes show in how characters move.

use super::train::Summary;
use super::*;
use kinelm_corpus::samples::{clip, walk};
use kinelm_corpus::{ClipRecord, Corpus, CorpusWriter, Split};
use kinelm_model::{Architecture, DecoderConfig, LoadedRun, ModelConfig, TokenLayout};
use kinelm_store::{files, random};
use kinelm_tokenizer::{Tokenizer, TokenizerConfig};
use kinelm_train::{TrainConfig, fixture};
use rand_chacha::rand_core::RngCore;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Clips that rise or fall (`way`), in codes that are low or high (`place`); the last of 24 train clips has no `place`.
fn corpus(dir: &Path) -> Corpus {
    let path = dir.join("corpus");
    let tokenizer = Tokenizer::fit([&walk(5)], TokenizerConfig::uniform(&[0], 20.0, 10)).unwrap();
    let mut writer = CorpusWriter::create(&path, &tokenizer, &["made".into()], None, false).unwrap();
    for key in 0..40 {
        let split = [Split::Train, Split::Valid, Split::Test][usize::from(key >= 24) + usize::from(key >= 32)];
        let (up, high) = (key % 2 == 0, key / 2 % 2 == 0);
        let mut rng = random::stream(2, "named", key as u64, 0);
        let frames = 9 + key % 5;
        let mut ids = Vec::new();
        for frame in 0..frames {
            let moved = if up { frame } else { frames - frame };
            for _ in 0..6 {
                let code = (moved + rng.next_u32() as usize % 2) % 5 + if high { 5 } else { 0 };
                ids.push(6 + code as u32);
            }
            ids.push(5);
        }
        let mut new = clip(&format!("clip{key}"), key, split, frames);
        new.record.labels.insert("way".into(), if up { "up" } else { "down" }.into());
        if key != 23 {
            new.record.labels.insert("place".into(), if high { "high" } else { "low" }.into());
        }
        writer.push(new, &ids).unwrap();
    }
    writer.finish().unwrap();
    Corpus::open(&path).unwrap()
}

fn run(dir: &Path) -> LoadedRun {
    let model = ModelConfig { layers: 1, heads: 2, width: 16, context: 60, dropout: 0.1, ..Default::default() };
    let train = TrainConfig { steps: 4, batch: 4, warmup: 1, ..Default::default() };
    fixture::run(dir, model, train)
}

/// The same in two levels.
fn two_levels(dir: &Path) -> LoadedRun {
    let decoder = Some(DecoderConfig { layers: 1, heads: 2, width: 8, character_width: 3 });
    let architecture = Architecture::TwoLevel;
    let model =
        ModelConfig { architecture, layers: 1, heads: 2, width: 16, window: Some(12), decoder, ..Default::default() };
    fixture::run(dir, model, TrainConfig { steps: 4, batch: 4, warmup: 1, ..Default::default() })
}

fn options() -> TrainOptions {
    TrainOptions {
        fields: vec!["way".into(), "place".into()],
        steps: 60,
        batch: 8,
        rate: 3e-3,
        head_rate: 1e-2,
        eval_every: 20,
        ..Default::default()
    }
}

fn trained(
    dir: &Path,
    run: &LoadedRun,
    corpus: &Corpus,
    options: &TrainOptions,
    name: &str,
) -> std::result::Result<Summary, String> {
    let out = dir.join(name);
    train(run, corpus, options, &out, false, &AtomicBool::new(false), &mut |_| ()).map_err(|e| e.to_string())
}

#[test]
fn class_tokens_learn_what_motion_shows_and_load_the_same() {
    for run in [run, two_levels] {
        learns(run);
    }
}

fn learns(run: fn(&Path) -> LoadedRun) {
    let dir = tempfile::tempdir().unwrap();
    let (corpus, run) = (corpus(dir.path()), run(dir.path()));
    let options = TrainOptions { steps: 100, ..options() };
    let done = trained(dir.path(), &run, &corpus, &options, "c").unwrap();
    assert_eq!((done.clips, done.fields.len(), done.stopped), (24, 2, false));
    assert_eq!(done.fields.0[1].classes, ["high", "low"]);
    assert_eq!(done.fields.0[1].clips.iter().sum::<usize>(), 23);
    let mut classifier = Classifier::load(&dir.path().join("c")).unwrap();
    let found = classifier.evaluate(&corpus, Split::Test, Some(&run), true).unwrap();
    assert_eq!((found.clips, found.left_out.as_slice()), ([24, 8], &[0, 0][..]));
    let right = |name: &str, field: &str| {
        found.rows.iter().find(|r| r.name == name && r.field == field).map(|r| r.clips.accuracy).unwrap()
    };
    assert!(right("class tokens", "place") == 1.0, "{found:?}");
    assert!(right("class tokens", "way") >= 0.75, "{found:?}");
    assert!(right("class tokens and LDA", "place") == 1.0, "{found:?}");
    assert!((0.4..=0.6).contains(&right("majority class", "way")));
    // two fields, each by five plain classifiers and by two of its own
    assert_eq!(found.rows.len(), 14);
    let text = found.to_string();
    assert!(
        text.contains("LDA of the model's vectors") && text.contains("place: 2 classes; training clips: high"),
        "{text}"
    );
    // the number of threads changes no byte
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    one.install(|| trained(dir.path(), &run, &corpus, &options, "d")).unwrap();
    let weights = |name: &str| fs::read(dir.path().join(name).join(&classifier.manifest.weights.0)).unwrap();
    assert!(weights("c") == weights("d"));
}

#[test]
fn nothing_has_the_final_name_before_the_end_and_an_interrupted_training_resumes_to_the_same_bytes() {
    for run in [run, two_levels] {
        resumes(run);
    }
}

fn resumes(run: fn(&Path) -> LoadedRun) {
    let dir = tempfile::tempdir().unwrap();
    let (corpus, run) = (corpus(dir.path()), run(dir.path()));
    let options = TrainOptions { steps: 30, eval_every: 8, ..options() };
    trained(dir.path(), &run, &corpus, &options, "straight").unwrap();
    let (out, work) = (dir.path().join("cut"), dir.path().join("cut.training"));
    let go = |options: &TrainOptions, resume: bool, most: u64| {
        let stop = AtomicBool::new(most == 0);
        train(&run, &corpus, options, &out, resume, &stop, &mut |metrics| {
            stop.store(metrics.step >= most, Ordering::Relaxed)
        })
        .map_err(|e| e.to_string())
    };
    assert!(go(&options, true, 99).unwrap_err().contains("leave `resume` out to begin one"));
    // between measurements, in one (which is then made first), and at one
    let calls = (2..=8).map(|step| (true, 0, step));
    for (resume, most, step) in [(false, 0, 1)].into_iter().chain(calls).chain([(true, 0, 8), (true, 16, 16)]) {
        let done = go(&options, resume, most).unwrap();
        assert_eq!((done.step, done.stopped, out.exists()), (step, true, false));
    }
    assert!(go(&options, false, 99).unwrap_err().contains("the same call with `resume` continues it"));
    let other = TrainOptions { rate: 1e-4, ..options.clone() };
    let message = go(&other, true, 99).unwrap_err();
    assert!(message.contains("found rate = 0.0001 requested, expected rate = 0.003, as begun"), "{message}");
    let done = go(&options, true, 99).unwrap();
    assert_eq!((done.step, done.stopped, work.exists()), (30, false, false));
    let files = |name: &str| {
        let entries = fs::read_dir(dir.path().join(name)).unwrap().map(|e| e.unwrap());
        let mut all: Vec<_> = entries.map(|e| (e.file_name(), fs::read(e.path()).unwrap())).collect();
        all.sort();
        all
    };
    let names: Vec<_> = files("cut").into_iter().map(|(name, _)| name).collect();
    assert_eq!(names.len(), 4, "{names:?}");
    assert!(files("cut") == files("straight"));
    assert!(go(&options, true, 99).unwrap_err().contains("is there already"));
}

#[test]
fn a_share_of_the_labels_and_a_filter_choose_the_clips() {
    let dir = tempfile::tempdir().unwrap();
    let (corpus, run) = (corpus(dir.path()), run(dir.path()));
    let few = TrainOptions { share: 0.01, steps: 2, ..options() };
    // one clip of each class
    assert_eq!(trained(dir.path(), &run, &corpus, &few, "few").unwrap().clips, 2);
    let some = |share: f64| {
        let all: Vec<&ClipRecord> = fields::clips(&corpus, &[]).unwrap();
        let fields = Fields::of(&corpus, &all, &options().fields).unwrap();
        super::train::training_clips(&all, &fields, share, 1).iter().map(|c| c.key).collect::<Vec<_>>()
    };
    let (third, half) = (some(0.3), some(0.5));
    // of twelve clips of each class 3.6 and 6
    assert!(third.len() == 8 && half.len() == 12 && third.iter().all(|k| half.contains(k)), "{third:?} {half:?}");
    let only = vec!["place=high".parse::<kinelm_corpus::labels::LabelFilter>().unwrap()];
    let high = TrainOptions { only, fields: vec!["way".into()], steps: 2, scratch: true, ..options() };
    assert_eq!(trained(dir.path(), &run, &corpus, &high, "high").unwrap().clips, 12);
    assert!(Classifier::load(&dir.path().join("high")).unwrap().manifest.from.is_none());
}

#[test]
fn what_cannot_be_learned_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let (corpus, run) = (corpus(dir.path()), run(dir.path()));
    let said = |options: &TrainOptions| trained(dir.path(), &run, &corpus, options, "x").unwrap_err();
    let of = |fields: &[&str]| TrainOptions { fields: fields.iter().map(|f| f.to_string()).collect(), ..options() };
    let message = said(&of(&["mood"]));
    assert!(
        message.contains("no training clip has the label `mood`") && message.contains("they have genre, place, way"),
        "{message}"
    );
    assert!(said(&of(&["way", "way"])).contains("given twice"));
    let message = said(&TrainOptions { only: vec!["way=up".parse().unwrap()], ..of(&["way"]) });
    assert!(message.contains("have one way alone, up"), "{message}");
    assert!(said(&TrainOptions { only: vec!["way=left".parse().unwrap()], ..of(&["way"]) }).contains("no such clip"));
    assert!(said(&TrainOptions { share: 0.0, ..options() }).contains("`share` is 0; expected above 0"));
    assert!(!dir.path().join("x").exists(), "nothing is begun");
    let config = ModelConfig { context: 8, ..run.config.clone() };
    assert!(said_layout(&config, &run.tokens).contains("expected room for a word"));
    let config = ModelConfig { architecture: Architecture::TwoLevel, window: Some(2), ..Default::default() };
    let config = config.resolved(&run.tokens);
    assert!(said_layout(&config, &run.tokens).contains("a window is 2 frames and 2 class rows; expected room"));
    files::write_folder(&dir.path().join("x"), &[("a", Vec::new())]).unwrap();
    assert!(said(&options()).contains("is there already"));
}

fn said_layout(config: &ModelConfig, tokens: &TokenLayout) -> String {
    kinelm_model::class_windows::Layout::new(config, tokens, 2).unwrap_err().to_string()
}

#[test]
fn a_damaged_folder_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let (corpus, run) = (corpus(dir.path()), run(dir.path()));
    trained(dir.path(), &run, &corpus, &TrainOptions { steps: 1, ..options() }, "c").unwrap();
    let folder = dir.path().join("c");
    let about = fs::read_to_string(folder.join("classifier.json")).unwrap();
    let said = || Classifier::load(&folder).map(|_| ()).unwrap_err().to_string();
    fs::write(folder.join("classifier.json"), about.replace("\"schema\": 3", "\"schema\": 9")).unwrap();
    assert!(said().contains("found schema 9, expected schema 3"), "{}", said());
    // weights of another folder, though they are the right ones
    let name = "model-00000001.safetensors";
    fs::copy(folder.join(name), dir.path().join(name)).unwrap();
    for elsewhere in [format!("../{name}"), dir.path().join(name).display().to_string(), format!("../c/{name}")] {
        fs::write(folder.join("classifier.json"), about.replace(name, &elsewhere)).unwrap();
        assert!(said().contains("expected the name of a file in the classifier's folder"), "{}", said());
    }
    fs::write(folder.join("classifier.json"), &about).unwrap();
    let own = fs::read(folder.join("tokenizer.json")).unwrap();
    fixture::foreign_tokenizer().save(folder.join("tokenizer.json")).unwrap();
    assert!(
        said().contains("tokenizer.json: found tokenizer") && said().contains("put back the tokenizer"),
        "{}",
        said()
    );
    fs::write(folder.join("tokenizer.json"), own).unwrap();
    let weights = folder.join("model-00000001.safetensors");
    let bytes = fs::read(&weights).unwrap();
    fs::write(&weights, &bytes[..bytes.len() / 2]).unwrap();
    assert!(said().contains("model-00000001.safetensors"), "{}", said());
    fs::remove_file(folder.join("classifier.json")).unwrap();
    assert!(said().contains("no classifier.json"));
}
