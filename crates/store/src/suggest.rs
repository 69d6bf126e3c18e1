//! Suggestions for misspelt names.

use strsim::osa_distance;

/// `; did you mean NAME?`, for the end of a message; empty when no name is similar.
pub fn did_you_mean<'a>(given: &str, names: impl IntoIterator<Item = &'a str>) -> String {
    nearest(given, names).map_or_else(String::new, |name| format!("; did you mean {name}?"))
}

/// The name with the fewest edits, the first of several; `None` with more than one edit per three letters. Case, `_`, `-`, `.`
/// and white space are ignored.
///
/// ```
/// assert_eq!(kinelm_store::suggest::nearest("rigth-arm", ["left_arm", "right_arm"]), Some("right_arm"));
/// ```
pub fn nearest<'a>(given: &str, names: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let given = plain(given);
    // at least one edit, also for one letter
    let most = given.chars().count().div_ceil(3);
    // so long a text is no typing error
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
