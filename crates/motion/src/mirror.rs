//! Mirroring: reflection of a motion in the plane x = 0.

use crate::rig::{Humanoid, ReferencePose};
use crate::{Clip, Error, GlobalPose, Quat, Result, Skeleton, Vec3, smpl};
use std::sync::Arc;

/// Mirrors a clip on the SMPL-24 rig: left and right are exchanged, a rotation (w, x, y, z) becomes (w, x, -y, -z), and
/// the root position (x, y, z) becomes (-x, y, z). Mirroring twice gives exactly the same clip.
///
/// # Errors
/// [`Invalid`](kinelm_store::Error::Invalid) when the joints are not SMPL's 24: retarget the clip first, or use a
/// [`Mirror`].
///
/// ```
/// use kinelm_motion::{mirror::mirror, synth};
///
/// let dance = synth::corpus(1, 1, 1.0, 20.0)?.remove(0).clip;
/// let mirrored = mirror(&dance)?;
/// assert_eq!(mirrored.root()[5].x, -dance.root()[5].x);
/// assert_eq!(mirror(&mirrored)?, dance);
/// # Ok::<(), kinelm_motion::Error>(())
/// ```
pub fn mirror(clip: &Clip) -> Result<Clip> {
    smpl::check_rig("the clip to mirror", clip.skeleton())?;
    let root = clip.root().iter().map(|p| reflect(*p)).collect();
    let rotations =
        (0..clip.frames()).flat_map(|f| smpl::MIRROR.iter().map(move |&j| turned(clip.pose(f)[j]))).collect();
    Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations)
}

fn reflect(p: Vec3) -> Vec3 {
    Vec3::new(-p.x, p.y, p.z)
}

/// `M R M` with `M = diag(-1, 1, 1)`.
fn turned(q: Quat) -> Quat {
    // a rotation's axis is a pseudovector: reflected in x, its y and z change sign
    Quat::from_xyzw(q.x, -q.y, -q.z, q.w)
}

/// Mirrors clips on a rig whose joints may have any axes. With `A_j` the world rotation of joint `j` in the left-right
/// symmetric reference pose, `m(j)` its partner on the other side and `M = diag(-1, 1, 1)`,
///
/// ```text
/// D_j = G_j A_j^-1        D'_j = M D_m(j) M        G'_j = D'_j A_j
/// ```
///
/// If both sides have bones of the same length, the joint positions are exact mirror images.
#[derive(Debug, Clone)]
pub struct Mirror {
    rig: Arc<Skeleton>,
    reference: ReferencePose,
    partners: Vec<Option<usize>>,
}

impl Mirror {
    /// The mirror of a rig. Joints that its map doesn't name (fingers, twist bones) are paired by name, left with right,
    /// else by position.
    ///
    /// # Errors
    /// Those of [`Humanoid::pose`].
    pub fn new(humanoid: &Humanoid) -> Result<Self> {
        let (rig, reference) = (humanoid.rig().clone(), humanoid.pose()?.into_owned());
        Ok(Mirror { partners: partners(&rig, &reference), rig, reference })
    }

    /// The joint on the other side: a middle joint itself; `None` if the rig has no counterpart.
    pub fn partner(&self, joint: usize) -> Option<usize> {
        self.partners.get(joint).copied().flatten()
    }

    /// Mirrors a clip. Mirroring twice gives the same clip up to rounding, except for joints without a partner, which get
    /// their reference pose.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when the clip is not on this rig.
    pub fn apply(&self, clip: &Clip) -> Result<Clip> {
        let on = clip.skeleton();
        if on.names() != self.rig.names() || on.parents() != self.rig.parents() {
            let joints = |s: &Skeleton| format!("{} joints from {}", s.joints(), s.names()[0]);
            let expected = format!("the {} of this mirror's rig", joints(&self.rig));
            return Err(Error::invalid("the clip to mirror", format!("one of {}", joints(on)), expected));
        }
        let root = clip.root().iter().map(|p| reflect(*p)).collect();
        let mut rotations = Vec::with_capacity(clip.rotations().len());
        let mut pose = GlobalPose::default();
        for f in 0..clip.frames() {
            pose.set(on, clip.root()[f], clip.pose(f));
            self.frame(&pose.rotations, &mut rotations);
        }
        Clip::new(on.clone(), clip.fps(), root, rotations)
    }

    /// Appends the local rotations of one mirrored frame.
    fn frame(&self, world: &[Quat], out: &mut Vec<Quat>) {
        let rest = &self.reference.global.rotations;
        let mut mirrored: Vec<Quat> = Vec::with_capacity(world.len());
        for j in 0..world.len() {
            let above = self.rig.parents()[j].map_or(Quat::IDENTITY, |p| mirrored[p]);
            let local = match self.partners[j] {
                Some(m) => (above.conjugate() * turned(world[m] * rest[m].conjugate()) * rest[j]).normalize(),
                None => self.reference.local[j],
            };
            mirrored.push(above * local);
            out.push(local);
        }
    }
}

/// The partner of each joint: from the map, else by name, else by position, among the children of the parent's partner.
fn partners(rig: &Skeleton, reference: &ReferencePose) -> Vec<Option<usize>> {
    let mut partners = vec![None; rig.joints()];
    let mut named = vec![false; rig.joints()];
    for (id, joint) in reference.joints.iter().enumerate() {
        if let Some(j) = *joint {
            partners[j] = reference.joints[smpl::MIRROR[id]];
            named[j] = true;
        }
    }
    if !named[0] {
        (partners[0], named[0]) = (Some(0), true);
    }
    let from_parent = |j: usize| {
        let at = &reference.global.positions;
        at[j] - rig.parents()[j].map_or(Vec3::ZERO, |p| at[p])
    };
    // parents come first, so the parent's partner, whose children are the candidates, is known
    for j in 0..rig.joints() {
        if named[j] || partners[j].is_some() {
            continue;
        }
        let Some(across) = rig.parents()[j].and_then(|p| partners[p]) else { continue };
        let mine = reflect(from_parent(j));
        let expected = swapped(&rig.names()[j]);
        let free = rig.children(across).filter(|&k| !named[k] && partners[k].is_none());
        // a name without a side says nothing: only the position counts
        let sided = expected != rig.names()[j];
        let distance = |k: usize| (sided && rig.names()[k] != expected, (from_parent(k) - mine).length());
        let nearest = free.min_by(|&a, &b| {
            let ((other_a, a), (other_b, b)) = (distance(a), distance(b));
            other_a.cmp(&other_b).then(a.total_cmp(&b))
        });
        if let Some(k) = nearest {
            partners[j] = Some(k);
            partners[k] = Some(j);
        }
    }
    partners
}

/// A joint name with left and right exchanged: the words, or a single `l` or `r` at the beginning or the end (`lThumb1`,
/// `L_Toe`, `Hand_L`, `Bip01 L Toe`). A name without a side stays.
fn swapped(name: &str) -> String {
    for (a, b) in [("Left", "Right"), ("left", "right"), ("LEFT", "RIGHT")] {
        for (from, to) in [(a, b), (b, a)] {
            if name.contains(from) {
                return name.replacen(from, to, 1);
            }
        }
    }
    let chars: Vec<char> = name.chars().collect();
    let separator = |c: Option<&char>| c.is_none_or(|c| !c.is_alphanumeric());
    let alone = |i: usize| {
        let before = separator(i.checked_sub(1).and_then(|i| chars.get(i)));
        before && (separator(chars.get(i + 1)) || chars.get(i + 1).is_some_and(|c| c.is_uppercase()))
    };
    let other = |c: char| match c {
        'l' => Some('r'),
        'r' => Some('l'),
        'L' => Some('R'),
        'R' => Some('L'),
        _ => None,
    };
    let side = (0..chars.len()).find(|&i| other(chars[i]).is_some() && alone(i));
    let turn = |(i, &c): (usize, &char)| if Some(i) == side { other(c).unwrap_or(c) } else { c };
    chars.iter().enumerate().map(turn).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::retarget::Retarget;
    use crate::retarget::tests::{reference_positions, rig as made_rig};
    use crate::rig::SkeletonMap;
    use crate::rotation::tests::any_quat;
    use crate::rotation::{angle_between, exp_map};
    use proptest::prelude::*;
    use std::sync::Arc;

    #[test]
    fn a_known_value() {
        let mut pose = vec![Quat::IDENTITY; 24];
        pose[16] = exp_map::from_vector(Vec3::new(0.1, 0.2, 0.3));
        let clip = Clip::new(smpl::neutral(), 20.0, vec![Vec3::new(1.0, 2.0, 3.0)], pose).unwrap();
        let m = mirror(&clip).unwrap();
        assert_eq!(m.root()[0], Vec3::new(-1.0, 2.0, 3.0));
        assert!((exp_map::to_vector(m.pose(0)[17]) - Vec3::new(0.1, -0.2, -0.3)).length() < 1e-12);
        assert_eq!(m.pose(0)[16], Quat::IDENTITY);
    }

    #[test]
    fn names_change_sides() {
        let pairs = [
            ("lThumb1", "rThumb1"),
            ("LHipJoint", "RHipJoint"),
            ("LeftHandIndex1", "RightHandIndex1"),
            ("mixamorig:LeftEye", "mixamorig:RightEye"),
            ("Toes_L", "Toes_R"),
            ("Bip01 L Toe0", "Bip01 R Toe0"),
            ("thumb.l", "thumb.r"),
        ];
        for (a, b) in pairs {
            assert_eq!((swapped(a).as_str(), swapped(b).as_str()), (b, a));
        }
        for middle in ["jaw", "LowerBack", "root", "Neck1", "l0wer", ""] {
            assert_eq!(swapped(middle), middle);
        }
    }

    #[test]
    fn fingers_and_eyes_find_their_partners() {
        let body = smpl::neutral();
        let mut names = body.names().to_vec();
        let mut parents = body.parents().to_vec();
        let mut offsets = body.offsets().to_vec();
        let mut add = |name: &str, parent: usize, offset: [f64; 3]| {
            names.push(name.into());
            parents.push(Some(parent));
            offsets.push(Vec3::from_array(offset));
        };
        // paired by name at equal positions; paired by position with meaningless names; unpaired
        add("LThumb", 22, [0.0; 3]);
        add("LFinger", 22, [0.0; 3]);
        add("RFinger", 23, [0.0; 3]);
        add("RThumb", 23, [0.0; 3]);
        add("a", 15, [0.03, 0.05, 0.08]);
        add("jaw", 15, [0.0, -0.02, 0.05]);
        add("b", 15, [-0.03, 0.05, 0.08]);
        add("tail of the left leg", 4, [0.0, 0.1, 0.0]);
        let rig = Skeleton::new(names, parents, offsets, vec![]).unwrap();
        let m = Mirror::new(&Humanoid::with_map(&rig, &SkeletonMap::builtin("smpl").unwrap())).unwrap();
        assert_eq!([24, 25, 26, 27].map(|j| m.partner(j).unwrap()), [27, 26, 25, 24]);
        assert_eq!([28, 29, 30].map(|j| m.partner(j).unwrap()), [30, 29, 28]);
        assert_eq!((m.partner(31), m.partner(16), m.partner(99)), (None, Some(17), None));
    }

    proptest! {
        #[test]
        fn twice_is_the_identity_and_positions_are_mirrored(q in prop::collection::vec(any_quat(), 24)) {
            let clip = Clip::new(smpl::neutral(), 20.0, vec![Vec3::new(0.5, 1.0, -2.0)], q).unwrap();
            let once = mirror(&clip).unwrap();
            prop_assert_eq!(&mirror(&once).unwrap(), &clip);
            let (a, b) = (clip.positions(), once.positions());
            for j in 0..24 {
                let p = a[smpl::MIRROR[j]];
                prop_assert!((b[j] - Vec3::new(-p.x, p.y, p.z)).length() < 1e-9);
            }
        }

        #[test]
        fn a_rig_of_any_axes_is_mirrored_as_smpl_is(
            axes in prop::collection::vec(any_quat(), 24),
            q in prop::collection::vec(any_quat(), 48),
            droop in 0.0..1.2f64,
            extra: bool,
        ) {
            let (rig, map) = made_rig(&reference_positions(droop, &[1.0; 24]), &axes, extra, &[]);
            let m = Mirror::new(&Humanoid::with_map(&rig, &map)).unwrap();
            for j in 0..rig.joints() {
                prop_assert_eq!(m.partner(m.partner(j).unwrap()), Some(j));
            }
            let rotations = q[..rig.joints()].to_vec();
            let clip = Clip::new(Arc::new(rig), 20.0, vec![Vec3::new(0.5, 1.0, -2.0)], rotations).unwrap();
            let once = m.apply(&clip).unwrap();
            let (a, b) = (clip.positions(), once.positions());
            for j in 0..clip.joints() {
                prop_assert!((b[j] - reflect(a[m.partner(j).unwrap()])).length() < 1e-9);
            }
            let twice = m.apply(&once).unwrap();
            for (a, b) in clip.rotations().iter().zip(twice.rotations()) {
                prop_assert!(angle_between(*a, *b) < 1e-9);
            }
            // mirroring on the rig agrees with mirroring after retargeting to SMPL
            let retarget = Retarget::new(&Humanoid::with_map(clip.skeleton(), &map), smpl::neutral()).unwrap();
            let (a, b) = (mirror(&retarget.to_smpl(&clip).unwrap()).unwrap(), retarget.to_smpl(&once).unwrap());
            for (a, b) in a.rotations().iter().zip(b.rotations()) {
                prop_assert!(angle_between(*a, *b) < 1e-7);
            }
        }
    }
}
