use super::*;
use kinelm_classify::metrics::wilson;
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::{Motion, synth};
use std::path::{Path, PathBuf};

/// Folders of made-up dances with these names of files, at rates and lengths of their own.
fn folders(dir: &Path, all: &[(&str, &[&str])]) -> Vec<PathBuf> {
    let made = all.iter().enumerate().map(|(k, (folder, names))| {
        let folder = dir.join(folder);
        std::fs::create_dir(&folder).unwrap();
        let dances = synth::corpus(7 + k as u64, names.len(), 3.0 + k as f64, [60.0, 25.0, 40.0][k]).unwrap();
        for (name, dance) in names.iter().zip(dances) {
            let path = folder.join(name).with_extension("bvh");
            format::write(&path, &Motion::new(&path, dance.clip)).unwrap();
        }
        folder
    });
    made.collect()
}

fn options(ask: Ask, folders: Vec<PathBuf>) -> StudyOptions {
    StudyOptions { ask, folders, pairs: 20, seconds: 2.0, seed: 5, read: ReadOptions::default() }
}

#[test]
fn a_page_has_no_trace_of_where_its_clips_are_from() {
    let dir = tempfile::tempdir().unwrap();
    let names: &[&str] = &["quokka-walk", "wombat-salsa", "numbat-waltz", "dingo-samba"];
    let folders = folders(dir.path(), &[("recorded-zone", names), ("generated-zone", names)]);
    let study = Study::make(&options(Ask::Real, folders.clone())).unwrap();
    let words =
        names.iter().flat_map(|name| name.split('-')).chain(["recorded-", "generated", "zone", ".bvh", ".key.json"]);
    for word in words.chain(dir.path().to_str()) {
        assert!(!study.page.contains(word), "{word}");
    }
    let key = &study.key;
    assert_eq!((key.trials.len(), key.fps, key.seconds), (4, 25.0, 2.0));
    // one rate, length, body and place for all
    for part in ["\"fps\":25.0", "\"frames\":50", "\"title\":\"1\"", "\"title\":\"2\"", "\"note\":\"\""] {
        let all = if part.contains("title") { 4 } else { 8 };
        assert_eq!(study.page.matches(part).count(), all, "{part}");
    }
    assert!(study.page.contains(&key.page) && key.page.len() == 64);
    for Trial { left, right, x } in &key.trials {
        assert_eq!((left.folder + right.folder, x), (1, &None));
        assert_eq!(left.clip.file_name(), right.clip.file_name(), "clips of one name belong together");
        assert!(left.clip.starts_with(&folders[left.folder]) && right.clip.starts_with(&folders[right.folder]));
    }
    assert_eq!(key.trials.iter().filter(|trial| trial.left.folder == 0).count(), 2, "each side as often");
    assert_eq!(Study::make(&options(Ask::Real, folders.clone())).unwrap(), study, "the same bytes");
    let other = Study::make(&StudyOptions { seed: 6, ..options(Ask::Real, folders.clone()) }).unwrap().key;
    assert!(other.trials != key.trials && other.page != key.page);
    assert_eq!(Study::make(&StudyOptions { pairs: 3, ..options(Ask::Better, folders) }).unwrap().key.trials.len(), 3);
}

#[test]
fn clips_without_common_names_are_paired_by_chance_or_refused() {
    let dir = tempfile::tempdir().unwrap();
    let folders = folders(dir.path(), &[("a", &["k", "l", "m"]), ("b", &["n", "o"]), ("c", &["k", "n"])]);
    let pairs = Study::make(&options(Ask::Better, folders[..2].to_vec())).unwrap().key.trials;
    let mut clips: Vec<_> = pairs.iter().flat_map(|trial| [&trial.left.clip, &trial.right.clip]).collect();
    clips.sort();
    clips.dedup();
    assert_eq!((pairs.len(), clips.len()), (2, 4), "each clip once");
    let said = |ask, folders: &[PathBuf]| Study::make(&options(ask, folders.to_vec())).unwrap_err().to_string();
    assert!(said(Ask::Blend, &folders).contains("no clips of one name"));
    assert!(said(Ask::Alike, &folders[..2]).contains("three, A, B and C"));
    assert!(said(Ask::Real, &folders).contains("two, A and B"));
    let short = StudyOptions { seconds: 0.1, ..options(Ask::Real, folders[..2].to_vec()) };
    assert!(Study::make(&short).unwrap_err().to_string().contains("at least 0.5 s"));
}

#[test]
fn a_blend_stands_between_its_clips_and_its_votes_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let names: &[&str] = &["k", "l", "m"];
    let folders = folders(dir.path(), &[("a", names), ("b", names), ("c", names)]);
    let Study { page, key } = Study::make(&options(Ask::Blend, folders.clone())).unwrap();
    assert_eq!(page.matches("\"title\":\"X\"").count(), 3);
    assert!(key.trials.iter().all(|trial| trial.x.as_ref().unwrap().starts_with(&folders[2])));
    // all choose the clip of A, and one of them in one trial as much of both
    let choice = |trial: usize| if key.trials[trial].left.folder == 0 { 0 } else { 2 };
    let file = |voter: &str, middle: Option<usize>| {
        let one =
            |trial| votes::Vote { trial, choice: if middle == Some(trial) { 1 } else { choice(trial) }, seconds: 1.0 };
        let votes = Votes { schema: 1, page: key.page.clone(), voter: voter.into(), votes: (0..3).map(one).collect() };
        let path = dir.path().join(voter).with_extension("json");
        std::fs::write(&path, serde_json::to_string(&votes).unwrap()).unwrap();
        path
    };
    let paths = [file("ann", None), file("bob", Some(1))];
    let load = |path: &PathBuf| Votes::load(path, &key);
    let files: Vec<_> = paths.iter().map(|path| (&**path, load(path).unwrap())).collect();
    let count = Count::of(&key, &files).unwrap();
    assert_eq!((count.voters, count.votes), (2, 6));
    let votes: Vec<usize> = count.shares.iter().map(|share| share.votes).collect();
    assert_eq!((votes, &count.trials[1]), (vec![5, 0, 1], &vec![1, 0, 1]));
    assert_eq!(count.shares[0].interval, wilson(5, 6));
    assert!(count.to_string().contains("5 votes, 83 % (95 % interval 44 to 97)"), "{count}");
    let twice = [files[0].clone(), files[0].clone()];
    assert!(Count::of(&key, &twice).unwrap_err().to_string().contains("the voter ann, who is in"));
    // of another page, and of trials and answers that there are none of
    let changed = |from: &str, to: &str| {
        let text = std::fs::read_to_string(&paths[0]).unwrap().replacen(from, to, 1);
        let path = dir.path().join("changed.json");
        std::fs::write(&path, text).unwrap();
        load(&path).unwrap_err().to_string()
    };
    let said = changed(&key.page, &"0".repeat(64));
    assert!(said.contains("changed.json") && said.contains("votes of another page, 000"), "{said}");
    assert!(changed("\"trial\":0", "\"trial\":3").contains("trial 3"));
    assert!(changed("\"trial\":1", "\"trial\":0").contains("at most once"));
    assert!(changed("\"choice\":0", "\"choice\":3").contains("answer 3"));
    assert!(changed("{", "[").contains("votes that a page saved"));
}

#[test]
fn a_key_is_read_as_it_was_written() {
    let source = |folder| Source { folder, clip: "a.bvh".into() };
    let trial = Trial { left: source(1), right: source(0), x: None };
    let key = Key {
        schema: 1,
        ask: Ask::Better,
        page: "ab".into(),
        seed: 3,
        seconds: 2.0,
        fps: 30.0,
        folders: vec!["a".into(), "b".into()],
        trials: vec![trial.clone()],
    };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("study.key.json");
    let load = |key: &Key| {
        std::fs::write(&path, serde_json::to_string(key).unwrap()).unwrap();
        Key::load(&path)
    };
    assert_eq!(load(&key).unwrap(), key);
    let twice = Trial { left: source(0), ..trial };
    for wrong in [Key { schema: 2, ..key.clone() }, Key { trials: vec![twice], ..key.clone() }] {
        assert!(load(&wrong).unwrap_err().to_string().contains("expected the key of a study"));
    }
}

/// Newcombe, "Two-sided confidence intervals for the single proportion" (1998), table I, method 3, and more digits of
/// scripts/reference/blind.py.
#[test]
fn intervals_are_wilsons() {
    for (votes, of, low, high) in [
        (81, 263, 0.2552885199, 0.366209577),
        (15, 148, 0.0623863995, 0.1604872417),
        (0, 20, 0.0, 0.1611251581),
        (1, 29, 0.0061132143, 0.1717552188),
        (29, 29, 0.8830302015, 1.0),
    ] {
        let found = wilson(votes, of);
        assert!((found[0] - low).abs() < 1e-9 && (found[1] - high).abs() < 1e-9, "{votes} of {of}: {found:?}");
    }
}

/// scripts/reference/blind.py, from pairs of raters.
#[test]
fn agreement_is_fleiss_kappa() {
    let table = [
        [0, 0, 0, 0, 14],
        [0, 2, 6, 4, 2],
        [0, 0, 3, 5, 6],
        [0, 3, 9, 2, 0],
        [2, 2, 8, 1, 1],
        [7, 7, 0, 0, 0],
        [3, 2, 6, 3, 0],
        [2, 5, 3, 2, 2],
        [6, 5, 2, 1, 0],
        [0, 2, 2, 3, 7],
    ];
    let kappa = |rows: &[&[usize]]| fleiss_kappa(&rows.iter().map(|row| row.to_vec()).collect::<Vec<_>>());
    let rows: Vec<&[usize]> = table.iter().map(|row| &row[..]).collect();
    assert!((kappa(&rows).unwrap() - 0.209930704422).abs() < 1e-11);
    assert!((kappa(&[&[3, 1], &[0, 5], &[2, 0], &[1, 0], &[2, 2]]).unwrap() - 0.4140625).abs() < 1e-12);
    assert_eq!(kappa(&[&[3, 0], &[0, 3]]), Some(1.0), "all agree");
    assert_eq!((kappa(&[&[3, 0], &[4, 0]]), kappa(&[&[1, 0], &[0, 1]]), kappa(&[])), (None, None, None));
}
