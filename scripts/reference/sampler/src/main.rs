//! What candle-transformers' sampler draws: how often each id, of fixed logits, by each of its rules.
//!
//!     cargo run --release --manifest-path scripts/reference/sampler/Cargo.toml > crates/generate/tests/golden/sampler.json

use candle_core::{Device, Tensor};
use candle_transformers::generation::{LogitsProcessor, Sampling};
use serde_json::{Value, json};

const SEED: u64 = 299_792_458;
const DRAWS: usize = 20_000;
const IDS: u32 = 24;

/// Neither even nor in order; even the least likely id is drawn some tens of times, so that those never drawn are those left
/// out.
fn logits() -> Vec<f32> {
    (0..IDS).map(|i| ((i * 37 + 11) % 101) as f32 / 101.0 * 3.0 - 1.5).collect()
}

fn case(logits: &Tensor, rule: Value, sampling: Sampling) -> Value {
    let mut processor = LogitsProcessor::from_sampling(SEED, sampling);
    let mut counts = vec![0u32; IDS as usize];
    for _ in 0..DRAWS {
        counts[processor.sample(logits).expect("good logits") as usize] += 1;
    }
    json!({"rule": rule, "counts": counts})
}

fn main() -> candle_core::Result<()> {
    let numbers = logits();
    let logits = Tensor::new(numbers.as_slice(), &Device::Cpu)?;
    let mut cases = Vec::new();
    for temperature in [0.7, 1.0, 1.5] {
        let rule = json!({"temperature": temperature});
        cases.push(case(&logits, rule, Sampling::All { temperature }));
    }
    for (k, temperature) in [(1, 1.0), (5, 0.8), (23, 1.0)] {
        let rule = json!({"temperature": temperature, "top_k": k});
        cases.push(case(&logits, rule, Sampling::TopK { k, temperature }));
    }
    for (p, temperature) in [(0.05, 1.0), (0.5, 1.0), (0.9, 0.7), (0.9, 1.5)] {
        let rule = json!({"temperature": temperature, "top_p": p});
        cases.push(case(&logits, rule, Sampling::TopP { p, temperature }));
    }
    // its p is of all ids, not of the k that are left
    for (k, p, temperature) in [(10, 0.4, 1.0), (6, 0.3, 0.7)] {
        let rule = json!({"temperature": temperature, "top_k": k, "top_p": p});
        cases.push(case(&logits, rule, Sampling::TopKThenTopP { k, p, temperature }));
    }
    let made_by = "scripts/reference/sampler: candle-transformers 0.11.1";
    println!("{}", json!({"made_by": made_by, "seed": SEED, "draws": DRAWS, "logits": numbers, "cases": cases}));
    Ok(())
}
