//! Dances of another program that continue the same seeds, measured as a network's rollouts.

use super::metrics::Rollout;
use super::{COMPARED, Metrics, Options, Report, Row, SHORT, Seed, Test};
use crate::aclstm::run::Trained;
use crate::data::{read, stride};
use crate::form::steps;
use crate::{Error, FPS, Result};
use kinelm_corpus::dataset::motion_files;
use kinelm_motion::Clip;
use kinelm_motion::format::ReadOptions;
use kinelm_motion::metric::Mpjpe;
use kinelm_motion::resample::{Method, resample};
use std::path::{Path, PathBuf};

/// Mean joint distance, hips aligned, above which a dance begins with another seed, cm: coding a prompt costs less.
const OTHER_SEED_CM: f64 = 10.0;

/// Measures the dances of a folder in the form and on the rig of a network's run. Each has the name of its seed
/// (`seed-07.bvh`), begins with the longest one, and continues for 400 frames or more at the network's rate. All are measured
/// over the length of the shortest. Seeds without a dance are left out.
///
/// # Errors
/// As [`Test::load`]; no dance in the folder; another rig or rate than the run's; a dance that is too short, or doesn't begin
/// with its seed.
pub fn evaluate_dances(trained: &Trained, options: &Options, folder: &Path) -> Result<Report> {
    let test = Test::load(trained, options)?;
    let length = options.longest();
    let files = motion_files(folder)?;
    let mut dances = Vec::new();
    for seed in &test.seeds {
        let is_it = |path: &&PathBuf| path.file_stem().is_some_and(|stem| stem == &*seed.name);
        if let Some(path) = files.iter().find(is_it) {
            dances.push((seed, after_seed(trained, path, seed, length)?));
        }
    }
    let Some(shortest) = dances.iter().map(|(_, clip)| clip.frames()).min() else {
        let expected = format!("dances that are named as their seeds: {}.bvh and so on", test.seeds[0].name);
        let help = "kinelm aclstm evaluate writes the seeds into a folder";
        return Err(Error::file(folder, format!("{} files of motion", files.len()), expected, help));
    };
    let frames = shortest.min(options.frames);
    let c = trained.coder.channels();
    let each: Vec<(&str, Rollout)> = dances
        .iter()
        .map(|(seed, clip)| {
            let truth = trained.coder.frames(&seed.clip.slice(seed.at - 1..seed.at + COMPARED + 1));
            let mut frames = trained.coder.frames(&clip.slice(0..frames));
            // the step after the last frame isn't measured
            frames.extend_from_within(frames.len() - c..);
            let steps = steps(&frames, c);
            Ok((&*seed.take, Rollout::of(trained, &truth[..c], &truth[c..], &steps, &seed.clip, test.thresholds)?))
        })
        .collect::<Result<_>>()?;
    let rows = vec![Row { seed_frames: length, metrics: Metrics::of(&each) }];
    let measured: Vec<&Seed> = dances.iter().map(|(seed, _)| *seed).collect();
    Ok(Report { dances: Some(folder.display().to_string()), ..Report::new(trained, options, &test, &measured, rows) })
}

/// The frames of a file after its seed.
fn after_seed(trained: &Trained, path: &Path, seed: &Seed, length: usize) -> Result<Clip> {
    let (motion, _) = read(path, &ReadOptions::default())?;
    trained.file.rig.check(path, motion.clip.skeleton())?;
    // for its message: the network's rate must divide the file's
    stride(path, motion.clip.fps())?;
    let clip = resample(&motion.clip, FPS, Method::Stride)?;
    if clip.frames() < length + SHORT {
        let found = format!("{} frames at {FPS} a second", clip.frames());
        let expected = format!("{} or more: the seed's {length} and {SHORT} after them", length + SHORT);
        return Err(Error::file(path, found, expected, "make it longer"));
    }
    let mut error = Mpjpe::default();
    error.add(&clip.slice(0..length), &seed.clip.slice(seed.at - length..seed.at))?;
    let cm = error.root_mm() / 10.0;
    if cm > OTHER_SEED_CM {
        let found = format!("{length} first frames whose joints are {cm:.1} cm from those of {}", seed.name);
        let help = "a dance begins with its seed (`with_seed`), of the same `seeds`, `seed_frames` and `split`";
        return Err(Error::file(path, found, format!("the seed itself, within {OTHER_SEED_CM} cm"), help));
    }
    Ok(clip.slice(length..clip.frames()))
}
