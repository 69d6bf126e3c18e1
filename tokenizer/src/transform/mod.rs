//! Transforms of series over time and over channels, independent of clips and codes.

pub mod dct;
#[cfg(feature = "fit")]
pub(crate) mod ica;
pub(crate) mod lapped;
#[cfg(feature = "fit")]
pub(crate) mod pca;
