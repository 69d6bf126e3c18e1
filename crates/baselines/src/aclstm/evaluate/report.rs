//! What is said of a network that was measured.

use super::figures::{Figures, Lasting, Mean, Moves, unit};
use super::{COMPARED, Options, Seed, Test};
use crate::aclstm::form::Form;
use crate::aclstm::run::Trained;
use kinelm_view::table::terminal;
use serde::Serialize;
use std::collections::BTreeSet;
use std::fmt;

/// Figures of a network.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// The layout's version.
    pub schema: u32,
    /// The folder of the dances, where they are not the network's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dances: Option<String>,
    /// How the network writes a pose.
    pub form: Form,
    /// Frames of its own that it was fed in training.
    pub condition: usize,
    /// Updates that it had.
    pub step: u64,
    /// The split that seeds are from.
    pub split: String,
    /// Seeds of each length.
    pub seeds: usize,
    /// Takes that they are from.
    pub takes: usize,
    /// Below it a dance stands still, cm/s: in the world, and with the hip held at 0.
    pub thresholds_cm_s: [f64; 2],
    /// The real clips of the split.
    pub real: Lasting,
    /// Share of their steps with a flip.
    pub real_flips: f64,
    /// A row for each length of seed.
    pub rows: Vec<Row>,
}

/// Seeds of one length.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Frames of a seed.
    pub seed_frames: usize,
    /// What follows.
    pub figures: Figures,
}

impl Report {
    pub(super) fn new(trained: &Trained, options: &Options, test: &Test, seeds: &[&Seed], rows: Vec<Row>) -> Report {
        let real = &test.real;
        let [flips, steps] = real.iter().fold([0, 0], |[f, s], (_, [found, all])| [f + found, s + all]);
        let takes: BTreeSet<&str> = seeds.iter().map(|seed| &*seed.take).collect();
        let moves: Vec<(&str, &Moves)> = real.iter().map(|(moves, _)| ("real", moves)).collect();
        Report {
            schema: 1,
            dances: None,
            form: trained.file.config.form,
            condition: trained.file.config.condition,
            step: trained.step,
            split: options.split.to_string(),
            seeds: seeds.len(),
            takes: takes.len(),
            thresholds_cm_s: test.thresholds,
            real: Lasting::of(&moves, 0),
            real_flips: flips as f64 / steps.max(1) as f64,
            rows,
        }
    }
}

fn between(mean: &Mean, digits: usize) -> String {
    let [low, high] = mean.over_takes;
    format!("{:.digits$} ({low:.digits$} to {high:.digits$})", mean.mean)
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
        writeln!(f, "in brackets: the middle 95 % when takes are drawn anew\n")?;
        let next = |row: &Row| {
            let g = &row.figures;
            vec![
                row.seed_frames.to_string(),
                between(&g.loss, 4),
                format!("{:.4}", g.still_loss.mean),
                between(&g.root_cm, 2),
                format!("{:.2}", g.still_root_cm.mean),
                between(&g.degrees, 2),
                format!("{:.2}", g.still_degrees.mean),
            ]
        };
        let title = format!("The next {COMPARED} frames, beside the last true frame held");
        let rows: Vec<Vec<String>> = self.rows.iter().map(next).collect();
        write!(f, "{}", terminal(&title, &["seed", "loss", "held", "cm", "held", "degrees", "held"], &rows))?;
        writeln!(f, "loss: {}; cm: hips in one place; degrees: of local rotations\n", unit(self.form))?;
        let [world, pose] = self.thresholds_cm_s;
        let title = format!(
            "How long they move: still is below {world:.2} cm/s, {pose:.2} with the hip held, as 1 % of the training frames are"
        );
        let mut rows = vec![lasts(format!("real {}", self.split), &self.real, percent(self.real_flips, 2))];
        for row in &self.rows {
            let (g, seed) = (&row.figures, row.seed_frames.to_string());
            rows.push(lasts(seed.clone(), &g.short, percent(g.flips.mean, 2)));
            rows.push(lasts(seed, &g.long, String::new()));
        }
        let head = ["seed", "frames", "still", "still, hip held", "never freeze", "median", "cm/s", "flips"];
        write!(f, "{}", terminal(&title, &head, &rows).trim_end())
    }
}

fn percent(share: f64, digits: usize) -> String {
    format!("{:.digits$} %", 100.0 * share)
}

/// How some dances last; of 0 frames, the real ones, without intervals.
fn lasts(seed: String, of: &Lasting, flips: String) -> Vec<String> {
    let share = |x: Option<f64>| x.map_or("-".into(), |x| percent(x, 1));
    let interval = |mean: &Mean| {
        let times = |x: f64| 100.0 * x;
        let mean = Mean { mean: times(mean.mean), over_takes: mean.over_takes.map(times) };
        format!("{} %", between(&mean, 1))
    };
    let (frames, still, never) = match of.frames {
        0 => ("all".into(), share(of.pose.freeze_rate), share(of.pose.never)),
        n => (n.to_string(), interval(&of.still), interval(&of.never)),
    };
    let median = of.pose.median_time_to_freeze_s.map_or("not".into(), |s| format!("{s:.1} s"));
    vec![seed, frames, share(of.world.freeze_rate), still, never, median, format!("{:.1}", of.speed_cm_s), flips]
}
