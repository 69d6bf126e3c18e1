//! What training windows are told of the music of their clips: [`crate::model::music`].

use super::batches::WindowId;
use crate::corpus::ClipRecord;
use crate::model::music::{Music, told};
use crate::random;

/// Share of the windows in which music is hidden, so that the model serves without it too.
const HIDDEN: f64 = 0.1;

/// What tells windows of music.
#[derive(Debug, Clone, Copy)]
pub struct Heard {
    music: Music,
    seed: u64,
    /// Of windows.
    frames: usize,
    fps: f64,
}

impl Heard {
    /// For windows of so many frames at `fps`; `None` where nothing is told.
    pub fn new(music: Music, seed: u64, (frames, fps): (usize, f64)) -> Option<Heard> {
        (!music.is_none()).then_some(Heard { music, seed, frames, fps })
    }

    /// (F, M) What a window is told whose first frame stands at the clip's frame `first`, and of which a frame is `factor` of
    /// the clip's. All 0 where the clip has no music, and where it is hidden.
    pub fn told(&self, clip: &ClipRecord, window: WindowId, (first, factor): (f64, f64)) -> Vec<f32> {
        let mut rng = random::stream(self.seed, "music", window.round, window.number as u64);
        let is_hidden = random::unit(&mut rng) < HIDDEN;
        let beats_s = if is_hidden { &[] } else { clip.beats_s() };
        // beats as the window has them: `factor` times as fast
        let beats_s: Vec<f64> = beats_s.iter().map(|beat| (beat - first / self.fps) / factor).collect();
        told(self.music, &beats_s, (0..self.frames).map(|frame| frame as f64 / self.fps))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::corpus::Split;
    use crate::corpus::record::{BeatsOf, ClipBeats};
    use crate::model::{Architecture, ModelConfig};
    use crate::train::augment::AugmentConfig;
    use crate::train::batches::{Batch, Batches};
    use crate::train::run::RunFile;
    use crate::train::{Data, TrainConfig, fixture};

    const WINDOW: usize = 24;

    fn model(music: Music) -> ModelConfig {
        ModelConfig {
            architecture: Architecture::TwoLevel,
            layers: 1,
            heads: 1,
            width: 8,
            window: Some(WINDOW),
            music,
            ..Default::default()
        }
    }

    fn batch(data: &Data, music: Music, augment: AugmentConfig) -> Batch {
        let train = TrainConfig { batch: 200, ..Default::default() };
        let run = RunFile { augment, ..RunFile::new(&model(music), &train, data).unwrap() };
        Batches::of_run(&run, data).unwrap().batch(3).unwrap()
    }

    #[test]
    fn windows_hear_their_clip_where_they_stand_but_for_a_tenth_and_nothing_else_changes() {
        let dir = tempfile::tempdir().unwrap();
        let clips = [(150, Split::Train), (140, Split::Train), (120, Split::Train), (30, Split::Valid)];
        let data = Data::one(fixture::heard(dir.path(), &clips)).unwrap();
        let augment = AugmentConfig { mirror: 0.5, ..Default::default() };
        let (without, with) = (batch(&data, Music::None, augment), batch(&data, Music::Beats, augment));
        assert_eq!((&without.inputs, &without.targets, &without.clips), (&with.inputs, &with.targets, &with.clips));
        assert_eq!(without.told, None);
        let told_windows = with.told.clone().unwrap();
        assert!(told_windows.numbers.is_empty() && told_windows.rows[0].is_empty());
        let of_window = told_windows.music.len() / 200;
        assert_eq!(of_window, WINDOW * Music::Beats.numbers());
        let (mut hidden, mut heard) = (0, 0);
        for (name, numbers) in with.clips.iter().zip(told_windows.music.chunks(of_window)) {
            let (clip, first) = name.split_once(" from frame ").unwrap();
            let clip = data.parts()[0].corpus.clips().iter().find(|c| c.name == clip).unwrap();
            let first: f64 = first.parse().unwrap();
            let beats = clip.beats_s();
            let whole = told(Music::Beats, beats, (0..WINDOW).map(|frame| (first + frame as f64) / 20.0));
            if numbers.iter().all(|x| *x == 0.0) {
                hidden += usize::from(!beats.is_empty());
            } else {
                heard += 1;
                assert!(numbers.iter().zip(&whole).all(|(a, b)| (a - b).abs() < 1e-4), "{name}");
            }
        }
        assert!((5..25).contains(&hidden) && heard > 100, "{hidden} hidden, {heard} heard");
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(one.install(|| batch(&data, Music::Beats, augment)), with);
    }

    #[test]
    fn faster_windows_have_faster_beats() {
        let beats_s: Vec<f64> = (0..40).map(|i| 0.2 + 0.5 * f64::from(i)).collect();
        let clip = ClipRecord { beats: Some(ClipBeats { of: BeatsOf::Music, times_s: beats_s.clone() }), ..record() };
        let heard = Heard::new(Music::Beats, 1, (8, 20.0)).unwrap();
        let window = (0..).map(|number| WindowId { round: 0, number });
        let shown = |at: (f64, f64)| {
            let mut windows = window.clone().map(|window| heard.told(&clip, window, at));
            windows.find(|numbers| numbers.iter().any(|x| *x != 0.0)).unwrap()
        };
        let found = shown((30.5, 1.25));
        // frame i stands at the clip's frame 30.5 + 1.25 i, and what is ahead comes sooner
        let faster: Vec<f64> = beats_s.iter().map(|beat| (beat - 30.5 / 20.0) / 1.25).collect();
        assert_eq!(found, told(Music::Beats, &faster, (0..8).map(|frame| f64::from(frame) / 20.0)));
        let phase = |numbers: &[f32]| f64::from(numbers[2]).atan2(numbers[1].into()) / std::f64::consts::TAU;
        let at = 2.0 * ((30.5 + 3.0 * 1.25) / 20.0 - 0.2);
        let frame = &found[3 * Music::Beats.numbers()..];
        assert!((phase(frame) - at + (at - phase(frame)).round()).abs() < 1e-6, "{} {at}", phase(frame));
    }

    #[test]
    fn speed_is_learned_with_the_music_that_fits() {
        let dir = tempfile::tempdir().unwrap();
        let data = Data::one(fixture::heard(dir.path(), &[(150, Split::Train), (140, Split::Train)])).unwrap();
        let plain = batch(&data, Music::Beats, AugmentConfig::default()).told.unwrap();
        let faster = batch(&data, Music::Beats, AugmentConfig { speed: 0.2, ..Default::default() }).told.unwrap();
        let m = Music::Beats.numbers();
        // the phase goes on by another step from frame to frame
        let steps = |music: &[f32]| -> Vec<f64> {
            let phase = |frame: usize| f64::from(music[frame * m + 2]).atan2(music[frame * m + 1].into());
            let windows = (0..music.len() / m / WINDOW).map(|window| window * WINDOW);
            windows.map(|first| (phase(first + 1) - phase(first)).rem_euclid(std::f64::consts::TAU)).collect()
        };
        let (plain, faster) = (steps(&plain.music), steps(&faster.music));
        let ratios: Vec<f64> = plain.iter().zip(&faster).filter(|(a, _)| **a > 0.0).map(|(a, b)| b / a).collect();
        assert!(ratios.iter().all(|r| (0.75..1.25).contains(r)), "{ratios:?}");
        assert!(ratios.iter().any(|r| *r > 1.1) && ratios.iter().any(|r| *r < 0.9));
    }

    #[test]
    fn a_model_that_hears_asks_for_music() {
        let dir = tempfile::tempdir().unwrap();
        let data = Data::one(fixture::turning(dir.path(), &[(50, Split::Train)])).unwrap();
        let said = RunFile::new(&model(Music::Beats), &TrainConfig::default(), &data).unwrap_err().to_string();
        assert!(said.contains("no training clip of the corpora has any; kinelm tokenize --music"), "{said}");
    }

    fn record() -> ClipRecord {
        serde_json::from_str(
            r#"{"name":"a","offset":0,"tokens":0,"frames":0,"labels":{},"split":"train","take":"a","key":0,"source":0,"sha256":""}"#,
        )
        .unwrap()
    }
}
