//! The pieces of a corpus, made on several machines, put together.

use super::record::{ClipRecord, Failure, Manifest, Shard};
use super::store::Corpus;
use super::writer::{CorpusWriter, NewClip};
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Merges all shards of one corpus, given in any order, into `out`: the same bytes as a run without shards writes.
///
/// # Errors
/// [`kinelm_store::Error::Call`] when the folders are not each shard of one corpus once (same tokenizer, same sources, same number of
/// shards); those of [`Corpus::open`] and [`CorpusWriter`].
pub fn merge(shards: &[PathBuf], out: &Path, force: bool) -> Result<Manifest> {
    let shards: Vec<Corpus> = shards.iter().map(Corpus::open).collect::<Result<_>>()?;
    let Some(first) = shards.first() else { return Err(Error::call("no shard to merge")) };
    shards.iter().try_for_each(|s| check_fits(first, s))?;
    check_complete(&shards)?;
    let sources: Vec<String> = first.manifest().sources.iter().map(|s| s.path.clone()).collect();
    let mut writer = CorpusWriter::create(out, first.tokenizer(), &sources, None, force)?;
    let mut clips: Vec<(&Corpus, &ClipRecord)> =
        shards.iter().flat_map(|s| s.clips().iter().map(move |c| (s, c))).collect();
    if clips.is_empty() {
        return Err(Error::call("the shards hold no clip"));
    }
    clips.sort_by_key(|(_, clip)| clip.key);
    for (shard, clip) in clips {
        let sound = shard.sound(clip)?.rows.numbers.into_owned();
        writer.push(NewClip { record: clip.clone(), sound }, &shard.clip_ids(clip)?)?;
    }
    writer.left_out(&first.manifest().left_out);
    let mut failed: Vec<&Failure> = shards.iter().flat_map(|s| &s.manifest().failed).collect();
    failed.sort_by_key(|f| f.key);
    failed.into_iter().for_each(|f| writer.fail(f.clone()));
    writer.finish()
}

fn check_fits(first: &Corpus, other: &Corpus) -> Result<()> {
    let (a, b) = (first.dir().display(), other.dir().display());
    let (x, y) = (first.manifest(), other.manifest());
    if x.coding() != y.coding() {
        let (t, u) = (&x.tokenizer, &y.tokenizer);
        return Err(Error::call(format!("{a} has tokenizer {t}, {b} has {u}; shards are made with one tokenizer")));
    }
    let paths = |m: &Manifest| m.sources.iter().map(|s| s.path.clone()).collect::<Vec<_>>();
    if paths(x) != paths(y) {
        let (p, q) = (paths(x).join(" "), paths(y).join(" "));
        return Err(Error::call(format!("{a} was made from {p}, {b} from {q}; shards are made from the same DATA")));
    }
    if x.left_out != y.left_out {
        let (m, n) = (x.left_out.len(), y.left_out.len());
        let what = format!("{a} was made without {m} ranges of its clips, {b} without {n}, or without others");
        return Err(Error::call(format!("{what}; shards are made with the same --leave-out")));
    }
    Ok(())
}

/// Whether every shard is there, once.
fn check_complete(shards: &[Corpus]) -> Result<()> {
    let mut there: Vec<Shard> = Vec::new();
    for corpus in shards {
        let shown = corpus.dir().display();
        let Some(shard) = corpus.manifest().shard else {
            let what = format!("{shown} is a whole corpus, no shard; only shards made with --shard I/N are merged");
            return Err(Error::call(what));
        };
        let of = there.first().map_or(shard.of, |s| s.of);
        if shard.of != of {
            return Err(Error::call(format!(
                "{shown} is shard {shard}, others are of {of}; all shards are of one run"
            )));
        }
        if there.contains(&shard) {
            return Err(Error::call(format!("{shown} is shard {shard}, which is there already; give each once")));
        }
        there.push(shard);
    }
    let of = there.first().map_or(0, |s| s.of);
    let missing: Vec<String> =
        (0..of).map(|index| Shard { index, of }).filter(|s| !there.contains(s)).map(|s| s.to_string()).collect();
    if !missing.is_empty() {
        return Err(Error::call(format!("shards {} are missing; give all {of}", missing.join(", "))));
    }
    Ok(())
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
            let sound = vec![*k as f32; if *k == 0 { 0 } else { CHANNELS * (k + 1) }];
            let new = NewClip { sound, ..clip(&format!("c{k}"), *k, Split::Train, k + 1) };
            w.push(new, &words(k + 1)).unwrap();
        }
        w.finish().unwrap();
        out
    }

    #[test]
    fn the_order_is_that_of_the_files() {
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
            let rows = corpus.sound(clip).unwrap().rows.numbers.into_owned();
            assert!(rows.len() == if k == 0 { 0 } else { CHANNELS * (k + 1) } && rows.iter().all(|x| *x == k as f32));
        }
    }

    #[test]
    fn what_does_not_fit_is_named() {
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
        assert!(says(&[&a]).contains("shards 1/2 are missing"));
        assert!(says(&[&a, &a]).contains("there already"));
        assert!(says(&[&a, &b]).contains("others are of 2"));
        assert!(says(&[&a, &c]).contains("the same DATA"));
        assert!(says(&[&a, &e]).contains("stands once"), "{}", says(&[&a, &e]));
        let whole = shard(d, 0, 1, &[0], "d");
        merge(&[whole], &d.join("w"), false).unwrap();
        assert!(says(&[&d.join("w")]).contains("no shard"));
        assert!(!out.exists());
    }
}
