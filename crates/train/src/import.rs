//! Import of models that were trained elsewhere.

use super::provenance::{self, PROVENANCE};
use super::run::RunFile;
use crate::{Error, Result};
use kinelm_model::checkpoint::Checkpoints;
use kinelm_model::run::{CONFIG, LoadedRun, TOKENIZER, WEIGHTS};
use kinelm_model::{CheckpointChoice, exchange, weights};
use kinelm_store::files;
use kinelm_store::files::PendingFolder;
use kinelm_tokenizer::Tokenizer;
use std::path::Path;

/// Makes the run folder `run` from a folder that `kinelm export`, scripts/cluster or `transformers` wrote: a tokenizer, one
/// checkpoint, `config.toml`. It is whole or doesn't exist. Returns the model, with notes for the user.
///
/// # Errors
/// Something else at `run`; a folder that is a run already; as [`exchange::load`]; what the system refuses.
pub fn import(folder: &Path, run: &Path) -> Result<LoadedRun> {
    if folder.join(CONFIG).is_file() {
        return Err(Error::unsupported(folder.display().to_string(), "it is a run already"));
    }
    let found = exchange::load(folder, CheckpointChoice::Auto)?;
    let tokenizer = found.load_tokenizer()?;
    let file = RunFile::imported(&found, &tokenizer);
    let work = PendingFolder::create(run)?;
    write(work.path(), &found, &tokenizer, &file)?;
    work.commit("give a folder that isn't there")?;
    // after settling, which compares the files of a folder that exists
    if !run.join(PROVENANCE).exists() {
        provenance::note(run)?;
    }
    Ok(found)
}

fn write(work: &Path, found: &LoadedRun, tokenizer: &Tokenizer, file: &RunFile) -> Result<()> {
    files::write_whole(&work.join(TOKENIZER), tokenizer.to_json().as_bytes())?;
    let bytes = weights::to_bytes(&found.weights)?;
    Checkpoints::of(work).write(found.state.clone(), &[(WEIGHTS, bytes)])?;
    file.write(work)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{NoProgress, PretrainOptions, TrainConfig, fixture, pretrain};
    use kinelm_corpus::{Corpus, Split};
    use kinelm_model::exchange::{Format, export};
    use kinelm_model::likelihood::likelihood;
    use kinelm_model::{Compute, HeadKind, ModelConfig, Positions, load_run};
    use std::fs;
    use std::sync::atomic::AtomicBool;

    /// A run of a few steps in `dir`, on a corpus beside it.
    fn trained(dir: &Path, model: ModelConfig) -> Corpus {
        let corpus = fixture::corpus(dir, &[(30, Split::Train), (20, Split::Valid)]);
        let train = TrainConfig { steps: 3, batch: 2, warmup: 1, ..Default::default() };
        fixture::run(dir, model, train);
        corpus
    }

    fn bits(run: &Path, corpus: &Corpus) -> f64 {
        let run = load_run(run, CheckpointChoice::Auto).unwrap();
        let clips: Vec<_> = corpus.split(Split::Valid).collect();
        let mut model = run.scores(Compute::default()).unwrap();
        let found = likelihood(&mut *model, corpus, &clips, 0, &run.load_conditions().unwrap());
        found.unwrap().unwrap().bits_per_frame
    }

    #[test]
    fn an_exported_run_is_imported_with_the_same_bits() {
        let gpt2 = ModelConfig {
            layers: 2,
            heads: 2,
            width: 8,
            context: 30,
            positions: Positions::FrameJoint,
            previous_frame: Some(false),
            head: Some(HeadKind::Absolute),
            ..Default::default()
        };
        let ours = ModelConfig { previous_frame: None, head: None, ..gpt2.clone() };
        for (model, format) in [(ours, Format::Kinelm), (gpt2.clone(), Format::Kinelm), (gpt2, Format::Hf)] {
            let dir = tempfile::tempdir().unwrap();
            let at = |name: &str| dir.path().join(name);
            let corpus = trained(dir.path(), model);
            let run = load_run(&at("run"), CheckpointChoice::Auto).unwrap();
            export(&run, format, &at("out")).unwrap();
            let found = import(&at("out"), &at("back")).unwrap();
            assert_eq!(found.state.step, run.state.step);
            assert_eq!(found.notes.is_empty(), format == Format::Kinelm, "{:?}", found.notes);
            let back = load_run(&at("back"), CheckpointChoice::Auto).unwrap();
            assert_eq!((&back.tokens, &back.conditions, back.state.step), (&run.tokens, &run.conditions, 3));
            let (after, before) = (bits(&at("back"), &corpus), bits(&at("run"), &corpus));
            // folded positions are added in another order by the fast form
            let bound = if format == Format::Hf { 1e-6 } else { 0.0 };
            assert!((after / before - 1.0).abs() <= bound, "{format:?}: {after}, before {before}");
            if format == Format::Kinelm {
                assert_eq!(back.config, run.config.resolved(&run.tokens));
                let bytes = |run: &LoadedRun| fs::read(run.checkpoint.join(WEIGHTS)).unwrap();
                assert_eq!(bytes(&back), bytes(&run));
            }
            assert_eq!(fs::read(&back.tokenizer).unwrap(), fs::read(&run.tokenizer).unwrap());
            // it can be exported again, and has no training to resume
            export(&back, format, &at("again")).unwrap();
            assert_eq!(fs::read(at("again").join(WEIGHTS)).unwrap(), fs::read(at("out").join(WEIGHTS)).unwrap());
            let resumed = PretrainOptions { run: Some(at("back")), resume: true, ..Default::default() };
            let message = pretrain(&resumed, &AtomicBool::new(false), &mut NoProgress).err().unwrap().to_string();
            assert!(message.contains("was imported, and has no training to resume"), "{message}");
        }
    }

    #[test]
    fn existing_folders_stay() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        let model = ModelConfig { layers: 1, heads: 1, width: 8, context: 30, ..Default::default() };
        trained(dir.path(), model);
        let said = |from: &str, to: &str| import(&at(from), &at(to)).err().unwrap().to_string();
        assert!(said("run", "other").ends_with("run: it is a run already"));
        let run = load_run(&at("run"), CheckpointChoice::Auto).unwrap();
        export(&run, Format::Kinelm, &at("out")).unwrap();
        assert!(said("out", "corpus").ends_with("corpus exists, with other contents; give a folder that isn't there"));
        fs::write(at("out").join(WEIGHTS), "{").unwrap();
        assert!(said("out", "other").contains("found no safetensors file"));
        let mut names: Vec<String> =
            fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        assert_eq!(names, ["corpus", "out", "run"]);
    }
}
