//! Labels out of file and folder names: patterns such as `{genre}/{take}.bvh`, and the names of AIST++.

use crate::{Error, Result};
use std::collections::BTreeMap;

/// Extensions of motion files.
pub const EXTENSIONS: &[&str] =
    if cfg!(feature = "fbx") { &["bvh", "npz", "pkl", "json", "fbx"] } else { &["bvh", "npz", "pkl", "json"] };

/// A path without the extension of a motion file.
pub fn without_extension(path: &str) -> &str {
    match path.rsplit_once('.') {
        Some((stem, e)) if !stem.is_empty() && EXTENSIONS.iter().any(|x| e.eq_ignore_ascii_case(x)) => stem,
        _ => path,
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Piece {
    Text(String),
    Field(String),
    Any,
}

/// A pattern over the last parts of a path.
///
/// `{field}` takes one or more characters other than `/`, the fewest that let the rest fit; `*` takes any number of
/// them; everything else stands for itself. A pattern of k parts (split by `/`) is laid on the last k parts of a path;
/// where its last part names no extension of a motion file, that of the path is left out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    text: String,
    parts: Vec<Vec<Piece>>,
    with_extension: bool,
}

impl Pattern {
    /// Reads a pattern.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Call`] for a brace without its partner, no field at all, a field without a name or named twice, or two
    /// fields with nothing between them.
    pub fn parse(text: &str) -> Result<Self> {
        let fail = |what: String| Err(Error::call(format!("pattern `{text}`: {what}")));
        let normal = text.replace('\\', "/");
        let mut parts = Vec::new();
        let mut seen: Vec<String> = Vec::new();
        for part in normal.trim_start_matches("./").split('/') {
            match parse_part(part, &mut seen) {
                Ok(pieces) => parts.push(pieces),
                Err(what) => return fail(what),
            }
        }
        if seen.is_empty() {
            return fail("no field; write one as {genre}".into());
        }
        Ok(Pattern { text: text.to_owned(), parts, with_extension: without_extension(&normal) != normal })
    }

    /// As the user wrote it.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// How many parts of a path it takes.
    pub fn depth(&self) -> usize {
        self.parts.len()
    }

    /// The values of its fields in a path with `/` between its parts, or `None` where it doesn't fit.
    pub fn find(&self, path: &str) -> Option<BTreeMap<String, String>> {
        let path = if self.with_extension { path } else { without_extension(path) };
        let parts: Vec<&str> = path.split('/').collect();
        let tail = &parts[parts.len().checked_sub(self.parts.len())?..];
        let mut found = BTreeMap::new();
        let all = self.parts.iter().zip(tail).all(|(pieces, part)| fit(pieces, part, &mut found));
        all.then_some(found)
    }
}

fn parse_part(part: &str, seen: &mut Vec<String>) -> std::result::Result<Vec<Piece>, String> {
    let (mut pieces, mut rest) = (Vec::new(), part);
    while let Some(first) = rest.chars().next() {
        match first {
            '{' => {
                let end = rest.find('}').ok_or("a `{` without its `}`")?;
                let name = rest[1..end].trim();
                if name.is_empty() || name.contains('{') {
                    return Err("a field without a name; write one as {genre}".into());
                }
                if seen.iter().any(|s| s == name) {
                    return Err(format!("the field {name} stands twice"));
                }
                if matches!(pieces.last(), Some(Piece::Field(_) | Piece::Any)) {
                    return Err(format!("nothing between {{{name}}} and what stands before it"));
                }
                seen.push(name.to_owned());
                pieces.push(Piece::Field(name.to_owned()));
                rest = &rest[end + 1..];
            }
            '}' => return Err("a `}` without its `{`".into()),
            '*' => {
                if matches!(pieces.last(), Some(Piece::Field(_) | Piece::Any)) {
                    return Err("nothing between `*` and what stands before it".into());
                }
                pieces.push(Piece::Any);
                rest = &rest[1..];
            }
            _ => {
                let end = rest.find(['{', '}', '*']).unwrap_or(rest.len());
                pieces.push(Piece::Text(rest[..end].to_owned()));
                rest = &rest[end..];
            }
        }
    }
    Ok(pieces)
}

/// Lays pieces on one part of a path. Free pieces never touch, so each ends where the text after it begins: the first
/// place that lets the rest fit. Failed (piece, place) pairs are remembered: many `*` stay cheap.
fn fit(pieces: &[Piece], part: &str, found: &mut BTreeMap<String, String>) -> bool {
    fn go(pieces: &[Piece], rest: &str, dead: &mut Vec<(usize, usize)>, taken: &mut Vec<(String, String)>) -> bool {
        let Some((piece, after)) = pieces.split_first() else { return rest.is_empty() };
        let here = (pieces.len(), rest.len());
        if dead.contains(&here) {
            return false;
        }
        let fits = match piece {
            Piece::Text(text) => rest.strip_prefix(text.as_str()).is_some_and(|r| go(after, r, dead, taken)),
            Piece::Field(_) | Piece::Any => {
                let ends = rest.char_indices().map(|(i, _)| i).chain([rest.len()]);
                let least = usize::from(matches!(piece, Piece::Field(_)));
                ends.skip(least).any(|end| {
                    let mark = taken.len();
                    if let Piece::Field(name) = piece {
                        taken.push((name.clone(), rest[..end].to_owned()));
                    }
                    let fits = go(after, &rest[end..], dead, taken);
                    if !fits {
                        taken.truncate(mark);
                    }
                    fits
                })
            }
        };
        if !fits {
            dead.push(here);
        }
        fits
    }
    let mut taken = Vec::new();
    let fits = go(pieces, part, &mut Vec::new(), &mut taken);
    found.extend(taken);
    fits
}

/// What an AIST++ name says: `gBR_sBM_cAll_d04_mBR0_ch01`, also with parts before and after these six.
///
/// Genres and situations of the table in the data set's paper get their names (`gBR` is `break`, `sBM` is `basic`);
/// other codes are kept as they are. The second value is the recording: the name without its camera, because the
/// cameras of one dance saw the same dance.
pub fn aist_name(stem: &str) -> Option<(BTreeMap<String, String>, String)> {
    let parts: Vec<&str> = stem.split('_').collect();
    let first = parts.windows(6).position(is_aist)?;
    let six = &parts[first..first + 6];
    let values = [genre(six[0]), situation(six[1]), six[2], six[3], six[4], six[5]];
    let fields = ["genre", "situation", "camera", "dancer", "music", "choreography"];
    let labels = fields.into_iter().zip(values).map(|(f, v)| (f.to_owned(), v.to_owned())).collect();
    let take: Vec<&str> = parts.iter().enumerate().filter(|(i, _)| *i != first + 2).map(|(_, p)| *p).collect();
    Some((labels, take.join("_")))
}

fn is_aist(six: &[&str]) -> bool {
    let code = |part: &str, lead: &str, test: fn(char) -> bool| {
        part.strip_prefix(lead).is_some_and(|rest| !rest.is_empty() && rest.chars().all(test))
    };
    let upper = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit();
    code(six[0], "g", upper)
        && code(six[1], "s", upper)
        && code(six[2], "c", |c| c.is_ascii_alphanumeric())
        && code(six[3], "d", |c| c.is_ascii_digit())
        && code(six[4], "m", upper)
        && code(six[5], "ch", |c| c.is_ascii_digit())
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
    fn patterns_take_names_and_folders() {
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
    fn many_stars_stay_cheap() {
        let pattern = format!("{}b{{x}}", "*a".repeat(40));
        assert_eq!(found(&pattern, &"a".repeat(200)), None);
    }

    #[test]
    fn nonsense_is_refused() {
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
