//! Prints one of the small tokenizers that `scripts/reference/tokenizer_ids.py` gives to Python's libraries: `plain` or
//! `merged`.

use kinelm_motion::{Clip, Quat, Vec3, smpl};
use kinelm_tokenizer::{Tokenizer, TokenizerConfig};

/// Pelvis and left knee in 80 bins (62 letters and digits, 18 ideographs), two conditioning tokens, and as many merges as
/// are wanted. Made of sums, quotients and roots only, so that it is the same on every machine.
pub fn golden(merges: u32) -> Tokenizer {
    let root = (0..400).map(|f| Vec3::new(0.125, 1.0, 0.25 * f64::from(f % 5))).collect();
    let bend = |i: u32| Quat::from_xyzw(f64::from(i / 24 % 7) / 3.1, 0.0, f64::from(i % 3) / 4.3, 1.0).normalize();
    let clip = Clip::new(smpl::neutral(), 20.0, root, (0..400 * 24).map(bend).collect()).expect("finite");
    let config = TokenizerConfig { merges, ..TokenizerConfig::uniform(&[0, 4], 20.0, 80) };
    let mut tokenizer = Tokenizer::fit([&clip], config).expect("valid settings");
    for (field, value) in [("genre", "salsa"), ("dancer", "two words: 61")] {
        tokenizer.vocabulary_mut().add_conditioning(field, value).expect("a good label");
    }
    tokenizer
}

#[allow(dead_code, reason = "the test takes `golden` alone")]
fn main() {
    let merges = if std::env::args().nth(1).as_deref() == Some("merged") { 50 } else { 0 };
    print!("{}", golden(merges).to_json());
}
