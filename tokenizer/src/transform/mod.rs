//! Pure maths on series of numbers: transforms over time and over channels. Knows no clips and no codes.

pub mod dct;
pub mod ica;
pub mod lapped;
pub mod pca;
