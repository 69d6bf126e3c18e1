//! Dances of a model during its training.

use super::run::RunFile;
use crate::{Error, Result};
use kinelm_generate as generate;
use kinelm_generate::SamplingPlan;
use kinelm_generate::masked::{PASSES, fill};
use kinelm_generate::sampling::{Sampling, default_top_p};
use kinelm_model::fast::Fast;
use kinelm_model::run::{TOKENIZER, load_tokenizer};
use kinelm_model::weights::Weights;
use kinelm_model::{DeviceName, Gpt, ModelKind, Reader, ReaderOptions};
use kinelm_motion::{Clip, Motion, format};
use kinelm_tokenizer::{Special, UncodedPose};
use kinelm_view::{Figure, write_page};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// Length of a dance, seconds.
pub const SECONDS: f64 = 5.0;

/// Writes an unprompted dance of the model with these weights, at temperature 1 from the run's seed, as `step-XXXXXXXX.bvh`
/// and as a page beside it into the run's `samples/`. Returns the page.
///
/// Its random streams are its own, so that training keeps its bits.
///
/// # Errors
/// Any failure, a panic too: it must not end the run.
pub fn sample(run: &Path, step: u64, file: &RunFile, weights: &Weights) -> Result<PathBuf> {
    let write = AssertUnwindSafe(|| write(run, step, file, weights));
    // `write` shares nothing with the training that a panic could leave half changed
    catch_unwind(write).unwrap_or_else(|_| Err(Error::unsupported("this dance", "its generation panicked")))
}

fn write(run: &Path, step: u64, file: &RunFile, weights: &Weights) -> Result<PathBuf> {
    let tokenizer = load_tokenizer(&run.join(TOKENIZER), &file.tokenizer_sha256)?;
    let gpt = Gpt::from_weights(&file.model, &file.tokens, weights, DeviceName::Cpu)?;
    let frames = (SECONDS * tokenizer.fps()).round() as usize;
    let words = frames.div_ceil(tokenizer.frames_per_word());
    // without labels
    let mut front = vec![Special::Unk.id(); file.tokens.front];
    front[0] = Special::Bos.id();
    let mut plan = SamplingPlan::free(
        tokenizer.grammar(),
        words,
        Sampling { top_p: Some(default_top_p(&file.model)), ..Sampling::default() },
        file.train.seed,
    );
    (plan.fronts, plan.passes) = (vec![(0, front)], PASSES);
    let watch = &mut generate::unwatched;
    let ids = match file.model.kind {
        ModelKind::Causal => generate::sample_one(&mut Reader::new(&gpt, ReaderOptions::default())?, &plan, watch)?,
        ModelKind::Masked => fill(&mut Fast::of(&gpt)?, &plan, 1, watch)?.ids.remove(0),
    };
    let clip = tokenizer.decode(&tokenizer.words_of_ids(&ids).words, UncodedPose::Identity)?.slice(0..frames);
    let seed = file.train.seed;
    write_sample(run, step, clip, &format!("free, temperature 1, seed {seed}"))
}

/// Writes a dance of the model after `step` updates as `step-XXXXXXXX.bvh` and as a page beside it into the run's
/// `samples/`; `note` says on the page how it was made. Returns the page.
///
/// # Errors
/// What the system refuses.
pub fn write_sample(run: &Path, step: u64, clip: Clip, note: &str) -> Result<PathBuf> {
    let folder = run.join("samples");
    std::fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
    let name = format!("step-{step:08}");
    let (bvh, page) = (folder.join(format!("{name}.bvh")), folder.join(format!("{name}.html")));
    let motion = Motion::new(&bvh, clip);
    format::write(&bvh, &motion)?;
    let figure = Figure::new(format!("step {step}"), &motion.clip).note(note);
    write_page(&page, &[figure])?;
    Ok(page)
}
