//! `kinelm evaluate dance`.

use super::compare::{self, How};
use super::music::{MusicArgs, beats, own_beats};
use super::{prompt_metrics, provenance_of};
use crate::cli::read::ReadArgs;
use crate::cli::{ForceArgs, Odd, Say, TrustArgs, each_file, motion_files, print};
use crate::evaluate::dance::fidelity::fidelity;
use crate::evaluate::dance::{Dance, Reference, requested_label};
use crate::generate::prompt::given_characters;
use crate::generate::provenance::Provenance;
use anyhow::Result;
use kinelm_motion::format::RestFrame;
use kinelm_motion::joints;
use std::collections::BTreeMap;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Dances: motion files of any rig, or folders of them. The prompt to compare with is that of a sidecar, FILE.bvh.kinelm.json
    #[arg(required_unless_present = "compare", value_name = "FILE")]
    dances: Vec<PathBuf>,
    /// Compare two folders of dances instead: the metrics of both and their differences
    #[arg(long, num_args = 2, value_names = ["A", "B"],
        conflicts_with_all = ["dances", "copying", "fidelity", "beats", "music"])]
    compare: Vec<PathBuf>,
    /// The corpus of real dances: its tokenizer codes all dances, its train clips give the thresholds, its valid clips
    /// are the reference
    #[arg(long, value_name = "CORPUS")]
    real: PathBuf,
    /// Also look for copies of training clips, which takes longer
    #[arg(long)]
    copying: bool,
    /// Also print Fréchet distances and diversities of kinetic and geometric features
    #[arg(long)]
    features: bool,
    /// Classify the dances by this label field, such as genre: how often the class is the requested one, or that of the
    /// prompt
    #[arg(long, value_name = "FIELD")]
    fidelity: Option<String>,
    #[command(flatten)]
    music: MusicArgs,
    /// Also plot the distribution of every metric over the real train clips and over the dances
    #[arg(long, value_name = "FILE.svg|png")]
    plot: Option<PathBuf>,
    /// Also write a page that plays the dances beside a real one, or the first of A beside the same take of B, with
    /// measures over time and the moments to look at (.html)
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    /// Print one JSON object instead of tables
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    read: ReadArgs,
    #[command(flatten)]
    trust: TrustArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    let corpus = super::real_corpus(&args.real, args.trust)?;
    let tokenizer = corpus.tokenizer();
    let outputs = args.force.outputs(args.dances.iter().chain(&args.compare).chain([&args.real]).cloned());
    let plot = args.plot.as_deref();
    plot.map_or(Ok(()), |out| crate::cli::picture(out, &outputs))?;
    let page = args.page.as_deref();
    page.map_or(Ok(()), crate::cli::page)?;
    outputs.check(page)?;
    if let [a, b] = &args.compare[..] {
        let how = How { features: args.features, plot, page, outputs: &outputs, json: args.json };
        return compare::run(&corpus, [a, b], &args.read, how, say);
    }
    let real = Reference::load(&corpus)?;
    let files = motion_files(&args.dances)?;
    let mut provenances: Vec<Option<Provenance>> = files.iter().map(|path| provenance_of(path, say)).collect();
    let options = args.read.of_files(&files, RestFrame::Drop, say);
    let odd = Odd::new(say);
    let read = each_file(&files, say, |i, path| {
        let dance = Dance::load(&corpus, path, provenances[i].as_ref(), &options[i])?;
        odd.rate(&dance.name, dance.rate.clone());
        Ok(dance)
    })?;
    let (numbers, dances): (Vec<usize>, Vec<Dance>) = read.into_iter().unzip();
    // prints what it has gathered
    drop(odd);
    let mut report = real.report(&dances)?;
    let mut given: Option<Vec<bool>> = None;
    let mut best = BTreeMap::<usize, usize>::new();
    let mut pieces = BTreeMap::new();
    let beats = beats(&args.music, files.len(), &mut pieces)?;
    let mut music_s = Vec::new();
    let mut requested = Vec::new();
    let mut joints_given = Vec::new();
    let mut prompt_sha256 = None;
    for (&i, dance) in numbers.iter().zip(&dances) {
        let (path, provenance) = (&files[i], provenances[i].take());
        prompt_sha256 = provenance.as_ref().and_then(|provenance| provenance.prompt_sha256.clone());
        // sets of --best differ by the number that they were chosen among
        provenance.iter().filter_map(|provenance| provenance.best).for_each(|of| *best.entry(of.of).or_default() += 1);
        music_s.push(match &beats {
            None => own_beats(path, provenance.as_ref(), &mut pieces).unwrap_or_else(|e| {
                say.line(format_args!("{}: its music is not compared: {e}; --music says where it is", path.display()));
                None
            }),
            // one list for all dances, or one for each
            Some(beats) => Some(beats[i % beats.len()].clone()),
        });
        requested.push(match &args.fidelity {
            Some(field) => requested_label(&corpus, field, path, provenance.as_ref())?,
            None => None,
        });
        let request = provenance.as_ref().map(|provenance| &provenance.request);
        let given_joints = request.and_then(|r| joints::parse(r.prompt.as_ref()?.joints.as_ref()?).ok());
        joints_given.extend(given_joints.iter().flat_map(|given_joints| given_joints.joints.iter().copied()));
        let places = given_joints.and_then(|given_joints| given_characters(tokenizer, &given_joints).ok());
        // what was given to one dance only may be a copy in the others
        let places = places.unwrap_or_default();
        given = Some(given.map_or(places.clone(), |given| if given == places { given } else { Vec::new() }));
        let found = provenance.and_then(|provenance| prompt_metrics(dance, path, &provenance, tokenizer, say));
        report.prompted.extend(found.map(|found| (dance.name.clone(), found)));
    }
    for (of, dances) in best {
        say.line(format_args!("{dances} of these {} dances were chosen among {of} each", files.len()));
    }
    if args.copying {
        report.copied = Some(real.copied(&dances, &given.unwrap_or_default())?);
    }
    if music_s.iter().any(Option::is_some) {
        report.beats = real.beats(&dances, &music_s)?;
    }
    if args.features {
        report.features = real.features(&[("dances", &dances)])?;
    }
    if let Some(field) = &args.fidelity {
        let dances: Vec<_> = dances.iter().zip(requested).collect();
        report.fidelity = Some(fidelity(&corpus, field, &joints_given, &dances)?);
    }
    if let Some(out) = page {
        let beside = match &dances[..] {
            [one] => Some(real.beside(one, prompt_sha256.as_deref())?),
            _ => None,
        };
        let shown: Vec<&Dance> = dances.iter().chain(&beside).take(super::ON_PAGE).collect();
        super::write_page(out, &real.page(&shown, report.copied.as_ref())?, dances.len(), &outputs, say)?;
    }
    if let Some(out) = plot {
        let of = |name: &str| report.prompted.iter().find(|(of, _)| of == name).map(|(_, prompted)| prompted);
        let dances = dances.iter().map(|dance| (dance, of(&dance.name)));
        crate::cli::draw_charts(out, &real.charts(&[("dances", dances.collect())])?, &outputs)?;
    }
    print(&if args.json { format!("{}\n", serde_json::to_string(&report)?) } else { format!("{report}\n") })
}
