//! `kinelm evaluate dance`.

use crate::cli::read::ReadArgs;
use crate::cli::{Say, WrongCall, print};
use anyhow::Result;
use kinelm::corpus::Corpus;
use kinelm::evaluate::dance::prompted::prompted;
use kinelm::evaluate::dance::{Dance, Real};
use kinelm::generate::prompt::given_places;
use kinelm::generate::provenance::{self, Provenance};
use kinelm_motion::format::{ReadOptions, RestFrame, input};
use kinelm_motion::joints;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Dances: motion files of any rig. What FILE.bvh.kinelm.json tells of a prompt is looked at
    #[arg(required = true, value_name = "FILE")]
    dances: Vec<PathBuf>,
    /// The corpus of the real ones: its tokenizer codes all, its train clips give the thresholds, its valid clips stand
    /// beside
    #[arg(long, value_name = "CORPUS")]
    real: PathBuf,
    /// Look for copies of training clips too, which takes longer
    #[arg(long)]
    copying: bool,
    /// Fréchet distances and diversities of kinetic and geometric features too
    #[arg(long)]
    features: bool,
    /// How the dances keep to these beats, a time in seconds a line; if not given, to those of --music, or of the music that
    /// each dance was made to
    #[arg(long, value_name = "FILE", conflicts_with = "music")]
    beats: Option<PathBuf>,
    /// How the dances keep to the beats of this music
    #[arg(long, value_name = "FILE")]
    music: Option<PathBuf>,
    /// The time of the music, or of the beats, when the dances begin, such as 12.5s
    #[arg(long, value_name = "SECONDS", default_value = "0s", value_parser = crate::cli::view::seconds_with_unit)]
    music_from: f64,
    /// One JSON object instead of tables
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    let corpus = corpus(&args.real)?;
    let tokenizer = corpus.tokenizer();
    let real = Real::load(&corpus)?;
    let options = args.read.options(RestFrame::Drop);
    let dances = args.dances.iter().map(|path| Dance::of_file(path, &as_told(path, &options), tokenizer));
    let dances: Vec<Dance> = dances.collect::<kinelm::Result<_>>()?;
    let mut report = real.report(&dances);
    let mut given: Option<Vec<bool>> = None;
    let mut best = BTreeMap::<usize, usize>::new();
    let beats = beats(args)?;
    let mut music_s = Vec::new();
    for (path, dance) in args.dances.iter().zip(&dances) {
        let recipe = match provenance::find(path) {
            Ok(told) => told.map(|told| {
                told.best.iter().for_each(|of| *best.entry(of.of).or_default() += 1);
                told.recipe
            }),
            Err(e) => {
                say.line(e);
                None
            }
        };
        music_s.push(match (&beats, recipe.as_ref().and_then(|recipe| recipe.music.as_ref())) {
            (None, Some(told)) => Some(behind(&heard(&told.path)?, told.from_s)),
            (beats, _) => beats.clone(),
        });
        let followed = recipe.as_ref().and_then(|r| r.prompt.as_ref()?.joints.as_ref());
        let places = followed.and_then(|list| given_places(tokenizer, &joints::parse(list).ok()?).ok());
        // what was given to one dance alone may be a copy in the others
        let places = places.unwrap_or_default();
        given = Some(given.map_or(places.clone(), |given| if given == places { given } else { Vec::new() }));
        match recipe.map(|recipe| prompted(dance, path, &recipe, tokenizer)).transpose() {
            Ok(found) => report.prompted.extend(found.flatten().map(|found| (dance.name.clone(), found))),
            Err(e) => say.line(format_args!("{}: its prompt is not looked at: {e}", path.display())),
        }
    }
    for (of, dances) in best {
        say.line(format_args!("{dances} of these {} dances were chosen among {of} each", args.dances.len()));
    }
    if args.copying {
        report.copied = Some(real.copied(&dances, &given.unwrap_or_default())?);
    }
    if music_s.iter().any(Option::is_some) {
        report.beats = real.beats(&corpus, &dances, &music_s)?;
    }
    if args.features {
        report.features = real.features(&corpus, &dances)?;
    }
    print(&if args.json { format!("{}\n", serde_json::to_string(&report)?) } else { format!("{report}\n") })
}

/// The corpus that `--real` names.
pub fn corpus(real: &Path) -> Result<Corpus> {
    if !real.join("corpus.json").exists() {
        let what = format!("--real {}: no corpus.json; expected a corpus, as kinelm tokenize makes it", real.display());
        return Err(WrongCall(what).into());
    }
    Ok(Corpus::open(real)?)
}

/// The beats that all dances are held to, if the call names any, seconds from their first frame.
fn beats(args: &Args) -> Result<Option<Vec<f64>>> {
    let found = match (&args.beats, &args.music) {
        (Some(path), _) => {
            let text = input::text(path).map_err(kinelm::Error::io(path))?;
            let beats = kinelm::music::beats::parse(path, &text)?;
            if beats.len() < 2 {
                let what = format!("--beats {}: {} beats; expected two or more", path.display(), beats.len());
                return Err(WrongCall(what).into());
            }
            Some(beats)
        }
        (None, Some(path)) => Some(heard(path)?),
        (None, None) => None,
    };
    Ok(found.map(|beats| behind(&beats, args.music_from)))
}

/// The beats of a piece.
fn heard(path: &Path) -> Result<Vec<f64>> {
    let beats = kinelm_music::beat::beats(path).map_err(kinelm::Error::from)?.times_s;
    match beats.len() {
        0 | 1 => Err(WrongCall(format!("{}: {} beats; is it silent?", path.display(), beats.len())).into()),
        _ => Ok(beats),
    }
}

/// Beats from another time on.
fn behind(beats_s: &[f64], from_s: f64) -> Vec<f64> {
    beats_s.iter().map(|beat| beat - from_s).collect()
}

/// The options of a call for one file: of a dance of ours, its recipe says what the call leaves open.
fn as_told(path: &Path, call: &ReadOptions) -> ReadOptions {
    let told = Provenance::load(&provenance::path_of(path)).ok();
    let told = told.filter(|told| told.output.file == provenance::name_of(path));
    told.map_or(call.clone(), |told| told.recipe.measured(path, call.clone()))
}
