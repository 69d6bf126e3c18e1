use super::*;
use crate::augment::AugmentConfig;
use crate::config::Masking;
use crate::fixture;
use kinelm_model::ModelConfig;
use kinelm_tokenizer::UncodedPose;

/// Without conditions.
fn of(data: &Data, context: usize, batch: usize, seed: u64) -> Result<Batches<'_>> {
    Batches::new(data, context, &TrainConfig { batch, seed, ..Default::default() })
}

#[test]
fn a_pass_has_every_stretch_once_and_steps_come_in_any_order() {
    let dir = tempfile::tempdir().unwrap();
    let data =
        Data::one(fixture::corpus(dir.path(), &[(30, Split::Train), (3, Split::Train), (9, Split::Valid)])).unwrap();
    // W = 7, T = 36: 5 whole words; 6 stretches of the first clip, one of the second
    let mut batches = of(&data, 36, 2, 5).unwrap();
    assert_eq!(batches.pass(), 7);
    let steps: Vec<Batch> = (0..7).map(|s| batches.batch(s).unwrap()).collect();
    for pass in 0..2 {
        let windows = steps.iter().flat_map(|b| &b.clips).skip(7 * pass).take(7);
        let mut starts: Vec<(String, usize)> = windows
            .map(|c| c.split_once(" from frame ").map(|(n, f)| (n.to_string(), f.parse().unwrap())).unwrap())
            .collect();
        starts.sort();
        // 26 starts in 6 stretches
        for (i, (name, frame)) in starts[..6].iter().enumerate() {
            assert_eq!(name, "clip0");
            assert!((26 * i / 6..26 * (i + 1) / 6).contains(frame), "{starts:?}");
        }
        assert_eq!(starts[6], ("clip1".to_string(), 0));
    }
    assert_eq!(batches.batch(3).unwrap(), steps[3]);
    assert_ne!(of(&data, 36, 2, 6).unwrap().batch(0).unwrap(), steps[0]);
}

#[test]
fn windows_start_at_a_frame_after_bos_and_short_clips_are_padded() {
    let dir = tempfile::tempdir().unwrap();
    let data = Data::one(fixture::corpus(dir.path(), &[(3, Split::Train)])).unwrap();
    let corpus = &data.parts()[0].corpus;
    let batch = of(&data, 36, 1, 5).unwrap().batch(0).unwrap();
    let ids = corpus.clip_ids(&corpus.clips()[0]).unwrap();
    assert_eq!(batch.targets[..21], ids);
    assert!(batch.targets[21..].iter().all(|&t| t == 0));
    assert_eq!(batch.inputs[0], 1);
    assert_eq!(batch.inputs[1..22], ids);
}

#[test]
fn windows_of_words_of_any_length_start_at_words_and_a_pass_sees_nearly_all() {
    let dir = tempfile::tempdir().unwrap();
    let data =
        Data::one(fixture::merged(dir.path(), &[(200, Split::Train), (3, Split::Train), (50, Split::Valid)])).unwrap();
    let corpus = &data.parts()[0].corpus;
    let clip = &corpus.clips()[0];
    // the second context is shorter than a word
    for context in [40, 3] {
        let mut batches = of(&data, context, 1, 5).unwrap();
        assert_eq!(batches.pass(), clip.tokens.div_ceil(context) + corpus.clips()[1].tokens.div_ceil(context));
        let (mut inside, mut seen) = (0, vec![false; clip.tokens]);
        for step in 0..4 * batches.pass() as u64 {
            let batch = batches.batch(step).unwrap();
            let (name, frame) = batch.clips[0].split_once(" from frame ").unwrap();
            if name != "clip0" {
                continue;
            }
            let word = frame.parse().unwrap();
            let (from, to) = (corpus.words(clip).start(word), corpus.words(clip).start(word + 1));
            let ids: Vec<u32> = batch.targets.iter().copied().filter(|&id| id != 0).collect();
            let start =
                (from..to).find(|&s| corpus.ids(clip, s..clip.tokens.min(s + context)).unwrap() == ids).unwrap();
            assert!(start == from || to - from > context, "{} from token {start}", batch.clips[0]);
            inside += usize::from(start > from);
            assert!(ids.len() == context || start + ids.len() == clip.tokens);
            seen[start..start + ids.len()].fill(true);
        }
        assert_eq!(inside > 0, context == 3);
        let share = seen.iter().filter(|s| **s).count() as f64 / clip.tokens as f64;
        assert!(share > 0.9, "context {context}: {share} of the tokens in four passes");
    }
}

#[test]
fn a_pass_takes_each_corpus_as_often_as_its_weight() {
    let dir = tempfile::tempdir().unwrap();
    let corpora = [("a", 30), ("b", 50)].map(|(name, frames)| {
        std::fs::create_dir(dir.path().join(name)).unwrap();
        fixture::corpus(&dir.path().join(name), &[(frames, Split::Train), (9, Split::Train)])
    });
    let [a, b] = corpora;
    let counts = |weights: [f64; 2], passes: std::ops::Range<u64>| {
        let parts = [&a, &b].map(|c| Corpus::open(c.dir()).unwrap()).into_iter().zip(weights);
        let parts = parts.map(|(corpus, weight)| Part { corpus, weight }).collect();
        let data = Data::of(parts, None, &[]).unwrap();
        let mut batches = of(&data, 36, 1, 5).unwrap();
        let pass = batches.pass() as u64;
        let mut counts = vec![0; 20];
        for place in passes.start * pass..passes.end * pass {
            counts[batches.window(place).number] += 1;
        }
        (pass, counts)
    };
    assert_eq!(counts([1.0, 1.0], 3..4), (20, vec![1; 20]));
    assert_eq!(counts([1.0, 3.0], 1..2), (8 + 36, [vec![1; 8], vec![3; 12]].concat()));
    // 25 % of 8 windows: each comes once in four passes; 50 % of 12: once in two
    assert_eq!(counts([0.25, 0.5], 0..4), (2 + 6, [vec![1; 8], vec![2; 12]].concat()));
    let (_, once) = counts([0.25, 0.5], 0..1);
    assert_eq!((once[..8].iter().sum::<i32>(), once[8..].iter().sum::<i32>()), (2, 6));
    // 1.5 times 8 and 12: no window comes more than twice
    let (pass, found) = counts([1.5, 1.5], 1..2);
    assert_eq!((pass, found[..8].iter().sum::<i32>(), found.iter().max()), (12 + 18, 12, Some(&2)));
    assert_eq!(counts([1e-3, 1.0], 0..8).1[..8], [1; 8]);
}

#[test]
fn labels_precede_windows_and_a_share_of_them_is_hidden() {
    let dir = tempfile::tempdir().unwrap();
    let corpus = fixture::corpus(dir.path(), &[(30, Split::Train), (40, Split::Train)]);
    let fields = ["dancer", "genre"].map(String::from);
    let data = Data::of(vec![Part { corpus, weight: 1.0 }], None, &fields).unwrap();
    // ids after the 10 characters, in the order of the fields
    assert_eq!(data.tokenizer().vocabulary().conditioning(), ["<genre:a>", "<genre:b>", "<dancer:61>"]);
    let windows = |label_dropout: f64, batch| {
        let train = TrainConfig { batch, label_dropout, ..Default::default() };
        Batches::new(&data, 37, &train).unwrap().batch(0).unwrap()
    };
    // T = 37 with three in front: 35 tokens of words, 5 whole ones
    let batch = windows(0.0, 14);
    for (i, (input, target)) in batch.inputs.chunks(37).zip(batch.targets.chunks(37)).enumerate() {
        let genre = if batch.clips[i].starts_with("clip0") { 16 } else { 17 };
        assert_eq!(input[..3], [1, genre, 18]);
        assert_eq!((target[..2].to_vec(), &target[2..36]), (vec![0, 0], &input[3..]));
        assert_eq!(target.iter().filter(|&&id| id == 5).count(), 5, "{target:?}");
    }
    let hidden = windows(0.1, 10_000);
    let plain = windows(0.0, 10_000);
    assert_eq!((&hidden.targets, &hidden.clips), (&plain.targets, &plain.clips));
    let fronts = |b: &Batch, place: usize| b.inputs.chunks(37).filter(|w| w[place] == 4).count();
    assert_eq!((fronts(&plain, 1), fronts(&plain, 2)), (0, 0));
    // four standard deviations of a binomial: 120; of both at once: 40
    for place in [1, 2] {
        assert!(fronts(&hidden, place).abs_diff(1000) < 120, "{}", fronts(&hidden, place));
    }
    let both = hidden.inputs.chunks(37).filter(|w| w[1..3] == [4, 4]).count();
    assert!(both.abs_diff(100) < 40, "{both}");
}

#[test]
fn windows_are_read_after_the_frames_before_them_but_for_a_share() {
    let dir = tempfile::tempdir().unwrap();
    let data = Data::one(fixture::turning(dir.path(), &[(90, Split::Train)])).unwrap();
    let corpus = &data.parts()[0].corpus;
    let word = data.tokenizer().tokens_per_word().unwrap();
    let two_level = kinelm_model::Architecture::TwoLevel;
    let model = ModelConfig { architecture: two_level, window: Some(10), ..Default::default() };
    let train = TrainConfig { batch: 900, ..Default::default() };
    let ids = corpus.clip_ids(&corpus.clips()[0]).unwrap();
    let drawn = |augment: AugmentConfig, history_dropout: f64| {
        let train = TrainConfig { history_dropout, ..train.clone() };
        let run = RunFile { augment, ..RunFile::new(&model, &train, &data).unwrap() };
        Batches::of_run(&run, &data).unwrap().batch(0).unwrap()
    };
    let of = |augment: AugmentConfig| drawn(augment, train.history_dropout);
    assert!(drawn(AugmentConfig::default(), 1.0).history.iter().all(|id| *id == 0));
    let batch = of(AugmentConfig::default());
    let all = model.history() * word;
    assert_eq!(batch.history.len(), 900 * all);
    let mut hidden = 0;
    for (i, clip) in batch.clips.iter().enumerate() {
        let start: usize = clip.split_once(" from frame ").unwrap().1.parse().unwrap();
        let found = &batch.history[i * all..][..all];
        assert_eq!(batch.targets[i * 10 * word..][..10 * word], ids[start * word..][..10 * word]);
        match found.iter().all(|id| *id == 0) {
            true => hidden += usize::from(start > 0),
            false => assert_eq!(found, scored_windows::history(&ids[..start * word], all, 0)),
        }
    }
    // four standard deviations of a binomial: 36; some windows begin with the clip
    assert!(hidden.abs_diff(88) < 40, "{hidden}");
    // mirrored with their windows: the same clip in the mirror
    let mirrored = of(AugmentConfig { mirror: 1.0, ..Default::default() });
    let clip = data.tokenizer().decode(&data.tokenizer().words_of_ids(&ids).words, UncodedPose::Identity).unwrap();
    let other = data.tokenizer().encode(&kinelm_motion::mirror::mirror(&clip).unwrap()).unwrap().words;
    let other = data.tokenizer().ids_of_words(&other).unwrap();
    let i = batch.clips.iter().position(|clip| clip.ends_with(" 40")).unwrap();
    assert_eq!(mirrored.targets[i * 10 * word..][..10 * word], other[40 * word..50 * word]);
    if batch.history[i * all] != 0 {
        assert_eq!(mirrored.history[i * all..][..all], other[(40 - model.history()) * word..40 * word]);
    }
}

#[test]
fn targets_of_a_masked_model_are_the_masked_tokens() {
    let dir = tempfile::tempdir().unwrap();
    let data = Data::one(fixture::corpus(dir.path(), &[(30, Split::Train), (3, Split::Train)])).unwrap();
    let train = TrainConfig { batch: 7, ..Default::default() };
    let model = ModelConfig { kind: ModelKind::Masked, context: 36, ..Default::default() };
    let run = RunFile::new(&model, &train, &data).unwrap();
    let found = Batches::of_run(&run, &data).unwrap().batch(0).unwrap();
    let plain = of(&data, 35, 7, 1).unwrap().batch(0).unwrap();
    assert_eq!((found.length(), &found.clips), (36, &plain.clips));
    let rows = found.inputs.chunks(36).zip(found.targets.chunks(36));
    for ((input, target), whole) in rows.zip(plain.targets.chunks(35)) {
        let n = whole.iter().filter(|id| **id != 0).count();
        // of 35 tokens, and of the 21 of the short clip
        let expected = if n == 35 { 6 } else { 4 };
        assert_eq!(target.iter().filter(|id| **id != 0).count(), expected);
        for i in 1..36 {
            let own = whole[i - 1];
            assert!(target[i] == 0 && input[i] == own || target[i] == own && [own, 3].contains(&input[i]));
        }
    }
    let again = Batches::of_run(&run, &data).unwrap().batch(1).unwrap();
    assert_ne!(again.targets, found.targets);
}

#[test]
fn spans_are_hidden_in_half_of_the_windows() {
    let dir = tempfile::tempdir().unwrap();
    let data = Data::one(fixture::turning(dir.path(), &[(30, Split::Train)])).unwrap();
    let train = TrainConfig { batch: 400, masking: Masking::Spans, ..Default::default() };
    let word = data.tokenizer().tokens_per_word().unwrap();
    let context = 1 + 10 * word;
    let model = ModelConfig { kind: ModelKind::Masked, context, ..Default::default() };
    let run = RunFile::new(&model, &train, &data).unwrap();
    let found = Batches::of_run(&run, &data).unwrap().batch(0).unwrap();
    let rows = found.inputs.chunks(context).zip(found.targets.chunks(context));
    // a target in sight, or a space, is one of the 15 %; one of them is in all but a few of those windows
    let is_random = |(input, target): (&[u32], &[u32])| {
        (0..context).any(|i| target[i] != 0 && (input[i] != 3 || target[i] == kinelm_tokenizer::SPACE))
    };
    let random = rows.filter(|row| is_random(*row)).count();
    // four standard deviations of a binomial: 40
    assert!(random.abs_diff(200) < 40, "{random} of 400");
}

#[test]
fn a_corpus_without_training_clips_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let data = Data::one(fixture::corpus(dir.path(), &[(3, Split::Test)])).unwrap();
    assert!(of(&data, 36, 1, 5).err().unwrap().to_string().contains("no training clip"));
}
