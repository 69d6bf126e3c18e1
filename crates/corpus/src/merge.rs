//! Merging the shards of a corpus that several machines made.

use super::record::{ClipRecord, Failure, Manifest, Shard};
use super::store::Corpus;
use super::writer::{CorpusWriter, NewClip};
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Merges all shards of a corpus, in any order, into `out`: the same bytes as a build without shards writes.
///
/// # Errors
/// [`kinelm_store::Error::Unsupported`] for folders that are not shards of one corpus, [`kinelm_store::Error::Missing`] for a
/// shard that isn't among them, those of [`Corpus::open`] and [`CorpusWriter`].
pub fn merge(shards: &[PathBuf], out: &Path, force: bool) -> Result<Manifest> {
    let shards: Vec<Corpus> = shards.iter().map(Corpus::open).collect::<Result<_>>()?;
    let Some(first) = shards.first() else { return Err(Error::missing("shard to merge", "give the folders of all")) };
    shards.iter().try_for_each(|s| check_fits(first, s))?;
    check_complete(&shards)?;
    let sources: Vec<String> = first.manifest().sources.iter().map(|s| s.path.clone()).collect();
    let mut writer = CorpusWriter::create(out, first.tokenizer(), &sources, None, force)?;
    let mut clips: Vec<(&Corpus, &ClipRecord)> =
        shards.iter().flat_map(|s| s.clips().iter().map(move |c| (s, c))).collect();
    if clips.is_empty() {
        return Err(Error::missing("clip in the shards", "nothing was written"));
    }
    // by key, the order in which a build without shards writes them
    clips.sort_by_key(|(_, clip)| clip.key);
    for (shard, clip) in clips {
        let music = shard.music(clip)?.rows.numbers.into_owned();
        writer.push(NewClip { record: clip.clone(), music }, &shard.clip_ids(clip)?)?;
    }
    writer.exclude(&first.manifest().excluded);
    let mut failed: Vec<&Failure> = shards.iter().flat_map(|s| &s.manifest().failed).collect();
    failed.sort_by_key(|f| f.key);
    failed.into_iter().for_each(|f| writer.fail(f.clone()));
    writer.finish()
}

/// Refuses shards that were not made alike.
fn check_fits(first: &Corpus, other: &Corpus) -> Result<()> {
    let (a, b) = (first.dir().display(), other.dir().display());
    let (x, y) = (first.manifest(), other.manifest());
    let differ = |what: String| Err(Error::unsupported(format!("merging {a} and {b}"), what));
    if x.coding() != y.coding() {
        let (t, u) = (&x.tokenizer, &y.tokenizer);
        return differ(format!("their tokenizers are {t} and {u}; shards are made with one tokenizer"));
    }
    let paths = |m: &Manifest| m.sources.iter().map(|s| s.path.as_str()).collect::<Vec<_>>().join(" ");
    if paths(x) != paths(y) {
        let (p, q) = (paths(x), paths(y));
        return differ(format!("they were made from {p} and from {q}; shards are made from the same data"));
    }
    if x.excluded != y.excluded {
        let (m, n) = (x.excluded.len(), y.excluded.len());
        return differ(format!("they exclude different ranges, {m} and {n}; shards are made with the same `exclude`"));
    }
    Ok(())
}

/// Refuses anything but every shard once.
fn check_complete(shards: &[Corpus]) -> Result<()> {
    let mut found: Vec<Shard> = Vec::new();
    for corpus in shards {
        let wrong = |why: String| Err(Error::unsupported(format!("merging {}", corpus.dir().display()), why));
        let Some(shard) = corpus.manifest().shard else { return wrong("it is a whole corpus, no shard".into()) };
        let of = found.first().map_or(shard.of, |s| s.of);
        if shard.of != of {
            return wrong(format!("it is shard {shard}, others are of {of}; all shards are of one build"));
        }
        if found.contains(&shard) {
            return wrong(format!("it is shard {shard}, which another folder is too; give each once"));
        }
        found.push(shard);
    }
    let of = found.first().map_or(0, |s| s.of);
    let missing: Vec<String> =
        (0..of).map(|index| Shard { index, of }).filter(|s| !found.contains(s)).map(|s| s.to_string()).collect();
    match missing.is_empty() {
        true => Ok(()),
        false => Err(Error::missing(format!("shard {}", missing.join(", ")), format!("give all {of}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Split;
    use crate::samples::{clip, tokenizer, words};
    use kinelm_music::feature::CHANNELS;

    fn shard(dir: &Path, index: usize, of: usize, keys: &[usize], source: &str) -> PathBuf {
        let out = dir.join(format!("{source}{index}-{of}"));
        let s = Some(Shard { index, of });
        let mut w = CorpusWriter::create(&out, &tokenizer(), &[source.to_string()], s, false).unwrap();
        for k in keys {
            // every clip but the first has as many rows of music as frames
            let music = vec![*k as f32; if *k == 0 { 0 } else { CHANNELS * (k + 1) }];
            let new = NewClip { music, ..clip(&format!("c{k}"), *k, Split::Train, k + 1) };
            w.push(new, &words(k + 1)).unwrap();
        }
        w.finish().unwrap();
        out
    }

    #[test]
    fn clips_are_merged_in_the_order_of_the_files() {
        let tmp = tempfile::tempdir().unwrap();
        let d = tmp.path();
        let shards = [shard(d, 1, 2, &[1, 3], "d"), shard(d, 0, 2, &[0, 2, 4], "d")];
        let out = d.join("m");
        let manifest = merge(&shards, &out, false).unwrap();
        assert_eq!((manifest.count.frames, manifest.shard), (15, None));
        let corpus = Corpus::open(&out).unwrap();
        assert_eq!(corpus.clips().iter().map(|c| c.key).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
        assert_eq!(corpus.clip_ids(&corpus.clips()[3]).unwrap(), words(4));
        for (k, clip) in corpus.clips().iter().enumerate() {
            let rows = corpus.music(clip).unwrap().rows.numbers.into_owned();
            assert!(rows.len() == if k == 0 { 0 } else { CHANNELS * (k + 1) } && rows.iter().all(|x| *x == k as f32));
        }
    }

    #[test]
    fn shards_that_do_not_fit_are_refused() {
        let tmp = tempfile::tempdir().unwrap();
        let d = tmp.path();
        let [a, b, c, e] = [
            shard(d, 0, 2, &[0], "d"),
            shard(d, 1, 3, &[1], "d"),
            shard(d, 1, 2, &[1], "other"),
            shard(d, 1, 2, &[0], "d"),
        ];
        let out = d.join("m");
        let says = |shards: &[&PathBuf]| {
            merge(&shards.iter().map(|p| p.to_path_buf()).collect::<Vec<_>>(), &out, false).unwrap_err().to_string()
        };
        assert!(says(&[]).contains("no shard"));
        assert!(says(&[&a]).contains("no shard 1/2; give all 2"));
        assert!(says(&[&a, &a]).contains("which another folder is too"));
        assert!(says(&[&a, &b]).contains("others are of 2"));
        assert!(says(&[&a, &c]).contains("the same data"));
        assert!(says(&[&a, &e]).contains("a name of its own"), "{}", says(&[&a, &e]));
        let whole = shard(d, 0, 1, &[0], "d");
        merge(&[whole], &d.join("w"), false).unwrap();
        assert!(says(&[&d.join("w")]).contains("no shard"));
        assert!(!out.exists());
    }
}
