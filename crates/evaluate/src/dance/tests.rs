use super::compare::{MeasuredDance, Side};
use super::fidelity::fidelity;
use super::positions::JointPositions;
use super::{Dance, Reference};
use kinelm_corpus::samples::clip;
use kinelm_corpus::{Corpus, CorpusWriter, Split};
use kinelm_motion::metric::{FootContact, Skate, jitter_of};
use kinelm_motion::{Clip, synth};
use kinelm_tokenizer::{Tokenizer, TokenizerConfig};
use std::path::Path;

/// Two training dances, one for validation.
fn corpus(dir: &Path) -> Corpus {
    let dances: Vec<Clip> = synth::corpus(5, 3, 8.0, 20.0).unwrap().into_iter().map(|d| d.clip).collect();
    let tokenizer = Tokenizer::fit(&dances, TokenizerConfig::uniform(&[0, 4, 5, 18, 19], 20.0, 90)).unwrap();
    let mut writer = CorpusWriter::create(dir, &tokenizer, &["made".into()], None, false).unwrap();
    for (key, dance) in dances.iter().enumerate() {
        let words = tokenizer.encode(dance).unwrap().words;
        let split = if key == 2 { Split::Valid } else { Split::Train };
        let ids = tokenizer.ids_of_words(&words).unwrap();
        writer.push(clip(&format!("clip{key}"), key, split, dance.frames()), &ids).unwrap();
    }
    writer.finish().unwrap();
    Corpus::open(dir).unwrap()
}

#[test]
fn real_dances_freeze_in_one_percent_and_a_statue_in_all() {
    let dir = tempfile::tempdir().unwrap();
    let corpus = corpus(&dir.path().join("c"));
    let real = Reference::load(&corpus).unwrap();
    let mut statue = Dance::of_corpus(&corpus, &corpus.clips()[2]).unwrap();
    let first = statue.word_ids()[0].repeat(160);
    statue.words = corpus.tokenizer().words_of_ids(&first).words;
    // one word after the other: the step of the pelvis is in it, so that the statue glides
    statue = Dance::new("statue".into(), statue.words.clone(), 160, corpus.tokenizer()).unwrap();
    let report = real.report(&[statue.clone()]).unwrap();
    let [train, valid, dances, alone] = &report.groups[..] else { panic!("{report}") };
    let rate = train.world.freeze_rate.unwrap();
    assert!((0.009..0.3).contains(&rate) && train.world.frames == 320, "{rate}");
    assert_eq!((valid.world.frames, dances.world.frames, alone.name.as_str()), (160, 160, "statue"));
    assert_eq!((dances.pose.freeze_rate, dances.pose.median_time_to_freeze_s), (Some(1.0), Some(0.0)));
    // all but the first second of it came before
    assert_eq!(dances.repeat_rate, Some(121.0 / 141.0));
    let [train_clip, valid_clip] =
        [Split::Train, Split::Valid].map(|s| Dance::of_corpus(&corpus, corpus.split(s).next().unwrap()).unwrap());
    let clip = &valid_clip.clip;
    assert!((valid.jitter_m_s3.unwrap() / jitter_of(clip, &real.joints).unwrap() - 1.0).abs() < 1e-12);
    let skate = Skate::of(&real.feet, clip);
    assert_eq!((valid.skate_cm_s, valid.skate_share), (skate.cm_s(), skate.share()));
    assert_eq!(valid.pfc, FootContact::of(clip).unwrap().mean());
    let speeds = JointPositions::of(clip, &real.joints).speeds();
    let mean = 100.0 * speeds.iter().sum::<f64>() / speeds.len() as f64;
    assert!((valid.speed_cm_s.unwrap() / mean - 1.0).abs() < 1e-12);
    // a raised one floats, a lowered one is in the floor
    let at = |y: f64| {
        let clip = train_clip.clip.clone().raised(y);
        let moved = real.report(&[Dance { clip, ..train_clip.clone() }]).unwrap().groups.swap_remove(2);
        (moved.floating_share.unwrap(), moved.penetration_cm.unwrap())
    };
    assert!(at(1.0).0 > 0.9 && at(1.0).1 == 0.0, "{:?}", at(1.0));
    assert!(at(-1.5).1 > 80.0 && at(-1.5).0 == 0.0, "{:?}", at(-1.5));
    let text = report.to_string();
    assert!(text.contains("skate cm/s") && text.contains("in floor cm") && text.contains("floating %"), "{text}");
    assert!(text.contains("320 training frames") && text.contains("statue"), "{text}");

    let copy = Dance::of_corpus(&corpus, &corpus.clips()[0]).unwrap();
    let copied = real.copied(&[copy], &[]).unwrap();
    assert_eq!((copied.copy_rate, copied.longest_run_frames[0]), (Some(1.0), 160));
    assert!(copied.median_cm[0].unwrap() < 1e-9 && copied.limit_cm > copied.median_cm[0], "{copied}");
}

#[test]
fn a_page_leads_to_where_a_dance_stands_still_falls_and_copies() {
    let dir = tempfile::tempdir().unwrap();
    let corpus = corpus(&dir.path().join("c"));
    let real = Reference::load(&corpus).unwrap();
    let copy = Dance { name: "dances/made.bvh".into(), ..Dance::of_corpus(&corpus, &corpus.clips()[0]).unwrap() };
    // it stops for two seconds, 3 s from its beginning
    let (clip, j) = (&copy.clip, copy.clip.joints());
    let frame = |f: usize| if (60..100).contains(&f) { 60 } else { f };
    let root = (0..clip.frames()).map(|f| clip.root()[frame(f)]).collect();
    let rotations = (0..clip.frames()).flat_map(|f| clip.pose(frame(f)).to_vec()).collect();
    let stopped = Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations).unwrap();
    let made = Dance { clip: stopped, ..copy.clone() };
    let copied = real.copied(std::slice::from_ref(&copy), &[]).unwrap();
    let beside = real.beside(&made, None).unwrap();
    assert_eq!((beside.name.as_str(), j), ("clip2 (real)", 24), "the validation clip");
    // all clips of these corpora have one hash, so the first of them is found by it
    let own = real.beside(&made, Some(&corpus.clips()[0].sha256)).unwrap();
    assert_eq!((own.name.as_str(), &own.clip), ("clip0 (real)", &copy.clip));
    let page = real.page(&[&made, &beside], Some(&copied)).unwrap();
    for part in [
        "\"stands still for 1.",
        "fastest: ",
        "\"a copy: 0.0 cm\"",
        "least balanced: ",
        "left knee",
        "clip2 (real), left",
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("dances/made.bvh"), "folders have no room");
    let without = real.page(&[&made], None).unwrap();
    assert!(!without.contains("nearest training clip") && without.contains("Feet on the floor"));
}

/// Sixteen dances of two genres, which tokens of all big joints tell apart; every fifth is for tests.
fn genres(dir: &Path) -> Corpus {
    let dances = synth::corpus(3, 24, 12.0, 20.0).unwrap();
    let genres = [dances[0].genre, dances[1].genre];
    let dances: Vec<_> = dances.into_iter().filter(|d| genres.contains(&d.genre)).collect();
    let clips: Vec<Clip> = dances.iter().map(|d| d.clip.clone()).collect();
    let tokenizer =
        Tokenizer::fit(&clips, TokenizerConfig::uniform(&[0, 1, 2, 4, 5, 16, 17, 18, 19], 20.0, 90)).unwrap();
    let mut writer = CorpusWriter::create(dir, &tokenizer, &["made".into()], None, false).unwrap();
    for (key, dance) in dances.iter().enumerate() {
        let split = if key % 5 == 3 { Split::Test } else { Split::Train };
        let mut new = clip(&format!("clip{key}"), key, split, dance.clip.frames());
        let labels = [("genre".to_string(), dance.genre.to_string())].into();
        let ids = tokenizer.ids_of_words(&tokenizer.encode(&dance.clip).unwrap().words).unwrap();
        new.record.labels = labels;
        writer.push(new, &ids).unwrap();
    }
    writer.finish().unwrap();
    Corpus::open(dir).unwrap()
}

#[test]
fn a_genre_is_told_by_free_joints_and_not_by_a_wrong_word_for_it() {
    let dir = tempfile::tempdir().unwrap();
    let corpus = genres(&dir.path().join("c"));
    let test: Vec<_> = corpus.split(Split::Test).collect();
    let dances: Vec<Dance> = test.iter().map(|record| Dance::of_corpus(&corpus, record).unwrap()).collect();
    let asked = |wrong: bool| -> Vec<(&Dance, Option<String>)> {
        let of = |at: usize| {
            let label = test[at].labels["genre"].clone();
            let other = test.iter().map(|r| r.labels["genre"].clone()).find(|l| *l != label);
            if wrong { other } else { Some(label) }
        };
        dances.iter().enumerate().map(|(at, d)| (d, of(at))).collect()
    };
    let right = fidelity(&corpus, "genre", &[], &asked(false)).unwrap();
    let [.., real, made] = &right.groups[..] else { panic!("{right}") };
    assert_eq!((right.groups.len(), real.count()), (3, made.count()));
    assert!(real.count() == [2, 2] && !right.joints.contains(&0), "{right}");
    let wrong = fidelity(&corpus, "genre", &[16, 18], &asked(true)).unwrap();
    assert_eq!(wrong.groups[2].count(), [0, 2], "{wrong}");
    assert_eq!(wrong.joints, [1, 2, 4, 5, 17, 19]);
    let nothing: Vec<_> = dances.iter().map(|d| (d, None)).collect();
    let nothing = fidelity(&corpus, "genre", &[], &nothing).unwrap();
    assert_eq!((nothing.groups[2].count(), nothing.groups[2].left_out), ([0, 0], 2));
    assert!(nothing.to_string().contains("2 dances without a genre"), "{nothing}");
    let none = fidelity(&corpus, "genre", &[1, 2, 4, 5, 16, 17, 18, 19], &[]).unwrap_err().to_string();
    assert!(none.contains("all but the pelvis were given"), "{none}");
    let unknown = fidelity(&corpus, "mood", &[], &[]).unwrap_err().to_string();
    assert!(unknown.contains("mood") && unknown.contains("genre"), "{unknown}");
}

#[test]
fn a_set_that_is_sunk_differs_in_the_floor_alone() {
    let dir = tempfile::tempdir().unwrap();
    let corpus = genres(&dir.path().join("c"));
    let real = Reference::load(&corpus).unwrap();
    let train = real.each(Split::Train, |_, dance| Ok(dance.clone())).unwrap();
    let side = |name: &str, y: f64| {
        let dance = |(at, dance): (usize, &Dance)| MeasuredDance {
            dance: Dance { clip: dance.clip.clone().raised(y), ..dance.clone() },
            take: format!("take {at}"),
            in_training: at == 0,
            prompted: None,
        };
        Side { name: name.into(), dances: train.iter().take(8).enumerate().map(dance).collect() }
    };
    let found = real.compare(&[side("a", 0.0), side("b", -0.3)]).unwrap();
    assert!(found.paired && found.takes == [8, 8] && found.dances == [8, 8], "{found}");
    let row = |what: &str| found.rows.iter().find(|row| row.what == what).unwrap();
    let speed = row("speed, cm/s").difference.unwrap();
    assert!(speed.mean.abs() < 1e-9 && speed.interval.iter().all(|x| x.abs() < 1e-9), "{speed:?}");
    let floor = row("in the floor, cm").difference.unwrap();
    assert!(floor.interval[0] > 15.0, "{floor:?}");
    let text = found.to_string();
    assert!(text.contains("a: 1 of 8 dances are train clips") && text.contains('*'), "{text}");
    assert!(!found.rows.iter().any(|row| row.what.contains("prompt")) && !text.contains("-0.0"), "{text}");
    // other takes, half as long, of files at another rate
    let mut other = side("c", 0.0);
    for dance in &mut other.dances {
        dance.take.push('x');
        dance.dance.file_fps = Some(60.0);
        dance.dance.clip = dance.dance.clip.slice(0..dance.dance.clip.frames() / 2);
    }
    let mut first = side("a", 0.0);
    first.dances.iter_mut().for_each(|dance| dance.dance.file_fps = Some(20.0));
    let found = real.compare(&[first, other]).unwrap();
    assert!(!found.paired, "{found}");
    let text = found.doubts.join("\n");
    assert!(text.contains("of 20 and of 60 frames a second") && text.contains("in the mean: longer"), "{text}");
    assert!(!text.contains("repeat one"), "{text}");
    // one dance under many names
    let mut one = side("d", 0.0);
    one.dances = vec![one.dances[0].clone(); 8];
    let text = real.compare(&[one, side("a", 0.0)]).unwrap().doubts.join("\n");
    assert!(text.contains("d: only 1 of its 8 dances differ"), "{text}");
}
