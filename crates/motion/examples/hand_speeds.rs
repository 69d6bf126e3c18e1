//! Prints the mean and the largest speed of the hands in a motion file, metres per second.
//!
//!     cargo run -p kinelm-motion --example hand_speeds -- DANCE.bvh
//!
//! Without a file it uses a synthetic dance.

use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::{Clip, retarget, smpl, synth};
use std::path::Path;

/// The file's motion on the 24 SMPL joints.
fn clip() -> kinelm_motion::Result<Clip> {
    match std::env::args_os().nth(1) {
        Some(file) => {
            let motion = format::read(Path::new(&file), &ReadOptions::default())?;
            motion.warnings.iter().for_each(|w| eprintln!("{w}"));
            retarget::to_smpl(&motion)
        }
        None => Ok(synth::corpus(1, 1, 10.0, 60.0)?.remove(0).clip),
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let clip = clip()?;
    println!("{} frames, {:.1} s at {} frames a second", clip.frames(), clip.duration_s(), clip.fps());
    let positions = clip.positions(); // (F, J)
    for name in ["left_wrist", "right_wrist"] {
        let joint = smpl::NAMES.iter().position(|n| *n == name).expect("an SMPL joint");
        let place = |frame: usize| positions[frame * clip.joints() + joint];
        let speeds: Vec<f64> = (1..clip.frames()).map(|f| place(f).distance(place(f - 1)) * clip.fps()).collect();
        let mean = speeds.iter().sum::<f64>() / speeds.len().max(1) as f64;
        println!(
            "{name:<12} {mean:5.2} m/s on average, {:5.2} at most",
            speeds.iter().fold(0.0, |a: f64, b| a.max(*b))
        );
    }
    Ok(())
}
