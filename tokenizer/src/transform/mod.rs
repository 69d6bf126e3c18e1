//! Transforms of series over time and over channels, independent of clips and codes.

pub mod dct;
#[cfg(feature = "fit")]
pub mod ica;
pub mod lapped;
#[cfg(feature = "fit")]
pub mod pca;
