//! `kinelm-lab train`.

use crate::model::{BenchModel, ModelArgs};
use crate::{How, Rates, Row, Say, Unit, peak, rounded, seconds};
use anyhow::Result;
use kinelm::model::{Architecture, Compute, DeviceName, Form, weights};
use kinelm::store::random;
use kinelm::train::batches::Batch;
use kinelm::train::learner::clip_share;
use kinelm::train::{Learner, Precision, learner};
use rand_chacha::rand_core::RngCore;
use serde_json::json;

/// Steps that don't count: in the first ones memory is taken and caches fill.
const WARM_UP: u16 = 3;
/// Ids below it are special ones.
const FIRST_ID: u32 = 6;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    model: ModelArgs,
    /// B: windows of a step; 8 for tiny, 2 for small, 1 for others if not given
    #[arg(long, value_name = "B", value_parser = clap::value_parser!(u16).range(1..))]
    batch: Option<u16>,
    /// In which numbers products are computed: f32, bf16 or auto
    #[arg(long, value_name = "f32|bf16|auto", default_value = "f32")]
    precision: Precision,
    /// The CPU, or the Nvidia card with this number (if built with CUDA)
    #[arg(long, value_name = "cpu|cuda:N", default_value = "cpu")]
    device: DeviceName,
    /// The implementation of the model: the fastest for the device, or the plain reference
    #[arg(long, value_name = "auto|plain", default_value = "auto")]
    form: Form,
    #[command(flatten)]
    how: How,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let bench = args.model.get()?;
    let batch = args.batch.map_or_else(|| usual_batch(&bench.name), usize::from);
    let batch = made_up(&bench, batch);
    let compute = Compute { device: args.device, form: args.form };
    let weights = weights::initial(&bench.file.model, &bench.tokens, 1);
    let parameters: usize = weights.values().map(|array| array.numbers().len()).sum();
    let (tokens, length) = (batch.inputs.len(), batch.length());
    say.line(format_args!("{parameters} parameters, {} x {length} tokens a step", batch.clips.len()));
    let (precision, note) = args.precision.decide(compute, bench.file.model.width)?;
    let chosen = precision.resolve(None, compute)?;
    chosen.notes.iter().chain(&note).for_each(|note| say.line(note));
    let mut learner = learner(&bench.file.model, &bench.tokens, &bench.file.train, &weights, compute, chosen.products)?;
    let mut losses = Vec::new();
    let timed = seconds(WARM_UP, args.how.repeats.unwrap_or(10), || {
        losses.push(step(&mut *learner, &batch, losses.len() as u64)?);
        Ok(())
    })?;
    let rates = Rates::of(tokens as f64, &timed);
    let gflops = operations(&bench, &batch) / tokens as f64 * rates.median / 1e9;
    let mut more = json!({
        "form": format!("{:?}", compute.form).to_lowercase(),
        "device": compute.device.to_string(),
        "batch": batch.clips.len(),
        "context": length,
        "parameters": parameters,
        "gflops": rounded(gflops, 1),
        "last_loss": losses.last(),
    });
    if compute.device == DeviceName::Cpu {
        let most = peak::gflops(chosen.products);
        more["products"] = json!(chosen.products.name());
        more["kernels"] = json!(kinelm::engine::dispatch::name());
        more["peak_gflops"] = rounded(most, 1);
        more["share_of_peak"] = rounded(gflops / most, 3);
    }
    let threads = rayon::current_num_threads();
    Row { what: "train", config: &bench.name, unit: Unit::Tokens, rates, threads, more }.print(&args.how)
}

/// Windows of a step that suit a configuration of this name.
fn usual_batch(name: &str) -> usize {
    match name {
        "tiny" => 8,
        "small" => 2,
        _ => 1,
    }
}

/// A batch of ids sampled with a fixed seed; every target counts.
fn made_up(bench: &BenchModel, batch: usize) -> Batch {
    let context = bench.file.model.context;
    let mut rng = random::stream(1, "bench", 0, 0);
    let ordinary = bench.tokens.vocabulary as u32 - FIRST_ID;
    let mut ids = || {
        let id = || FIRST_ID + rng.next_u32() % ordinary;
        std::iter::repeat_with(id).take(batch * context).collect::<Vec<u32>>()
    };
    Batch {
        inputs: ids(),
        targets: ids(),
        history: Vec::new(),
        clips: vec!["made up".into(); batch],
        conditioning: None,
    }
}

/// A whole step; its loss.
fn step(learner: &mut dyn Learner, batch: &Batch, step: u64) -> Result<f64> {
    let found = learner.gradients(batch, step)?;
    learner.update(clip_share(found.norm, 1.0), 1e-3)?;
    Ok(found.loss)
}

/// Operations of a step: two a weight and token forward, four backward; the same of causal attention's two products,
/// which hold T (T + 1)/2 pairs. Nothing that is computed twice counts twice.
fn operations(bench: &BenchModel, batch: &Batch) -> f64 {
    let (model, length) = (&bench.file.model, batch.length() as f64);
    // numbers of the pairs of some sequences in a stack
    let seen = |sequences: f64, rows: f64, layers: usize, width: usize| {
        sequences * rows * (rows + 1.0) / 2.0 * (layers * width) as f64
    };
    let windows = batch.clips.len() as f64;
    let pairs = match model.architecture {
        Architecture::Flat => seen(windows, length, model.layers, model.width),
        Architecture::TwoLevel => {
            let (decoder, word) = (model.decoder(), bench.tokens.word as f64);
            let frames = length / word;
            let decoded = seen(windows * frames, word, decoder.layers, decoder.width);
            seen(windows, frames, model.layers, model.width) + decoded
        }
    };
    let attention = 2.0 * 6.0 * pairs;
    6.0 * bench.matrices() as f64 * batch.inputs.len() as f64 + attention
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(clap::Parser)]
    struct Call {
        #[command(flatten)]
        args: Args,
    }

    fn bench(more: &[&str]) -> BenchModel {
        let call = Call::parse_from(["x"].iter().chain(more));
        call.args.model.get().unwrap()
    }

    #[test]
    fn operations_of_a_step_counted_by_hand() {
        let bench = bench(&["--context", "100"]);
        // 4 blocks of 12 x 128 x 128 and a head of 421 x 128; 2 windows of 100 tokens, 5,050 pairs each
        let products = 6.0 * (4.0 * 196_608.0 + 53_888.0) * 200.0;
        let attention = 12.0 * 10_100.0 * 4.0 * 128.0;
        assert_eq!(operations(&bench, &made_up(&bench, 2)), products + attention);
    }

    #[test]
    fn made_up_tokens_are_ordinary_ones_and_always_the_same() {
        let bench = bench(&["--vocabulary", "9"]);
        let batch = made_up(&bench, 3);
        assert_eq!((batch.inputs.len(), batch.targets.len(), batch.length()), (768, 768, 256));
        assert!(batch.inputs.iter().chain(&batch.targets).all(|id| (6..9).contains(id)));
        assert_ne!(batch.inputs, batch.targets);
        assert_eq!(batch, made_up(&bench, 3));
    }
}
