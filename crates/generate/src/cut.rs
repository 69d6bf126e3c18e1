//! How much of what is likely tokens are drawn from, where nobody says.

use super::open::OpenRequest;
use super::starts::has_given_behind_drawn;

/// [`super::sampling::Draw::top_p`] of a dance that is given joints behind free ones in all its frames. What is given keeps it
/// going, and less left to chance leaves less to go wrong; a dance by itself would stand still sooner
/// (docs/results/two-level.md, "What is cut").
pub const GIVEN_TOP_P: f64 = 0.8;

impl OpenRequest {
    /// Draws with [`GIVEN_TOP_P`] where every frame that isn't given whole has joints given behind free ones.
    pub(super) fn cut_where_given(&mut self) {
        let Some(prompt) = &self.prompt else { return };
        let (frames, first) = (prompt.clip.frames(), self.first_given());
        let given = prompt.edit.as_ref().map_or_else(|| first.clone(), |edit| edit.given(frames).0);
        let is_whole = |frame: &[bool]| frame.iter().all(|is_given| *is_given);
        let mut drawn = given.chunks(first.len().max(1)).filter(|frame| !is_whole(frame)).peekable();
        if self.frames <= frames && drawn.peek().is_some() && drawn.all(has_given_behind_drawn) {
            self.recipe.draw.top_p = Some(GIVEN_TOP_P);
        }
    }
}
