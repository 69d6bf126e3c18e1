//! Motion-derived beats, for dances without music.
//!
//! Every landing of a foot becomes a click, and the beat tracker runs on the clicks. These beats say nothing about music:
//! alignment measured by them is that of a dance with its own steps.

use crate::Result;
use kinelm_motion::Clip;
use kinelm_motion::feet::contact::contacts;
use kinelm_motion::feet::leg::Leg;
use kinelm_motion::feet::track::FootTrack;
use kinelm_motion::rig::Humanoid;
use kinelm_music::beat::{RATE, beats_of};
use std::f64::consts::TAU;

/// Time in which a click decays by e, seconds.
const DECAY_S: f64 = 0.03;
/// The two tones of a click.
const TONES_HZ: [f64; 2] = [90.0, 1500.0];

/// Motion-derived beats of a clip on the model's body, in seconds from its first frame; `None` if there are fewer than two.
/// `floor_m` is the height of the floor under the clip, estimated if not given.
///
/// # Errors
/// Those of the beat tracker.
pub fn beats_s(clip: &Clip, floor_m: Option<f64>) -> Result<Option<Vec<f64>>> {
    let landings = landings_s(clip, floor_m)?;
    let seconds = clip.frames() as f64 / clip.fps();
    let beats = beats_of(&clicks(&landings, seconds)).times_s;
    Ok((landings.len() > 1 && beats.len() > 1).then(|| beats.iter().map(|t| (t * 1e4).round() / 1e4).collect()))
}

/// Times at which feet land, in seconds, ascending.
fn landings_s(clip: &Clip, floor_m: Option<f64>) -> Result<Vec<f64>> {
    let body = Humanoid::neutral();
    let floor_m = floor_m.map_or_else(|| body.floor(clip).map(|floor| floor.height_m), Ok)?;
    let legs = Leg::of(body)?;
    let of_leg = |(side, leg): (usize, &Leg)| {
        contacts(&FootTrack::new(clip, leg), side, floor_m).into_iter().map(|contact| contact.from)
    };
    // a contact from frame 0 on is no landing
    let mut frames: Vec<usize> = legs.iter().enumerate().flat_map(of_leg).filter(|from| *from > 0).collect();
    frames.sort_unstable();
    Ok(frames.into_iter().map(|frame| frame as f64 / clip.fps()).collect())
}

/// Samples with a click at each of these times.
fn clicks(times_s: &[f64], seconds: f64) -> Vec<f32> {
    let rate = f64::from(RATE);
    let mut out = vec![0.0f32; (seconds * rate).round() as usize];
    for time in times_s {
        let start = (time * rate).round() as usize;
        // after five decays a click is below 1 % of its height
        let end = (start + (5.0 * DECAY_S * rate) as usize).min(out.len());
        for (i, x) in out.iter_mut().enumerate().take(end).skip(start) {
            let t = i as f64 / rate - time;
            let sound: f64 = TONES_HZ.iter().map(|hz| (TAU * hz * t).sin()).sum();
            *x += (0.3 * (-t / DECAY_S).exp() * sound) as f32;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::{Quat, Vec3, smpl, synth};

    #[test]
    fn synthetic_dances_step_at_their_tempo_or_a_multiple() {
        let dances = synth::corpus_at(5, &[100.0; 8], 30.0, 60.0).unwrap();
        let (mut right, mut found) = (0, Vec::new());
        for dance in &dances {
            let landings = landings_s(&dance.clip, Some(0.0)).unwrap().len();
            let Some(beats) = beats_s(&dance.clip, None).unwrap() else {
                found.push((dance.genre, landings, 0.0));
                continue;
            };
            let bpm = 60.0 * (beats.len() - 1) as f64 / (beats[beats.len() - 1] - beats[0]);
            right += usize::from([0.5, 1.0, 2.0].iter().any(|times| (bpm / (100.0 * times) - 1.0).abs() < 0.05));
            assert!(beats.windows(2).all(|pair| pair[1] > pair[0]));
            found.push((dance.genre, landings, bpm));
        }
        // some genres step off the beat
        assert!(right >= 4, "{right} of 8: {found:?}");
    }

    #[test]
    fn a_body_that_stands_still_has_no_beats() {
        let root = vec![Vec3::Y * smpl::STANDING_PELVIS_M; 200];
        let clip = kinelm_motion::Clip::new(smpl::neutral(), 20.0, root, vec![Quat::IDENTITY; 24 * 200]).unwrap();
        assert_eq!(beats_s(&clip, None).unwrap(), None);
    }
}
