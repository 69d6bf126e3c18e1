//! One step's loss and gradients, in pieces side by side.

use super::adamw::Gradients;
use super::batches::Batch;
use crate::model::workers::Workers;
use crate::model::{Dropout, Gpt, ops};
use crate::{Error, Result};
use candle_core::{Device, Tensor};

/// Windows of a piece: as many as make up so many tokens. It follows from the context alone, never from the threads.
const PIECE_TOKENS: usize = 1024;

/// Windows that are computed together.
pub fn piece(context: usize) -> usize {
    (PIECE_TOKENS / context.max(1)).max(1)
}

/// What a step computes before the update.
#[derive(Debug)]
pub struct Step {
    /// Mean over the targets that count, nats a token.
    pub loss: f64,
    /// Targets that count.
    pub counted: usize,
    /// Of the mean loss.
    pub gradients: Gradients,
}

/// Loss and gradients of a batch; the sum over pieces has a fixed order.
///
/// # Errors
/// A loss that is not finite: the piece's clips are named; a variable without a gradient, which would be our bug.
pub fn step(model: &Gpt, workers: &Workers, batch: &Batch, dropout: Option<Dropout>) -> Result<Step> {
    let context = model.config().context;
    let rows = piece(context);
    let windows = batch.inputs.len() / context;
    let pad = model.tokens().pad;
    let counted = batch.targets.iter().filter(|&&t| t != pad).count();
    let work = |index: usize| -> Result<(f64, Gradients)> {
        let part = index * rows * context..((index + 1) * rows * context).min(batch.inputs.len());
        let ids = Tensor::from_slice(&batch.inputs[part.clone()], (part.len() / context, context), &Device::Cpu)?;
        let dropout = dropout.map(|d| Dropout { first: (index * rows) as u64, ..d });
        let loss = model.loss_sum(&ids, &batch.targets[part], dropout.as_ref())?;
        let loss = (loss / counted.max(1) as f64)?;
        let value = loss.to_scalar::<f32>()? as f64;
        if !value.is_finite() {
            return Ok((value, Gradients::new()));
        }
        Ok((value, gradients(model, &loss)?))
    };
    let (mut loss, mut sum) = (0.0, Gradients::new());
    let mut take = |index: usize, (value, gradients): (f64, Gradients)| {
        if !value.is_finite() {
            let clips = batch.clips.iter().skip(index * rows).take(rows);
            let clips: Vec<&str> = clips.map(String::as_str).collect();
            return Err(Error::Call(format!("the loss is {value} on {}", clips.join(", "))));
        }
        loss += value;
        add(&mut sum, gradients);
        Ok(())
    };
    workers.each(windows.div_ceil(rows), &work, &mut take)?;
    Ok(Step { loss, counted, gradients: sum })
}

/// The gradient of every variable, in the order of their names.
fn gradients(model: &Gpt, loss: &Tensor) -> Result<Gradients> {
    let mut store = loss.backward()?;
    let of = |(name, var): (&String, &candle_core::Var)| {
        let missing = || Error::Call(format!("variable {name} got no gradient: the graph is cut before it"));
        let gradient = store.remove(var.as_tensor()).ok_or_else(missing)?;
        Ok(ops::with_slice(&gradient, |g: &[f32]| Ok(g.to_vec()))?)
    };
    model.vars().iter().map(of).collect()
}

fn add(sum: &mut Gradients, gradients: Gradients) {
    if sum.is_empty() {
        *sum = gradients;
        return;
    }
    for (sum, gradient) in sum.iter_mut().zip(gradients) {
        for (s, g) in sum.iter_mut().zip(gradient) {
            *s += g;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::corpus::Split;
    use crate::model::ModelConfig;
    use crate::train::batches::Batches;
    use crate::train::fixture;

    fn setup(context: usize) -> (tempfile::TempDir, Gpt, Batch) {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::corpus(dir.path(), &[(90, Split::Train), (3, Split::Train)]);
        let model = ModelConfig { layers: 2, heads: 2, width: 64, context, ..Default::default() };
        let gpt = Gpt::new(&model, &fixture::TOKENS, 1).unwrap();
        let batch = Batches::new(&corpus, context, 5, 1).unwrap().batch(0);
        (dir, gpt, batch)
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        // wide enough that the products inside are split over threads too
        let (_dir, gpt, batch) = setup(260);
        let dropout = Dropout { share: 0.1, seed: 1, step: 0, first: 0 };
        let run = |threads| {
            let s = step(&gpt, &Workers::new(Some(threads), 2).unwrap(), &batch, Some(dropout)).unwrap();
            (s.loss.to_bits(), s.gradients.iter().flatten().map(|g| g.to_bits()).collect::<Vec<_>>())
        };
        let one = run(1);
        for threads in [2, 3, 5] {
            assert!(run(threads) == one, "{threads} threads");
        }
    }

    #[test]
    #[ignore = "prints what the next test compares, in a process of its own"]
    fn bits_of_a_step() {
        let (_dir, gpt, batch) = setup(260);
        let s = step(&gpt, &Workers::new(None, 2).unwrap(), &batch, None).unwrap();
        let bytes: Vec<u8> = s.gradients.iter().flatten().flat_map(|g| g.to_le_bytes()).collect();
        println!("bits {} {}", s.loss.to_bits(), crate::corpus::FileRecord::of(&bytes).sha256);
    }

    #[test]
    fn the_library_s_own_threads_change_no_bit() {
        let run = |rayon: &str, candle: &str| {
            let test = ["--ignored", "--exact", "train::step::tests::bits_of_a_step", "--nocapture"];
            let out = std::process::Command::new(std::env::current_exe().unwrap())
                .args(test)
                .env("RAYON_NUM_THREADS", rayon)
                .env("CANDLE_NUM_THREADS", candle)
                .output()
                .unwrap();
            let text = String::from_utf8(out.stdout).unwrap();
            text.lines().find(|l| l.starts_with("bits ")).expect("the test prints its bits").to_string()
        };
        let one = run("1", "1");
        for (rayon, candle) in [("2", "2"), ("3", "1"), ("7", "3")] {
            assert_eq!(run(rayon, candle), one, "{rayon} and {candle} threads");
        }
    }

    #[test]
    fn pieces_sum_to_the_whole() {
        let (_dir, gpt, batch) = setup(300);
        let s = step(&gpt, &Workers::new(Some(2), 2).unwrap(), &batch, None).unwrap();
        let ids = Tensor::from_slice(&batch.inputs, (5, 300), &Device::Cpu).unwrap();
        let whole = gpt.loss(&ids, &batch.targets, None).unwrap();
        assert!((s.loss - whole.to_scalar::<f32>().unwrap() as f64).abs() < 1e-6);
        for (name, (part, all)) in gpt.vars().keys().zip(s.gradients.iter().zip(gradients(&gpt, &whole).unwrap())) {
            let apart = part.iter().zip(&all).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(apart < 1e-6, "{name}: {apart}");
        }
    }

    #[test]
    fn a_loss_that_is_not_finite_names_its_clips() {
        let (_dir, gpt, batch) = setup(260);
        gpt.vars()["norm.bias"].set(&Tensor::full(f32::NAN, 64, &Device::Cpu).unwrap()).unwrap();
        let message = step(&gpt, &Workers::new(Some(1), 1).unwrap(), &batch, None).unwrap_err().to_string();
        assert!(message.starts_with("the loss is NaN on clip"), "{message}");
        assert!(batch.clips[..3].iter().all(|c| message.contains(c.as_str())), "{message}");
    }
}
