//! The text of a clip: a tokenizer learned from made-up dances writes one of them down and reads it back.
//!
//!     cargo run -p kinelm-tokenizer --example text_of_a_clip

use kinelm_motion::joints::THIRTEEN;
use kinelm_motion::metric::GeodesicError;
use kinelm_motion::{Clip, synth};
use kinelm_tokenizer::{Tokenizer, TokenizerConfig, UncodedPose};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let dances: Vec<Clip> = synth::corpus(1, 8, 10.0, 20.0)?.into_iter().map(|dance| dance.clip).collect();
    // 18 joints, 20 frames a second, a turn in 360 bins
    let tokenizer = Tokenizer::fit(&dances, TokenizerConfig::uniform(&THIRTEEN, 20.0, 360))?;

    let words = tokenizer.encode(&dances[0])?.words;
    let text = tokenizer.text(&words)?;
    println!("{} frames are {} words of {} characters:", dances[0].frames(), words.len(), words.word(0).len());
    text.split(' ').take(3).for_each(|word| println!("    {word}"));

    let ids = tokenizer.ids_of_words(&words)?;
    println!("which are {} ids of {}: {:?} ..", ids.len(), tokenizer.vocabulary().len(), &ids[..6]);

    let read = tokenizer.words_of_text(&text)?;
    assert_eq!(read, words, "the text says it all");
    let back = tokenizer.decode(&read, UncodedPose::Identity)?;
    let mut error = GeodesicError::new(THIRTEEN.to_vec());
    error.add(&dances[0], &back)?;
    println!("back from the text, a joint is {:.2} degrees off on average", error.mean().to_degrees());
    Ok(())
}
