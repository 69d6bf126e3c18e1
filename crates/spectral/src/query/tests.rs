//! Indices on disk, exclusions, evaluations.

mod exact;

use super::evaluate::{EvaluateOptions, evaluate};
use super::exclude::{Exclude, Exclusion, Origin};
use super::part::Part;
use super::record::ClipEntry;
use super::*;
use crate::WindowSpec;
use kinelm_corpus::build::{BuildEvent, BuildOptions};
use kinelm_corpus::{Dataset, samples};
use kinelm_motion::format::ReadOptions;
use kinelm_motion::{Motion, format, synth};
use std::collections::BTreeMap;
use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

fn go(_: BuildEvent<'_>) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

fn entry(name: &str, take: &str, starts: Vec<usize>) -> ClipEntry {
    ClipEntry {
        name: name.into(),
        path: PathBuf::from(name),
        sha256: name.into(),
        read: ReadOptions::default(),
        take: take.into(),
        labels: BTreeMap::new(),
        frames: 1000,
        starts,
    }
}

#[test]
fn exclusions_leave_out_more_and_more() {
    let clips = vec![
        entry("a", "t", vec![0, 64, 128, 192]),
        entry("b", "t", vec![0, 64]),
        entry("c", "u", vec![0]),
        entry("d", "v", vec![0]),
    ];
    let mut clips = clips;
    for (clip, value) in clips.iter_mut().zip(["x", "x", "x", "y"]) {
        clip.labels.insert("choreography".into(), value.into());
    }
    let database = Database::new(1, vec![(Part::held(vec![1.0; 8], 1), clips)]);
    let allowed = |exclude| {
        let filter = Exclusion::new(&database, exclude, Origin::of(&database, database.window(1)), 128);
        (0..8).filter(|&w| filter.allows(w)).collect::<Vec<_>>()
    };
    let expected: [&[usize]; 6] =
        [&[0, 1, 2, 3, 4, 5, 6, 7], &[0, 2, 3, 4, 5, 6, 7], &[3, 4, 5, 6, 7], &[4, 5, 6, 7], &[6, 7], &[7]];
    for (exclude, expected) in Exclude::ALL.into_iter().zip(expected) {
        assert_eq!(allowed(exclude), expected, "{exclude:?}");
    }
    assert!(Exclude::Choreography.check(database.clips()).is_ok());
    let e = Exclude::Choreography.check(&[entry("a", "t", vec![])]).unwrap_err().to_string();
    assert!(e.contains("`choreography`"), "{e}");
}

/// Extracted-up dances of two genres and a clip that is too short.
struct Data {
    dir: tempfile::TempDir,
    labels: String,
}

impl Data {
    fn new() -> Data {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("data")).unwrap();
        let mut csv = "clip,genre,take\n".to_string();
        for (i, dance) in synth::corpus(9, 6, 5.0, 30.0).unwrap().into_iter().enumerate() {
            let frames = if i == 5 { 40 } else { dance.clip.frames() };
            let path = dir.path().join(format!("data/d{i}.bvh"));
            let motion = Motion::new(&path, dance.clip.slice(0..frames));
            format::write(&path, &motion).unwrap();
            csv += &format!("d{i},{},t{}\n", ["salsa", "waltz"][i % 2], i / 2);
        }
        let labels = dir.path().join("labels.csv");
        fs::write(&labels, csv).unwrap();
        Data { labels: labels.display().to_string(), dir }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn dataset(&self, clips: &[usize]) -> Dataset {
        let paths: Vec<PathBuf> = clips.iter().map(|i| self.at(&format!("data/d{i}.bvh"))).collect();
        Dataset::find(&paths, std::slice::from_ref(&self.labels)).unwrap()
    }

    fn build(&self, clips: &[usize], request: &IndexRequest, out: &str) -> crate::Result<BuildReport> {
        Index::build(&self.dataset(clips), request, &BuildOptions::default(), &self.at(out), &mut go)
    }

    fn names(&self) -> Vec<String> {
        let names =
            fs::read_dir(self.dir.path()).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned());
        let mut names: Vec<String> = names.collect();
        names.sort();
        names
    }
}

fn question(data: &Data, clip: usize) -> Query {
    Query {
        clip: data.at(&format!("data/d{clip}.bvh")),
        read: ReadOptions::default(),
        as_indexed: true,
        at_s: None,
        k: 4,
        lowest: 0,
        distance: Distance::Cosine,
        exclude: Exclude::Take,
        one_per_clip: false,
        models: Models::default(),
    }
}

#[test]
fn built_in_two_goes_as_in_one() {
    let data = Data::new();
    let request = IndexRequest::default();
    let whole = data.build(&[0, 1, 2, 3, 4, 5], &request, "whole").unwrap();
    assert_eq!((whole.added.0, whole.short, whole.known), (5, 1, 0));
    data.build(&[0, 1], &request, "pieces").unwrap();
    let more = data.build(&[1, 2, 3, 4], &request, "pieces").unwrap();
    assert_eq!((more.added.0, more.known, more.windows), (3, 1, whole.windows));
    let again = data.build(&[4], &request, "pieces").unwrap();
    assert_eq!((again.added, again.known), ((0, 0), 1));
    assert_eq!(data.names(), ["data", "labels.csv", "pieces", "whole"]);
    let (one, two) = (Index::open(&data.at("whole")).unwrap(), Index::open(&data.at("pieces")).unwrap());
    assert_eq!((one.manifest().parts.len(), two.manifest().parts.len()), (1, 2));
    let (a, b) = (one.database(), two.database());
    assert_eq!(a.numbers(), 1152);
    for window in 0..a.windows() {
        assert_eq!((a.window(window), a.feature(window).unwrap()), (b.window(window), b.feature(window).unwrap()));
    }
    for clip in [0, 3] {
        let mut answers = [&one, &two].map(|index| index.find(&question(&data, clip)).unwrap());
        answers.iter_mut().for_each(|a| (a.seconds, a.measured) = (0.0, 0));
        assert_eq!(answers[0], answers[1]);
        assert_eq!(answers[0].matches.len(), 4);
        let take = format!("t{}", clip / 2);
        assert!(answers[0].matches.iter().all(|f| f.window.take != take && f.window.clip != "d5"));
        let itself = Query { exclude: Exclude::None, at_s: Some(64.0 / 60.0), ..question(&data, clip) };
        let first = one.find(&itself).unwrap().matches.remove(0);
        assert_eq!((first.window.clip.as_str(), first.window.start), (format!("d{clip}").as_str(), 64));
        assert!((first.value - 1.0).abs() < 1e-12);
    }
}

/// Features are those of a window's own poses: cut out and read alone, it has the same to the last bit.
#[test]
fn what_came_before_a_window_does_not_matter() {
    let clip = samples::spinning(&synth::corpus(9, 1, 8.0, 60.0).unwrap().remove(0).clip, 0.4);
    for kind in [FeatureKind::stft(), FeatureKind::dct(), FeatureKind::pca()] {
        let options = IndexOptions::new(kind);
        let starts: Vec<usize> = options.windows.starts(clip.frames(), 0).collect();
        let basis = match options.transform {
            FeatureKind::Pca { keep } => Some(extract::fit_of(&clip, &starts, &options).unwrap().finish(keep).unwrap()),
            _ => None,
        };
        let extractor = extract::FeatureExtractor::new(&options, basis.as_ref(), Models::default()).unwrap();
        let features = |clip: &kinelm_motion::Clip, starts: &[usize]| {
            extractor.embed(extractor.extract(clip, starts).unwrap()).unwrap()
        };
        let whole = features(&clip, &starts);
        for (feature, &start) in whole.chunks(whole.len() / starts.len()).zip(&starts) {
            assert!(features(&clip.slice(start..start + 128), &[0]) == feature, "{:?} {start}", options.transform);
        }
    }
}

#[test]
fn a_fitted_basis_stays() {
    let data = Data::new();
    let request = IndexRequest { transform: Some(FeatureKind::pca()), ..IndexRequest::default() };
    let built = data.build(&[0, 1, 2], &request, "pca").unwrap();
    assert!(built.explained.unwrap() > 0.9, "{:?}", built.explained);
    let before = Index::open(&data.at("pca")).unwrap().basis().unwrap().clone();
    // without saying what it holds
    data.build(&[3, 4], &IndexRequest::default(), "pca").unwrap();
    let index = Index::open(&data.at("pca")).unwrap();
    assert_eq!((index.basis(), index.manifest().parts.len()), (Some(&before), 2));
    assert_eq!(index.find(&question(&data, 4)).unwrap().matches.len(), 4);
}

#[test]
fn what_cannot_be_done_is_said_and_changes_nothing() {
    let data = Data::new();
    data.build(&[0, 1], &IndexRequest::default(), "index").unwrap();
    let before = fs::read(data.at("index/index.json")).unwrap();
    let error =
        |clips: &[usize], request: IndexRequest, out: &str| data.build(clips, &request, out).unwrap_err().to_string();
    let e = error(&[2], IndexRequest { hop: Some(32), joints: Some(vec![0]), ..IndexRequest::default() }, "index");
    assert!(e.contains("hop 64 frames, joints all 24") && e.contains("hop 32 frames, joints pelvis"), "{e}");
    let e = error(&[5], IndexRequest::default(), "other");
    assert!(e.contains("no clip as long as a window of 128 frames (2.133 s)"), "{e}");
    let pca = IndexRequest { transform: Some(FeatureKind::pca()), ..IndexRequest::default() };
    assert!(error(&[5], pca, "other").contains("no clip as long"));
    let e = error(&[0], IndexRequest { frames: Some(8), ..IndexRequest::default() }, "other");
    assert!(e.contains("expected 16 to 4096"), "{e}");
    assert!(error(&[0], IndexRequest::default(), "data").contains("exists and is no index"));
    let mut stop = |e: BuildEvent<'_>| match e {
        BuildEvent::Done { done: 2, .. } => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    for out in ["index", "other"] {
        let dataset = data.dataset(&[2, 3, 4]);
        let e = Index::build(&dataset, &IndexRequest::default(), &BuildOptions::default(), &data.at(out), &mut stop)
            .unwrap_err();
        assert!(e.to_string().contains("stopped after 2 of 3 files"), "{e}");
    }
    assert_eq!(fs::read(data.at("index/index.json")).unwrap(), before);
    assert_eq!(data.names(), ["data", "index", "labels.csv"]);
    let inside: Vec<_> = fs::read_dir(data.at("index")).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(inside.len(), 2, "{inside:?}");
}

#[test]
fn other_versions_and_damage_are_refused() {
    let data = Data::new();
    data.build(&[0, 1], &IndexRequest::default(), "index").unwrap();
    let error = || Index::open(&data.at("index")).err().unwrap().to_string();
    let path = data.at("index/index.json");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replace("\"version\": 5", "\"version\": 2")).unwrap();
    let e = error();
    assert!(e.contains("found version 2, written by kinelm") && e.contains("expected version 5; build"), "{e}");
    fs::write(&path, &text).unwrap();
    for name in ["features.f32", "heads.i8", "rests.i8", "order.u32", "scales.f32", "sizes.f64", "clips.jsonl"] {
        let path = data.at("index/part-0001").join(name);
        let whole = fs::read(&path).unwrap();
        let mut bent = whole.clone();
        bent[20] ^= 1;
        for bytes in [&bent[..], &whole[..whole.len() - 1]] {
            fs::write(&path, bytes).unwrap();
            let e = error();
            assert!(e.contains(name) && e.contains("build the index again"), "{e}");
        }
        fs::write(&path, &whole).unwrap();
    }
    Index::open(&data.at("index")).unwrap();
}

#[test]
fn a_question_that_does_not_fit_is_said() {
    let data = Data::new();
    data.build(&[0, 1], &IndexRequest::default(), "index").unwrap();
    let index = Index::open(&data.at("index")).unwrap();
    let error = |q: Query| index.find(&q).unwrap_err().to_string();
    let e = error(question(&data, 5));
    assert!(e.contains("d5.bvh") && e.contains("79 frames at 60") && e.contains("at least 128 (2.13 s)"), "{e}");
    let e = error(Query { at_s: Some(4.0), ..question(&data, 0) });
    assert!(e.contains("a window from 4 s on") && e.contains("0 to 2.8"), "{e}");
    assert!(error(Query { exclude: Exclude::Choreography, ..question(&data, 0) }).contains("`choreography`"));
    let stranger = index.find(&question(&data, 2)).unwrap();
    assert!(stranger.notes[0].contains("doesn't have this clip"), "{:?}", stranger.notes);
}

/// Nearest and least similar windows share the allowed ones, best first and worst first.
#[test]
fn the_least_similar_are_found_beside_the_nearest() {
    let data = Data::new();
    data.build(&[0, 1, 2, 3, 4], &IndexRequest::default(), "index").unwrap();
    let index = Index::open(&data.at("index")).unwrap();
    for distance in [Distance::Cosine, Distance::Euclid] {
        let ask = |k, lowest, one_per_clip| {
            index.find(&Query { k, lowest, one_per_clip, distance, ..question(&data, 0) }).unwrap()
        };
        // clips 0 and 1 are one take, so three are left
        let all = ask(100, 100, false);
        assert!(all.lowest.is_empty(), "nothing is both");
        assert!(
            all.notes.iter().any(|n| n.contains("only 0 of 100 requested least similar windows")),
            "{:?}",
            all.notes
        );
        let some = ask(2, 3, false);
        assert_eq!(some.matches, all.matches[..2]);
        let worst: Vec<_> = all.matches.iter().rev().take(3).map(|found| &found.window).collect();
        assert_eq!(some.lowest.iter().map(|found| &found.window).collect::<Vec<_>>(), worst);
        assert_eq!(some.lowest.iter().map(|found| found.rank).collect::<Vec<_>>(), [1, 2, 3]);
        let text = some.table(distance);
        let (nearest, lowest) = text.split_once("lowest, the least similar first:").unwrap();
        assert!(nearest.contains(&format!("{:.4}", some.matches[0].value)));
        assert!(
            lowest.contains(&format!("{:.4}", some.lowest[0].value))
                && !ask(2, 0, false).table(distance).contains("lowest")
        );
        let clips = ask(1, 9, true);
        let mut names: Vec<&str> = clips.matches.iter().chain(&clips.lowest).map(|f| f.window.clip.as_str()).collect();
        names.sort_unstable();
        assert_eq!(names, ["d2", "d3", "d4"], "one of each clip");
        assert_eq!(clips.lowest[0].window, some.lowest[0].window);
    }
}

#[test]
fn a_page_plays_the_query_beside_what_was_found() {
    let data = Data::new();
    data.build(&[0, 1, 2, 3], &IndexRequest::default(), "index").unwrap();
    let index = Index::open(&data.at("index")).unwrap();
    let answer = index.find(&Query { one_per_clip: true, k: 2, ..question(&data, 0) }).unwrap();
    let (both, _) = index.find(&Query { k: 1, lowest: 2, ..question(&data, 0) }).unwrap().page().unwrap();
    assert!(both.contains("\"1. d") && both.contains("\"lowest 1. d") && both.contains("\"lowest 2. d"));
    let (text, lost) = answer.page().unwrap();
    assert!(lost.is_empty());
    assert!(text.contains("query: d0") && text.contains("1. d") && text.contains("2. d") && text.contains("genre"));
    let hit = &answer.matches[0].window.path;
    fs::write(hit, fs::read_to_string(hit).unwrap() + "\n").unwrap();
    let (text, lost) = answer.page().unwrap();
    assert!(lost.len() == 1 && lost[0].to_string().contains("changed since the index was built"), "{lost:?}");
    assert!(text.contains("query: d0") && !text.contains("1. d") && text.contains("2. d"));
}

#[test]
fn an_evaluation_has_all_ways_and_says_what_lacks() {
    let data = Data::new();
    let options = EvaluateOptions {
        build: BuildOptions::default(),
        windows: WindowSpec::default(),
        joints: vec![],
        raw: false,
        transforms: vec![FeatureKind::stft(), FeatureKind::dct(), FeatureKind::pca()],
        distances: vec![Distance::Cosine, Distance::Euclid],
        fields: vec![],
        only: vec![],
        exclude: Exclude::Take,
        k: 3,
        models: Models::default(),
    };
    let dataset = data.dataset(&[0, 1, 2, 3, 4, 5]);
    let report = evaluate(&dataset, &options, &mut go).unwrap();
    // two phases, five exclusions (no clip has a choreography), six ways and chance
    assert_eq!((report.rows.len(), report.clips, report.short, report.takes), (2 * 5 * 7, 5, 1, 3));
    for row in &report.rows {
        let itself = row.exclude == Exclude::None && row.transform != "chance";
        assert_eq!(row.queries, report.queries.iter().find(|q| q.0 == row.phase).unwrap().1);
        assert!((0.0..=1.0).contains(&row.accuracy.unwrap()) && (0.0..=1.0).contains(&row.entropy_bans.unwrap()));
        assert!(!itself || row.accuracy.unwrap() > 0.5, "{row:?}");
    }
    let text = tables::markdown(&report);
    assert!(
        text.contains("genre: 2 values") && text.contains("| pca, euclid |") && text.contains("3 at random"),
        "{text}"
    );
    let error = |options: EvaluateOptions| evaluate(&dataset, &options, &mut go).unwrap_err().to_string();
    let e = error(EvaluateOptions { fields: vec!["mood".into()], ..options.clone() });
    assert!(e.contains("no label `mood` on 5 of 5 clips") && e.contains("genre"), "{e}");
    let only = |value: &str| vec![format!("genre={value}").parse().unwrap()];
    assert!(error(EvaluateOptions { only: only("polka"), ..options.clone() }).contains("genre=polka"));
    let e = error(EvaluateOptions { only: only("salsa"), fields: vec!["genre".into()], ..options.clone() });
    assert!(e.contains("one value"), "{e}");
    assert!(error(EvaluateOptions { exclude: Exclude::Choreography, ..options }).contains("`choreography`"));
}
