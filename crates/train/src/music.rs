//! Music conditioning of training windows: [`kinelm_model::music`] at the window's place in its clip.

use super::window::WindowId;
use crate::Result;
use kinelm_corpus::{ClipRecord, Corpus};
use kinelm_model::ModelConfig;
use kinelm_store::random;

/// Share of the windows whose music is hidden, so that the model works without music too.
const HIDDEN: f64 = 0.1;

/// Conditions windows on the music of their clips.
#[derive(Debug, Clone)]
pub struct MusicConditioning {
    model: ModelConfig,
    seed: u64,
    /// Of windows.
    frames: usize,
    fps: f64,
}

impl MusicConditioning {
    /// For windows of `frames` frames at `fps`; `None` for a model without music.
    pub fn new(model: &ModelConfig, seed: u64, frames: usize, fps: f64) -> Option<MusicConditioning> {
        (!model.music.is_none()).then(|| MusicConditioning { model: model.clone(), seed, frames, fps })
    }

    /// (F, M) The conditioning of a window whose first frame is the clip's frame `first`; from one of its frames to the next
    /// are `factor` frames of the clip. All 0 where the clip has no music, or it is hidden.
    ///
    /// # Errors
    /// A corpus that can no longer be read.
    pub fn of_window(
        &self,
        corpus: &Corpus,
        clip: &ClipRecord,
        window: WindowId,
        first: f64,
        factor: f64,
    ) -> Result<Vec<f32>> {
        let mut rng = random::stream(self.seed, "music", window.round, window.number as u64);
        if random::unit(&mut rng) < HIDDEN {
            return Ok(vec![0.0; self.frames * self.model.music.numbers()]);
        }
        // the music runs as fast as the motion, so both stay together
        let times = (0..self.frames).map(|frame| (first + factor * frame as f64) / self.fps);
        Ok(self.model.music_conditioning(&corpus.music(clip)?, times, factor))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::augment::AugmentConfig;
    use crate::batches::{Batch, Batches};
    use crate::run::RunFile;
    use crate::{Data, TrainConfig, fixture};
    use kinelm_corpus::Split;
    use kinelm_corpus::music::clip_music::{ClipMusic, FeatureRows};
    use kinelm_model::Architecture;
    use kinelm_model::music::Music;

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
    fn windows_have_the_music_of_their_frames_except_a_tenth_and_nothing_else_changes() {
        let dir = tempfile::tempdir().unwrap();
        let clips = [(150, Split::Train), (140, Split::Train), (120, Split::Train), (30, Split::Valid)];
        let data = Data::one(fixture::with_music(dir.path(), &clips)).unwrap();
        let augment = AugmentConfig { mirror: 0.5, ..Default::default() };
        let without = batch(&data, Music::None, augment);
        assert_eq!(without.conditioning, None);
        for music in [Music::Beats, Music::Features, Music::Both] {
            let with = batch(&data, music, augment);
            assert_eq!((&without.inputs, &without.targets, &without.clips), (&with.inputs, &with.targets, &with.clips));
            let model = RunFile::new(&model(music), &TrainConfig::default(), &data).unwrap().model;
            assert_eq!(model.music_scale.is_some(), music.has_features());
            let found = with.conditioning.clone().unwrap();
            assert!(found.numbers.is_empty() && found.rows[0].is_empty());
            let of_window = found.music.len() / 200;
            assert_eq!(of_window, WINDOW * music.numbers());
            let (mut hidden, mut shown) = (0, 0);
            for (name, numbers) in with.clips.iter().zip(found.music.chunks(of_window)) {
                let (clip, first) = name.split_once(" from frame ").unwrap();
                let corpus = &data.parts()[0].corpus;
                let clip = corpus.clips().iter().find(|c| c.name == clip).unwrap();
                let first: f64 = first.parse().unwrap();
                let times = (0..WINDOW).map(|frame| (first + frame as f64) / 20.0);
                let whole = model.music_conditioning(&corpus.music(clip).unwrap(), times, 1.0);
                if numbers.iter().all(|x| *x == 0.0) {
                    hidden += usize::from(clip.beats.is_some());
                } else {
                    shown += 1;
                    assert!(numbers.iter().zip(&whole).all(|(a, b)| (a - b).abs() < 1e-4), "{name}");
                }
            }
            assert!((5..25).contains(&hidden) && shown > 100, "{hidden} hidden, {shown} shown");
            let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            assert_eq!(one.install(|| batch(&data, music, augment)), with);
        }
    }

    #[test]
    fn faster_windows_have_faster_music() {
        let dir = tempfile::tempdir().unwrap();
        let data = Data::one(fixture::with_music(dir.path(), &[(150, Split::Train)])).unwrap();
        let (corpus, config) = (&data.parts()[0].corpus, model(Music::Both));
        let config = RunFile::new(&config, &TrainConfig::default(), &data).unwrap().model;
        let music = MusicConditioning::new(&config, 1, 8, 20.0).unwrap();
        let window = (0..).map(|number| WindowId { round: 0, number });
        let shown = |first: f64, factor: f64| {
            let clip = &corpus.clips()[0];
            let mut windows =
                window.clone().map(|window| music.of_window(corpus, clip, window, first, factor).unwrap());
            windows.find(|numbers| numbers.iter().any(|x| *x != 0.0)).unwrap()
        };
        let found = shown(30.5, 1.25);
        // frame i is the clip's frame 30.5 + 1.25 i, and beats come sooner
        let sound = corpus.music(&corpus.clips()[0]).unwrap();
        let faster: Vec<f64> = sound.beats_s.iter().map(|beat| (beat - 30.5 / 20.0) / 1.25).collect();
        let (fps, from_s) = (20.0 * 1.25, -30.5 / 20.0 / 1.25);
        let rows = FeatureRows { fps, from_s, numbers: sound.rows.numbers.clone() };
        let faster = ClipMusic { beats_s: &faster, rows };
        let expected = config.music_conditioning(&faster, (0..8).map(|frame| f64::from(frame) / 20.0), 1.0);
        assert!(found.len() == expected.len() && found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-4));
        let slow = shown(30.5, 1.0);
        assert!(found.iter().zip(&slow).any(|(a, b)| (a - b).abs() > 0.1));
    }

    #[test]
    fn speed_is_learned_with_the_music_that_fits() {
        let dir = tempfile::tempdir().unwrap();
        let data = Data::one(fixture::with_music(dir.path(), &[(150, Split::Train), (140, Split::Train)])).unwrap();
        let plain = batch(&data, Music::Beats, AugmentConfig::default()).conditioning.unwrap();
        let faster =
            batch(&data, Music::Beats, AugmentConfig { speed: 0.2, ..Default::default() }).conditioning.unwrap();
        let m = Music::Beats.numbers();
        // the phase moves by another step from frame to frame
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
    fn a_model_with_music_needs_music() {
        let dir = tempfile::tempdir().unwrap();
        let data = Data::one(fixture::turning(dir.path(), &[(50, Split::Train)])).unwrap();
        let said = |music| RunFile::new(&model(music), &TrainConfig::default(), &data).unwrap_err().to_string();
        let beats = said(Music::Beats);
        assert!(
            beats.contains("no music; model.music needs it, and no training clip of the corpora has any"),
            "{beats}"
        );
        assert!(said(Music::Both).contains("no music; model.music needs it"));
        assert!(said(Music::Features).contains("no music features; model.music needs it"));
    }
}
