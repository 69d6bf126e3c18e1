//! What a GLB has: its chunks, its document with numbers, its nodes and its animations.

pub(super) mod chunks;
pub(super) mod document;
pub(super) mod take;
pub(super) mod track;
pub(super) mod tree;
