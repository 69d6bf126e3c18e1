//! The learning-rate range test: a few hundred steps at rates that grow until the loss blows up (docs/training.md, "Which
//! rate").
//!
//! Source: Smith, "Cyclical learning rates for training neural networks" (2017); the smoothing, and stopping at a multiple
//! of the least loss, are fastai's.
//!
//! The losses are of training batches: the test finds rates at which training is stable, not the one that generalises
//! best.

use super::config::TrainConfig;
use super::data::{CorpusPart, Data};
use super::factory::learner;
use super::learner::Fit;
use super::memory;
use super::pretrain::first_weights;
use super::run::RunFile;
use super::stages::Stages;
use super::train_file::TrainFile;
use super::trainer::{Cadence, Files, Task, Trainer};
use crate::{Error, Result};
use kinelm_corpus::CorpusOptions;
use kinelm_model::Compute;
use kinelm_model::checkpoint::State;
use kinelm_view::plot::{Chart, Look, Rule, Scale, Series};
use serde::Serialize;
use std::sync::atomic::{AtomicBool, Ordering};

/// Decay of the smoothed loss from step to step.
const SMOOTHING: f64 = 0.98;
/// The test ends where the smoothed loss is this multiple of its least.
const BLOWN_UP: f64 = 4.0;
/// From this multiple of its least on, the smoothed loss has risen rather than wavered.
const RISEN: f64 = 1.1;
/// The suggestion is the turn over this.
const SAFETY: f64 = 10.0;

/// A model and the range of rates to test.
#[derive(Debug, Clone)]
pub struct LrFindOptions {
    /// The training file; its rate, schedule, steps, stages and run are ignored.
    pub file: TrainFile,
    /// The corpora, in place of those in the file.
    pub corpora: Vec<CorpusPart>,
    /// Steps, 2 or more.
    pub steps: u64,
    /// The first rate, above 0.
    pub from: f64,
    /// The last rate, above the first.
    pub to: f64,
    /// Where and how to compute.
    pub compute: Compute,
    /// How the corpora are opened.
    pub opening: CorpusOptions,
}

/// One step of the test.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RangeStep {
    /// Counted from 1.
    pub step: u64,
    /// The learning rate of its update.
    pub rate: f64,
    /// The loss before that update, nats a token.
    pub loss: f64,
    /// The smoothed losses so far.
    pub smoothed: f64,
}

/// The result of a range test.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RangeTest {
    /// The steps.
    pub steps: Vec<RangeStep>,
    /// The rate at which the smoothed loss is least, before it rises for good. `None` if it was still falling at the last
    /// rate, or never fell.
    pub turn: Option<f64>,
    /// A tenth of the turn.
    pub suggestion: Option<f64>,
    /// Whether the loss blew up before the last rate.
    pub blew_up: bool,
}

/// Trains a model at rates that grow exponentially, and discards it. `progress` receives every step.
///
/// # Errors
/// Options outside their limits; what training refuses before its first step; a first loss that is not finite.
pub fn lr_find(options: &LrFindOptions, stop: &AtomicBool, progress: &mut dyn FnMut(&RangeStep)) -> Result<RangeTest> {
    check(options)?;
    let corpora = if options.corpora.is_empty() { options.file.corpora()? } else { options.corpora.clone() };
    // the model's own windows throughout: those of stages would change the loss for another reason than the rate
    let train = TrainConfig { ema: 0.0, steps: options.steps, stages: Vec::new(), ..options.file.train.clone() };
    let data = Data::open(&corpora, None, &train.conditions, options.opening)?;
    let file = RunFile { augment: options.file.augment, ..RunFile::new(&options.file.model, &train, &data)? };
    memory::check(&file.model, &file.tokens, &train)?;
    let stages = Stages::of_run(&file, &data)?;
    let weights = first_weights(&file, &data)?;
    let precision = train.precision.decide(options.compute, file.model.width)?.0;
    let products = precision.resolve(None, options.compute)?.products;
    let learner = learner(&file.model, &file.tokens, &train, &weights, options.compute, products)?;
    let test = Test { fit: Fit::new(stages, learner, &train), options, curve: Curve::default(), blew_up: false };
    let cadence = Cadence { steps: options.steps, ..train.cadence() };
    let mut trainer = Trainer::new(test, cadence, None, State::new(0, 0, 0, train.seed, None));
    loop {
        if stop.load(Ordering::Relaxed) {
            let (step, steps) = (trainer.state().step, options.steps);
            return Err(Error::stopped(format!("stopped after {step} of {steps} steps")));
        }
        match trainer.next() {
            Some(step) => step?.iter().for_each(&mut *progress),
            None => return Ok(trainer.task.curve.end(trainer.task.blew_up)),
        }
    }
}

fn check(options: &LrFindOptions) -> Result<()> {
    let LrFindOptions { steps, from, to, .. } = *options;
    if steps < 2 {
        return Err(Error::invalid_parameter("steps", steps, "2 or more"));
    }
    if !(from > 0.0 && to > from && to.is_finite()) {
        return Err(Error::invalid_parameter(
            "from",
            format!("{from} and `to` {to}"),
            "a first rate above 0 and a last above that",
        ));
    }
    Ok(())
}

/// A model as the range test trains it.
struct Test<'a> {
    fit: Fit<'a>,
    options: &'a LrFindOptions,
    curve: Curve,
    blew_up: bool,
}

impl Task for Test<'_> {
    /// `None` where the loss is not finite: the rates before were too high.
    type Step = Option<RangeStep>;

    fn update(&mut self, state: &mut State) -> Result<Option<RangeStep>> {
        let LrFindOptions { steps, from, to, .. } = *self.options;
        let rate = from * (to / from).powf(state.step as f64 / (steps - 1) as f64);
        let found = match self.fit.gradients(state.step) {
            // at the first step the weights are random: a loss that isn't finite there is no matter of the rate
            Err(Error::NotFinite(_)) if state.step > 0 => None,
            found => Some(found?.0),
        };
        state.step += 1;
        let step = found.map(|found| self.curve.step(rate, found.loss));
        self.blew_up = step.is_none() || self.curve.blew_up();
        if let Some(found) = found.filter(|_| !self.blew_up) {
            self.fit.update(found.norm, rate)?;
        }
        Ok(step)
    }

    fn is_over(&self, _: &State) -> bool {
        self.blew_up
    }

    fn files(&mut self, _due: bool) -> Result<Files> {
        Ok(Vec::new())
    }
}

/// The losses so far.
#[derive(Default)]
struct Curve {
    steps: Vec<RangeStep>,
    /// The moving average before its bias correction.
    average: f64,
}

impl Curve {
    fn step(&mut self, rate: f64, loss: f64) -> RangeStep {
        let step = self.steps.len() as u64 + 1;
        self.average = SMOOTHING * self.average + (1.0 - SMOOTHING) * loss;
        // the average begins at 0, and would be 2 % of the loss in the first step
        let smoothed = self.average / (1.0 - SMOOTHING.powf(step as f64));
        let step = RangeStep { step, rate, loss, smoothed };
        self.steps.push(step);
        step
    }

    /// The index of the least smoothed loss.
    fn least(&self) -> Option<usize> {
        (0..self.steps.len()).min_by(|&a, &b| self.steps[a].smoothed.total_cmp(&self.steps[b].smoothed))
    }

    fn blew_up(&self) -> bool {
        let least = self.least().map_or(f64::MAX, |i| self.steps[i].smoothed);
        self.steps.last().is_some_and(|last| last.smoothed > BLOWN_UP * least)
    }

    fn end(self, blew_up: bool) -> RangeTest {
        // a least at either end is no turn: the loss never fell, or still fell
        let inside = |i: &usize| (1..self.steps.len().saturating_sub(1)).contains(i);
        // a loss that only fell has a turn where the next one was not finite
        let least = self.least().filter(|i| inside(i) || (blew_up && *i > 0));
        let least = least.filter(|&i| {
            let rose = |last: &RangeStep| last.smoothed > RISEN * self.steps[i].smoothed;
            blew_up || self.steps.last().is_some_and(rose)
        });
        let turn = least.map(|i| self.steps[i].rate);
        RangeTest { turn, suggestion: turn.map(|t| t / SAFETY), blew_up, steps: self.steps }
    }
}

impl RangeTest {
    /// A table for a terminal: a row every quarter of a decade, the turn and the suggestion.
    pub fn table(&self) -> String {
        let mut text = format!("{:>6}  {:>9}  {:>9}  {:>9}\n", "step", "rate", "loss", "smoothed");
        let mut next = f64::MIN;
        for (i, RangeStep { step, rate, loss, smoothed }) in self.steps.iter().enumerate() {
            if rate.log10() >= next || i + 1 == self.steps.len() {
                text += &format!("{step:>6}  {rate:>9.2e}  {loss:>9.4}  {smoothed:>9.4}\n");
                next = rate.log10() + 0.25;
            }
        }
        text + &match (self.turn, self.suggestion) {
            (Some(turn), Some(suggestion)) => format!(
                "turn {turn:.2e}: from there on the smoothed loss rises\nsuggestion {suggestion:.2e}: a tenth of it\n"
            ),
            _ => "no turn: the smoothed loss did not fall and then rise; try other `from` and `to`\n".into(),
        }
    }

    /// Loss over rate, with the turn and the suggestion.
    pub fn chart(&self) -> Chart {
        let series = |name: &str, look, y: fn(&RangeStep) -> f64| Series {
            name: name.into(),
            points: self.steps.iter().map(|t| (t.rate, y(t))).collect(),
            look,
            colour: Some(0),
        };
        let rule = |name: &str, x: Option<f64>| x.map(|x| Rule { x, name: format!("{name} {x:.1e}") });
        Chart {
            title: "Learning-rate range test".into(),
            x: "learning rate".into(),
            y: "loss, nats a token".into(),
            scales: (Scale::Log, Scale::Log),
            series: vec![series("loss", Look::Faint, |t| t.loss), series("smoothed", Look::Line, |t| t.smoothed)],
            rules: [rule("suggestion", self.suggestion), rule("turn", self.turn)].into_iter().flatten().collect(),
            ..Chart::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;
    use kinelm_corpus::Split;
    use kinelm_model::ModelConfig;

    /// A loss that falls to rate 1e-3 and rises fourfold after.
    fn curve(steps: u64) -> Curve {
        let mut test = Curve::default();
        for i in 0..steps {
            let rate = 1e-7 * 10f64.powf(7.0 * i as f64 / (steps - 1) as f64);
            let x = rate.log10() + 3.0;
            test.step(rate, if x < 0.0 { 3.0 - 0.2 * x.max(-3.0) } else { 3.0 * (2.0 * x).exp() });
            if test.blew_up() {
                break;
            }
        }
        test
    }

    #[test]
    fn smoothing_is_the_corrected_average_and_the_end_is_four_times_the_least() {
        let mut test = Curve::default();
        for loss in [4.0, 2.0, 3.0] {
            test.step(1.0, loss);
        }
        // by hand: (0.98^2 x 4 + 0.98 x 2 + 3) x 0.02 / (1 - 0.98^3)
        let expected = (0.9604 * 4.0 + 0.98 * 2.0 + 3.0) * 0.02 / (1.0 - 0.941192);
        assert!((test.steps[2].smoothed - expected).abs() < 1e-12, "{:?}", test.steps[2]);
        assert_eq!(test.steps[0].smoothed, 4.0);
        let test = curve(3000);
        assert!(test.blew_up());
        let found = test.end(true);
        let turn = found.turn.unwrap();
        assert!((turn.log10() + 3.0).abs() < 0.15, "{turn}: an average of 50 steps of 3,000 lags little");
        assert_eq!(found.suggestion, Some(turn / 10.0));
        let (last, least) = (found.steps.last().unwrap().smoothed, found.steps.iter().map(|t| t.smoothed));
        let least = least.fold(f64::MAX, f64::min);
        assert!(last > 4.0 * least && last < 4.2 * least);
    }

    #[test]
    fn a_loss_that_never_turned_has_no_suggestion() {
        let of = |losses: &[f64], blew_up| {
            let mut test = Curve::default();
            for loss in losses {
                test.step(0.1, *loss);
            }
            test.end(blew_up).turn
        };
        assert_eq!(of(&[3.0, 2.0, 1.0], false), None);
        assert_eq!(of(&[1.0, 2.0, 3.0], false), None);
        assert_eq!(of(&[3.0, 2.0, 1.0], true), Some(0.1));
        assert_eq!(of(&[], true), None);
    }

    #[test]
    fn a_model_that_learns_has_a_turn_and_the_same_twice() {
        let dir = tempfile::tempdir().unwrap();
        fixture::corpus(dir.path(), &[(300, Split::Train), (12, Split::Valid)]);
        let model = ModelConfig { layers: 1, heads: 2, width: 32, context: 36, ..Default::default() };
        let train = TrainConfig { batch: 4, ..Default::default() };
        let file = TrainFile { model, train, run: Some(dir.path().join("run")), ..Default::default() };
        let corpora = vec![CorpusPart::once(dir.path().join("corpus"))];
        let options = LrFindOptions {
            file,
            corpora,
            steps: 120,
            from: 1e-7,
            to: 100.0,
            compute: Compute::default(),
            opening: CorpusOptions::default(),
        };
        let find = |options: &LrFindOptions| lr_find(options, &AtomicBool::new(false), &mut |_| ());
        let found = find(&options).unwrap();
        let (first, turn) = (found.steps[0], found.turn.unwrap());
        // of a window's 36 targets 11 are among 16 ids, the others among the 10 bins that a frame before leaves
        let knows_nothing = (11.0 * 16f64.ln() + 25.0 * 10f64.ln()) / 36.0;
        assert!((first.rate - 1e-7).abs() < 1e-18 && (first.loss - knows_nothing).abs() < 0.1, "{first:?}");
        assert!((1e-4..1.0).contains(&turn), "{turn}");
        let least = found.steps.iter().map(|t| t.smoothed).fold(f64::MAX, f64::min);
        assert!(least < first.loss - 0.1, "{least}");
        assert_eq!(find(&options).unwrap(), found);
        let chart = found.chart();
        assert_eq!(chart.rules.len(), 2);
        assert!(!dir.path().join("run").exists(), "no run is touched");
        for (steps, from, to) in [(1, 1e-7, 1.0), (9, 0.0, 1.0), (9, 1.0, 1.0), (9, 1.0, f64::INFINITY)] {
            let message = find(&LrFindOptions { steps, from, to, ..options.clone() }).unwrap_err().to_string();
            assert!(message.contains("expected"), "{message}");
        }
    }
}
