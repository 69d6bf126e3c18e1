//! A report as tables.

use super::beats;
use super::beats::BeatMetrics;
use super::metrics::GroupMetrics;
use super::report::{Copied, Report};
use crate::number::{number, percent};
use std::fmt;

impl Report {
    /// A row of `cells` a group, without a line end after the last.
    fn table(
        &self,
        f: &mut fmt::Formatter<'_>,
        heads: &[&str],
        cells: impl Fn(&GroupMetrics) -> Vec<String>,
    ) -> fmt::Result {
        write!(f, "{:<32}", "")?;
        heads.iter().try_for_each(|head| write!(f, " {head:>11}"))?;
        for group in &self.groups {
            write!(f, "\n{:<32}", shortened(&group.name))?;
            cells(group).iter().try_for_each(|cell| write!(f, " {cell:>11}"))?;
        }
        Ok(())
    }
}

impl fmt::Display for Report {
    /// Tables, without a line end after the last.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (j, fps) = (self.joints.len(), self.fps);
        let frames = self.groups.first().map_or(0, |train| train.world.frames);
        writeln!(
            f,
            "{j} joints at {fps} fps; a frame stands still up to the first percentile of {frames} training frames:"
        )?;
        writeln!(
            f,
            "{:.3} cm/s in the world, {:.3} cm/s of the pose alone",
            self.threshold_cm_s, self.pose_threshold_cm_s
        )?;
        self.table(f, &["frames", "freeze %", "(sd)", "pose %", "to freeze s", "never %", "repeat %"], |group| {
            let w = &group.world;
            vec![
                w.frames.to_string(),
                percent(w.freeze_rate),
                percent(w.freeze_rate_sd),
                percent(group.pose.freeze_rate),
                // the dance in the middle doesn't freeze: later than the longest lasts
                w.median_time_to_freeze_s.map_or(format!("> {:.0}", w.duration_s[1]), |t| format!("{t:.1}")),
                percent(w.never),
                percent(group.repeat_rate),
            ]
        })?;
        writeln!(f)?;
        // of n times 30 frames a second PFC has n values
        let spreads = self.groups.iter().any(|group| group.pfc_spread.is_some());
        let mut heads = vec![
            "speed cm/s",
            "jitter m/s3",
            "skate cm/s",
            "skating %",
            "in floor cm",
            "in floor %",
            "floating %",
            "PFC",
        ];
        heads.extend(spreads.then_some("(spread)"));
        self.table(f, &heads, |group| {
            let mut cells = vec![
                number(group.speed_cm_s, 1),
                number(group.jitter_m_s3, 0),
                number(group.skate_cm_s, 1),
                percent(group.skate_share),
                number(group.penetration_cm, 2),
                percent(group.penetration_share),
                percent(group.floating_share),
                number(group.pfc, 2),
            ];
            let spread = || group.pfc_spread.map_or("n/a".into(), |[least, most]| format!("{least:.2}-{most:.2}"));
            cells.extend(spreads.then(spread));
            cells
        })?;
        writeln!(f)?;
        let heads =
            ["outside %", "outside cm", "kicks %", "hands up %", "snaps/min", "fastest m/s", "knee deg", "elbow deg"];
        self.table(f, &heads, |group| {
            let [knee, elbow] = group.bends_deg;
            vec![
                percent(group.outside_share),
                number(group.outside_cm, 2),
                percent(group.kick_share),
                percent(group.raised_share),
                number(group.snaps_per_min, 1),
                number(group.fastest_m_s, 1),
                number(Some(knee), 0),
                number(Some(elbow), 0),
            ]
        })?;
        write!(f, "\nfreeze % of every 5 s:")?;
        // train, valid and the dances together
        for group in self.groups.iter().take(3).filter(|g| g.world.dances > 0) {
            write!(f, "\n{:<32}", shortened(&group.name))?;
            // two minutes a line
            group.world.per_5_s.iter().take(24).try_for_each(|x| write!(f, " {:.1}", 100.0 * x))?;
        }
        for (name, p) in &self.prompted {
            let (name, joints) = (shortened(name), &p.joints);
            write!(f, "\n{name:<32} follows {joints}: ")?;
            if let Some(mismatch) = p.mismatch {
                write!(f, "{:.4} % of its characters differ, ", 100.0 * mismatch)?;
            }
            write!(f, "places {:.2} cm apart", p.given_mpjpe_cm)?;
            if let Some(x) = p.free_jitter {
                write!(f, "; free joints: jitter {:.2} of the prompt's", x)?;
            }
            if let Some(x) = p.free_skate {
                write!(f, ", skate {:.2} of the prompt's", x)?;
            }
            if let Some(c) = p.coordination {
                write!(f, "; coordination {:.3}, shifted {:.3}, effect {:.3}", c.correlation, c.shifted, c.effect)?;
            }
            if let Some(why) = &p.not_compared {
                write!(f, "; its characters are not compared: {why}")?;
            }
        }
        if let Some(BeatMetrics { lag, .. }) = self.beats.first() {
            write!(f, "\n\n{:<32}{}", "all joints, on the beat", beats::HEADS)?;
            self.beats.iter().try_for_each(|row| write!(f, "\n{:<32}{}", shortened(&row.name), row.all))?;
            let way = format!("knees, ankles, {lag:.2} of a beat on");
            write!(f, "\n\n{way:<32}{} in tempo %", beats::HEADS)?;
            self.beats.iter().try_for_each(|row| {
                write!(f, "\n{:<32}{} {:>10.0}", shortened(&row.name), row.legs, 100.0 * row.in_tempo)
            })?;
        }
        self.features.iter().try_for_each(|features| write!(f, "\n\n{features}"))?;
        self.copied.iter().try_for_each(|copied| write!(f, "\n{copied}"))?;
        self.fidelity.iter().try_for_each(|fidelity| write!(f, "\n\n{fidelity}"))
    }
}

impl fmt::Display for Copied {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let cm = |x: Option<f64>| x.map_or("n/a".into(), |x| format!("{x:.2} cm"));
        let rate = self.copy_rate.map_or("n/a".into(), |x| format!("{:.2} %", 100.0 * x));
        let ([n, m], [a, b]) = (self.windows, self.median_cm.map(cm));
        writeln!(f, "windows of 2 s to the nearest of training: median {a} of {n}, of validation {b} of {m}")?;
        if let Some(clips) = self.sampled_of {
            writeln!(f, "the validation's are those of a sample of its {clips} clips")?;
        }
        writeln!(f, "copies, nearer than {} as 1 % of validation: {rate}", cm(self.limit_cm))?;
        let [dances, valid] = self.longest_run_frames;
        write!(f, "longest run of a training clip's tokens: {dances} frames, of validation {valid}")
    }
}

/// The end of a long name.
pub(super) fn shortened(name: &str) -> String {
    let skip = name.chars().count().saturating_sub(32);
    name.chars().skip(skip).collect()
}
