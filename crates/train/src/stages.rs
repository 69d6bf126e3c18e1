//! Stages: windows that grow over a run, by `[[train.stages]]`.
//!
//! Short windows come first because many small steps learn faster than few large ones, and short-range dependencies are
//! learned before long-range ones: docs/results/two-level.md.

use super::batches::{Batch, Batches};
use super::config::{Stage, TrainConfig};
use super::data::Data;
use super::run::RunFile;
use crate::Result;
use kinelm_model::{ModelConfig, ModelKind, TokenLayout};

impl Stage {
    /// The first step after it, in a run of `steps` steps.
    fn end(&self, steps: u64) -> u64 {
        (self.until * steps as f64).round() as u64
    }

    /// T: tokens of its windows, as in `model.context`.
    fn context(&self, model: &ModelConfig, tokens: &TokenLayout) -> usize {
        // a masked model's last input predicts nothing
        let last = usize::from(model.kind == ModelKind::Masked);
        self.frames * tokens.word + tokens.front + last - 1
    }
}

/// The largest number of tokens of a batch, over all stages.
pub fn most_tokens(train: &TrainConfig, model: &ModelConfig, tokens: &TokenLayout) -> usize {
    let stages = train.stages.iter().map(|s| s.batch * s.context(model, tokens).min(model.context));
    stages.chain([train.batch * model.context]).max().unwrap_or(0)
}

/// The windows of a run's steps, from the first to the last.
pub struct Stages<'a> {
    stages: Vec<Running<'a>>,
    accumulate: u64,
}

/// A stage from its first step on.
struct Running<'a> {
    first: u64,
    batches: Batches<'a>,
}

impl<'a> Stages<'a> {
    /// The windows of a run.
    ///
    /// # Errors
    /// As [`Batches::of_run`].
    pub fn of_run(run: &RunFile, data: &'a Data) -> Result<Stages<'a>> {
        let mut stages = Vec::with_capacity(run.train.stages.len() + 1);
        let mut first = 0;
        for stage in &run.train.stages {
            let model = ModelConfig { context: stage.context(&run.model, &run.tokens), ..run.model.clone() };
            let train = TrainConfig { batch: stage.batch, ..run.train.clone() };
            let batches = Batches::of_run(&RunFile { model, train, ..run.clone() }, data)?;
            // two stages may round to the same first step: `at` takes the later one
            stages.push(Running { first, batches });
            first = stage.end(run.train.steps);
        }
        stages.push(Running { first, batches: Batches::of_run(run, data)? });
        Ok(Stages { stages, accumulate: run.train.accumulate as u64 })
    }

    /// The batches of step `step`, which are accumulated.
    ///
    /// # Errors
    /// A corpus that can no longer be read.
    pub fn of_step(&mut self, step: u64) -> Result<Vec<Batch>> {
        let parts = self.accumulate;
        let Running { first, batches } = self.at(step);
        // a stage counts its windows from 0, so that its data doesn't depend on the length of the one before
        let step = step - *first;
        (step * parts..(step + 1) * parts).map(|i| batches.batch(i)).collect()
    }

    fn at(&mut self, step: u64) -> &mut Running<'a> {
        let index = self.stages.partition_point(|s| s.first <= step).saturating_sub(1);
        &mut self.stages[index]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{validate_stages, validate_stages_for};
    use crate::fixture;
    use crate::fixture::TOKENS;
    use kinelm_corpus::Split;

    fn stage(until: f64, frames: usize, batch: usize) -> Stage {
        Stage { until, frames, batch }
    }

    #[test]
    fn wrong_stages_are_named() {
        let said = |stages: &[Stage]| validate_stages(stages).unwrap_err().to_string();
        validate_stages(&[stage(0.4, 3, 2), stage(0.7, 2, 1)]).unwrap();
        assert_eq!(
            said(&[stage(0.4, 3, 2), stage(0.4, 6, 1)]),
            "train.stages: `until` of stage 2 is 0.4; expected more than 0.4 and less than 1"
        );
        assert!(said(&[stage(f64::NAN, 3, 2)]).contains("`until` of stage 1 is NaN"));
        assert!(said(&[stage(1.0, 3, 2)]).contains("less than 1"));
        assert!(said(&[stage(0.5, 0, 2)]).contains("`frames` of stage 1 is 0; expected 1 or more"));
        assert!(said(&[stage(0.5, 1, 0)]).contains("`batch` of stage 1 is 0; expected 1 to 65536"));
        let model = ModelConfig { context: 36, ..Default::default() };
        validate_stages_for(&[stage(0.5, 5, 1)], &model, &TOKENS).unwrap();
        let message = validate_stages_for(&[stage(0.5, 6, 1)], &model, &TOKENS).unwrap_err().to_string();
        assert!(message.contains("`frames` of stage 1 is 6; expected 5 or less"), "{message}");
        let varying = TokenLayout { varying: true, ..TOKENS };
        let message = validate_stages_for(&[stage(0.5, 5, 1)], &model, &varying).unwrap_err().to_string();
        assert!(message.contains("differ in length"), "{message}");
    }

    #[test]
    fn each_step_has_the_windows_of_its_stage_and_steps_come_in_any_order() {
        let dir = tempfile::tempdir().unwrap();
        let data = Data::one(fixture::corpus(dir.path(), &[(60, Split::Train), (20, Split::Train)])).unwrap();
        for (kind, context) in [(ModelKind::Causal, 36), (ModelKind::Masked, 37)] {
            let model = ModelConfig { kind, context, ..Default::default() };
            let stages = vec![stage(0.3, 2, 4), stage(0.8, 3, 2)];
            let train = TrainConfig { batch: 1, accumulate: 2, steps: 10, stages, ..Default::default() };
            let run = RunFile::new(&model, &train, &data).unwrap();
            let mut stages = Stages::of_run(&run, &data).unwrap();
            let all: Vec<Vec<Batch>> = (0..10).map(|step| stages.of_step(step).unwrap()).collect();
            let shape = |batches: &Vec<Batch>| {
                assert_eq!(batches.len(), 2);
                assert!(
                    batches
                        .iter()
                        .all(|b| (b.length(), b.clips.len()) == (batches[0].length(), batches[0].clips.len()))
                );
                (batches[0].length(), batches[0].clips.len())
            };
            let more = context - 36;
            let expected = [[(14 + more, 4); 3].as_slice(), &[(21 + more, 2); 5], &[(context, 1); 2]].concat();
            assert_eq!(all.iter().map(shape).collect::<Vec<_>>(), expected);
            for step in [9, 0, 8, 3, 2] {
                assert_eq!(stages.of_step(step).unwrap(), all[step as usize], "step {step}");
            }
            assert_eq!(most_tokens(&run.train, &run.model, &run.tokens), 4 * (14 + more));
        }
    }
}
