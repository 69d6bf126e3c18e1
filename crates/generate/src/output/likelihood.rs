//! The likelihood of a dance under the model that generated it.

use crate::open::OpenRequest;
use crate::{Error, Result};
use kinelm_corpus::windows::{eval_windows, fill_sequence};
use kinelm_corpus::words::ClipWords;
use kinelm_model::TokenWindows;
use kinelm_model::scored_windows::{history, room};
use kinelm_tokenizer::{SPACE, Words};

impl OpenRequest {
    /// Bits per frame of each dance, given characters included. Windows are cut and scored as for clips of a corpus
    /// ([`kinelm_model::likelihood`]), with the labels in front and without music and goals.
    ///
    /// # Errors
    /// A masked model, which has no likelihood; what the model fails with; words that are not its tokenizer's.
    pub fn bits_per_frame(&self, dances: &[&Words]) -> Result<Vec<f64>> {
        if self.is_masked() {
            let why = "a masked model sees both sides of a token, and what it makes of it is no likelihood";
            return Err(Error::unsupported("bits per frame of a dance", why));
        }
        let mut model = self.run.scores(self.resolved.computing.compute()?)?;
        let (pad, room) = (model.tokens().pad, room(model.config(), model.tokens()));
        let mut bits = Vec::with_capacity(dances.len());
        for dance in dances {
            let ids = self.tokenizer.ids_of_words(dance)?;
            let ends = ids.iter().enumerate().filter(|(_, id)| **id == SPACE).map(|(at, _)| at as u32 + 1);
            let mut starts: Vec<u32> = std::iter::once(0).chain(ends).collect();
            // the last space begins no word
            starts.pop();
            let words = ClipWords::Varying { starts: &starts, tokens: ids.len() };
            let mut nats = 0.0;
            for window in eval_windows([words], room)? {
                let frame = words.before(window.start + 1).saturating_sub(1) * self.tokenizer.frames_per_word();
                let front = self.front_at(frame);
                let length = window.tokens + front.len() - 1;
                let (mut input, mut target) = (vec![pad; length], vec![pad; length]);
                fill_sequence(&ids[window.start..][..window.tokens], front, pad, &mut input, &mut target);
                // scored by the window before
                target[..front.len() - 1 + window.scored.start].fill(pad);
                let mut scored = vec![0.0; length];
                let before = history(&ids[..window.start], model.config().history() * model.tokens().word, pad);
                let windows =
                    TokenWindows { inputs: &input, targets: &target, length, history: &before, conditioning: None };
                model.nats(windows, &mut scored)?;
                nats += scored.iter().map(|&x| f64::from(x)).sum::<f64>();
            }
            let frames = starts.len() * self.tokenizer.frames_per_word();
            if !nats.is_finite() || frames == 0 {
                return Err(Error::NotFinite(format!("the likelihood of a dance of {frames} frames: {nats} nats")));
            }
            bits.push(nats / std::f64::consts::LN_2 / frames as f64);
        }
        Ok(bits)
    }
}
