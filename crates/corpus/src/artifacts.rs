//! Folders that this program makes and goes on with: runs, corpora, indexes, classifiers. They are known by what is in them;
//! no clip is looked for there, and no output replaces a file of theirs.

use std::path::Path;

/// What such a folder is, what is in every one (a name that ends in `-` begins a longer one), and how the names of its files
/// begin.
type Kind = (&'static str, [&'static str; 2], &'static [&'static str]);

/// The name of a corpus folder.
pub const CORPUS: &str = "a corpus";

const KINDS: [Kind; 5] = [
    ("a run", ["config.toml", "checkpoints"], RUN),
    ("a classifier's training", ["call.json", "checkpoints"], RUN),
    (CORPUS, ["corpus.json", "clips.jsonl"], &["corpus.json", "clips.jsonl", "tokenizer.json", "tokens.", "music."]),
    ("an index", ["index.json", "part-0000"], &["index.json", "basis.json", "part-"]),
    ("a classifier", ["classifier.json", "tokenizer.json"], RUN),
];

/// Of all that trains.
const RUN: &[&str] = &[
    "config.toml",
    "call.json",
    "classifier.json",
    "tokenizer.json",
    "corpus",
    "metrics.jsonl",
    "model-",
    "latest",
    "best",
    ".lock",
    "checkpoints",
    "events.out.tfevents.",
];

fn find(folder: &Path) -> Option<&'static Kind> {
    KINDS.iter().find(|(_, all, _)| all.iter().all(|name| folder.join(name).exists()))
}

/// The kind of a folder, if it is one of ours.
pub(crate) fn kind(folder: &Path) -> Option<&'static str> {
    find(folder).map(|(kind, ..)| *kind)
}

/// The folder of ours that `path`, which has no links in it, is a file of, and what that folder is.
pub fn owner(path: &Path) -> Option<(&Path, &'static str)> {
    // the deepest is `checkpoints/step-00000001/state.json`
    path.ancestors().skip(1).take(3).find_map(|folder| {
        let (kind, _, parts) = find(folder)?;
        let first = path.strip_prefix(folder).ok()?.iter().next()?.to_str()?;
        parts.iter().any(|part| first.starts_with(part)).then_some((folder, *kind))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn folders_of_ours_are_known_by_their_files() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::create_dir_all(at("run/checkpoints/step-00000001")).unwrap();
        fs::create_dir_all(at("data")).unwrap();
        fs::write(at("data/config.toml"), "").unwrap();
        assert_eq!((kind(&at("run")), kind(&at("data"))), (None, None));
        fs::write(at("run/config.toml"), "").unwrap();
        assert_eq!((kind(&at("run")), kind(&at("data")), kind(dir.path())), (Some("a run"), None, None));
        let of = |name: &str| owner(&at(name)).map(|(folder, _)| folder.to_owned());
        for name in ["run/config.toml", "run/checkpoints/step-00000001/state.json", "run/corpus-2.json", "run/latest"] {
            assert_eq!(of(name), Some(at("run")), "{name}");
        }
        for name in ["run/dance.bvh", "run/notes.json", "data/config.toml", "config.toml"] {
            assert_eq!(of(name), None, "{name}");
        }
        for (folder, [a, b], parts) in KINDS {
            assert!([a, b].iter().all(|name| parts.iter().any(|part| name.starts_with(part))), "{folder}");
        }
    }
}
