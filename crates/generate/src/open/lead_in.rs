//! The second of a train clip that an unprompted dance continues from.

use super::OpenRequest;
use crate::edit::PreparedEdit;
use crate::request::Resolved;
use crate::sampler::variation_seed;
use crate::{Error, Result};
use kinelm_model::lead_in::{self, LeadIn, LeadInFrom, LeadIns};
use kinelm_tokenizer::Tokenizer;

impl OpenRequest {
    /// Whether nothing of the first frame is given: no prompt gives anything, or an edit frees all of it.
    pub(super) fn is_unprompted(&self) -> bool {
        let of_edit = |edit: &PreparedEdit| edit.begins_free();
        self.prompt.as_ref().is_none_or(|prompt| prompt.lends() || prompt.edit.as_ref().is_some_and(of_edit))
    }

    /// Gives an unprompted dance a second of lead-in: of a train clip, if `of_train` and the run stores some, else sampled.
    ///
    /// # Errors
    /// Those of [`LeadIns::load`].
    pub(super) fn add_lead_in(&mut self, of_train: bool) -> Result<()> {
        let is_unprompted = self.is_unprompted();
        let words = lead_in::words(&self.tokenizer);
        self.resolved.lead_in = if is_unprompted { words * self.tokenizer.frames_per_word() } else { 0 };
        (self.resolved.lead_in_from, self.lead_ins) = (None, None);
        if is_unprompted && of_train {
            let all = LeadIns::load(&self.resolved.run, &self.tokenizer)?;
            self.lead_ins =
                all.map(|all| self.run.load_conditions().map(|conditions| (all, conditions))).transpose()?;
            self.resolved.lead_in_from = self.lead_in(0).map(|lead_in| lead_in.from.clone());
        }
        Ok(())
    }

    /// The second of a train clip that a variation continues from, if it does.
    pub fn lead_in(&self, variation: usize) -> Option<&LeadIn> {
        let (all, conditions) = self.lead_ins.as_ref()?;
        match (variation, &self.resolved.lead_in_from) {
            (0, Some(from)) => all.find(from),
            _ => all.choose(conditions, self.front_at(0), variation_seed(self.resolved.seed, variation)),
        }
    }
}

/// The lead-ins of a request's run, which have the one that the request names.
pub(super) fn with(from: &LeadInFrom, request: &Resolved, tokenizer: &Tokenizer) -> Result<LeadIns> {
    let path = request.run.join(lead_in::LEAD_INS);
    let named = format!("the one of {} from frame {}, which the dance continues from", from.clip, from.frame);
    let wrong = |found: &str| Error::file(&path, found, named.clone(), "put back the file that the run had");
    let all = LeadIns::load(&request.run, tokenizer)?.ok_or_else(|| wrong("no lead-ins"))?;
    let length = lead_in::words(tokenizer) * tokenizer.frames_per_word();
    if request.lead_in != length {
        let expected = format!("{length}, the frames of a train clip's second");
        return Err(Error::invalid("`lead_in`", request.lead_in, expected));
    }
    match all.find(from) {
        Some(_) => Ok(all),
        None => Err(wrong("other lead-ins")),
    }
}
