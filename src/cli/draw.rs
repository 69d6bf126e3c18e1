//! How tokens are sampled, the same on every command that samples some.

use super::values::positive;
use crate::generate::open::{GAP_TOP_P, GIVEN_TOP_P};
use crate::generate::sampling::{FORECAST_TOP_P, Sampling, TOP_P};
use anyhow::Result;

/// How tokens are sampled: the penalty first, then temperature, top-k, top-p, min-p.
#[derive(Debug, Clone, Copy, clap::Args)]
#[command(next_help_heading = "Drawing")]
pub struct DrawArgs {
    /// Take the most likely token instead of sampling
    #[arg(long, conflicts_with_all = ["temperature", "top_k", "top_p", "min_p"])]
    greedy: bool,
    /// Sampling temperature: below 1 favours likely tokens, above 1 unlikely ones
    #[arg(long, default_value_t = Sampling::default().temperature, value_parser = positive)]
    temperature: f64,
    /// Sample from the N most likely tokens only
    #[arg(long, value_name = "N")]
    top_k: Option<usize>,
    #[arg(long, value_name = "P", help = format!("Sample from the smallest set of most likely tokens whose probability reaches \
        P; 1 truncates nothing [default: {TOP_P} without other truncation, {FORECAST_TOP_P} by a model with a forecast; \
        {GIVEN_TOP_P} in generate where joints are given after free ones throughout, such as an arm but not the root alone; \
        {GAP_TOP_P} in other gaps that a goal-conditioned model fills]"))]
    top_p: Option<f64>,
    /// Sample only from tokens at least P times as likely as the most likely one
    #[arg(long, value_name = "P")]
    min_p: Option<f64>,
    /// Divide the probability of tokens that recently stood in the same slot of a word; above 1 works against freezing
    #[arg(long, value_name = "X", default_value_t = Sampling::default().repetition_penalty, value_parser = positive)]
    repetition_penalty: f64,
    /// Words that the penalty looks back (frames, where a word is a frame)
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
        Ok(self.requested()?.truncated_at(TOP_P))
    }
}
