//! The demo with music: dances made up at several tempi, each with the music of its score; a model conditioned on beats; and
//! a dance to music of a tempo outside its training data.

use super::{Args, MARK, tokenize, train, write_dances};
use crate::corpus::music::synth::music;
use crate::corpus::{Corpus, Split};
use crate::evaluate::dance::beats::{BeatMetrics, BeatPair, BeatScores, controls, of_corpus};
use crate::generate::open::{MUSIC_GUIDANCE, OpenRequest};
use crate::generate::request::{LeadInKind, Length, MusicRequest, Request, Seeding};
use crate::generate::sampling::Sampling;
use crate::generate::variation_seed;
use crate::model::likelihood::likelihood;
use crate::model::{CheckpointChoice, load_run};
use crate::shell::Say;
use crate::view::music::Music;
use crate::view::{Figure, Page};
use anyhow::{Context, Result};
use kinelm_motion::synth::{self, Dance};
use kinelm_motion::{Clip, Motion, format};
use kinelm_music::beat::{RATE, beats_of};
use kinelm_music::wav;
use kinelm_store::files::write_whole;
use std::path::{Path, PathBuf};
use std::time::Instant;

const SETTINGS: &str = "demo-music";
const CLIPS: usize = 84;
const SECONDS: f64 = 20.0;
const FPS: f64 = 30.0;
/// Beats a minute of the dances for training and validation, in turn.
const TRAIN_BPM: [f64; 8] = [80.0, 84.0, 97.0, 103.0, 117.0, 123.0, 137.0, 141.0];
/// Beats a minute of the test dances.
const TEST_BPM: [f64; 3] = [110.0, 90.0, 130.0];

pub fn run(args: &Args, started: Instant, say: Say) -> Result<()> {
    let at = |name: &str| args.out.join(name);
    say.line(format_args!("1/5 {CLIPS} dances of {SECONDS} s are made up, and played to"));
    let dances = compose(args)?;
    say.line("2/5 they become words, and the beats of their music are detected");
    let tokenizer = tokenize(args, Some(at("music")))?;
    say.line("3/5 a small model learns the language, conditioned on the beats");
    train(args, SETTINGS, say)?;
    say.line("4/5 it dances to music of tempi outside its training data");
    let (run, corpus) = (load_run(&at("run"), CheckpointChoice::Auto)?, Corpus::open(at("corpus"))?);
    // the last take of each pair, which `write_dances` gives to test
    let tests: Vec<&Dance> = dances.iter().skip(CLIPS - pairs()).collect();
    let pieces = tests.iter().map(|dance| piece(args, dance)).collect::<Result<Vec<_>>>()?;
    let all = |with_music: bool| -> Result<Vec<Clip>> {
        let dance = |(i, piece): (usize, &Piece)| danced(args, Some(piece).filter(|_| with_music), i);
        pieces.iter().enumerate().map(dance).collect()
    };
    let (made, free) = (all(true)?, all(false)?);
    format::write(&at("dance.bvh"), &Motion::new(at("dance.bvh"), made[0].clone()))?;
    say.line("5/5 page and report");
    let joints = tokenizer.channels().joints().to_vec();
    let (_, lag) = of_corpus(&corpus, &joints)?;
    page(&at("page.html"), [&tests[0].clip, &made[0]], &pieces[0], &joints, lag)?;
    let table = table(&tests, &made, &free, &pieces, &joints, lag)?;
    let clips: Vec<_> = corpus.split(Split::Test).collect();
    let conditions = run.load_conditions()?;
    let mut model = run.scores(args.compute.get())?;
    let mut bits = |conditions| -> Result<f64> {
        let found = likelihood(&mut *model, &corpus, &clips, 0, conditions)?;
        Ok(found.context("the demo's corpus has no test frame")?.bits_per_frame)
    };
    // the same model and frames: the difference is what the music is worth
    let bits = [bits(&conditions)?, bits(&conditions.unknown())?];
    let report = report(args, &table, bits, started.elapsed().as_secs_f64());
    write_whole(&at("report.md"), report.as_bytes())?;
    crate::shell::print(&report)?;
    let [page, dance] = ["page.html", "dance.bvh"].map(|name| at(name).display().to_string());
    say.line(format_args!("done: open {page} in a browser, and click to hear it; the dance is {dance}"));
    Ok(())
}

/// Dances of one take: a pair of genre and dancer each.
fn pairs() -> usize {
    synth::genres().count() * synth::dancers().count()
}

/// The dances, their labels and their music as files; the last take is for test and at tempi of its own.
fn compose(args: &Args) -> Result<Vec<Dance>> {
    let tempo = |i: usize| match i + pairs() >= CLIPS {
        true => TEST_BPM[i % TEST_BPM.len()],
        // another one of each pair in each take
        false => TRAIN_BPM[(i + i / pairs()) % TRAIN_BPM.len()],
    };
    let tempi: Vec<f64> = (0..CLIPS).map(tempo).collect();
    let dances = synth::corpus_at(args.seed, &tempi, SECONDS, FPS)?;
    write_dances(&args.out, &dances)?;
    for dance in &dances {
        let path = music_of(args, dance);
        std::fs::create_dir_all(path.parent().context("a folder")?)?;
        write_whole(&path, &wav::bytes(&music(dance, args.seed, RATE)?, RATE))?;
    }
    Ok(dances)
}

fn music_of(args: &Args, dance: &Dance) -> PathBuf {
    args.out.join("music").join(dance.genre).join(dance.name()).with_extension("wav")
}

/// Music that is danced to: its file, its detected beats.
struct Piece {
    path: PathBuf,
    beats_s: Vec<f64>,
}

fn piece(args: &Args, dance: &Dance) -> Result<Piece> {
    let beats_s = beats_of(&music(dance, args.seed, RATE)?).times_s;
    Ok(Piece { path: music_of(args, dance), beats_s })
}

/// A dance to a piece, or without music; `number` decides its seed.
fn danced(args: &Args, piece: Option<&Piece>, number: usize) -> Result<Clip> {
    let request = Request {
        guidance: piece.map(|_| MUSIC_GUIDANCE),
        music: piece.map(|piece| MusicRequest::of(&piece.path, None)),
        length: Some(Length::Seconds(SECONDS)),
        lead_in: Some(LeadInKind::None),
        seed: Some(variation_seed(args.seed, number)),
        // dances with and without music share their random numbers
        seeding: Some(Seeding::Seed),
        sampling: Sampling { top_p: Some(super::CALM), ..Sampling::default() },
        computing: Some(args.computing()),
        ..Request::of(args.out.join("run"))
    };
    Ok(OpenRequest::open(&request)?.make_one(Path::new("dance.bvh"))?.generated.motion.clip)
}

/// The beat alignment of dances with their music, and with other music.
fn table(
    tests: &[&Dance],
    made: &[Clip],
    free: &[Clip],
    pieces: &[Piece],
    joints: &[usize],
    lag: f64,
) -> Result<Vec<BeatMetrics>> {
    let pairs = |clips: Vec<&Clip>| -> Result<Vec<BeatPair>> {
        let pair = |(clip, piece): (&Clip, &Piece)| BeatPair::new(clip, joints, &piece.beats_s);
        Ok(clips.into_iter().zip(pieces).map(pair).collect::<crate::Result<_>>()?)
    };
    let [real, made, free] =
        [tests.iter().map(|dance| &dance.clip).collect(), made.iter().collect(), free.iter().collect()];
    // these rows twice: as they are, and against shifted music
    let made = pairs(made)?;
    let mut rows: Vec<BeatMetrics> = BeatMetrics::of("the real test dances", &pairs(real)?, lag).into_iter().collect();
    rows.extend(BeatMetrics::of("the model's, with music", &made, lag));
    rows.extend(controls("the same", &made, lag));
    rows.extend(BeatMetrics::of("the model's, without music", &pairs(free)?, lag));
    Ok(rows)
}

/// The test dance of the same music beside the model's, with the beats that their legs hit.
fn page(path: &Path, [real, made]: [&Clip; 2], piece: &Piece, joints: &[usize], lag: f64) -> Result<()> {
    let hits = |clip: &Clip| Ok::<_, crate::Error>(BeatPair::new(clip, joints, &piece.beats_s)?.hits(Some(lag)));
    let figures = [
        Figure::new("test", real).note("a made-up dance to this music, never trained on").hits(Some(hits(real)?)),
        Figure::new("dance", made).note("the model's, with its beats").hits(Some(hits(made)?)),
    ];
    let sound = kinelm_store::input::bytes(&piece.path).map_err(crate::Error::io(&piece.path))?;
    let music = Music::embedded(&piece.path, &sound, 0.0, piece.beats_s.clone());
    Ok(write_whole(path, Page::new(&figures).music(Some(&music)).html()?.as_bytes())?)
}

fn report(args: &Args, table: &[BeatMetrics], bits: [f64; 2], seconds: f64) -> String {
    let mut out = format!(
        "{MARK}, seed {}\n\n{CLIPS} made-up dances of {SECONDS} s at {} tempi, with music; the model dances to music at {} \
         beats a minute, which is outside its training data.\n\n\
         | against beats | dances | BA_motion | shifted music | z | BA_music | shifted music | z | in tempo |\n|---|--:|--:|--:|--:|--:|--:|--:|--:|\n",
        args.seed,
        TRAIN_BPM.len(),
        TEST_BPM.map(|bpm| bpm.to_string()).join(", "),
    );
    for BeatMetrics { name, dances, legs: BeatScores { scores, shifted, z, .. }, in_tempo, .. } in table {
        let z = z.map_or(["n/a".into(), "n/a".into()], |z| z.map(|z| format!("{z:.1}")));
        out += &format!(
            "| {name} | {dances} | {:.3} | {:.3} | {} | {:.3} | {:.3} | {} | {:.0} % |\n",
            scores[0],
            shifted[0],
            z[0],
            scores[1],
            shifted[1],
            z[1],
            100.0 * in_tempo
        );
    }
    let ([with_music, without], lag) = (bits, table.first().map_or(0.0, |row| row.lag));
    out + &format!(
        "\nBA, beat alignment of knees and ankles: 1 where they rest wherever the train dances would, {lag:.2} of a beat behind \
         each. *Shifted music* is what chance gives; z says how many standard deviations of chance the mean lies above it. In \
         tempo: the legs' speed peaks at the beat, its half or double, to 5 %.\n\nBits a frame of the test dances: {with_music:.1} with music \
         conditioning, {without:.1} without.\n\n`page.html` plays a dance with its music. {seconds:.0} s in all.\n"
    )
}
