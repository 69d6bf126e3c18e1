use super::*;
use crate::rotation::exp_map;
use crate::{Quat, Skeleton, Vec3, smpl};
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

/// Two bones of a metre along x; frames of (root position, two rotation vectors).
fn arm(frames: &[(Vec3, [Vec3; 2])]) -> Clip {
    let names = ["a", "b", "c"].map(String::from).to_vec();
    let bone = Vec3::X;
    let s = Skeleton::new(names, vec![None, Some(0), Some(1)], vec![Vec3::ZERO, bone, bone], vec![]).unwrap();
    let root = frames.iter().map(|f| f.0).collect();
    let turns = frames.iter().flat_map(|f| [f.1[0], f.1[1], Vec3::ZERO]).map(exp_map::from_vector).collect();
    Clip::new(Arc::new(s), 20.0, root, turns).unwrap()
}

fn straight(frames: usize) -> Clip {
    arm(&vec![(Vec3::ZERO, [Vec3::ZERO; 2]); frames])
}

/// All joints of the model rig swing, by the same formulas as in the golden file's script.
fn swinging(frames: usize, error: f64) -> Clip {
    let (mut root, mut turns) = (Vec::new(), Vec::new());
    for f in 0..frames {
        let t = f as f64;
        root.push(Vec3::new(
            0.3 * (0.2 * t).sin() + error * (0.9 * t).sin(),
            0.95 + 0.05 * (0.3 * t).cos() + error * (1.1 * t).cos(),
            0.02 * t + error * (0.7 * t + 1.0).sin(),
        ));
        for j in 0..24 {
            let j = f64::from(j);
            let part = |i: f64| {
                let swing = 1.1 * (0.37 * t * (1.0 + 0.1 * j) + 1.3 * i + j).sin();
                swing + error * (1.7 * t + 0.9 * j + 2.1 * i).sin()
            };
            turns.push(exp_map::from_vector(Vec3::new(part(0.0), part(1.0), part(2.0))));
        }
    }
    Clip::new(smpl::neutral(), 20.0, root, turns).unwrap()
}

/// All measures of two clips, all joints, borders every 4 frames.
#[derive(Debug, Clone, PartialEq)]
struct Figures {
    geodesic: [f64; 5],
    vector: [f64; 3],
    skipped: [u64; 2],
    mpjpe: [f64; 3],
    jerk: Option<f64>,
}

struct All(GeodesicError, VectorAngle, Mpjpe, BorderJerk);

impl All {
    fn new(joints: usize) -> Self {
        let joints: Vec<usize> = (0..joints).collect();
        All(GeodesicError::new(joints.clone()), VectorAngle::new(joints), Mpjpe::default(), BorderJerk::new(4))
    }

    fn add(mut self, a: &Clip, b: &Clip) -> Self {
        self.0.add(a, b).unwrap();
        self.1.add(a, b).unwrap();
        self.2.add(a, b).unwrap();
        self.3.add(a, b).unwrap();
        self
    }

    fn figures(&self) -> Figures {
        let All(g, v, m, j) = self;
        Figures {
            geodesic: [g.mean(), g.rms(), g.percentile_99(), g.max(), g.sum_joints()],
            vector: [v.mean_joint(), v.mean_frame(), v.max_joint()],
            skipped: v.skipped(),
            mpjpe: [m.global_mm(), m.root_mm(), m.max_mm()],
            jerk: j.ratio(),
        }
    }
}

fn figures(a: &Clip, b: &Clip) -> Figures {
    All::new(a.joints()).add(a, b).figures()
}

fn near(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance
}

#[test]
fn a_clip_is_no_distance_from_itself() {
    let clip = swinging(30, 0.0);
    let f = figures(&clip, &clip);
    // conj(q) q is the identity up to rounding
    assert!(f.geodesic.iter().all(|x| *x < 1e-14), "{f:?}");
    assert_eq!((f.vector, f.mpjpe, f.jerk), ([0.0; 3], [0.0; 3], Some(1.0)));
    let other_sign =
        Clip::new(clip.skeleton().clone(), 20.0, clip.root().to_vec(), clip.rotations().iter().map(|q| -*q).collect());
    assert!(figures(&clip, &other_sign.unwrap()).geodesic[3] < 1e-14, "q and -q are equal");
    assert_eq!(figures(&straight(0), &straight(0)).geodesic, [0.0; 5], "no frames");
}

#[test]
fn by_hand() {
    // frame 0: the upper arm rotated by a right angle; frame 1: the arm moved by 0.3 m and the forearm rotated by 0.2 rad
    let a = straight(2);
    let quarter = Vec3::new(0.0, 0.0, FRAC_PI_2);
    let b = arm(&[(Vec3::ZERO, [quarter, Vec3::ZERO]), (Vec3::Y * 0.3, [Vec3::ZERO, Vec3::Z * 0.2])]);
    let f = figures(&a, &b);
    let sum = FRAC_PI_2 + 0.2;
    assert!(near(f.geodesic[0], sum / 6.0, 1e-15) && near(f.geodesic[4], sum / 2.0, 1e-15), "{f:?}");
    assert!(near(f.geodesic[1], ((FRAC_PI_2 * FRAC_PI_2 + 0.04) / 6.0).sqrt(), 1e-15));
    assert!(near(f.geodesic[3], FRAC_PI_2, 1e-15) && near(f.geodesic[2], FRAC_PI_2, 1e-15));
    // frame 0: 0, sqrt 2, 2 sqrt 2; frame 1: 0.3, 0.3, and 2 sin 0.1 across, seen from (1, 0.3)
    let tip = Vec3::new(0.2f64.cos() - 1.0, 0.3 + 0.2f64.sin(), 0.0);
    let global = 3.0 * 2f64.sqrt() + 0.6 + tip.length();
    assert!(near(f.mpjpe[0], 1000.0 * global / 6.0, 1e-9), "{f:?}");
    assert!(near(f.mpjpe[1], 1000.0 * (3.0 * 2f64.sqrt() + 2.0 * 0.1f64.sin()) / 6.0, 1e-9));
    assert!(near(f.mpjpe[2], 2000.0 * 2f64.sqrt(), 1e-9));
    // every vector of `a` is zero: nothing has a direction
    assert_eq!((f.vector, f.skipped, f.jerk), ([0.0; 3], [6, 2], None));
}

#[test]
fn the_vector_angle_sees_the_axis_alone() {
    let one = |v: [Vec3; 2]| arm(&[(Vec3::ZERO, v)]);
    let a = one([Vec3::X * 0.1, Vec3::Y * 0.2]);
    let f = figures(&a, &one([Vec3::X * 1.7, Vec3::Y * 3.0]));
    assert_eq!((f.vector[0], f.vector[2], f.skipped), (0.0, 0.0, [1, 0]));
    // (0.1, 0.2) against (1.7, 3.0)
    let cosine = (0.17 + 0.6) / (0.05f64.sqrt() * 11.89f64.sqrt());
    assert!(near(f.vector[1], cosine.acos(), 1e-12), "{f:?}");
    let f = figures(&a, &one([Vec3::Y * 0.1, Vec3::Y * -0.2]));
    assert!(near(f.vector[0], (FRAC_PI_2 + PI) / 2.0, 1e-12) && near(f.vector[2], PI, 1e-12), "{f:?}");
}

#[test]
fn a_jump_at_a_border_is_seen() {
    // a cubic has one jerk everywhere; a jump of h at a border adds h, 2h, h to the three that touch it
    let cubic = |f: usize| 0.001 * (f as f64).powi(3);
    let line = |jump: f64| {
        let at = |f: usize| Vec3::X * (cubic(f) - jump * (f / 8) as f64);
        arm(&(0..24).map(|f| (at(f), [Vec3::ZERO; 2])).collect::<Vec<_>>())
    };
    let ratio = |hop: usize, jump: f64| {
        let mut j = BorderJerk::new(hop);
        j.add(&line(0.0), &line(jump)).unwrap();
        j.ratio()
    };
    assert!(near(ratio(8, 0.0).unwrap(), 1.0, 1e-9));
    // jerk 0.006; with a jump back of 0.03: |0.006 - 0.03|, |0.006 + 0.06|, |0.006 - 0.03|, over 0.006
    assert!(near(ratio(8, 0.03).unwrap(), (0.024 + 0.066 + 0.024) / 3.0 / 0.006, 1e-6), "{:?}", ratio(8, 0.03));
    assert_eq!((ratio(3, 0.03), ratio(1, 0.03), ratio(24, 0.03)), (None, None, None), "nothing inside, or no border");
    let (mut a, mut b) = (BorderJerk::new(8), BorderJerk::new(8));
    a.add(&line(0.0), &line(0.03)).unwrap();
    b.add(&line(0.03), &line(0.0)).unwrap();
    assert!(near(a.ratio().unwrap() * b.ratio().unwrap(), 1.0, 1e-12), "turned round, it is the inverse");
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let (a, b) = (straight(2), straight(3));
    let message = |e: Result<()>| e.unwrap_err().to_string();
    let expected = "the second clip is one of 3 frames and 3 joints; expected 2 frames and 3 joints, as the first has";
    assert_eq!(message(Mpjpe::default().add(&a, &b)), expected);
    assert_eq!(message(GeodesicError::new(vec![0]).add(&a, &b)), expected);
    assert_eq!(message(VectorAngle::new(vec![0]).add(&a, &b)), expected);
    assert_eq!(message(BorderJerk::new(1).add(&a, &b)), expected);
    assert!(message(GeodesicError::new(vec![3]).add(&a, &a)).contains("a joint to measure is 3; expected less than 3"));
    assert!(message(Mpjpe::default().add_positions(&[Vec3::ZERO; 4], &[Vec3::ZERO; 4], 3)).contains("whole frames"));
}

#[test]
fn parts_merge_in_order_to_the_same_bits() {
    let pairs: Vec<(Clip, Clip)> = (5..9).map(|n| (swinging(n, 0.0), swinging(n, 0.01 * n as f64))).collect();
    let whole = pairs.iter().fold(All::new(24), |all, (a, b)| all.add(a, b)).figures();
    let merged = |order: &[usize]| {
        let mut all = All::new(24);
        for &i in order {
            let one = All::new(24).add(&pairs[i].0, &pairs[i].1);
            all.0.merge(&one.0);
            all.1.merge(&one.1);
            all.2.merge(&one.2);
            all.3.merge(&one.3);
        }
        all.figures()
    };
    let parts = merged(&[0, 1, 2, 3]);
    assert_eq!(parts, merged(&[0, 1, 2, 3]));
    for (a, b) in parts.geodesic.iter().chain(&parts.mpjpe).zip(whole.geodesic.iter().chain(&whole.mpjpe)) {
        assert!(near(*a, *b, 1e-12 * b.abs()), "{parts:?} {whole:?}");
    }
}

/// Both programs compute in f64 in different ways: matrices and scipy's rotations there, quaternions here.
const AS_NUMPY: f64 = 1e-11;

#[test]
fn as_numpy_and_scipy_have_it() {
    let golden: serde_json::Value = serde_json::from_str(include_str!("../../tests/golden/metrics.json")).unwrap();
    for case in golden["cases"].as_array().unwrap() {
        let number = |key: &str| case[key].as_f64().unwrap_or_else(|| panic!("{key} in {case}"));
        let frames = case["frames"].as_u64().unwrap() as usize;
        let f = figures(&swinging(frames, 0.0), &swinging(frames, number("error")));
        let pairs = [
            ("geodesic_mean", f.geodesic[0]),
            ("geodesic_rms", f.geodesic[1]),
            ("geodesic_max", f.geodesic[3]),
            ("geodesic_sum_joints", f.geodesic[4]),
            ("vector_mean_joint", f.vector[0]),
            ("vector_mean_frame", f.vector[1]),
            ("vector_max_joint", f.vector[2]),
            ("mpjpe_global_mm", f.mpjpe[0]),
            ("mpjpe_root_mm", f.mpjpe[1]),
            ("mpjpe_max_mm", f.mpjpe[2]),
            ("border_jerk_ratio", f.jerk.unwrap()),
        ];
        for (key, ours) in pairs {
            assert!(near(ours, number(key), AS_NUMPY * number(key).max(1.0)), "{key}: {ours}, numpy {}", number(key));
        }
        let exact = number("geodesic_percentile_99");
        assert!(f.geodesic[2] >= exact * (1.0 - 1e-12) && f.geodesic[2] <= exact * (1.0 + 1.0 / 1023.0));
    }
}

proptest! {
    #[test]
    fn either_clip_may_be_the_first(error in 0.0..1.0f64, frames in 1usize..12) {
        let (a, b) = (swinging(frames, 0.0), swinging(frames, error));
        let (f, g) = (figures(&a, &b), figures(&b, &a));
        for (x, y) in f.geodesic.iter().chain(&f.vector).chain(&f.mpjpe).zip(g.geodesic.iter().chain(&g.vector).chain(&g.mpjpe)) {
            prop_assert!(near(*x, *y, 1e-12 * x.abs().max(1.0)), "{f:?} {g:?}");
        }
        prop_assert!(f.geodesic[0] <= f.geodesic[1] && f.geodesic[1] <= f.geodesic[3] && f.geodesic[3] <= PI + 1e-12);
    }

    #[test]
    fn where_a_body_stands_and_faces_changes_nothing(x in -9.0..9.0f64, turn in -3.0..3.0f64) {
        let (a, b) = (swinging(6, 0.0), swinging(6, 0.1));
        let moved = |c: &Clip| {
            let q = Quat::from_rotation_y(turn);
            let root = c.root().iter().map(|p| q * *p + Vec3::X * x).collect();
            let turned = c.rotations().iter().enumerate().map(|(i, r)| if i % 24 == 0 { q * *r } else { *r }).collect();
            Clip::new(c.skeleton().clone(), 20.0, root, turned).unwrap()
        };
        let (f, g) = (figures(&a, &b), figures(&moved(&a), &moved(&b)));
        prop_assert!(near(f.geodesic[0], g.geodesic[0], 1e-9) && near(f.mpjpe[0], g.mpjpe[0], 1e-6));
        prop_assert!(near(f.mpjpe[1], g.mpjpe[1], 1e-6) && near(f.jerk.unwrap(), g.jerk.unwrap(), 1e-9));
    }
}
