//! A page with the words of a clip beside the body that they decode to.

use crate::Result;
use kinelm_tokenizer::meaning::{Legend, Meaning, Unit};
use kinelm_tokenizer::{SPACE, Tokenizer, WordLength, Words, alphabet};
use kinelm_view::panel::Panel;
use kinelm_view::words::{Sense, Senses, WordSeries, Words as WordsPanel};
use kinelm_view::{Figure, Page};
use std::collections::HashMap;

/// The page of words; uncoded joints have their mean pose. `title` names the clip.
///
/// # Errors
/// Those of decoding, for words of another tokenizer; a page of no words.
pub fn words_page(tokenizer: &Tokenizer, words: &Words, title: &str) -> Result<String> {
    let clip = tokenizer.decode(words, tokenizer.uncoded_pose())?;
    let figures = [Figure::new(title, &clip).note("as its words decode")];
    let panel = Panel::Words(panel(tokenizer, words)?);
    Ok(Page::new(&figures).panels(&[panel]).html()?)
}

/// The panel of the words of the page's first figure, a clip on SMPL's joints at the tokenizer's rate.
///
/// # Errors
/// As [`Tokenizer::text`].
pub fn panel(tokenizer: &Tokenizer, words: &Words) -> Result<WordsPanel> {
    let legend = tokenizer.legend();
    let shown =
        Shown { scales: legend.series.iter().map(|series| on_page(series.unit, tokenizer.fps())).collect(), legend };
    let series = shown.legend.series.iter().zip(&shown.scales);
    let series = series.map(|(series, (unit, _))| WordSeries {
        name: series.name.clone(),
        unit: (*unit).into(),
        joints: series.joints.clone(),
    });
    let senses = match tokenizer.word_length() {
        WordLength::Fixed(length) => shown.tables(tokenizer, length),
        WordLength::Varying { .. } => Senses::Each(words.iter().flat_map(|word| shown.each(tokenizer, word)).collect()),
    };
    Ok(WordsPanel {
        title: "Words".into(),
        figure: 0,
        word: shown.legend.word.into(),
        frames: (tokenizer.frames_per_word(), tokenizer.fps()),
        text: tokenizer.text(words)?,
        tokens: tokens(tokenizer, words)?,
        series: series.collect(),
        numbers: shown.legend.numbers.iter().map(|number| (number.series, number.coefficient)).collect(),
        senses,
    })
}

/// A legend, with each series' unit on the page and how many of these its own unit is.
struct Shown {
    legend: Legend,
    scales: Vec<(&'static str, f64)>,
}

fn on_page(unit: Unit, fps: f64) -> (&'static str, f64) {
    match unit {
        Unit::Radians => ("°", 1f64.to_degrees()),
        Unit::Metres => ("cm", 100.0),
        Unit::RadiansPerFrame => ("°/s", fps * 1f64.to_degrees()),
        Unit::MetresPerFrame => ("cm/s", fps * 100.0),
    }
}

impl Shown {
    fn scaled(&self, number: usize, value: f64) -> f32 {
        (value * self.scales[self.legend.numbers[number].series].1) as f32
    }

    /// What each character of a word stands for.
    fn each(&self, tokenizer: &Tokenizer, word: &[u16]) -> Vec<Sense> {
        let sense = |meaning| match meaning {
            Meaning::Value { number, value } => Sense::Value(self.scaled(number, value)),
            Meaning::Digit { .. } => Sense::Part,
            Meaning::Zeros(range) => Sense::Zeros(range.len() as u16),
            // the page sees that the word has no more numbers
            Meaning::Nothing => Sense::Zeros(1),
        };
        tokenizer.meanings(word).into_iter().map(sense).collect()
    }

    /// The tables of words of one length, whose n-th characters are their n-th numbers; equal tables once.
    fn tables(&self, tokenizer: &Tokenizer, length: usize) -> Senses {
        let codes = 0..tokenizer.vocabulary().characters();
        let mut columns = vec![Vec::with_capacity(codes.len()); length];
        for code in codes.clone() {
            for meaning in tokenizer.meanings(&vec![code as u16; length]) {
                if let Meaning::Value { number, value } = meaning {
                    columns[number].push(self.scaled(number, value));
                }
            }
        }
        let (mut tables, mut known) = (Vec::new(), HashMap::new());
        let mut of_numbers = Vec::with_capacity(length);
        for column in columns {
            let bits: Vec<u32> = column.iter().map(|x: &f32| x.to_bits()).collect();
            of_numbers.push(*known.entry(bits).or_insert(tables.len()));
            if of_numbers.last() == Some(&tables.len()) {
                tables.push(column);
            }
        }
        Senses::Tables { characters: codes.filter_map(alphabet::character).collect(), of_numbers, tables }
    }
}

/// The characters of each token; none without merges.
fn tokens(tokenizer: &Tokenizer, words: &Words) -> Result<Vec<u16>> {
    let vocabulary = tokenizer.vocabulary();
    if vocabulary.merged() == 0 {
        return Ok(Vec::new());
    }
    let ids = tokenizer.ids_of_words(words)?;
    Ok(ids.into_iter().filter(|id| *id != SPACE).map(|id| vocabulary.length_of_id(id) as u16).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::{Clip, synth};
    use kinelm_tokenizer::{DctConfig, SchemeConfig, TokenizerConfig};

    fn dance() -> Clip {
        synth::corpus(3, 1, 6.0, 20.0).unwrap().remove(0).clip
    }

    #[test]
    fn a_frames_table_has_degrees_and_merged_tokens_all_their_characters() {
        let clip = dance();
        let config = TokenizerConfig { merges: 40, ..TokenizerConfig::uniform(&[0, 4], 20.0, 90) };
        let tokenizer = Tokenizer::fit([&clip], config).unwrap();
        let words = tokenizer.encode(&clip).unwrap().words;
        let panel = panel(&tokenizer, &words).unwrap();
        let Senses::Tables { characters, of_numbers, tables } = &panel.senses else { panic!("tables") };
        // three of the root's coordinates, one of all angles
        assert_eq!((characters.chars().count(), of_numbers.len(), tables.len()), (90, 9, 4));
        let knee = &tables[of_numbers[panel.series.iter().position(|s| s.name == "left_knee x").unwrap()]];
        assert!((knee[45], knee[46] - 4.0) == (0.0, 0.0), "{knee:?}");
        assert_eq!(panel.tokens.iter().map(|&n| usize::from(n)).sum::<usize>(), words.codes().len());
        assert!(panel.tokens.iter().any(|&n| n > 1));
        let page = words_page(&tokenizer, &words, "a dance").unwrap();
        assert!(page.contains("class WordsPanel") && page.contains("a dance"));
    }

    #[test]
    fn a_tiles_characters_take_as_many_numbers_as_it_has() {
        let clip = dance();
        let scheme = SchemeConfig::Dct(DctConfig { tile: 30, ..DctConfig::default() });
        let config = TokenizerConfig { scheme, ..TokenizerConfig::uniform(&[0, 4, 16], 20.0, 90) };
        let tokenizer = Tokenizer::fit([&clip], config).unwrap();
        let words = tokenizer.encode(&clip).unwrap().words;
        let panel = panel(&tokenizer, &words).unwrap();
        let Senses::Each(all) = &panel.senses else { panic!("one each") };
        assert_eq!((all.len(), panel.numbers.len(), panel.frames.0), (words.codes().len(), 12 * 30, 30));
        let moves = |sense: &Sense| if let Sense::Zeros(n) = sense { usize::from(*n) } else { 1 };
        let mut rest = &all[..];
        for word in words.iter() {
            let (own, others) = rest.split_at(word.len());
            assert!(own.iter().map(moves).sum::<usize>() <= panel.numbers.len());
            assert!(own.iter().any(|sense| matches!(sense, Sense::Zeros(_))));
            rest = others;
        }
    }
}
