//! Settings that are compiled in, by the names of their files in `configs/`.
//!
//! A name that is built in means that; a file of the same name is meant by `./NAME`.

use crate::{Error, Result};
use kinelm_baselines::aclstm::config::ACLSTM;
use kinelm_baselines::music_lstm::config::MUSIC_LSTM;
use kinelm_corpus::settings::TOKENIZER;
use kinelm_store::presets::Presets;
use kinelm_store::suggest::did_you_mean;
pub use kinelm_train::train_file::TRAIN;

/// All of them, by the folder that a name may be given with.
const KINDS: [(&str, &Presets); 4] =
    [("train", TRAIN), ("tokenizer", TOKENIZER), ("aclstm", ACLSTM), ("music-lstm", MUSIC_LSTM)];

/// The names of [`text_of`]: `tiny` of training files, `tokenizer/uniform` of the others.
pub fn names() -> Vec<String> {
    let of = |(kind, presets): &(&str, &Presets)| {
        let prefix = if *kind == "train" { String::new() } else { format!("{kind}/") };
        presets.iter().map(|(name, _)| format!("{prefix}{name}")).collect::<Vec<_>>()
    };
    KINDS.iter().flat_map(of).collect()
}

/// The text of settings that are built in, by one of [`names`], or by a name that only one kind has.
///
/// # Errors
/// There are none of that name; the message lists the names.
pub fn text_of(name: &str) -> Result<&'static str> {
    let (folder, bare) = name.split_once('/').map_or((None, name), |(folder, bare)| (Some(folder), bare));
    let has = |presets: &'static Presets| presets.iter().find(|(n, _)| *n == bare).map(|(_, text)| *text);
    let mut found = KINDS.iter().filter(|(kind, _)| folder.is_none_or(|f| f == *kind)).filter_map(|(_, all)| has(all));
    found.next().ok_or_else(|| {
        let names = names();
        let meant = did_you_mean(name, names.iter().map(String::as_str));
        Error::invalid_parameter("name", format!("{name:?}"), format!("one of {}{meant}", names.join(", ")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::corpus::Settings;
    use crate::train::TrainFile;
    use std::path::Path;

    #[test]
    fn every_name_is_found_and_a_file_by_its_path() {
        for (name, _) in TRAIN {
            TrainFile::find(Path::new(name)).unwrap();
        }
        for (name, _) in TOKENIZER {
            Settings::find(Path::new(name)).unwrap().config().unwrap();
        }
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("tiny");
        std::fs::write(&file, "[train]\nsteps = 7\n").unwrap();
        assert_eq!(TrainFile::find(&file).unwrap().train.steps, 7);
        let message = TrainFile::find(Path::new("smal")).unwrap_err().to_string();
        let expected = "`config` \"smal\": no training file: neither a file nor one of tiny, small, two-level, thesis-26m, gpt2, finetune, goal, \
                        tune, labels, demo, demo-music; did you mean small?";
        assert_eq!(message, expected);
        let message = Settings::find(Path::new("no/such.toml")).unwrap_err().to_string();
        assert!(message.contains("neither a file nor one of uniform") && !message.contains("did you"), "{message}");
        for name in names() {
            toml::from_str::<toml::Table>(text_of(&name).unwrap()).unwrap();
        }
        assert_eq!(text_of("small").unwrap(), text_of("train/small").unwrap(), "of several a training file is meant");
        assert_ne!(text_of("small").unwrap(), text_of("music-lstm/small").unwrap());
        assert_eq!(text_of("lapped").unwrap(), text_of("tokenizer/lapped").unwrap());
        assert!(text_of("tinny").unwrap_err().to_string().ends_with("did you mean tiny?"));
    }

    #[test]
    fn every_file_of_the_folders_is_built_in() {
        for (folder, presets) in
            [("train", TRAIN), ("aclstm", ACLSTM), ("music_lstm", MUSIC_LSTM), ("tokenizer", TOKENIZER)]
        {
            let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs").join(folder);
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                let name = path.file_stem().unwrap().to_string_lossy().into_owned();
                // lists of rows, `--schemes`
                assert!(name.starts_with("study") || presets.iter().any(|(n, _)| *n == name), "{name}");
            }
        }
    }
}
