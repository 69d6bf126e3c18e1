//! `kinelm evaluate dance`.

use crate::cli::read::ReadArgs;
use crate::cli::{Say, WrongCall, print};
use anyhow::Result;
use kinelm::corpus::Corpus;
use kinelm::evaluate::dance::prompted::prompted;
use kinelm::evaluate::dance::{Dance, Real};
use kinelm::generate::prompt::given_places;
use kinelm::generate::provenance::{self, Provenance};
use kinelm_motion::format::{ReadOptions, RestFrame};
use kinelm_motion::joints;
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
    /// One JSON object instead of tables
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    if !args.real.join("corpus.json").exists() {
        let what =
            format!("--real {}: no corpus.json; expected a corpus, as kinelm tokenize makes it", args.real.display());
        return Err(WrongCall(what).into());
    }
    let corpus = Corpus::open(&args.real)?;
    let tokenizer = corpus.tokenizer();
    let real = Real::load(&corpus)?;
    let options = args.read.options(RestFrame::Drop);
    let dances = args.dances.iter().map(|path| {
        let options = ReadOptions { floor: options.floor.or_else(|| floor_of(path)), ..options.clone() };
        Dance::of_file(path, &options, tokenizer)
    });
    let dances: Vec<Dance> = dances.collect::<kinelm::Result<_>>()?;
    let mut report = real.report(&dances);
    let mut given: Option<Vec<bool>> = None;
    for (path, dance) in args.dances.iter().zip(&dances) {
        let recipe = match provenance::find(path) {
            Ok(told) => told.and_then(|told| told.recipe.prompt),
            Err(e) => {
                say.line(e);
                None
            }
        };
        let places =
            recipe.as_ref().and_then(|r| given_places(tokenizer, &joints::parse(r.joints.as_ref()?).ok()?).ok());
        // what was given to one dance alone may be a copy in the others
        let places = places.unwrap_or_default();
        given = Some(given.map_or(places.clone(), |given| if given == places { given } else { Vec::new() }));
        match recipe.map(|recipe| prompted(dance, &recipe, tokenizer)).transpose() {
            Ok(found) => report.prompted.extend(found.flatten().map(|found| (dance.name.clone(), found))),
            Err(e) => say.line(format_args!("{}: its prompt is not looked at: {e}", path.display())),
        }
    }
    if args.copying {
        report.copied = Some(real.copied(&dances, &given.unwrap_or_default())?);
    }
    print(&if args.json { format!("{}\n", serde_json::to_string(&report)?) } else { format!("{report}\n") })
}

/// Where the floor of a dance of ours is, as its recipe says: that of its prompt, 0 without.
fn floor_of(path: &Path) -> Option<f64> {
    let told = Provenance::load(&provenance::path_of(path)).ok()?;
    let ours = told.output.file == provenance::name_of(path);
    ours.then(|| told.recipe.prompt.and_then(|prompt| prompt.read.floor).unwrap_or(0.0))
}
