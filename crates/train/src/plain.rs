//! The plain form as it learns: the tensor library's gradients, on any device.

use super::adamw::AdamW;
use super::batches::Batch;
use super::config::TrainConfig;
use super::ema;
use super::learner::{BatchLoss, Learner, no_average, not_finite};
use crate::{Error, Result};
use candle_core::{DType, Tensor};
use kinelm_model::weights::{Weights, in_order};
use kinelm_model::{Dropout, Gpt, ModelConfig, Scores, layout};

/// Attention scores of one layer that are computed at a time; the graph holds about six such tensors per layer.
const PIECE_SCORES: usize = 1 << 24;

/// The plain form and its optimizer.
pub struct Plain {
    model: Gpt,
    optimizer: AdamW,
    dropout: Option<Dropout>,
    /// Gradients of the last step, in the order of the variables.
    gradients: Vec<Tensor>,
    /// The moving average of the weights, in that order, and its decay.
    averages: Option<(Vec<Tensor>, f64)>,
    /// Updates done.
    step: u64,
}

impl Plain {
    /// Before the first update, on the model's device.
    ///
    /// # Errors
    /// Errors of the device.
    pub fn new(mut model: Gpt, train: &TrainConfig) -> Result<Plain> {
        model.smooth_targets(train.smoothing());
        let share = model.config().dropout;
        let dropout = (share > 0.0).then_some(Dropout { share, seed: train.seed, step: 0, first: 0 });
        let zeros = || model.vars().values().map(|v| Ok(v.zeros_like()?)).collect::<Result<Vec<_>>>();
        let averages = if train.ema > 0.0 { Some((zeros()?, train.ema)) } else { None };
        let optimizer = AdamW::new(&model, train)?;
        Ok(Plain { optimizer, model, dropout, gradients: Vec::new(), averages, step: 0 })
    }

    /// The last gradients, by the names of their variables.
    #[cfg(test)]
    pub fn gradients_by_name(&self) -> impl Iterator<Item = (&str, &Tensor)> {
        self.model.vars().keys().map(String::as_str).zip(&self.gradients)
    }

    /// Adds the gradients of `loss`.
    fn add_gradients(&mut self, loss: &Tensor) -> Result<()> {
        let mut store = loss.backward()?;
        let mut found = Vec::with_capacity(self.model.vars().len());
        for (i, (name, var)) in self.model.vars().iter().enumerate() {
            let missing = || Error::Weights(format!("variable {name} got no gradient: the graph is cut before it"));
            let gradient = match store.remove(var.as_tensor()) {
                // a batch may have no goals
                // all other tensors are in every graph: a missing gradient means that an operation cut it
                None if layout::GOAL.contains(&name.as_str()) => var.zeros_like()?,
                // an attached gradient would keep the graph alive
                found => found.ok_or_else(missing)?.detach(),
            };
            found.push(match self.gradients.get(i) {
                Some(before) => (before + gradient)?,
                None => gradient,
            });
        }
        self.gradients = found;
        Ok(())
    }
}

/// The number of windows of `length` tokens that are computed together.
fn piece(config: &ModelConfig, length: usize) -> usize {
    (PIECE_SCORES / (config.heads * length * length).max(1)).max(1)
}

impl Plain {
    /// Adds the gradients of one batch, whose windows have the numbers from `before` on in their step, over the `counted`
    /// targets of the step. Returns its part of the loss.
    fn add_batch(&mut self, batch: &Batch, step: u64, before: u64, counted: usize) -> Result<f64> {
        let length = batch.length();
        let rows = piece(self.model.config(), length);
        let mut sum = 0.0;
        for (first, clips) in (0..).step_by(rows).zip(batch.clips.chunks(rows)) {
            let part = first * length..(first + clips.len()) * length;
            let dropout = self.dropout.map(|d| Dropout { step, first: before + first as u64, ..d });
            let ids = self.model.ids(&batch.inputs[part.clone()], length)?;
            let before = batch.history.len() / batch.clips.len().max(1);
            let history = &batch.history[first * before..(first + clips.len()) * before];
            let conditioning = batch
                .conditioning
                .as_ref()
                .map(|conditioning| conditioning.windows(first..first + clips.len(), batch.clips.len()));
            let loss = self.model.loss_sum_conditioned(
                &ids,
                &batch.targets[part],
                dropout.as_ref(),
                history,
                conditioning.as_ref(),
            )?;
            // by the targets of the whole step, so that the pieces' gradients add up to the mean's
            let loss = (loss / counted.max(1) as f64)?;
            let value = loss.to_scalar::<f32>()? as f64;
            if !value.is_finite() {
                return Err(not_finite(value, clips));
            }
            sum += value;
            self.add_gradients(&loss)?;
        }
        Ok(sum)
    }
}

impl Learner for Plain {
    fn scores(&mut self) -> &mut dyn Scores {
        &mut self.model
    }

    fn gradients_of(&mut self, batches: &[Batch], step: u64) -> Result<BatchLoss> {
        let counted = batches.iter().map(|b| b.counted(self.model.tokens().pad)).sum();
        self.gradients.clear();
        let (mut loss, mut before) = (0.0, 0);
        for batch in batches {
            loss += self.add_batch(batch, step, before, counted)?;
            before += batch.clips.len() as u64;
        }
        Ok(BatchLoss { loss, counted, norm: norm(&self.gradients)? })
    }

    fn update(&mut self, share: f64, rate: f64) -> Result<()> {
        self.optimizer.update(&self.model, &self.gradients, share, rate)?;
        self.step += 1;
        if let Some((averages, decay)) = &mut self.averages {
            let share = ema::share(*decay, self.step);
            for (average, var) in averages.iter_mut().zip(self.model.vars().values()) {
                *average = (&*average + ((var.as_detached_tensor() - &*average)? * share)?)?;
            }
        }
        Ok(())
    }

    fn weights(&self) -> Result<Weights> {
        self.model.weights()
    }

    fn moments(&self) -> Result<Weights> {
        self.optimizer.moments()
    }

    fn restore(&mut self, moments: &Weights, step: u64) -> Result<()> {
        self.step = step;
        self.optimizer.restore(moments, step)
    }

    fn averages(&self) -> Result<Option<Weights>> {
        let Some((averages, _)) = &self.averages else { return Ok(None) };
        Ok(Some(self.model.named(averages.iter())?))
    }

    fn restore_averages(&mut self, averages: &Weights) -> Result<()> {
        let (own, _) = self.averages.as_mut().ok_or_else(no_average)?;
        let parameters = layout::parameters(self.model.config(), self.model.tokens());
        let all = in_order("average", &parameters, averages, |p| p.name.clone())?;
        *own = all.iter().map(|array| array.tensor(self.model.device())).collect::<Result<_>>()?;
        Ok(())
    }

    fn swap_averages(&mut self) -> Result<()> {
        if let Some((averages, _)) = &mut self.averages {
            for (average, var) in averages.iter_mut().zip(self.model.vars().values()) {
                let weights = var.as_detached_tensor().copy()?;
                var.set(&std::mem::replace(average, weights))?;
            }
        }
        Ok(())
    }
}

/// Euclidean norm over all gradients.
fn norm(gradients: &[Tensor]) -> Result<f64> {
    // in f64: f32 sums of millions of squares lose digits, and squares of numbers above 1e19 overflow
    let squares = |g: &Tensor| g.to_dtype(DType::F64)?.sqr()?.sum_all();
    let squares = gradients.iter().map(squares).collect::<candle_core::Result<Vec<_>>>()?;
    Ok(Tensor::stack(&squares, 0)?.sum_all()?.to_scalar::<f64>()?.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batches::Batches;
    use crate::{Data, fixture};
    use candle_core::Device;
    use kinelm_corpus::Split;

    fn setup(context: usize, dropout: f64) -> (tempfile::TempDir, Plain, Batch) {
        let dir = tempfile::tempdir().unwrap();
        let data = Data::one(fixture::corpus(dir.path(), &[(90, Split::Train), (3, Split::Train)])).unwrap();
        let config = ModelConfig { layers: 2, heads: 2, width: 64, context, dropout, ..Default::default() };
        let gpt = Gpt::new(&config, &fixture::TOKENS, 1).unwrap();
        let train = TrainConfig { batch: 5, ..Default::default() };
        let batch = Batches::new(&data, context, &train).unwrap().batch(0).unwrap();
        (dir, Plain::new(gpt, &TrainConfig::default()).unwrap(), batch)
    }

    fn bits(plain: &Plain) -> Vec<u32> {
        let numbers = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        plain.gradients_by_name().flat_map(|(_, g)| numbers(g)).map(f32::to_bits).collect()
    }

    #[test]
    #[ignore = "prints what the next test compares, in a process of its own"]
    fn bits_of_a_step() {
        // wide enough that the products inside are split over threads
        let (_dir, mut plain, batch) = setup(260, 0.1);
        let found = plain.gradients(&batch, 0).unwrap();
        plain.update(1.0, 1e-3).unwrap();
        let bytes: Vec<u8> = bits(&plain).iter().flat_map(|g| g.to_le_bytes()).collect();
        let weights = kinelm_model::weights::to_bytes(&plain.weights().unwrap());
        let hash = |bytes: &[u8]| kinelm_store::FileRecord::of(bytes).sha256;
        let numbers = (found.loss.to_bits(), found.norm.to_bits());
        println!("bits {numbers:?} {} {}", hash(&bytes), hash(&weights.unwrap()));
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let run = |rayon: &str, candle: &str| {
            let test = ["--ignored", "--exact", "plain::tests::bits_of_a_step", "--nocapture"];
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
        for (rayon, candle) in [("2", "2"), ("7", "3")] {
            assert_eq!(run(rayon, candle), one, "{rayon} and {candle} threads");
        }
    }

    #[test]
    fn pieces_sum_to_the_whole() {
        let (_dir, mut plain, batch) = setup(300, 0.0);
        let whole = plain.gradients(&batch, 0).unwrap();
        let gradients = plain.gradients.clone();
        plain.gradients.clear();
        let mut loss = 0.0;
        for i in 0..5 {
            let part = i * 300..(i + 1) * 300;
            let ids = plain.model.ids(&batch.inputs[part.clone()], 300).unwrap();
            let sum = plain.model.loss_sum(&ids, &batch.targets[part], None).unwrap();
            let mean = (sum / whole.counted as f64).unwrap();
            loss += mean.to_scalar::<f32>().unwrap() as f64;
            plain.add_gradients(&mean).unwrap();
        }
        assert!((loss - whole.loss).abs() < 1e-6);
        for ((name, part), all) in plain.gradients_by_name().zip(&gradients) {
            let error = (part - all).unwrap().abs().unwrap().max_all().unwrap().to_scalar::<f32>().unwrap();
            assert!(error < 1e-6, "{name}: {error}");
        }
        assert!((norm(&plain.gradients).unwrap() - whole.norm).abs() < 1e-5);
        let two = [Tensor::new(&[3f32], &Device::Cpu).unwrap(), Tensor::new(&[[0f32], [4.0]], &Device::Cpu).unwrap()];
        assert_eq!(norm(&two).unwrap(), 5.0);
    }

    #[test]
    fn a_loss_that_is_not_finite_names_its_clips() {
        let (_dir, mut plain, batch) = setup(260, 0.0);
        plain.model.vars()["norm.bias"].set(&Tensor::full(f32::NAN, 64, &Device::Cpu).unwrap()).unwrap();
        let message = plain.gradients(&batch, 0).unwrap_err().to_string();
        assert!(message.starts_with("the loss is NaN on clip"), "{message}");
        assert!(batch.clips.iter().all(|c| message.contains(c.as_str())), "{message}");
    }

    #[test]
    fn a_long_context_is_computed_in_pieces() {
        let config = |context| ModelConfig { heads: 8, context, ..Default::default() };
        assert_eq!((piece(&config(1024), 1024), piece(&config(256), 256)), (2, 32));
        assert_eq!(piece(&config(1 << 20), 1 << 20), 1);
    }
}
