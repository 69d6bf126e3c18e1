//! Dances that something else made of the same seeds, measured as a network's are.

use super::figures::Continued;
use super::{COMPARED, FPS, Figures, Options, Report, Row, SHORT, Seed, Test};
use crate::aclstm::data::{read, stride};
use crate::aclstm::form::steps;
use crate::aclstm::run::Trained;
use crate::{Error, Result};
use kinelm_corpus::gather::files_below;
use kinelm_motion::Clip;
use kinelm_motion::format::ReadOptions;
use kinelm_motion::metric::Mpjpe;
use kinelm_motion::resample::{Method, resample};
use std::path::{Path, PathBuf};

/// Joints that are so far from the seed's, hips in one place, are another seed's, cm: coding a prompt costs less.
const OTHER_SEED_CM: f64 = 10.0;

/// Measures the dances of a folder in the form and on the rig of a network's run. Each has the name of its seed
/// (`seed-07.bvh`), begins with the longest one, and goes on for 400 frames or more at the network's rate; all are measured
/// as far as the shortest goes. Seeds without a dance are left out.
///
/// # Errors
/// As [`Test::load`]; no dance in the folder; another rig or rate than the run's; a dance that is too short, or doesn't begin
/// with its seed.
pub fn evaluate_dances(trained: &Trained, options: &Options, folder: &Path) -> Result<Report> {
    let test = Test::load(trained, options)?;
    let length = options.longest();
    let files = files_below(folder)?;
    let mut dances = Vec::new();
    for seed in &test.seeds {
        let is_it = |path: &&PathBuf| path.file_stem().is_some_and(|stem| stem == &*seed.name);
        if let Some(path) = files.iter().find(is_it) {
            dances.push((seed, behind(trained, path, seed, length)?));
        }
    }
    let Some(shortest) = dances.iter().map(|(_, clip)| clip.frames()).min() else {
        let expected = format!("dances that are named as their seeds: {}.bvh and so on", test.seeds[0].name);
        let help = "kinelm aclstm evaluate --write-seeds FOLDER writes the seeds";
        return Err(Error::file(folder, format!("{} files of motion", files.len()), expected, help));
    };
    let frames = shortest.min(options.frames);
    let c = trained.coder.channels();
    let each: Vec<(&str, Continued)> = dances
        .iter()
        .map(|(seed, clip)| {
            let truth = trained.coder.frames(&seed.clip.slice(seed.at - 1..seed.at + COMPARED + 1));
            let mut made = trained.coder.frames(&clip.slice(0..frames));
            // nothing says where the hip goes behind the last frame, and nothing asks
            made.extend_from_within(made.len() - c..);
            let made = steps(&made, c);
            Ok((&*seed.take, Continued::of(trained, &truth[..c], &truth[c..], &made, &seed.clip, test.thresholds)?))
        })
        .collect::<Result<_>>()?;
    let rows = vec![Row { seed_frames: length, figures: Figures::of(&each) }];
    let measured: Vec<&Seed> = dances.iter().map(|(seed, _)| *seed).collect();
    Ok(Report { dances: Some(folder.display().to_string()), ..Report::new(trained, options, &test, &measured, rows) })
}

/// What a file has behind its seed.
fn behind(trained: &Trained, path: &Path, seed: &Seed, length: usize) -> Result<Clip> {
    let (motion, _) = read(path, &ReadOptions::default())?;
    trained.file.rig.check(path, motion.clip.skeleton())?;
    stride(path, motion.clip.fps())?;
    let clip = resample(&motion.clip, FPS, Method::Stride)?;
    if clip.frames() < length + SHORT {
        let found = format!("{} frames at {FPS} a second", clip.frames());
        let expected = format!("{} or more: the seed's {length} and {SHORT} behind them", length + SHORT);
        return Err(Error::file(path, found, expected, "make it longer"));
    }
    let mut apart = Mpjpe::default();
    apart.add(&clip.slice(0..length), &seed.clip.slice(seed.at - length..seed.at))?;
    let cm = apart.root_mm() / 10.0;
    if cm > OTHER_SEED_CM {
        let found = format!("{length} frames in front whose joints are {cm:.1} cm from those of {}", seed.name);
        let help = "a dance begins with its seed (aclstm generate --with-seed, generate --from-frame), of the same --seeds, \
            --seed-frames and --split";
        return Err(Error::file(path, found, format!("the seed itself, within {OTHER_SEED_CM} cm"), help));
    }
    Ok(clip.slice(length..clip.frames()))
}
