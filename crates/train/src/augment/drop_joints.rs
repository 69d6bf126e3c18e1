//! Windows with hidden joints, so that the model also works with some joints unknown.

use crate::{Error, Result};
use kinelm_motion::joints::Selection;
use kinelm_tokenizer::Tokenizer;
use rand_chacha::rand_core::RngCore;

/// The places of each joint that may be hidden: all that are coded but the root.
#[derive(Debug, Default)]
pub struct Droppable {
    joints: Vec<Vec<usize>>,
}

impl Droppable {
    /// The droppable joints of a tokenizer.
    ///
    /// # Errors
    /// A tokenizer whose tokens don't belong to one joint each, with the reason; one that codes only the root.
    pub fn of(tokenizer: &Tokenizer) -> Result<Droppable> {
        let refuse = |why: String| {
            Error::unsupported("augment.drop_joints", format!("no joint can be hidden: {why}; leave it out"))
        };
        let coded = tokenizer.channels().joints().iter().filter(|&&joint| joint != 0);
        let places = |&joint: &usize| tokenizer.slots_of(&Selection::in_place(vec![joint]));
        let joints: Vec<Vec<usize>> =
            coded.map(places).collect::<kinelm_tokenizer::Result<_>>().map_err(|e| refuse(e.to_string()))?;
        if tokenizer.tokens_per_word().is_none() {
            return Err(refuse("words differ in length".into()));
        }
        if joints.is_empty() {
            return Err(refuse("the tokenizer codes the root alone".into()));
        }
        Ok(Droppable { joints })
    }

    /// The places of one up to half of the joints, any number of them alike, ascending.
    pub fn sample(&self, rng: &mut impl RngCore) -> Vec<usize> {
        // a tokenizer of the root and one joint still hides that one
        let half = (self.joints.len() / 2).max(1);
        let number = 1 + (rng.next_u64() % half as u64) as usize;
        let mut order: Vec<usize> = (0..self.joints.len()).collect();
        // the first `number` places of Fisher and Yates: a subset without repeats
        for i in 0..number {
            let left = (order.len() - i) as u64;
            order.swap(i, i + (rng.next_u64() % left) as usize);
        }
        let mut places: Vec<usize> = order[..number].iter().flat_map(|&j| self.joints[j].iter().copied()).collect();
        places.sort_unstable();
        places
    }
}
