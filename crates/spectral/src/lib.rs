//! The spectra of a dance: windows of rotation series and what transforms make of them.
//!
//! A clip becomes a [`Series`] (rotation vectors of chosen joints, continuous in time, at one rate), the series windows
//! ([`WindowSpec`]), a window a feature ([`Transform`]): magnitudes of a short-time Fourier transform, low coefficients of a
//! cosine transform, or coordinates in a basis of principal components. Source: the motion-language thesis
//! (docs/query.md).
//!
//! Beside these, [`filter`] takes fast movements away, and [`interpolate`] moves one dance towards another.
//!
//! **Letters**: C channels (three a joint), N frames of a window. Windows are (C, N), features (C, numbers a channel).
#![forbid(unsafe_code)]

pub mod clean;
pub mod compare;
mod dct;
mod feature;
pub mod filter;
pub mod interpolate;
mod pca;
pub mod picture;
pub mod query;
pub mod series;
mod stft;
pub mod windows;

pub use dct::LowDct;
pub use feature::Transform;
pub use kinelm_corpus::{Error, Result};
pub use pca::PcaBasis;
pub use series::Series;
pub use stft::Stft;
pub use windows::WindowSpec;
