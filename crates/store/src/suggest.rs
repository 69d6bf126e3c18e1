//! The name that was meant.

use strsim::osa_distance;

/// `; did you mean NAME?`, to end an error's text with; empty where no name is near the one that was given.
pub fn did_you_mean<'a>(given: &str, names: impl IntoIterator<Item = &'a str>) -> String {
    nearest(given, names).map_or_else(String::new, |name| format!("; did you mean {name}?"))
}

/// The name with the fewest edits to the one given, the first of several; none with more than one edit in three letters.
/// Case, `_`, `-`, `.` and blanks count for nothing.
pub fn nearest<'a>(given: &str, names: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let given = plain(given);
    let most = given.chars().count().div_ceil(3);
    // what is that long is no slip of the hand
    if given.chars().count() > 64 {
        return None;
    }
    let distances = names.into_iter().map(|name| (osa_distance(&given, &plain(name)), name));
    distances.filter(|(edits, _)| *edits <= most).min_by_key(|(edits, _)| *edits).map(|(_, name)| name)
}

fn plain(name: &str) -> String {
    let kept = name.chars().filter(|c| !matches!(c, '_' | '-' | '.') && !c.is_whitespace());
    kept.flat_map(char::to_lowercase).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
