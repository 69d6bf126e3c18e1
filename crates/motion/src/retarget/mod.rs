//! Retargeting: one body's motion on another body.
//!
//! Rotations are transferred in the world, because the joints' own axes differ between rigs. With `G_s` the world rotation
//! of a rig's joint, `A_s` the same in the reference pose (a T-pose or A-pose, [`ReferencePose`]) and `S` the smallest
//! rotation that aligns the SMPL bone of the rest pose with the rig's bone of the reference pose, the SMPL joint has
//!
//! ```text
//! G_t = G_s E C        C = A_s^-1 S        E = swing of the bone, in the joint's frame, from the reference to now
//! ```
//!
//! so that limb bones point in the same direction and hinges stay hinges. `E` is identity unless joints without an SMPL
//! counterpart (twist bones) move between the two ends of a bone. `S` is identity for pelvis, spine, neck, head, collars
//! and feet. The inverse is `G_s = G_t (E C)^-1`.
//!
//! The path of the pelvis is scaled with the leg length about the floor, and raised by the constant that keeps the feet of
//! the reference pose on the floor, because bodies also differ below the ankles and above the hips. With `floor`, `scale`
//! (leg over leg) and `rise`
//!
//! ```text
//! y_t = floor + scale (y_s - floor) + rise        x_t = scale x_s        z_t = scale z_s
//! ```

mod neutral;

pub use neutral::{OntoNeutral, to_smpl};

use crate::rig::reference::LIMBS;
use crate::rig::{Feet, Humanoid, ReferencePose};
use crate::rotation::swing;
use crate::{Clip, Error, GlobalPose, Quat, Result, Skeleton, Vec3, smpl};
use std::sync::Arc;

/// Retargeting between a rig and the SMPL-24 body, in both directions. See [`to_smpl`] for a motion that was read.
///
/// ```
/// use kinelm_motion::retarget::Retarget;
/// use kinelm_motion::rig::{Humanoid, SkeletonMap};
/// use kinelm_motion::{smpl, synth};
///
/// let map = SkeletonMap::builtin("smpl").expect("a built-in map");
/// let giant = Humanoid::with_map(&smpl::neutral().scaled(2.0), &map);
/// let retarget = Retarget::new(&giant, smpl::neutral())?;
/// let dance = synth::corpus(1, 1, 1.0, 20.0)?.remove(0).clip;
/// let on_giant = retarget.to_rig(&dance)?;
/// assert!((on_giant.root()[0].y - 2.0 * dance.root()[0].y).abs() < 1e-9);
/// # Ok::<(), kinelm_motion::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Retarget {
    rig: Arc<Skeleton>,
    smpl: Arc<Skeleton>,
    /// By SMPL id: the rig's joint and how it rotates the SMPL joint.
    links: [Option<Link>; 24],
    /// (J of the rig) local rotations of joints without an SMPL counterpart: the reference pose; identity above the pelvis.
    rest: Vec<Quat>,
    scale: f64,
    /// The height that keeps the feet of the reference pose on the floor, metres on the SMPL body.
    rise: f64,
    floor: f64,
    same: bool,
}

/// How a rig's joint rotates its SMPL joint.
#[derive(Debug, Clone)]
struct Link {
    joint: usize,
    /// `A_s^-1 S`.
    turn: Quat,
    bent: Option<Bent>,
}

/// A limb bone with joints between its ends.
#[derive(Debug, Clone)]
struct Bent {
    /// The joints from below the bone's upper end to its lower end.
    chain: Vec<usize>,
    /// The bone in the upper joint's frame, in the reference pose.
    straight: Vec3,
}

impl Retarget {
    /// Prepares retargeting between a rig and the SMPL-24 body `smpl` ([`smpl::neutral`] or a body with other offsets).
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when `smpl` hasn't SMPL's 24 joints; those of [`Humanoid::pose`].
    pub fn new(humanoid: &Humanoid, smpl: Arc<Skeleton>) -> Result<Self> {
        smpl::check_rig("the body to retarget to", &smpl)?;
        let (rig, pose) = (humanoid.rig().clone(), &*humanoid.pose()?);
        let still = GlobalPose::new(&smpl, Vec3::ZERO, &[Quat::IDENTITY; 24]);
        let scale = smpl_leg_m(&smpl) / pose.leg_m();
        let links = std::array::from_fn(|id| {
            let joint = pose.joints[id]?;
            let turn = pose.global.rotations[joint].conjugate() * bone_turn(&rig, pose, &still, id);
            Some(Link { joint, turn: turn.normalize(), bent: bent(&rig, pose, id, joint) })
        });
        let pelvis = pose.joints[0].unwrap_or(0);
        // joints above the pelvis needn't rotate: whatever they do, the pelvis's rotation is set in the world
        let above = |j: usize| j != pelvis && rig.descends(pelvis, j);
        let rest = (0..rig.joints()).map(|j| if above(j) { Quat::IDENTITY } else { pose.local[j] }).collect();
        let same = is_same(&rig, &smpl);
        // files may order the joints differently and add end sites
        let alike = same
            || (0..24).all(|id| {
                let joint = rig.names().iter().position(|name| name == smpl::NAMES[id]);
                joint.is_some_and(|j| id == 0 || rig.offsets()[j].distance(smpl.offsets()[id]) < 1e-6)
            });
        // exactly 1: the legs of a file with rounded offsets would scale every path by 1 + 1e-7
        let scale = if alike { 1.0 } else { scale };
        let mut retarget = Retarget { rig, smpl, links, rest, scale, rise: 0.0, floor: 0.0, same };
        if !alike {
            retarget.rise = retarget.rise(pose)?;
        }
        Ok(retarget)
    }

    /// Scales the path about a floor at this height, metres. The default is 0.
    pub fn with_floor(self, floor_m: f64) -> Self {
        Retarget { floor: floor_m, ..self }
    }

    /// The height beyond scaling that the SMPL pelvis needs for both bodies to stand in the reference pose.
    fn rise(&self, pose: &ReferencePose) -> Result<f64> {
        let stand = Clip::new(self.rig.clone(), 1.0, vec![Vec3::ZERO], pose.local.clone())?;
        let stand = self.to_smpl(&stand)?;
        let at_zero = Clip::new(self.smpl.clone(), 1.0, vec![Vec3::ZERO], stand.rotations().to_vec())?;
        let feet = Humanoid::with_map(&self.smpl, Humanoid::neutral().map()).feet()?.clearance(&at_zero);
        // the pelvis of `at_zero` is at y = 0, so minus the clearance is the height at which it stands
        Ok(-feet.first().copied().unwrap_or(0.0) - self.scale * Feet::from_pose(&self.rig, pose).pelvis_m)
    }

    fn smpl_root(&self, pelvis: Vec3) -> Vec3 {
        let raise = self.floor * (1.0 - self.scale) + self.rise;
        pelvis * self.scale + Vec3::Y * raise
    }

    fn rig_pelvis(&self, root: Vec3) -> Vec3 {
        let raise = self.floor * (1.0 - self.scale) + self.rise;
        (root - Vec3::Y * raise) / self.scale
    }

    /// The rig's skeleton.
    pub fn rig(&self) -> &Arc<Skeleton> {
        &self.rig
    }

    /// The factor of positions: the SMPL body's leg length over the rig's (hip to knee to ankle).
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// The rig's joint that corresponds to an SMPL joint.
    pub fn joint(&self, smpl_id: usize) -> Option<usize> {
        self.links.get(smpl_id)?.as_ref().map(|l| l.joint)
    }

    /// Puts a clip of the rig on the SMPL-24 body. The root follows the rig's pelvis, scaled about the floor and raised so
    /// that the feet stay on it. SMPL joints without a counterpart keep their rest rotation. A clip that is on this SMPL body
    /// already (offsets equal to a micrometre) is returned bit for bit.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when the clip is not on the rig.
    pub fn to_smpl(&self, clip: &Clip) -> Result<Clip> {
        check_on(clip, &self.rig)?;
        if self.same {
            return clip.clone().with_skeleton(self.smpl.clone());
        }
        let pelvis = self.joint(0).unwrap_or(0);
        let mut root = Vec::with_capacity(clip.frames());
        let mut rotations = Vec::with_capacity(clip.frames() * 24);
        let turning = self.turning();
        // from below the root down to the pelvis, each with its parent
        let mut chain: Vec<(usize, usize)> = std::iter::successors(Some(pelvis), |&j| self.rig.parents()[j])
            .filter_map(|j| Some((j, self.rig.parents()[j]?)))
            .collect();
        chain.reverse();
        let mut world = vec![Quat::IDENTITY; self.rig.joints()];
        for f in 0..clip.frames() {
            let local = clip.pose(f);
            for &(j, parent) in &turning {
                world[j] = parent.map_or(local[j], |parent: usize| world[parent] * local[j]);
            }
            let place = |place: Vec3, &(j, parent): &(usize, usize)| place + world[parent] * self.rig.offsets()[j];
            root.push(self.smpl_root(chain.iter().fold(clip.root()[f], place)));
            let mut global = [Quat::IDENTITY; 24];
            for id in 0..24 {
                let parent = smpl::PARENTS[id];
                let above = if parent < 0 { Quat::IDENTITY } else { global[parent as usize] };
                let Some(link) = &self.links[id] else {
                    // its children continue from the parent's frame, as if the joint were rigid
                    global[id] = above;
                    rotations.push(Quat::IDENTITY);
                    continue;
                };
                global[id] = world[link.joint] * link.turn_now(&self.rig, local);
                rotations.push((above.conjugate() * global[id]).normalize());
            }
        }
        Clip::new(self.smpl.clone(), clip.fps(), root, rotations)
    }

    /// Puts an SMPL-24 clip on the rig. Joints without an SMPL counterpart keep the reference pose.
    ///
    /// `to_smpl` of the result is the clip again up to rounding: its root, and the world rotations of all joints that the rig
    /// has. (If the rig lacks a joint between two that it has, their local rotations are recovered only if that joint was at
    /// rest.)
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when the clip is not on the SMPL-24 body.
    pub fn to_rig(&self, clip: &Clip) -> Result<Clip> {
        self.to_rig_over(clip, None)
    }

    /// Like [`Retarget::to_rig`], but joints without an SMPL counterpart (fingers, twist bones) move as in `base`, a clip on
    /// the rig; its last frame is held if it is shorter.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when the clip is not on the SMPL-24 body, or `base` not on the rig.
    pub fn to_rig_over(&self, clip: &Clip, base: Option<&Clip>) -> Result<Clip> {
        check_on(clip, &self.smpl)?;
        if let Some(base) = base {
            check_on(base, &self.rig)?;
        }
        if self.same {
            return clip.clone().with_skeleton(self.rig.clone());
        }
        let base = base.filter(|b| b.frames() > 0);
        let by_joint = self.by_joint();
        let mut root = Vec::with_capacity(clip.frames());
        let mut rotations = Vec::with_capacity(clip.frames() * self.rig.joints());
        let mut pose = GlobalPose::default();
        for f in 0..clip.frames() {
            let rest = base.map_or(self.rest.as_slice(), |b| b.pose(f.min(b.frames() - 1)));
            pose.set(&self.smpl, clip.root()[f], clip.pose(f));
            let from = rotations.len();
            self.rig_frame(&by_joint, rest, &pose.rotations, &mut rotations);
            root.push(self.rig_root(self.rig_pelvis(clip.root()[f]), &rotations[from..]));
        }
        Clip::new(self.rig.clone(), clip.fps(), root, rotations)
    }

    /// The joints that SMPL's turn with, and all above them, from the root downwards, each with its parent: not fingers and
    /// twist bones.
    fn turning(&self) -> Vec<(usize, Option<usize>)> {
        let mut turns = vec![false; self.rig.joints()];
        let parents = self.rig.parents();
        self.links.iter().flatten().for_each(|link| turns[link.joint] = true);
        for j in (0..turns.len()).rev().filter(|j| *j > 0) {
            if let Some(parent) = parents[j] {
                turns[parent] |= turns[j];
            }
        }
        (0..turns.len()).filter(|j| turns[*j]).map(|j| (j, parents[j])).collect()
    }

    /// The SMPL id of each joint of the rig.
    fn by_joint(&self) -> Vec<Option<usize>> {
        let mut ids = vec![None; self.rig.joints()];
        for id in (0..24).rev() {
            if let Some(joint) = self.joint(id) {
                ids[joint] = Some(id);
            }
        }
        ids
    }

    /// Appends the rig's local rotations of one frame; `rest` for joints without an SMPL counterpart.
    fn rig_frame(&self, by_joint: &[Option<usize>], rest: &[Quat], smpl: &[Quat], out: &mut Vec<Quat>) {
        let mut global = vec![Quat::IDENTITY; self.rig.joints()];
        for j in 0..self.rig.joints() {
            let above = self.rig.parents()[j].map_or(Quat::IDENTITY, |p| global[p]);
            let link = by_joint[j].and_then(|id| Some((id, self.links[id].as_ref()?)));
            let local = match link {
                None => rest[j],
                Some((id, link)) => {
                    (above.conjugate() * smpl[id] * link.turn_now(&self.rig, rest).conjugate()).normalize()
                }
            };
            global[j] = above * local;
            out.push(local);
        }
    }

    /// The root position that puts the pelvis at `pelvis`.
    fn rig_root(&self, pelvis: Vec3, local: &[Quat]) -> Vec3 {
        let mut at = self.joint(0).unwrap_or(0);
        // upwards from the pelvis: its position in the frame of each ancestor
        let mut place = Vec3::ZERO;
        while let Some(parent) = self.rig.parents()[at] {
            // a clip's root position replaces the root's offset, which therefore isn't added at the end of the loop
            place = self.rig.offsets()[at] + place;
            place = local[parent] * place;
            at = parent;
        }
        pelvis - place
    }
}

impl Link {
    /// `E C` for the rig's local rotations (J) of one frame.
    fn turn_now(&self, rig: &Skeleton, local: &[Quat]) -> Quat {
        let Some(bent) = &self.bent else { return self.turn };
        swing(bent.straight, along(rig, &bent.chain, local)) * self.turn
    }
}

/// Position of a chain's last joint in the frame of the chain's parent.
fn along(rig: &Skeleton, chain: &[usize], local: &[Quat]) -> Vec3 {
    chain.iter().rev().fold(Vec3::ZERO, |place, &j| rig.offsets()[j] + local[j] * place)
}

/// `S`: the smallest rotation from the SMPL bone at rest to the rig's in the reference pose; identity except for limbs.
fn bone_turn(rig: &Skeleton, pose: &ReferencePose, still: &GlobalPose, id: usize) -> Quat {
    if let Some((_, lower)) = LIMBS.iter().find(|(upper, _)| *upper == id) {
        let (Some(a), Some(b)) = (pose.position(id), pose.position(*lower)) else { return Quat::IDENTITY };
        return swing(still.positions[*lower] - still.positions[id], b - a);
    }
    // hands align with the hand's own bone if the rig has one, else with the forearm
    let (elbow, wrist, hand) = match id {
        20 | 22 => (18, 20, 22),
        21 | 23 => (19, 21, 23),
        _ => return Quat::IDENTITY,
    };
    let rest = still.positions[hand] - still.positions[wrist];
    match hand_bone(rig, pose, wrist, hand) {
        Some(bone) => swing(rest, bone),
        None => bone_turn(rig, pose, still, elbow),
    }
}

/// The hand's bone in the reference pose: to the joint of SMPL's hand, else to the wrist's only child or end site.
fn hand_bone(rig: &Skeleton, pose: &ReferencePose, wrist: usize, hand: usize) -> Option<Vec3> {
    let joint = pose.joints[wrist]?;
    let bone = match pose.joints[hand].filter(|&h| rig.descends(h, joint)) {
        Some(hand) => pose.global.positions[hand] - pose.global.positions[joint],
        None => {
            let mut offsets = rig.children(joint).map(|c| rig.offsets()[c]).collect::<Vec<_>>();
            offsets.extend(rig.ends().iter().filter(|e| e.parent == joint).map(|e| e.offset));
            match offsets.as_slice() {
                [one] => pose.global.rotations[joint] * *one,
                _ => return None,
            }
        }
    };
    (bone.length() > 1e-6).then_some(bone)
}

/// The joints between the ends of a limb bone, if there are any.
fn bent(rig: &Skeleton, pose: &ReferencePose, id: usize, joint: usize) -> Option<Bent> {
    let (_, lower) = LIMBS.iter().find(|(upper, _)| *upper == id)?;
    let mut at = pose.joints[*lower]?;
    let mut chain = Vec::new();
    while at != joint {
        chain.push(at);
        at = rig.parents()[at]?;
    }
    chain.reverse();
    let straight = along(rig, &chain, &pose.local);
    (chain.len() > 1).then_some(Bent { chain, straight })
}

fn smpl_leg_m(smpl: &Skeleton) -> f64 {
    0.5 * [4, 5, 7, 8].iter().map(|&j: &usize| smpl.offsets()[j].length()).sum::<f64>()
}

fn is_same(rig: &Skeleton, smpl: &Skeleton) -> bool {
    // kinematics ignores the root's offset; files round the others
    let offsets = || rig.offsets()[1..].iter().zip(&smpl.offsets()[1..]);
    rig.names() == smpl.names() && rig.parents() == smpl.parents() && offsets().all(|(a, b)| a.distance(*b) < 1e-6)
}

/// Checks for the same joints and parents, and the same offsets to a millimetre.
fn check_on(clip: &Clip, body: &Skeleton) -> Result<()> {
    let on = clip.skeleton();
    if on.names() != body.names() || on.parents() != body.parents() {
        let joints = |s: &Skeleton| format!("{} joints from {}", s.joints(), s.names()[0]);
        let expected = format!("the {} of the body that this is for", joints(body));
        return Err(Error::invalid("the clip to retarget", format!("one of {}", joints(on)), expected));
    }
    let far = (1..on.joints()).find(|&j| (on.offsets()[j] - body.offsets()[j]).length() > 1e-3);
    match far {
        None => Ok(()),
        Some(j) => {
            let what = format!("the offset of {} in the clip to retarget", on.names()[j]);
            let expected = format!("{}, as in the body that this is for", body.offsets()[j]);
            Err(Error::invalid(what, on.offsets()[j], expected))
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
