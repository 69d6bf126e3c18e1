//! Pure maths on series of numbers: transforms over time and over channels. Knows no clips and no codes.

pub mod dct;
#[cfg(feature = "fit")]
pub mod ica;
pub mod lapped;
#[cfg(feature = "fit")]
pub mod pca;
