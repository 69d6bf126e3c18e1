//! A job carried out: the request opened, its dances sampled and streamed, chosen, decoded and written.

use super::best;
use super::jobs::{Job, Running};
use super::model::Model;
use super::request::{Kind, Prepared};
use super::stream::Streams;
use crate::events::Hub;
use crate::library::Library;
use crate::project::dances::write_made;
use crate::project::document::{Change, DanceRecord, MadeSpan};
use crate::timeline::Timelines;
use crate::{Error, Result};
use kinelm_generate::OpenRequest;
use kinelm_generate::make::{BestOf, Dance, Making};
use kinelm_generate::sampler::variation_seed;
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
    /// Carries a job out. `progress` is called after frames were sampled, `made` with each dance.
    ///
    /// # Errors
    /// What the request can't be opened with, or sampled; [`kinelm_store::Error::Stopped`] where the user stopped it.
    pub fn carry_out(
        &self,
        job: &Job,
        running: &Running,
        progress: &(dyn Fn() + Sync),
        made: &(dyn Fn(Change) -> Result<()> + Sync),
    ) -> Result<()> {
        running.since.store(self.hub.last(), Ordering::Relaxed);
        let is_cancelled = || running.cancelled.load(Ordering::Relaxed);
        // a timeline may have any of them
        let all = match job.make.kind {
            Kind::Timeline => self.library.project().read(|all| all.clips.iter().map(|clip| clip.id.clone()).collect()),
            _ => Vec::new(),
        };
        for id in job.make.clip.iter().chain(&job.make.music).chain(&all) {
            self.library.wait_for(id, &|| !is_cancelled());
        }
        let mut prepared = job.make.prepare(&self.model, &self.library, &self.timelines)?;
        let open = OpenRequest::open_with(&prepared.request, prepared.layout.take())?;
        let mut notes = open.notes()?;
        // what can't be compared is refused before it is sampled
        let real = job.make.best.map(|_| best::real(self.real.as_deref(), &open, &self.library)).transpose()?;
        notes.extend(real.iter().map(|(_, what)| format!("compared with {what}")));
        let best = real.as_ref().zip(job.make.best);
        let best = best.map(|((judge, _), samples)| BestOf { samples, judge });
        let name = job.make.name(prepared.source.as_ref());
        let mut streams = Streams::new(&open, &self.hub, &job.id, &job.dances, &name)?;
        let outs: Vec<PathBuf> = job.dances.iter().map(|id| format!("{id}.bvh").into()).collect();
        let (mut reported, mut failed) = (Instant::now(), None);
        let dances = open.make(&Making { outs: &outs, best, guesses: None }, &mut |at| {
            running.frames[0].store(at.frames, Ordering::Relaxed);
            running.frames[1].store(at.of, Ordering::Relaxed);
            failed = streams.look(at).err();
            if reported.elapsed() >= EVERY {
                reported = Instant::now();
                progress();
            }
            if failed.is_some() || is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        if let Some(e) = failed {
            return Err(e);
        }
        let dances = dances?;
        notes.extend(open.surprise_note()?);
        let work = Work { job, prepared: &prepared, open: &open, notes: &notes, name: &name };
        for (variation, chosen) in dances.chosen.into_iter().enumerate() {
            if is_cancelled() {
                return Err(kinelm_store::Error::stopped("stopped before all dances were written").into());
            }
            // a job that is begun again: the user may have kept or rejected what it had made
            let project = self.library.project();
            if project.dance(&job.dances[variation]).is_err() {
                made(work.write(project.folder(), variation, &chosen.decode(&open)?)?)?;
            }
        }
        Ok(())
    }
}

/// A job whose dances are sampled.
struct Work<'a> {
    job: &'a Job,
    prepared: &'a Prepared,
    open: &'a OpenRequest,
    notes: &'a [String],
    name: &'a str,
}

impl Work<'_> {
    /// Writes a dance with its sidecar: the change that takes it into the project.
    fn write(&self, folder: &Path, variation: usize, dance: &Dance) -> Result<Change> {
        let Work { job, open, .. } = self;
        let (id, source) = (&job.dances[variation], self.prepared.source.as_ref());
        let (bytes, provenance) = dance.file()?;
        let floor_m = provenance.read.floor.or(source.map(|source| source.floor_m));
        let made = write_made(folder, id, &bytes, provenance)?;
        let clip = &dance.generated.motion.clip;
        let notes: Vec<String> = self.notes.iter().cloned().chain(dance.generated.notes(open)).collect();
        let given = open.resolved.prompt.as_ref().and_then(|prompt| prompt.joints.clone());
        let several = if job.make.variations > 1 { format!(" {}", variation + 1) } else { String::new() };
        let record = DanceRecord {
            id: id.clone(),
            name: format!("{}{several}", self.name),
            made: Some(made),
            kept: None,
            rejected: false,
            job: Some(job.id.clone()),
            variation: variation + 1,
            seed: variation_seed(open.resolved.seed, dance.chosen.number),
            frames: clip.frames(),
            fps: clip.fps(),
            floor_m: floor_m.unwrap_or(0.0),
            note: notes.join("\n").replace('`', ""),
            source: source.map(|source| source.id.clone()),
            rig: self.prepared.rig.clone(),
            generated_s: open.generated_s(),
            given: given.unwrap_or_default(),
            free: job.make.free.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "),
            made_spans: MadeSpan::of(&open.free_spans(), open.tokenizer.fps()),
            best: dance.chosen.best,
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
