//! Music beside dances: what a file holds, its beats as text, and how a clip has both.

pub mod beats;
pub mod dance;
pub mod find;
pub mod own;
pub mod piece;
pub mod sound;
pub mod tempo;
