//! The report of a model's likelihood on a split: beside static floors, by joint, in gaps.

use crate::Floors;
use crate::floors::channels::figure_row;
use crate::gap_bits::GapBits;
use crate::per_joint::{SlotBits, by_part};
use kinelm_corpus::Split;
use kinelm_model::scored_windows::Likelihood;
use serde_json::{Map, Value, json};

/// The likelihood of a model on a split.
pub struct LikelihoodReport {
    /// The checkpoint that was measured.
    pub checkpoint: String,
    /// The split.
    pub split: Split,
    /// Bits of the scored windows.
    pub found: Likelihood,
    /// Bits per frame of each clip, by name, where all its windows were scored.
    pub clips: Vec<(String, f64)>,
    /// Bits of each slot of a word, where requested.
    pub places: Option<Vec<SlotBits>>,
    /// Bits in gaps, for each requested length.
    pub gaps: Vec<GapBits>,
    /// Static floors of the same tokens, or why there are none.
    pub floors: Result<Floors, String>,
    /// Bits a frame of the model mixed online with the floors, where all of the split was scored by both.
    pub mixed: Option<f64>,
    /// Frames of the split, scored or not.
    pub all_frames: usize,
    /// Frames per second of the corpus.
    pub fps: f64,
}

impl LikelihoodReport {
    /// Bits of all frames of the split.
    fn in_all(&self, bits_per_frame: f64) -> f64 {
        bits_per_frame * self.all_frames as f64
    }

    /// All of it as one JSON object.
    pub fn to_json(&self) -> Value {
        let LikelihoodReport { found, all_frames, .. } = self;
        let floors = self.floors.as_ref().ok();
        let in_all = |bits: f64| self.in_all(bits);
        let mut line = json!({
            "schema": 1, "checkpoint": self.checkpoint, "split": self.split.to_string(),
            "bits_per_frame": found.bits_per_frame, "bits_per_s": found.bits_per_frame * self.fps,
            "nats_per_token": found.nats_per_token, "tokens": found.tokens, "frames": found.frames,
            "windows": found.windows, "all_windows": found.all_windows, "pseudo": found.pseudo, "floors": floors.map(Floors::to_json),
            "mixed_with_floors": self.mixed, "all_frames": all_frames,
            "bits": {
                "model": in_all(found.bits_per_frame), "order0": floors.map(|f| in_all(f.order0())),
            },
        });
        if !self.clips.is_empty() {
            let clip = |(name, bits): &(String, f64)| json!({"name": name, "bits_per_frame": bits});
            line["clips"] = self.clips.iter().map(clip).collect();
        }
        if let Some(places) = &self.places {
            line["places"] = json!(places);
            line["parts"] =
                by_part(places).into_iter().map(|(part, bits)| (part, bits.into())).collect::<Map<_, _>>().into();
        }
        if !self.gaps.is_empty() {
            line["gaps"] = json!(self.gaps);
        }
        line
    }

    /// Tables for a terminal.
    pub fn table(&self) -> String {
        let LikelihoodReport { split, found, places, gaps, floors, all_frames, .. } = self;
        let name = if found.pseudo { "the model (pseudo)" } else { "the model" };
        let beside = match floors {
            Ok(floors) => floors.to_string(),
            Err(why) => {
                format!("{:<32} {:>12}\n{:<32} {:>12}   {why}", "bits/frame", "all frames", "static models", "n/a")
            }
        };
        let mut table = format!("{beside}\n{}\n", figure_row(name, found.bits_per_frame, None));
        if let Some(mixed) = self.mixed {
            table += &format!("{}\n", figure_row("mixed with floors, online", mixed, None));
        }
        let floors = floors.as_ref().ok();
        let of = format!("{all_frames} frames of {split}");
        table += &format!("\n{of:<32} {:>12} {:>14}\n", "bits/frame", "bits in all");
        let rows = [("order 0", floors.map(Floors::order0)), (name, Some(found.bits_per_frame))];
        for (name, bits) in rows.into_iter().filter_map(|(name, bits)| Some((name, bits?))) {
            table += &format!("{name:<32} {bits:>12.2} {:>14.0}\n", self.in_all(bits));
        }
        if !gaps.is_empty() {
            table += &format!("\n{:<32} {:>12} {:>14}\n", "in gaps, bits/frame", "no goal", "goal given");
        }
        for gap in gaps {
            let name = format!("{} of {} frames", gap.gaps, gap.frames);
            table += &format!("{name:<32} {:>12.2} {:>14.2}\n", gap.unconditioned, gap.conditioned);
            let (plain, conditioned) = (gap.unconditioned_end, gap.conditioned_end);
            table += &format!("{:<32} {plain:>12.2} {conditioned:>14.2}\n", "  their last quarter");
        }
        if let Some(places) = places {
            table += &format!("\n{:<32} {:>12} {:>14}\n", "under the model", "bits/frame", "share %");
            for (part, bits) in by_part(places) {
                table += &format!("{part:<32} {bits:>12.2} {:>14.1}\n", 100.0 * bits / found.bits_per_frame);
            }
        }
        table
    }

    /// Lines to print beside the table.
    pub fn notes(&self) -> Vec<String> {
        let LikelihoodReport { checkpoint, found, floors, fps, .. } = self;
        let (tokens, frames, windows, of) = (found.tokens, found.frames, found.windows, found.all_windows);
        let per_s = found.bits_per_frame * fps;
        let mut notes = vec![format!(
            "{checkpoint}: {per_s:.1} bits/s; {tokens} tokens of {frames} frames scored once, in {windows} of {of} windows"
        )];
        if found.pseudo {
            notes.push(
                "a masked model sees both sides of what it predicts: its bits are no likelihood and compare with no other"
                    .into(),
            );
        } else if let Some(best) = floors.as_ref().ok().map(Floors::best).filter(|best| found.bits_per_frame >= *best) {
            notes.push(format!("the model is not below the best static model of its own tokens, {best:.2} bits/frame"));
        }
        notes
    }
}
