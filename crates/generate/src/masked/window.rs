//! Which window of a dance is filled next.

use std::ops::Range;

/// A window of a dance.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Window {
    /// Its words.
    pub words: Range<usize>,
    /// Words before this one are stored as filled; the rest of the window is masked again.
    pub kept: usize,
}

impl Window {
    /// The window for word `first`, the first of `words` words that is `open`: has masked characters.
    ///
    /// A run of open words that a window holds together with a word on either side is filled at once, in the window's middle.
    /// Of a longer run a window takes the beginning: a quarter of the window is before it, and the fill of the last
    /// quarter is discarded, since nothing is known after it. So the windows of a long run advance by half a window.
    pub fn next(first: usize, words: usize, most: usize, open: &dyn Fn(usize) -> bool) -> Option<Window> {
        if first >= words {
            return None;
        }
        let most = most.min(words);
        // a run that is longer than a window fits in no case, so its end needn't be searched for
        let seen = (first + most).min(words);
        let end = (first..seen).find(|&word| !open(word)).unwrap_or(seen);
        let with_sides = first.saturating_sub(1)..(end + 1).min(words);
        let fits = with_sides.len() <= most;
        let (before, after) = if fits { ((most - (end - first)) / 2, 0) } else { (most / 4, most / 4) };
        // pushed back from the end of the dance: a shorter window would have less context
        let start = first.saturating_sub(before).min(words - most);
        Some(Window { words: start..start + most, kept: if fits { end } else { start + most - after } })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The windows of a dance of `words` words of which `open` are.
    fn windows(words: usize, most: usize, open: &[(usize, usize)]) -> Vec<(Range<usize>, usize)> {
        let (mut found, mut from) = (Vec::new(), 0);
        loop {
            let is_open = |word: usize| word >= from && open.iter().any(|run| (run.0..run.1).contains(&word));
            let Some(first) = (0..words).find(|&word| is_open(word)) else { return found };
            let Window { words, kept } = Window::next(first, words, most, &is_open).unwrap();
            assert!(kept > first && words.contains(&first) && words.len() <= most && kept <= words.end);
            found.push((words, kept));
            from = kept;
        }
    }

    #[test]
    fn a_gap_that_fits_is_filled_at_once_in_the_windows_middle() {
        assert_eq!(windows(100, 20, &[(40, 50)]), [(35..55, 50)]);
        assert_eq!(windows(100, 20, &[(40, 58)]), [(39..59, 58)]);
        // at the ends of the dance, and in one shorter than a window
        assert_eq!(windows(100, 20, &[(0, 10)]), [(0..20, 10)]);
        assert_eq!(windows(100, 20, &[(81, 100)]), [(80..100, 100)]);
        assert_eq!(windows(12, 20, &[(3, 9)]), [(0..12, 9)]);
        assert_eq!(windows(12, 20, &[(0, 12)]), [(0..12, 12)]);
        // two gaps in one window are filled one after the other
        assert_eq!(windows(100, 20, &[(40, 44), (46, 50)]), [(32..52, 44), (38..58, 50)]);
    }

    #[test]
    fn windows_of_a_long_gap_are_half_a_window_apart() {
        let found = windows(100, 20, &[(30, 70)]);
        assert_eq!(found, [(25..45, 40), (35..55, 50), (45..65, 60), (55..75, 70)]);
        let free = windows(50, 20, &[(0, 50)]);
        assert_eq!(free, [(0..20, 15), (10..30, 25), (20..40, 35), (30..50, 50)]);
    }

    #[test]
    fn every_open_word_is_kept_once_in_windows_of_any_size() {
        for most in 2..9 {
            for words in 1..30 {
                for open in [(0, words), (1, words), (0, words - 1), (words / 3, words / 2)] {
                    let found = windows(words, most, &[open]);
                    assert_eq!(found.is_empty(), open.0 == open.1);
                    assert!(found.windows(2).all(|pair| pair[0].1 < pair[1].1), "{found:?}");
                    assert!(found.last().is_none_or(|(_, kept)| *kept >= open.1), "{found:?}");
                }
            }
        }
    }
}
