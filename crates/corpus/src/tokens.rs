//! The token file: the ids of all clips, one after the other.

use super::array_file::ArrayFile;
use super::record::TokenType;
use crate::{Error, Result};
use std::ops::Range;
use std::path::PathBuf;

/// The tokens of all clips.
#[derive(Debug)]
pub struct Tokens {
    pub(super) bytes: ArrayFile<u8>,
    pub(super) kind: TokenType,
    pub(super) path: PathBuf,
    /// Ids are below this.
    pub(super) vocabulary: usize,
}

impl Tokens {
    /// How many there are.
    pub(crate) fn len(&self) -> usize {
        self.bytes.len() / self.kind.width()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The ids of a range of places.
    ///
    /// # Errors
    /// A token file that was cut while it was in use; an id that the tokenizer hasn't.
    ///
    /// # Panics
    /// If the range leaves the file.
    pub fn ids(&self, places: Range<usize>) -> Result<Vec<u32>> {
        let width = self.kind.width();
        let bytes = self.bytes.read(places.start * width..places.end * width)?;
        self.check(&bytes)?;
        Ok(self.kind.ids_of(&bytes).collect())
    }

    /// Refuses ids that the tokenizer hasn't: a model has no row for them.
    fn check(&self, bytes: &[u8]) -> Result<()> {
        let largest = self.kind.ids_of(bytes).max();
        largest.filter(|id| *id as usize >= self.vocabulary).map_or(Ok(()), |id| {
            let expected = format!("ids below {}, those of its tokenizer.json", self.vocabulary);
            Err(Error::file(&self.path, format!("id {id}"), expected, "make the corpus again"))
        })
    }

    pub(super) fn check_all(&self) -> Result<()> {
        self.bytes.blocks().try_for_each(|block| self.check(&self.bytes.read(block)?))
    }
}
