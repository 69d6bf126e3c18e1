//! How much of what is likely tokens are drawn from, where nobody says.

use super::make::Ready;
use super::starts::has_given_behind_drawn;

/// [`super::sampling::Draw::top_p`] of a dance in whose frames joints are given behind free ones. What is given keeps it going,
/// and less left to chance leaves less to go wrong; a dance by itself would stand still sooner (docs/results/two-level.md,
/// "What is cut").
pub const GIVEN_TOP_P: f64 = 0.8;

impl Ready {
    /// Draws with [`GIVEN_TOP_P`] where some frame has joints given behind free ones, and the prompt lasts to the end.
    pub fn cut_where_given(&mut self) {
        let Some(prompt) = &self.prompt else { return };
        let (frames, first) = (prompt.clip.frames(), self.first_given());
        let given = prompt.edit.as_ref().map_or_else(|| first.clone(), |edit| edit.given(frames).0);
        if self.frames <= frames && given.chunks(first.len().max(1)).any(has_given_behind_drawn) {
            self.recipe.draw.top_p = Some(GIVEN_TOP_P);
        }
    }
}
