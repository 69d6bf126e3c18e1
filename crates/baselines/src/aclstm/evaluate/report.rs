//! The report of an evaluation.

use super::metrics::{Duration, Metrics, Movement, unit};
use super::{COMPARED, Options, Seed, Test};
use crate::aclstm::run::Trained;
use crate::form::Form;
use kinelm_view::table::terminal;
use serde::Serialize;
use std::collections::BTreeSet;
use std::fmt;

/// Metrics of a network.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// The layout's version.
    pub schema: u32,
    /// The folder of the dances, if they are not the network's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dances: Option<String>,
    /// The network's representation of a pose.
    pub form: Form,
    /// Its own outputs that were alternating inputs in training.
    pub condition: usize,
    /// Updates done.
    pub step: u64,
    /// The split of the seeds.
    pub split: String,
    /// Seeds of each length.
    pub seeds: usize,
    /// Their takes.
    pub takes: usize,
    /// Energy below which a dance is still, cm/s: in the world, and with the hip fixed at 0.
    pub thresholds_cm_s: [f64; 2],
    /// The real clips of the split.
    pub real: Duration,
    /// Share of their steps with a flip.
    pub real_flips: f64,
    /// A row per length of seed.
    pub rows: Vec<Row>,
}

/// Seeds of one length.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Frames of a seed.
    pub seed_frames: usize,
    /// The metrics of the rollouts.
    pub metrics: Metrics,
}

impl Report {
    pub(super) fn new(trained: &Trained, options: &Options, test: &Test, seeds: &[&Seed], rows: Vec<Row>) -> Report {
        let real = &test.real;
        let [flips, steps] = real.iter().fold([0, 0], |[f, s], (_, [found, all])| [f + found, s + all]);
        let takes: BTreeSet<&str> = seeds.iter().map(|seed| &*seed.take).collect();
        // as if of one take: their intervals aren't printed
        let moves: Vec<(&str, &Movement)> = real.iter().map(|(moves, _)| ("real", moves)).collect();
        Report {
            schema: 2,
            dances: None,
            form: trained.file.config.form,
            condition: trained.file.config.condition,
            step: trained.step,
            split: options.split.to_string(),
            seeds: seeds.len(),
            takes: takes.len(),
            thresholds_cm_s: test.thresholds,
            real: Duration::of(&moves, 0),
            real_flips: flips as f64 / steps.max(1) as f64,
            rows,
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (condition, step, seeds, takes) = (self.condition, self.step, self.seeds, self.takes);
        let name = format!("{:?}", self.form).to_lowercase();
        match &self.dances {
            Some(folder) => write!(f, "the dances of {folder} as {name}")?,
            None => write!(f, "{name} {condition} after {step} updates")?,
        }
        writeln!(f, ": {seeds} seeds of {takes} {} takes", self.split)?;
        writeln!(f, "in brackets: 95 % intervals, by bootstrap over takes\n")?;
        let next = |row: &Row| {
            let m = &row.metrics;
            vec![
                row.seed_frames.to_string(),
                m.loss.text(4),
                format!("{:.4}", m.still_loss.mean),
                m.root_cm.text(2),
                format!("{:.2}", m.still_root_cm.mean),
                m.degrees.text(2),
                format!("{:.2}", m.still_degrees.mean),
            ]
        };
        let title = format!("The next {COMPARED} frames, beside holding the last true frame");
        let rows: Vec<Vec<String>> = self.rows.iter().map(next).collect();
        write!(f, "{}", terminal(&title, &["seed", "loss", "held", "cm", "held", "degrees", "held"], &rows))?;
        writeln!(f, "loss: {}; cm: hips aligned; degrees: of local rotations\n", unit(self.form))?;
        let [world, pose] = self.thresholds_cm_s;
        let title = format!(
            "How long they move: still is below {world:.2} cm/s, {pose:.2} with the hip fixed, as 1 % of the training frames are"
        );
        let mut rows = vec![duration(format!("real {}", self.split), &self.real, percent(self.real_flips, 2))];
        for row in &self.rows {
            let (m, seed) = (&row.metrics, row.seed_frames.to_string());
            rows.push(duration(seed.clone(), &m.short, percent(m.flips.mean, 2)));
            rows.push(duration(seed, &m.long, String::new()));
        }
        let head = ["seed", "frames", "still", "still, hip fixed", "never freeze", "median", "cm/s", "flips"];
        write!(f, "{}", terminal(&title, &head, &rows).trim_end())
    }
}

fn percent(share: f64, digits: usize) -> String {
    format!("{:.digits$} %", 100.0 * share)
}

/// A row of durations; 0 frames: the real clips, without intervals.
fn duration(seed: String, of: &Duration, flips: String) -> Vec<String> {
    let share = |x: Option<f64>| x.map_or("-".into(), |x| percent(x, 1));
    let (frames, still, never) = match of.frames {
        0 => ("all".into(), share(of.pose.freeze_rate), share(of.pose.never)),
        n => (n.to_string(), of.still.percent(1), of.never.percent(1)),
    };
    let median = of.pose.median_time_to_freeze_s.map_or("not".into(), |s| format!("{s:.1} s"));
    vec![seed, frames, share(of.world.freeze_rate), still, never, median, format!("{:.1}", of.speed_cm_s), flips]
}
