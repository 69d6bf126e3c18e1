//! How well the neighbours of a window share its labels: the thesis's tables 3.1 and 3.2; docs/query.md, "Do
//! neighbours share labels?".

use super::build::no_window;
use super::database::Database;
use super::distance::{Distance, SearchOptions};
use super::embedding::Models;
use super::exclude::{Exclude, Exclusion, Origin};
use super::options::{FeatureKind, IndexOptions};
use super::record::ClipEntry;
use super::search::{Found, Hit, Search};
use super::vote::{Tally, vote};
use crate::{Error, Result, WindowSpec};
pub use kinelm_corpus::build::{BuildOptions, BuildProgress, Summary, for_each_clip};
use kinelm_corpus::labels::LabelFilter;
use kinelm_corpus::{Dataset, Item};
use kinelm_motion::Clip;
use kinelm_store::random;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;

/// Queries in a batch.
const QUERIES: usize = 64;

/// The options of an evaluation.
#[derive(Debug, Clone)]
pub struct EvaluateOptions {
    /// How files are read.
    pub build: BuildOptions,
    /// How series are cut into windows.
    pub windows: WindowSpec,
    /// SMPL joints; all if empty. A model reads its own.
    pub joints: Vec<usize>,
    /// Canonical rotation vectors (compat); a model reads its own.
    pub raw: bool,
    /// The feature that windows are compared by.
    pub transforms: Vec<FeatureKind>,
    /// The measure of nearness.
    pub distances: Vec<Distance>,
    /// Label fields; by themselves those that all clips have with at least two values.
    pub fields: Vec<String>,
    /// Only clips with these labels.
    pub only: Vec<LabelFilter>,
    /// The exclusion of the main figures.
    pub exclude: Exclude,
    /// Neighbours.
    pub k: usize,
    /// How the model of a transform is opened.
    pub models: Models,
}

/// Accuracy and entropy of one kind of query.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// The label.
    pub field: String,
    /// As [`FeatureKind::name`]; `chance` is neighbours sampled at random from those allowed.
    pub transform: String,
    /// Cosine or Euclid.
    pub distance: Option<Distance>,
    /// The exclusion.
    pub exclude: Exclude,
    /// The first frame of a clip's first window.
    pub phase: usize,
    /// Queries; windows that have no neighbour don't count.
    pub queries: usize,
    /// Share of right majorities.
    pub accuracy: Option<f64>,
    /// Half of its 95 % interval over recordings.
    pub half_interval: Option<f64>,
    /// Mean entropy of the neighbours' labels, bans.
    pub entropy_bans: Option<f64>,
}

/// The values of a label.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Shares {
    /// The label.
    pub field: String,
    /// Value to share of the windows at the first phase.
    pub shares: BTreeMap<String, f64>,
}

/// All that was measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Of this form.
    pub schema: u32,
    /// The program's version.
    pub version: &'static str,
    /// How series are cut into windows.
    pub windows: WindowSpec,
    /// Neighbours.
    pub k: usize,
    /// The exclusion of the main figures.
    pub exclude: Exclude,
    /// Clips with at least one window.
    pub clips: usize,
    /// Clips shorter than a window.
    pub short: usize,
    /// Recordings.
    pub takes: usize,
    /// Windows at each phase.
    pub queries: Vec<(usize, usize)>,
    /// Of each label.
    pub shares: Vec<Shares>,
    /// All figures.
    pub rows: Vec<Row>,
    /// Of the files that were read.
    #[serde(skip)]
    pub summary: Summary,
}

/// A clip in memory.
struct LoadedClip {
    clip: Clip,
    entry: ClipEntry,
}

/// Reads the clips, and queries each window at both phases (windows from a clip's first frame on, and from half a hop
/// on).
///
/// # Errors
/// Files that can't be read where `strict` is given; [`kinelm_store::Error::Missing`] when no clip is as long as a window or has the labels
/// requested, a label that some clip doesn't have, or has but one value.
pub fn evaluate(dataset: &Dataset, options: &EvaluateOptions, watch: &mut BuildProgress<'_>) -> Result<Report> {
    options.windows.validate()?;
    let mut of_kind = Vec::new();
    for kind in &options.transforms {
        let model = matches!(kind, FeatureKind::Model { .. });
        let (joints, raw) = if model { (vec![], false) } else { (options.joints.clone(), options.raw) };
        let one = IndexOptions { transform: kind.clone(), windows: options.windows, joints, raw };
        one.validate()?;
        of_kind.push(one);
    }
    let items = chosen(dataset, &options.only)?;
    let (held, short, summary) = load(&items, options, watch)?;
    let fields = fields_of(&held, &options.fields)?;
    let entries = held.iter().map(|h| &h.entry);
    options.exclude.check(entries.clone())?;
    let excludes: Vec<Exclude> = Exclude::ALL.into_iter().filter(|e| e.check(entries.clone()).is_ok()).collect();
    let mut takes: Vec<&str> = held.iter().map(|h| h.entry.take.as_str()).collect();
    // sorted, since `count` looks recordings up by bisection
    takes.sort_unstable();
    takes.dedup();
    let labels: Vec<Labels> = fields.iter().map(|f| Labels::of(&held, f)).collect();
    let mut report = Report {
        schema: 1,
        version: env!("CARGO_PKG_VERSION"),
        windows: options.windows,
        k: options.k,
        exclude: options.exclude,
        clips: held.len(),
        short,
        takes: takes.len(),
        queries: Vec::new(),
        shares: labels.iter().map(|l| l.shares(&held, &options.windows)).collect(),
        rows: Vec::new(),
        summary,
    };
    // a second cut of the same clips shows how much figures depend on where windows begin
    for phase in [0, options.windows.hop / 2] {
        let count = held.iter().map(|h| options.windows.starts(h.clip.frames(), phase).count()).sum();
        report.queries.push((phase, count));
        for kind in &of_kind {
            let database = database(&held, kind, phase, options.models)?;
            let judge =
                Judge { database: &database, labels: &labels, takes: &takes, options, excludes: &excludes, phase };
            report.rows.extend(judge.ask(&kind.transform)?);
            // chance doesn't depend on the feature
            if kind == &of_kind[0] {
                report.rows.extend(judge.chance());
            }
        }
        // half a hop is 0 then, and the second phase would be the first again
        if options.windows.hop < 2 {
            break;
        }
    }
    Ok(report)
}

/// The items with these labels.
fn chosen<'a>(dataset: &'a Dataset, only: &[LabelFilter]) -> Result<Vec<&'a Item>> {
    let fits = |i: &&Item| only.iter().all(|label| label.allows(&i.labels));
    let items: Vec<&Item> = dataset.items.iter().filter(fits).collect();
    if items.is_empty() {
        let wanted: Vec<String> = only.iter().map(LabelFilter::to_string).collect();
        let what = format!("clip with the labels {}", wanted.join(" "));
        return Err(Error::missing(what, "see which labels the clips have"));
    }
    Ok(items)
}

/// The clips that have a window, how many have none, and what reading found.
fn load(
    items: &[&Item],
    options: &EvaluateOptions,
    watch: &mut BuildProgress<'_>,
) -> Result<(Vec<LoadedClip>, usize, Summary)> {
    let (mut held, mut short) = (Vec::new(), 0);
    let spec = options.windows;
    let summary = for_each_clip(
        items,
        &options.build,
        kinelm_corpus::load::ClipSpec::in_world(spec.fps),
        watch,
        |_, loaded| Ok(loaded.clip.clone()),
        |item, sha256, clip, _| -> Result<_> {
            let frames = clip.frames();
            if frames < spec.frames {
                short += 1;
                return Ok(frames);
            }
            let Item { name, path, take, labels, .. } = item.clone();
            let read = item.read_options(&options.build.read);
            held.push(LoadedClip {
                clip,
                entry: ClipEntry { name, path, sha256, read, take, labels, frames, starts: vec![] },
            });
            Ok(frames)
        },
    )?;
    if held.is_empty() {
        return Err(no_window(&spec));
    }
    Ok((held, short, summary))
}

/// The label fields that are measured.
fn fields_of(held: &[LoadedClip], requested: &[String]) -> Result<Vec<String>> {
    let first = &held[0].entry.labels;
    let values = |field: &String| {
        let mut values: Vec<&String> = held.iter().filter_map(|h| h.entry.labels.get(field)).collect();
        let clips = values.len();
        values.sort_unstable();
        values.dedup();
        (clips, values.len())
    };
    for field in requested {
        let (clips, count) = values(field);
        if clips < held.len() {
            let lacks = held.iter().find(|h| !h.entry.labels.contains_key(field)).map_or("", |h| &h.entry.name);
            let known: Vec<&str> = first.keys().map(String::as_str).collect();
            let known = if known.is_empty() { "no labels".into() } else { known.join(", ") };
            let what =
                format!("label `{field}` on {} of {} clips, the first is {lacks}", held.len() - clips, held.len());
            return Err(Error::missing(what, format!("every clip needs it; the first clip has {known}")));
        }
        if count < 2 {
            return Err(Error::invalid(format!("label `{field}`"), "one value on all clips", "at least two values"));
        }
    }
    let all: Vec<String> = match requested {
        [] => first.keys().filter(|f| values(f) >= (held.len(), 2)).cloned().collect(),
        requested => requested.to_vec(),
    };
    if all.is_empty() {
        let help = "neighbours are judged by labels; give the clips some";
        return Err(Error::missing("label that all clips have, with two values or more", help));
    }
    Ok(all)
}

/// A field, and each clip's value as a number.
struct Labels {
    field: String,
    values: Vec<String>,
    of_clip: Vec<usize>,
}

impl Labels {
    fn of(held: &[LoadedClip], field: &str) -> Labels {
        let value = |h: &LoadedClip| h.entry.labels[field].clone();
        let mut values: Vec<String> = held.iter().map(value).collect();
        values.sort_unstable();
        values.dedup();
        let of_clip = held.iter().map(|h| values.partition_point(|v| *v < h.entry.labels[field])).collect();
        Labels { field: field.into(), values, of_clip }
    }

    fn shares(&self, held: &[LoadedClip], spec: &WindowSpec) -> Shares {
        let mut counts = vec![0usize; self.values.len()];
        for (h, &value) in held.iter().zip(&self.of_clip) {
            counts[value] += spec.starts(h.clip.frames(), 0).count();
        }
        let all = counts.iter().sum::<usize>().max(1) as f64;
        let shares = self.values.iter().cloned().zip(counts.iter().map(|&n| n as f64 / all)).collect();
        Shares { field: self.field.clone(), shares }
    }
}

/// The windows of all clips at a phase.
fn database(held: &[LoadedClip], options: &IndexOptions, phase: usize, models: Models) -> Result<Database> {
    let with_windows = |h: &LoadedClip| {
        let starts = options.windows.starts(h.clip.frames(), phase).collect();
        ClipEntry { starts, ..h.entry.clone() }
    };
    Database::of_clips(options, held.iter().map(|h| (&h.clip, with_windows(h))).collect(), models)
}

/// One database and its queries.
struct Judge<'a> {
    database: &'a Database,
    labels: &'a [Labels],
    takes: &'a [&'a str],
    options: &'a EvaluateOptions,
    excludes: &'a [Exclude],
    phase: usize,
}

impl Judge<'_> {
    /// Queries every window by every distance and exclusion.
    fn ask(&self, kind: &FeatureKind) -> Result<Vec<Row>> {
        let distances = self.options.distances.iter();
        let ways: Vec<_> = distances.flat_map(|&d| self.excludes.iter().map(move |&e| (Some(d), e))).collect();
        let mut tallies = vec![Tally::default(); ways.len() * self.labels.len()];
        let windows: Vec<usize> = (0..self.database.windows()).collect();
        for block in windows.chunks(QUERIES) {
            let features: Vec<_> = block.iter().map(|&w| self.database.feature(w)).collect::<Result<_>>()?;
            let features: Vec<&[f32]> = features.iter().map(|feature| &**feature).collect();
            let filters = |&exclude: &Exclude| block.iter().map(|&query| self.filter(query, exclude)).collect();
            let filters: Vec<Vec<Exclusion>> = self.excludes.iter().map(filters).collect();
            let mut found: Vec<Vec<Found>> = Vec::new();
            for &distance in &self.options.distances {
                let wanted = SearchOptions { k: self.options.k, distance, one_per_clip: false, farthest: false };
                let search = Search::new(self.database, &features, wanted)?;
                for filters in &filters {
                    found.push(search.nearest(&|query, window| filters[query].allows(window))?);
                }
            }
            for (i, &query) in block.iter().enumerate() {
                self.count(query, found.iter().map(|way| &way[i].hits[..]), &mut tallies);
            }
        }
        Ok(self.rows(kind.name(), &ways, &tallies))
    }

    /// Neighbours sampled at random from those allowed.
    fn chance(&self) -> Vec<Row> {
        let ways: Vec<(Option<Distance>, Exclude)> = self.excludes.iter().map(|&e| (None, e)).collect();
        let mut tallies = vec![Tally::default(); ways.len() * self.labels.len()];
        let draw = |query: usize| -> Vec<Vec<Hit>> {
            let mut rng = random::stream(0, "query chance", self.phase as u64, query as u64);
            let mut some = |&(_, exclude): &(Option<Distance>, Exclude)| {
                let filter = self.filter(query, exclude);
                let mut allowed: Vec<usize> = (0..self.database.windows()).filter(|&w| filter.allows(w)).collect();
                let k = self.options.k.min(allowed.len());
                for i in 0..k {
                    let other = i + (random::unit(&mut rng) * (allowed.len() - i) as f64) as usize;
                    allowed.swap(i, other);
                }
                allowed[..k].iter().map(|&window| Hit { window, score: 0.0 }).collect()
            };
            ways.iter().map(&mut some).collect()
        };
        let found: Vec<_> = (0..self.database.windows()).into_par_iter().map(draw).collect();
        for (query, found) in found.iter().enumerate() {
            self.count(query, found.iter().map(Vec::as_slice), &mut tallies);
        }
        self.rows("chance", &ways, &tallies)
    }

    fn filter(&self, query: usize, exclude: Exclude) -> Exclusion<'_> {
        let origin = Origin::of(self.database, self.database.window(query));
        Exclusion::new(self.database, exclude, origin, self.options.windows.frames)
    }

    /// Counts the votes of one query's neighbours, way by way.
    fn count<'h>(&self, query: usize, found: impl Iterator<Item = &'h [Hit]>, tallies: &mut [Tally]) {
        let clip = self.database.window(query).clip;
        let take = self.database.clips()[clip].take.as_str();
        let group = self.takes.partition_point(|&t| t < take);
        for (found, tallies) in found.zip(tallies.chunks_mut(self.labels.len())) {
            for (labels, tally) in self.labels.iter().zip(tallies) {
                let values = found.iter().map(|hit| (labels.of_clip[self.database.window(hit.window).clip], hit.score));
                if let Some(vote) = vote(values, labels.values.len()) {
                    tally.add(group, vote.winner == labels.of_clip[clip], vote.entropy);
                }
            }
        }
    }

    fn rows(&self, name: &str, ways: &[(Option<Distance>, Exclude)], tallies: &[Tally]) -> Vec<Row> {
        let all = ways.iter().zip(tallies.chunks(self.labels.len()));
        let row = |(&(distance, exclude), (labels, tally)): (&(Option<Distance>, Exclude), (&Labels, &Tally))| Row {
            field: labels.field.clone(),
            transform: name.into(),
            distance,
            exclude,
            phase: self.phase,
            queries: tally.queries(),
            accuracy: tally.accuracy(),
            half_interval: tally.half_interval(),
            entropy_bans: tally.entropy(),
        };
        all.flat_map(|(way, tallies)| self.labels.iter().zip(tallies).map(move |both| (way, both))).map(row).collect()
    }
}
