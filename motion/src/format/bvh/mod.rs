//! BVH.

/// What a BVH says beside its clip.
#[derive(Debug, Clone, PartialEq)]
pub struct BvhSource {}
