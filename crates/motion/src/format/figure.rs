//! Which nodes of a scene are a figure's joints: for FBX and glTF, whose skeletons are among other nodes.

use crate::Warning;
use std::collections::BTreeMap;

/// A part of a skeleton with fewer joints than this is no figure of its own: a body needs 13 (`rig::map::REQUIRED`).
const FEWEST: usize = 13;

/// The nodes of a scene.
pub(super) struct Nodes {
    pub names: Vec<String>,
    pub parents: Vec<Option<usize>>,
    /// Whether each is a joint.
    pub joints: Vec<bool>,
}

/// A figure: its nodes, parents first, and the one among them that the caller named as the clip's root.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Chosen {
    pub nodes: Vec<usize>,
    pub root: Option<usize>,
}

/// A figure of several.
struct Figure {
    /// Joints and what connects them, parents first; the first is above all others.
    nodes: Vec<usize>,
    /// The topmost node below which no other figure is.
    armature: usize,
    name: String,
}

impl Nodes {
    /// The figure that `root` names, else the one with the most joints, which is reported if there are others.
    ///
    /// # Errors
    /// What was found and what was expected: no figure, none of that name, or several.
    pub fn choose(
        &self,
        root: Option<&str>,
        warnings: &mut Vec<Warning>,
    ) -> std::result::Result<Chosen, (String, String)> {
        let mut figures = self.figures();
        let names = figures.iter().map(|f| f.name.as_str()).collect::<Vec<_>>().join(", ");
        let Some(root) = root else {
            let largest = (0..figures.len()).rev().max_by_key(|&n| figures[n].nodes.len());
            let largest = largest.ok_or_else(|| ("no joints".to_owned(), "a figure with a skeleton".to_owned()))?;
            if figures.len() > 1 {
                let (count, name) = (figures.len(), &figures[largest].name);
                let what = format!("{count} figures, {names}; {name} is read, `root` takes another");
                warnings.push(Warning { kind: "several_roots", what });
            }
            return Ok(Chosen { nodes: figures.swap_remove(largest).nodes, root: None });
        };
        if let Some(n) = figures.iter().position(|f| f.name == root) {
            return Ok(Chosen { nodes: figures.swap_remove(n).nodes, root: None });
        }
        let found: Vec<(usize, Option<usize>)> =
            (0..figures.len()).filter_map(|n| Some((n, self.named(&figures[n], root)?))).collect();
        match found[..] {
            [(n, root)] => Ok(Chosen { nodes: figures.swap_remove(n).nodes, root }),
            [] => Err((format!("no figure {root}"), format!("one of {names}, or a joint of one"))),
            _ => {
                let of: Vec<&str> = found.iter().map(|(n, _)| figures[*n].name.as_str()).collect();
                Err((format!("{root} in {} figures", found.len()), format!("one of {}", of.join(", "))))
            }
        }
    }

    /// The meaning of `name` in a figure: a joint, which is then the clip's root, or a node from its topmost joint up.
    fn named(&self, figure: &Figure, name: &str) -> Option<Option<usize>> {
        let (top, below) = figure.nodes.split_first()?;
        if self.upwards(*top).any(|n| self.names[n] == name) {
            return Some(None);
        }
        below.iter().copied().find(|&n| self.names[n] == name).map(Some)
    }

    fn upwards(&self, node: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(Some(node), |&n| self.parents[n])
    }

    /// Nodes from the top of the scene down to one.
    fn downwards(&self, node: usize) -> Vec<usize> {
        let mut down: Vec<usize> = self.upwards(node).collect();
        down.reverse();
        down
    }

    /// The figures, by their topmost node.
    fn figures(&self) -> Vec<Figure> {
        let mut trees: BTreeMap<usize, Vec<Vec<usize>>> = BTreeMap::new();
        for joint in (0..self.joints.len()).filter(|&n| self.joints[n]) {
            let down = self.downwards(joint);
            trees.entry(down[0]).or_default().push(down);
        }
        let mut all = Vec::new();
        for ways in trees.into_values() {
            self.split(ways, &mut all);
        }
        let mut figures: Vec<Figure> = all
            .iter()
            .enumerate()
            .map(|(n, nodes)| {
                // the topmost node that is above no other figure
                let others = |node: &usize| {
                    !all.iter().enumerate().any(|(m, o)| m != n && self.upwards(o[0]).any(|u| u == *node))
                };
                let armature = self.downwards(nodes[0]).into_iter().find(others).unwrap_or(nodes[0]);
                Figure { nodes: nodes.clone(), armature, name: String::new() }
            })
            .collect();
        // figures on the same rig are named by their armatures
        let own: Vec<&str> = all.iter().map(|nodes| self.names[nodes[0]].as_str()).collect();
        for (n, figure) in figures.iter_mut().enumerate() {
            let shared = own.iter().filter(|name| **name == own[n]).count() > 1;
            figure.name = if shared { self.names[figure.armature].clone() } else { own[n].to_owned() };
        }
        figures
    }

    /// Separates the joints of one tree, given by their ways from its top down: two bodies below one node that is no
    /// joint are two figures.
    fn split(&self, ways: Vec<Vec<usize>>, figures: &mut Vec<Vec<usize>>) {
        let shared = ways.iter().skip(1).fold(ways[0].len(), |shared, way| {
            way.iter().zip(&ways[0]).take(shared).take_while(|(a, b)| a == b).count()
        });
        let top = ways[0][shared - 1];
        if !self.joints[top] {
            let mut parts: BTreeMap<usize, Vec<Vec<usize>>> = BTreeMap::new();
            for way in &ways {
                // a way ends at a joint, and the shared top is none, so each goes on below it
                parts.entry(way[shared]).or_default().push(way.clone());
            }
            if parts.values().filter(|part| part.len() >= FEWEST).count() > 1 {
                // a single node is no skeleton
                parts.into_values().filter(|part| part.len() > 1).for_each(|part| self.split(part, figures));
                return;
            }
        }
        // with the nodes between the joints; in the file's order if parents come first in it
        let mut nodes: Vec<usize> = ways.iter().flat_map(|way| way[shared - 1..].iter().copied()).collect();
        nodes.sort_unstable();
        nodes.dedup();
        if !nodes.iter().all(|&n| n == top || self.parents[n].is_none_or(|p| p < n)) {
            nodes.sort_by_cached_key(|&n| self.downwards(n));
        }
        figures.push(nodes);
    }
}

/// Which of the takes of a file is read, by its place among `names`: the one called `name`, else the longest that moves the
/// figure, else the longest; `None` without any. `of` gives whether a take moves it, and its length in seconds.
///
/// # Errors
/// What was found and what was expected, where none has that name.
pub(super) fn choose_take(
    names: &[String],
    name: Option<&str>,
    of: impl Fn(usize) -> (bool, f64),
    warnings: &mut Vec<Warning>,
) -> std::result::Result<Option<usize>, (String, String)> {
    if let Some(name) = name {
        let found = names.iter().position(|n| n == name);
        return match found {
            Some(n) => {
                if !of(n).0 {
                    let what = format!("the take {name} moves nothing of the figure; `root` takes another figure");
                    warnings.push(Warning { kind: "take_still", what });
                }
                Ok(Some(n))
            }
            None if names.is_empty() => Err((format!("no take {name}"), "a file with takes".to_owned())),
            None => Err((format!("no take {name}"), format!("one of {}", names.join(", ")))),
        };
    }
    let longer = |a: &usize, b: &usize| {
        let (a, b) = (of(*a), of(*b));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    };
    // of equals the first
    let best = (0..names.len()).rev().max_by(longer);
    if let Some(n) = best.filter(|_| names.len() > 1) {
        let why = if of(n).0 { "the longest that moves the figure" } else { "the longest; none moves the figure" };
        let what = format!("{} takes, {}; {} is read, {why}; `take` chooses", names.len(), names.join(", "), names[n]);
        warnings.push(Warning { kind: "several_takes", what });
    }
    Ok(best)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nodes by name and parent; joints are those whose name begins with j.
    fn nodes(all: &[(&str, Option<usize>)]) -> Nodes {
        Nodes {
            names: all.iter().map(|(name, _)| name.to_string()).collect(),
            parents: all.iter().map(|(_, parent)| *parent).collect(),
            joints: all.iter().map(|(name, _)| name.starts_with('j')).collect(),
        }
    }

    /// A stage with two armatures, each a chain of this many joints.
    fn pair(joints: usize) -> Nodes {
        let mut all = vec![("stage", None)];
        for armature in ["one", "two"] {
            all.push((armature, Some(0)));
            for j in 0..joints {
                let name = if j == 0 { "jroot" } else { "jbone" };
                all.push((name, Some(all.len() - 1)));
            }
        }
        nodes(&all)
    }

    #[test]
    fn bodies_that_hang_from_one_node_are_figures_of_their_own() {
        let (pair, mut warnings) = (pair(14), Vec::new());
        assert_eq!(pair.choose(None, &mut warnings).unwrap().nodes, (2..16).collect::<Vec<_>>());
        assert_eq!(warnings[0].what, "2 figures, one, two; one is read, `root` takes another");
        let choose = |root: &str| pair.choose(Some(root), &mut Vec::new());
        assert_eq!(choose("two").unwrap(), Chosen { nodes: (17..31).collect(), root: None });
        for shared in ["jroot", "jbone", "stage"] {
            let (found, expected) = choose(shared).unwrap_err();
            assert_eq!((found, expected.as_str()), (format!("{shared} in 2 figures"), "one of one, two"));
        }
        assert_eq!(choose("nobody").unwrap_err().1, "one of one, two, or a joint of one");
    }

    #[test]
    fn the_longest_take_that_moves_the_figure_is_read() {
        let names = ["other", "short", "long"].map(str::to_owned);
        let of = |n: usize| [(false, 9.0), (true, 1.0), (true, 2.0)][n];
        let choose = |name| choose_take(&names, name, of, &mut Vec::new());
        assert_eq!((choose(None), choose(Some("other"))), (Ok(Some(2)), Ok(Some(0))));
        assert_eq!(choose(Some("none")).unwrap_err().1, "one of other, short, long");
        assert_eq!(choose_take(&[], None, of, &mut Vec::new()), Ok(None));
    }

    #[test]
    fn parts_of_one_body_stay_together() {
        // hips without a joint of their own, with two short chains
        let one =
            nodes(&[("hips", None), ("jleg", Some(0)), ("jfoot", Some(1)), ("jspine", Some(0)), ("mesh", Some(0))]);
        assert_eq!(one.choose(None, &mut Vec::new()).unwrap().nodes, [0, 1, 2, 3]);
        let choose = |root| one.choose(Some(root), &mut Vec::new()).unwrap().root;
        assert_eq!((choose("hips"), choose("jspine")), (None, Some(3)));
        // parents that come later in the file
        let late = nodes(&[("jfoot", Some(2)), ("jroot", None), ("jleg", Some(1))]);
        assert_eq!(late.choose(None, &mut Vec::new()).unwrap().nodes, [1, 2, 0]);
        assert!(nodes(&[("mesh", None)]).choose(None, &mut Vec::new()).is_err());
    }
}
