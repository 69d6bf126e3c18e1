//! The network: linear layers over spectra, LSTM layers, and one whose units are the joints' quaternions.
//!
//! Linear layers have ReLUs between them (ours: the dissertation doesn't say). In training there is dropout between LSTM
//! layers. Users of the last layer's outputs normalise them; the layer reads its own outputs unnormalised.

use super::SPECTRUM;
use super::config::Shape;
use crate::train::{parameter, uniform};
use kinelm_engine::arena::Floats;
use kinelm_engine::block::Linear;
use kinelm_engine::dense;
use kinelm_engine::linear::Products;
use kinelm_engine::lstm::{Single, TeacherForcing};
use kinelm_engine::op::dropout;
use kinelm_model::layout::Parameter;
use rayon::prelude::*;

/// The mean and deviation of the spectra, before the tensors that learn: their gradients stay 0.
const SCALE: usize = 2;

/// The tensors by name.
pub fn list(shape: &Shape) -> Vec<Parameter> {
    let scale = ["audio.mean", "audio.deviation"].map(|name| (name.to_owned(), [1, SPECTRUM]));
    let linear = shape.linear().into_iter().enumerate().flat_map(|(i, [inputs, outputs])| {
        [(format!("linear.{i:02}.weight"), [inputs, outputs]), (format!("linear.{i:02}.bias"), [1, outputs])]
    });
    let recurrent = shape.recurrent().into_iter().enumerate().flat_map(|(l, [inputs, width])| {
        let layer = if l == shape.layers { "joints".to_owned() } else { format!("layer.{l:02}") };
        let names = ["input.weight", "own.weight", "input.bias", "own.bias"].map(|name| format!("{layer}.{name}"));
        names.into_iter().zip(Single::tensors(inputs, width)).collect::<Vec<_>>()
    });
    let all = scale.into_iter().chain(linear).chain(recurrent);
    all.map(|(name, size)| parameter(name, size)).collect()
}

/// Weights before training, as in PyTorch: uniform over +-1 / sqrt(inputs) for linear layers, +-1 / sqrt(units) for LSTM
/// layers. `scale`: mean and deviation of each number of the spectra.
pub fn initial(shape: &Shape, scale: [Vec<f32>; 2], seed: u64) -> Vec<Floats> {
    // in PyTorch a layer's weight and bias share one bound
    let linear = shape.linear().into_iter().flat_map(|[inputs, _]| [inputs; 2]);
    let over = linear.chain(shape.recurrent().into_iter().flat_map(|[_, width]| [width; 4]));
    let sizes = list(shape).into_iter().skip(SCALE).map(|p| p.len());
    let learned = sizes.zip(over).enumerate();
    let of = |(i, (len, over)): (usize, (usize, usize))| {
        uniform("music lstm weights", i, len, 1.0 / (over as f64).sqrt(), seed)
    };
    scale.iter().map(|numbers| Floats::of(numbers)).chain(learned.map(of)).collect()
}

/// The memory of a pass over T steps of B sequences.
pub struct Network {
    shape: Shape,
    linear: Vec<Dense>,
    recurrent: Vec<Single>,
    /// (T, B, D) outputs of LSTM layers, after dropout.
    hidden: Vec<Floats>,
    /// Their gradients.
    d_hidden: Option<Vec<Floats>>,
}

struct Dense {
    space: dense::Workspace,
    /// (T B, M) outputs, after the ReLU except in the last layer.
    out: Floats,
    /// (T B, M) gradients of the outputs.
    d_out: Option<Floats>,
}

/// Dropout between layers.
#[derive(Debug, Clone, Copy)]
pub struct Dropout<'a> {
    /// The share of dropped numbers.
    pub share: f64,
    /// (L) keys.
    pub keys: &'a [u64],
}

impl Network {
    /// Memory for a pass; `backward`: for gradients too.
    ///
    /// # Panics
    /// A size of 0.
    pub fn new(shape: &Shape, batch: usize, steps: usize, backward: bool) -> Network {
        let rows = batch * steps;
        let linear = shape.linear().into_iter().map(|[inputs, outputs]| Dense {
            space: dense::Workspace::new(rows, inputs, outputs, Products::F32, backward),
            out: Floats::new(rows * outputs),
            d_out: backward.then(|| Floats::new(rows * outputs)),
        });
        let sizes = shape.recurrent();
        let hidden = || sizes[1..].iter().map(|[inputs, _]| Floats::new(rows * inputs)).collect::<Vec<_>>();
        Network {
            shape: shape.clone(),
            linear: linear.collect(),
            recurrent: sizes
                .iter()
                .map(|[inputs, width]| Single::new(*inputs, *width, batch, steps, backward))
                .collect(),
            d_hidden: backward.then(hidden),
            hidden: hidden(),
        }
    }

    /// Takes weights, in the order of [`list`]: before the first pass and after every update.
    ///
    /// # Panics
    /// Tensors of another shape, here and below.
    pub fn pack(&mut self, weights: &[Floats]) {
        let first = SCALE + 2 * self.linear.len();
        // the linear layers read their weights as they are
        self.recurrent.iter_mut().zip(weights[first..].chunks_exact(4)).for_each(|(layer, four)| layer.pack(four));
    }

    /// The next pass begins at the zero state.
    pub fn rest(&mut self) {
        self.recurrent.iter_mut().for_each(Single::rest);
    }

    /// The next pass continues from the end of the last one.
    pub fn carry(&mut self) {
        self.recurrent.iter_mut().for_each(Single::carry);
    }

    /// Outputs (T, B, 4J) of standardised `spectra` (T, B, N), T as in [`Network::new`]. At teacher-forced steps the joints'
    /// layer reads the given rows (T, B, 4J) in place of its previous output.
    pub fn forward(&mut self, weights: &[Floats], spectra: &[f32], forced: TeacherForcing, dropout: Dropout) -> &[f32] {
        let last = self.linear.len() - 1;
        for i in 0..self.linear.len() {
            let (below, own) = self.linear.split_at_mut(i);
            let (x, own) = (below.last().map_or(spectra, |below| &below.out), &mut own[0]);
            let [weight, bias] = [0, 1].map(|k| &*weights[SCALE + 2 * i + k]);
            dense::forward(&mut own.out, x, Linear { weight, bias }, &mut own.space);
            if i < last {
                own.out.iter_mut().for_each(|y| *y = y.max(0.0));
            }
        }
        let layers = self.shape.layers;
        for l in 0..layers {
            // no dropout before the first LSTM layer, and none after the joints'
            let x = if l == 0 { &self.linear[last].out } else { &self.hidden[l - 1] };
            let out = self.recurrent[l].forward(x, TeacherForcing::NONE);
            self.hidden[l].copy_from_slice(out);
            drop_out(&mut self.hidden[l], self.shape.width, l, dropout);
        }
        self.recurrent[layers].forward(&self.hidden[layers - 1], forced)
    }

    /// Gradients of the weights, in the order of [`list`], from those of the last pass's outputs (T, B, 4J), with the same
    /// `spectra` and `dropout`.
    pub fn backward(
        &mut self,
        weights: &[Floats],
        outputs: &[f32],
        spectra: &[f32],
        dropout: Dropout,
        gradients: &mut [Floats],
    ) {
        let Some(d_hidden) = &mut self.d_hidden else { panic!("memory for the forward pass only") };
        let (layers, last) = (self.shape.layers, self.linear.len() - 1);
        let first = SCALE + 2 * self.linear.len();
        let (of_linear, of_recurrent) = gradients.split_at_mut(first);
        for l in (0..=layers).rev() {
            let own = &mut of_recurrent[4 * l..4 * l + 4];
            let (below, above) = d_hidden.split_at_mut(l);
            let d_out = if l == layers { outputs } else { &above[0] };
            let (x, dx) = match l {
                0 => {
                    let Dense { out, d_out: Some(d_out), .. } = &mut self.linear[last] else { return };
                    (&*out, d_out)
                }
                _ => (&self.hidden[l - 1], &mut below[l - 1]),
            };
            self.recurrent[l].backward(d_out, x, dx, own);
            if l > 0 {
                // the same key as forward: gradients are dropped where outputs were
                drop_out(&mut below[l - 1], self.shape.width, l - 1, dropout);
            }
        }
        for i in (0..=last).rev() {
            let [weight, bias] = &mut of_linear[SCALE + 2 * i..SCALE + 2 * i + 2] else { return };
            let (below, own) = self.linear.split_at_mut(i);
            let (below, own) = (below.last_mut(), &mut own[0]);
            let Some(d_out) = &own.d_out else { return };
            let (to, with) = (Linear { weight: &mut **weight, bias: &mut **bias }, &weights[SCALE + 2 * i]);
            match below {
                None => dense::backward(None, d_out, spectra, with, to, &mut own.space),
                Some(Dense { out, d_out: Some(dx), .. }) => {
                    dense::backward(Some(dx), d_out, out, with, to, &mut own.space);
                    // the ReLU's slope: outputs of 0 had none
                    dx.iter_mut().zip(out.iter()).filter(|(_, y)| **y <= 0.0).for_each(|(d, _)| *d = 0.0);
                }
                Some(_) => return,
            }
        }
    }
}

fn drop_out(x: &mut [f32], width: usize, layer: usize, dropout: Dropout) {
    let Some(key) = dropout.keys.get(layer).filter(|_| dropout.share > 0.0) else { return };
    x.par_chunks_mut(width).enumerate().for_each(|(row, x)| dropout::apply(x, *key, row as u64, 0, dropout.share));
}

/// Standardises spectra (.., N) by the mean and deviation among the weights.
pub fn standardise(weights: &[Floats], spectra: &mut [f32]) {
    let [mean, deviation] = [0, 1].map(|k| &*weights[k]);
    spectra.par_chunks_mut(SPECTRUM).for_each(|frame| {
        frame.iter_mut().zip(mean.iter().zip(deviation)).for_each(|(x, (m, d))| *x = (*x - m) / d);
    });
}
