//! The report of an evaluation.

use super::Options;
use super::metrics::{LongDance, Metrics};
use crate::music_lstm::config::Config;
use crate::music_lstm::run::Trained;
use crate::{FPS, Mean};
use kinelm_view::table::terminal;
use serde::Serialize;
use std::fmt;

/// Metrics of a network.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// The layout's version.
    pub schema: u32,
    /// The run's settings.
    pub config: Config,
    /// Updates done.
    pub step: u64,
    /// Energy below which a dance is still, cm/s.
    pub threshold_cm_s: f64,
    /// The cutoff of the low-pass filter, Hz.
    pub cutoff_hz: f64,
    /// Dances of a split to some music.
    pub rows: Vec<Row>,
    /// A long dance to unseen music.
    pub long: LongDance,
}

/// Dances of a split to some music.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// The split of the clips.
    pub split: String,
    /// The music.
    pub music: String,
    /// Their metrics.
    pub metrics: Metrics,
}

impl Report {
    pub(super) fn new(
        trained: &Trained,
        options: &Options,
        threshold_cm_s: f64,
        rows: Vec<Row>,
        long: LongDance,
    ) -> Report {
        let (config, step) = (trained.file.config.clone(), trained.step);
        Report { schema: 2, config, step, threshold_cm_s, cutoff_hz: options.cutoff_hz, rows, long }
    }
}

fn maybe(mean: Option<&Mean>, digits: usize) -> String {
    mean.map_or("-".into(), |mean| mean.text(digits))
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lower = |x: &dyn fmt::Debug| format!("{x:?}").to_lowercase();
        let (audio, pose, effort) = (lower(&self.config.audio), lower(&self.config.pose), lower(&self.config.effort));
        let (every, step) = (self.config.effort_every, self.step);
        writeln!(f, "audio {audio}, pose {pose}, effort {effort} every {every}, after {step} updates")?;
        writeln!(f, "in brackets: 95 % intervals, by bootstrap over takes\n")?;
        let head = |row: &Row| vec![row.split.clone(), row.music.clone(), row.metrics.dances.to_string()];
        let errors = |row: &Row| {
            let m = &row.metrics;
            let more = [
                m.degrees.text(2),
                m.hip_degrees.text(1),
                format!("{:.2}", m.mean_pose_degrees.mean),
                maybe(m.worse_degrees.as_ref(), 2),
                maybe(m.from_own_degrees.as_ref(), 2),
            ];
            [head(row), more.to_vec()].concat()
        };
        let title = "Degrees between local rotations and the true ones";
        let columns = ["split", "music", "dances", "all joints", "hip", "mean pose", "worse than own", "from own"];
        let rows: Vec<Vec<String>> = self.rows.iter().map(errors).collect();
        writeln!(f, "{}\n", terminal(title, &columns, &rows).trim_end())?;
        let movement = |row: &Row| {
            let m = &row.metrics;
            let more = [
                format!("{:.2}", m.speed_rad_s),
                m.speed_ratio.text(2),
                m.jitter_ratio.text(2),
                m.filtered_jitter_ratio.text(2),
                m.hip_flips_per_minute.text(1),
                m.still.percent(0),
            ];
            [head(row), more.to_vec()].concat()
        };
        let title = format!(
            "Movement, over the true dances' speed and jitter; still is below {:.2} cm/s, as 1 % of the training frames are",
            self.threshold_cm_s
        );
        let filtered = format!("jitter, {} Hz", self.cutoff_hz);
        let columns = ["split", "music", "dances", "rad/s", "speed", "jitter", &filtered, "hip flips/min", "still"];
        let rows: Vec<Vec<String>> = self.rows.iter().map(movement).collect();
        writeln!(f, "{}\n", terminal(&title, &columns, &rows).trim_end())?;
        let long = &self.long;
        let freezes = long.freezes_at_s.map_or("doesn't freeze".into(), |s| format!("freezes at {s:.1} s"));
        let (frames, seconds) = (long.frames, long.frames as f64 / FPS);
        write!(
            f,
            "{frames} frames ({seconds:.0} s) to unseen music: {freezes}; still {:.1} %, {:.2} rad/s, {:.1} hip flips a \
             minute; {:.0} frames a second",
            100.0 * long.still,
            long.speed_rad_s,
            long.hip_flips_per_minute,
            long.frames_per_second
        )
    }
}
