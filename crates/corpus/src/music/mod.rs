//! Music of dances: the files that belong to clips, their beats as text, and how a clip has both.

pub mod beats;
pub mod clip_music;
pub mod library;
pub(crate) mod motion_beats;
pub mod synth;
pub mod tempo;
pub mod track;
