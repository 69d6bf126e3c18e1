//! Pairs of limbs: chains that leave one joint to both sides with bones of the same lengths.

use crate::Skeleton;

/// Bones of both sides may differ by this share before it counts.
const UNEVEN: f64 = 0.05;
/// The lower bone of a limb over its upper one. CMU's forearms end at two thirds, where a joint is called wrist.
const RATIO: std::ops::Range<f64> = 0.3..2.5;
/// Most joints along a limb. This limit and the next two are beyond any body; they bound the work on a hostile file.
const LONGEST: usize = 12;
/// Most children of a joint that are tried as limbs.
const SIBLINGS: usize = 16;
/// Most pairs of limbs of a rig.
const MOST_PAIRS: usize = 20_000;

/// A rig as a tree of lengths.
pub(super) struct Tree<'a> {
    pub rig: &'a Skeleton,
    /// Children (J).
    pub children: Vec<Vec<usize>>,
    /// Length of the longest way down from each joint (J), end sites included.
    pub reach: Vec<f64>,
}

impl<'a> Tree<'a> {
    pub fn new(rig: &'a Skeleton) -> Self {
        let joints = rig.joints();
        let mut children = vec![Vec::new(); joints];
        let mut reach = vec![0.0; joints];
        for end in rig.ends() {
            reach[end.parent] = f64::max(reach[end.parent], end.offset.length());
        }
        // parents precede their children, so backwards every child's reach is final when it is added
        for j in (1..joints).rev() {
            let Some(parent) = rig.parents()[j] else { continue };
            children[parent].push(j);
            reach[parent] = f64::max(reach[parent], rig.offsets()[j].length() + reach[j]);
        }
        // the backward loop collected them in reverse; ties in scores go by the file's order
        children.iter_mut().for_each(|c| c.reverse());
        Tree { rig, children, reach }
    }

    /// Length of the bone from the parent of `joint` to it.
    pub fn bone(&self, joint: usize) -> f64 {
        self.rig.offsets()[joint].length()
    }

    /// The way down from `from`, at each joint along the child that leads furthest; at most [`LONGEST`] joints.
    pub fn path(&self, from: usize) -> Vec<usize> {
        let mut path = vec![from];
        let mut at = from;
        let further = |c: &usize| self.bone(*c) + self.reach[*c];
        while let Some(&next) = self.children[at].iter().max_by(|a, b| further(a).total_cmp(&further(b)).then(b.cmp(a)))
        {
            path.push(next);
            at = next;
            if path.len() == LONGEST {
                break;
            }
        }
        path
    }

    /// Ancestors of `joint` from itself to the root.
    pub fn upwards(&self, joint: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(Some(joint), |&j| self.rig.parents()[j])
    }

    /// The lowest joint that both descend from.
    pub fn common(&self, a: usize, b: usize) -> usize {
        let of_a: Vec<usize> = self.upwards(a).collect();
        self.upwards(b).find(|j| of_a.contains(j)).unwrap_or(0)
    }

    /// Length of the way from `ancestor` down to `joint`.
    pub fn way(&self, ancestor: usize, joint: usize) -> f64 {
        self.upwards(joint).take_while(|&j| j != ancestor).map(|j| self.bone(j)).sum()
    }
}

/// A limb on both sides: three joints (hip, knee, ankle or shoulder, elbow, wrist) on two ways down from siblings.
#[derive(Debug, Clone)]
pub(super) struct LimbPair {
    /// The parent of both sides.
    pub parent: usize,
    /// The ways down of both sides; the same places on both correspond.
    pub paths: [Vec<usize>; 2],
    /// The places of the three joints on the ways.
    pub at: [usize; 3],
    /// Length of upper and lower bone, mean of both sides.
    pub bones: [f64; 2],
    /// How much the sides differ: summed squares of differences beyond a few per cent, in units of a few per cent.
    pub uneven: f64,
}

impl LimbPair {
    /// The three joints of a side.
    pub fn joints(&self, side: usize) -> [usize; 3] {
        self.at.map(|i| self.paths[side][i])
    }

    /// The pair with its sides exchanged.
    pub fn swapped(&self) -> Self {
        let [a, b] = &self.paths;
        LimbPair { paths: [b.clone(), a.clone()], ..self.clone() }
    }

    /// Upper and lower bone together.
    pub fn length(&self) -> f64 {
        self.bones[0] + self.bones[1]
    }

    /// The joint after the third on a side's way, if there is one.
    pub fn next(&self, side: usize) -> Option<usize> {
        self.paths[side].get(self.at[2] + 1).copied()
    }
}

/// All pairs of limbs of a rig, the ratio of whose bones a body may have.
pub(super) fn pairs(tree: &Tree) -> Vec<LimbPair> {
    let mut found = Vec::new();
    for parent in 0..tree.rig.joints() {
        let mut paths: Vec<Vec<usize>> =
            tree.children[parent].iter().map(|&c| tree.path(c)).filter(|p| p.len() >= 3).collect();
        let reach = |p: &Vec<usize>| tree.bone(p[0]) + tree.reach[p[0]];
        paths.sort_by(|a, b| reach(b).total_cmp(&reach(a)));
        paths.truncate(SIBLINGS);
        for (i, a) in paths.iter().enumerate() {
            for b in &paths[i + 1..] {
                if found.len() < MOST_PAIRS {
                    of_ways(tree, parent, a, b, &mut found);
                }
            }
        }
    }
    found
}

fn of_ways(tree: &Tree, parent: usize, a: &[usize], b: &[usize], found: &mut Vec<LimbPair>) {
    let n = a.len().min(b.len());
    let ways = [a, b].map(|path| {
        let mut sum = 0.0;
        path.iter()
            .map(|&j| {
                sum += tree.bone(j);
                sum
            })
            .collect::<Vec<f64>>()
    });
    let length = |side: usize, from: usize, to: usize| ways[side][to] - ways[side][from];
    // any three joints of the ways: collars precede a limb, and twist joints split its bones
    for i in 0..n {
        for j in i + 1..n {
            for k in j + 1..n {
                let bones = [[i, j], [j, k]].map(|[from, to]| [length(0, from, to), length(1, from, to)]);
                let mean = bones.map(|[a, b]| 0.5 * (a + b));
                // before the ratio, which would be NaN or infinite
                if mean[0].min(mean[1]) < 1e-6 || !RATIO.contains(&(mean[1] / mean[0])) {
                    continue;
                }
                let excess = |[a, b]: [f64; 2]| ((2.0 * (a - b).abs() / (a + b) - UNEVEN).max(0.0) / UNEVEN).powi(2);
                let uneven = bones.map(excess).iter().sum();
                found.push(LimbPair { parent, paths: [a.to_vec(), b.to_vec()], at: [i, j, k], bones: mean, uneven });
            }
        }
    }
}
