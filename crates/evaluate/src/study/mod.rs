//! Every way of turning motion into text, measured on the user's own data.
//!
//! A row is a tokenizer: fitted on the train clips, measured on the test clips, written to disk when it is done, so
//! that a study that was interrupted resumes. Clips are read, encoded and measured few at a time; memory doesn't grow
//! with the data.

mod channels;
mod clips;
mod measure;
mod metrics;
mod page;
mod pictures;
mod row;
mod store;
pub mod tables;

pub use measure::Loss;
pub use metrics::RowMetrics;
pub use row::{Row, RowDefaults, default_rows};

use crate::{Error, Result};
use channels::RotationChannel;
use clips::{Clips, Extent};
use kinelm_corpus::build::BuildOptions;
use kinelm_corpus::{Dataset, Item};
use kinelm_store::output::Outputs;
use kinelm_tokenizer::TokenizerConfig;
use kinelm_view::plot;
use serde::Serialize;
use std::path::{Path, PathBuf};
use store::Store;

/// The rate of rows that state none, unless the data are slower.
pub const USUAL_FPS: f64 = 60.0;

/// What a study is of.
#[derive(Debug, Clone)]
pub struct StudyOptions {
    /// How files are read.
    pub build: BuildOptions,
    /// The rows in TOML, and their path, for messages.
    pub rows: (String, PathBuf),
    /// Joints of rows that state none.
    pub joints: Vec<usize>,
    /// Frames per second of rows that state none; by itself [`USUAL_FPS`], or the slowest file's rate if that is lower.
    pub fps: Option<f64>,
    /// What was finished before is thrown away.
    pub force: bool,
    /// The rows that the page shows; by itself one of the tiles and one of the lapped rows.
    pub shown: Vec<String>,
    /// Components of joints' rotations, such as `right_shoulder.x`, whose distribution is drawn with the rows' bins.
    pub channels: Vec<String>,
}

/// What happens meanwhile.
#[derive(Debug)]
pub enum Event<'a> {
    /// A file could not be taken.
    Skipped(&'a Item, &'a Error),
    /// A row begins.
    Row(&'a str),
    /// One more clip was processed.
    Step {
        /// So far.
        done: u64,
        /// In all.
        of: u64,
    },
    /// Something the user should know.
    Note(&'a str),
}

/// The files of a study's folder beside `rows/`.
const FILES: [&str; 9] = [
    "study.json",
    "study.md",
    "bins.svg",
    "bins.png",
    "rate.svg",
    "rate.png",
    "channels.svg",
    "channels.png",
    "page.html",
];

/// All that a study found: `study.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// The mark by which the file is known as ours.
    pub made_by: &'static str,
    /// Of this form.
    pub schema: u32,
    /// The program's version.
    pub version: &'static str,
    /// SHA-256 of the clips' numbers.
    pub data: String,
    /// What was fitted on.
    pub train: Extent,
    /// What was measured on.
    pub test: Extent,
    /// Frames per second of rows that state none.
    pub fps: f64,
    /// The rates of the files, slowest first.
    pub file_rates: Vec<f64>,
    /// A row each, in the order of the file.
    pub rows: Vec<RowMetrics>,
    /// What rates and choices of joints lose before anything is coded.
    pub losses: Vec<Loss>,
}

impl Report {
    /// What a reader should know before the tables.
    pub fn notes(&self) -> Vec<String> {
        let of = |name: &str, e: &Extent| format!("{name}: {} clips, {} frames, {:.1} s", e.clips, e.frames, e.seconds);
        let rates: Vec<String> = self.file_rates.iter().map(|r| tables::short(*r)).collect();
        let mut notes = vec![
            of("train", &self.train),
            of("test", &self.test),
            format!(
                "the files have {} frames per second; rows that state none have {}",
                rates.join(", "),
                tables::short(self.fps)
            ),
            "errors are against the clip at the row's own rate; joints that are not coded are the clip's own in both"
                .into(),
        ];
        if self.fps < USUAL_FPS {
            let (fps, seconds) = (tables::short(self.fps), USUAL_FPS / self.fps);
            notes.push(format!("at {fps} frames per second a tile of 60 frames is {seconds:.1} s long, not 1 s"));
        }
        notes
    }
}

/// Measures every row and writes `study.json`, `study.md`, the pictures (with channels also theirs), `page.html` and
/// `rows/` under `out`.
///
/// # Errors
/// [`kinelm_store::Error::File`] for wrong rows (before anything is read) and for an `out` that no study wrote; [`kinelm_store::Error::Invalid`] when a
/// split is empty or a row can't be fitted; those of reading and writing.
pub fn study(
    dataset: &Dataset,
    options: &StudyOptions,
    out: &Path,
    outputs: &Outputs,
    watch: &mut dyn FnMut(Event<'_>),
) -> Result<Report> {
    let names = FILES.map(|name| out.join(name));
    outputs.check(names.iter().map(PathBuf::as_path))?;
    names.iter().try_for_each(|path| outputs.check_replaceable(path, None))?;
    let rows_at = |fps: f64| {
        let defaults = RowDefaults { joints: options.joints.clone(), fps };
        row::parse(&options.rows.0, &options.rows.1, &defaults)
    };
    // before hours of reading: wrong rows and names need no clip to be found
    let named = rows_at(options.fps.unwrap_or(USUAL_FPS))?;
    check_shown(&named, &options.shown)?;
    let channels = RotationChannel::parse_all(&options.channels, &named)?;
    let clips = Clips::scan(dataset, &options.build, &mut |item, e| watch(Event::Skipped(item, e)))?;
    clips.doubts.line().iter().for_each(|line| watch(Event::Note(line)));
    let fps = options.fps.unwrap_or(clips.slowest().min(USUAL_FPS));
    let rows = rows_at(fps)?;
    let data = clips.sha256();
    let store = Store::open(out, &data, options.force)?;
    let figures = measured(&rows, &clips, &store, watch)?;
    let losses = lost(&rows, &clips, &store)?;
    let [train, test] = clips.extents();
    let (file_rates, version) = (clips.rates(), env!("CARGO_PKG_VERSION"));
    let report =
        Report { made_by: "kinelm", schema: 1, version, data, train, test, fps, file_rates, rows: figures, losses };
    let json = serde_json::to_string_pretty(&report).expect("a report has text keys");
    let mut contents = vec![("study.json".to_string(), (json + "\n").into_bytes())];
    contents.push(("study.md".into(), tables::markdown(&report).into_bytes()));
    let of_channels = channels::charts(&channels, &rows, &clips, &store, &mut |line| watch(Event::Note(line)))?;
    for (name, charts) in pictures::all(&report).into_iter().chain([("channels", of_channels)]) {
        for name in [format!("{name}.svg"), format!("{name}.png")] {
            let bytes = plot::to_bytes(Path::new(&name), &charts)?;
            contents.extend(bytes.map(|bytes| (name, bytes)));
        }
    }
    let page = page::page(&report.rows, &options.shown, &clips, &store)?;
    contents.extend(page.map(|page| ("page.html".into(), page.into_bytes())));
    for (name, bytes) in &contents {
        outputs.write(&out.join(name), bytes)?;
    }
    Ok(report)
}

fn check_shown(rows: &[Row], shown: &[String]) -> Result<()> {
    match shown.iter().find(|name| rows.iter().all(|r| r.name != **name)) {
        Some(name) => Err(Error::invalid_parameter("show", name, "the names of rows")),
        None => Ok(()),
    }
}

/// The figures of all rows, those that were finished before as they were.
fn measured(rows: &[Row], clips: &Clips, store: &Store, watch: &mut dyn FnMut(Event<'_>)) -> Result<Vec<RowMetrics>> {
    let mut found = Vec::with_capacity(rows.len());
    for row in rows {
        let figures = store.get::<RowMetrics>(&row.name, &row.config);
        // a row without its tokenizer is fitted again: the page reads that
        let figures = figures.filter(|_| store.tokenizer(row).is_file());
        // results are found by name and settings; the group may have changed since
        found.push(figures.map(|f| RowMetrics { row: row.clone(), ..f }));
    }
    let open = found.iter().filter(|f| f.is_none()).count();
    if open < rows.len() {
        watch(Event::Note(&format!("{} of {} rows were measured before", rows.len() - open, rows.len())));
    }
    let [train, test] = measure::PASSES;
    let of = (open * (train * clips.train.len() + test * clips.test.len())) as u64;
    let mut done = 0;
    for (row, figures) in rows.iter().zip(&mut found) {
        if figures.is_some() {
            continue;
        }
        watch(Event::Row(&row.name));
        let mut step = || {
            done += 1;
            watch(Event::Step { done, of });
        };
        let (measured, tokenizer) = measure::measure(row, clips, &mut step)?;
        tokenizer.save(store.tokenizer(row))?;
        store.put(&row.name, &row.config, &measured)?;
        *figures = Some(measured);
    }
    Ok(found.into_iter().flatten().collect())
}

/// What every rate and choice of joints among the rows loses.
fn lost(rows: &[Row], clips: &Clips, store: &Store) -> Result<Vec<Loss>> {
    let mut losses: Vec<Loss> = Vec::new();
    for TokenizerConfig { joints, fps, .. } in rows.iter().map(|r| &r.config) {
        if losses.iter().any(|l| l.fps == *fps && l.joints == *joints) {
            continue;
        }
        let what = ("loss", fps, joints);
        let loss = match store.get("loss", &what) {
            Some(loss) => loss,
            None => {
                let loss = measure::loss(clips, *fps, joints)?;
                store.put("loss", &what, &loss)?;
                loss
            }
        };
        losses.push(loss);
    }
    Ok(losses)
}
