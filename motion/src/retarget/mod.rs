//! One body's motion on another body.

pub mod map;

pub use map::SkeletonMap;
