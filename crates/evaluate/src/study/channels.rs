//! The distribution of joints' rotations, with the edges of the bins that the rows cut it into.

use super::clips::{Clips, StudyClip, each};
use super::row::Row;
use super::store::Store;
use crate::{Error, Result};
use kinelm_motion::rotation::{Axis, exp_map};
use kinelm_motion::{Clip, smpl};
use kinelm_tokenizer::Tokenizer;
use kinelm_view::plot::{Chart, Look, Rule, Scale, Series};

/// Degrees of a bar.
const BAR: usize = 1;
/// Bars of a full turn.
const BARS: usize = 360 / BAR;
/// The most edges among the values of a chart; more would cover it.
const MOST_EDGES: usize = 150;

/// A component of a joint's rotation vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RotationChannel {
    joint: usize,
    axis: Axis,
}

impl RotationChannel {
    /// The channels of names such as `right_shoulder.x`, of joints that a row codes.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] for another name, with those that exist.
    pub fn parse_all(names: &[String], rows: &[Row]) -> Result<Vec<Self>> {
        let coded: Vec<usize> =
            (0..24).filter(|joint| rows.iter().any(|row| row.config.joints.contains(joint))).collect();
        let one = |name: &String| {
            let axis = |end: &str| ["x", "y", "z"].iter().position(|axis| *axis == end);
            let parts = name.trim().rsplit_once('.').and_then(|(joint, end)| Some((joint, axis(end)?)));
            let joint = |own: &str| coded.iter().copied().find(|&joint| smpl::NAMES[joint] == own);
            match parts.and_then(|(own, axis)| Some((joint(own)?, axis))) {
                Some((joint, axis)) => Ok(RotationChannel { joint, axis: [Axis::X, Axis::Y, Axis::Z][axis] }),
                None => {
                    let names: Vec<&str> = coded.iter().map(|&joint| smpl::NAMES[joint]).collect();
                    let expected = format!("JOINT.x, JOINT.y or JOINT.z of a coded joint: {}", names.join(", "));
                    Err(Error::invalid_parameter("channels", name, expected))
                }
            }
        };
        names.iter().map(one).collect()
    }

    fn name(self) -> String {
        format!("{}.{}", smpl::NAMES[self.joint], ["x", "y", "z"][self.axis.index()])
    }

    /// Adds the values of a clip to the counts of bars from -180 degrees on.
    fn count(self, clip: &Clip, bars: &mut [u64]) {
        for frame in 0..clip.frames() {
            let degrees = exp_map::to_vector(clip.pose(frame)[self.joint])[self.axis.index()].to_degrees();
            bars[(((degrees + 180.0) / BAR as f64) as usize).min(BARS - 1)] += 1;
        }
    }
}

/// A chart for each channel and each row that has bins for it: the share of the train clips' frames by degree, and the
/// edges between bins. Rows with too many edges are left out and noted.
///
/// # Errors
/// Those of reading clips and tokenizers.
pub fn charts(
    channels: &[RotationChannel],
    rows: &[Row],
    clips: &Clips,
    store: &Store,
    note: &mut dyn FnMut(&str),
) -> Result<Vec<Chart>> {
    let mut known: Vec<(f64, Vec<Vec<u64>>)> = Vec::new();
    let mut charts = Vec::new();
    let tokenizers = rows.iter().map(|row| Ok(Tokenizer::load(store.tokenizer(row))?)).collect::<Result<Vec<_>>>()?;
    for (i, &channel) in channels.iter().enumerate() {
        for (row, tokenizer) in rows.iter().zip(&tokenizers) {
            let edges = tokenizer.scheme().edges(tokenizer.channels(), channel.joint, channel.axis);
            let Some(edges) = edges else { continue };
            let fps = row.config.fps;
            if !known.iter().any(|(rate, _)| *rate == fps) {
                known.push((fps, counted(channels, clips, fps)?));
            }
            let Some((_, bars)) = known.iter().find(|(rate, _)| *rate == fps) else { continue };
            let (name, bins) = (format!("{}, {}", channel.name(), row.name), edges.len() + 1);
            let (chart, inside) = chart(format!("{name}: {bins} bins"), &bars[i], &edges);
            match inside > MOST_EDGES {
                true => note(&format!("{name}: {inside} edges of bins among the values are too many to draw")),
                false => charts.push(chart),
            }
        }
    }
    if charts.is_empty() && !channels.is_empty() {
        note("no row cuts these channels into bins that can be drawn: uniform or quantile without a joint transform");
    }
    Ok(charts)
}

/// The bars of each channel over the train clips.
fn counted(channels: &[RotationChannel], clips: &Clips, fps: f64) -> Result<Vec<Vec<u64>>> {
    let mut all = vec![vec![0; BARS]; channels.len()];
    let work = |known: &StudyClip| {
        let clip = clips.get(known, fps)?;
        let mut bars = vec![vec![0; BARS]; channels.len()];
        channels.iter().zip(&mut bars).for_each(|(channel, bars)| channel.count(&clip, bars));
        Ok(bars)
    };
    each(&clips.train, work, |bars| {
        all.iter_mut().flatten().zip(bars.iter().flatten()).for_each(|(sum, n)| *sum += n);
        Ok(())
    })?;
    Ok(all)
}

/// Bars as an outline and edges, radians, as rules; and the number of edges among the values.
fn chart(title: String, bars: &[u64], edges: &[f64]) -> (Chart, usize) {
    let frames = bars.iter().sum::<u64>().max(1) as f64;
    let first = bars.iter().position(|n| *n > 0).unwrap_or(0);
    let last = bars.iter().rposition(|n| *n > 0).unwrap_or(0);
    let at = |bar: usize| (bar * BAR) as f64 - 180.0;
    let share = |bar: usize| 100.0 * bars[bar] as f64 / frames;
    let outline = (first..=last).flat_map(|bar| [(at(bar), share(bar)), (at(bar + 1), share(bar))]);
    let points = [(at(first), 0.0)].into_iter().chain(outline).chain([(at(last + 1), 0.0)]).collect();
    let inside = edges.iter().map(|edge| edge.to_degrees()).filter(|x| (at(first)..=at(last + 1)).contains(x));
    let rules: Vec<Rule> = inside.map(|x| Rule { x, name: String::new() }).collect();
    let series = vec![Series { points, look: Look::Line, ..Series::default() }];
    let (x, y) = ("degrees".into(), "frames a degree, %".into());
    let edges = rules.len();
    (Chart { title, x, y, scales: (Scale::Linear, Scale::Linear), series, rules, ..Chart::default() }, edges)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::row::{self, RowDefaults};
    use kinelm_motion::{Quat, Vec3};
    use std::path::Path;

    #[test]
    fn names_are_of_coded_joints() {
        let defaults = RowDefaults { joints: vec![0, 4, 5], fps: 20.0 };
        let rows =
            row::parse("[[row]]\nname = \"a\"\nscheme = { type = \"uniform\" }\n", Path::new("rows.toml"), &defaults)
                .unwrap();
        let parse = |name: &str| RotationChannel::parse_all(&[name.to_owned()], &rows);
        assert_eq!(parse("left_knee.z").unwrap(), [RotationChannel { joint: 4, axis: Axis::Z }]);
        for wrong in ["left_knee", "left_knee.w", "left_knee.", "head.x", "knee.x", ""] {
            let said = parse(wrong).unwrap_err().to_string();
            assert!(said.contains("JOINT.x") && said.contains("left_knee, right_knee"), "{said}");
        }
    }

    #[test]
    fn shares_and_edges_by_hand() {
        let channel = RotationChannel { joint: 4, axis: Axis::X };
        let degrees = [10.5f64, 10.7, 12.2, -0.5];
        let rotations = degrees.map(|x| [exp_map::from_vector(Vec3::X * x.to_radians()); 24]).concat();
        let clip = Clip::new(smpl::neutral(), 20.0, vec![Vec3::Y; 4], rotations.into_iter().collect::<Vec<Quat>>());
        let mut bars = vec![0; BARS];
        channel.count(&clip.unwrap(), &mut bars);
        assert_eq!((bars[190], bars[192], bars[179]), (2, 1, 1));
        let (chart, inside) = chart("t".into(), &bars, &[-0.1, 0.0, 0.1, 0.5]);
        // from -1 to 13 degrees: 0 and 5.7, not -5.7 and 28.6
        assert_eq!((inside, chart.rules[1].x.round()), (2, 6.0));
        let points = &chart.series[0].points;
        assert_eq!((points[0], points[1], points[2]), ((-1.0, 0.0), (-1.0, 25.0), (0.0, 25.0)));
        assert_eq!((points[23], points[points.len() - 1]), ((10.0, 50.0), (13.0, 0.0)));
    }
}
