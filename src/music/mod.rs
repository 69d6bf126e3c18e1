//! Music beside dances: what a file holds, its beats as text, a picture of both.

pub mod beats;
pub mod dance;
pub mod find;
pub mod own;
pub mod picture;
pub mod piece;
pub mod report;
pub mod tempo;
