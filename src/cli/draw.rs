//! How tokens are drawn, the same on every command that draws some.

use super::read::positive;
use crate::generate::sampling::Sampling;
use anyhow::Result;

/// How the next token is drawn: the penalty first, then temperature, top-k, top-p, min-p, in this order.
#[derive(Debug, Clone, Copy, clap::Args)]
#[command(next_help_heading = "Drawing")]
pub struct DrawArgs {
    /// Always the likeliest token, instead of drawing by probability
    #[arg(long, conflicts_with_all = ["temperature", "top_k", "top_p", "min_p"])]
    greedy: bool,
    /// Below 1 bolder in what is likely, above 1 in what is not
    #[arg(long, default_value_t = 1.0, value_parser = positive)]
    temperature: f64,
    /// Draw from the N likeliest tokens only
    #[arg(long, value_name = "N")]
    top_k: Option<usize>,
    /// Draw from the fewest likeliest tokens only that have the probability P together; 1 cuts nothing. 0.95 where no
    /// other option cuts: rare tokens, drawn again and again, make a body fly apart. `generate` takes 0.8 where joints
    /// are given behind free ones from end to end (an arm, not the root alone)
    #[arg(long, value_name = "P")]
    top_p: Option<f64>,
    /// Draw from the tokens only that are at least P times as likely as the likeliest
    #[arg(long, value_name = "P")]
    min_p: Option<f64>,
    /// Divide the probability of what stood at the same place of a word a short while ago: above 1 against freezing
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = positive)]
    repetition_penalty: f64,
    /// Words that the penalty looks back: frames, where a word is a frame
    #[arg(long, value_name = "N", default_value_t = Sampling::default().repetition_words)]
    repetition_words: usize,
}

impl DrawArgs {
    /// As it is requested: without any truncation, the library chooses one.
    pub fn requested(self) -> Result<Sampling> {
        let draw = Sampling {
            greedy: self.greedy,
            repetition_penalty: self.repetition_penalty,
            repetition_words: self.repetition_words,
            temperature: self.temperature,
            top_k: self.top_k,
            top_p: self.top_p,
            min_p: self.min_p,
        };
        draw.validate()?;
        Ok(draw)
    }

    /// The same with a top-p where nothing truncates.
    pub fn get(self) -> Result<Sampling> {
        Ok(self.requested()?.truncated())
    }
}
