//! `kinelm-lab`: how fast this machine does what the program does. A file a subject; the rows are printed here.

mod decode;
mod lstm;
mod model;
mod peak;
mod query;
mod read;
mod tokenize;
mod train;

use anyhow::Result;
use clap::Parser;
use serde_json::{Map, Value, json};
use std::fmt::Display;
use std::io::Write;
use std::time::Instant;

/// How fast this machine does what kinelm does.
#[derive(Debug, clap::Parser)]
#[command(name = "kinelm-lab", arg_required_else_help = true)]
struct Call {
    #[command(subcommand)]
    bench: Bench,
    /// Threads to use [default: all cores]
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print rows only, no notes
    #[arg(long, short, global = true)]
    quiet: bool,
}

#[derive(Debug, clap::Subcommand)]
enum Bench {
    /// MB/s of a BVH's number block, on one core
    Read(read::Args),
    /// Frames/s of encoding and decoding made-up dances of 13 joints, on all threads
    Tokenize(tokenize::Args),
    /// Tokens/s of training steps on made-up tokens: forward, backward, norm clipped at 1, AdamW
    Train(train::Args),
    /// Tokens/s of reading with random weights: one by one, a whole context, and dances of which an arm is given
    Decode(decode::Args),
    /// Frames/s of updates of an auto-conditioned LSTM on made-up frames: forward, backward, Adam
    Lstm(lstm::Args),
    /// Milliseconds of a search among made-up windows, exact, on all threads
    Query(query::Args),
}

/// How every bench measures and prints.
#[derive(Debug, clap::Args)]
struct How {
    /// Timings, after a warm-up that doesn't count; their median is the figure
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    repeats: Option<u16>,
    /// One JSON object a row instead of a table
    #[arg(long)]
    json: bool,
}

/// What stands beside the rows, on stderr.
#[derive(Debug, Clone, Copy)]
struct Say {
    quiet: bool,
}

impl Say {
    fn line(self, text: impl Display) {
        if !self.quiet {
            eprintln!("{text}");
        }
    }
}

fn main() -> Result<()> {
    let call = Call::parse();
    let threads = call.threads.unwrap_or(0).into();
    rayon::ThreadPoolBuilder::new().num_threads(threads).stack_size(8 << 20).build_global()?;
    let say = Say { quiet: call.quiet };
    // on a thread of the pool, as the program does: from outside, every parallel step would wake its threads anew
    let done = rayon::scope(|_| match call.bench {
        Bench::Read(args) => read::run(args, say),
        Bench::Tokenize(args) => tokenize::run(args, say),
        Bench::Train(args) => train::run(args, say),
        Bench::Decode(args) => decode::run(args, say),
        Bench::Lstm(args) => lstm::run(args, say),
        Bench::Query(args) => query::run(args, say),
    });
    match done {
        // as after `| head`: who closes the output has read enough
        Err(e) if is_broken_pipe(&e) => Ok(()),
        done => done,
    }
}

fn is_broken_pipe(e: &anyhow::Error) -> bool {
    e.downcast_ref::<std::io::Error>().is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
}

/// What a rate counts.
#[derive(Debug, Clone, Copy)]
enum Unit {
    Megabytes,
    Frames,
    Tokens,
    Windows,
}

impl Unit {
    /// Its name in a table and in JSON.
    fn names(self) -> [&'static str; 2] {
        match self {
            Unit::Megabytes => ["MB/s", "mb_per_s"],
            Unit::Frames => ["frames/s", "frames_per_s"],
            Unit::Tokens => ["tokens/s", "tokens_per_s"],
            Unit::Windows => ["windows/s", "windows_per_s"],
        }
    }
}

/// The rates of a bench's timings.
#[derive(Debug, Clone, Copy)]
struct Rates {
    median: f64,
    low: f64,
    high: f64,
}

impl Rates {
    /// Of `amount` done in each of `seconds`, which are at least one.
    fn of(amount: f64, seconds: &[f64]) -> Rates {
        let mut rates: Vec<f64> = seconds.iter().map(|s| amount / s.max(1e-9)).collect();
        rates.sort_by(f64::total_cmp);
        let middle = rates.len() / 2;
        let median =
            if rates.len().is_multiple_of(2) { (rates[middle - 1] + rates[middle]) / 2.0 } else { rates[middle] };
        Rates { median, low: rates[0], high: rates[rates.len() - 1] }
    }
}

/// Seconds of each of `repeats` runs of `work`, after `warm_up` runs that don't count.
fn seconds(warm_up: u16, repeats: u16, mut work: impl FnMut() -> Result<()>) -> Result<Vec<f64>> {
    for _ in 0..warm_up {
        work()?;
    }
    let timed = |_| {
        let started = Instant::now();
        work()?;
        Ok(started.elapsed().as_secs_f64())
    };
    (0..repeats).map(timed).collect()
}

/// `x` with `digits` digits after the point, for JSON.
fn rounded(x: f64, digits: i32) -> Value {
    let unit = 10f64.powi(digits);
    json!((x * unit).round() / unit)
}

/// A line of a bench.
struct Row<'a> {
    what: &'a str,
    config: &'a str,
    unit: Unit,
    rates: Rates,
    threads: usize,
    /// Further figures: a JSON object's keys and values.
    more: Value,
}

impl Row<'_> {
    fn print(&self, how: &How) -> Result<()> {
        let (Rates { median, low, high }, [unit, key]) = (self.rates, self.unit.names());
        let peak = peak_rss_mb();
        if how.json {
            let mut line = Map::new();
            let rate = |x| rounded(x, 3);
            line.insert("schema".into(), json!(1));
            line.insert("what".into(), json!(self.what));
            line.insert("config".into(), json!(self.config));
            line.insert(key.into(), rate(median));
            line.insert("spread".into(), json!([rate(low), rate(high)]));
            line.insert("peak_rss_mb".into(), json!(peak));
            line.insert("threads".into(), json!(self.threads));
            line.extend(self.more.as_object().cloned().unwrap_or_default());
            return Ok(writeln!(std::io::stdout(), "{}", Value::Object(line))?);
        }
        let (what, config, threads) = (self.what, self.config, self.threads);
        let mut text =
            format!("{what:<9} {config:<32} {median:>11.1} {unit} ({low:.1} to {high:.1}), {threads} threads");
        if let Some(peak) = peak {
            text += &format!(", peak {peak} MB");
        }
        for (key, value) in self.more.as_object().into_iter().flatten() {
            text += &format!(", {} {}", key.replace('_', " "), value.to_string().trim_matches('"'));
        }
        Ok(writeln!(std::io::stdout(), "{text}")?)
    }
}

/// The most memory this process ever held, in 10^6 bytes; `None` where the system doesn't say.
fn peak_rss_mb() -> Option<u64> {
    peak_of(&std::fs::read_to_string("/proc/self/status").ok()?)
}

fn peak_of(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    // 1024 bytes, whatever the unit's name says
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024 / 1_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_of_rates_lies_between_the_middle_two() {
        let r = Rates::of(10.0, &[1.0, 5.0, 2.0, 10.0]);
        assert_eq!((r.median, r.low, r.high), (3.5, 1.0, 10.0));
        assert_eq!(Rates::of(3.0, &[1.5]).median, 2.0);
    }

    #[test]
    fn warm_ups_do_not_count() {
        let mut runs = 0;
        let timed = seconds(2, 3, || {
            runs += 1;
            Ok(())
        });
        assert_eq!((timed.unwrap().len(), runs), (3, 5));
    }

    #[test]
    fn the_peak_is_read_where_the_system_tells_it() {
        assert_eq!(peak_of("Name:\tx\nVmHWM:\t  100000 kB\nVmRSS:\t 1 kB\n"), Some(102));
        assert_eq!(peak_of("Name:\tx\n"), None);
    }
}
