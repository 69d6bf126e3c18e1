//! Skeletons: names, parents and rest offsets.

use crate::{Error, Result, Vec3};

/// The tip of a chain: a point without rotation, at `p = p_parent + G_parent * offset`.
#[derive(Debug, Clone, PartialEq)]
pub struct EndSite {
    /// The joint that it is attached to.
    pub parent: usize,
    /// Offset in the parent's frame, metres.
    pub offset: Vec3,
}

/// A tree of J joints. Joint 0 is the root; parents come before their children.
#[derive(Debug, Clone, PartialEq)]
pub struct Skeleton {
    names: Vec<String>,
    parents: Vec<Option<usize>>,
    offsets: Vec<Vec3>,
    ends: Vec<EndSite>,
}

impl Skeleton {
    /// Makes a skeleton from `names`, `parents` (`None` for the root, an earlier joint for the others), rest `offsets` in
    /// metres and end sites. Kinematics ignores the root's offset.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when lengths differ, a parent doesn't come before its child, a name occurs
    /// twice, there is not exactly one root at joint 0, or an offset is not finite.
    pub fn new(
        names: Vec<String>,
        parents: Vec<Option<usize>>,
        offsets: Vec<Vec3>,
        ends: Vec<EndSite>,
    ) -> Result<Self> {
        let n = names.len();
        if n == 0 || parents.len() != n || offsets.len() != n {
            let (p, o) = (parents.len(), offsets.len());
            let found = format!("{n} names, {p} parents and {o} offsets");
            return Err(Error::invalid("a skeleton", found, "as many of each, at least one"));
        }
        let mut seen = std::collections::HashSet::new();
        for j in 0..n {
            match (j, parents[j]) {
                (0, None) => {}
                // also rules out cycles, so walks up the tree end
                (_, Some(p)) if p < j => {}
                (_, p) => {
                    let what = format!("the parent of joint {j} ({})", names[j]);
                    let expected = "none for joint 0, an earlier joint for the others";
                    return Err(Error::invalid(what, format!("{p:?}"), expected));
                }
            }
            if !seen.insert(names[j].as_str()) {
                return Err(Error::invalid(format!("the name of joint {j}"), &names[j], "a name of its own"));
            }
            if !offsets[j].is_finite() {
                return Err(Error::invalid(format!("the offset of {}", names[j]), offsets[j], "finite numbers"));
            }
        }
        if let Some(e) = ends.iter().find(|e| e.parent >= n || !e.offset.is_finite()) {
            let found = format!("on joint {} of {n}, at {}", e.parent, e.offset);
            return Err(Error::invalid("an end site", found, "on a joint of the skeleton, at finite numbers"));
        }
        Ok(Skeleton { names, parents, offsets, ends })
    }

    /// J, the number of joints.
    pub fn joints(&self) -> usize {
        self.names.len()
    }

    /// Names (J), each unique.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Parents (J): `None` for joint 0, an earlier joint for the others.
    pub fn parents(&self) -> &[Option<usize>] {
        &self.parents
    }

    /// Rest offsets (J) in the parent's frame, metres.
    pub fn offsets(&self) -> &[Vec3] {
        &self.offsets
    }

    /// The end sites, in file order.
    pub fn ends(&self) -> &[EndSite] {
        &self.ends
    }

    /// The joint that moves a [point](crate::GlobalPose::point): itself, or the one that its end site is attached to.
    ///
    /// # Panics
    /// If there is no such point.
    pub(crate) fn joint_of(&self, point: usize) -> usize {
        point.checked_sub(self.joints()).map_or(point, |end| self.ends[end].parent)
    }

    /// The joint with this name.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }

    /// The children of `joint`, ascending.
    pub fn children(&self, joint: usize) -> impl Iterator<Item = usize> + '_ {
        (0..self.joints()).filter(move |&c| self.parents[c] == Some(joint))
    }

    /// Whether `joint` is `ancestor` or a descendant of it.
    pub fn descends(&self, joint: usize, ancestor: usize) -> bool {
        let mut at = Some(joint);
        while let Some(j) = at {
            if j == ancestor {
                return true;
            }
            at = self.parents[j];
        }
        false
    }

    /// The same skeleton with all lengths multiplied by `factor`.
    pub fn scaled(&self, factor: f64) -> Self {
        let mut s = self.clone();
        s.offsets.iter_mut().for_each(|o| *o *= factor);
        s.ends.iter_mut().for_each(|e| e.offset *= factor);
        s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(n: &[&str]) -> Vec<String> {
        n.iter().map(|s| s.to_string()).collect()
    }

    #[test]
    fn nonsense_is_refused() {
        let zero = |n| vec![Vec3::ZERO; n];
        assert!(Skeleton::new(vec![], vec![], vec![], vec![]).is_err());
        assert!(Skeleton::new(names(&["a", "b"]), vec![None, Some(1)], zero(2), vec![]).is_err());
        assert!(Skeleton::new(names(&["a", "b"]), vec![None, None], zero(2), vec![]).is_err());
        assert!(Skeleton::new(names(&["a", "a"]), vec![None, Some(0)], zero(2), vec![]).is_err());
        assert!(Skeleton::new(names(&["a"]), vec![None], vec![Vec3::NAN], vec![]).is_err());
        let end = EndSite { parent: 3, offset: Vec3::ZERO };
        assert!(Skeleton::new(names(&["a"]), vec![None], zero(1), vec![end]).is_err());
        assert!(Skeleton::new(names(&["a", "b"]), vec![None, Some(0)], zero(2), vec![]).is_ok());
    }
}
