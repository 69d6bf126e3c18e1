//! The program as a user runs it: one binary, so that it is linked once.

mod aclstm;
mod blend;
mod classify;
mod clean;
mod compare;
mod convert;
mod demo;
mod edit;
mod faults;
mod files;
mod follow;
mod hours;
mod links;
mod masked;
mod music;
mod music_lstm;
mod new_dances;
mod once;
mod outputs;
mod pipeline;
mod plan;
mod query;
mod readme;
mod ready;
#[cfg(feature = "studio")]
mod studio;
mod study;
mod support;
mod tokens;
mod training;
mod two_level;
mod vrm;
mod words;
