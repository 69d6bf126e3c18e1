//! Fine-tuning: training that begins with another model's weights, and may add labels, goals and music to its conditioning.

use super::{PretrainOptions, Summary, run_of};
use crate::progress::Progress;
use crate::train_file::TrainFile;
use crate::{Error, Result};
use kinelm_corpus::conditions::in_order;
use kinelm_model::{LoadedRun, ModelConfig, TokenLayout};
use std::sync::atomic::AtomicBool;

/// Trains a new run from the weights of `options.from`. The optimizer begins anew.
///
/// The model's shape is the source's: keys of `[model]` in the training file must agree with it, except `dropout`, and
/// `goal` and `music`, which may be added. The vocabulary is the source's with the labels of the training clips, for the
/// fields of the source and those of `train.conditions`; [`resize`](crate::resize::resize) extends the tables. To resume
/// such a run, see [`pretrain`](fn@super::pretrain).
///
/// # Errors
/// A source that is none, or damaged; keys of `[model]` that differ from the source's; a corpus of another tokenizer; those
/// of [`pretrain`](fn@super::pretrain).
pub fn finetune(options: &PretrainOptions, stop: &AtomicBool, progress: &mut dyn Progress) -> Result<Summary> {
    if options.from.is_none() {
        return Err(Error::missing("weights to begin with", "give `from`: a run, or an exported folder"));
    }
    run_of(options, true, stop, progress)
}

/// The label fields of a fine-tuned model: the source's and these.
pub(super) fn conditions(source: &LoadedRun, fields: &[String]) -> Vec<String> {
    in_order(&[source.conditions.as_slice(), fields].concat())
}

/// The source's shape, with the dropout and the conditioning on goals and music that the file adds.
pub(super) fn shape(file: &TrainFile, source: &LoadedRun) -> Result<ModelConfig> {
    let goal = file.model.goal || source.config.goal;
    let music = if source.config.music.is_none() { file.model.music } else { source.config.music };
    let own = source.config.resolved(&source.tokens);
    let has = keys(&own);
    // conditioning may be added, and can't be removed
    let may_differ = |key: &str| match key {
        "goal" => !source.config.goal,
        "music" => source.config.music.is_none(),
        key => key == "dropout",
    };
    for (key, value) in file.given.iter().filter(|(key, _)| !may_differ(key)) {
        if has.get(key) != Some(value) {
            let own = has.get(key).map_or("nothing".into(), |own| own.to_string());
            let expected = format!("{own}, as the source has; leave [model] out: the shape is that of the weights");
            return Err(file.located(Error::invalid(format!("model.{key}"), value, expected)));
        }
    }
    let dropout = if file.given.contains_key("dropout") { file.model.dropout } else { source.config.dropout };
    Ok(ModelConfig { dropout, goal, music, ..own })
}

/// The keys of `[model]` that decide the weights.
pub(super) fn keys(model: &ModelConfig) -> toml::Table {
    // dropout has no tensor, so it may differ from the source's
    let model = ModelConfig { dropout: 0.0, ..model.clone() };
    toml::Table::try_from(model).expect("a model's configuration is a TOML table")
}

/// A note on what the model's input gets more.
pub(super) fn new_inputs(old: &TokenLayout, new: &TokenLayout) -> String {
    match (new.vocabulary - old.vocabulary, new.front - old.front) {
        (0, 0) => "the model's vocabulary and label fields stay as they are".into(),
        (ids, fields) => format!("the model gets {ids} more ids and {fields} more label fields"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pretrain::tests::StopAt;
    use crate::run::RunFile;
    use crate::{CorpusPart, NoProgress, fixture, pretrain};
    use kinelm_corpus::{Corpus, Split};
    use kinelm_model::CheckpointChoice;
    use kinelm_model::run::{WEIGHTS, load_run};
    use std::fs;
    use std::path::Path;

    const SOURCE: &str = "[model]\nlayers = 2\nheads = 2\nwidth = 16\ncontext = 24\n[train]\nbatch = 3\nsteps = 6\n\
                          warmup = 2\nlearning_rate = 1e-2\neval_every = 3\nconditions = [\"genre\"]\n";
    const CONFIG: &str = "[model]\nwidth = 16\ndropout = 0.1\n[train]\nbatch = 3\nsteps = 8\nwarmup = 2\n\
                          learning_rate = 1e-3\neval_every = 4\nkeep = 9\nconditions = [\"dancer\"]\nlabel_dropout = 0.3\n\
                          [augment]\nmirror = 0.5\nspeed = 0.1\n";

    /// A run `source`, and the file of a run that goes on from it.
    fn setup(dir: &Path) -> (Corpus, PretrainOptions) {
        let corpus = fixture::corpus(dir, &[(40, Split::Train), (9, Split::Train), (12, Split::Valid)]);
        fs::write(dir.join("source.toml"), SOURCE).unwrap();
        fs::write(dir.join("config.toml"), CONFIG).unwrap();
        let options = PretrainOptions {
            file: Some(TrainFile::load(&dir.join("source.toml")).unwrap()),
            corpora: vec![CorpusPart::once(corpus.dir())],
            run: Some(dir.join("source")),
            ..Default::default()
        };
        pretrain(&options, &AtomicBool::new(false), &mut NoProgress).unwrap();
        let options = PretrainOptions {
            from: Some(dir.join("source")),
            file: Some(TrainFile::load(&dir.join("config.toml")).unwrap()),
            corpora: vec![CorpusPart::once(corpus.dir())],
            run: Some(dir.join("run")),
            ..Default::default()
        };
        (corpus, options)
    }

    #[test]
    fn a_run_goes_on_from_anothers_weights_learns_labels_and_resumes_bit_for_bit() {
        let dir = tempfile::tempdir().unwrap();
        let (_corpus, options) = setup(dir.path());
        let whole = finetune(&options, &AtomicBool::new(false), &mut NoProgress).unwrap();
        let stop = AtomicBool::new(false);
        let halves = PretrainOptions { run: Some(dir.path().join("halves")), ..options.clone() };
        let first = finetune(&halves, &stop, &mut StopAt(3, &stop, Vec::new())).unwrap();
        assert_eq!((first.step, first.stopped), (3, true));
        let resume = PretrainOptions { run: halves.run, resume: true, ..Default::default() };
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let second = one.install(|| pretrain(&resume, &AtomicBool::new(false), &mut NoProgress)).unwrap();
        // with dropout, hidden labels, mirrors and speeds
        let bytes = |s: &Summary| fs::read(s.checkpoint.join(WEIGHTS)).unwrap();
        assert!(bytes(&whole) == bytes(&second));
        let (source, run) = (
            load_run(options.from.as_ref().unwrap(), CheckpointChoice::Auto).unwrap(),
            load_run(&whole.run, CheckpointChoice::Auto).unwrap(),
        );
        assert_eq!((run.conditions.as_slice(), run.config.dropout), (&["genre", "dancer"].map(String::from)[..], 0.1));
        assert_eq!((source.tokens.vocabulary, run.tokens.vocabulary, run.tokens.front), (18, 19, 3));
        let begun = load_run(&whole.run, CheckpointChoice::Step(0)).unwrap();
        for (name, rows) in [("token.weight", 18), ("position.front.weight", 2)] {
            assert!(begun.weights[name].rows().take(rows).eq(source.weights[name].rows()), "{name}");
        }
        let file = RunFile::read(&whole.run).unwrap();
        let named = file.from.unwrap();
        assert_eq!(
            (named.path, named.step),
            (std::path::absolute(options.from.as_ref().unwrap()).unwrap(), source.state.step)
        );
        assert_eq!(named.sha256, source.state.files[WEIGHTS].sha256);
    }

    #[test]
    fn a_run_becomes_goal_conditioned_and_resumes_bit_for_bit() {
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
        pretrain(&source, &AtomicBool::new(false), &mut NoProgress).unwrap();
        let options = PretrainOptions {
            from: Some(dir.path().join("source")),
            file: Some(TrainFile::load(&dir.path().join("config.toml")).unwrap()),
            corpora: vec![CorpusPart::once(corpus.dir())],
            run: Some(dir.path().join("run")),
            ..Default::default()
        };
        let whole = finetune(&options, &AtomicBool::new(false), &mut NoProgress).unwrap();
        let stop = AtomicBool::new(false);
        let halves = PretrainOptions { run: Some(dir.path().join("halves")), ..options.clone() };
        finetune(&halves, &stop, &mut StopAt(3, &stop, Vec::new())).unwrap();
        let resume = PretrainOptions { run: halves.run, resume: true, ..Default::default() };
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let second = one.install(|| pretrain(&resume, &AtomicBool::new(false), &mut NoProgress)).unwrap();
        let bytes = |s: &Summary| fs::read(s.checkpoint.join(WEIGHTS)).unwrap();
        assert!(bytes(&whole) == bytes(&second));
        let begun = load_run(&whole.run, CheckpointChoice::Step(0)).unwrap();
        let was = load_run(options.from.as_ref().unwrap(), CheckpointChoice::Auto).unwrap();
        assert!(begun.config.goal && !was.config.goal);
        for (name, array) in &was.weights {
            assert!(begun.weights[name] == *array, "{name}");
        }
        let learned = load_run(&whole.run, CheckpointChoice::Step(6)).unwrap();
        for name in kinelm_model::layout::GOAL {
            assert!(begun.weights[name].numbers().iter().all(|x| *x == 0.0), "{name}");
            assert!(learned.weights[name].numbers().iter().any(|x| *x != 0.0), "{name}");
        }
        // and on from there, which can't be unlearned
        let (from, run) = (Some(dir.path().join("run")), Some(dir.path().join("again")));
        let mut again = PretrainOptions { from, run, ..options };
        finetune(&again, &AtomicBool::new(false), &mut NoProgress).unwrap();
        again.file = Some(TrainFile::parse(&format!("{levels}goal = false\n"), Path::new("config.toml")).unwrap());
        let message = finetune(&again, &AtomicBool::new(false), &mut NoProgress).unwrap_err().to_string();
        assert!(message.contains("model.goal is false; expected true, as the source has"), "{message}");
    }

    #[test]
    fn a_name_that_is_built_in_is_a_training_file() {
        let dir = tempfile::tempdir().unwrap();
        let (_corpus, options) = setup(dir.path());
        let file = Some(TrainFile::find(Path::new("finetune")).unwrap());
        let named = PretrainOptions { file, steps: Some(1), ..options };
        assert_eq!(finetune(&named, &AtomicBool::new(false), &mut NoProgress).unwrap().step, 1);
    }

    #[test]
    fn another_shape_is_refused_by_its_key() {
        let dir = tempfile::tempdir().unwrap();
        let (_corpus, options) = setup(dir.path());
        let with = |config: &str| {
            let file = Some(TrainFile::parse(config, Path::new("config.toml")).unwrap());
            PretrainOptions { file, ..options.clone() }
        };
        let error = |options| finetune(&options, &AtomicBool::new(false), &mut NoProgress).unwrap_err().to_string();
        let said = |config: &str| error(with(config));
        let message = said("[model]\nwidth = 32\n");
        assert!(message.contains("model.width is 32; expected 16, as the source has; leave [model] out"), "{message}");
        assert!(said("[train]\nconditions = [\"mood\"]\n").contains("no training clip has the label `mood`"));
        assert!(!dir.path().join("run").exists());
        let merged = fixture::merged(dir.path(), &[(90, Split::Train)]);
        let message = error(PretrainOptions { corpora: vec![CorpusPart::once(merged.dir())], ..with("") });
        assert!(message.contains("expected that of the run's"), "{message}");
    }
}
