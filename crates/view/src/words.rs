//! Words beside the dancer that they decode to: a panel that names what each character stands for. It takes plain data
//! and knows no tokenizer.

use crate::data::base64;
use crate::{Error, Result};
use kinelm_motion::Clip;
use serde_json::{Value, json};

/// The words of a figure, from its first frame on.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Words {
    /// The title.
    pub title: String,
    /// The figure's index; joints are those of its clip.
    pub figure: usize,
    /// What a word is, such as `frame`.
    pub word: String,
    /// Frames of a word, and frames per second.
    pub frames: (usize, f64),
    /// The words, a space after each.
    pub text: String,
    /// The characters of each token, in the order of the text; empty when each character is one.
    pub tokens: Vec<u16>,
    /// The series that numbers belong to.
    pub series: Vec<WordSeries>,
    /// The numbers of a word in their order: the index of the series, and the coefficient if it is one.
    pub numbers: Vec<(usize, Option<usize>)>,
    /// What the characters stand for.
    pub senses: Senses,
}

/// A series of numbers over time.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WordSeries {
    /// Its name.
    pub name: String,
    /// The unit of its values.
    pub unit: String,
    /// The joints of the figure that it moves and their shares, 0 to 1.
    pub joints: Vec<(usize, f64)>,
}

/// What characters stand for.
#[derive(Debug, Clone, PartialEq)]
pub enum Senses {
    /// The n-th character of a word is its n-th number.
    Tables {
        /// The characters by their codes.
        characters: String,
        /// For each number the index of its table.
        of_numbers: Vec<usize>,
        /// Values by code.
        tables: Vec<Vec<f32>>,
    },
    /// One of each character of the text, spaces left out.
    Each(Vec<Sense>),
}

impl Default for Senses {
    fn default() -> Self {
        Senses::Each(Vec::new())
    }
}

/// What a character stands for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sense {
    /// The value of the word's next number.
    Value(f32),
    /// As many zeros, for the next numbers.
    Zeros(u16),
    /// A part of the next number, which a later character completes.
    Part,
}

impl Words {
    /// The JSON for the page's script.
    pub(crate) fn json(&self, clip: &Clip) -> Result<Value> {
        self.check(clip.joints())?;
        // four digits are enough for a label and half of the text
        let short = |x: f64| (x * 1e4).round() / 1e4;
        let series = |series: &WordSeries| {
            let joints: Vec<_> = series.joints.iter().map(|&(joint, share)| json!([joint, short(share)])).collect();
            json!({ "name": series.name, "unit": series.unit, "joints": joints })
        };
        let floats =
            |values: &mut dyn Iterator<Item = f32>| base64(&values.flat_map(f32::to_le_bytes).collect::<Vec<_>>());
        let shorts =
            |values: &mut dyn Iterator<Item = u16>| base64(&values.flat_map(u16::to_le_bytes).collect::<Vec<_>>());
        let senses = match &self.senses {
            Senses::Tables { characters, of_numbers, tables } => json!({ "characters": characters, "of": of_numbers,
                "tables": floats(&mut tables.iter().flatten().copied()), "size": tables.first().map_or(0, Vec::len) }),
            Senses::Each(all) => {
                let (moves, values): (Vec<u16>, Vec<f32>) = all.iter().map(|sense| sense.numbers()).unzip();
                json!({ "moves": shorts(&mut moves.into_iter()), "values": floats(&mut values.into_iter()) })
            }
        };
        let (frames, fps) = self.frames;
        Ok(json!({ "kind": "words", "title": self.title, "figure": self.figure, "word": self.word, "frames": frames,
            "fps": fps, "text": self.text, "tokens": shorts(&mut self.tokens.iter().copied()),
            "series": self.series.iter().map(series).collect::<Vec<_>>(), "numbers": self.numbers,
            "names": clip.skeleton().names(), "senses": senses }))
    }

    /// Refuses parts that don't belong together.
    fn check(&self, joints: usize) -> Result<()> {
        let characters = self.text.chars().filter(|c| *c != ' ').count();
        let tokens = self.tokens.iter().map(|&n| usize::from(n)).sum::<usize>();
        let senses = match &self.senses {
            Senses::Each(all) => all.len() == characters,
            Senses::Tables { characters, of_numbers, tables } => {
                let size = characters.chars().count();
                of_numbers.len() == self.numbers.len()
                    && of_numbers.iter().all(|&i| i < tables.len())
                    && tables.iter().all(|table| table.len() == size)
            }
        };
        let rate = self.frames.0 > 0 && self.frames.1.is_finite() && self.frames.1 > 0.0;
        let known = self.numbers.iter().all(|(series, _)| *series < self.series.len())
            && self.series.iter().flat_map(|series| &series.joints).all(|(joint, _)| *joint < joints);
        match senses && rate && known && (self.tokens.is_empty() || tokens == characters) {
            true => Ok(()),
            false => Err(Error::unsupported(
                format!("the panel {:?}", self.title),
                "words whose parts don't belong together; expected a sense for each character, known series and joints, \
                 and a rate above 0",
            )),
        }
    }
}

impl Sense {
    /// The numbers that it moves on in its word, and its value; NaN without one.
    fn numbers(self) -> (u16, f32) {
        match self {
            Sense::Value(value) => (1, value),
            Sense::Zeros(count) => (count, f32::NAN),
            Sense::Part => (0, f32::NAN),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panel::Panel;
    use crate::{Figure, Page};
    use kinelm_motion::synth;

    fn words() -> Words {
        let series = WordSeries { name: "left_knee x".into(), unit: "°".into(), joints: vec![(4, 1.0)] };
        let tables = vec![vec![-1.0, 2.0]];
        Words {
            title: "w".into(),
            word: "frame".into(),
            frames: (1, 20.0),
            text: "01 10 ".into(),
            series: vec![series],
            numbers: vec![(0, None), (0, None)],
            senses: Senses::Tables { characters: "01".into(), of_numbers: vec![0, 0], tables },
            ..Words::default()
        }
    }

    #[test]
    fn numbers_are_compact_and_come_with_the_script() {
        let clip = synth::corpus(1, 1, 1.0, 20.0).unwrap().remove(0).clip;
        let json = words().json(&clip).unwrap();
        // -1 and 2 as little-endian f32: 00 00 80 bf 00 00 00 40
        assert_eq!((&json["senses"]["tables"], &json["numbers"][1]), (&json!("AACAvwAAAEA="), &json!([0, null])));
        let each = vec![Sense::Value(2.0), Sense::Zeros(3), Sense::Part, Sense::Value(-1.0)];
        let json = Words { senses: Senses::Each(each), ..words() }.json(&clip).unwrap();
        assert_eq!(json["senses"]["moves"], "AQADAAAAAQA=");
        let figures = [Figure::new("a", &clip)];
        let html = |panels: &[Panel]| Page::new(&figures).panels(panels).html();
        let page = html(&[Panel::Words(words())]).unwrap();
        assert!(page.contains("class WordsPanel") && page.contains("function picked("));
        assert!(!html(&[]).unwrap().contains("function picked("));
    }

    #[test]
    fn parts_that_do_not_belong_together_are_refused() {
        let clip = synth::corpus(1, 1, 1.0, 20.0).unwrap().remove(0).clip;
        words().json(&clip).unwrap();
        let refused = |change: fn(&mut Words)| {
            let mut words = words();
            change(&mut words);
            words.json(&clip).is_err()
        };
        assert!(refused(|w| w.tokens = vec![2, 1]));
        assert!(refused(|w| w.senses = Senses::Each(vec![Sense::Part; 3])));
        assert!(refused(|w| w.series[0].joints = vec![(24, 1.0)]));
        assert!(refused(|w| w.numbers[1].0 = 1));
        assert!(refused(|w| w.frames = (0, 20.0)));
        assert!(refused(|w| w.frames = (1, f64::NAN)));
        assert!(Panel::Words(Words { figure: 1, ..words() }).json(&[Figure::new("a", &clip)]).is_err());
    }
}
