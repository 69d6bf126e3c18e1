//! Forward kinematics: from local rotations to world positions and rotations.

use crate::{Clip, Quat, Skeleton, Vec3};

/// World positions and rotations of the joints in one frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GlobalPose {
    /// Positions (J), metres.
    pub positions: Vec<Vec3>,
    /// Rotations (J).
    pub rotations: Vec<Quat>,
}

impl GlobalPose {
    /// The world pose of `local` rotations (J) with the root at `root`: `p_j = p_parent + G_parent t_j`,
    /// `G_j = G_parent L_j`.
    ///
    /// # Panics
    /// If `local` doesn't have one rotation per joint.
    pub fn new(skeleton: &Skeleton, root: Vec3, local: &[Quat]) -> Self {
        let mut pose = GlobalPose::default();
        pose.set(skeleton, root, local);
        pose
    }

    /// Recomputes the pose in place, for loops over frames; see [`GlobalPose::new`].
    ///
    /// # Panics
    /// If `local` doesn't have one rotation per joint.
    pub fn set(&mut self, skeleton: &Skeleton, root: Vec3, local: &[Quat]) {
        assert_eq!(local.len(), skeleton.joints(), "one local rotation a joint");
        #[cfg(test)]
        tests::COMPUTED.with(|n| n.set(n.get() + 1));
        self.positions.clear();
        self.rotations.clear();
        for ((&l, parent), &offset) in local.iter().zip(skeleton.parents()).zip(skeleton.offsets()) {
            let (p, g) = match *parent {
                // the root's own offset plays no part: `root` is its position in the world
                None => (root, l),
                Some(parent) => {
                    let g = self.rotations[parent];
                    (self.positions[parent] + g * offset, g * l)
                }
            };
            self.positions.push(p);
            self.rotations.push(g);
        }
    }

    /// World positions of the end sites, metres.
    pub fn ends<'a>(&'a self, skeleton: &'a Skeleton) -> impl Iterator<Item = Vec3> + 'a {
        skeleton.ends().iter().map(|e| self.positions[e.parent] + self.rotations[e.parent] * e.offset)
    }

    /// World position of a point of the skeleton, metres: joint `point`, or, counted on from J, an end site.
    ///
    /// # Panics
    /// If there is no such point.
    pub fn point(&self, skeleton: &Skeleton, point: usize) -> Vec3 {
        match point.checked_sub(self.positions.len()) {
            None => self.positions[point],
            Some(end) => {
                let end = &skeleton.ends()[end];
                self.positions[end.parent] + self.rotations[end.parent] * end.offset
            }
        }
    }

    /// Local rotations (J): the inverse of [`GlobalPose::new`].
    pub fn to_local(&self, skeleton: &Skeleton) -> Vec<Quat> {
        let local = |j: usize| match skeleton.parents()[j] {
            None => self.rotations[j],
            Some(p) => (self.rotations[p].conjugate() * self.rotations[j]).normalize(),
        };
        (0..skeleton.joints()).map(local).collect()
    }
}

impl Clip {
    /// The world pose of one frame.
    pub fn global_pose(&self, frame: usize) -> GlobalPose {
        GlobalPose::new(self.skeleton(), self.root()[frame], self.pose(frame))
    }

    /// World positions of the joints (F, J), metres.
    pub fn positions(&self) -> Vec<Vec3> {
        let mut all = Vec::with_capacity(self.frames() * self.joints());
        let mut pose = GlobalPose::default();
        for f in 0..self.frames() {
            pose.set(self.skeleton(), self.root()[f], self.pose(f));
            all.extend_from_slice(&pose.positions);
        }
        all
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::rotation::angle_between;
    use crate::rotation::tests::any_quat;
    use crate::smpl;
    use proptest::prelude::*;

    thread_local! {
        /// How many poses this thread has computed, for tests of how work grows.
        pub(crate) static COMPUTED: std::cell::Cell<usize> = const { std::cell::Cell::new(0) };
    }

    #[test]
    fn a_child_turns_with_its_parent() {
        let names = ["a", "b"].map(String::from).to_vec();
        let s = Skeleton::new(names, vec![None, Some(0)], vec![Vec3::ZERO, Vec3::new(0.0, 10.0, 0.0)], vec![]).unwrap();
        let quarter = Quat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let p = GlobalPose::new(&s, Vec3::new(1.0, 2.0, 3.0), &[quarter, Quat::IDENTITY]);
        assert!((p.positions[1] - Vec3::new(-9.0, 2.0, 3.0)).length() < 1e-12);
    }

    proptest! {
        #[test]
        fn local_global_local(q in prop::collection::vec(any_quat(), 24)) {
            let s = smpl::neutral();
            let g = GlobalPose::new(&s, Vec3::ZERO, &q);
            for (a, b) in g.to_local(&s).iter().zip(&q) {
                prop_assert!(angle_between(*a, *b) < 1e-9);
            }
        }
    }
}
