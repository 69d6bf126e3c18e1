//! What a GLB has: its chunks, its document with numbers, VRM's humanoid, its nodes and its animations.

pub(super) mod chunks;
pub(super) mod document;
mod extensions;
pub(super) mod humanoid;
pub(super) mod sole;
pub(super) mod take;
pub(super) mod track;
pub(super) mod tree;
