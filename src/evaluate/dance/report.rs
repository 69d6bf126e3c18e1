//! Dances held to real ones.

use super::beats::{self, Kept};
use super::copying::{Track, longest_run, nearest};
use super::features::{Features, features};
use super::freeze::{Freezing, Summary, energy, summary, threshold};
use super::places::Places;
use super::prompted::Prompted;
use super::repeat::repeats;
use crate::corpus::load::parse_placed;
use crate::corpus::{ClipRecord, Corpus, Split};
use crate::{Error, Result};
use kinelm_motion::format::{self, Format, ReadOptions};
use kinelm_motion::metric::{Feet, Ground, Skate, jitter_of, physical_foot_contact};
use kinelm_motion::retarget::SkeletonMap;
use kinelm_motion::{Clip, smpl};
use kinelm_tokenizer::{Rest, SPACE, Tokenizer, Words};
use rayon::prelude::*;
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// A dance, coded and decoded.
#[derive(Debug, Clone)]
pub struct Dance {
    /// Its name.
    pub name: String,
    /// Decoded, on SMPL-24.
    pub clip: Clip,
    /// Its words.
    pub words: Words,
    ids: Vec<u32>,
}

impl Dance {
    /// A clip of a corpus.
    ///
    /// # Errors
    /// Words that are not the tokenizer's.
    pub fn of_corpus(corpus: &Corpus, record: &ClipRecord) -> Result<Dance> {
        let (words, tokenizer) = (corpus.clip_words(record)?, corpus.tokenizer());
        Dance::new(record.name.clone(), words, record.frames, tokenizer)
    }

    /// A motion file.
    ///
    /// # Errors
    /// What reading, retargeting and coding fail with; no frames.
    pub fn of_file(path: &Path, options: &ReadOptions, tokenizer: &Tokenizer) -> Result<Dance> {
        Format::of(path)?; // refused by its name before it is read
        let bytes = format::input::bytes(path).map_err(Error::io(path))?;
        Dance::of_bytes(path, &bytes, options, tokenizer)
    }

    /// The same of a file's bytes.
    ///
    /// # Errors
    /// Those of [`Dance::of_file`].
    pub fn of_bytes(path: &Path, bytes: &[u8], options: &ReadOptions, tokenizer: &Tokenizer) -> Result<Dance> {
        let clip = parse_placed(path, bytes, options, tokenizer.config().into())?.lowered();
        if clip.frames() == 0 {
            return Err(Error::file(path, "no frames", "at least one", ""));
        }
        let words = tokenizer.encode(&clip)?.words;
        Dance::new(path.display().to_string(), words, clip.frames(), tokenizer)
    }

    fn new(name: String, words: Words, frames: usize, tokenizer: &Tokenizer) -> Result<Dance> {
        let clip = tokenizer.decode(&words, Rest::Identity)?;
        let clip = clip.slice(0..frames.min(clip.frames()));
        let ids = tokenizer.ids_of_words(&words)?;
        Ok(Dance { name, clip, words, ids })
    }

    /// Ids of each word, with its space.
    fn word_ids(&self) -> Vec<&[u32]> {
        self.ids.split_inclusive(|&id| id == SPACE).collect()
    }
}

/// Real dances, and the thresholds measured from them.
pub struct Real {
    pub(super) train: Vec<Dance>,
    pub(super) valid: Vec<Dance>,
    pub(super) joints: Vec<usize>,
    feet: Feet,
    pub(super) fps: f64,
    frames_per_word: usize,
    /// In the world, and of the pose alone, cm/s.
    thresholds: [f64; 2],
}

/// The figures of one dance.
#[derive(Debug, Clone)]
struct Figures {
    world: Freezing,
    pose: Freezing,
    repeats: [usize; 2],
    ground: Ground,
    skate: Skate,
    /// Sums over the frames that have one: m/s, m/s^3.
    speed: Mean,
    jitter: Mean,
    pfc: Option<f64>,
}

/// The figures of several dances.
#[derive(Debug, Clone, Serialize)]
pub struct Group {
    /// What they are.
    pub name: String,
    /// In the world.
    pub world: Summary,
    /// Of the pose alone: the pelvis at 0, the heading removed.
    pub pose: Summary,
    /// Share of frames whose next second of tokens came in the ten seconds before; `None` of dances under a second.
    pub repeat_rate: Option<f64>,
    /// Mean depth of the lowest foot in the floor beyond 2 cm, cm.
    pub penetration_cm: Option<f64>,
    /// Share of frames in which it is as deep.
    pub penetration_share: Option<f64>,
    /// Share of frames that hang in the air and are in no jump.
    pub floating_share: Option<f64>,
    /// Mean horizontal speed of foot joints that stand, cm/s.
    pub skate_cm_s: Option<f64>,
    /// Share of those steps that are faster than 10 cm/s.
    pub skate_share: Option<f64>,
    /// Physical foot contact, mean over the dances; see [`physical_foot_contact`].
    pub pfc: Option<f64>,
    /// Mean speed of the coded joints, cm/s.
    pub speed_cm_s: Option<f64>,
    /// Mean jerk of the coded joints, m/s^3.
    pub jitter_m_s3: Option<f64>,
}

/// A mean over frames that adds up over clips.
#[derive(Debug, Clone, Copy, Default)]
struct Mean {
    sum: f64,
    frames: usize,
}

impl Mean {
    /// Of `frames` frames, or of nothing.
    fn of(mean: Option<f64>, frames: usize) -> Mean {
        mean.map_or(Mean::default(), |mean| Mean { sum: mean * frames as f64, frames })
    }

    fn over<'a>(all: impl Iterator<Item = &'a Mean>) -> Option<f64> {
        let (sum, frames) = all.fold((0.0, 0), |(sum, frames), m| (sum + m.sum, frames + m.frames));
        (frames > 0).then(|| sum / frames as f64)
    }
}

/// Distances to the nearest training window.
#[derive(Debug, Clone, Serialize)]
pub struct Copied {
    /// Windows of the dances, and of the validation clips.
    pub windows: [usize; 2],
    /// Median distance to the nearest training window of both, cm.
    pub median_cm: [Option<f64>; 2],
    /// First percentile of the validation clips' distances, cm.
    pub limit_cm: Option<f64>,
    /// Share of the dances' windows that are nearer than that.
    pub copy_rate: Option<f64>,
    /// The longest run of frames that a dance, and that a validation clip, has in common with a training clip, token by
    /// token.
    pub longest_run_frames: [usize; 2],
}

/// All figures.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// The layout's version.
    pub schema: u32,
    /// The joints that the tokenizer codes and that are measured, SMPL ids.
    pub joints: Vec<usize>,
    /// Frames per second.
    pub fps: f64,
    /// A frame with no more stands still, cm/s: the first percentile over the real training frames.
    pub threshold_cm_s: f64,
    /// The same of the pose alone.
    pub pose_threshold_cm_s: f64,
    /// The real training and validation clips, the dances together, each dance.
    pub groups: Vec<Group>,
    /// What the dances made of their prompts, by name.
    pub prompted: Vec<(String, Prompted)>,
    /// Whether they are copies, where that was asked for.
    pub copied: Option<Copied>,
    /// Clouds of features beside those of the real train clips, where that was asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub features: Vec<Features>,
    /// How real clips and dances keep to the beats of their music, where there is any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub beats: Vec<Kept>,
}

impl Real {
    /// The training and the validation clips of a corpus.
    ///
    /// # Errors
    /// A corpus without a training frame; words that can't be decoded.
    pub fn load(corpus: &Corpus) -> Result<Real> {
        let records: Vec<_> = corpus.split(Split::Train).chain(corpus.split(Split::Valid)).collect();
        let load = |record: &&ClipRecord| Ok((record.split, Dance::of_corpus(corpus, record)?));
        let all: Vec<(Split, Dance)> = records.par_iter().map(load).collect::<Result<_>>()?;
        let (train, valid): (Vec<_>, Vec<_>) = all.into_iter().partition(|(split, _)| *split == Split::Train);
        let [train, valid] = [train, valid].map(|all| all.into_iter().map(|(_, dance)| dance).collect::<Vec<_>>());
        let joints = corpus.tokenizer().channels().joints().to_vec();
        let fit = |places: fn(&Clip, &[usize]) -> Places| {
            threshold(train.par_iter().flat_map_iter(|d| energy(&places(&d.clip, &joints))).collect())
        };
        let (Some(world), Some(pose)) = (fit(Places::of), fit(Places::of_pose)) else {
            return Err(Error::file(
                corpus.dir(),
                "no training frame",
                "some, for the thresholds",
                "see --labels of tokenize",
            ));
        };
        let (fps, frames_per_word) = (corpus.tokenizer().fps(), corpus.tokenizer().frames_per_word());
        let feet = feet(&joints)?;
        Ok(Real { train, valid, joints, feet, fps, frames_per_word, thresholds: [world, pose] })
    }

    /// The figures of dances beside those of the real ones.
    pub fn report(&self, dances: &[Dance]) -> Report {
        let each: Vec<Figures> = dances.par_iter().map(|d| self.figures(d)).collect();
        let all = |dances: &[Dance]| dances.par_iter().map(|d| self.figures(d)).collect::<Vec<_>>();
        let mut groups =
            vec![group("train", &all(&self.train)), group("valid", &all(&self.valid)), group("dances", &each)];
        groups.extend(dances.iter().zip(&each).map(|(d, f)| group(&d.name, std::slice::from_ref(f))));
        Report {
            schema: 1,
            joints: self.joints.clone(),
            fps: self.fps,
            threshold_cm_s: self.thresholds[0],
            pose_threshold_cm_s: self.thresholds[1],
            groups,
            prompted: Vec::new(),
            copied: None,
            features: Vec::new(),
            beats: Vec::new(),
        }
    }

    fn figures(&self, dance: &Dance) -> Figures {
        let freezing = |places: Places, x: f64| Freezing::of(&energy(&places), self.fps, x);
        Figures {
            world: freezing(Places::of(&dance.clip, &self.joints), self.thresholds[0]),
            pose: freezing(Places::of_pose(&dance.clip, &self.joints), self.thresholds[1]),
            repeats: repeats(&dance.word_ids(), self.frames_per_word, self.fps),
            ground: self.ground(&dance.clip),
            skate: Skate::of(&self.feet, &dance.clip),
            speed: {
                let speeds = Places::of(&dance.clip, &self.joints).speeds();
                Mean { sum: speeds.iter().sum(), frames: speeds.len() }
            },
            jitter: Mean::of(jitter_of(&dance.clip, &self.joints), dance.clip.frames().saturating_sub(3)),
            pfc: physical_foot_contact(&dance.clip).ok().flatten(),
        }
    }

    /// How a decoded dance stands on its floor, which coding has put to y = 0.
    fn ground(&self, clip: &Clip) -> Ground {
        let pelvis: Vec<f64> = clip.root().iter().map(|p| p.y).collect();
        Ground::of(&self.feet.least(clip), &pelvis, self.fps)
    }

    /// Features of dances, and of the real clips that no dance was learned from, beside those of the real train clips.
    ///
    /// # Errors
    /// What coding, resampling and features fail with.
    pub fn features(&self, corpus: &Corpus, dances: &[Dance]) -> Result<Vec<Features>> {
        let test: Vec<Dance> =
            corpus.split(Split::Test).map(|record| Dance::of_corpus(corpus, record)).collect::<Result<_>>()?;
        features(&self.train, &[("valid", &self.valid), ("test", &test), ("dances", dances)])
    }

    /// How dances keep to the beats of their music (seconds from their first frame), beside the real clips of a corpus.
    ///
    /// # Errors
    /// What decoding and resampling fail with.
    pub fn beats(&self, corpus: &Corpus, dances: &[Dance], music_s: &[Option<Vec<f64>>]) -> Result<Vec<Kept>> {
        let (real, lag) = beats::of_corpus(corpus, &self.joints)?;
        Ok(real.into_iter().chain(beats::of_dances(dances, music_s, &self.joints, lag)?).collect())
    }

    /// Whether dances are copies of training clips; `given`: the places of a word that were given to all of them.
    ///
    /// # Errors
    /// Clips that can't be mirrored.
    pub fn copied(&self, dances: &[Dance], given: &[bool]) -> Result<Copied> {
        let both = |d: &Dance| Track::both(&d.clip, &self.joints);
        let training: Vec<Track> = self.train.par_iter().map(both).collect::<Result<Vec<_>>>()?.concat();
        let distances = |dances: &[Dance]| {
            let mut all: Vec<f64> =
                dances.iter().flat_map(|d| nearest(&Track::of(&d.clip, &self.joints), &training)).collect();
            all.sort_by(f64::total_cmp);
            all
        };
        let (found, reference) = (distances(dances), distances(&self.valid));
        let limit = super::percentile(&reference, 0.01);
        let copies = limit.map(|limit| found.iter().filter(|d| **d < limit).count());
        let words: Vec<Vec<&[u32]>> = self.train.iter().map(Dance::word_ids).collect();
        let run = |dances: &[Dance]| {
            let longest = dances.iter().map(|d| longest_run(&d.word_ids(), &words, given)).max();
            longest.unwrap_or(0) * self.frames_per_word
        };
        Ok(Copied {
            windows: [found.len(), reference.len()],
            median_cm: [super::percentile(&found, 0.5), super::percentile(&reference, 0.5)],
            limit_cm: limit,
            copy_rate: copies.filter(|_| !found.is_empty()).map(|n| n as f64 / found.len() as f64),
            longest_run_frames: [run(dances), run(&self.valid)],
        })
    }
}

/// The feet of the model's body as far as they are coded: of the thirteen joints the ankles. Where none is, the ankles.
pub(super) fn feet(joints: &[usize]) -> Result<Feet> {
    let map = SkeletonMap::builtin("smpl").ok_or_else(|| Error::Call("no skeleton map smpl".into()))?;
    let mut feet = Feet::new(&smpl::neutral(), &map)?;
    let coded = feet.joints.iter().any(|(j, _)| joints.contains(j));
    feet.joints.retain(|(j, _)| if coded { joints.contains(j) } else { matches!(j, 7 | 8) });
    Ok(feet)
}

fn group(name: &str, all: &[Figures]) -> Group {
    let of = |part: fn(&Figures) -> &Freezing| summary(&all.iter().map(|f| part(f).clone()).collect::<Vec<_>>());
    let (found, of_all) = all.iter().fold((0, 0), |(a, b), f| (a + f.repeats[0], b + f.repeats[1]));
    let mut ground = Ground::default();
    let mut skate = Skate::default();
    all.iter().for_each(|f| {
        ground.add(&f.ground);
        skate.add(&f.skate);
    });
    Group {
        name: name.into(),
        world: of(|f| &f.world),
        pose: of(|f| &f.pose),
        repeat_rate: (of_all > 0).then(|| found as f64 / of_all as f64),
        penetration_cm: ground.penetration_cm(),
        penetration_share: ground.penetration_share(),
        floating_share: ground.floating_share(),
        skate_cm_s: skate.cm_s(),
        skate_share: skate.share(),
        pfc: Mean::over(all.iter().filter_map(|f| f.pfc).map(|x| Mean::of(Some(x), 1)).collect::<Vec<_>>().iter()),
        speed_cm_s: Mean::over(all.iter().map(|f| &f.speed)).map(|m_s| 100.0 * m_s),
        jitter_m_s3: Mean::over(all.iter().map(|f| &f.jitter)),
    }
}

impl Report {
    /// A row of `cells` a group, without a line end after the last.
    fn table(&self, f: &mut fmt::Formatter<'_>, heads: &[&str], cells: impl Fn(&Group) -> Vec<String>) -> fmt::Result {
        write!(f, "{:<32}", "")?;
        heads.iter().try_for_each(|head| write!(f, " {head:>11}"))?;
        for group in &self.groups {
            write!(f, "\n{:<32}", shortened(&group.name))?;
            cells(group).iter().try_for_each(|cell| write!(f, " {cell:>11}"))?;
        }
        Ok(())
    }
}

impl fmt::Display for Report {
    /// Tables, without a line end after the last.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (j, fps) = (self.joints.len(), self.fps);
        let frames = self.groups.first().map_or(0, |train| train.world.frames);
        writeln!(
            f,
            "{j} joints at {fps} fps; a frame stands still up to the first percentile of {frames} training frames:"
        )?;
        writeln!(
            f,
            "{:.3} cm/s in the world, {:.3} cm/s of the pose alone",
            self.threshold_cm_s, self.pose_threshold_cm_s
        )?;
        let percent = |x: Option<f64>| x.map_or("n/a".into(), |x| format!("{:.2}", 100.0 * x));
        let number = |x: Option<f64>, digits: usize| x.map_or("n/a".into(), |x| format!("{x:.digits$}"));
        self.table(f, &["frames", "freeze %", "(sd)", "pose %", "to freeze s", "never %", "repeat %"], |group| {
            let w = &group.world;
            vec![
                w.frames.to_string(),
                percent(w.freeze_rate),
                percent(w.freeze_rate_sd),
                percent(group.pose.freeze_rate),
                w.median_time_to_freeze_s.map_or(format!("> {:.0}", w.duration_s[1]), |t| format!("{t:.1}")),
                percent(w.never),
                percent(group.repeat_rate),
            ]
        })?;
        writeln!(f)?;
        let heads =
            ["speed cm/s", "jitter m/s3", "skate cm/s", "skating %", "in floor cm", "in floor %", "floating %", "PFC"];
        self.table(f, &heads, |group| {
            vec![
                number(group.speed_cm_s, 1),
                number(group.jitter_m_s3, 0),
                number(group.skate_cm_s, 1),
                percent(group.skate_share),
                number(group.penetration_cm, 2),
                percent(group.penetration_share),
                percent(group.floating_share),
                number(group.pfc, 2),
            ]
        })?;
        write!(f, "\nfreeze % of every 5 s:")?;
        for group in self.groups.iter().take(3).filter(|g| g.world.dances > 0) {
            write!(f, "\n{:<32}", shortened(&group.name))?;
            group.world.per_5_s.iter().take(24).try_for_each(|x| write!(f, " {:.1}", 100.0 * x))?;
        }
        for (name, p) in &self.prompted {
            let (name, joints) = (shortened(name), &p.joints);
            let (mismatch, cm) = (100.0 * p.mismatch, p.given_mpjpe_cm);
            write!(
                f,
                "\n{name:<32} follows {joints}: {mismatch:.4} % of its characters differ, places {cm:.2} cm apart"
            )?;
            if let Some(x) = p.free_jitter {
                write!(f, "; free joints: jitter {:.2} of the prompt's", x)?;
            }
            if let Some(x) = p.free_skate {
                write!(f, ", skate {:.2} of the prompt's", x)?;
            }
            if let Some(c) = p.coordination {
                write!(f, "; coordination {:.3}, shifted {:.3}, effect {:.3}", c.correlation, c.shifted, c.effect)?;
            }
        }
        if let Some(Kept { lag, .. }) = self.beats.first() {
            write!(f, "\n\n{:<32}{}", "all joints, on the beat", beats::HEADS)?;
            self.beats.iter().try_for_each(|kept| write!(f, "\n{:<32}{}", shortened(&kept.name), kept.all))?;
            let way = format!("knees, ankles, {lag:.2} of a beat on");
            write!(f, "\n\n{way:<32}{} in tempo %", beats::HEADS)?;
            self.beats.iter().try_for_each(|kept| {
                write!(f, "\n{:<32}{} {:>10.0}", shortened(&kept.name), kept.legs, 100.0 * kept.in_tempo)
            })?;
        }
        self.features.iter().try_for_each(|features| write!(f, "\n\n{features}"))?;
        self.copied.as_ref().map_or(Ok(()), |copied| write!(f, "\n{copied}"))
    }
}

impl fmt::Display for Copied {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let cm = |x: Option<f64>| x.map_or("n/a".into(), |x| format!("{x:.2} cm"));
        let rate = self.copy_rate.map_or("n/a".into(), |x| format!("{:.2} %", 100.0 * x));
        let ([n, m], [a, b]) = (self.windows, self.median_cm.map(cm));
        writeln!(f, "windows of 2 s to the nearest of training: median {a} of {n}, of validation {b} of {m}")?;
        writeln!(f, "copies, nearer than {} as 1 % of validation: {rate}", cm(self.limit_cm))?;
        let [dances, valid] = self.longest_run_frames;
        write!(f, "longest run of a training clip's tokens: {dances} frames, of validation {valid}")
    }
}

/// The end of a long name.
fn shortened(name: &str) -> String {
    let skip = name.chars().count().saturating_sub(32);
    name.chars().skip(skip).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::corpus::CorpusWriter;
    use crate::corpus::samples::clip;
    use kinelm_motion::synth;
    use kinelm_tokenizer::TokenizerConfig;

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
        let real = Real::load(&corpus).unwrap();
        let mut statue = Dance::of_corpus(&corpus, &corpus.clips()[2]).unwrap();
        let first = statue.word_ids()[0].repeat(160);
        statue.words = corpus.tokenizer().words_of_ids(&first).words;
        // one word after the other: the step of the pelvis is in it, so that the statue glides
        statue = Dance::new("statue".into(), statue.words.clone(), 160, corpus.tokenizer()).unwrap();
        let report = real.report(&[statue.clone()]);
        let [train, valid, dances, alone] = &report.groups[..] else { panic!("{report}") };
        let rate = train.world.freeze_rate.unwrap();
        assert!((0.009..0.3).contains(&rate) && train.world.frames == 320, "{rate}");
        assert_eq!((valid.world.frames, dances.world.frames, alone.name.as_str()), (160, 160, "statue"));
        assert_eq!((dances.pose.freeze_rate, dances.pose.median_time_to_freeze_s), (Some(1.0), Some(0.0)));
        // all but the first second of it came before
        assert_eq!(dances.repeat_rate, Some(121.0 / 141.0));
        let clip = &real.valid[0].clip;
        assert!((valid.jitter_m_s3.unwrap() / jitter_of(clip, &real.joints).unwrap() - 1.0).abs() < 1e-12);
        let skate = Skate::of(&real.feet, clip);
        assert_eq!((valid.skate_cm_s, valid.skate_share), (skate.cm_s(), skate.share()));
        assert_eq!(valid.pfc, physical_foot_contact(clip).unwrap());
        let speeds = Places::of(clip, &real.joints).speeds();
        let mean = 100.0 * speeds.iter().sum::<f64>() / speeds.len() as f64;
        assert!((valid.speed_cm_s.unwrap() / mean - 1.0).abs() < 1e-12);
        // one that hangs floats, one that has sunk is in the floor
        let at = |y: f64| {
            let clip = real.train[0].clip.clone().raised(y);
            let moved = real.report(&[Dance { clip, ..real.train[0].clone() }]).groups.swap_remove(2);
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
}
