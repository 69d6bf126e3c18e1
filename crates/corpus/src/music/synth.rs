//! Music for synthetic dances, rendered from the dance's own score.

use crate::Result;
use kinelm_motion::synth::{Dance, genres};
use kinelm_music::synth::{Score, Style, render};

/// The musical style of a genre: each genre has its own, as long as there are no more genres than styles.
pub fn style(genre: &str) -> Style {
    let number = genres().position(|name| name == genre).unwrap_or(0);
    Style::ALL[number % Style::ALL.len()]
}

/// The music of a dance, as long as its clip, at `rate` samples per second; a dance and a seed always give the same samples.
///
/// # Errors
/// Those of [`render`].
pub fn music(dance: &Dance, seed: u64, rate: u32) -> Result<Vec<f32>> {
    let score = Score {
        style: style(dance.genre),
        beats_s: dance.beats_s.clone(),
        downbeat: dance.downbeat,
        seconds: dance.clip.frames() as f64 / dance.clip.fps(),
        seed: seed.wrapping_mul(1000).wrapping_add(dance.take as u64),
    };
    Ok(render(&score, rate)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::synth::corpus;
    use kinelm_music::beat::{RATE, beats_of};

    #[test]
    fn the_beats_of_the_music_are_those_of_the_dance() {
        let dances = corpus(3, 4, 40.0, 60.0).unwrap();
        for dance in &dances {
            let x = music(dance, 3, RATE).unwrap();
            assert_eq!(x.len(), 40 * RATE as usize);
            assert_eq!(x, music(dance, 3, RATE).unwrap());
            let found = beats_of(&x).times_s;
            let hits = dance.beats_s.iter().filter(|t| found.iter().any(|f| (f - **t).abs() < 0.035)).count();
            assert!(hits * 10 > dance.beats_s.len() * 9, "{}: {hits} of {}", dance.name(), dance.beats_s.len());
        }
        let styles: std::collections::HashSet<Style> = dances.iter().map(|d| style(d.genre)).collect();
        assert_eq!(styles.len(), 4);
    }
}
