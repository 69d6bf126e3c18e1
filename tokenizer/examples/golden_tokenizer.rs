//! Prints the small tokenizer that `scripts/reference/tokenizer_ids.py` gives to Python's libraries.

use kinelm_motion::{Clip, Quat, Vec3, smpl};
use kinelm_tokenizer::{Tokenizer, TokenizerConfig};

/// Pelvis and left knee in 80 bins (62 letters and digits, 18 ideographs), two conditioning tokens. Made of sums and
/// quotients only, so that it is the same on every machine.
pub fn golden() -> Tokenizer {
    let root = (0..5).map(|f| Vec3::new(0.125, 1.0, 0.25 * f64::from(f))).collect();
    let clip = Clip::new(smpl::neutral(), 20.0, root, vec![Quat::IDENTITY; 5 * 24]).expect("finite");
    let mut tokenizer = Tokenizer::fit([&clip], TokenizerConfig::uniform(&[0, 4], 20.0, 80)).expect("valid settings");
    for (field, value) in [("genre", "salsa"), ("dancer", "two words: 61")] {
        tokenizer.vocabulary_mut().add_conditioning(field, value).expect("a good label");
    }
    tokenizer
}

#[allow(dead_code, reason = "the test takes `golden` alone")]
fn main() {
    print!("{}", golden().to_json());
}
