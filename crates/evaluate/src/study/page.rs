//! A page with one test clip as it was and as two rows decode it.

use super::clips::{Clips, StudyClip};
use super::measure::decoded;
use super::metrics::RowMetrics;
use super::row::scheme_name;
use super::store::Store;
use super::tables::short;
use crate::{Error, Result};
use kinelm_motion::Clip;
use kinelm_tokenizer::{JointTransform, SchemeConfig, Tokenizer};
use kinelm_view as view;
use kinelm_view::Figure;

/// The longest stretch of a clip that is shown, seconds.
const LONGEST_S: f64 = 20.0;

/// The page, if there is a clip to show. The rows are those named, else chosen by [`pair`].
///
/// # Errors
/// [`kinelm_store::Error::Invalid`] for a name that is no row's; those of reading and decoding.
pub fn page(rows: &[RowMetrics], named: &[String], clips: &Clips, store: &Store) -> Result<Option<String>> {
    let shown = match named {
        [] => pair(rows),
        names => names.iter().map(|n| find(rows, n)).collect::<Result<Vec<_>>>()?,
    };
    let length = |k: &&StudyClip| (k.frames as f64 / k.fps).min(LONGEST_S);
    // the first of the longest: of equals `max_by` takes the last
    let longest = clips.test.iter().rev().max_by(|a, b| length(a).total_cmp(&length(b)));
    let Some(known) = longest else { return Ok(None) };
    let own = clips.get(known, known.fps)?;
    // one frame more: 20 s have two ends
    let cut = |clip: &Clip| clip.slice(0..clip.frames().min((LONGEST_S * clip.fps()) as usize + 1));
    let mut motions = vec![(known.name().to_string(), format!("as it was, {} fps", short(known.fps)), cut(&own))];
    for f in shown {
        let tokenizer = Tokenizer::load(store.tokenizer(&f.row))?;
        let clip = cut(&*clips.get(known, f.fps())?);
        let back = decoded(&tokenizer, &tokenizer.encode(&clip)?, &clip)?;
        let (bits, mm) = (f.order0.bits_per_second, f.mpjpe.global);
        let tokens = f.text.tokens_per_second;
        motions.push((f.name().into(), format!("{bits:.0} bits/s, {tokens:.0} tokens/s, {mm:.1} mm"), back));
    }
    let figures: Vec<Figure> =
        motions.iter().map(|(title, note, clip)| Figure::new(title.as_str(), clip).note(note.as_str())).collect();
    Ok(Some(view::page(&figures)?))
}

fn find<'a>(rows: &'a [RowMetrics], name: &str) -> Result<&'a RowMetrics> {
    rows.iter().find(|f| f.name() == name).ok_or_else(|| {
        let names: Vec<&str> = rows.iter().map(RowMetrics::name).collect();
        Error::invalid_parameter("show", name, format!("one of {}", names.join(", ")))
    })
}

/// The tiles of principal components of lowest error, and the lapped row that costs tokens the most like them; where there
/// are none, the coarsest uniform row, and the row of lowest error.
pub fn pair(rows: &[RowMetrics]) -> Vec<&RowMetrics> {
    let error = |f: &&RowMetrics| f.mpjpe.global;
    let tiles = |f: &RowMetrics| matches!(&f.row.config.scheme, SchemeConfig::Dct(c) if matches!(c.joint_transform, JointTransform::Pca { .. }));
    let uniform = |f: &RowMetrics| matches!(f.row.config.scheme, SchemeConfig::Uniform(_));
    let first = rows.iter().filter(|f| tiles(f)).min_by(|a, b| error(a).total_cmp(&error(b)));
    let first = first.or(rows.iter().filter(|f| uniform(f)).max_by(|a, b| error(a).total_cmp(&error(b))));
    let Some(first) = first.or(rows.first()) else { return Vec::new() };
    let distance = |f: &&RowMetrics| (f.text.tokens_per_second / first.text.tokens_per_second).ln().abs();
    let lapped = rows.iter().filter(|f| scheme_name(&f.row.config.scheme) == "lapped");
    let second = lapped.min_by(|a, b| distance(a).total_cmp(&distance(b)));
    let others = rows.iter().filter(|f| f.name() != first.name());
    let second = second.or(others.min_by(|a, b| error(a).total_cmp(&error(b))));
    std::iter::once(first).chain(second).collect()
}
