use super::*;
use crate::metrics::StepMetrics;
use crate::{NoProgress, Precision, Schedule, TrainConfig, fixture};
use kinelm_corpus::{Conditions, Corpus, Split};
use kinelm_engine::linear::Products;
use kinelm_model::checkpoint::{CheckpointChoice, Keep};
use kinelm_model::run::{AVERAGED, OPTIMIZER, WEIGHTS, load_run};
use kinelm_model::weights::Array;
use kinelm_model::{Form, ModelConfig, weights};
use kinelm_tokenizer::Tokenizer;
use std::fs;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Sets a flag after some step, and stores the notes.
pub(super) struct StopAt<'a>(pub u64, pub &'a AtomicBool, pub Vec<String>);

impl Progress for StopAt<'_> {
    fn step(&mut self, f: &StepMetrics, _: u64, _: Duration) {
        self.1.store(f.step == self.0, Ordering::Relaxed);
    }
    fn valid(&mut self, _: u64, _: &Likelihood, _: bool) {}
    fn note(&mut self, text: &str) {
        self.2.push(text.into());
    }
}

fn file() -> TrainFile {
    let model = ModelConfig { layers: 2, heads: 2, width: 16, context: 24, dropout: 0.1, ..Default::default() };
    let train = TrainConfig {
        batch: 3,
        steps: 10,
        warmup: 3,
        learning_rate: 1e-2,
        eval_every: 4,
        checkpoint_every: 0,
        keep: Keep::Last(5),
        ..Default::default()
    };
    TrainFile { model, train, ..Default::default() }
}

const CLIPS: [(usize, Split); 3] = [(40, Split::Train), (7, Split::Train), (12, Split::Valid)];

fn options(dir: &Path, run: &str, file: Option<TrainFile>) -> PretrainOptions {
    let (corpora, run) = (vec![CorpusPart::once(dir.join("corpus"))], Some(dir.join(run)));
    PretrainOptions { file, corpora, run, ..Default::default() }
}

fn go(options: &PretrainOptions) -> Result<Summary> {
    pretrain(options, &AtomicBool::new(false), &mut NoProgress)
}

#[test]
fn five_steps_and_five_more_are_ten() {
    resumed(file(), &[WEIGHTS, OPTIMIZER, "state.json"]);
    let mut file = file();
    (file.train.accumulate, file.train.ema) = (2, 0.9);
    resumed(file, &[WEIGHTS, OPTIMIZER, AVERAGED, "state.json"]);
}

/// A run in two halves has the bytes of one in a piece.
fn resumed(file: TrainFile, files: &[&str]) {
    let dir = tempfile::tempdir().unwrap();
    fixture::corpus(dir.path(), &CLIPS);
    let straight = go(&options(dir.path(), "straight", Some(file.clone()))).unwrap();
    let stop = AtomicBool::new(false);
    let mut halves = options(dir.path(), "halves", Some(file.clone()));
    let first = pretrain(&halves, &stop, &mut StopAt(5, &stop, Vec::new())).unwrap();
    assert_eq!((first.step, first.stopped, straight.stopped), (5, true, false));
    let message = go(&halves).unwrap_err().to_string();
    assert!(message.contains("halves exists; resume it"), "{message}");
    halves.resume = true;
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let second = one_thread.install(|| go(&halves)).unwrap();
    assert_eq!((second.step, second.tokens, second.best), (10, straight.tokens, straight.best));
    for name in files {
        let bytes = |s: &Summary| fs::read(s.checkpoint.join(name)).unwrap();
        assert!(bytes(&straight) == bytes(&second), "{name} differs");
    }
    let losses = |run: &str| {
        let text = fs::read_to_string(dir.path().join(run).join("metrics.jsonl")).unwrap();
        let loss = |l: &str| serde_json::from_str::<serde_json::Value>(l).unwrap()["loss"].as_f64();
        text.lines().map(loss).collect::<Vec<_>>()
    };
    assert_eq!(losses("straight"), losses("halves"));
}

#[test]
fn a_run_in_bf16_goes_on_bit_for_bit_and_says_what_computed_it() {
    let mut bf16 = file();
    bf16.train.precision = Precision::Bf16;
    resumed(bf16.clone(), &[WEIGHTS, OPTIMIZER, "state.json"]);

    let dir = tempfile::tempdir().unwrap();
    fixture::corpus(dir.path(), &CLIPS);
    let f32s = go(&options(dir.path(), "f32", Some(file()))).unwrap();
    let stop = AtomicBool::new(false);
    let mut halves = options(dir.path(), "bf16", Some(bf16));
    let first = pretrain(&halves, &stop, &mut StopAt(5, &stop, Vec::new())).unwrap();
    let products = |s: &Summary| load_run(&s.run, CheckpointChoice::Latest).unwrap().state.products;
    let name = Products::bf16().name();
    assert_eq!((products(&first).as_deref(), products(&f32s)), (Some(name), None));

    // another precision is requested by name, and the break is said
    (halves.resume, halves.file, halves.precision) = (true, None, Some(Precision::F32));
    let mut notes = StopAt(100, &stop, Vec::new());
    let second = pretrain(&halves, &AtomicBool::new(false), &mut notes).unwrap();
    let said = notes.2.join("\n");
    assert!(said.contains(&format!("computed by {name} so far, now by f32")), "{said}");
    assert_eq!((products(&second), RunFile::read(&second.run).unwrap().train.precision), (None, Precision::F32));
    let (found, plain) = (second.loss.unwrap(), f32s.loss.unwrap());
    assert!(found != plain && (found - plain).abs() < 0.02 * plain, "{found} nats a token, {plain} in f32 throughout");

    let mut plain = options(dir.path(), "plain", Some(file()));
    (plain.precision, plain.compute.form) = (Some(Precision::Bf16), Form::Plain);
    let message = go(&plain).unwrap_err().to_string();
    assert!(message.contains("f32, which this form computes in") && !dir.path().join("plain").exists(), "{message}");
}

#[test]
fn a_run_goes_on_in_another_form() {
    let dir = tempfile::tempdir().unwrap();
    fixture::corpus(dir.path(), &CLIPS);
    let loss = |run: &str, first: Form, second: Form| {
        let mut options = options(dir.path(), run, Some(file()));
        options.compute.form = first;
        let stop = AtomicBool::new(false);
        pretrain(&options, &stop, &mut StopAt(5, &stop, Vec::new())).unwrap();
        (options.resume, options.compute.form) = (true, second);
        let summary = go(&options).unwrap();
        (summary.loss.unwrap(), summary.valid.unwrap().bits_per_frame)
    };
    // with dropout: both forms drop the same numbers
    let (plain, bits) = loss("plain", Form::Plain, Form::Plain);
    for (run, first, second) in [("there", Form::Plain, Form::Auto), ("back", Form::Auto, Form::Plain)] {
        let (found, found_bits) = loss(run, first, second);
        assert!((found - plain).abs() < 1e-4, "{run}: {found}, in one form {plain}");
        assert!((found_bits - bits).abs() < 1e-2, "{run}: {found_bits} bits a frame, in one form {bits}");
    }
}

#[test]
fn a_damaged_checkpoint_is_passed_over_and_loading_takes_the_best() {
    let dir = tempfile::tempdir().unwrap();
    fixture::corpus(dir.path(), &CLIPS);
    let mut options = options(dir.path(), "run", Some(file()));
    let straight = go(&options).unwrap();
    let run = dir.path().join("run");
    let whole = fs::read(straight.checkpoint.join(WEIGHTS)).unwrap();
    fs::write(straight.checkpoint.join(WEIGHTS), &whole[..whole.len() / 2]).unwrap();
    options.resume = true;
    let stop = AtomicBool::new(false);
    let mut progress = StopAt(99, &stop, Vec::new());
    let again = pretrain(&options, &stop, &mut progress).unwrap();
    assert!(
        progress.2.iter().any(|n| n.contains("model.safetensors: found") && n.contains("step 8")),
        "{:?}",
        progress.2
    );
    assert!(fs::read(again.checkpoint.join(WEIGHTS)).unwrap() == whole);
    let best = load_run(&run, CheckpointChoice::Auto).unwrap();
    assert_eq!(best.state.step, again.best.unwrap().step);
    assert_eq!(load_run(&run, CheckpointChoice::Latest).unwrap().state.step, 10);
    assert!(load_run(&run, CheckpointChoice::Step(3)).is_err());
    assert!(load_run(dir.path(), CheckpointChoice::Auto).err().unwrap().to_string().contains("no config.toml"));
    for name in ["tokenizer.json", "corpus.json", "config.toml", "samples", "latest", "best"] {
        assert!(run.join(name).exists(), "{name}");
    }
}

#[test]
fn a_corpus_without_validation_clips_trains_and_says_so() {
    let dir = tempfile::tempdir().unwrap();
    fixture::corpus(dir.path(), &CLIPS[..2]);
    let stop = AtomicBool::new(false);
    let mut progress = StopAt(99, &stop, Vec::new());
    let mut file = file();
    file.train.checkpoint_every = 3;
    file.train.keep = Keep::Last(1);
    let summary = pretrain(&options(dir.path(), "run", Some(file)), &stop, &mut progress).unwrap();
    assert!(progress.2[0].contains("no validation clip"));
    assert_eq!((summary.step, summary.valid, summary.best), (10, None, None));
    assert_eq!(load_run(&dir.path().join("run"), CheckpointChoice::Auto).unwrap().state.step, 10);
    assert_eq!(Checkpoints::of(&dir.path().join("run")).steps().unwrap(), [10]);
}

#[test]
fn another_corpus_seed_or_configuration_is_no_resume() {
    let dir = tempfile::tempdir().unwrap();
    fixture::corpus(dir.path(), &CLIPS);
    let mut options = options(dir.path(), "run", Some(file()));
    (options.steps, options.seed) = (Some(1), Some(4));
    go(&options).unwrap();
    options.resume = true;
    let said = |change: &dyn Fn(&mut PretrainOptions)| {
        let mut options = options.clone();
        change(&mut options);
        go(&options).map(|s| s.step).map_err(|e| e.to_string())
    };
    assert!(said(&|o| o.seed = Some(5)).unwrap_err().contains("another configuration"));
    assert!(
        said(&|o| (o.seed, o.file) = (Some(5), None))
            .unwrap_err()
            .contains("`seed` is 5; expected 4, which the run was begun with")
    );
    assert!(said(&|o| o.file.as_mut().unwrap().model.width = 8).unwrap_err().contains("another configuration"));
    assert!(said(&|o| o.run = Some(dir.path().join("none"))).unwrap_err().contains("no config.toml"));
    let held = RunFolder::open(&dir.path().join("run")).unwrap();
    assert!(said(&|_| ()).unwrap_err().contains("another process"));
    drop(held);
    assert_eq!(said(&|_| ()), Ok(1));
    assert_eq!(said(&|o| (o.file, o.steps) = (None, Some(2))), Ok(2));
    assert!(said(&|o| (o.file, o.steps) = (None, Some(1))).unwrap_err().contains("the run has done 2"));
    let elsewhere = dir.path().join("other");
    fs::create_dir(&elsewhere).unwrap();
    let other = fixture::corpus(&elsewhere, &CLIPS[..2]);
    assert!(said(&|o| o.corpora = vec![CorpusPart::once(other.dir())]).unwrap_err().contains("begin a new run"));
}

#[test]
fn a_run_whose_checkpoints_are_lost_is_not_begun_again() {
    let dir = tempfile::tempdir().unwrap();
    fixture::corpus(dir.path(), &CLIPS);
    let mut options = options(dir.path(), "run", Some(file()));
    options.steps = Some(1);
    go(&options).unwrap();
    for entry in fs::read_dir(dir.path().join("run/checkpoints")).unwrap() {
        fs::remove_dir_all(entry.unwrap().path()).unwrap();
    }
    options.resume = true;
    let message = go(&options).unwrap_err().to_string();
    assert!(message.contains("no checkpoint, though `latest` names that of step 1"), "{message}");
}

#[test]
fn a_rate_that_blows_up_stops_with_step_and_clips() {
    let dir = tempfile::tempdir().unwrap();
    fixture::corpus(dir.path(), &CLIPS);
    let mut file = file();
    file.train.learning_rate = 1e30;
    (file.train.warmup, file.train.schedule, file.train.eval_every) = (0, Schedule::Constant, 0);
    let message = go(&options(dir.path(), "run", Some(file))).unwrap_err().to_string();
    assert!(message.starts_with("step 2: the ") && message.contains("clip0 from frame"), "{message}");
}

#[test]
fn weights_to_begin_with_are_the_first_checkpoint() {
    let dir = tempfile::tempdir().unwrap();
    let data = Data::one(fixture::corpus(dir.path(), &CLIPS)).unwrap();
    let TrainFile { model, train, .. } = file();
    let run_file = RunFile::new(&model, &train, &data).unwrap();
    // the weights of another seed, so that they aren't those that the run would begin with
    let weights = || weights::initial(&model, &run_file.tokens, 77);
    let go = |run: &Path, weights| {
        let folder = begin(run, &run_file, &data, weights)?;
        continue_run(&folder, run_file.clone(), &data, Compute::default(), &AtomicBool::new(false), &mut NoProgress)
    };
    let run = dir.path().join("with");
    let with = go(&run, Some(weights())).unwrap();
    let without = go(&dir.path().join("without"), None).unwrap();
    assert_ne!(with.loss, without.loss);
    assert_eq!(with.step, 10);
    // killed before its first own checkpoint it still has them
    let cut = dir.path().join("cut");
    drop(begin(&cut, &run_file, &data, Some(weights())).unwrap());
    let options = PretrainOptions { run: Some(cut), resume: true, ..Default::default() };
    assert_eq!(pretrain(&options, &AtomicBool::new(false), &mut NoProgress).unwrap().loss, with.loss);
    // what doesn't fit leaves no folder
    let said = |change: &dyn Fn(&mut Weights)| {
        let mut weights = weights();
        change(&mut weights);
        let none = dir.path().join("none");
        let message = begin(&none, &run_file, &data, Some(weights)).unwrap_err().to_string();
        assert!(!none.exists());
        message
    };
    let one = || Array::full(&[16], f32::NAN);
    assert!(said(&|w| drop(w.remove("norm.bias"))).contains("no norm.bias of shape [16]"));
    assert!(said(&|w| drop(w.insert("norm.bias".into(), one()))).contains("would hold NaN in norm.bias"));
    assert!(said(&|w| drop(w.insert("more".into(), one()))).contains("no place for the tensor more"));
    assert!(said(&|w| drop(w.insert("token.weight".into(), one()))).contains("no token.weight of shape"));
}

#[test]
fn batches_that_are_accumulated_are_one_batch() {
    let dir = tempfile::tempdir().unwrap();
    // of the short clip's windows fewer targets count
    fixture::corpus(dir.path(), &[(40, Split::Train), (2, Split::Train), (1, Split::Train), (12, Split::Valid)]);
    let run = |name: &str, batch: usize, accumulate: usize, form: Form| {
        let mut file = file();
        (file.train.batch, file.train.accumulate) = (batch, accumulate);
        let mut options = options(dir.path(), name, Some(file));
        options.compute.form = form;
        let summary = go(&options).unwrap();
        (summary.loss.unwrap(), summary.valid.unwrap().bits_per_frame, summary.tokens)
    };
    let (loss, bits, tokens) = run("one", 6, 1, Form::Auto);
    for (batch, accumulate, form) in [(3, 2, Form::Auto), (1, 6, Form::Auto), (2, 3, Form::Plain)] {
        let (found, found_bits, counted) = run(&format!("{batch}"), batch, accumulate, form);
        assert!((found - loss).abs() < 1e-4, "{batch} x {accumulate}: {found}, at once {loss}");
        assert!((found_bits - bits).abs() < 1e-2, "{batch} x {accumulate}: {found_bits}, at once {bits}");
        assert_eq!(counted, tokens);
    }
}

#[test]
fn the_average_is_what_is_measured_and_loaded() {
    let dir = tempfile::tempdir().unwrap();
    fixture::corpus(dir.path(), &CLIPS);
    let run = |name: &str, ema: f64, form: Form| {
        let mut file = file();
        file.train.ema = ema;
        let mut options = options(dir.path(), name, Some(file));
        options.compute.form = form;
        go(&options).unwrap()
    };
    let (plain, with) = (run("without", 0.0, Form::Auto), run("with", 0.8, Form::Auto));
    assert_eq!(plain.loss, with.loss, "the weights go their own way");
    assert!(fs::read(plain.checkpoint.join(WEIGHTS)).unwrap() == fs::read(with.checkpoint.join(WEIGHTS)).unwrap());
    assert!(!plain.checkpoint.join(AVERAGED).exists());
    let bits = with.valid.unwrap().bits_per_frame;
    assert_ne!(plain.valid.unwrap().bits_per_frame, bits);
    let other = run("plain", 0.8, Form::Plain).valid.unwrap().bits_per_frame;
    assert!((other - bits).abs() < 1e-2, "{other}, in the other form {bits}");
    let loaded = load_run(&with.run, CheckpointChoice::Latest).unwrap();
    let saved = fs::read(with.checkpoint.join(AVERAGED)).unwrap();
    assert!(weights::to_bytes(&loaded.weights).unwrap() == saved);
    let corpus = Corpus::open(dir.path().join("corpus")).unwrap();
    let clips: Vec<_> = corpus.split(Split::Valid).collect();
    let mut scores = loaded.scores(Compute::default()).unwrap();
    let found =
        kinelm_model::likelihood::likelihood(&mut *scores, &corpus, &clips, 0, &Conditions::none()).unwrap().unwrap();
    assert_eq!(found.bits_per_frame, bits);
}

#[test]
fn the_average_before_the_first_step_is_the_weights() {
    let dir = tempfile::tempdir().unwrap();
    fixture::corpus(dir.path(), &CLIPS);
    let mut file = file();
    (file.train.ema, file.train.steps) = (0.9, 0);
    for form in [Form::Auto, Form::Plain] {
        let mut options = options(dir.path(), &format!("{form:?}"), Some(file.clone()));
        options.compute.form = form;
        let checkpoint = go(&options).unwrap().checkpoint;
        assert!(fs::read(checkpoint.join(WEIGHTS)).unwrap() == fs::read(checkpoint.join(AVERAGED)).unwrap());
    }
}

#[test]
fn a_run_that_gets_no_better_ends_and_stays_ended() {
    let dir = tempfile::tempdir().unwrap();
    fixture::corpus(dir.path(), &CLIPS);
    let mut file = file();
    file.train = TrainConfig { steps: 60, eval_every: 2, patience: 3, learning_rate: 0.7, warmup: 0, ..file.train };
    let mut options = options(dir.path(), "run", Some(file));
    let summary = go(&options).unwrap();
    let best = summary.best.unwrap();
    assert!(summary.early && !summary.stopped && summary.step < 60, "{summary:?}");
    assert_eq!(summary.step, best.step + 6);
    assert!(summary.valid.unwrap().bits_per_frame > best.measured.value());
    assert_eq!(load_run(&summary.run, CheckpointChoice::Auto).unwrap().state.step, best.step);
    options.resume = true;
    let again = go(&options).unwrap();
    assert!(again.early && again.loss.is_none() && again.step == summary.step, "{again:?}");
}

#[test]
fn a_run_with_conditions_has_its_labels_in_its_vocabulary_and_resumes() {
    let dir = tempfile::tempdir().unwrap();
    let corpus = fixture::corpus(dir.path(), &CLIPS);
    let mut file = file();
    (file.train.conditions, file.train.label_dropout) = (vec!["dancer".into(), "genre".into()], 0.5);
    let straight = go(&options(dir.path(), "straight", Some(file.clone()))).unwrap();
    let stop = AtomicBool::new(false);
    let mut halves = options(dir.path(), "halves", Some(file.clone()));
    pretrain(&halves, &stop, &mut StopAt(5, &stop, Vec::new())).unwrap();
    halves.resume = true;
    let second = go(&halves).unwrap();
    let bytes = |s: &Summary| fs::read(s.checkpoint.join(WEIGHTS)).unwrap();
    assert!(bytes(&straight) == bytes(&second));
    let run = load_run(&dir.path().join("straight"), CheckpointChoice::Auto).unwrap();
    assert_eq!((run.conditions.as_slice(), run.tokens.front), (&["genre", "dancer"].map(String::from)[..], 3));
    let tokenizer = Tokenizer::load(&run.tokenizer).unwrap();
    assert_eq!(tokenizer.base_hash(), corpus.tokenizer().hash());
    assert_eq!(run.tokens.vocabulary, fixture::TOKENS.vocabulary + 3);
    assert_eq!(run.load_conditions().unwrap().values("genre"), ["a", "b"]);
    file.train.conditions.push("mood".into());
    let message = go(&options(dir.path(), "none", Some(file))).unwrap_err().to_string();
    assert!(
        message.contains("no training clip has the label `mood` of train.conditions; the clips have dancer, genre"),
        "{message}"
    );
    assert!(!dir.path().join("none").exists());
    corpus.tokenizer().save(&run.tokenizer).unwrap();
    assert!(run.load_conditions().unwrap_err().to_string().contains("put back the tokenizer.json"));
    halves.run = Some(dir.path().join("straight"));
    assert!(go(&halves).unwrap_err().to_string().contains("put back the tokenizer.json"));
}

#[test]
fn a_foreign_tokenizer_of_the_same_shape_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    fixture::corpus(dir.path(), &CLIPS);
    let train = TrainConfig { steps: 1, batch: 2, warmup: 1, ..Default::default() };
    let run = fixture::run(dir.path(), file().model, train);
    let own = run.load_tokenizer().unwrap();
    let foreign = fixture::foreign_tokenizer();
    assert_eq!(kinelm_model::TokenLayout::of(&foreign), kinelm_model::TokenLayout::of(&own));
    foreign.save(&run.tokenizer).unwrap();
    let refused = |message: String| {
        let hashes = message.contains(&own.hash()) && message.contains(&foreign.hash());
        assert!(hashes && message.contains("tokenizer.json: found tokenizer"), "{message}");
    };
    refused(run.load_tokenizer().unwrap_err().to_string());
    refused(run.load_conditions().unwrap_err().to_string());
    let form = kinelm_model::exchange::Format::Kinelm;
    refused(kinelm_model::exchange::export(&run, form, &dir.path().join("out")).unwrap_err().to_string());
    let again = PretrainOptions { resume: true, run: Some(dir.path().join("run")), ..Default::default() };
    refused(go(&again).unwrap_err().to_string());
}

#[test]
fn a_run_on_two_corpora_resumes_and_keeps_their_weights() {
    let dir = tempfile::tempdir().unwrap();
    let parts = [("a", 1.0), ("b", 2.5)].map(|(name, weight)| {
        let place = dir.path().join(name);
        fs::create_dir(&place).unwrap();
        CorpusPart { path: fixture::corpus(&place, &CLIPS).dir().into(), weight }
    });
    let mut straight = options(dir.path(), "straight", Some(file()));
    straight.corpora = parts.to_vec();
    let whole = go(&straight).unwrap();
    let stop = AtomicBool::new(false);
    let mut halves = PretrainOptions { run: Some(dir.path().join("halves")), ..straight };
    pretrain(&halves, &stop, &mut StopAt(7, &stop, Vec::new())).unwrap();
    (halves.resume, halves.corpora) = (true, Vec::new());
    let again = go(&halves).unwrap();
    let bytes = |s: &Summary| fs::read(s.checkpoint.join(WEIGHTS)).unwrap();
    assert!(bytes(&whole) == bytes(&again));
    assert_eq!(whole.valid.unwrap().frames, 24);
    assert!(dir.path().join("halves/corpus-2.json").is_file());
    halves.corpora = parts[..1].to_vec();
    let message = go(&halves).unwrap_err().to_string();
    assert_eq!(message, "`corpora` is of the weights 1; expected the weights 1, 2.5, as the run was begun");
    halves.corpora = parts.iter().rev().map(|p| CorpusPart { weight: 3.5 - p.weight, ..p.clone() }).collect();
    // the same clips, so the same hash
    go(&halves).unwrap();
}

#[test]
fn a_run_begins_with_the_weights_of_another() {
    let dir = tempfile::tempdir().unwrap();
    fixture::corpus(dir.path(), &CLIPS);
    let mut first = file();
    first.train.ema = 0.5;
    let other = go(&options(dir.path(), "first", Some(first))).unwrap();
    let mut further = options(dir.path(), "second", Some(file()));
    further.from = Some(other.run.clone());
    further.steps = Some(2);
    let stop = AtomicBool::new(true);
    let begun = pretrain(&further, &stop, &mut NoProgress).unwrap();
    assert_eq!((begun.step, begun.stopped), (0, true));
    let own = load_run(&begun.run, CheckpointChoice::Latest).unwrap();
    let theirs = load_run(&other.run, CheckpointChoice::Auto).unwrap();
    let bytes = |run: &kinelm_model::LoadedRun| weights::to_bytes(&run.weights);
    assert!(bytes(&own).unwrap() == bytes(&theirs).unwrap(), "the average of the first run's weights");
    let origin = RunFile::read(&begun.run).unwrap().from.unwrap();
    assert_eq!(origin.step, theirs.state.step);
    assert!(origin.path.ends_with("first"));
    // gone on with, it needs the first no more
    fs::remove_dir_all(&other.run).unwrap();
    further.resume = true;
    (further.file, further.from) = (None, None);
    let resumed = go(&further).unwrap();
    assert_eq!(resumed.step, 2);
    assert!(resumed.loss.unwrap() < 2.7, "{:?}: it knows something already", resumed.loss);
    let said = |change: &dyn Fn(&mut PretrainOptions)| {
        let mut options = options(dir.path(), "third", Some(file()));
        options.from = Some(resumed.run.clone());
        change(&mut options);
        let message = go(&options).unwrap_err().to_string();
        assert!(!dir.path().join("third").exists());
        message
    };
    let message = said(&|o| o.file.as_mut().unwrap().model.layers = 1);
    assert!(message.contains("model.layers is 1; expected 2, as in the weights of"), "{message}");
    assert!(said(&|o| o.from = Some(dir.path().join("none"))).contains("none"));
}

#[test]
fn a_run_goes_on_from_an_earlier_checkpoint_as_a_new_one() {
    let dir = tempfile::tempdir().unwrap();
    fixture::corpus(dir.path(), &CLIPS);
    let mut own = file();
    (own.train.keep, own.train.checkpoint_every, own.train.ema) = (Keep::All, 3, 0.5);
    let whole = go(&options(dir.path(), "whole", Some(own))).unwrap();
    let all = Checkpoints::of(&whole.run).steps().unwrap();
    assert!([3, 6, 9, 10].iter().all(|step| all.contains(step)), "{all:?}");
    let branched = |name: &str, step, set: &[&str]| PretrainOptions {
        run: Some(whole.run.clone()),
        branch: Some(Branch { step, run: dir.path().join(name) }),
        set: set.iter().map(|pair| pair.to_string()).collect(),
        ..Default::default()
    };
    let bytes = |s: &Summary, name| fs::read(s.checkpoint.join(name)).unwrap();
    let same = go(&branched("same", 6, &[])).unwrap();
    for name in [WEIGHTS, OPTIMIZER, AVERAGED, "state.json"] {
        assert!(bytes(&same, name) == bytes(&whole, name), "{name}");
    }
    let metrics = |run: &Path| fs::read_to_string(run.join("metrics.jsonl")).unwrap().lines().count();
    assert_eq!(metrics(&same.run), metrics(&whole.run));
    let slower = go(&branched("slower", 6, &["train.learning_rate=1e-3", "train.steps=8"])).unwrap();
    assert!(
        slower.step == 8
            && bytes(&slower, WEIGHTS)
                != fs::read(Checkpoints::of(&whole.run).path(8).join(WEIGHTS)).unwrap_or_default()
    );
    let made = RunFile::read(&slower.run).unwrap();
    let origin = made.from.unwrap();
    assert_eq!((&origin.path, origin.step, made.train.learning_rate), (&whole.run, 6, 1e-3));
    assert_eq!(RunFile::read(&whole.run).unwrap().from, None, "the parent stays as it is");
    // nothing is left of what is refused
    for (step, set, says) in [
        (5, &[][..], "no checkpoint of step 5, expected one of step 5; there are "),
        (6, &["train.steps=5"], "`steps` is 5; expected 6 or more"),
        (6, &["model.width=32"], "`set` model.width:"),
    ] {
        let message = go(&branched("none", step, set)).unwrap_err().to_string();
        assert!(message.contains(says), "{message}");
        assert!(!dir.path().join("none").exists());
    }
    assert!(go(&branched("same", 6, &[])).unwrap_err().to_string().contains("same exists; resume it"));
    // the branch needs its parent no more, and can be resumed
    fs::remove_dir_all(&whole.run).unwrap();
    let resumed = PretrainOptions { run: Some(slower.run), resume: true, steps: Some(9), ..Default::default() };
    assert_eq!(go(&resumed).unwrap().step, 9);
}
