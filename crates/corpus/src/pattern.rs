//! Labels from file and folder names: patterns such as `{genre}/{take}.bvh`, and the names of AIST++.

use crate::{Error, Result};
use kinelm_motion::format::Format;
use regex::Regex;
use std::collections::BTreeMap;
use std::sync::LazyLock;

/// A path without the extension of a motion file.
pub(crate) fn without_extension(path: &str) -> &str {
    match path.rsplit_once('.') {
        Some((stem, e)) if !stem.is_empty() && Format::extensions().any(|x| e.eq_ignore_ascii_case(x)) => stem,
        _ => path,
    }
}

/// A pattern over the last parts of a path.
///
/// `{field}` matches one or more characters other than `/`, as few as possible; `*` matches any number of them; everything
/// else matches itself. A pattern of k parts (separated by `/`) matches the last k parts of a path. The path's extension
/// counts only if the pattern ends in the extension of a motion file.
///
/// ```
/// use kinelm_corpus::pattern::Pattern;
/// let found = Pattern::parse("{genre}/{dancer}_{take}.bvh")?.find("data/salsa/ann_07.bvh").unwrap();
/// assert_eq!((&*found["genre"], &*found["dancer"], &*found["take"]), ("salsa", "ann", "07"));
/// # Ok::<(), kinelm_corpus::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Pattern {
    text: String,
    regex: Regex,
    /// Names of the regex's groups, in order.
    fields: Vec<String>,
    with_extension: bool,
}

impl Pattern {
    /// Parses a pattern.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] for a brace without its partner, no field at all, a field without a name or named
    /// twice, or two fields with nothing between them.
    pub fn parse(text: &str) -> Result<Self> {
        let wrong = |what: String| {
            let expected = "fields such as {genre} with text between them";
            Error::invalid_parameter("labels", format!("`{text}`, a pattern with {what}"), expected)
        };
        let normal = text.replace('\\', "/");
        let mut rest = normal.trim_start_matches("./");
        let (mut regex, mut fields, mut after_wildcard) = (String::from("(?:^|/)"), Vec::<String>::new(), false);
        while let Some(first) = rest.chars().next() {
            let length = match first {
                '{' => {
                    let end = rest.find('}').ok_or_else(|| wrong("a `{` without its `}`".into()))?;
                    let name = rest[1..end].trim();
                    if name.is_empty() || name.contains(['{', '/']) {
                        return Err(wrong("a field without a name".into()));
                    }
                    if fields.iter().any(|field| field == name) {
                        return Err(wrong(format!("the field {name} twice")));
                    }
                    fields.push(name.to_owned());
                    // reluctant, so that `{a}_{b}` gives the first field as little as possible
                    regex += "([^/]+?)";
                    end + 1
                }
                '}' => return Err(wrong("a `}` without its `{`".into())),
                '*' => {
                    regex += "[^/]*?";
                    1
                }
                _ => {
                    let end = rest.find(['{', '}', '*']).unwrap_or(rest.len());
                    regex += &regex::escape(&rest[..end]);
                    end
                }
            };
            let is_wildcard = matches!(first, '{' | '*');
            // two side by side could split their text anywhere
            if is_wildcard && after_wildcard {
                return Err(wrong(format!("nothing between `{}` and the field before it", &rest[..length])));
            }
            after_wildcard = is_wildcard;
            rest = &rest[length..];
        }
        if fields.is_empty() {
            return Err(wrong("no field".into()));
        }
        let regex = Regex::new(&(regex + "$")).map_err(|e| wrong(e.to_string()))?;
        Ok(Pattern { text: text.to_owned(), regex, fields, with_extension: without_extension(&normal) != normal })
    }

    /// The pattern as the user wrote it.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The values of the fields in a path with `/` between its parts, or `None` if it doesn't match.
    pub fn find(&self, path: &str) -> Option<BTreeMap<String, String>> {
        let path = if self.with_extension { path } else { without_extension(path) };
        let found = self.regex.captures(path)?;
        Some(self.fields.iter().enumerate().map(|(i, field)| (field.clone(), found[i + 1].to_owned())).collect())
    }
}

/// Labels and take of an AIST++ name such as `gBR_sBM_cAll_d04_mBR0_ch01`, which may have further parts before and after.
///
/// Genres and situations of the table in the data set's paper get their names (`gBR` is `break`, `sBM` is `basic`), other
/// codes stay. The take is the name without its camera, since all cameras recorded one dance.
pub(crate) fn aist_name(stem: &str) -> Option<(BTreeMap<String, String>, String)> {
    static NAME: LazyLock<Regex> = LazyLock::new(|| {
        let parts = "(g[A-Z0-9]+)_(s[A-Z0-9]+)_(c[A-Za-z0-9]+)_(d[0-9]+)_(m[A-Z0-9]+)_(ch[0-9]+)";
        Regex::new(&format!("(?:^|_){parts}(?:_|$)")).expect("a fixed pattern")
    });
    let found = NAME.captures(stem)?;
    let (_, [g, s, camera, dancer, music, choreography]) = found.extract();
    let fields = ["genre", "situation", "camera", "dancer", "music", "choreography"];
    let values = [genre(g), situation(s), camera, dancer, music, choreography];
    let labels = fields.into_iter().zip(values).map(|(f, v)| (f.to_owned(), v.to_owned())).collect();
    // other parts are before the camera, so there is a `_` to cut with it
    let camera = found.get(3)?.range();
    Some((labels, format!("{}{}", &stem[..camera.start - 1], &stem[camera.end..])))
}

fn genre(code: &str) -> &str {
    match code {
        "gBR" => "break",
        "gPO" => "pop",
        "gLO" => "lock",
        "gMH" => "middle-hip-hop",
        "gLH" => "la-style-hip-hop",
        "gHO" => "house",
        "gWA" => "waack",
        "gKR" => "krump",
        "gJS" => "street-jazz",
        "gJB" => "ballet-jazz",
        other => other,
    }
}

fn situation(code: &str) -> &str {
    match code {
        "sBM" => "basic",
        "sFM" => "advanced",
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(pattern: &str, path: &str) -> Option<String> {
        let found = Pattern::parse(pattern).unwrap().find(path)?;
        Some(found.iter().map(|(k, v)| format!("{k}={v}")).collect::<Vec<_>>().join(" "))
    }

    #[test]
    fn patterns_match_names_and_folders() {
        let table = [
            ("{genre}/{take}.bvh", "salsa/07.bvh", Some("genre=salsa take=07")),
            ("{genre}/{take}.bvh", "a/b/salsa/07.bvh", Some("genre=salsa take=07")),
            ("{genre}/{take}.bvh", "07.bvh", None),
            ("{genre}/{take}.bvh", "salsa/07.npz", None),
            ("{genre}/{take}", "salsa/07.npz", Some("genre=salsa take=07")),
            (
                "dataset-{set}_{content}_{style}_{id}",
                "dataset-2_walk-left_not-confident_012.bvh",
                Some("content=walk-left id=012 set=2 style=not-confident"),
            ),
            ("{a}_{b}", "x_y_z.bvh", Some("a=x b=y_z")),
            ("{a}_x_{b}", "1_2_x_3.bvh", Some("a=1_2 b=3")),
            ("*_{b}.bvh", "x_y_z.bvh", Some("b=y_z")),
            ("*-{b}", "none.bvh", None),
            ("{a}-{b}", "-é.bvh", None),
            ("{a}-{b}", "é-ü.bvh", Some("a=é b=ü")),
        ];
        for (pattern, path, expected) in table {
            assert_eq!(found(pattern, path).as_deref(), expected, "{pattern} on {path}");
        }
    }

    #[test]
    fn many_wildcards_take_little_time() {
        let pattern = format!("{}b{{x}}", "*a".repeat(40));
        assert_eq!(found(&pattern, &"a".repeat(200)), None);
    }

    #[test]
    fn bad_patterns_are_refused() {
        for (bad, why) in [
            ("{genre", "without its `}`"),
            ("genre}", "without its `{`"),
            ("{}", "without a name"),
            ("{a}{b}", "nothing between"),
            ("{a}/{a}", "twice"),
            ("salsa", "no field"),
        ] {
            assert!(Pattern::parse(bad).unwrap_err().to_string().contains(why), "{bad}");
        }
    }

    #[test]
    fn aist_names() {
        let (labels, take) = aist_name("gBR_sBM_cAll_d04_mBR0_ch01").unwrap();
        let values: Vec<_> =
            ["genre", "situation", "camera", "dancer", "music", "choreography"].map(|f| &labels[f]).into();
        assert_eq!(values, ["break", "basic", "cAll", "d04", "mBR0", "ch01"]);
        assert_eq!(take, "gBR_sBM_d04_mBR0_ch01");
        let (labels, take) = aist_name("kthmisc_gCH_sFM_c01_d02_mCH_ch11_street_003").unwrap();
        assert_eq!((labels["genre"].as_str(), labels["situation"].as_str()), ("gCH", "advanced"));
        assert_eq!(take, "kthmisc_gCH_sFM_d02_mCH_ch11_street_003");
        for no in ["gBR_sBM_cAll_d04_mBR0", "a", "", "gBR_sBM_cAll_dxx_mBR0_ch01", "g_s_c_d_m_ch"] {
            assert_eq!(aist_name(no), None, "{no}");
        }
    }

    #[test]
    fn only_motion_extensions_are_taken_off() {
        assert_eq!(without_extension("a/b.BVH"), "a/b");
        assert_eq!(without_extension("a/b.v2"), "a/b.v2");
        assert_eq!(without_extension(".bvh"), ".bvh");
    }
}
