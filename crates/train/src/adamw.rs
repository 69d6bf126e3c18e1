//! AdamW from plain tensor operations, on the model's device; moments in f32. The oracle of [`super::optimizer`].
//!
//! Source: Loshchilov and Hutter, "Decoupled weight decay regularization" (2019); the order of operations is PyTorch's.

use super::config::TrainConfig;
use super::optimizer::MOMENTS;
use crate::{Error, Result};
use candle_core::{DType, Tensor};
use kinelm_model::layout::{Parameter, Role};
use kinelm_model::weights::{Array, Weights, in_order};
use kinelm_model::{Gpt, layout};

/// The moments of all variables.
pub struct AdamW {
    parameters: Vec<Parameter>,
    moments: Vec<[Tensor; 2]>,
    betas: [f64; 2],
    epsilon: f64,
    weight_decay: f64,
    table_rate: f64,
    /// Updates done.
    step: u64,
}

impl AdamW {
    /// Before the first update.
    ///
    /// # Errors
    /// No memory on the device.
    pub fn new(model: &Gpt, config: &TrainConfig) -> Result<AdamW> {
        let parameters = layout::parameters(model.config(), model.tokens());
        let zeros = |p: &Parameter| Tensor::zeros(p.shape.as_slice(), DType::F32, model.device());
        let moments = parameters.iter().map(|p| Ok([zeros(p)?, zeros(p)?])).collect::<Result<_>>()?;
        let TrainConfig { betas, epsilon, weight_decay, table_rate, .. } = *config;
        Ok(AdamW { parameters, moments, betas, epsilon, weight_decay, table_rate, step: 0 })
    }

    /// Moves every variable of `model` by its gradient times `share`, at the learning rate `rate`, tables at theirs. The
    /// gradients are in the order of the variables' names.
    ///
    /// # Errors
    /// Gradients of another model.
    pub fn update(&mut self, model: &Gpt, gradients: &[Tensor], share: f64, rate: f64) -> Result<()> {
        if gradients.len() != self.parameters.len() {
            let (found, expected) = (gradients.len(), self.parameters.len());
            return Err(Error::Weights(format!("{found} gradients for {expected} variables")));
        }
        self.step += 1;
        let [b1, b2] = self.betas;
        let [correction1, correction2] = self.betas.map(|b| 1.0 - b.powf(self.step as f64));
        for ((parameter, [first, second]), gradient) in self.parameters.iter().zip(&mut self.moments).zip(gradients) {
            let g = (gradient * share)?;
            *first = ((&*first * b1)? + (&g * (1.0 - b1))?)?;
            *second = ((&*second * b2)? + (g.sqr()? * (1.0 - b2))?)?;
            // epsilon is added to the corrected root, as in PyTorch: the other order changes the first updates
            let root = ((second.sqrt()? / correction2.sqrt())? + self.epsilon)?;
            let (rate, decayed) = match parameter.role {
                Role::Vector => (rate, 1.0),
                Role::Matrix => (rate, 1.0 - rate * self.weight_decay),
                Role::Table => (rate * self.table_rate, 1.0),
            };
            let var = &model.vars()[&parameter.name];
            // decay before the step, and on the detached tensor: an update must not enter the next graph
            let x = (var.as_detached_tensor() * decayed)?;
            var.set(&(x - (&*first * (rate / correction1))?.div(&root)?)?)?;
        }
        Ok(())
    }

    /// The moments by name: `first.{name}` and `second.{name}`.
    ///
    /// # Errors
    /// Errors of the device.
    pub fn moments(&self) -> Result<Weights> {
        let mut all = Weights::new();
        for (p, moments) in self.parameters.iter().zip(&self.moments) {
            for (prefix, moment) in MOMENTS.iter().zip(moments) {
                all.insert(format!("{prefix}.{}", p.name), Array::of(moment)?);
            }
        }
        Ok(all)
    }

    /// Continues from the moments after `step` updates.
    ///
    /// # Errors
    /// Moments that are missing or of another shape, each named.
    pub fn restore(&mut self, all: &Weights, step: u64) -> Result<()> {
        for (i, prefix) in MOMENTS.iter().enumerate() {
            let name = |p: &Parameter| format!("{prefix}.{}", p.name);
            let all = in_order("optimizer", &self.parameters, all, name)?;
            for (moments, array) in self.moments.iter_mut().zip(all) {
                moments[i] = array.tensor(moments[i].device())?;
            }
        }
        self.step = step;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::Device;
    use kinelm_model::{ModelConfig, TokenLayout};

    #[test]
    fn two_updates_by_hand() {
        let tokens = TokenLayout {
            vocabulary: 11,
            word: 4,
            varying: false,
            front: 1,
            pad: 0,
            bos: 1,
            space: 5,
            places: Vec::new(),
        };
        let model = ModelConfig { layers: 1, heads: 1, width: 2, context: 10, ..Default::default() };
        let gpt = Gpt::new(&model, &tokens, 1).unwrap();
        let config = TrainConfig { betas: [0.9, 0.99], weight_decay: 0.5, table_rate: 3.0, ..Default::default() };
        let mut adamw = AdamW::new(&gpt, &config).unwrap();
        let numbers = |name: &str| gpt.vars()[name].flatten_all().unwrap().to_vec1::<f32>().unwrap();
        let names = ["block.00.mlp.up.weight", "token.weight", "norm.weight"];
        let before = names.map(numbers);
        let all = |x: f32| -> Vec<Tensor> {
            gpt.vars().values().map(|v| Tensor::full(x, v.shape(), &Device::Cpu).unwrap()).collect()
        };
        adamw.update(&gpt, &all(2.0), 0.5, 0.1).unwrap();
        adamw.update(&gpt, &all(-1.0), 1.0, 0.1).unwrap();
        // gradients 1 and -1: first moments 0.1, then 0.09 - 0.1 = -0.01; second ones 0.01, then 0.0199
        let moves = |x: f64, rate: f64, decay: f64| {
            let x = x * (1.0 - rate * decay) - rate * 1.0 / (1.0 + 1e-8);
            x * (1.0 - rate * decay) - rate * (-0.01 / 0.19) / ((0.0199f64 / 0.0199).sqrt() + 1e-8)
        };
        for ((name, before), (rate, decay)) in names.iter().zip(&before).zip([(0.1, 0.5), (0.3, 0.0), (0.1, 0.0)]) {
            for (x, &b) in numbers(name).iter().zip(before) {
                let expected = moves(b as f64, rate, decay);
                assert!((*x as f64 - expected).abs() < 2e-7, "{name}: {x}, expected {expected}");
            }
        }
        assert!(adamw.update(&gpt, &[], 1.0, 0.1).unwrap_err().to_string().contains("0 gradients"));
    }

    #[test]
    fn moments_are_restored_and_missing_ones_are_named() {
        let tokens = TokenLayout {
            vocabulary: 11,
            word: 4,
            varying: false,
            front: 1,
            pad: 0,
            bos: 1,
            space: 5,
            places: Vec::new(),
        };
        let model = ModelConfig { layers: 1, heads: 1, width: 2, context: 10, ..Default::default() };
        let gpt = Gpt::new(&model, &tokens, 1).unwrap();
        let mut adamw = AdamW::new(&gpt, &TrainConfig::default()).unwrap();
        let gradients: Vec<Tensor> = gpt.vars().values().map(|v| v.ones_like().unwrap()).collect();
        adamw.update(&gpt, &gradients, 1.0, 0.1).unwrap();
        let mut moments = adamw.moments().unwrap();
        let mut other = AdamW::new(&gpt, &TrainConfig::default()).unwrap();
        other.restore(&moments, 1).unwrap();
        assert_eq!((other.moments().unwrap(), other.step), (adamw.moments().unwrap(), 1));
        moments.remove("second.norm.bias");
        let message = other.restore(&moments, 1).unwrap_err().to_string();
        assert_eq!(message, "the optimizer has no second.norm.bias of shape [2]");
    }
}
