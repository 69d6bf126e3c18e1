//! The tensors of a model: names, shapes, and how they begin.

use super::config::Architecture;
use super::config::{HeadKind, ModelConfig, Positions, TokenLayout};
use super::forecast;
use super::frames::{BACK, Frames, spelt_tables};
use super::goal;
use crate::words::Steps;
use kinelm_store::random;

/// One tensor of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its name on disk.
    pub name: String,
    /// Its shape; matrices are (in, out).
    pub shape: Vec<usize>,
    /// Its numbers before training.
    pub init: Init,
    /// Its role in the optimizer.
    pub role: Role,
}

/// A tensor's role in the optimizer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// A norm's weights, or a bias.
    Vector,
    /// A matrix that rows are multiplied with, at which weight decay pulls.
    Matrix,
    /// A table whose rows are looked up, which may learn at a rate of its own.
    Table,
}

/// A tensor's numbers before training.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Init {
    /// Zeros.
    Zeros,
    /// Ones.
    Ones,
    /// Normal numbers around 0 with this standard deviation.
    Normal(f64),
}

/// All tensors of a model, sorted by name.
///
/// GPT-2's beginning: sd 0.02, outputs into the residual stream 0.02/sqrt(2 L), biases 0, norms 1.
pub fn parameters(config: &ModelConfig, tokens: &TokenLayout) -> Vec<Parameter> {
    let mut all = match config.architecture {
        Architecture::Flat => flat(config, tokens),
        Architecture::TwoLevel => two_level(config, tokens),
    };
    let d = config.head_width();
    norm(&mut all, "norm", d);
    if config.ids_table() == "head.weight" {
        all.push(Parameter { role: Role::Matrix, ..embedding("head.weight", tokens.vocabulary, d) });
    }
    if config.head_of(tokens) == HeadKind::Relative {
        let steps = Steps::of(&tokens.bins());
        let tables = [("head.circular.weight", steps.circular), ("head.clamped.weight", steps.up_and_down())];
        let tables = tables.into_iter().filter(|(_, rows)| *rows > 0);
        all.extend(tables.map(|(name, rows)| Parameter { role: Role::Matrix, ..embedding(name, rows, d) }));
    }
    // the fast form finds tensors by binary search, and files are the same bytes
    all.sort_by(|a, b| a.name.cmp(&b.name));
    all
}

/// The tensors before the last norm of a flat model.
fn flat(config: &ModelConfig, tokens: &TokenLayout) -> Vec<Parameter> {
    let d = config.width;
    let mut all = vec![embedding("token.weight", tokens.vocabulary, d)];
    match config.positions {
        Positions::Absolute => all.push(embedding("position.absolute.weight", config.context, d)),
        Positions::FrameJoint => {
            all.push(embedding("position.front.weight", tokens.front, d));
            all.push(embedding("position.frame.weight", word_rows(config, tokens), d));
            all.push(embedding("position.place.weight", tokens.word, d));
        }
        Positions::Rope => {
            all.push(embedding("position.front.weight", tokens.front, d));
            all.push(embedding("position.place.weight", tokens.word, d));
        }
    }
    if config.reads_previous(tokens) {
        all.push(embedding("previous.character.weight", tokens.vocabulary, d));
        all.push(embedding("previous.step.weight", Steps::of(&tokens.bins()).most() + 1, d));
    }
    stack(&mut all, "", config.layers, d);
    all
}

/// The tensors before the last norm of a two-level model.
fn two_level(config: &ModelConfig, tokens: &TokenLayout) -> Vec<Parameter> {
    let (frames, decoder, trunk) = (Frames::of(tokens), config.decoder(), config.width);
    let (e, d, c) = (decoder.character_width, decoder.width, frames.characters());
    let mut all = vec![
        embedding("frame.character.weight", c * frames.bins(), e),
        embedding("frame.position.weight", config.frames(tokens), trunk),
    ];
    if tokens.front > 1 {
        // a model that learns labels later begins as it was
        let begin = |name, width| Parameter { init: Init::Zeros, ..embedding(name, tokens.vocabulary, width) };
        all.extend([begin(LABEL, trunk), begin(SPELT_LABEL, d)]);
    }
    if config.classes > 0 {
        all.push(embedding(CLASS, config.classes, trunk));
    }
    linear(&mut all, "frame.join", BACK * c * e, trunk, 0.02);
    stack(&mut all, TRUNK, config.layers, trunk);
    norm(&mut all, "trunk.norm", trunk);
    linear(&mut all, "spell.frame", trunk, d, 0.02);
    let tables = spelt_tables(config.forecast()).iter().zip(frames.spelt_rows());
    all.extend(tables.map(|(name, rows)| embedding(name, rows, d)));
    if config.forecast() {
        // zeros: a model begins with what it knows without the numbers
        all.push(Parameter { init: Init::Zeros, ..embedding(FORECAST, forecast::NUMBERS, d) });
    }
    stack(&mut all, SPELL, decoder.layers, d);
    if config.goal {
        let (numbers, steps) = (goal::numbers(c), frames.steps().all());
        let shapes = [(numbers, trunk), (numbers, d), (steps, d), (steps, d)];
        // zeros: a model that is fine-tuned with goals starts from its own predictions
        let begin = |(name, (rows, width))| Parameter { init: Init::Zeros, ..embedding(name, rows, width) };
        all.extend(GOAL.into_iter().zip(shapes).map(begin));
    }
    if !config.music.is_none() {
        // zeros for the same reason as goals
        let begin = |(name, width)| Parameter { init: Init::Zeros, ..embedding(name, config.music.numbers(), width) };
        all.extend(MUSIC.into_iter().zip([trunk, d]).map(begin));
    }
    all
}

/// The table of labels, whose rows are added to every frame: there where windows begin with labels.
pub(super) const LABEL: &str = "frame.label.weight";
/// Another, whose rows are added to every row of the decoder.
pub(super) const SPELT_LABEL: &str = "spell.label.weight";
/// The numbers of a slot's forecast are projected by it into the decoder's row.
pub(super) const FORECAST: &str = "spell.forecast.weight";
/// The vectors that class rows, after the last frame, have instead of a position.
pub const CLASS: &str = "frame.class.weight";
/// Goal conditioning is projected by these: its numbers into the trunk's row and into those of the decoder,
/// and two tables of steps.
pub const GOAL: [&str; 4] = ["ahead.frame.weight", "ahead.spell.weight", "ahead.step.weight", "ahead.pace.weight"];
/// Music conditioning is projected by these: into the trunk's row, and into those of the decoder.
pub const MUSIC: [&str; 2] = ["music.frame.weight", "music.spell.weight"];
/// The prefixes of the names of the trunk's blocks, and of the decoder's.
pub(super) const TRUNK: &str = "trunk.";
pub(super) const SPELL: &str = "spell.";

/// Blocks of width `d`, whose names begin with `prefix`.
fn stack(all: &mut Vec<Parameter>, prefix: &str, layers: usize, d: usize) {
    // two outputs a block are summed into the stream: its variance stays that of one at any depth
    let residual = 0.02 / (2.0 * layers as f64).sqrt();
    for layer in 0..layers {
        let block = format!("{prefix}{}", block_name(layer));
        let all = &mut *all;
        norm(all, &format!("{block}.norm1"), d);
        linear(all, &format!("{block}.attention.qkv"), d, 3 * d, 0.02);
        linear(all, &format!("{block}.attention.out"), d, d, residual);
        norm(all, &format!("{block}.norm2"), d);
        linear(all, &format!("{block}.mlp.up"), d, 4 * d, 0.02);
        linear(all, &format!("{block}.mlp.down"), 4 * d, d, residual);
    }
}

/// Words that have a position of their own: those that a window can hold, a character and a space each if words differ in
/// length.
pub(super) fn word_rows(config: &ModelConfig, tokens: &TokenLayout) -> usize {
    // rounded up, as the last word of a window may be cut
    tokens.room(config.context).div_ceil(if tokens.varying { 2 } else { tokens.word })
}

/// The name of a block's tensors, up to the dot after its number.
pub(super) fn block_name(layer: usize) -> String {
    // two digits, as there are at most 96 layers: names sort as numbers do
    format!("block.{layer:02}")
}

fn embedding(name: &str, rows: usize, width: usize) -> Parameter {
    Parameter { name: name.into(), shape: vec![rows, width], init: Init::Normal(0.02), role: Role::Table }
}

fn norm(all: &mut Vec<Parameter>, name: &str, width: usize) {
    for (part, init) in [("weight", Init::Ones), ("bias", Init::Zeros)] {
        all.push(Parameter { name: format!("{name}.{part}"), shape: vec![width], init, role: Role::Vector });
    }
}

fn linear(all: &mut Vec<Parameter>, name: &str, rows: usize, columns: usize, sd: f64) {
    let (weight, bias) = (format!("{name}.weight"), format!("{name}.bias"));
    all.push(Parameter { name: weight, shape: vec![rows, columns], init: Init::Normal(sd), role: Role::Matrix });
    all.push(Parameter { name: bias, shape: vec![columns], init: Init::Zeros, role: Role::Vector });
}

impl Parameter {
    /// The number of its elements.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether it has no numbers, which no valid configuration gives.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Its numbers before training; every tensor has the random stream of its own name.
    pub fn initial(&self, seed: u64) -> Vec<f32> {
        match self.init {
            Init::Zeros => vec![0.0; self.len()],
            Init::Ones => vec![1.0; self.len()],
            Init::Normal(sd) => {
                let mut rng = random::stream(seed, &format!("init {}", self.name), 0, 0);
                (0..self.len()).map(|_| (random::normal(&mut rng) * sd) as f32).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_thesis_size_has_the_parameters_it_should() {
        let tokens = TokenLayout {
            vocabulary: 480,
            word: 43,
            varying: false,
            front: 1,
            pad: 0,
            bos: 1,
            space: 5,
            places: Vec::new(),
        };
        let config = ModelConfig {
            layers: 8,
            heads: 8,
            width: 512,
            context: 1024,
            positions: Positions::Absolute,
            ..ModelConfig::default()
        };
        let all = parameters(&config, &tokens);
        assert_eq!(all.iter().map(Parameter::len).sum::<usize>(), 25_990_144);
        assert!(all.windows(2).all(|p| p[0].name < p[1].name));
    }

    #[test]
    fn the_beginning_has_the_spread_it_should_and_comes_from_the_seed() {
        let p = Parameter { name: "x".into(), shape: vec![200, 100], init: Init::Normal(0.02), role: Role::Matrix };
        let x = p.initial(3);
        let sd = (x.iter().map(|x| x * x).sum::<f32>() / x.len() as f32).sqrt();
        // the sd of 20,000 normal numbers is within 2 % for all but 1 in 10,000 seeds
        assert!((sd / 0.02 - 1.0).abs() < 0.02, "{sd}");
        assert_eq!(x, p.initial(3));
        assert_ne!(x, p.initial(4));
        assert_ne!(x, Parameter { name: "y".into(), ..p }.initial(3));
    }
}
