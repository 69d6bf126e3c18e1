//! Training that begins with another model's weights, and may add labels to its language.

use super::config::TrainFile;
use super::data::{CorpusPart, Data};
use super::grow::{Language, grow};
use super::precision::Precision;
use super::pretrain::{Summary, begin, go_on};
use super::progress::Progress;
use super::run::{RunFile, origin};
use crate::{Error, Result};
use kinelm_corpus::Opening;
use kinelm_corpus::conditions::in_order;
use kinelm_model::{Compute, LoadedRun, ModelConfig, TokenLayout, exchange};
use kinelm_store::{input, presets};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// What to go on from, with what, and where to.
#[derive(Debug, Clone)]
pub struct FinetuneOptions {
    /// A run, of which its best checkpoint counts, or a folder that `kinelm export` or `transformers` wrote.
    pub from: PathBuf,
    /// The training TOML. The model's shape is the source's: keys of `[model]` that are given must agree, but
    /// dropout and `ahead`, which may be added.
    pub config: PathBuf,
    /// The corpora, over those in the file.
    pub corpora: Vec<CorpusPart>,
    /// The run folder, over the one in the file.
    pub run: Option<PathBuf>,
    /// Steps in all, over the file's.
    pub steps: Option<u64>,
    /// The seed, over the file's.
    pub seed: Option<u64>,
    /// Label fields that the model is conditioned on beside the source's, over the file's.
    pub conditions: Option<Vec<String>>,
    /// In which numbers products are computed, over the file's.
    pub precision: Option<Precision>,
    /// Where and how to compute.
    pub compute: Compute,
    /// How the corpora are opened.
    pub opening: Opening,
}

/// Trains a new run from another's weights. The optimizer begins anew.
///
/// The run's vocabulary is the source's with the labels of the training clips, for the fields that the source is told of
/// and those of `train.conditions`; see [`grow`] for what becomes of its tables. To go on with such a run, see
/// [`pretrain`](fn@super::pretrain) with `resume`.
///
/// # Errors
/// A source that is none, or damaged; keys of `[model]` that differ from the source's; a corpus of another tokenizer;
/// those of [`begin`] and [`go_on`].
pub fn finetune(options: &FinetuneOptions, stop: &AtomicBool, progress: &mut dyn Progress) -> Result<Summary> {
    // a device that isn't there must not leave an empty run behind
    options.compute.device.open()?;
    let file = TrainFile::find(&options.config)?;
    let run = options.run.clone().or_else(|| file.run.clone());
    let run = run.ok_or_else(|| Error::call("no run folder; give one by --run or in the training file"))?;
    let source = exchange::load(&options.from)?;
    source.notes.iter().for_each(|note| progress.note(note));
    let model = shape(&options.config, &file, &source)?;
    let corpora = if options.corpora.is_empty() { file.corpora()? } else { options.corpora.clone() };
    let asked = options.conditions.as_ref().unwrap_or(&file.train.conditions);
    let fields = in_order(&[source.conditions.as_slice(), asked].concat());
    let tokenizer = source.load_tokenizer()?;
    let data = Data::open(&corpora, Some(&tokenizer), &fields, options.opening).map_err(|e| file.named(e))?;
    let mut train = file.train.clone();
    train.conditions = fields;
    train.steps = options.steps.unwrap_or(train.steps);
    train.seed = options.seed.unwrap_or(train.seed);
    train.precision = options.precision.unwrap_or(train.precision);
    train.precision.choose(None, options.compute)?;
    let new = RunFile::new(&model, &train, &data).map_err(|e| file.named(e))?;
    let new = RunFile { augment: file.augment, from: Some(origin(&options.from, &source)?), ..new };
    let (was, is) = (&source.tokens, &new.tokens);
    let old = Language { tokens: was, conditions: &source.conditions };
    let language = Language { tokens: is, conditions: &train.conditions };
    let grown = grow(&source.weights, &new.model, old, language, train.seed)?;
    progress.note(&learnt(was, is));
    let folder = begin(&run, &new, &data, Some(grown))?;
    go_on(&folder, new, &data, options.compute, stop, progress)
}

/// The source's shape, with the dropout that the file gives, and told what is ahead, and music, if the file says so.
fn shape(path: &Path, file: &TrainFile, source: &LoadedRun) -> Result<ModelConfig> {
    let goal = file.model.goal || source.config.goal;
    let music = if source.config.music.is_none() { file.model.music } else { source.config.music };
    let own = ModelConfig { dropout: 0.0, ..source.config.resolved(&source.tokens) };
    let table = |what: &dyn Fn() -> String| Error::call(format!("{}: {}", path.display(), what()));
    let text = match presets::find(crate::config::TRAIN, path, "training file")? {
        Some(text) => text.to_owned(),
        None => input::text(path).map_err(Error::io(path))?,
    };
    let all: toml::Table = toml::from_str(&text).map_err(|e| table(&|| e.message().into()))?;
    let given = all.get("model").and_then(toml::Value::as_table).cloned().unwrap_or_default();
    let has = toml::Table::try_from(&own).map_err(|e| table(&|| e.to_string()))?;
    // a model may learn to be told what is ahead, or music, and can't unlearn it
    let may_differ = |key: &str| match key {
        "goal" => !source.config.goal,
        "music" => source.config.music.is_none(),
        key => key == "dropout",
    };
    for (key, value) in given.iter().filter(|(key, _)| !may_differ(key)) {
        if has.get(key) != Some(value) {
            let own = has.get(key).map_or("nothing".into(), |own| own.to_string());
            let help = "leave [model] out: the shape is that of the weights";
            return Err(table(&|| format!("model.{key} is {value}; the source has {own}; {help}")));
        }
    }
    let dropout = if given.contains_key("dropout") { file.model.dropout } else { source.config.dropout };
    Ok(ModelConfig { dropout, goal, music, ..own })
}

fn learnt(was: &TokenLayout, is: &TokenLayout) -> String {
    let (ids, fields) = (is.vocabulary - was.vocabulary, is.front - was.front);
    match (ids, fields) {
        (0, 0) => "the model's language stays as it is".into(),
        _ => format!("the model gets {ids} more ids and {fields} more label fields"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::StepFigures;
    use crate::{PretrainOptions, Silent, fixture, pretrain};
    use kinelm_corpus::{Corpus, Split};
    use kinelm_model::CheckpointChoice;
    use kinelm_model::likelihood::Likelihood;
    use kinelm_model::run::{WEIGHTS, load_run};
    use std::fs;
    use std::sync::atomic::Ordering;
    use std::time::Duration;

    const SOURCE: &str = "[model]\nlayers = 2\nheads = 2\nwidth = 16\ncontext = 24\n[train]\nbatch = 3\nsteps = 6\n\
                          warmup = 2\nlearning_rate = 1e-2\neval_every = 3\nconditions = [\"genre\"]\n";
    const CONFIG: &str = "[model]\nwidth = 16\ndropout = 0.1\n[train]\nbatch = 3\nsteps = 8\nwarmup = 2\n\
                          learning_rate = 1e-3\neval_every = 4\nkeep = 9\nconditions = [\"dancer\"]\nlabel_dropout = 0.3\n\
                          [augment]\nmirror = 0.5\nspeed = 0.1\n";

    struct StopAt<'a>(u64, &'a AtomicBool);

    impl Progress for StopAt<'_> {
        fn step(&mut self, f: &StepFigures, _: u64, _: Duration) {
            self.1.store(f.step == self.0, Ordering::Relaxed);
        }
        fn valid(&mut self, _: u64, _: &Likelihood, _: bool) {}
        fn note(&mut self, _: &str) {}
    }

    /// A run `source`, and the file of a run that goes on from it.
    fn setup(dir: &Path) -> (Corpus, FinetuneOptions) {
        let corpus = fixture::corpus(dir, &[(40, Split::Train), (9, Split::Train), (12, Split::Valid)]);
        fs::write(dir.join("source.toml"), SOURCE).unwrap();
        fs::write(dir.join("config.toml"), CONFIG).unwrap();
        let options = PretrainOptions {
            file: Some(TrainFile::load(&dir.join("source.toml")).unwrap()),
            corpora: vec![CorpusPart::once(corpus.dir())],
            run: Some(dir.join("source")),
            ..Default::default()
        };
        pretrain(&options, &AtomicBool::new(false), &mut Silent).unwrap();
        let options = FinetuneOptions {
            conditions: None,
            precision: None,
            from: dir.join("source"),
            config: dir.join("config.toml"),
            corpora: vec![CorpusPart::once(corpus.dir())],
            run: Some(dir.join("run")),
            steps: None,
            seed: None,
            compute: Compute::default(),
            opening: Opening::default(),
        };
        (corpus, options)
    }

    #[test]
    fn a_run_goes_on_from_anothers_weights_learns_labels_and_resumes_bit_for_bit() {
        let dir = tempfile::tempdir().unwrap();
        let (_corpus, options) = setup(dir.path());
        let whole = finetune(&options, &AtomicBool::new(false), &mut Silent).unwrap();
        let stop = AtomicBool::new(false);
        let halves = FinetuneOptions { run: Some(dir.path().join("halves")), ..options.clone() };
        let first = finetune(&halves, &stop, &mut StopAt(3, &stop)).unwrap();
        assert_eq!((first.step, first.stopped), (3, true));
        let resume = PretrainOptions { run: halves.run, resume: true, ..Default::default() };
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let second = one.install(|| pretrain(&resume, &AtomicBool::new(false), &mut Silent)).unwrap();
        // with dropout, hidden labels, mirrors and speeds
        let bytes = |s: &Summary| fs::read(s.checkpoint.join(WEIGHTS)).unwrap();
        assert!(bytes(&whole) == bytes(&second));
        let (source, run) = (
            load_run(&options.from, CheckpointChoice::Auto).unwrap(),
            load_run(&whole.run, CheckpointChoice::Auto).unwrap(),
        );
        assert_eq!((run.conditions.as_slice(), run.config.dropout), (&["genre", "dancer"].map(String::from)[..], 0.1));
        assert_eq!((source.tokens.vocabulary, run.tokens.vocabulary, run.tokens.front), (18, 19, 3));
        let begun = load_run(&whole.run, CheckpointChoice::Step(0)).unwrap();
        let rows = |run: &LoadedRun, name: &str| run.weights[name].to_vec2::<f32>().unwrap();
        assert_eq!(rows(&begun, "token.weight")[..18], rows(&source, "token.weight")[..]);
        assert_eq!(rows(&begun, "position.front.weight")[..2], rows(&source, "position.front.weight")[..]);
        let file = RunFile::read(&whole.run).unwrap();
        let named = file.from.unwrap();
        assert_eq!((named.path, named.step), (std::path::absolute(&options.from).unwrap(), source.state.step));
        assert_eq!(named.sha256, source.state.files[WEIGHTS].sha256);
    }

    #[test]
    fn a_run_learns_to_be_told_what_is_ahead_from_where_it_was_and_resumes_bit_for_bit() {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::turning(dir.path(), &[(90, Split::Train), (60, Split::Valid)]);
        let levels = "[model]\narchitecture = \"two_level\"\n";
        let model = "layers = 1\nheads = 2\nwidth = 16\nwindow = 20\n";
        let train = "[train]\nbatch = 3\nsteps = 6\nwarmup = 2\nlearning_rate = 1e-2\neval_every = 3\nkeep = 9\n";
        fs::write(dir.path().join("source.toml"), format!("{levels}{model}{train}")).unwrap();
        fs::write(dir.path().join("config.toml"), format!("{levels}goal = true\n{train}gaps = 0.5\n")).unwrap();
        let source = PretrainOptions {
            file: Some(TrainFile::load(&dir.path().join("source.toml")).unwrap()),
            corpora: vec![CorpusPart::once(corpus.dir())],
            run: Some(dir.path().join("source")),
            ..Default::default()
        };
        pretrain(&source, &AtomicBool::new(false), &mut Silent).unwrap();
        let options = FinetuneOptions {
            conditions: None,
            precision: None,
            from: dir.path().join("source"),
            config: dir.path().join("config.toml"),
            corpora: vec![CorpusPart::once(corpus.dir())],
            run: Some(dir.path().join("run")),
            steps: None,
            seed: None,
            compute: Compute::default(),
            opening: Opening::default(),
        };
        let whole = finetune(&options, &AtomicBool::new(false), &mut Silent).unwrap();
        let stop = AtomicBool::new(false);
        let halves = FinetuneOptions { run: Some(dir.path().join("halves")), ..options.clone() };
        finetune(&halves, &stop, &mut StopAt(3, &stop)).unwrap();
        let resume = PretrainOptions { run: halves.run, resume: true, ..Default::default() };
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let second = one.install(|| pretrain(&resume, &AtomicBool::new(false), &mut Silent)).unwrap();
        let bytes = |s: &Summary| fs::read(s.checkpoint.join(WEIGHTS)).unwrap();
        assert!(bytes(&whole) == bytes(&second));
        let begun = load_run(&whole.run, CheckpointChoice::Step(0)).unwrap();
        let was = load_run(&options.from, CheckpointChoice::Auto).unwrap();
        assert!(begun.config.goal && !was.config.goal);
        let numbers = |run: &LoadedRun, name: &str| run.weights[name].flatten_all().unwrap().to_vec1::<f32>().unwrap();
        for name in was.weights.keys() {
            assert!(numbers(&begun, name) == numbers(&was, name), "{name}");
        }
        let learned = load_run(&whole.run, CheckpointChoice::Step(6)).unwrap();
        for name in kinelm_model::layout::GOAL {
            assert!(numbers(&begun, name).iter().all(|x| *x == 0.0), "{name}");
            assert!(numbers(&learned, name).iter().any(|x| *x != 0.0), "{name}");
        }
        // and on from there, which can't be unlearned
        let again = FinetuneOptions { from: dir.path().join("run"), run: Some(dir.path().join("again")), ..options };
        finetune(&again, &AtomicBool::new(false), &mut Silent).unwrap();
        fs::write(dir.path().join("config.toml"), format!("{levels}goal = false\n")).unwrap();
        let message = finetune(&again, &AtomicBool::new(false), &mut Silent).unwrap_err().to_string();
        assert!(message.contains("model.goal is false; the source has true"), "{message}");
    }

    #[test]
    fn a_name_that_is_built_in_is_a_training_file() {
        let dir = tempfile::tempdir().unwrap();
        let (_corpus, options) = setup(dir.path());
        let named = FinetuneOptions { config: "finetune".into(), steps: Some(1), ..options };
        assert_eq!(finetune(&named, &AtomicBool::new(false), &mut Silent).unwrap().step, 1);
    }

    #[test]
    fn another_shape_is_refused_by_its_key() {
        let dir = tempfile::tempdir().unwrap();
        let (_corpus, options) = setup(dir.path());
        let said = |config: &str| {
            fs::write(dir.path().join("config.toml"), config).unwrap();
            finetune(&options, &AtomicBool::new(false), &mut Silent).unwrap_err().to_string()
        };
        let message = said("[model]\nwidth = 32\n");
        assert!(message.contains("model.width is 32; the source has 16; leave [model] out"), "{message}");
        assert!(said("[train]\nconditions = [\"mood\"]\n").contains("names `mood`, which no training clip has"));
        assert!(!dir.path().join("run").exists());
        let merged = fixture::merged(dir.path(), &[(90, Split::Train)]);
        let other = FinetuneOptions { corpora: vec![CorpusPart::once(merged.dir())], ..options.clone() };
        fs::write(dir.path().join("config.toml"), "").unwrap();
        let message = finetune(&other, &AtomicBool::new(false), &mut Silent).unwrap_err().to_string();
        assert!(message.contains("expected that of the run's"), "{message}");
    }
}
