//! What is said of a network that was measured.

use super::figures::{Figures, Lasting};
use super::{FPS, Options};
use crate::aclstm::evaluate::Mean;
use crate::music_lstm::config::Config;
use crate::music_lstm::run::Trained;
use kinelm_view::table::terminal;
use serde::Serialize;
use std::fmt;

/// Figures of a network.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// The layout's version.
    pub schema: u32,
    /// The run's settings.
    pub config: Config,
    /// Updates that it had.
    pub step: u64,
    /// Below it a dance stands still, cm/s.
    pub threshold_cm_s: f64,
    /// The filter's frequency, Hz.
    pub cutoff_hz: f64,
    /// Dances of a split to some music.
    pub rows: Vec<Row>,
    /// A long dance to unheard music.
    pub lasting: Lasting,
}

/// Dances of a split to some music.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// The split of the clips.
    pub split: String,
    /// What is danced to.
    pub music: String,
    /// What they are like.
    pub figures: Figures,
}

impl Report {
    pub(super) fn new(
        trained: &Trained,
        options: &Options,
        threshold_cm_s: f64,
        rows: Vec<Row>,
        lasting: Lasting,
    ) -> Report {
        let (config, step) = (trained.file.config.clone(), trained.step);
        Report { schema: 1, config, step, threshold_cm_s, cutoff_hz: options.cutoff_hz, rows, lasting }
    }
}

fn between(mean: &Mean, digits: usize) -> String {
    let [low, high] = mean.over_takes;
    format!("{:.digits$} ({low:.digits$} to {high:.digits$})", mean.mean)
}

fn maybe(mean: Option<&Mean>, digits: usize) -> String {
    mean.map_or("-".into(), |mean| between(mean, digits))
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lower = |x: &dyn fmt::Debug| format!("{x:?}").to_lowercase();
        let (audio, pose, effort) = (lower(&self.config.audio), lower(&self.config.pose), lower(&self.config.effort));
        let (every, step) = (self.config.effort_every, self.step);
        writeln!(f, "audio {audio}, pose {pose}, effort {effort} every {every}, after {step} updates")?;
        writeln!(f, "in brackets: the middle 95 % when takes are drawn anew\n")?;
        let head = |row: &Row| vec![row.split.clone(), row.music.clone(), row.figures.dances.to_string()];
        let near = |row: &Row| {
            let g = &row.figures;
            let more = [
                between(&g.degrees, 2),
                between(&g.hip_degrees, 1),
                format!("{:.2}", g.mean_pose_degrees.mean),
                maybe(g.worse_degrees.as_ref(), 2),
                maybe(g.apart_degrees.as_ref(), 2),
            ];
            [head(row), more.to_vec()].concat()
        };
        let title = "Degrees between local rotations and the true ones";
        let columns = ["split", "music", "dances", "all joints", "hip", "mean pose", "worse than own", "from own"];
        let rows: Vec<Vec<String>> = self.rows.iter().map(near).collect();
        writeln!(f, "{}\n", terminal(title, &columns, &rows).trim_end())?;
        let like = |row: &Row| {
            let g = &row.figures;
            let still = Mean { mean: 100.0 * g.still.mean, over_takes: g.still.over_takes.map(|x| 100.0 * x) };
            let more = [
                format!("{:.2}", g.speed_rad_s),
                between(&g.speed_ratio, 2),
                between(&g.jitter_ratio, 2),
                between(&g.filtered_jitter_ratio, 2),
                between(&g.hip_flips_per_minute, 1),
                format!("{} %", between(&still, 0)),
            ];
            [head(row), more.to_vec()].concat()
        };
        let title = format!(
            "What they are like: over the true dances' speed and jitter; still is below {:.2} cm/s, as 1 % of the training \
             frames are",
            self.threshold_cm_s
        );
        let filtered = format!("jitter, {} Hz", self.cutoff_hz);
        let columns = ["split", "music", "dances", "rad/s", "speed", "jitter", &filtered, "hip flips/min", "still"];
        let rows: Vec<Vec<String>> = self.rows.iter().map(like).collect();
        writeln!(f, "{}\n", terminal(&title, &columns, &rows).trim_end())?;
        let long = &self.lasting;
        let freezes = long.freezes_at_s.map_or("doesn't freeze".into(), |s| format!("freezes at {s:.1} s"));
        let (frames, seconds) = (long.frames, long.frames as f64 / FPS);
        write!(
            f,
            "{frames} frames ({seconds:.0} s) to unheard music: {freezes}; still {:.1} %, {:.2} rad/s, {:.1} hip flips a \
             minute; {:.0} frames a second",
            100.0 * long.still,
            long.speed_rad_s,
            long.hip_flips_per_minute,
            long.frames_per_second
        )
    }
}
