//! `kinelm-lab lstm`.

use crate::{How, Rates, Row, Say, Unit, rounded, seconds};
use anyhow::Result;
use kinelm::baselines::Settings;
use kinelm::baselines::aclstm::network::{Learner, initial};
use kinelm::baselines::aclstm::{Config, Form};
use kinelm::store::random;
use serde_json::json;

/// Steps that don't count: in the first ones memory is taken and caches fill.
const WARM_UP: u16 = 2;
/// Channels of quaternions on a rig of 43 joints.
const CHANNELS: usize = 175;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Units of a layer
    #[arg(long, value_name = "N", default_value_t = 256)]
    width: u16,
    /// Frames of its own that it is fed after every 5 true ones; 0: none
    #[arg(long, value_name = "N", default_value_t = 5)]
    condition: u16,
    /// Sequences of a step
    #[arg(long, value_name = "N", default_value_t = 32)]
    batch: u16,
    #[command(flatten)]
    how: How,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let config = Config {
        form: Form::Positional,
        width: args.width.into(),
        condition: args.condition.into(),
        batch: args.batch.into(),
        ..Config::default()
    };
    config.validate()?;
    let shape = config.shape(CHANNELS);
    let frames = config.batch * config.length;
    say.line(format_args!("{} parameters, {} x {} frames a step", shape.parameters(), config.batch, config.length));
    let mut rng = random::stream(1, "bench", 0, 0);
    let mut sample = || (0..frames * CHANNELS).map(|_| 0.1 * random::normal(&mut rng) as f32).collect::<Vec<f32>>();
    let (inputs, targets, given) = (sample(), sample(), config.given());
    let mut learner = Learner::new(config.form, config.parts(), shape, config.batch, config.length, initial(&shape, 1));
    let mut last = 0.0;
    let timed = seconds(WARM_UP, args.how.repeats.unwrap_or(10), || {
        last = learner.gradients(&inputs, &targets, &given).loss;
        learner.parameters.update(config.learning_rate, None);
        Ok(())
    })?;
    let rates = Rates::of(frames as f64, &timed);
    // two a weight and frame forward, four backward
    let gflops = 6.0 * shape.parameters() as f64 * rates.median / 1e9;
    let more = json!({
        "width": config.width,
        "condition": config.condition,
        "batch": config.batch,
        "length": config.length,
        "parameters": shape.parameters(),
        "gflops": rounded(gflops, 1),
        "kernels": kinelm::engine::dispatch::name(),
        "last_loss": last,
    });
    let threads = rayon::current_num_threads();
    let name = format!("lstm {}", config.width);
    Row { what: "lstm", config: &name, unit: Unit::Frames, rates, threads, more }.print(&args.how)
}
