//! `kinelm evaluate dance --compare A B`.

use super::{prompt_metrics, provenance_of};
use crate::baselines::aclstm::dance::source_hashes;
use crate::cli::read::ReadArgs;
use crate::cli::{Odd, Say, each_file, motion_files, print, wrong_call};
use crate::corpus::Corpus;
use crate::evaluate::dance::compare::{Comparison, MeasuredDance, Side, take_of};
use crate::evaluate::dance::features::Features;
use crate::evaluate::dance::two_sample::{self, ToldApart};
use crate::evaluate::dance::{Dance, Reference};
use anyhow::Result;
use kinelm_motion::format::{ReadOptions, RestFrame};
use kinelm_store::output::Outputs;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The JSON output.
#[derive(Serialize)]
struct Line {
    #[serde(flatten)]
    comparison: Comparison,
    told_apart: Vec<ToldApart>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    features: Vec<Features>,
}

/// Compares the dances of two folders.
pub fn run(corpus: &Corpus, folders: [&PathBuf; 2], read: &ReadArgs, how: How<'_>, say: Say) -> Result<()> {
    let real = Reference::load(corpus)?;
    let [a, b] = folders.map(|folder| side(corpus, folder, read, say));
    let sides = [a?, b?];
    let comparison = real.compare(&sides)?;
    let told_apart = real.told_apart(&sides)?;
    let features = match how.features {
        true => {
            let sets = sides.each_ref().map(|side| side.dances.iter().map(|d| d.dance.clone()).collect::<Vec<_>>());
            real.features(&[("A", &sets[0]), ("B", &sets[1])])?
        }
        false => Vec::new(),
    };
    if let Some(out) = how.page {
        let [a, b] = &sides;
        let first = a.dances.first().zip(b.dances.first());
        let of_a = |d: &MeasuredDance| a.dances.iter().find(|other| other.take == d.take);
        let same = b.dances.iter().find_map(|d| Some((of_a(d)?, d)));
        // takes of one name are the usual case
        let named = |side: &str, dance: &MeasuredDance| {
            let name = Path::new(&dance.dance.name).file_name().unwrap_or_default().to_string_lossy().into_owned();
            let mut dance = dance.dance.clone();
            dance.name = format!("{side} {name}");
            dance
        };
        let both: Vec<Dance> = same.or(first).into_iter().flat_map(|(a, b)| [named("A", a), named("B", b)]).collect();
        let shown: Vec<&Dance> = both.iter().collect();
        super::write_page(out, &real.page(&shown, None)?, shown.len(), how.outputs, say)?;
    }
    if let Some(out) = how.plot {
        let sets = [("A", &sides[0]), ("B", &sides[1])]
            .map(|(name, side)| (name, side.dances.iter().map(|d| (&d.dance, d.prompted.as_ref())).collect()));
        crate::cli::draw_charts(out, &real.charts(&sets)?, how.outputs)?;
    }
    if how.json {
        return print(&format!("{}\n", serde_json::to_string(&Line { comparison, told_apart, features })?));
    }
    let tables: String = features.iter().map(|table| format!("\n\n{table}")).collect();
    print(&format!("{comparison}\n\n{}{tables}\n", two_sample::table(&told_apart)))
}

/// Options of the comparison.
#[derive(Clone, Copy)]
pub struct How<'a> {
    /// Whether features are compared too.
    pub features: bool,
    /// Where all metrics are plotted.
    pub plot: Option<&'a Path>,
    /// Where a page of a dance of each goes.
    pub page: Option<&'a Path>,
    /// What may be written.
    pub outputs: &'a Outputs,
    /// One JSON object instead of tables.
    pub json: bool,
}

fn side(corpus: &Corpus, folder: &PathBuf, read: &ReadArgs, say: Say) -> Result<Side> {
    if !folder.exists() {
        wrong_call!("--compare {}: there is no such folder", folder.display());
    }
    let files = motion_files(std::slice::from_ref(folder))?;
    let (options, odd) = (read.of_files(&files, RestFrame::Drop, say), Odd::new(say));
    let dances = each_file(&files, say, |i, path| measured(corpus, path, &options[i], &odd, say))?;
    Ok(Side { name: folder.display().to_string(), dances: dances.into_iter().map(|(_, dance)| dance).collect() })
}

fn measured(corpus: &Corpus, path: &Path, options: &ReadOptions, odd: &Odd, say: Say) -> Result<MeasuredDance> {
    let provenance = provenance_of(path, say);
    let sha256 = source_hashes(path, provenance.as_ref())?;
    let dance = Dance::load(corpus, path, provenance.as_ref(), options)?;
    odd.rate(&dance.name, dance.rate.clone());
    let prompt = provenance.as_ref().and_then(|provenance| provenance.request.prompt.as_ref());
    // of no file in the corpus: dances of one prompt are one take
    let itself = || (prompt.map_or(path, |prompt| &prompt.path).display().to_string(), false);
    let (take, in_training) = take_of(corpus, &sha256).unwrap_or_else(itself);
    let prompted = provenance.and_then(|provenance| prompt_metrics(&dance, path, &provenance, corpus.tokenizer(), say));
    Ok(MeasuredDance { dance, take, in_training, prompted })
}
