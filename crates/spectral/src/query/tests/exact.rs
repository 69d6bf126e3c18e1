//! Searches against measuring everything.

use super::*;
use crate::feature::tests::noise;

/// Windows of noise around a common middle, some the same; four a clip.
fn noisy(windows: usize, numbers: usize) -> (Vec<f32>, Vec<ClipEntry>) {
    let mut features: Vec<f32> = noise(7, windows * numbers)
        .iter()
        .enumerate()
        .map(|(i, &x)| (0.3 * x + (i % numbers % 3) as f64) as f32)
        .collect();
    features.copy_within(numbers..3 * numbers, 8 * numbers);
    features[5 * numbers..6 * numbers].fill(0.0);
    let clips =
        (0..windows / 4).map(|i| entry(&format!("c{i}"), &format!("t{}", i / 2), vec![0, 64, 128, 192])).collect();
    (features, clips)
}

/// The nearest, or the farthest, by measuring every window.
fn by_hand(database: &Database, feature: &[f32], wanted: SearchOptions, allowed: &dyn Fn(usize) -> bool) -> Vec<Hit> {
    let score = |window| Hit { window, score: wanted.distance.score(feature, &database.feature(window).unwrap()) };
    let mut all: Vec<Hit> = (0..database.windows()).filter(|&w| allowed(w)).map(score).collect();
    let sign = if wanted.farthest { 1.0 } else { -1.0 };
    all.sort_by(|a, b| (sign * a.score).total_cmp(&(sign * b.score)).then(a.window.cmp(&b.window)));
    let mut seen = Vec::new();
    all.retain(|h| {
        let clip = database.window(h.window).clip;
        let new = !seen.contains(&clip);
        seen.push(clip);
        new || !wanted.one_per_clip
    });
    all.truncate(wanted.k);
    all
}

/// The database as a build writes it, in two parts.
fn on_disk(dir: &Path, features: &[f32], clips: &[ClipEntry], numbers: usize) -> Database {
    let half = clips.len() / 2;
    let mut parts = Vec::new();
    let mut rest = features;
    for (i, clips) in [&clips[..half], &clips[half..]].into_iter().enumerate() {
        let place = dir.join(format!("part{i}"));
        let mut writer = writer::PartWriter::create(&place, numbers).unwrap();
        for clip in clips {
            let (here, behind) = rest.split_at(clip.starts.len() * numbers);
            rest = behind;
            writer.push(clip, here).unwrap();
        }
        let record = writer.finish().unwrap();
        parts.push(Part::open(&place, &record, numbers).unwrap());
    }
    Database::new(numbers, parts)
}

#[test]
fn found_is_what_measuring_everything_finds() {
    let dir = tempfile::tempdir().unwrap();
    let (windows, numbers) = (700, 45);
    let (features, clips) = noisy(windows, numbers);
    let written = on_disk(dir.path(), &features, &clips, numbers);
    let held = Database::new(numbers, vec![(Part::held(features, numbers), clips)]);
    // more than a panel of a product has columns
    let queries: Vec<usize> = [0, 1, 5, 8, 333, 699].into_iter().chain((10..700).step_by(11)).collect();
    let features: Vec<_> = queries.iter().map(|&query| held.feature(query).unwrap()).collect();
    let features: Vec<&[f32]> = features.iter().map(|feature| &**feature).collect();
    for distance in [Distance::Cosine, Distance::Euclid] {
        let sizes = [(0, false), (1, false), (10, false), (10, true), (1000, false), (1000, true)];
        for ((k, one_per_clip), farthest) in sizes.into_iter().flat_map(|size| [(size, false), (size, true)]) {
            let wanted = SearchOptions { k, distance, one_per_clip, farthest };
            let allowed = |query: usize, w: usize| w.abs_diff(queries[query]) > 2 || w.is_multiple_of(5);
            let together = Search::new(&written, &features, wanted).unwrap().nearest(&allowed).unwrap();
            for (i, (&feature, together)) in features.iter().zip(together).enumerate() {
                let expected = by_hand(&held, feature, wanted, &|w| allowed(i, w));
                assert_eq!(together.hits, expected, "{i} {wanted:?} beside others");
                if i >= 6 {
                    continue;
                }
                for database in [&held, &written] {
                    let alone = database.nearest(feature, wanted, &|w| allowed(i, w)).unwrap();
                    assert_eq!(alone.hits, expected, "{i} {wanted:?}");
                }
            }
        }
    }
}

/// Many blocks, of which a search reads few: the answers are still those of measuring everything, also where the blocks that
/// promise most have no window that is allowed.
#[test]
fn of_many_blocks_few_are_read() {
    let (windows, numbers) = (256 * 40, 20);
    // along a curve: the windows near a query are those beside it
    let at = |i: usize| ((i / numbers) as f64 / 700.0 + (i % numbers) as f64).sin() + 0.1 * (i % numbers) as f64;
    let features: Vec<f32> = (0..windows * numbers).map(|i| at(i) as f32).collect();
    let (_, clips) = noisy(windows, 1);
    let database = Database::new(numbers, vec![(Part::held(features, numbers), clips)]);
    let queries = [0, 5000, 10_239];
    let features = queries.map(|query| database.feature(query).unwrap());
    let features = features.each_ref().map(|f| &**f);
    for (distance, farthest) in [(Distance::Cosine, false), (Distance::Euclid, false), (Distance::Euclid, true)] {
        let wanted = SearchOptions { k: 7, distance, one_per_clip: false, farthest };
        let search = Search::new(&database, &features, wanted).unwrap();
        for least in [0, 300, 4000] {
            let allowed = |query: usize, w: usize| w.abs_diff(queries[query]) >= least && !w.is_multiple_of(3);
            for (i, found) in search.nearest(&allowed).unwrap().into_iter().enumerate() {
                let expected = by_hand(&database, features[i], wanted, &|w| allowed(i, w));
                assert_eq!(found.hits, expected, "{i} {wanted:?} from {least}");
                assert!(found.measured < windows / 4, "{i} {wanted:?} from {least}: {}", found.measured);
            }
        }
    }
}

/// Sets of features (N, D) that a bound might miss: equal ones, zeros, tiny and huge ones, ones with a single number, ones
/// of two kinds that differ a million times in size, ones that differ in the last bit.
fn adversarial(windows: usize, numbers: usize) -> Vec<(&'static str, Vec<f32>)> {
    let noise = noise(11, windows * numbers);
    let of = |f: &dyn Fn(usize, usize, f64) -> f64| -> Vec<f32> {
        noise.iter().enumerate().map(|(i, &x)| f(i / numbers, i % numbers, x) as f32).collect()
    };
    vec![
        ("all equal", of(&|_, i, _| 1.0 + i as f64)),
        ("all zero", of(&|_, _, _| 0.0)),
        ("few kinds", of(&|w, i, _| ((w % 3) * i) as f64 - 1.0)),
        ("signs", of(&|w, i, _| if (w + i).is_multiple_of(2) { 1.0 } else { -1.0 })),
        ("noise", of(&|_, _, x| x)),
        ("tiny", of(&|_, _, x| x * 1e-42)),
        ("huge", of(&|_, _, x| x * 1e38)),
        ("the largest", of(&|w, i, _| f64::from(f32::MAX) * if (w * i) % 3 == 1 { -1.0 } else { 1.0 })),
        ("of all sizes", of(&|w, _, x| x * 10f64.powi((w % 70) as i32 - 35))),
        ("one number each", of(&|w, i, x| if w % numbers == i { x } else { 0.0 })),
        ("an outlier", of(&|w, i, x| if w == 7 && i == 3 { 1e6 } else { 1.0 + 1e-3 * x })),
        ("last bits", of(&|w, i, _| 1.0 + i as f64 + f64::from(f32::EPSILON) * (w * (i % 5)) as f64)),
        ("zeros between", of(&|w, _, x| if w.is_multiple_of(3) { 0.0 } else { x })),
    ]
}

#[test]
fn no_features_are_too_bad_for_the_bounds() {
    // more numbers than a head has
    let (windows, numbers) = (640, 150);
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for (what, features) in adversarial(windows, numbers) {
        let dir = tempfile::tempdir().unwrap();
        let (_, clips) = noisy(windows, 1);
        let written = on_disk(dir.path(), &features, &clips, numbers);
        let whole = Database::new(numbers, vec![(Part::held(features, numbers), clips)]);
        let queries = [0, 1, 7, 300, 639];
        let features = queries.map(|query| whole.feature(query).unwrap());
        let features = features.each_ref().map(|f| &**f);
        for distance in [Distance::Cosine, Distance::Euclid] {
            let sizes = [(1, false), (10, false), (10, true), (700, false), (159, true)];
            for ((k, one_per_clip), farthest) in sizes.into_iter().flat_map(|size| [(size, false), (size, true)]) {
                let wanted = SearchOptions { k, distance, one_per_clip, farthest };
                let allowed = |query: usize, w: usize| w.abs_diff(queries[query]) > 1;
                let expected: Vec<_> =
                    (0..5).map(|i| by_hand(&whole, features[i], wanted, &|w| allowed(i, w))).collect();
                for database in [&whole, &written] {
                    let search = Search::new(database, &features, wanted).unwrap();
                    let together = search.nearest(&allowed).unwrap();
                    for (i, (together, expected)) in together.iter().zip(&expected).enumerate() {
                        let alone = database.nearest(features[i], wanted, &|w| allowed(i, w)).unwrap();
                        assert_eq!(&alone.hits, expected, "{what}: {i} {wanted:?}");
                        assert_eq!(&together.hits, expected, "{what}: {i} {wanted:?} beside others");
                    }
                    for query in 0..5 {
                        let on_one = one_thread.install(|| search.candidates(query, &allowed).unwrap());
                        assert_eq!(search.candidates(query, &allowed).unwrap(), on_one, "{what}: {query} {wanted:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn features_that_are_not_finite_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut writer = writer::PartWriter::create(&dir.path().join("part"), 3).unwrap();
        let e = writer.push(&entry("a", "t", vec![0, 64]), &[1.0, 2.0, 3.0, 4.0, bad, 6.0]).unwrap_err().to_string();
        assert!(e.contains("a window's feature is not finite"), "{e}");
    }
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
}

/// The bytes of a part, written in blocks, are those that one in memory has.
#[test]
fn written_in_blocks_as_in_memory() {
    let dir = tempfile::tempdir().unwrap();
    let (windows, numbers) = (2400, 1000);
    let (features, clips) = noisy(windows, numbers);
    let mut writer = writer::PartWriter::create(&dir.path().join("part"), numbers).unwrap();
    for (clip, features) in clips.iter().zip(features.chunks_exact(4 * numbers)) {
        writer.push(clip, features).unwrap();
    }
    let record = writer.finish().unwrap();
    assert_eq!(record.bytes.map(|half| half.bytes), [2400 * 128, 2400 * 896]);
    let (written, _) = Part::open(&dir.path().join("part"), &record, numbers).unwrap();
    let held = Part::held(features, numbers);
    for half in [0, 1] {
        assert!(written.bytes(half, 0..2400).unwrap() == held.bytes(half, 0..2400).unwrap());
    }
    assert!(written.sizes == held.sizes && written.scales == held.scales);
}
