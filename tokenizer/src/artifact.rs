//! The tokenizer on disk: one `tokenizer.json` that Hugging Face's loaders read too.
//!
//! They load it as a byte-pair model of words between spaces, with or without merges. That form needs no regular expression,
//! which tokenizers 1.0 in Python can't compute, and pairs as texts are read before 0.20, too. kinelm's own part (settings,
//! fitted ranges, version, SHA-256) is the key `kinelm` of the `decoder` object, where their loaders ignore unknown keys, in
//! the Rust crate and in Python; at the top level they refuse them. A file that they save again lacks that part, and
//! [`Tokenizer::load`] reports it.

use crate::scheme::Fitted;
use crate::vocab::Special;
use crate::{Error, Result, Tokenizer, TokenizerConfig, Vocabulary};
use kinelm_motion::Quat;
use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

/// The version of kinelm's part of the file; other versions are refused.
pub const FORMAT_VERSION: u64 = 4;

/// Larger files are refused. A tokenizer with the most bins is far smaller.
pub const MAX_FILE_BYTES: u64 = 64 << 20;

/// Takes the hash's place while it is computed.
const NO_HASH: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// kinelm's part.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Own {
    version: u64,
    sha256: String,
    config: TokenizerConfig,
    fitted: Fitted,
    merges: Vec<(u32, u32)>,
    longest_word: usize,
    conditioning: Vec<String>,
    /// Mean rotations of the uncoded joints, by ascending id: x, y, z, w.
    mean_pose: Vec<[f64; 4]>,
    /// Range of the heights above the floor, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    height_range: Option<[f64; 2]>,
}

/// The whole file, in the order of its keys. Not `json!`, whose order depends on a feature of serde_json that any crate of a
/// build can enable.
#[derive(Serialize)]
struct Whole<'a> {
    version: &'static str,
    truncation: (),
    padding: (),
    added_tokens: Vec<AddedToken<'a>>,
    normalizer: (),
    pre_tokenizer: Split,
    post_processor: Template,
    decoder: Decoder,
    model: Model<'a>,
}

#[derive(Serialize)]
struct AddedToken<'a> {
    id: u32,
    content: Cow<'a, str>,
    single_word: bool,
    lstrip: bool,
    rstrip: bool,
    normalized: bool,
    special: bool,
}

#[derive(Serialize)]
struct Split {
    r#type: &'static str,
    pattern: Pattern,
    behavior: &'static str,
    invert: bool,
}

#[derive(Serialize)]
enum Pattern {
    String(&'static str),
}

#[derive(Serialize)]
struct Template {
    r#type: &'static str,
    single: Vec<Piece>,
    pair: Vec<Piece>,
    special_tokens: BTreeMap<&'static str, SpecialPiece>,
}

#[derive(Serialize, Clone, Copy)]
enum Piece {
    SpecialToken { id: &'static str, type_id: u32 },
    Sequence { id: &'static str, type_id: u32 },
}

#[derive(Serialize)]
struct SpecialPiece {
    id: &'static str,
    ids: [u32; 1],
    tokens: [&'static str; 1],
}

#[derive(Serialize)]
struct Decoder {
    r#type: &'static str,
    kinelm: Own,
}

#[derive(Serialize)]
struct Model<'a> {
    r#type: &'static str,
    #[serde(serialize_with = "by_id")]
    vocab: &'a Vocabulary,
    unk_token: &'static str,
    /// Both sides of each pair, with a space between them.
    merges: Vec<String>,
}

fn by_id<S: Serializer>(vocabulary: &&Vocabulary, s: S) -> std::result::Result<S::Ok, S::Error> {
    let mut map = s.serialize_map(Some(vocabulary.len() as usize))?;
    for (id, token) in vocabulary.iter() {
        map.serialize_entry(&token, &id)?;
    }
    map.end()
}

impl Tokenizer {
    /// The text of `tokenizer.json`.
    pub fn to_json(&self) -> String {
        self.render().0
    }

    /// SHA-256 of the file's bytes, with zeros in place of the hash's own 64 digits. Tokenizers with equal hashes encode
    /// equally.
    pub fn hash(&self) -> String {
        self.render().1
    }

    /// The hash of the tokenizer without its conditioning tokens: tokenizers with equal base hashes encode motion equally,
    /// whatever labels they have.
    pub fn base_hash(&self) -> String {
        if self.vocabulary.conditioning().is_empty() {
            return self.hash();
        }
        let mut base = self.clone();
        base.vocabulary.clear_conditioning();
        base.hash()
    }

    fn render(&self) -> (String, String) {
        // the hash can't cover its own digits, so zeros of the same length stand in for them
        let blank = serde_json::to_string_pretty(&self.whole()).expect("plain data with text keys is JSON") + "\n";
        let hash = hex_sha256(blank.as_bytes());
        (blank.replacen(NO_HASH, &hash, 1), hash)
    }

    fn whole(&self) -> Whole<'_> {
        let token = |id: u32| self.vocabulary.token(id).unwrap_or_default();
        let merges = self.vocabulary.merges().iter().map(|&(a, b)| format!("{} {}", token(a), token(b)));
        let is_added = |id: u32| id < Special::ALL.len() as u32 || id >= self.vocabulary.first_conditioning();
        let added = self.vocabulary.iter().filter(|&(id, _)| is_added(id)).map(|(id, content)| AddedToken {
            id,
            content,
            single_word: false,
            lstrip: false,
            rstrip: false,
            normalized: false,
            special: true,
        });
        let bos = Special::Bos.token();
        let front = Piece::SpecialToken { id: bos, type_id: 0 };
        let text = |id, type_id| Piece::Sequence { id, type_id };
        Whole {
            version: "1.0",
            truncation: (),
            padding: (),
            added_tokens: added.collect(),
            normalizer: (),
            pre_tokenizer: Split {
                r#type: "Split",
                pattern: Pattern::String(" "),
                behavior: "Isolated",
                invert: false,
            },
            post_processor: Template {
                r#type: "TemplateProcessing",
                single: vec![front, text("A", 0)],
                pair: vec![front, text("A", 0), text("B", 1)],
                special_tokens: [(bos, SpecialPiece { id: bos, ids: [Special::Bos.id()], tokens: [bos] })].into(),
            },
            decoder: Decoder {
                r#type: "Fuse",
                kinelm: Own {
                    version: FORMAT_VERSION,
                    sha256: NO_HASH.into(),
                    config: self.config.clone(),
                    fitted: self.fitted.clone(),
                    merges: self.vocabulary.merges().to_vec(),
                    longest_word: self.longest_word,
                    conditioning: self.vocabulary.conditioning().to_vec(),
                    mean_pose: uncoded(&self.config).map(|j| self.mean_pose[j].to_array()).collect(),
                    height_range: self.height_range,
                },
            },
            model: Model {
                r#type: "BPE",
                vocab: &self.vocabulary,
                unk_token: Special::Unk.token(),
                merges: merges.collect(),
            },
        }
    }

    /// Writes `tokenizer.json`, whole or not at all.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`] with the file.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        Ok(kinelm_store::files::write_whole(path.as_ref(), self.to_json().as_bytes())?)
    }

    /// Reads a `tokenizer.json`.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`Error::File`] for another kind of file, another version, or a file that was changed
    /// after it was written.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let mut text = String::new();
        let file = kinelm_store::input::open(path).map_err(Error::io(path))?;
        let wrong = |what| Error::File { path: path.to_owned(), what };
        // one byte more than allowed distinguishes a file at the limit from a longer one
        file.take(MAX_FILE_BYTES + 1).read_to_string(&mut text).map_err(|e| match e.kind() {
            std::io::ErrorKind::InvalidData => {
                wrong("bytes that are no UTF-8; expected a tokenizer.json of kinelm".into())
            }
            _ => Error::io(path)(e),
        })?;
        if text.len() as u64 > MAX_FILE_BYTES {
            return Err(wrong(format!("more than {MAX_FILE_BYTES} bytes; expected a tokenizer.json of kinelm")));
        }
        Tokenizer::from_json(&text).map_err(|e| match e {
            Error::File { what, .. } => wrong(what),
            other => wrong(other.to_string()),
        })
    }

    /// The tokenizer of a `tokenizer.json`'s text.
    ///
    /// # Errors
    /// [`Error::File`], with an empty path, for another kind of text, another version, or text that was changed after it was
    /// written.
    pub fn from_json(text: &str) -> Result<Self> {
        let wrong = |what: String| Error::File { path: Default::default(), what };
        let whole: Value = serde_json::from_str(text).map_err(|e| {
            wrong(format!("no JSON ({e}); expected the tokenizer.json that `kinelm tokenizer fit` writes"))
        })?;
        let Some(own) = whole.get("decoder").and_then(|d| d.get("kinelm")) else {
            return Err(wrong(
                "no part of kinelm's in it (decoder.kinelm); another program's tokenizer, or saved again by one; \
                 take the file that `kinelm tokenizer fit` wrote"
                    .into(),
            ));
        };
        match own.get("version") {
            Some(v) if v.as_u64() == Some(FORMAT_VERSION) => {}
            found => {
                let found = found.map_or("none".into(), Value::to_string);
                return Err(wrong(format!(
                    "version {found} of the tokenizer's format, expected {FORMAT_VERSION}; fit it again with this program"
                )));
            }
        }
        // after the version, since another version may hash differently, and before the tables are trusted
        check_hash(text, own.get("sha256").and_then(Value::as_str).unwrap_or("")).map_err(wrong)?;
        let own: Own = serde_json::from_value(own.clone()).map_err(|e| wrong(format!("decoder.kinelm: {e}")))?;
        let tokenizer = own.build().map_err(|e| wrong(format!("decoder.kinelm: {e}")))?;
        // a right hash doesn't prove that vocabulary and merges, which their loaders read, are those of our settings
        if tokenizer.to_json() != text {
            return Err(wrong("its vocabulary is not what its settings give; fit it again".into()));
        }
        Ok(tokenizer)
    }
}

impl Own {
    fn build(self) -> Result<Tokenizer> {
        self.config.validate()?;
        let fitted = self.fitted.with_config(&self.config.scheme, &self.config.channels())?;
        let mean_pose = mean_pose(&self.config, &self.mean_pose)?;
        let above_floor = self.config.above_floor();
        // NaN fails both comparisons
        let good = |[low, high]: [f64; 2]| low <= high && low.abs().max(high.abs()) < 1e7;
        if self.height_range.is_some() != above_floor || !self.height_range.is_none_or(good) {
            let expected =
                if above_floor { "the least and the greatest height" } else { "none: heights have no floor" };
            let found = format!("{:?}", self.height_range);
            return Err(Error::setting("height_range", found, expected));
        }
        let (longest, heights) = (self.longest_word, self.height_range);
        let mut tokenizer = Tokenizer::new(self.config, fitted, &self.merges, longest, mean_pose, heights)?;
        for token in &self.conditioning {
            let inner = token.strip_prefix('<').and_then(|t| t.strip_suffix('>')).and_then(|t| t.split_once(':'));
            let (field, value) = inner.unwrap_or((token, ""));
            tokenizer.vocabulary.add_conditioning(field, value)?;
        }
        Ok(tokenizer)
    }
}

/// The uncoded joints, ascending.
fn uncoded(config: &TokenizerConfig) -> impl Iterator<Item = usize> + '_ {
    (0..24).filter(|j| !config.joints.contains(j))
}

/// The pose (24) with the rotations of a file.
fn mean_pose(config: &TokenizerConfig, rotations: &[[f64; 4]]) -> Result<[Quat; 24]> {
    let mut pose = [Quat::IDENTITY; 24];
    let joints: Vec<usize> = uncoded(config).collect();
    let unit = |q: &[f64; 4]| (Quat::from_array(*q).length_squared() - 1.0).abs() < 1e-9;
    if rotations.len() != joints.len() || !rotations.iter().all(unit) {
        return Err(Error::setting(
            "mean_pose",
            format!("{} rotations, {} of them unit", rotations.len(), rotations.iter().filter(|q| unit(q)).count()),
            format!("{} unit quaternions, of the uncoded joints", joints.len()),
        ));
    }
    joints.into_iter().zip(rotations).for_each(|(j, q)| pose[j] = Quat::from_array(*q));
    Ok(pose)
}

fn check_hash(text: &str, found: &str) -> std::result::Result<(), String> {
    if found.len() != NO_HASH.len() || !found.bytes().all(|b| b.is_ascii_hexdigit()) {
        return Err(format!("its sha256 is {found:?}, expected 64 hexadecimal digits; fit it again"));
    }
    let contents = hex_sha256(text.replacen(found, NO_HASH, 1).as_bytes());
    if contents != found {
        return Err(format!(
            "its contents have the SHA-256 {contents}, it says {found}: changed since it was written; \
             take the original, or fit it again"
        ));
    }
    Ok(())
}

fn hex_sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::{bent, small};
    use crate::{DctConfig, Height, LappedConfig, QuantileConfig, SchemeConfig, UniformConfig};

    #[test]
    fn save_and_load() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("tokenizer.json");
        let mut t = Tokenizer::fit([&bent(1, 50)], TokenizerConfig::default()).unwrap();
        let plain = t.hash();
        t.vocabulary_mut().add_conditioning("genre", "salsa").unwrap();
        t.vocabulary_mut().add_conditioning("music", "a: \"b\" \\ é").unwrap();
        assert_ne!(t.hash(), plain);
        assert_eq!(t.base_hash(), plain);
        t.save(&path).unwrap();
        let back = Tokenizer::load(&path).unwrap();
        assert_eq!(back, t);
        assert_eq!(back.hash(), t.hash());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        assert!(Tokenizer::load(dir.path().join("none.json")).unwrap_err().to_string().contains("none.json"));
        assert!(t.save(path.join("t.json")).is_err(), "a file is no folder");
    }

    #[test]
    fn the_largest_tokenizer_is_read_back() {
        let config = TokenizerConfig::uniform(&(0..24).collect::<Vec<_>>(), 20.0, crate::alphabet::SIZE);
        let t = Tokenizer::fit([&bent(1, 20)], config).unwrap();
        let text = t.to_json();
        assert!((text.len() as u64) < MAX_FILE_BYTES / 10, "{} bytes", text.len());
        assert_eq!(Tokenizer::from_json(&text).unwrap(), t);
    }

    #[test]
    fn the_mean_pose_is_stored() {
        let clip = bent(1, 40);
        let t = Tokenizer::fit([&clip], TokenizerConfig::uniform(&[0, 4], 20.0, 60)).unwrap();
        let pose = t.mean_pose();
        assert_eq!((pose[0], pose[4]), (Quat::IDENTITY, Quat::IDENTITY), "coded");
        let off = |f: usize| kinelm_motion::rotation::angle_between(clip.pose(f)[16], pose[16]);
        let far: Vec<f64> = (0..40).map(off).collect();
        assert!(far.iter().all(|a| *a < 2.5) && far.iter().sum::<f64>() / 40.0 < 1.2, "{far:?}");
        let back = Tokenizer::from_json(&t.to_json()).unwrap();
        assert_eq!(back, t);
        let words = t.encode(&clip).unwrap().words;
        let decoded = back.decode(&words, back.uncoded_pose()).unwrap();
        assert_eq!((decoded.pose(3)[16], decoded.pose(39)[9]), (pose[16], pose[9]));
        let all = TokenizerConfig { joints: (0..24).collect(), ..TokenizerConfig::default() };
        let all = Tokenizer::fit([&clip], all).unwrap();
        assert_eq!(Tokenizer::from_json(&all.to_json()).unwrap(), all);
    }

    #[test]
    fn heights_as_steps_or_in_the_world_have_no_range() {
        let velocity = Height::Velocity;
        let schemes = [
            SchemeConfig::Uniform(UniformConfig { bins: 60, height: velocity, ..Default::default() }),
            SchemeConfig::Quantile(QuantileConfig { bins: 60, height: velocity, ..Default::default() }),
            SchemeConfig::Dct(DctConfig { tile: 15, height: velocity, ..Default::default() }),
            SchemeConfig::Lapped(LappedConfig { hop: 8, height: Height::Absolute, ..Default::default() }),
        ];
        for scheme in schemes {
            let clip = bent(1, 60);
            let config = TokenizerConfig { scheme, ..TokenizerConfig::uniform(&[0, 4], 20.0, 60) };
            let tokenizer = Tokenizer::fit([&clip], config.clone()).unwrap();
            let text = tokenizer.to_json();
            assert!(text.contains("\"height\": ") && !text.contains("height_range"));
            let back = Tokenizer::from_json(&text).unwrap();
            assert_eq!((back.config(), back.height_range()), (&config, None));
            assert_eq!(back.encode(&clip).unwrap(), tokenizer.encode(&clip).unwrap());
        }
    }

    #[test]
    fn every_release_of_theirs_reads_the_form() {
        let merged = TokenizerConfig { merges: 20, ..TokenizerConfig::uniform(&[0, 4], 20.0, 60) };
        for (t, merges) in [(small(), false), (Tokenizer::fit([&bent(1, 60)], merged).unwrap(), true)] {
            let whole: Value = serde_json::from_str(&t.to_json()).unwrap();
            // tokenizers 1.0 splits at no regular expression
            assert_eq!(whole["pre_tokenizer"]["pattern"], serde_json::json!({ "String": " " }));
            assert_eq!(whole["model"]["type"], "BPE");
            // before 0.20 a pair was a text
            let pairs = whole["model"]["merges"].as_array().unwrap();
            assert_eq!(!pairs.is_empty(), merges);
            assert!(pairs.iter().all(|pair| pair.as_str().is_some_and(|p| p.matches(' ').count() == 1)), "{pairs:?}");
        }
    }

    #[test]
    fn what_is_not_ours_is_refused_with_a_reason() {
        let text = small().to_json();
        let error = |text: &str| Tokenizer::from_json(text).unwrap_err().to_string();
        assert!(error("").contains("no JSON"));
        assert!(error("{}").contains("no part of kinelm's"));
        assert!(
            error(&text.replace("\"kinelm\": {\n      \"version\": 4", "\"kinelm\": {\n      \"version\": 1"))
                .contains("version 1")
        );
        assert!(error(&text.replace("\"bins\": 60", "\"bins\": 61")).contains("changed since"));
        assert!(error(&text.replace("\"一\"", "\"二\"").replace("<bos>", "<b>")).contains("changed since"));
        assert!(error(&text.replace(&small().hash(), "12")).contains("64 hexadecimal"));
        assert!(error(&text[..text.len() / 2]).contains("no JSON"));
    }

    #[test]
    fn a_right_hash_alone_is_not_enough() {
        let forged = |from: &str, to: &str| {
            let (text, hash) = small().render();
            let blank = text.replace(&hash, NO_HASH).replace(from, to);
            let text = blank.replacen(NO_HASH, &hex_sha256(blank.as_bytes()), 1);
            Tokenizer::from_json(&text).unwrap_err().to_string()
        };
        assert!(forged("\"7\": 13", "\"7\": 14").contains("vocabulary"));
        assert!(forged("\"bins\": 60", "\"bins\": 0").contains("bins"));
        assert!(forged("\"fps\": 20.0", "\"fps\": -1.0").contains("fps"));
        assert!(forged("\"zero\": ", "\"zero\": 6").contains("zero"));
        assert!(forged("\"version\": 4", "\"version\": 2").contains("version 2"));
        let mean = format!("{:?}", small().mean_pose()[1].w);
        assert!(forged(&mean, "7.0").contains("mean_pose"));
        assert!(forged("\"conditioning\": []", "\"conditioning\": [\"<pad>\"]").contains("conditioning token"));
    }
}
