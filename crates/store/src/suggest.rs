//! The name that was meant.

/// `; did you mean NAME?`, to end an error's text with; empty where no name is near the one that was given.
pub fn did_you_mean<'a>(given: &str, names: impl IntoIterator<Item = &'a str>) -> String {
    nearest(given, names).map_or_else(String::new, |name| format!("; did you mean {name}?"))
}

/// The name with the fewest edits to the one given, the first of several; none with more than one edit in three letters.
/// Case, `_`, `-`, `.` and blanks count for nothing.
pub fn nearest<'a>(given: &str, names: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let given = plain(given);
    let most = given.len().div_ceil(3);
    // what is that long is no slip of the hand
    if given.len() > 64 {
        return None;
    }
    let distances = names.into_iter().map(|name| (edits(&given, &plain(name)), name));
    distances.filter(|(edits, _)| *edits <= most).min_by_key(|(edits, _)| *edits).map(|(_, name)| name)
}

fn plain(name: &str) -> Vec<char> {
    let kept = name.chars().filter(|c| !matches!(c, '_' | '-' | '.') && !c.is_whitespace());
    kept.flat_map(char::to_lowercase).collect()
}

/// Letters put in, left out, changed, or swapped with their neighbour, each once: the optimal string alignment distance.
fn edits(a: &[char], b: &[char]) -> usize {
    let mut rows: Vec<Vec<usize>> = vec![(0..=b.len()).collect()];
    for i in 1..=a.len() {
        let mut row = vec![i];
        for j in 1..=b.len() {
            let changed = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            let mut least = changed.min(rows[i - 1][j] + 1).min(row[j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                least = least.min(rows[i - 2][j - 2] + 1);
            }
            row.push(least);
        }
        rows.push(row);
    }
    rows[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edits_are_counted() {
        let of = |a: &str, b: &str| edits(&plain(a), &plain(b));
        assert_eq!([of("", ""), of("kitten", "sitting"), of("ab", "ba"), of("Right-Arm", "right_arm")], [0, 3, 1, 0]);
        assert_eq!([of("abc", ""), of("", "abc"), of("ca", "abc")], [3, 3, 3]);
    }

    #[test]
    fn the_nearest_name_is_meant_if_it_is_near() {
        let names = ["left_arm", "right_arm", "root"];
        assert_eq!(nearest("rigth_arm", names), Some("right_arm"));
        assert_eq!(nearest("RightArm", names), Some("right_arm"));
        assert_eq!(nearest("rot", names), Some("root"));
        assert_eq!(nearest("wing", names), None);
        assert_eq!(nearest("", names), None);
        assert_eq!(nearest(&"x".repeat(1 << 20), names), None);
        assert_eq!(did_you_mean("lft_arm", names), "; did you mean left_arm?");
        assert_eq!(did_you_mean("wing", names), "");
    }
}
