//! Training on synthetic dances and their music: it learns, it resumes to the same bits, it uses the music, and it refuses
//! what can't be learned from.

use super::*;
use crate::Changes;
use crate::data::Sources;
use crate::music_lstm::config::{Audio, Effort, Pose};
use crate::music_lstm::evaluate::{Options, evaluate};
use crate::music_lstm::run::Trained;
use crate::train::Event;
use kinelm_corpus::music::synth::music;
use kinelm_model::run::{OPTIMIZER, WEIGHTS};
use kinelm_model::{CheckpointChoice, Keep};
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::{Motion, synth};
use kinelm_music::wav;
use kinelm_train::Branch;
use std::fs;
use std::sync::atomic::Ordering;

/// Some dances in a folder with their music beside them, and what a small run takes of them.
fn place(dir: &Path, fps: f64) -> (Config, MusicSources) {
    let (data, songs) = (dir.join("data"), dir.join("songs"));
    [&data, &songs].into_iter().for_each(|folder| fs::create_dir(folder).unwrap());
    let mut labels = "clip,split,genre\n".to_owned();
    for (i, dance) in synth::corpus(3, 4, 3.0, fps).unwrap().into_iter().enumerate() {
        let path = data.join(format!("{i}.json"));
        let sound = music(&dance, 3, 16_000).unwrap();
        fs::write(songs.join(format!("{i}.wav")), wav::bytes(&sound, 16_000)).unwrap();
        let motion = Motion::new(&path, dance.clip);
        format::write(&path, &motion).unwrap();
        labels += &format!("{i},{},{}\n", ["train", "train", "train", "test"][i], dance.genre);
    }
    let csv = dir.join("labels.csv");
    fs::write(&csv, labels).unwrap();
    let config = Config {
        encoder: vec![8],
        width: 12,
        layers: 2,
        length: 12,
        batch: 3,
        margin: 2,
        steps: 7,
        learning_rate: 3e-3,
        checkpoint_every: 3,
        keep: Keep::Last(2),
        ..Config::default()
    };
    let labels = vec![csv.to_string_lossy().into_owned()];
    let motion = Sources { data: vec![data], labels, only: vec![], read: ReadOptions::default() };
    (config, MusicSources { music: songs, motion })
}

fn go(run: &Path, start: &Start, stop_after: u64) -> Result<(Summary, Vec<f64>)> {
    let stop = AtomicBool::new(stop_after == 0);
    let mut losses = Vec::new();
    let summary = train(run, start, &stop, &mut |event| {
        if let Event::Step(metrics, _) = event {
            losses.push(metrics.loss);
            stop.store(losses.len() as u64 >= stop_after, Ordering::Relaxed);
        }
    })?;
    Ok((summary, losses))
}

#[test]
fn a_stopped_run_resumes_to_the_same_bits() {
    let dir = tempfile::tempdir().unwrap();
    let (config, places) = place(dir.path(), 60.0);
    let new = Start::New(Config { effort: Effort::Corrected, effort_every: 2, ..config }, places.clone());
    let (whole, parts) = (dir.path().join("whole"), dir.path().join("parts"));
    let (done, losses) = go(&whole, &new, 99).unwrap();
    assert_eq!((done.step, done.stopped, losses.len()), (7, false, 7));
    let (first, found) = go(&parts, &new, 4).unwrap();
    assert_eq!((first.step, first.stopped), (4, true));
    // another number of threads, and updates after the last checkpoint are repeated
    fs::remove_dir_all(parts.join("checkpoints/step-00000004")).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    let (second, more) = pool.install(|| go(&parts, &Start::Resume(Changes::default()), 99)).unwrap();
    assert_eq!((found, second.step, &more[..]), (losses[..4].to_vec(), 7, &losses[3..]));
    for name in [WEIGHTS, OPTIMIZER] {
        let read = |run: &Path| fs::read(run.join("checkpoints/step-00000007").join(name)).unwrap();
        assert!(read(&whole) == read(&parts), "{name}");
    }
    // other music under the same name
    let song = places.music.join("1.wav");
    fs::copy(places.music.join("0.wav"), &song).unwrap();
    let message = go(&parts, &Start::Resume(Changes::default()), 1).unwrap_err().to_string();
    assert!(message.contains("songs/1.wav: found SHA-256 "), "{message}");
}

#[test]
fn a_run_is_measured_writes_dances_and_goes_on_from_an_earlier_checkpoint() {
    let dir = tempfile::tempdir().unwrap();
    let (config, mut places) = place(dir.path(), 60.0);
    let csv = dir.path().join("held.csv");
    fs::write(&csv, "clip,split\n0,train\n1,train\n2,valid\n3,test\n").unwrap();
    places.motion.labels = vec![csv.to_string_lossy().into_owned()];
    let config = Config { effort: Effort::Corrected, effort_every: 2, keep: Keep::All, ..config };
    let [plain, watched, branch] = ["plain", "watched", "branch"].map(|name| dir.path().join(name));
    go(&plain, &Start::New(config.clone(), places.clone()), 99).unwrap();
    let new = Start::New(Config { eval_every: 4, sample_every: 6, ..config }, places);
    go(&watched, &new, 99).unwrap();
    let weights = |run: &Path| fs::read(run.join("checkpoints/step-00000007").join(WEIGHTS)).unwrap();
    assert!(weights(&plain) == weights(&watched), "watching changes nothing");
    let lines = fs::read_to_string(watched.join("metrics.jsonl")).unwrap();
    let lines: Vec<serde_json::Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let (valid, steps): (Vec<_>, Vec<_>) = lines.iter().partition(|line| line["kind"] == "valid");
    assert_eq!(valid.iter().map(|line| line["step"].as_u64().unwrap()).collect::<Vec<_>>(), [4, 7]);
    for line in valid.iter().map(|line| &line["valid"]).chain(steps.iter().copied()) {
        let of = |key: &str| line[key].as_f64().unwrap_or(0.0);
        assert!((of("loss") - of("root") - of("rotations") - of("effort")).abs() < 1e-9 && of("root") > 0.0, "{line}");
    }
    // every second update has an effort, and all measurements
    let has = |lines: &[&serde_json::Value]| lines.iter().filter(|line| line.to_string().contains("effort")).count();
    assert_eq!((has(&steps), has(&valid)), (3, 2));
    let sample = fs::read_to_string(watched.join("samples/step-00000006.bvh")).unwrap();
    // the valid clip has 3 s
    assert!(sample.contains("Frames: ") && watched.join("samples/step-00000006.html").is_file());
    let from = Branch { step: 3, run: branch.clone() };
    go(&watched, &Start::Resume(Changes { branch: Some(from), ..Changes::default() }), 99).unwrap();
    assert!(weights(&branch) == weights(&watched));
    let origin = RunFile::read(&branch).unwrap().from.unwrap();
    assert_eq!((origin.path, origin.step), (watched, 3));
}

#[test]
fn losses_fall_for_all_terms() {
    let all = [
        (Pose::Aligned, Effort::None, Audio::Fixed),
        (Pose::Compat, Effort::Compat, Audio::Compat),
        (Pose::None, Effort::Corrected, Audio::Fixed),
        (Pose::None, Effort::Compat, Audio::Fixed),
    ];
    let dir = tempfile::tempdir().unwrap();
    let (config, places) = place(dir.path(), 30.0);
    for (i, (pose, effort, audio)) in all.into_iter().enumerate() {
        let config = Config { pose, effort, audio, effort_every: 1, steps: 60, learning_rate: 1e-2, ..config.clone() };
        let (_, losses) = go(&dir.path().join(format!("run{i}")), &Start::New(config, places.clone()), 99).unwrap();
        let mean = |some: &[f64]| some.iter().sum::<f64>() / some.len() as f64;
        assert!(mean(&losses[50..]) < 0.7 * mean(&losses[..5]), "{pose:?} {effort:?}: {losses:?}");
    }
}

#[test]
fn batches_are_true_frames_with_the_music_of_their_time() {
    let dir = tempfile::tempdir().unwrap();
    let (config, places) = place(dir.path(), 60.0);
    let recordings = Recordings::load(&places.motion, config.margin, None).unwrap();
    let clips = MusicClips::load(&recordings, &places, config.audio, config.margin, is_used(&config)).unwrap();
    let ([all, _], short) = sequence_clips(clips, &config).unwrap();
    assert!(all.len() == 3 && short.is_empty(), "the test dance isn't learned from");
    let (b, c) = (config.batch, 4 * recordings.rig.joints());
    let seen = batch(&all, c, &config, 5);
    assert!(seen.truth == batch(&all, c, &config, 5).truth && seen.truth != batch(&all, c, &config, 6).truth);
    assert_eq!(seen.previous[b * c..], seen.truth[..seen.truth.len() - b * c]);
    let share = |teacher: f64| batch(&all, c, &Config { teacher, length: 80, ..config.clone() }, 0).forced;
    assert!(share(0.0).iter().all(|t| !t) && share(1.0).iter().all(|t| *t));
    let some = share(0.3).iter().filter(|t| **t).count();
    // 80 * 0.3 = 24, and three standard deviations of 4.1 around it
    assert!((12..37).contains(&some), "{some}");
    for i in 0..b {
        let (dance, row) = (&all[seen.clips[i]], |t: usize| &seen.truth[(t * b + i) * c..][..c]);
        let first = dance.poses.chunks_exact(c).position(|pose| pose == row(0)).unwrap();
        for t in 0..config.length {
            assert_eq!(row(t), &dance.poses[(first + 2 * t) * c..][..c]);
            // the margin is two frames, so that frame 0 is 1/30 s into the music
            let at = (first + 2 * t).div_ceil(2);
            let spectrum = &seen.spectra[(t * b + i) * SPECTRUM..][..SPECTRUM];
            let near = [at, at.saturating_sub(1)].map(|s| &dance.spectra[s * SPECTRUM..][..SPECTRUM] == spectrum);
            assert!(near.contains(&true), "step {t}");
        }
    }
}

#[test]
fn the_music_decides_the_dance() {
    let dir = tempfile::tempdir().unwrap();
    let (config, places) = place(dir.path(), 30.0);
    let config = Config { steps: 150, learning_rate: 1e-2, dropout: 0.0, ..config };
    let run = dir.path().join("run");
    go(&run, &Start::New(config, places), 999).unwrap();
    let trained = Trained::load(&run, CheckpointChoice::Auto).unwrap();
    let options = Options { split: Split::Test, frames: 300, cutoff_hz: 6.0 };
    let report = evaluate(&trained, &options, &mut |_| ()).unwrap();
    let of = |music: &str| &report.rows.iter().find(|r| r.split == "train" && r.music == music).unwrap().metrics;
    assert!(of("none: the true dances").degrees.mean < 1e-3);
    let (own, other) = (of("the clips' own"), of("other clips'"));
    assert!(own.worse_degrees.is_none() && own.degrees.mean > 0.0, "{own:?}");
    assert!(other.from_own_degrees.unwrap().mean > 0.01, "{other:?}");
    assert_eq!(report.long.frames, 300);
    // the same in pieces
    let spectra: Vec<f32> = (0..120 * SPECTRUM).map(|i| (i as f32 * 0.01).sin()).collect();
    let (long, short) = (trained.dance(&spectra).unwrap(), trained.dance(&spectra[..70 * SPECTRUM]).unwrap());
    assert!(long.rotations()[..short.rotations().len()] == *short.rotations());
}

#[test]
fn what_can_not_be_learned_from_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let (config, places) = place(dir.path(), 30.0);
    let run = dir.path().join("run");
    let said = |config: &Config, places: &MusicSources| {
        go(&run, &Start::New(config.clone(), places.clone()), 1).unwrap_err().to_string()
    };
    let none = MusicSources { music: dir.path().join("none"), ..places.clone() };
    assert!(said(&config, &none).contains("found no folder, expected one that holds music"));
    let empty = dir.path().join("empty");
    fs::create_dir(&empty).unwrap();
    let message = said(&config, &MusicSources { music: empty, ..places.clone() });
    assert!(message.contains("no clip with music in ") && message.contains("4 without"), "{message}");
    let message = said(&Config { length: 400, ..config.clone() }, &places);
    assert!(message.contains("no training clip with music and 401 frames at 30 a second; 3 are shorter"), "{message}");
    // the margin of two frames is 0.07 s
    let song = places.music.join("1.wav");
    fs::write(&song, wav::bytes(&vec![0.0; 64_000], 16_000)).unwrap();
    let message = said(&config, &places);
    assert!(message.contains("1.wav: found silence from 0.07 s"), "{message}");
    let click: Vec<f32> = (0..16_000).map(|i| (i as f32 * 0.3).sin()).collect();
    fs::write(&song, wav::bytes(&click, 16_000)).unwrap();
    let message = said(&config, &places);
    assert!(message.contains("1.wav: found 0.93 s of music after 0.07 s, expected"), "{message}");
    fs::write(&song, "no sound").unwrap();
    assert!(said(&config, &places).contains("1.wav"));
    assert!(!run.exists(), "nothing is left of a run that was refused");
}
