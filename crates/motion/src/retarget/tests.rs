//! Rigs with any axes, lengths and extra joints, made from the SMPL body, so that the right answer is known.

use super::*;
use crate::format::Axes;
use crate::format::floor_height;
use crate::rig::SkeletonMap;
use crate::rotation::tests::any_quat;
use crate::rotation::{EulerOrder, angle_between, exp_map};
use crate::{Motion, Source};
use proptest::prelude::*;
use std::fmt::Write;
use std::path::Path;

/// A rig with the joints of SMPL under other names, at `places` in the reference pose, each with its own `axes`; a
/// twist joint in the middle of each thigh and upper arm, and a root above the pelvis, if requested. The joints in
/// `lacks` are left out.
pub fn rig(positions: &[Vec3], axes: &[Quat], extra: bool, lacks: &[usize]) -> (Skeleton, SkeletonMap) {
    let (mut names, mut parents, mut at, mut turned) = (vec![], vec![], vec![], vec![]);
    let mut push = |name: String, parent: Option<usize>, place: Vec3, axes: Quat| {
        names.push(name);
        parents.push(parent);
        at.push(place);
        turned.push(axes);
        names.len() - 1
    };
    let above = extra.then(|| push("world".into(), None, Vec3::ZERO, Quat::IDENTITY));
    let mut joint = [0; 24];
    for id in (0..24).filter(|id| !lacks.contains(id)) {
        let mut parent = smpl::PARENTS[id];
        while lacks.contains(&(parent as usize)) {
            parent = smpl::PARENTS[parent as usize];
        }
        let mut on = if parent < 0 { above } else { Some(joint[parent as usize]) };
        if extra && matches!(id, 4 | 5 | 18 | 19) {
            let middle = 0.5 * (positions[id] + positions[parent as usize]);
            on = Some(push(format!("twist of {id}"), on, middle, axes[23 - id]));
        }
        joint[id] = push(format!("bone {id}"), on, positions[id], axes[id]);
    }
    let local = |j: usize, p: Option<usize>| p.map_or(turned[j], |p: usize| turned[p].conjugate() * turned[j]);
    let mut toml = String::from("name = \"made\"\n[joints]\n");
    for id in (0..24).filter(|id| !lacks.contains(id)) {
        writeln!(toml, "{} = \"bone {id}\"", smpl::NAMES[id]).unwrap();
    }
    toml += "[reference]\norder = \"YXZ\"\n[reference.rotations]\n";
    let order = EulerOrder::ALL[2];
    for (j, name) in names.iter().enumerate() {
        let degrees = order.from_quat(local(j, parents[j]), 0.0).map(f64::to_degrees);
        writeln!(toml, "{name:?} = {degrees:?}").unwrap();
    }
    let offsets = (0..names.len())
        .map(|j| parents[j].map_or(at[j], |p: usize| turned[p].conjugate() * (at[j] - at[p])))
        .collect();
    let map = SkeletonMap::parse(&toml, Path::new("made.toml")).unwrap();
    (Skeleton::new(names, parents, offsets, vec![]).unwrap(), map)
}

/// The joint positions of the SMPL body in a stand whose arms hang by `droop` radians, every bone `stretch[id]` times as long.
pub fn reference_positions(droop: f64, stretch: &[f64]) -> Vec<Vec3> {
    let mut pose = [Quat::IDENTITY; 24];
    pose[16] = Quat::from_rotation_z(-droop);
    pose[17] = Quat::from_rotation_z(droop);
    let body = smpl::neutral();
    let offsets = body.offsets().iter().zip(stretch).map(|(o, s)| *o * *s).collect();
    let body = Skeleton::new(body.names().to_vec(), body.parents().to_vec(), offsets, vec![]).unwrap();
    GlobalPose::new(&body, Vec3::new(0.0, 0.9, 0.0), &pose).positions
}

/// A clip on the SMPL body from rotation vectors (F, 24).
fn dance(vectors: &[[f64; 3]]) -> Clip {
    let rotations: Vec<_> = vectors.iter().map(|&v| exp_map::from_vector(Vec3::from_array(v))).collect();
    let root = (0..rotations.len() / 24).map(|f| Vec3::new(0.1 * f as f64, 0.97, -0.2)).collect();
    Clip::new(smpl::neutral(), 30.0, root, rotations).unwrap()
}

fn axes() -> impl Strategy<Value = Vec<Quat>> {
    prop::collection::vec(any_quat(), 24)
}

fn vectors(frames: usize) -> impl Strategy<Value = Vec<[f64; 3]>> {
    prop::collection::vec(prop::array::uniform3(-1.5..1.5f64), 24 * frames)
}

fn stretches() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(0.7..1.4f64, 24)
}

/// The largest angle between a limb bone of a rig and its image, radians, over all frames.
fn limb_error(retarget: &Retarget, on_rig: &Clip, on_smpl: &Clip) -> f64 {
    let mut worst: f64 = 0.0;
    for f in 0..on_rig.frames() {
        let (a, b) = (on_rig.global_pose(f).positions, on_smpl.global_pose(f).positions);
        for (upper, lower) in LIMBS {
            let bone = a[retarget.joint(lower).unwrap()] - a[retarget.joint(upper).unwrap()];
            worst = worst.max(bone.angle_between(b[lower] - b[upper]));
        }
    }
    worst
}

fn worst_angle(a: &Clip, b: &Clip, joints: &[usize]) -> f64 {
    let each = |f: usize| joints.iter().map(move |&j| angle_between(a.pose(f)[j], b.pose(f)[j]));
    (0..a.frames()).flat_map(each).fold(0.0, f64::max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn a_dance_seen_through_other_axes_is_the_same_dance(axes in axes(), v in vectors(2), extra: bool) {
        let (body, map) = rig(&reference_positions(0.0, &[1.0; 24]), &axes, extra, &[]);
        let retarget = Retarget::new(&Humanoid::with_map(&body, &map), smpl::neutral()).unwrap();
        prop_assert!((retarget.scale() - 1.0).abs() < 1e-9);
        let x = dance(&v);
        // the same world rotations, in the rig's axes: G = D A
        let mut rotations = Vec::new();
        for f in 0..2 {
            let d = x.global_pose(f).rotations;
            let mut world = vec![Quat::IDENTITY; body.joints()];
            for (j, name) in body.names().iter().enumerate() {
                let id = name.strip_prefix("bone ").map(|n| n.parse::<usize>().unwrap());
                let twist = name.strip_prefix("twist of ").map(|n| n.parse::<usize>().unwrap());
                if let Some(id) = id {
                    world[j] = d[id] * axes[id];
                } else if let Some(id) = twist {
                    world[j] = d[smpl::PARENTS[id] as usize] * axes[23 - id];
                }
            }
            rotations.extend(GlobalPose { positions: vec![], rotations: world }.to_local(&body));
        }
        let root = if extra { vec![Vec3::ZERO; 2] } else { x.root().to_vec() };
        let y = retarget.to_smpl(&Clip::new(Arc::new(body), 30.0, root, rotations).unwrap()).unwrap();
        prop_assert!(worst_angle(&x, &y, &(0..24).collect::<Vec<_>>()) < 1e-7);
    }

    #[test]
    fn limb_bones_point_alike_on_any_body(
        axes in axes(), v in vectors(3), s in stretches(), droop in 0.0..1.5f64, extra: bool,
        twists in prop::collection::vec(prop::array::uniform3(-0.4..0.4f64), 12),
    ) {
        let (body, map) = rig(&reference_positions(droop, &s), &axes, extra, &[]);
        let retarget = Retarget::new(&Humanoid::with_map(&body, &map), smpl::neutral()).unwrap();
        let on_rig = retarget.to_rig(&dance(&v)).unwrap();
        // the joints between turn on their own, as no SMPL motion would have them
        let mut rotations = on_rig.rotations().to_vec();
        for (k, q) in rotations.iter_mut().enumerate() {
            if body.names()[k % body.joints()].starts_with("twist") {
                *q *= exp_map::from_vector(Vec3::from_array(twists[k % 12]));
            }
        }
        let root = on_rig.root().iter().map(|p| *p + Vec3::Y).collect();
        let on_rig = Clip::new(on_rig.skeleton().clone(), 30.0, root, rotations).unwrap();
        let on_smpl = retarget.to_smpl(&on_rig).unwrap();
        prop_assert!(limb_error(&retarget, &on_rig, &on_smpl) < 1e-6);
        // and over the first, the way back has the same joints between
        let back = retarget.to_rig_over(&on_smpl, Some(&on_rig)).unwrap();
        let all: Vec<_> = (0..body.joints()).collect();
        prop_assert!(worst_angle(&back, &on_rig, &all) < 1e-7);
        for (a, b) in back.root().iter().zip(on_rig.root()) {
            prop_assert!((*a - *b).length() < 1e-9);
        }
    }

    #[test]
    fn there_and_back_is_the_identity(axes in axes(), v in vectors(2), s in stretches(), extra: bool, base: bool) {
        let (body, map) = rig(&reference_positions(0.6, &s), &axes, extra, &[]);
        let retarget = Retarget::new(&Humanoid::with_map(&body, &map), smpl::neutral()).unwrap();
        let x = dance(&v);
        let other = retarget.to_rig(&dance(&v.iter().rev().copied().collect::<Vec<_>>())).unwrap().slice(0..1);
        let y = retarget.to_smpl(&retarget.to_rig_over(&x, base.then_some(&other)).unwrap()).unwrap();
        prop_assert!(worst_angle(&x, &y, &(0..24).collect::<Vec<_>>()) < 1e-9);
        for (a, b) in x.root().iter().zip(y.root()) {
            prop_assert!((*a - *b).length() < 1e-9);
        }
    }

    #[test]
    fn rigs_that_lack_joints_keep_the_rest(axes in axes(), v in vectors(2), s in stretches()) {
        let lacks = [3, 6, 10, 11, 12, 13, 14, 22, 23];
        let (body, map) = rig(&reference_positions(0.3, &s), &axes, false, &lacks);
        let retarget = Retarget::new(&Humanoid::with_map(&body, &map), smpl::neutral()).unwrap();
        let still = |i: usize| lacks.contains(&(i % 24));
        let x = dance(&v.iter().enumerate().map(|(i, v)| if still(i) { [0.0; 3] } else { *v }).collect::<Vec<_>>());
        let on_rig = retarget.to_rig(&x).unwrap();
        let y = retarget.to_smpl(&on_rig).unwrap();
        prop_assert!(worst_angle(&x, &y, &(0..24).collect::<Vec<_>>()) < 1e-9);
        prop_assert!(limb_error(&retarget, &on_rig, &y) < 1e-6);
        for id in lacks {
            prop_assert_eq!(y.pose(1)[id], Quat::IDENTITY);
        }
        // joints that it lacks but that move: the others' world rotations come back all the same
        let x = dance(&v);
        let y = retarget.to_smpl(&retarget.to_rig(&x).unwrap()).unwrap();
        let (a, b) = (x.global_pose(0).rotations, y.global_pose(0).rotations);
        for id in (0..24).filter(|id| !lacks.contains(id)) {
            prop_assert!(angle_between(a[id], b[id]) < 1e-9);
        }
    }
}

fn smpl_map() -> SkeletonMap {
    SkeletonMap::builtin("smpl").unwrap()
}

#[test]
fn the_smpl_body_itself_is_left_alone() {
    let v: Vec<_> = (0..48).map(|i| [(i as f64).sin(), 0.3, (i as f64).cos()]).collect();
    let x = dance(&v);
    let retarget = Retarget::new(&Humanoid::with_map(&smpl::neutral(), &smpl_map()), smpl::neutral()).unwrap();
    assert_eq!(retarget.to_smpl(&x).unwrap(), x);
    assert_eq!(retarget.to_rig(&x).unwrap(), x);
    assert_eq!(retarget.scale(), 1.0);
}

#[test]
fn the_root_is_scaled_by_the_legs() {
    let big = smpl::neutral().scaled(2.0);
    let retarget = Retarget::new(&Humanoid::with_map(&big, &smpl_map()), smpl::neutral()).unwrap();
    assert!((retarget.scale() - 0.5).abs() < 1e-12);
    let stand = Clip::new(Arc::new(big), 30.0, vec![Vec3::new(1.0, 1.94, -3.0)], vec![Quat::IDENTITY; 24]).unwrap();
    let small = retarget.to_smpl(&stand).unwrap();
    assert!((small.root()[0] - Vec3::new(0.5, 0.97, -1.5)).length() < 1e-12);
    assert!(small.positions()[10].y.abs() < 1e-12, "the foot stays on the floor");
}

#[test]
fn a_rig_that_faces_elsewhere_at_rest_is_turned() {
    // the same body with z up, or looking backward, at zero
    let quarters = [Quat::from_rotation_x(std::f64::consts::FRAC_PI_2), Quat::from_rotation_y(std::f64::consts::PI)];
    for turn in quarters {
        let body = smpl::neutral();
        let offsets = body.offsets().iter().map(|o| turn * *o).collect();
        let rig = Skeleton::new(body.names().to_vec(), body.parents().to_vec(), offsets, vec![]).unwrap();
        let retarget = Retarget::new(&Humanoid::with_map(&rig, &smpl_map()), body).unwrap();
        let x = dance(&[[0.3, -0.2, 0.5]; 24]);
        let mut rotations: Vec<_> = x.pose(0).iter().map(|q| turn * *q * turn.conjugate()).collect();
        rotations[0] = x.pose(0)[0] * turn.conjugate();
        let y = retarget.to_smpl(&Clip::new(Arc::new(rig), 30.0, x.root().to_vec(), rotations).unwrap()).unwrap();
        assert!(worst_angle(&x, &y, &(0..24).collect::<Vec<_>>()) < 1e-9);
    }
}

#[test]
fn refusals_say_what_is_missing_and_what_to_write() {
    let body = smpl::neutral();
    // a body without its arms
    let names = body.names()[..16].iter().map(|n| n.replace("left_knee", "tail").replace("pelvis", "Hips")).collect();
    let rig = Skeleton::new(names, body.parents()[..16].to_vec(), body.offsets()[..16].to_vec(), vec![]).unwrap();
    let e = crate::rig::map_for(&rig, None).unwrap_err().to_string();
    assert!(e.contains("the nearest, smpl, finds no left_knee, left_shoulder,"), "{e}");
    assert!(e.contains("pelvis = \"Hips\"") && e.contains("left_knee = \"?\""), "{e}");
    let e = Retarget::new(&Humanoid::with_map(&rig, &smpl_map()), body.clone()).unwrap_err().to_string();
    assert!(e.contains("the skeleton map smpl finds no left_knee, left_shoulder,"), "{e}");
    assert!(crate::rig::map_for(&rig, Some("no-such")).is_err());

    // the legs of this one point forward at zero
    let mut offsets = body.offsets().to_vec();
    offsets[4] = Vec3::new(0.0, 0.0, 0.41);
    let rig = Skeleton::new(body.names().to_vec(), body.parents().to_vec(), offsets, vec![]).unwrap();
    let e = Retarget::new(&Humanoid::with_map(&rig, &smpl_map()), body.clone()).unwrap_err().to_string();
    assert!(e.contains("left_hip to left_knee does not point down") && e.contains("[reference]"), "{e}");

    let mut offsets = body.offsets().to_vec();
    offsets[20] = Vec3::ZERO;
    let rig = Skeleton::new(body.names().to_vec(), body.parents().to_vec(), offsets, vec![]).unwrap();
    let e = Retarget::new(&Humanoid::with_map(&rig, &smpl_map()), body.clone()).unwrap_err().to_string();
    assert!(e.contains("left_elbow to left_wrist"), "{e}");

    let mut parents = body.parents().to_vec();
    parents[20] = Some(0);
    let rig = Skeleton::new(body.names().to_vec(), parents, body.offsets().to_vec(), vec![]).unwrap();
    let e = Retarget::new(&Humanoid::with_map(&rig, &smpl_map()), body.clone()).unwrap_err().to_string();
    assert!(e.contains("left_wrist") && e.contains("one chain"), "{e}");

    let retarget = Retarget::new(&Humanoid::with_map(&body.scaled(2.0), &smpl_map()), body.clone()).unwrap();
    let e = retarget.to_smpl(&dance(&[[0.0; 3]; 24])).unwrap_err().to_string();
    assert!(e.contains("the offset of left_hip"), "{e}");
}

#[test]
fn smpl_files_keep_their_rotations() {
    let x = dance(&[[0.3, -0.2, 0.5]; 24]);
    let stretched = smpl::neutral().offsets().iter().map(|o| *o * 1.1 + Vec3::new(0.0, 0.0, 0.01)).collect();
    let body = Skeleton::new(smpl::neutral().names().to_vec(), smpl::neutral().parents().to_vec(), stretched, vec![]);
    let source = Source::Aist { scaling: 90.0, rest_pelvis: Vec3::ZERO, body_model: true, axes: Axes::OWN };
    let clip = x.clone().with_skeleton(Arc::new(body.unwrap())).unwrap();
    let motion = Motion::new("a.pkl", clip).with_source(source);
    let y = to_smpl(&motion).unwrap();
    assert_eq!(y.rotations(), x.rotations());
    let floor = floor_height(&motion).unwrap();
    assert!(((y.root()[0].y - floor) / (x.root()[0].y - floor) - 1.0 / 1.1).abs() < 0.01);
    assert_eq!(to_smpl(&Motion::new("a.json", x.clone())).unwrap(), x);
}
