//! The beats of a file, one a line: `cargo run --release -p kinelm-music --example beats -- song.mp3`.

use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for path in std::env::args().skip(1) {
        let beats = kinelm_music::beat::beats(Path::new(&path))?;
        for time in &beats.times_s {
            println!("{time:.3}");
        }
        eprintln!("{path}: {} beats, {:.1} a minute", beats.times_s.len(), beats.bpm().unwrap_or(0.0));
    }
    Ok(())
}
