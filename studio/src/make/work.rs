//! A job carried out: the request opened, its dances sampled and streamed, chosen, decoded and written.

use super::best::Real;
use super::jobs::{Job, Running};
use super::model::Model;
use super::request::{Kind, Prepared};
use super::stream::Streams;
use crate::events::Hub;
use crate::library::{Library, Source};
use crate::project::dances::write_made;
use crate::project::document::{Change, DanceRecord, MadeSpan};
use crate::timeline::Timelines;
use crate::{Error, Result};
use kinelm_generate::OpenRequest;
use kinelm_generate::best::Best;
use kinelm_generate::provenance::Provenance;
use kinelm_generate::sampler::variation_seed;
use kinelm_tokenizer::Words;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// The least time between two reports of a job's progress.
const EVERY: Duration = Duration::from_millis(100);

/// What makes dances.
#[derive(Debug)]
pub struct Maker {
    /// The model.
    pub model: Model,
    /// The corpus of real dances that the call named.
    pub real: Option<PathBuf>,
    /// The library.
    pub library: Arc<Library>,
    /// The timeline.
    pub timelines: Arc<Timelines>,
    /// Where frames go.
    pub hub: Arc<Hub>,
}

impl Maker {
    /// Carries a job out. `progress` is told that frames were sampled, `made` of each dance.
    ///
    /// # Errors
    /// What the request can't be opened with, or sampled; [`kinelm_store::Error::Stopped`] where the user stopped it.
    pub fn carry_out(
        &self,
        (job, running): (&Job, &Running),
        progress: &(dyn Fn() + Sync),
        made: &(dyn Fn(Change) -> Result<()> + Sync),
    ) -> Result<()> {
        running.since.store(self.hub.last(), Ordering::Relaxed);
        // a timeline may have any of them
        let all = match job.make.kind {
            Kind::Timeline => self.library.project().read(|all| all.clips.iter().map(|clip| clip.id.clone()).collect()),
            _ => Vec::new(),
        };
        for id in job.make.clip.iter().chain(&job.make.music).chain(&all) {
            self.library.wait_for(id, &|| !running.cancelled.load(Ordering::Relaxed));
        }
        let Prepared { request, layout, source, rig } =
            job.make.prepare(&self.model, &self.library, &self.timelines)?;
        let open = OpenRequest::open_with(&request, layout)?;
        let mut notes = open.notes()?;
        let samples = job.make.best.unwrap_or(job.make.variations);
        // what can't be compared is refused before it is sampled
        let real = job.make.best.map(|_| Real::open(self.real.as_deref(), &open, &self.library)).transpose()?;
        notes.extend(real.iter().map(|real| real.what.clone()));
        let name = job.make.name(source.as_ref());
        let mut streams = Streams::new(&open, (&self.hub, &job.id), (&job.dances, &name))?;
        let mut reported = Instant::now();
        let mut failed = None;
        let sampled = open.sample(samples, None, &mut |words, last| {
            if running.cancelled.load(Ordering::Relaxed) {
                return ControlFlow::Break(());
            }
            match streams.push(words, last) {
                Ok([frames, of]) => {
                    running.frames[0].store(frames, Ordering::Relaxed);
                    running.frames[1].store(of, Ordering::Relaxed);
                }
                Err(e) => {
                    failed = Some(e);
                    return ControlFlow::Break(());
                }
            }
            if reported.elapsed() >= EVERY {
                reported = Instant::now();
                progress();
            }
            ControlFlow::Continue(())
        });
        if let Some(e) = failed {
            return Err(e);
        }
        let sampled = sampled?;
        let words: Vec<Words> = (0..sampled.ids.len()).map(|dance| open.words(&sampled, dance)).collect();
        let out = Path::new("dance.bvh");
        let chosen: Vec<(usize, Option<Best>)> = match &real {
            Some(real) => {
                let best = real.choose(&open, &words, out, job.make.variations)?;
                best.into_iter().map(|(dance, best)| (dance, Some(best))).collect()
            }
            None => (0..words.len()).map(|dance| (dance, None)).collect(),
        };
        if let Some(note) = open.surprise_note()? {
            notes.push(note);
        }
        for (id, (dance, best)) in job.dances.iter().zip(chosen) {
            if running.cancelled.load(Ordering::Relaxed) {
                return Err(kinelm_store::Error::stopped("stopped before all dances were written").into());
            }
            // a job that is begun again: the user may have kept or rejected what it had made
            if self.library.project().dance(id).is_ok() {
                continue;
            }
            let (source, rig) = (source.as_ref(), rig.as_deref());
            let work = Work { job, open: &open, source, rig, notes: &notes, name: &name };
            made(work.write(self.library.project().folder(), (id, &words[dance]), (dance, best))?)?;
        }
        Ok(())
    }
}

/// A job whose dances are sampled.
struct Work<'a> {
    job: &'a Job,
    open: &'a OpenRequest,
    source: Option<&'a Source>,
    rig: Option<&'a str>,
    notes: &'a [String],
    name: &'a str,
}

impl Work<'_> {
    /// Writes a dance with its sidecar: the change that takes it into the project.
    fn write(
        &self,
        folder: &Path,
        (id, words): (&str, &Words),
        (dance, best): (usize, Option<Best>),
    ) -> Result<Change> {
        let (open, job) = (self.open, self.job);
        let out = PathBuf::from(format!("{id}.bvh"));
        let generated = open.motion(words, &out)?;
        let bytes = generated.bytes(&out)?;
        let (frames, fps) = (generated.motion.clip.frames(), generated.motion.clip.fps());
        let provenance = Provenance { best, ..Provenance::of(open, dance + 1, (&out, fps), &bytes) };
        let floor_m = provenance.read.floor.or(self.source.map(|source| source.floor_m));
        let made = write_made(folder, id, &bytes, provenance)?;
        let notes: Vec<String> = self.notes.iter().cloned().chain(generated.notes(open)).collect();
        let given = open.resolved.prompt.as_ref().and_then(|prompt| prompt.joints.clone());
        let variation = job.dances.iter().position(|other| other == id).unwrap_or(0) + 1;
        let several = if job.make.variations > 1 { format!(" {variation}") } else { String::new() };
        let record = DanceRecord {
            id: id.into(),
            name: format!("{}{several}", self.name),
            made: Some(made),
            kept: None,
            rejected: false,
            job: Some(job.id.clone()),
            variation,
            seed: variation_seed(open.resolved.seed, dance),
            frames,
            fps,
            floor_m: floor_m.unwrap_or(0.0),
            note: notes.join("\n").replace('`', ""),
            source: self.source.map(|source| source.id.clone()),
            rig: self.rig.map(str::to_owned),
            generated_s: open.generated_s(),
            given: given.unwrap_or_default(),
            free: job.make.free.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "),
            made_spans: MadeSpan::of(&open.free_spans(), open.tokenizer.fps()),
            best,
            opening: job.opening,
        };
        Ok(Change::Dance { before: None, after: Some(Box::new(record)) })
    }
}

/// Runs work on the threads that compute, and makes an error of a panic.
///
/// # Errors
/// Those of the work.
pub fn guarded<T: Send>(work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    // on a thread of the pool: from outside, every parallel step would wake its threads anew
    Error::of_panics(|| rayon::scope(|_| work()))
}
