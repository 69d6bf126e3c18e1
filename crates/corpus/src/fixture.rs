//! Small corpora for tests: words of six characters that a model can learn, and dances.

use crate::record::{BeatSource, ClipBeats};
use crate::samples::{clip, walk};
use crate::{Corpus, CorpusWriter, Split};
use kinelm_motion::{Clip, synth};
use kinelm_music::feature::CHANNELS;
use kinelm_store::random;
use kinelm_tokenizer::{RootRotation, Tokenizer, TokenizerConfig};
use rand_chacha::rand_core::RngCore;
use std::path::Path;

/// The token that ends a word.
const SPACE: u32 = 5;

/// A corpus in `dir` of clips of these numbers of frames. Characters walk by -1, 0 or 1 from frame to frame.
/// Their genres are a and b in turn, the dancer is 61.
pub fn corpus(dir: &Path, clips: &[(usize, Split)]) -> Corpus {
    let path = dir.join("corpus");
    let tokenizer = Tokenizer::fit([&walk(5)], TokenizerConfig::uniform(&[0], 20.0, 10)).unwrap();
    let mut writer = CorpusWriter::create(&path, &tokenizer, &["made".into()], None, false).unwrap();
    for (key, &(frames, split)) in clips.iter().enumerate() {
        let mut rng = random::stream(9, "fixture", key as u64, 0);
        let mut ids = Vec::new();
        let mut codes = [5u32; 6];
        for _ in 0..frames {
            for code in &mut codes {
                // 9, 10 or 11 more modulo 10: a step of -1, 0 or 1 without negative numbers
                *code = (*code + 9 + rng.next_u32() % 3) % 10;
                ids.push(6 + *code);
            }
            ids.push(SPACE);
        }
        let mut new = clip(&format!("clip{key}"), key, split, frames);
        new.record.labels.insert("genre".into(), ["a", "b"][key % 2].into());
        new.record.labels.insert("dancer".into(), "61".into());
        writer.push(new, &ids).unwrap();
    }
    writer.finish().unwrap();
    Corpus::open(&path).unwrap()
}

/// A tokenizer of the shape of the corpora's, for another rate.
pub fn foreign_tokenizer() -> Tokenizer {
    let walk = walk(5);
    let faster = Clip::new(walk.skeleton().clone(), 30.0, walk.root().to_vec(), walk.rotations().to_vec()).unwrap();
    Tokenizer::fit([&faster], TokenizerConfig::uniform(&[0], 30.0, 10)).unwrap()
}

/// A corpus in `dir` of dances of these numbers of frames, in words of any length: merged characters of two joints.
pub fn merged(dir: &Path, clips: &[(usize, Split)]) -> Corpus {
    let config = TokenizerConfig { merges: 60, ..TokenizerConfig::uniform(&[0, 4], 20.0, 20) };
    let corpus = danced(&dir.join("merged"), config, clips);
    assert_eq!(corpus.tokenizer().tokens_per_word(), None);
    corpus
}

/// The same in words of nine characters, the turn as steps: what goal conditioning needs.
pub fn turning(dir: &Path, clips: &[(usize, Split)]) -> Corpus {
    let config = TokenizerConfig::uniform(&[0, 4], 20.0, 20);
    danced(&dir.join("turning"), TokenizerConfig { root_rotation: RootRotation::HeadingDelta, ..config }, clips)
}

/// The same with the beats of the dances, and a sound; every third has no music.
pub fn with_music(dir: &Path, clips: &[(usize, Split)]) -> Corpus {
    let config = TokenizerConfig::uniform(&[0, 4], 20.0, 20);
    let has_music = |clip: usize| clip % 3 != 2;
    made(
        &dir.join("with_music"),
        TokenizerConfig { root_rotation: RootRotation::HeadingDelta, ..config },
        clips,
        &has_music,
    )
}

/// A corpus in the folder `path` of dances of these numbers of frames.
pub fn danced(path: &Path, config: TokenizerConfig, clips: &[(usize, Split)]) -> Corpus {
    made(path, config, clips, &|_| false)
}

fn made(path: &Path, config: TokenizerConfig, clips: &[(usize, Split)], has_music: &dyn Fn(usize) -> bool) -> Corpus {
    let all = synth::corpus(5, clips.len(), 10.0, 20.0).unwrap();
    let dances: Vec<_> = all.iter().map(|d| d.clip.clone()).collect();
    let tokenizer = Tokenizer::fit(&dances, config).unwrap();
    let mut writer = CorpusWriter::create(path, &tokenizer, &["made".into()], None, false).unwrap();
    for (key, (&(frames, split), dance)) in clips.iter().zip(&dances).enumerate() {
        let words = tokenizer.encode(&dance.slice(0..frames)).unwrap().words;
        let mut new = clip(&format!("clip{key}"), key, split, frames);
        let times_s = all[key].beats_s.clone();
        new.record.beats = has_music(key).then_some(ClipBeats { source: BeatSource::Music, times_s });
        if has_music(key) {
            // a clip's music goes on for one more second, 20 frames
            let rows = (0..frames + 20).flat_map(|row| (0..CHANNELS).map(move |c| row * (c + 1) % 17));
            new.music = rows.map(|x| x as f32).collect();
        }
        writer.push(new, &tokenizer.ids_of_words(&words).unwrap()).unwrap();
    }
    writer.finish().unwrap();
    Corpus::open(path).unwrap()
}
