//! Splits by recording: all clips of a take serve one part of the experiment.

use super::item::Item;
use super::record::Split;
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, BTreeSet};

/// The split of a take by the hash of its name alone: 80 % train, 10 % valid, 10 % test. It stays when clips are added.
pub fn split_of_take(take: &str) -> Split {
    match hash_of_take(take) % 10 {
        0..=7 => Split::Train,
        8 => Split::Valid,
        _ => Split::Test,
    }
}

/// The first eight bytes of the SHA-256 of a take's name.
fn hash_of_take(take: &str) -> u64 {
    let hash = Sha256::digest(take.as_bytes());
    // in a fixed byte order, so that a take's split is the same on every machine
    u64::from_be_bytes(hash[..8].try_into().expect("SHA-256 has 32 bytes"))
}

/// Gives every item its split: the one stated for it, else the one stated for another clip of its take, else the hash's,
/// which leaves no split empty that it can fill ([`fill`]). `stated` stands beside `items`. Returns what a user should know:
/// takes stated in two splits, splits filled and splits without clips, labels that a split lacks.
pub(super) fn assign(items: &mut [Item], stated: &[Option<Split>]) -> Vec<String> {
    let mut of_take: BTreeMap<&str, BTreeSet<Split>> = BTreeMap::new();
    for (item, split) in items.iter().zip(stated) {
        if let Some(split) = split {
            of_take.entry(&item.take).or_default().insert(*split);
        }
    }
    let torn: Vec<&str> = of_take.iter().filter(|(_, s)| s.len() > 1).map(|(t, _)| *t).collect();
    let mut said = Vec::new();
    if !torn.is_empty() {
        said.push(format!("{} takes stand in two splits by the labels given: {}", torn.len(), abbreviated(&torn)));
    }
    let mut hashed: BTreeMap<&str, Split> = (items.iter().map(|i| i.take.as_str()))
        .filter(|take| !of_take.contains_key(take))
        .map(|take| (take, split_of_take(take)))
        .collect();
    said.extend(fill(&mut hashed, &of_take));
    let splits: Vec<Split> = (items.iter().zip(stated))
        .map(|(item, stated)| {
            let of_its_take = || of_take.get(item.take.as_str()).and_then(|s| s.first().copied());
            stated.or_else(of_its_take).unwrap_or_else(|| hashed[item.take.as_str()])
        })
        .collect();
    items.iter_mut().zip(splits).for_each(|(item, split)| item.split = split);
    said.extend(missing(items));
    said
}

/// Fills the splits that the hash left empty, test first, then valid, then train: with the take of the greatest hash, out
/// of train if that has one to spare, else out of any split that does. Of fewer than three takes none can be spared, and
/// takes whose split is stated stay. Returns the line that says so.
fn fill(hashed: &mut BTreeMap<&str, Split>, stated: &BTreeMap<&str, BTreeSet<Split>>) -> Option<String> {
    if hashed.len() + stated.len() < Split::ALL.len() {
        return None;
    }
    let mut takes: BTreeMap<Split, usize> = BTreeMap::new();
    for split in hashed.values().chain(stated.values().flatten()) {
        *takes.entry(*split).or_default() += 1;
    }
    let mut moved = Vec::new();
    for empty in [Split::Test, Split::Valid, Split::Train] {
        let spared = hashed.iter().filter(|(_, split)| !takes.contains_key(&empty) && takes[split] > 1);
        let Some((&take, &from)) = spared.max_by_key(|(take, split)| (**split == Split::Train, hash_of_take(take)))
        else {
            continue;
        };
        hashed.insert(take, empty);
        *takes.entry(from).or_default() -= 1;
        takes.insert(empty, 1);
        moved.push(format!("{take} is {empty}"));
    }
    let why = "the split by the hashes of so few takes left a part empty";
    (!moved.is_empty()).then(|| format!("{why}: {}", moved.join(", ")))
}

/// What can't be done without clips in a split.
fn cannot(split: Split) -> &'static str {
    match split {
        Split::Train => "nothing can be fitted or trained",
        Split::Valid => "training can't tell its best step, nor be measured on the way",
        Split::Test => "a model can't be measured on clips that nothing was chosen by",
    }
}

/// Splits without clips, and labels that some split lacks.
fn missing(items: &[Item]) -> Vec<String> {
    let present: BTreeSet<Split> = items.iter().map(|i| i.split).collect();
    let mut said: Vec<String> = (Split::ALL.into_iter().filter(|s| !present.contains(s)))
        .map(|s| format!("no clip is in the {s} split: {}", cannot(s)))
        .collect();
    let mut values: BTreeMap<&str, BTreeMap<&str, BTreeSet<Split>>> = BTreeMap::new();
    for item in items {
        for (field, value) in &item.labels {
            values.entry(field).or_default().entry(value).or_default().insert(item.split);
        }
    }
    for (field, values) in &values {
        for split in &present {
            let lacks: Vec<&str> = values.iter().filter(|(_, s)| !s.contains(split)).map(|(v, _)| *v).collect();
            if !lacks.is_empty() {
                let (n, of) = (lacks.len(), values.len());
                said.push(format!("{field}: {n} of {of} values have no clip in {split}: {}", abbreviated(&lacks)));
            }
        }
    }
    said
}

/// The first few names of many.
pub(super) fn abbreviated(names: &[&str]) -> String {
    const SHOWN: usize = 8;
    let shown = names[..names.len().min(SHOWN)].join(", ");
    if names.len() > SHOWN { format!("{shown}, and {} more", names.len() - SHOWN) } else { shown }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn item(name: &str, take: &str, genre: &str) -> Item {
        let labels = BTreeMap::from([("genre".to_string(), genre.to_string())]);
        Item { name: name.into(), take: take.into(), labels, ..Item::default() }
    }

    #[test]
    fn the_hash_holds_its_shares_and_its_values() {
        // first 8 bytes of SHA-256 mod 10, reckoned with Python's hashlib
        let expected = [Split::Train, Split::Valid, Split::Test, Split::Train]; // remainders 7, 8, 9, 1
        assert_eq!(["salsa-03", "salsa-05", "salsa-07", "salsa-09"].map(split_of_take), expected);
        let mut counts = BTreeMap::new();
        (0..10_000).for_each(|i| *counts.entry(split_of_take(&format!("take {i}"))).or_insert(0) += 1);
        // three standard deviations of a binomial: 120 and 90
        assert!((counts[&Split::Train] - 8000_i32).abs() < 120, "{counts:?}");
        assert!((counts[&Split::Valid] - 1000_i32).abs() < 90, "{counts:?}");
    }

    #[test]
    fn a_take_stays_together() {
        let mut items = vec![item("a1", "a", "x"), item("a2", "a", "x"), item("b1", "b", "y"), item("b2", "b", "y")];
        let said = assign(&mut items, &[None, Some(Split::Test), Some(Split::Train), Some(Split::Valid)]);
        let splits: Vec<_> = items.iter().map(|i| i.split).collect();
        assert_eq!(splits, [Split::Test, Split::Test, Split::Train, Split::Valid]);
        assert!(said[0].contains("1 takes stand in two splits by the labels given: b"), "{said:?}");
        assert!(said.iter().any(|s| s == "genre: 1 of 2 values have no clip in train: x"), "{said:?}");
    }

    #[test]
    fn an_empty_split_is_said() {
        let mut items = vec![item("a", "a", "x")];
        let said = assign(&mut items, &[Some(Split::Train)]);
        assert_eq!(
            said,
            [
                "no clip is in the valid split: training can't tell its best step, nor be measured on the way",
                "no clip is in the test split: a model can't be measured on clips that nothing was chosen by"
            ]
        );
    }

    /// Takes of the same name as their one clip, split as the hash has it; what was said.
    fn by_hash(takes: &[&str], stated: &[Option<Split>]) -> (Vec<Split>, Vec<String>) {
        let mut items: Vec<Item> = takes.iter().map(|take| item(take, take, "x")).collect();
        let said = assign(&mut items, stated);
        (items.iter().map(|i| i.split).collect(), said)
    }

    #[test]
    fn a_split_that_the_hash_left_empty_is_filled_where_there_are_three_takes() {
        use Split::{Test, Train, Valid};
        // by Python's hashlib, remainder and first bytes: a 0 ca97.., b 6 3e23.., c 0 2e7d..
        let (splits, said) = by_hash(&["a", "b", "c"], &[None; 3]);
        assert_eq!(splits, [Test, Valid, Train]);
        let filled = "the split by the hashes of so few takes left a part empty: a is test, b is valid";
        assert_eq!(said, [filled]);
        // only what is empty is filled: salsa-05 has the remainder 8
        let (splits, _) = by_hash(&["a", "b", "salsa-05"], &[None; 3]);
        assert_eq!(splits, [Test, Train, Valid]);
        // two takes are too few, and a stated split stays
        let (splits, said) = by_hash(&["a", "b"], &[None; 2]);
        assert_eq!((splits, said.len()), (vec![Train, Train], 2));
        assert!(said[0].contains("no clip is in the valid split: training can't"), "{said:?}");
        let (splits, said) = by_hash(&["a", "b", "c"], &[Some(Train), Some(Train), None]);
        assert_eq!((splits, said.len()), (vec![Train, Train, Test], 2));
        let (splits, _) = by_hash(&["a", "b", "c"], &[Some(Train); 3]);
        assert_eq!(splits, [Train; 3]);
        // all three fell to test: 31e9.., 8c99.., 3fd2..
        let (splits, _) = by_hash(&["take 0", "take 3", "take 12"], &[None; 3]);
        assert_eq!(splits, [Test, Valid, Train]);
    }
}
