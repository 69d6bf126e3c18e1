//! Two dancers of the library compared.

use super::Library;
use crate::Result;
use kinelm_motion::format;
use kinelm_spectral::compare::{CompareOptions, Compared, compare};
use serde::Deserialize;

/// Whom a page compares.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pair {
    /// A clip or a dance.
    pub teacher: String,
    /// A clip or a dance.
    pub student: String,
}

impl Pair {
    /// The student compared with the teacher, and the names of both.
    ///
    /// # Errors
    /// Those of [`Library::source`], of reading and of [`compare`].
    pub fn compare(&self, library: &Library) -> Result<(Compared, [String; 2])> {
        let read = |id: &str| {
            let source = library.source(id)?;
            Ok::<_, crate::Error>((format::read(&source.path, &source.read)?, source.name))
        };
        let ((teacher, first), (student, second)) = (read(&self.teacher)?, read(&self.student)?);
        Ok((compare(&teacher, &student, &CompareOptions::default())?, [first, second]))
    }
}
