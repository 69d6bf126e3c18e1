//! Linear heads over the final vectors of some tokens, beside the heads over ids: those of classifiers.

use super::{Fast, Windows};
use crate::{Architecture, Dropout, Result};
use kinelm_engine::arena::Floats;
use kinelm_engine::bins::Bins;
use kinelm_engine::block::Norm;
use kinelm_engine::head::{self, Targets, Workspace};
use kinelm_engine::linear::Products;
use kinelm_engine::op::cross_entropy::RowTarget;
use kinelm_engine::op::matmul::Store;

/// The target of a row of a batch (N = B T rows).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClassRow {
    /// The row.
    pub row: usize,
    /// The table that gives its logits.
    pub table: usize,
    /// The right class: a row of that table.
    pub class: u32,
    /// The factor of its -ln p and of the gradient.
    pub weight: f32,
}

/// The losses of both kinds of heads on a batch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Losses {
    /// Sum of -ln p over the targets that aren't `<pad>`, in nats.
    pub tokens: f64,
    /// Sum of weight times -ln p over the class rows, in nats.
    pub classes: f64,
}

impl Fast {
    /// As [`Fast::gradients`], of the mean over the targets plus the weighted sum over the class rows: logit c of a row is
    /// h . row c of its table (C, D), h as [`Fast::final_vectors`] has it. `of_tables` become the gradients of the tables.
    ///
    /// # Errors
    /// As [`Fast::gradients`].
    ///
    /// # Panics
    /// If a row, a table or a class isn't there.
    pub fn gradients_with_classes(
        &mut self,
        windows: Windows,
        dropout: Option<&Dropout>,
        gradients: &mut [Floats],
        tables: &[Floats],
        rows: &[ClassRow],
        of_tables: &mut [Floats],
    ) -> Result<Losses> {
        let mut classes = 0.0;
        // tables without a row in this batch get no product that would set them
        of_tables.iter_mut().for_each(|t| t.fill(0.0));
        let tokens = self.gradients_and(windows, dropout, gradients, &mut |model, last, dx, gradients| {
            classes = model.class_loss(last, dx, gradients, tables, rows, of_tables);
        })?;
        Ok(Losses { tokens, classes })
    }

    /// The final norm's output at the rows `rows` of a batch, a vector of D each, one after the other. Of a two-level model
    /// that is the trunk's norm, and rows are frames (B F).
    ///
    /// # Errors
    /// As [`Fast::gradients`].
    ///
    /// # Panics
    /// If a row isn't there.
    pub fn final_vectors(&mut self, windows: Windows, rows: &[usize]) -> Result<Vec<f32>> {
        let mut pass = self.scored(windows)?;
        let found = self.normed(pass.vectors(self, windows), rows);
        self.scoring = Some(pass);
        Ok(found)
    }

    fn normed(&self, last: &[f32], rows: &[usize]) -> Vec<f32> {
        let d = self.config.width;
        let x: Vec<f32> = rows.iter().flat_map(|&row| &last[row * d..][..d]).copied().collect();
        let (mut out, mut stats) = (vec![0.0; x.len()], vec![0.0; 2 * rows.len()]);
        let Norm { weight, bias } = self.vector_norm();
        kinelm_engine::op::layer_norm::forward(&mut out, &mut stats, &x, weight, bias);
        out
    }

    fn vector_norm(&self) -> Norm<&[f32]> {
        let [bias, weight] = self.vector_norm_names().map(|name| self.weight(name));
        Norm { weight, bias }
    }

    /// Bias and weight of the norm whose output the final vectors are.
    fn vector_norm_names(&self) -> [&'static str; 2] {
        match self.config.architecture {
            Architecture::Flat => ["norm.bias", "norm.weight"],
            Architecture::TwoLevel => super::two_level::NORM,
        }
    }

    fn class_loss(
        &self,
        last: &[f32],
        dx: &mut [f32],
        gradients: &mut [Floats],
        tables: &[Floats],
        rows: &[ClassRow],
        of_tables: &mut [Floats],
    ) -> f64 {
        let d = self.config.width;
        let [bias, weight] = self.vector_norm_names().map(|name| self.index(name));
        let mut nats = 0.0;
        // an exam has one scale: rows of one table and one weight go together
        let mut order: Vec<&ClassRow> = rows.iter().collect();
        // by row too, so that sums have one order whatever the caller's; bits, since floats aren't `Ord`
        order.sort_by_key(|r| (r.table, r.weight.to_bits(), r.row));
        for same in order.chunk_by(|a, b| (a.table, a.weight.to_bits()) == (b.table, b.weight.to_bits())) {
            let ClassRow { table, weight: scale, .. } = *same[0];
            let count = tables[table].len() / d;
            let target_of =
                |r: &&ClassRow| RowTarget { target: r.class, first: 0, count: count as u32, bins: Bins::NONE };
            let targets: Vec<RowTarget> = same.iter().map(target_of).collect();
            let x: Vec<f32> = same.iter().flat_map(|r| &last[r.row * d..][..d]).copied().collect();
            let mut of_x = vec![0.0; x.len()];
            let mut space = Workspace::new(same.len(), d, count, Products::F32, true);
            let Ok([bias, weight]) = gradients.get_disjoint_mut([bias, weight]) else {
                panic!("{} gradients for a model of {}", gradients.len(), self.parameters.len());
            };
            let norm = Norm { weight: &mut **weight, bias: &mut **bias };
            let mut to = head::Gradients { dx: &mut of_x, norm, head: &mut of_tables[table] };
            let targets = Targets { targets: &targets, smoothing: None, scale };
            let found = head::loss(&x, self.vector_norm(), &tables[table], targets, &mut to, Store::Add, &mut space);
            nats += f64::from(scale) * found;
            for (r, of_x) in same.iter().zip(of_x.chunks(d)) {
                dx[r.row * d..][..d].iter_mut().zip(of_x).for_each(|(dx, g)| *dx += g);
            }
        }
        nats
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::class_windows::{Layout, mask};
    use crate::fixtures::TOKENS;
    use crate::ops::Mask as PlainMask;
    use crate::{Gpt, HeadKind, ModelConfig, Positions, TokenLayout, fixtures, layout};
    use candle_core::{DType, Device, Tensor, Var};
    use kinelm_store::random;
    use rand_chacha::rand_core::RngCore;

    const CLASSES: [usize; 2] = [3, 2];

    fn config() -> ModelConfig {
        let positions = Positions::FrameJoint;
        ModelConfig {
            layers: 2,
            heads: 2,
            width: 8,
            context: 40,
            positions,
            head: Some(HeadKind::Absolute),
            ..Default::default()
        }
    }

    /// Two windows of 5 and 3 words, their mask and their targets.
    struct Case {
        tokens: TokenLayout,
        layout: Layout,
        inputs: Vec<u32>,
        targets: Vec<u32>,
        hiding: Vec<f32>,
        rows: Vec<ClassRow>,
    }

    fn case() -> Case {
        let layout = Layout::new(&config(), &TOKENS, 2).unwrap();
        let t = layout.length();
        let (mut inputs, mut targets) = (vec![0; 2 * t], vec![0; 2 * t]);
        let mut rng = random::stream(3, "classes", 0, 0);
        let words = [layout.words(), 3];
        for ((words, input), target) in words.iter().zip(inputs.chunks_mut(t)).zip(targets.chunks_mut(t)) {
            let ids: Vec<u32> = (0..words * TOKENS.word)
                .map(|i| if i % TOKENS.word == TOKENS.word - 1 { TOKENS.space } else { 6 + rng.next_u32() % 10 })
                .collect();
            layout.fill(&ids, input, target);
        }
        let row = |window: usize, table: usize, class, weight| ClassRow {
            row: window * t + layout.rows(words[window]).start + table,
            table,
            class,
            weight,
        };
        let rows = vec![row(0, 0, 2, 0.5), row(1, 0, 0, 1.25), row(0, 1, 1, 0.5), row(1, 1, 1, 0.5)];
        let tokens = TokenLayout { vocabulary: TOKENS.vocabulary + 2, ..TOKENS };
        Case { tokens, hiding: layout.hiding(&words, false).unwrap(), layout, inputs, targets, rows }
    }

    impl Case {
        fn windows(&self) -> Windows<'_> {
            let length = self.layout.length();
            Windows {
                inputs: &self.inputs,
                targets: &self.targets,
                length,
                mask: mask(Some(&self.hiding)),
                history: &[],
                conditioning: None,
            }
        }
    }

    fn tables() -> Vec<Floats> {
        let mut rng = random::stream(4, "tables", 0, 0);
        let mut numbers = |n: usize| (0..n).map(|_| random::unit(&mut rng) as f32 - 0.5).collect::<Vec<f32>>();
        CLASSES.iter().map(|n| Floats::of(&numbers(n * config().width))).collect()
    }

    #[test]
    fn losses_and_gradients_are_the_tensor_librarys() {
        let (case, tables) = (case(), tables());
        let gpt = Gpt::new(&config(), &case.tokens, 7).unwrap();
        let mut fast = Fast::of(&gpt).unwrap();
        let (mut gradients, mut of_tables) = (fast.like_weights(), tables.clone());
        let found = fast
            .gradients_with_classes(case.windows(), None, &mut gradients, &tables, &case.rows, &mut of_tables)
            .unwrap();
        // the same by the plain form, under the same mask
        let t = case.layout.length();
        let plain = PlainMask::Additive(Tensor::from_slice(&case.hiding, (2, 1, t, t), &Device::Cpu).unwrap());
        let ids = gpt.ids(&case.inputs, t).unwrap();
        let vectors = gpt.final_vectors(&ids, &plain).unwrap();
        let vars: Vec<Var> = tables
            .iter()
            .map(|x| Var::from_slice(x, (x.len() / config().width, config().width), &Device::Cpu).unwrap())
            .collect();
        let log_p = |row: usize, table: &Tensor| {
            let h = vectors.narrow(0, row, 1).unwrap();
            candle_nn::ops::log_softmax(&h.matmul(&table.t().unwrap()).unwrap(), 1).unwrap()
        };
        let at = |log_p: Tensor, column: usize| log_p.narrow(1, column, 1).unwrap().sum_all().unwrap();
        let counted: Vec<usize> = (0..2 * t).filter(|&i| case.targets[i] != TOKENS.pad).collect();
        let token = gpt.vars()["token.weight"].as_tensor();
        let motion = counted.iter().map(|&i| at(log_p(i, token), case.targets[i] as usize));
        let motion = motion.reduce(|a, b| (a + b).unwrap()).unwrap().neg().unwrap();
        let classes = case
            .rows
            .iter()
            .map(|r| (at(log_p(r.row, &vars[r.table]), r.class as usize) * f64::from(-r.weight)).unwrap());
        let classes = classes.reduce(|a, b| (a + b).unwrap()).unwrap();
        let scalar = |x: &Tensor| f64::from(x.to_scalar::<f32>().unwrap());
        assert!(
            (found.tokens - scalar(&motion)).abs() < 1e-3 && (found.classes - scalar(&classes)).abs() < 1e-5,
            "{found:?}"
        );
        let store = (motion / counted.len() as f64).unwrap().add(&classes).unwrap().backward().unwrap();
        let close = |name: &str, found: &[f32], expected: &Tensor| {
            let expected = expected.flatten_all().unwrap().to_vec1::<f32>().unwrap();
            let far = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(far < 1e-5, "{name}: {far}");
        };
        for (p, gradient) in fast.parameters().iter().zip(&gradients) {
            close(&p.name, gradient, store.get(gpt.vars()[&p.name].as_tensor()).unwrap());
        }
        for (i, (var, gradient)) in vars.iter().zip(&of_tables).enumerate() {
            close(&format!("table {i}"), gradient, store.get(var.as_tensor()).unwrap());
        }
    }

    #[test]
    fn other_class_tokens_change_no_logit_of_motion_and_not_each_other() {
        let mut case = case();
        let mut fast = Fast::of(&Gpt::new(&config(), &case.tokens, 7).unwrap()).unwrap();
        let classes = case.rows.iter().map(|r| r.row).collect::<Vec<_>>();
        let (before, vectors) =
            (fast.logits(case.windows()).unwrap(), fast.final_vectors(case.windows(), &classes).unwrap());
        // another token in the place of the first class token of each window
        for row in case.rows.iter().filter(|r| r.table == 0) {
            case.inputs[row.row] = 6;
        }
        let (after, others) =
            (fast.logits(case.windows()).unwrap(), fast.final_vectors(case.windows(), &classes).unwrap());
        let (v, d, t) = (case.tokens.vocabulary, config().width, case.layout.length());
        for (window, words) in [case.layout.words(), 3].into_iter().enumerate() {
            let motion = window * t * v..(window * t + case.layout.motion_rows(words).end) * v;
            assert!(before[motion.clone()] == after[motion]);
        }
        for (row, (a, b)) in case.rows.iter().zip(vectors.chunks(d).zip(others.chunks(d))) {
            assert_eq!(a == b, row.table == 1, "only the token itself is another");
        }
    }

    /// Two windows of a two-level model, of 4 and 2 frames in front of two class rows; a room of 6.
    fn frames() -> (Gpt, Layout, [usize; 2], Vec<u32>, Vec<u32>) {
        let (levels, tokens) = fixtures::every(36).into_iter().find(|(c, _)| !c.architecture.is_flat()).unwrap();
        let layout = Layout::new(&levels, &tokens, 2).unwrap();
        let gpt = fixtures::model(&ModelConfig { classes: 2, ..levels }, &tokens);
        let (t, words) = (layout.length(), [layout.words(), 2]);
        assert_eq!((t, words), (36, [4, 2]));
        // the first of three windows is whole
        let (_, ids) = fixtures::batch(gpt.config(), &tokens, 3, t);
        let (mut inputs, mut targets) = (vec![0; 2 * t], vec![0; 2 * t]);
        for (i, words) in words.into_iter().enumerate() {
            let ids = &ids[i * tokens.word..][..words * tokens.word];
            layout.fill(ids, &mut inputs[i * t..][..t], &mut targets[i * t..][..t]);
        }
        (gpt, layout, words, inputs, targets)
    }

    #[test]
    fn class_rows_of_a_two_level_model_are_the_oracles() {
        let (gpt, layout, words, inputs, targets) = frames();
        let (truth, d) = (gpt.to_f64().unwrap(), gpt.config().width);
        let (length, places) = (layout.length(), layout.places());
        let mut rng = random::stream(4, "tables", 0, 0);
        let mut numbers = |n: usize| (0..n).map(|_| random::unit(&mut rng) as f32 - 0.5).collect::<Vec<f32>>();
        let tables: Vec<Floats> = CLASSES.iter().map(|n| Floats::of(&numbers(n * d))).collect();
        let row = |window: usize, table: usize, class, weight| ClassRow {
            row: window * places + layout.rows(words[window]).start + table,
            table,
            class,
            weight,
        };
        let rows = [row(0, 0, 2, 0.5), row(1, 0, 0, 1.25), row(0, 1, 1, 0.5), row(1, 1, 1, 0.75)];
        let ids = truth.ids(&inputs, length).unwrap();
        for hiding in [None, layout.hiding(&words, false)] {
            let plain = hiding.as_ref().map_or(PlainMask::Causal, |mask| {
                let mask = Tensor::from_slice(mask, (2, 1, places, places), &Device::Cpu).unwrap();
                PlainMask::Additive(mask.to_dtype(DType::F64).unwrap())
            });
            let vectors = truth.final_vectors(&ids, &plain).unwrap();
            let vars: Vec<Var> = tables
                .iter()
                .map(|x| {
                    let x = Tensor::from_slice(x, (x.len() / d, d), &Device::Cpu).unwrap();
                    Var::from_tensor(&x.to_dtype(DType::F64).unwrap()).unwrap()
                })
                .collect();
            let nats = rows.iter().map(|r| {
                let logits = vectors.narrow(0, r.row, 1).unwrap().matmul(&vars[r.table].t().unwrap()).unwrap();
                let log_p = candle_nn::ops::log_softmax(&logits, 1).unwrap().narrow(1, r.class as usize, 1).unwrap();
                (log_p.sum_all().unwrap() * f64::from(-r.weight)).unwrap()
            });
            let classes = nats.reduce(|a, b| (a + b).unwrap()).unwrap();
            let motion = truth.loss_sum(&ids, &targets, None).unwrap();
            let counted = targets.iter().filter(|&&t| t != 0).count();
            let loss = (&motion / counted as f64).unwrap().add(&classes).unwrap();
            let store = loss.backward().unwrap();

            let mut fast = Fast::of(&gpt).unwrap();
            let (mut gradients, mut of_tables) = (fast.like_weights(), tables.clone());
            gradients.iter_mut().for_each(|g| g.fill(f32::NAN));
            let windows = Windows {
                inputs: &inputs,
                targets: &targets,
                length,
                mask: mask(hiding.as_deref()),
                history: &[],
                conditioning: None,
            };
            let found =
                fast.gradients_with_classes(windows, None, &mut gradients, &tables, &rows, &mut of_tables).unwrap();
            let near = |found: f64, expected: &Tensor| {
                let expected = expected.to_scalar::<f64>().unwrap();
                (found - expected).abs() <= 1e-5 * expected.abs()
            };
            assert!(near(found.tokens, &motion) && near(found.classes, &classes), "{found:?}");
            let close = |name: &str, found: &[f32], expected: &Tensor| {
                let expected = expected.flatten_all().unwrap().to_vec1::<f64>().unwrap();
                let most = expected.iter().fold(1e-3, |m: f64, x| m.max(x.abs()));
                let far = found.iter().zip(&expected).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
                assert!(far <= 1e-5 * most && found.iter().all(|x| x.is_finite()), "{name}: {far} of {most}");
            };
            for (p, gradient) in fast.parameters().iter().zip(&gradients) {
                close(&p.name, gradient, store.get(truth.vars()[&p.name].as_tensor()).unwrap());
            }
            for (i, (var, gradient)) in vars.iter().zip(&of_tables).enumerate() {
                close(&format!("table {i}"), gradient, store.get(var.as_tensor()).unwrap());
            }
            let all: Vec<usize> = (0..2 * places).collect();
            close("vectors", &fast.final_vectors(windows, &all).unwrap(), &vectors);
        }
    }

    #[test]
    fn class_rows_see_the_frames_and_themselves_and_nobody_sees_them() {
        let (gpt, layout, words, inputs, targets) = frames();
        let (length, places, d, word) = (layout.length(), layout.places(), gpt.config().width, gpt.tokens().word);
        let hiding = layout.hiding(&words, false).unwrap();
        let read = |inputs: &[u32]| {
            let mut fast = Fast::of(&gpt).unwrap();
            let windows = Windows {
                inputs,
                targets: &targets,
                length,
                mask: mask(Some(&hiding)),
                history: &[],
                conditioning: None,
            };
            let vectors = fast.final_vectors(windows, &(0..2 * places).collect::<Vec<_>>()).unwrap();
            (vectors, fast.logits(windows).unwrap())
        };
        let (vectors, logits) = read(&inputs);
        // which rows of the second window become others (0 and 1 are frames, 2 and 3 class rows), and whether a logit does
        let others = |(now, of_tokens): &(Vec<f32>, Vec<f32>)| {
            let row = |row: &usize| vectors[(places + row) * d..][..d] != now[(places + row) * d..][..d];
            let [from, to] = [length, length + 2 * word].map(|at| at * gpt.tokens().vocabulary);
            ((0..4).filter(row).collect::<Vec<_>>(), logits[from..to] != of_tokens[from..to])
        };
        let with = |at: usize, id: u32| {
            let mut inputs = inputs.clone();
            assert_ne!(std::mem::replace(&mut inputs[length + 1 + at], id), id);
            read(&inputs)
        };
        // a character of the last frame, which the decoder reads too; padding
        let last = 2 * word - 2;
        let other = if inputs[length + 1 + last] == 20 { 21 } else { 20 };
        assert_eq!(others(&with(last, other)), (vec![2, 3], true));
        assert_eq!(others(&with(2 * word + 1, 6)), (vec![], false));
        // what stands for the first field
        let class = &gpt.vars()[layout::CLASS];
        let first = Tensor::new(&[[2f32], [1.0]], &Device::Cpu).unwrap();
        class.set(&class.as_tensor().broadcast_mul(&first).unwrap()).unwrap();
        assert_eq!(others(&read(&inputs)), (vec![2], false));
    }
}
