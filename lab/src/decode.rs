//! `kinelm-lab decode`.

use crate::model::{BenchModel, ModelArgs};
use crate::{How, Rates, Row, Say, Unit, rounded, seconds};
use anyhow::Result;
use kinelm::engine::arena::Floats;
use kinelm::generate::sampling::Sampling;
use kinelm::generate::{NextToken, SamplingPlan, sample_side_by_side};
use kinelm::model::{Gpt, KvKind, Logits, ModelConfig, Reader, ReaderOptions, WeightKind};
use kinelm::store::random;
use kinelm::tokenizer::{Grammar, Vocabulary, WordLength};
use rand_chacha::rand_core::RngCore;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::ops::{ControlFlow, Range};
use std::time::Instant;

/// Tokens that are read one by one, at the end of the context, in a timing.
const STEPS: usize = 32;
/// Ids below it are special ones.
const FIRST_ID: u32 = 6;
/// Slots of a word that a prompted dance has given: a shoulder, an elbow and a wrist of three angles each.
const GIVEN: Range<usize> = 27..36;
/// And of a two-level model: the pelvis's place and turn.
const ROOT: Range<usize> = 0..6;
/// Frames of the first second, at 20 a second, after which times are compared, and frames of a stretch.
const LEAD_IN: usize = 20;
const EVEN: usize = 64;
/// Numbers that are read for the memory's bandwidth: 256 MiB.
const SWEEP: usize = 64 << 20;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    model: ModelArgs,
    /// S: sequences read side by side
    #[arg(long, value_name = "S", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16))]
    streams: u8,
    /// Frames of the dances; two windows if not given. From 148 on, how even their times are is printed too
    #[arg(long, value_name = "F", value_parser = frames)]
    frames: Option<usize>,
    /// The format of the weights
    #[arg(long, value_enum, default_value = "f32")]
    weights: WeightKind,
    /// The format of cached keys and values
    #[arg(long, value_enum, default_value = "f32")]
    kv: KvKind,
    #[command(flatten)]
    how: How,
}

fn frames(text: &str) -> std::result::Result<usize, String> {
    match text.parse() {
        Ok(frames @ 1..=1_000_000) => Ok(frames),
        _ => Err("expected 1 to 1000000 frames".into()),
    }
}

struct Bench<'a> {
    args: &'a Args,
    model: BenchModel,
    reading: ReaderOptions,
    gpt: Gpt,
    reader: Reader,
    /// (T) tokens to read.
    tokens: Vec<u32>,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let model = args.model.get()?;
    let reading = ReaderOptions { streams: args.streams.into(), weights: args.weights, kv: args.kv };
    let gpt = Gpt::new(&model.file.model, &model.tokens, 1)?;
    let reader = Reader::new(&gpt, reading)?;
    let mut rng = random::stream(1, "bench", 0, 0);
    let ordinary = model.tokens.vocabulary as u32 - FIRST_ID;
    let tokens = (0..model.file.model.context).map(|_| FIRST_ID + rng.next_u32() % ordinary).collect();
    say.line(format_args!("{} MB of weights a token", reader.weight_bytes() / 1_000_000));
    let mut bench = Bench { args: &args, model, reading, gpt, reader, tokens };
    bench.decode()?;
    bench.prefill()?;
    if !bench.model.file.model.architecture.is_flat() {
        bench.generate(|_| false)?;
    }
    bench.prompted()
}

impl Bench<'_> {
    fn row(&self, what: &str, unit: Unit, rates: Rates, more: Value) -> Result<()> {
        let threads = rayon::current_num_threads();
        let mut all = json!({
            "streams": self.reading.streams,
            "weights": format!("{:?}", self.reading.weights).to_lowercase(),
            "kv": format!("{:?}", self.reading.kv).to_lowercase(),
            "context": self.tokens.len(),
            "kernels": kinelm::engine::dispatch::name(),
        });
        for (key, value) in more.as_object().into_iter().flatten() {
            all[key] = value.clone();
        }
        Row { what, config: &self.model.name, unit, rates, threads, more: all }.print(&self.args.how)
    }

    fn repeats(&self, usual: u16) -> u16 {
        self.args.how.repeats.unwrap_or(usual)
    }

    /// Every sequence forgets all but its first tokens, which are read where they weren't.
    fn rewind(&mut self, length: usize) -> Result<()> {
        (0..self.reading.streams).for_each(|stream| self.reader.truncate(stream, 0));
        let blocks = vec![&self.tokens[..length]; self.reading.streams];
        self.reader.read(&blocks, Logits::Last)?;
        Ok(())
    }

    /// Tokens one by one at the end of the context.
    fn decode(&mut self) -> Result<()> {
        let (streams, context) = (self.reading.streams, self.tokens.len());
        let steps = STEPS.min(context / 2);
        let first = context - steps;
        self.rewind(first)?;
        let timed = seconds(1, self.repeats(10), || {
            (0..streams).for_each(|stream| self.reader.truncate(stream, first));
            for token in self.tokens[first..].chunks(1) {
                self.reader.read(&vec![token; streams], Logits::Last)?;
            }
            Ok(())
        })?;
        let rates = Rates::of((steps * streams) as f64, &timed);
        if !self.model.file.model.architecture.is_flat() {
            // a frame's keys and the decoder's weights stay in the cache: memory doesn't bound it
            return self.row("decode", Unit::Tokens, rates, json!({}));
        }
        // the mean of the steps, which read from `first` to `context` tokens
        let bytes = self.reader.weight_bytes() + streams * self.kv_bytes(context - steps / 2);
        let (read, most) = (bytes as f64 * rates.median / streams as f64 / 1e9, bandwidth());
        let more = json!({
            "gb_per_s": rounded(read, 1),
            "bandwidth_gb_per_s": rounded(most, 1),
            "share_of_bandwidth": rounded(read / most, 3),
        });
        self.row("decode", Unit::Tokens, rates, more)
    }

    /// Bytes of keys and values that a token after `seen` others reads.
    fn kv_bytes(&self, seen: usize) -> usize {
        let ModelConfig { layers, width, .. } = self.model.file.model;
        let number = match self.reading.kv {
            KvKind::F32 => 4,
            KvKind::F16 => 2,
            KvKind::Int8 => 1,
        };
        2 * layers * width * seen * number
    }

    /// A whole context in one block, one sequence.
    fn prefill(&mut self) -> Result<()> {
        // the other sequences read nothing
        let mut blocks = vec![&[][..]; self.reading.streams];
        blocks[0] = &self.tokens;
        let timed = seconds(1, self.repeats(10), || {
            self.reader.truncate(0, 0);
            self.reader.read(&blocks, Logits::Last)?;
            Ok(())
        })?;
        self.row("prefill", Unit::Tokens, Rates::of(self.tokens.len() as f64, &timed), json!({}))
    }

    /// Dances of which an arm is given, of a two-level model the root too.
    fn prompted(&mut self) -> Result<()> {
        let root = if self.model.file.model.architecture.is_flat() { 0..0 } else { ROOT };
        self.generate(|place| GIVEN.contains(&place) || root.contains(&place))
    }

    /// Dances of which some slots of a word are given; by default until the window has moved twice.
    fn generate(&mut self, is_given: impl Fn(usize) -> bool) -> Result<()> {
        let tokens = &self.model.tokens;
        let (word, window) = (tokens.word, tokens.room(self.tokens.len()) / tokens.word);
        let given: Vec<bool> = (0..word - 1).map(is_given).collect();
        let frames = self.args.frames.unwrap_or(2 * window);
        let ids = self.tokens.iter().copied().cycle().take(frames.max(window) * word).enumerate();
        let prompt: Vec<u32> = ids.map(|(i, id)| if i % word + 1 == word { tokens.space } else { id }).collect();
        let vocabulary = Vocabulary::new(tokens.vocabulary as u32 - FIRST_ID);
        let grammar = Grammar::new(&vocabulary, WordLength::Fixed(word - 1));
        // untruncated: among ids that are all as likely, as random weights have them, truncating costs most
        let plan = SamplingPlan::free(grammar, frames, Sampling::default(), 1);
        let plan = SamplingPlan { given: given.clone(), prompt: prompt.clone(), ..plan };
        let after =
            SamplingPlan { beginnings: vec![prompt[..(window - 1) * word].to_vec()], words: window, ..plan.clone() };
        let repeats = self.args.how.repeats.unwrap_or(3);
        let readers = Reader::side_by_side(&self.gpt, self.reading, 1)?;
        let mut readers: Vec<Box<dyn NextToken>> = readers.into_iter().map(|reader| Box::new(reader) as _).collect();
        let runs = (0..repeats).map(|_| times(&mut readers, &plan)).collect::<Result<Vec<_>>>()?;
        let later = (0..repeats).map(|_| Ok(times(&mut readers, &after)?[window - 1])).collect::<Result<Vec<_>>>()?;
        let whole: Vec<f64> = runs.iter().filter_map(|run| run.last().copied()).collect();
        let first: Vec<f64> = runs.iter().filter_map(|run| run.first().copied()).collect();
        let milliseconds = |seconds: &[f64]| rounded(1e3 / Rates::of(1.0, seconds).median, 1);
        let count = given.iter().filter(|given| **given).count();
        let mut more = json!({
            "given": count,
            "free": given.len() - count,
            "first_frame_ms": milliseconds(&first),
            "first_behind_a_window_ms": milliseconds(&later),
        });
        if let Some((least, most)) = evenness(&runs) {
            more["even_64"] = json!([rounded(least, 3), rounded(most, 3)]);
        }
        let rates = Rates::of((frames * self.reading.streams) as f64, &whole);
        self.row("generate", Unit::Frames, rates, more)
    }
}

/// Seconds from the call until each frame of `plan` was there.
fn times(readers: &mut [Box<dyn NextToken>], plan: &SamplingPlan) -> Result<Vec<f64>> {
    let (started, mut at) = (Instant::now(), Vec::with_capacity(plan.words));
    sample_side_by_side(readers, plan, &mut |words, _| {
        at.resize(words, started.elapsed().as_secs_f64());
        ControlFlow::Continue(())
    })?;
    Ok(at)
}

/// Of every 64 frames from the 20th on, the time over that of the first 64 there: the least and the most; `None` where there
/// are fewer than twice 64. A stretch's time is that of the quickest run: what else the machine does only adds to it.
fn evenness(runs: &[Vec<f64>]) -> Option<(f64, f64)> {
    let marks = |at: &Vec<f64>| at.iter().skip(LEAD_IN - 1).step_by(EVEN).copied().collect::<Vec<f64>>();
    let each = |at: &Vec<f64>| marks(at).windows(2).map(|pair| pair[1] - pair[0]).collect::<Vec<f64>>();
    let runs: Vec<Vec<f64>> = runs.iter().map(each).collect();
    let stretches = runs.iter().map(Vec::len).min()?;
    let quickest = |i: usize| runs.iter().map(|run| run[i].max(1e-9)).fold(f64::INFINITY, f64::min);
    let each: Vec<f64> = (0..stretches).map(quickest).collect();
    let (first, later) = each.split_first().filter(|(_, later)| !later.is_empty())?;
    let ratios = later.iter().map(|seconds| seconds / first);
    Some(ratios.fold((f64::INFINITY, 0.0), |(least, most), ratio| (least.min(ratio), most.max(ratio))))
}

/// 10^9 bytes a second that all threads together read from memory: the best of 8 sweeps, four streams a thread.
fn bandwidth() -> f64 {
    let mut numbers = Floats::new(SWEEP);
    numbers.fill(1.0);
    let sum = |part: &[f32]| {
        let (a, b) = part.split_at(part.len() / 2);
        let (a, b, c, d) = (a.split_at(a.len() / 2), b.split_at(b.len() / 2), 0u32, 0u32);
        // as integers: sums of f32 have an order, and would wait for one another
        let pairs = a.0.iter().zip(a.1).zip(b.0.iter().zip(b.1));
        let (x, y) = pairs.fold((c, d), |(x, y), ((a, b), (c, d))| {
            (x.wrapping_add(a.to_bits() ^ b.to_bits()), y.wrapping_add(c.to_bits() ^ d.to_bits()))
        });
        x.wrapping_add(y)
    };
    let sweep = |_| {
        let started = Instant::now();
        let sum = numbers.par_chunks(SWEEP / 64).map(sum).reduce(|| 0, u32::wrapping_add);
        std::hint::black_box(sum);
        (SWEEP * 4) as f64 / started.elapsed().as_secs_f64() / 1e9
    };
    (0..8).map(sweep).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evenness_is_of_whole_stretches_behind_the_first_second() {
        // a frame a second, from the 100th on two
        let at: Vec<f64> = (0..300).map(|i| if i < 100 { i as f64 } else { 2.0 * i as f64 - 100.0 }).collect();
        // frames 19, 83, 147, 211, 275: 64 s, 64 + 47 s, twice 128 s
        let found = evenness(std::slice::from_ref(&at)).unwrap();
        assert!((found.0 - 111.0 / 64.0).abs() < 1e-9 && (found.1 - 2.0).abs() < 1e-9, "{found:?}");
        assert_eq!((evenness(&[at[..147].to_vec()]), evenness(&[])), (None, None));
        assert!(evenness(&[at[..148].to_vec()]).is_some());
        // what one of two runs waits for is not the dance's
        let even: Vec<f64> = (0..300).map(f64::from).collect();
        let (least, most) = evenness(&[even, at]).unwrap();
        assert!((least - 1.0).abs() < 1e-9 && (most - 1.0).abs() < 1e-9, "{least} {most}");
    }
}
