//! The network: linear layers over spectra, layers of LSTM, and one whose units are the joints' quaternions.
//!
//! Linear layers have a rectifier between them (ours: the dissertation doesn't say). Numbers between layers of LSTM are
//! dropped in training. The outputs of the last layer are made unit quaternions by whoever uses them; what it sees of its
//! own is as it came out.

use super::HEARD;
use super::config::Shape;
use crate::aclstm::network::even;
use kinelm_engine::arena::Floats;
use kinelm_engine::block::Linear;
use kinelm_engine::dense;
use kinelm_engine::linear::Products;
use kinelm_engine::lstm::{Single, TeacherForcing};
use kinelm_engine::op::dropout;
use kinelm_train::parameters::List;
use rayon::prelude::*;

/// Tensors of the numbers that spectra are standardised by, in front of those that learn: their gradients stay 0.
const STANDARD: usize = 2;

/// The tensors by name.
pub fn list(shape: &Shape) -> List {
    let standard = ["audio.mean", "audio.deviation"].map(|name| (name.to_owned(), [1, HEARD]));
    let linear = shape.linear().into_iter().enumerate().flat_map(|(i, [inputs, outputs])| {
        [(format!("linear.{i:02}.weight"), [inputs, outputs]), (format!("linear.{i:02}.bias"), [1, outputs])]
    });
    let recurrent = shape.recurrent().into_iter().enumerate().flat_map(|(l, [inputs, width])| {
        let layer = if l == shape.layers { "joints".to_owned() } else { format!("layer.{l:02}") };
        let names = ["input.weight", "own.weight", "input.bias", "own.bias"].map(|name| format!("{layer}.{name}"));
        names.into_iter().zip(Single::tensors(inputs, width)).collect::<Vec<_>>()
    });
    standard.into_iter().chain(linear).chain(recurrent).collect()
}

/// Weights before training, as PyTorch's layers begin: even over +-1 / sqrt(inputs) of a linear layer, +-1 / sqrt(units)
/// of one of LSTM. `standard`: mean and deviation of each number of the spectra.
pub fn initial(shape: &Shape, standard: [Vec<f32>; 2], seed: u64) -> Vec<Floats> {
    let linear = shape.linear().into_iter().flat_map(|[inputs, _]| [inputs; 2]);
    let over = linear.chain(shape.recurrent().into_iter().flat_map(|[_, width]| [width; 4]));
    let sizes = list(shape).into_iter().skip(STANDARD).map(|(_, [rows, columns])| rows * columns);
    let learned = sizes.zip(over).enumerate();
    let of = |(i, (len, over)): (usize, (usize, usize))| {
        even(("music lstm weights", i), len, 1.0 / (over as f64).sqrt(), seed)
    };
    standard.iter().map(|numbers| Floats::of(numbers)).chain(learned.map(of)).collect()
}

/// The memory of a pass over T steps of B sequences.
pub struct Network {
    shape: Shape,
    rows: usize,
    linear: Vec<Dense>,
    recurrent: Vec<Single>,
    /// (T, B, D) what stands between layers of LSTM, after dropping.
    between: Vec<Floats>,
    back: Option<Vec<Floats>>,
}

struct Dense {
    space: dense::Workspace,
    /// (T B, M) outputs, rectified but for the last layer's.
    out: Floats,
    /// (T B, M), of the outputs.
    d_out: Option<Floats>,
}

/// What is dropped between layers: the share, and a key for each.
#[derive(Debug, Clone, Copy)]
pub struct Dropped<'a> {
    /// 0: nothing is.
    pub share: f64,
    /// (L).
    pub keys: &'a [u64],
}

impl Network {
    /// Memory; `backward`: for gradients too.
    ///
    /// # Panics
    /// A size of 0.
    pub fn new(shape: &Shape, (batch, steps): (usize, usize), backward: bool) -> Network {
        let rows = batch * steps;
        let linear = shape.linear().into_iter().map(|[inputs, outputs]| Dense {
            space: dense::Workspace::new(rows, inputs, outputs, Products::F32, backward),
            out: Floats::new(rows * outputs),
            d_out: backward.then(|| Floats::new(rows * outputs)),
        });
        let sizes = shape.recurrent();
        let between = || sizes[1..].iter().map(|[inputs, _]| Floats::new(rows * inputs)).collect::<Vec<_>>();
        Network {
            shape: shape.clone(),
            rows,
            linear: linear.collect(),
            recurrent: sizes
                .iter()
                .map(|[inputs, width]| Single::new(*inputs, *width, (batch, steps), backward))
                .collect(),
            back: backward.then(between),
            between: between(),
        }
    }

    /// Takes over weights, in the order of [`list`]: before the first pass and after every update.
    ///
    /// # Panics
    /// Tensors of another shape, here and below.
    pub fn pack(&mut self, weights: &[Floats]) {
        let first = STANDARD + 2 * self.linear.len();
        self.recurrent.iter_mut().zip(weights[first..].chunks_exact(4)).for_each(|(layer, four)| layer.pack(four));
    }

    /// The next pass begins at rest.
    pub fn rest(&mut self) {
        self.recurrent.iter_mut().for_each(Single::rest);
    }

    /// The next pass goes on where the last one ended.
    pub fn carry(&mut self) {
        self.recurrent.iter_mut().for_each(Single::carry);
    }

    /// Outputs (T, B, 4J) of standardised spectra `heard` (T, B, N), with all steps that there is memory for. At steps that
    /// are told something the joints' layer sees that, (T, B, 4J), in place of its own output before.
    pub fn forward(&mut self, weights: &[Floats], heard: &[f32], forced: TeacherForcing, dropped: Dropped) -> &[f32] {
        let last = self.linear.len() - 1;
        for i in 0..self.linear.len() {
            let (below, own) = self.linear.split_at_mut(i);
            let (x, own) = (below.last().map_or(heard, |below| &below.out), &mut own[0]);
            let [weight, bias] = [0, 1].map(|k| &*weights[STANDARD + 2 * i + k]);
            dense::forward(&mut own.out, x, Linear { weight, bias }, &mut own.space);
            if i < last {
                own.out.iter_mut().for_each(|y| *y = y.max(0.0));
            }
        }
        let layers = self.shape.layers;
        for l in 0..layers {
            let x = if l == 0 { &self.linear[last].out } else { &self.between[l - 1] };
            let out = self.recurrent[l].forward(x, TeacherForcing::NONE);
            self.between[l].copy_from_slice(out);
            drop_some(&mut self.between[l], self.shape.width, l, dropped);
        }
        self.recurrent[layers].forward(&self.between[layers - 1], forced)
    }

    /// Gradients of the weights, in the order of [`list`], by those of the last pass's outputs (T, B, 4J), which had
    /// `heard` and `dropped`.
    pub fn backward(
        &mut self,
        weights: &[Floats],
        outputs: &[f32],
        heard: &[f32],
        dropped: Dropped,
        gradients: &mut [Floats],
    ) {
        let Some(back) = &mut self.back else { panic!("memory for the forward pass only") };
        let (layers, last) = (self.shape.layers, self.linear.len() - 1);
        let first = STANDARD + 2 * self.linear.len();
        let (of_linear, of_recurrent) = gradients.split_at_mut(first);
        for l in (0..=layers).rev() {
            let own = &mut of_recurrent[4 * l..4 * l + 4];
            let (below, above) = back.split_at_mut(l);
            let d_out = if l == layers { outputs } else { &above[0] };
            let (x, dx) = match l {
                0 => {
                    let Dense { out, d_out: Some(d_out), .. } = &mut self.linear[last] else { return };
                    (&*out, d_out)
                }
                _ => (&self.between[l - 1], &mut below[l - 1]),
            };
            self.recurrent[l].backward(d_out, x, dx, own);
            if l > 0 {
                drop_some(&mut below[l - 1], self.shape.width, l - 1, dropped);
            }
        }
        for i in (0..=last).rev() {
            let [weight, bias] = &mut of_linear[STANDARD + 2 * i..STANDARD + 2 * i + 2] else { return };
            let (below, own) = self.linear.split_at_mut(i);
            let (below, own) = (below.last_mut(), &mut own[0]);
            let Some(d_out) = &own.d_out else { return };
            let (to, with) = (Linear { weight: &mut **weight, bias: &mut **bias }, &weights[STANDARD + 2 * i]);
            match below {
                None => dense::backward(None, d_out, heard, with, to, &mut own.space),
                Some(Dense { out, d_out: Some(dx), .. }) => {
                    dense::backward(Some(dx), d_out, out, with, to, &mut own.space);
                    dx.iter_mut().zip(out.iter()).filter(|(_, y)| **y <= 0.0).for_each(|(d, _)| *d = 0.0);
                }
                Some(_) => return,
            }
        }
    }

    /// T B.
    pub fn rows(&self) -> usize {
        self.rows
    }
}

fn drop_some(x: &mut [f32], width: usize, layer: usize, dropped: Dropped) {
    let Some(key) = dropped.keys.get(layer).filter(|_| dropped.share > 0.0) else { return };
    x.par_chunks_mut(width).enumerate().for_each(|(row, x)| dropout::apply(x, *key, row as u64, 0, dropped.share));
}

/// Standardises spectra (.., N) by the numbers that stand in front of the weights.
pub fn standardise(weights: &[Floats], heard: &mut [f32]) {
    let [mean, deviation] = [0, 1].map(|k| &*weights[k]);
    heard.par_chunks_mut(HEARD).for_each(|frame| {
        frame.iter_mut().zip(mean.iter().zip(deviation)).for_each(|(x, (m, d))| *x = (*x - m) / d);
    });
}
