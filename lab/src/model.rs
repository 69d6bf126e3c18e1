//! Which model a bench is about.

use anyhow::Result;
use kinelm::model::config::SlotRun;
use kinelm::model::words::Steps;
use kinelm::model::{Architecture, HeadKind, TokenLayout};
use kinelm::tokenizer::SlotIds;
use kinelm::train::TrainFile;
use std::path::Path;

/// The id of the first bin.
const FIRST: u32 = 6;

/// Tokens of a word: of 13 joints, and of two levels of the 18 that the default has.
const WORD: usize = 43; // 3 of the root, 3 a joint, the space
const WIDE_WORD: usize = 58;

#[derive(Debug, clap::Args)]
pub struct ModelArgs {
    /// The model: that of the training settings tiny, small, thesis-26m, gpt2, demo, or of a TOML
    #[arg(long, default_value = "tiny", value_name = "NAME|FILE")]
    config: String,
    /// Tokens of a window; the configuration's if not given
    #[arg(long, value_name = "T")]
    context: Option<usize>,
    /// V: ids that the model knows
    #[arg(long, default_value_t = 400, value_name = "V", value_parser = clap::value_parser!(u32).range(7..=65_536))]
    vocabulary: u32,
    /// Share dropped in training, whatever the configuration says
    #[arg(long, default_value_t = 0.0, value_name = "P")]
    dropout: f64,
}

/// A model to measure.
#[derive(Debug)]
pub struct BenchModel {
    /// The configuration's name, or its file's.
    pub name: String,
    pub file: TrainFile,
    pub tokens: TokenLayout,
}

impl ModelArgs {
    /// The configuration with what the call changes in it.
    pub fn get(&self) -> Result<BenchModel> {
        let path = Path::new(&self.config);
        let mut file = TrainFile::find(path)?;
        let word = match file.model.architecture {
            Architecture::Flat => {
                file.model.context = self.context.unwrap_or(file.model.context);
                WORD
            }
            Architecture::TwoLevel => {
                file.model.window = self.context.map(|t| t / WIDE_WORD).or(file.model.window);
                WIDE_WORD
            }
        };
        file.model.dropout = self.dropout;
        // a word and the special ids as joints have them: a position, then angles, of the same bins
        let kind = |circular| SlotIds { first: FIRST, count: self.vocabulary - FIRST, circular };
        let places = [(3, false), (word - 4, true)].map(|(number, circular)| SlotRun { number, kind: kind(circular) });
        let tokens = TokenLayout {
            vocabulary: self.vocabulary as usize,
            word,
            varying: false,
            front: 1,
            pad: 0,
            bos: 1,
            space: 5,
            places: places.to_vec(),
        };
        file.model = file.model.resolved(&tokens);
        file.model.validate_for(&tokens)?;
        let name = path.file_stem().map_or(self.config.clone(), |s| s.to_string_lossy().into_owned());
        Ok(BenchModel { name, file, tokens })
    }
}

impl BenchModel {
    /// Numbers in the matrices that every token is multiplied with, the head among them: of several, the mean over a word's
    /// slots.
    pub fn matrices(&self) -> usize {
        let config = &self.file.model;
        let steps = Steps::of(&self.tokens.bins());
        let rows = |kind: SlotIds| if kind.circular { steps.circular } else { steps.up_and_down() };
        let head = match config.head_of(&self.tokens) {
            HeadKind::Absolute => self.tokens.vocabulary,
            // the space's is over all ids
            HeadKind::Relative => {
                (self.tokens.slot_ids().map(rows).sum::<usize>() + self.tokens.vocabulary) / self.tokens.word
            }
        };
        // a block's matrices: 4 D x D of attention, 8 of the feed-forward layers
        let blocks = |layers: usize, width: usize| 12 * layers * width * width;
        let stacks = blocks(config.layers, config.width);
        let before_head = match config.architecture {
            Architecture::Flat => stacks,
            Architecture::TwoLevel => {
                let decoder = config.decoder();
                let read = 2 * (self.tokens.word - 1) * decoder.character_width;
                let frame = stacks + (read + decoder.width) * config.width;
                frame / self.tokens.word + blocks(decoder.layers, decoder.width)
            }
        };
        before_head + head * config.head_width()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm::train::train_file::TRAIN;

    fn args(config: &str) -> ModelArgs {
        ModelArgs { config: config.into(), context: None, vocabulary: 400, dropout: 0.0 }
    }

    #[test]
    fn names_and_files_are_found_and_others_are_refused() {
        for (name, _) in TRAIN {
            assert_eq!(args(name).get().unwrap().name, *name);
        }
        let thesis = args("thesis-26m").get().unwrap();
        assert_eq!((thesis.file.model.width, thesis.file.model.dropout), (512, 0.0));
        assert_eq!(thesis.matrices(), 25_370_624);
        // (3 x 787 + 39 x 394 + 400) / 43 rows
        assert_eq!(args("tiny").get().unwrap().matrices(), 786_432 + 421 * 128);
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/train/small.toml");
        assert_eq!(args(folder.to_str().unwrap()).get().unwrap().name, "small");
        let refused = format!("{:#}", args("huge").get().unwrap_err());
        assert!(refused.contains("`config` \"huge\": no training file: neither a file nor one of tiny"), "{refused}");
        let short = ModelArgs { context: Some(20), ..args("tiny") };
        assert!(short.get().unwrap_err().to_string().contains("86 or more"));
    }
}
