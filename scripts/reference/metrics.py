#!/usr/bin/env python3
"""Golden figures for crates/motion/src/metric: distances between two swinging bodies, by numpy and scipy.

    python3 metrics.py > ../../crates/motion/tests/golden/metrics.json

Needs numpy and scipy. No randomness: the clips are sines that the test writes down again. Angles come from
scipy.spatial.transform, places from products of matrices, every mean from an array with one number for each frame and joint.
"""
import json, sys
import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from smpl import posed

HOP = 4


def swinging(frames, error):
    """-> root (F, 3), rotation vectors (F, 24, 3)."""
    t, j, i = np.arange(frames)[:, None, None], np.arange(24)[None, :, None], np.arange(3)[None, None, :]
    vectors = 1.1 * np.sin(0.37 * t * (1 + 0.1 * j) + 1.3 * i + j) + error * np.sin(1.7 * t + 0.9 * j + 2.1 * i)
    t = np.arange(frames)
    root = np.stack([0.3 * np.sin(0.2 * t) + error * np.sin(0.9 * t),
                     0.95 + 0.05 * np.cos(0.3 * t) + error * np.cos(1.1 * t),
                     0.02 * t + error * np.sin(0.7 * t + 1)], axis=1)
    return root, vectors


def places(root, rotations):
    """-> (F, 24, 3) by forward kinematics with matrices."""
    return posed(root, rotations.as_matrix().reshape(len(root), 24, 3, 3))[1]


def arccos(a, b):
    """Angles between vectors along the last axis, those of short vectors left out."""
    lengths = np.linalg.norm(a, axis=-1), np.linalg.norm(b, axis=-1)
    kept = (lengths[0] >= 1e-8) & (lengths[1] >= 1e-8)
    cosine = (a * b).sum(-1)[kept] / (lengths[0] * lengths[1])[kept]
    return np.arccos(np.clip(cosine, -1, 1))


def quotient(p):
    """Mean jerk at borders over mean jerk elsewhere."""
    jerk = np.linalg.norm(p[3:] - 3 * p[2:-1] + 3 * p[1:-2] - p[:-3], axis=-1)
    touching = np.zeros(len(jerk), bool)
    for border in range(HOP, len(p), HOP):
        touching[border - 3:border] = True
    return jerk[touching].mean() / jerk[~touching].mean()


def case(frames, error):
    (root_a, a), (root_b, b) = swinging(frames, 0.0), swinging(frames, error)
    ra, rb = Rotation.from_rotvec(a.reshape(-1, 3)), Rotation.from_rotvec(b.reshape(-1, 3))
    angles = (ra.inv() * rb).magnitude()
    va, vb = ra.as_rotvec(), rb.as_rotvec()
    each, whole = arccos(va, vb), arccos(va.reshape(frames, -1), vb.reshape(frames, -1))
    pa, pb = places(root_a, ra), places(root_b, rb)
    globally = np.linalg.norm(pa - pb, axis=-1)
    at_root = np.linalg.norm((pa - pa[:, :1]) - (pb - pb[:, :1]), axis=-1)
    return {
        "frames": frames, "error": error,
        "geodesic_mean": angles.mean(), "geodesic_rms": np.sqrt((angles ** 2).mean()), "geodesic_max": angles.max(),
        "geodesic_percentile_99": np.percentile(angles, 99, method="inverted_cdf"),
        "geodesic_sum_joints": angles.reshape(frames, 24).sum(1).mean(),
        "vector_mean_joint": each.mean(), "vector_mean_frame": whole.mean(), "vector_max_joint": each.max(),
        "mpjpe_global_mm": 1000 * globally.mean(), "mpjpe_root_mm": 1000 * at_root.mean(),
        "mpjpe_max_mm": 1000 * globally.max(), "border_jerk_ratio": quotient(pb) / quotient(pa),
    }


cases = [case(12, 0.05), case(50, 0.02), case(33, 0.7), case(7, 0.3)]
head = {"script": "scripts/reference/metrics.py", "seed": None, "python": sys.version.split()[0],
        "numpy": np.__version__, "scipy": scipy.__version__, "hop": HOP}
json.dump({**head, "cases": cases}, sys.stdout, indent=1)
print()
