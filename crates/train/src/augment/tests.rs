use super::*;
use crate::batches::Batches;
use crate::run::RunFile;
use crate::{Data, TrainConfig};
use kinelm_corpus::samples::clip as record;
use kinelm_corpus::{CorpusWriter, Split};
use kinelm_model::ModelConfig;
use kinelm_motion::rotation::angle_between;
use kinelm_motion::synth;
use kinelm_tokenizer::{DctConfig, LappedConfig, QuantileConfig, RootRotation, SchemeConfig, TokenizerConfig};
use std::path::Path;

const JOINTS: [usize; 4] = [0, 1, 2, 16];

/// Two dances of 12 s in a corpus.
fn corpus(dir: &Path, config: TokenizerConfig) -> Corpus {
    corpus_of(dir, config, 12.0)
}

fn corpus_of(dir: &Path, config: TokenizerConfig, seconds: f64) -> Corpus {
    let dances: Vec<_> = synth::corpus(7, 2, seconds, 20.0).unwrap().into_iter().map(|d| d.clip).collect();
    let tokenizer = Tokenizer::fit(&dances, config).unwrap();
    let mut writer = CorpusWriter::create(dir.join("corpus"), &tokenizer, &["made".into()], None, true).unwrap();
    for (key, dance) in dances.iter().enumerate() {
        let words = tokenizer.encode(dance).unwrap().words;
        let new = record(&format!("clip{key}"), key, Split::Train, dance.frames());
        writer.push(new, &tokenizer.ids_of_words(&words).unwrap()).unwrap();
    }
    writer.finish().unwrap();
    Corpus::open(dir.join("corpus")).unwrap()
}

fn uniform(root_rotation: RootRotation) -> TokenizerConfig {
    TokenizerConfig { root_rotation, ..TokenizerConfig::uniform(&JOINTS, 20.0, 360) }
}

/// How many of the `words` words from `first` on differ after `change`.
fn differ(corpus: &Corpus, first: usize, words: usize, change: &dyn Fn(Clip) -> Result<Clip>) -> usize {
    let clip = &corpus.clips()[0];
    let piece = Piece { corpus, clip, first, words, factor: 1.0 };
    let t = corpus.tokenizer();
    let read = |ids: &[u32]| t.words_of_ids(ids).words;
    let (new, old) = (piece.recoded(t, change).unwrap(), corpus.word_ids(clip, first..first + words).unwrap());
    let (new, old) = (read(&new), read(&old));
    assert_eq!(new.len(), old.len());
    new.iter().zip(old.iter()).filter(|(a, b)| a != b).count()
}

#[test]
fn windows_anywhere_keep_their_words_where_nothing_changes_and_where_they_are_mirrored_twice() {
    let dir = tempfile::tempdir().unwrap();
    let quantile = SchemeConfig::Quantile(QuantileConfig::default());
    let quantile = TokenizerConfig { scheme: quantile, ..TokenizerConfig::uniform(&JOINTS, 20.0, 360) };
    for config in [uniform(RootRotation::Absolute), uniform(RootRotation::HeadingDelta), quantile] {
        let corpus = corpus(dir.path(), config);
        let words = corpus.words(&corpus.clips()[0]).len();
        for first in [0, 1, 2, 77, 150, words - 12] {
            assert_eq!(differ(&corpus, first, 12, &Ok), 0, "{:?} from {first}", corpus.tokenizer().config());
            let twice = |c: Clip| mirror::mirrored(&mirror::mirrored(&c)?);
            assert_eq!(differ(&corpus, first, 12, &twice), 0, "in two mirrors from {first}");
            assert!(differ(&corpus, first, 12, &|c| mirror::mirrored(&c)) > 6, "in one mirror from {first}");
        }
    }
}

/// Tiles are rounded once more: how much that changes is in docs/training.md.
#[test]
fn tiles_that_are_coded_again_stay_near() {
    let dir = tempfile::tempdir().unwrap();
    for scheme in [SchemeConfig::Dct(DctConfig::default()), SchemeConfig::Lapped(LappedConfig::default())] {
        let config = TokenizerConfig { scheme, ..TokenizerConfig::uniform(&JOINTS, 20.0, 360) };
        let corpus = corpus_of(dir.path(), config, 60.0);
        let (clip, t) = (&corpus.clips()[0], corpus.tokenizer());
        let l = t.frames_per_word();
        let (mut differing, mut all) = (0, 0);
        for first in 0..corpus.words(clip).len() - 3 {
            differing += differ(&corpus, first, 3, &Ok);
            all += 3;
        }
        println!("words of {l} frames: {differing} of {all} differ");
        // what they say is near: rotations of the middle of a window, decoded in its surroundings
        let first = 7;
        let piece = Piece { corpus: &corpus, clip, first, words: 3, factor: 1.0 };
        let decode = |ids: &[u32]| t.decode(&t.words_of_ids(ids).words, UncodedPose::Identity).unwrap();
        let (new, old) =
            (decode(&piece.recoded(t, &Ok).unwrap()), decode(&corpus.word_ids(clip, first..first + 3).unwrap()));
        let angles: f64 = new.rotations().iter().zip(old.rotations()).map(|(a, b)| angle_between(*a, *b)).sum();
        let degrees = (angles / (new.frames() * JOINTS.len()) as f64).to_degrees();
        println!("words of {l} frames: {degrees:.3} degrees apart");
        assert!(degrees < 2.0, "{degrees}");
    }
}

/// The batches of a run on `corpus` with this augmentation.
fn batches<'a>(data: &'a Data, augment: AugmentConfig, train: &TrainConfig) -> Batches<'a> {
    let model = ModelConfig { context: 200, ..Default::default() };
    let file = RunFile { augment, ..RunFile::new(&model, train, data).unwrap() };
    Batches::of_run(&file, data).unwrap()
}

#[test]
fn shares_are_held_and_threads_change_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let data = Data::one(corpus(dir.path(), uniform(RootRotation::Absolute))).unwrap();
    let train = TrainConfig { batch: 400, ..Default::default() };
    let all = AugmentConfig { mirror: 0.5, heading: true, speed: 0.1, drop_joints: 0.3, history_noise: 2.0 };
    let plain = batches(&data, AugmentConfig::default(), &train).batch(1).unwrap();
    let mirrored = batches(&data, AugmentConfig { mirror: 0.5, ..Default::default() }, &train).batch(1).unwrap();
    let changed = plain.targets.chunks(200).zip(mirrored.targets.chunks(200)).filter(|(a, b)| a != b).count();
    // four standard deviations of a binomial: 40
    assert!(changed.abs_diff(200) < 40, "{changed} of 400 windows are mirrored");
    let count = |t: &[u32]| t.iter().filter(|&&id| id != 0).count();
    assert_eq!(count(&plain.targets), count(&mirrored.targets), "a mirror takes no word");
    let found = batches(&data, all, &train).batch(1).unwrap();
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(one.install(|| batches(&data, all, &train).batch(1).unwrap()), found);
    assert_ne!(batches(&data, all, &TrainConfig { seed: 2, ..train.clone() }).batch(1).unwrap().inputs, found.inputs);
    assert_eq!(found.clips, plain.clips);
    // every other window faces another way
    let differ = plain.targets.chunks(200).zip(found.targets.chunks(200)).filter(|(a, b)| a != b).count();
    assert!(differ > 395, "{differ}");
}

#[test]
fn dropped_joints_are_hidden_in_the_whole_window_and_never_asked_about() {
    let dir = tempfile::tempdir().unwrap();
    let data = Data::one(corpus(dir.path(), uniform(RootRotation::Absolute))).unwrap();
    let (word, train) = (16, TrainConfig { batch: 400, ..Default::default() });
    let plain = batches(&data, AugmentConfig::default(), &train).batch(0).unwrap();
    let found = batches(&data, AugmentConfig { drop_joints: 0.5, ..Default::default() }, &train).batch(0).unwrap();
    let mut windows = 0;
    let rows = |b: &'_ crate::batches::Batch| -> Vec<(Vec<u32>, Vec<u32>)> {
        b.inputs.chunks(200).zip(b.targets.chunks(200)).map(|(i, t)| (i.to_vec(), t.to_vec())).collect()
    };
    for ((inputs, targets), (whole, asked)) in rows(&found).into_iter().zip(rows(&plain)) {
        let mut hidden: Vec<usize> =
            inputs[1..].iter().enumerate().filter(|(_, id)| **id == 3).map(|(k, _)| k % word).collect();
        hidden.sort_unstable();
        hidden.dedup();
        windows += usize::from(!hidden.is_empty());
        // the root's translation and rotation and the space stay; of three joints one is hidden
        assert!(hidden.is_empty() || (hidden.len() == 3 && hidden[0] >= 6 && hidden[2] < 15), "{hidden:?}");
        for k in 0..199 {
            let is_hidden = hidden.contains(&(k % word));
            assert_eq!(inputs[k + 1], if is_hidden && whole[k + 1] != 0 { 3 } else { whole[k + 1] });
            assert_eq!(targets[k], if is_hidden { 0 } else { asked[k] });
        }
    }
    assert!(windows.abs_diff(200) < 40, "{windows}");
}

#[test]
fn faster_windows_at_a_clips_end_are_shorter_and_others_keep_their_length() {
    let dir = tempfile::tempdir().unwrap();
    let corpus = corpus(dir.path(), uniform(RootRotation::Absolute));
    let clip = &corpus.clips()[0];
    let words = corpus.words(clip).len();
    let length = |first: usize, factor: f64| {
        let piece = Piece { corpus: &corpus, clip, first, words: 12, factor };
        piece.recoded(corpus.tokenizer(), &Ok).unwrap().len() / 16
    };
    assert_eq!((length(40, 1.25), length(40, 0.8), length(words - 12, 0.8)), (12, 12, 12));
    // 12 frames and the one before them in 4/5 of the time
    assert_eq!(length(words - 12, 1.25), 9);
}

#[test]
fn what_makes_no_sense_is_refused_with_the_reason() {
    let dir = tempfile::tempdir().unwrap();
    let said = |tokenizer: TokenizerConfig, config: AugmentConfig| {
        let corpus = corpus(dir.path(), tokenizer);
        Augment::new(&config, corpus.tokenizer(), 1).map(|a| a.is_some()).map_err(|e| e.to_string())
    };
    let drop = AugmentConfig { drop_joints: 0.1, ..Default::default() };
    let turn = AugmentConfig { heading: true, ..Default::default() };
    assert_eq!(said(uniform(RootRotation::Absolute), AugmentConfig::default()), Ok(false));
    assert_eq!(said(uniform(RootRotation::Absolute), drop), Ok(true));
    assert!(said(uniform(RootRotation::HeadingDelta), turn).unwrap_err().contains("the same for every heading"));
    let tiles = SchemeConfig::Dct(DctConfig::default());
    let tiles = TokenizerConfig { scheme: tiles, ..uniform(RootRotation::Absolute) };
    assert!(said(tiles, drop).unwrap_err().starts_with("augment.drop_joints: no joint can be hidden"));
    let root = TokenizerConfig::uniform(&[0], 20.0, 60);
    assert!(said(root, drop).unwrap_err().contains("codes the root alone"));
}

#[test]
#[ignore = "prints frames a second of one thread, of windows with and without changes"]
fn how_fast_windows_are_changed() {
    let dir = tempfile::tempdir().unwrap();
    let joints = kinelm_motion::joints::THIRTEEN;
    let quiet = AugmentConfig::default();
    let all = AugmentConfig { mirror: 0.5, heading: false, speed: 0.1, drop_joints: 0.3, history_noise: 2.0 };
    let lapped =
        TokenizerConfig { scheme: SchemeConfig::Lapped(LappedConfig::default()), ..TokenizerConfig::default() };
    for (name, config) in [("uniform", TokenizerConfig::uniform(&joints, 20.0, 360)), ("lapped", lapped)] {
        let data = Data::one(corpus_of(dir.path(), config, 60.0)).unwrap();
        let tokens = data.tokens();
        let all = AugmentConfig { drop_joints: if tokens.varying { 0.0 } else { 0.3 }, ..all };
        let train = TrainConfig { batch: 200, ..Default::default() };
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        for augment in [quiet, all] {
            let model = ModelConfig { context: 1024, ..Default::default() };
            let file = RunFile { augment, ..RunFile::new(&model, &train, &data).unwrap() };
            let mut batches = Batches::of_run(&file, &data).unwrap();
            let started = std::time::Instant::now();
            let batch = one.install(|| batches.batch(0).unwrap());
            let frames = batch.counted(0) as f64 / data.tokens_per_frame();
            println!("{name}, {augment:?}: {:.0} frames/s", frames / started.elapsed().as_secs_f64());
        }
    }
}
