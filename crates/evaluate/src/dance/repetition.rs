//! Whether a dance repeats itself: docs/measures.md, "Repetition".
//!
//! Limits: only an exact repetition counts, so that finer bins find fewer.

/// How far back a repetition may have ended, seconds.
const BACK_S: f64 = 10.0;

/// Frames whose next second of tokens is, token by token, one that ended at most ten seconds earlier, and all frames that
/// have a next second. `words`: a dance's words, each of `frames_per_word` frames.
pub fn repeats(words: &[&[u32]], frames_per_word: usize, fps: f64) -> [usize; 2] {
    let in_words = |seconds: f64| ((seconds * fps / frames_per_word as f64).round() as usize).max(1);
    let (second, back) = (in_words(1.0), in_words(BACK_S));
    let Some(last) = words.len().checked_sub(second) else { return [0, 0] };
    let repeated = |at: usize| {
        let next = &words[at..at + second];
        // the earlier second ends by `at`, so that the two never overlap
        (at.saturating_sub(back)..=at).any(|end| end >= second && &words[end - second..end] == next)
    };
    let found = (0..=last).filter(|&at| repeated(at)).count();
    [found * frames_per_word, (last + 1) * frames_per_word]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(ids: &[u32]) -> [usize; 2] {
        let words: Vec<&[u32]> = ids.chunks(1).collect();
        repeats(&words, 1, 4.0)
    }

    #[test]
    fn a_second_that_came_before_is_a_repetition() {
        // four frames a second: 1 2 3 4 comes again at frames 4 and 8, and what lies between them as well
        assert_eq!(of(&[1, 2, 3, 4, 1, 2, 3, 4, 1, 2, 3, 4]), [5, 9]);
        assert_eq!(of(&[1, 2, 3, 4, 5, 6, 7, 8]), [0, 5]);
        assert_eq!(of(&[7; 8]), [1, 5], "the second before ends where the next begins");
        assert_eq!(of(&[1, 2, 3]), [0, 0]);
    }

    #[test]
    fn what_ended_longer_ago_does_not_count() {
        let far = |between: u32| [vec![1, 2, 3, 4], (10..10 + between).collect(), vec![1, 2, 3, 4]].concat();
        // ten seconds are 40 frames
        assert_eq!(of(&far(40))[0], 1);
        assert_eq!(of(&far(41))[0], 0);
    }

    #[test]
    fn tiles_count_with_all_their_frames() {
        let words: Vec<&[u32]> = [1, 2, 1, 2].chunks(1).collect();
        // a second is two words: of the three places that have a next one, the last repeats the first
        assert_eq!(repeats(&words, 10, 20.0), [10, 30]);
    }
}
