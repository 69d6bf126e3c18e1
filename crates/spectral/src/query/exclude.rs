//! Which windows don't count as found.

use super::database::{Database, Window};
use super::record::ClipEntry;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// The windows left out of an answer: each leaves out what those before it do. See docs/query.md, "Exclusions".
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Exclude {
    /// Nothing.
    None,
    /// The window itself.
    #[serde(rename = "self")]
    #[cfg_attr(feature = "clap", value(name = "self"))]
    Itself,
    /// Windows that share a frame with it.
    Overlap,
    /// Its clip.
    Clip,
    /// The same recording, whoever of the dancers it shows and from wherever.
    Take,
    /// The same choreography, by the label of this name, of the same genre if that is known.
    Choreography,
}

impl Exclude {
    /// All, in this order.
    pub const ALL: [Exclude; 6] =
        [Exclude::None, Exclude::Itself, Exclude::Overlap, Exclude::Clip, Exclude::Take, Exclude::Choreography];

    /// Its name in tables and flags.
    pub fn name(self) -> &'static str {
        match self {
            Exclude::None => "none",
            Exclude::Itself => "self",
            Exclude::Overlap => "overlap",
            Exclude::Clip => "clip",
            Exclude::Take => "take",
            Exclude::Choreography => "choreography",
        }
    }

    /// Whether the clips say what this needs.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Missing`] where no clip has a choreography.
    pub fn check<'a>(self, clips: impl IntoIterator<Item = &'a ClipEntry>) -> Result<()> {
        let known = |c: &ClipEntry| c.labels.contains_key("choreography");
        if self == Exclude::Choreography && !clips.into_iter().any(known) {
            let help = "excluding choreographies needs it; exclude takes instead";
            return Err(Error::missing("clip with the label `choreography`", help));
        }
        Ok(())
    }
}

/// The origin of a query.
#[derive(Debug, Clone, Copy, Default)]
pub struct Origin<'a> {
    /// Its clip, if the database has it.
    pub clip: Option<usize>,
    /// Its entry in the database, if it has one.
    pub entry: Option<&'a ClipEntry>,
    /// Its first frame.
    pub start: usize,
}

impl<'a> Origin<'a> {
    /// Of a window of the database itself.
    pub fn of(database: &'a Database, window: Window) -> Origin<'a> {
        let Window { clip, start } = window;
        Origin { clip: Some(clip), entry: Some(&database.clips()[clip]), start }
    }
}

/// Decides for the windows of a database.
pub struct Exclusion<'a> {
    database: &'a Database,
    exclude: Exclude,
    origin: Origin<'a>,
    /// Of a window.
    frames: usize,
    /// Per clip, whether all of it is left out.
    clips: Vec<bool>,
}

impl<'a> Exclusion<'a> {
    /// The exclusion for a query from `origin` in `database`, whose windows have `frames` frames.
    pub fn new(database: &'a Database, exclude: Exclude, origin: Origin<'a>, frames: usize) -> Exclusion<'a> {
        let out = |(i, clip): (usize, &ClipEntry)| {
            // the same file may be in there twice, read in two ways
            let itself = origin.clip == Some(i) || origin.entry.is_some_and(|e| e.sha256 == clip.sha256);
            let take = || origin.entry.is_some_and(|e| e.take == clip.take);
            let choreography = || origin.entry.is_some_and(|e| same_choreography(e, clip));
            match exclude {
                Exclude::None | Exclude::Itself | Exclude::Overlap => false,
                Exclude::Clip => itself,
                Exclude::Take => itself || take(),
                Exclude::Choreography => itself || take() || choreography(),
            }
        };
        let clips = database.clips().iter().enumerate().map(out).collect();
        Exclusion { database, exclude, origin, frames, clips }
    }

    /// Whether a window may be found.
    pub fn allows(&self, window: usize) -> bool {
        let Window { clip, start } = self.database.window(window);
        if self.clips[clip] {
            return false;
        }
        let apart = start.abs_diff(self.origin.start);
        match self.exclude {
            _ if self.origin.clip != Some(clip) => true,
            Exclude::Itself => apart > 0,
            Exclude::Overlap => apart >= self.frames,
            _ => true,
        }
    }
}

fn same_choreography(a: &ClipEntry, b: &ClipEntry) -> bool {
    let same = |field: &str| a.labels.get(field) == b.labels.get(field);
    a.labels.contains_key("choreography") && same("choreography") && same("genre")
}
