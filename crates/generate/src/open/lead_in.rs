//! The second of a train clip that an unprompted dance continues from.

use super::OpenRequest;
use crate::request::Resolved;
use crate::sampler::variation_seed;
use crate::{Error, Result};
use kinelm_model::lead_in::{self, LeadIn, LeadInFrom, LeadIns};
use kinelm_tokenizer::Tokenizer;

impl OpenRequest {
    /// The second of a train clip that a variation continues from, if it does.
    pub fn lead_in(&self, variation: usize) -> Option<&LeadIn> {
        let all = self.lead_ins.as_ref()?;
        match (variation, &self.resolved.lead_in_from) {
            (0, Some(from)) => all.find(from),
            _ => all.choose(&self.conditions, self.front_at(0), variation_seed(self.resolved.seed, variation)),
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
        return Err(Error::invalid_parameter("lead_in", request.lead_in, expected));
    }
    match all.find(from) {
        Some(_) => Ok(all),
        None => Err(wrong("other lead-ins")),
    }
}
