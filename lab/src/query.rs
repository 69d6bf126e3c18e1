//! `kinelm-lab query`.

use crate::{How, Rates, Row, Say, Unit, rounded, seconds};
use anyhow::Result;
use kinelm::corpus::load::{ClipSpec, ModelClip};
use kinelm::motion::Clip;
use kinelm::spectral::WindowSpec;
use kinelm::spectral::query::synthetic::{repeated, synthetic};
use kinelm::spectral::query::{Distance, FeatureKind, Search, SearchOptions};
use serde_json::json;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The feature that windows are compared by
    #[arg(long, value_enum, default_value = "dct")]
    transform: TransformArg,
    /// Windows of the index; 100,000 of an STFT take 5 GB of memory
    #[arg(long, default_value_t = 100_000, value_parser = clap::value_parser!(u32).range(10..))]
    windows: u32,
    /// Motion files whose windows are repeated with small turns, instead of made-up dances
    #[arg(long, value_name = "FILE", num_args = 1..)]
    of: Vec<PathBuf>,
    /// Queries that are searched together
    #[arg(long, value_name = "Q", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=4096))]
    together: u32,
    /// Write the features (N, D) as f32 too, for other programs to search
    #[arg(long, value_name = "FILE")]
    save: Option<PathBuf>,
    #[command(flatten)]
    how: How,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum TransformArg {
    /// 1,152 numbers, as many as PCA's
    Dct,
    /// 9,720 numbers
    Stft,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let (kind, config) = match args.transform {
        TransformArg::Dct => (FeatureKind::dct(), "dct, 1152 numbers"),
        TransformArg::Stft => (FeatureKind::stft(), "stft, 9720 numbers"),
    };
    let count = args.windows as usize;
    let database = match args.of.is_empty() {
        true => synthetic(&kind, count)?,
        false => repeated(&kind, &clips(&args.of)?, count)?,
    };
    say.line(format_args!("{count} windows of {} numbers", database.numbers()));
    if let Some(file) = &args.save {
        let mut out = BufWriter::new(File::create(file)?);
        for window in 0..count {
            database.feature(window)?.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
        }
        out.flush()?;
    }
    for distance in [Distance::Cosine, Distance::Euclid] {
        let (mut query, mut wrong, mut measured) = (0, 0, Vec::new());
        let search = SearchOptions { k: 10, distance, one_per_clip: false, farthest: false };
        let timed = seconds(2, args.how.repeats.unwrap_or(15), || {
            // windows by a prime step, so that none comes soon again; each is its own nearest neighbour
            let queries: Vec<usize> = (1..=args.together as usize).map(|i| (query + i * 7919) % count).collect();
            query = queries[queries.len() - 1];
            let features: Vec<_> = queries.iter().map(|&q| Ok(database.feature(q)?)).collect::<Result<_>>()?;
            let features: Vec<&[f32]> = features.iter().map(|feature| &**feature).collect();
            let found = Search::new(&database, &features, search)?.nearest(&|_, _| true)?;
            for (query, found) in queries.iter().zip(found) {
                measured.push(found.measured);
                wrong += usize::from(found.hits.len() != 10 || found.hits[0].window != *query);
            }
            Ok(())
        })?;
        anyhow::ensure!(wrong == 0, "a window is its own nearest neighbour");
        let compared = count as f64 * f64::from(args.together);
        let rates = Rates::of(compared, &timed);
        measured.sort_unstable();
        let ms = rounded(1e3 * compared / rates.median, 2);
        let more = json!({"ms": ms, "distance": distance.name(), "together": args.together, "measured": measured[measured.len() / 2]});
        let threads = rayon::current_num_threads();
        Row { what: "query", config, unit: Unit::Windows, rates, threads, more }.print(&args.how)?;
    }
    Ok(())
}

/// Files as windows are cut from them.
fn clips(files: &[PathBuf]) -> Result<Vec<Clip>> {
    let spec = ClipSpec::in_world(WindowSpec::default().fps);
    files.iter().map(|file| Ok(ModelClip::load(file, &Default::default(), spec)?.clip)).collect()
}
