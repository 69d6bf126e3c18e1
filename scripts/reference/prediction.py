#!/usr/bin/env python3
"""Golden figures for crates/motion/src/metric/short_term.rs: short-term prediction by numpy and scipy, with matrices throughout.

    python3 prediction.py > ../../crates/motion/tests/golden/prediction.json

Needs numpy and scipy. No randomness: the poses are sines that the test writes down again. One array holds every window,
frame and joint; the definitions are those of Aksan et al. (2019).
"""
import json, sys
import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from smpl import OFFSETS, posed

MAJOR = [1, 2, 3, 4, 5, 6, 9, 12, 13, 14, 15, 16, 17, 18, 19]
RADII = np.array([.001, .005, .01, .02, .05, .1, .15, .2, .3])


def swinging(windows, frames, error):
    """-> rotation matrices (N, F, 24, 3, 3); joint 6 rests where there is no error."""
    t = (50 * np.arange(windows)[:, None] + np.arange(frames)[None])[:, :, None, None]
    j, i = np.arange(24)[:, None], np.arange(3)[None]
    swing = 1.5 * np.sin(0.21 * t * (1 + 0.05 * j) + 1.3 * i + j)
    swing[:, :, 6] = 0
    vectors = swing + error * np.sin(0.9 * t + 0.9 * j + 2.1 * i)
    return Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(windows, frames, 24, 3, 3)


def world(local):
    """-> matrices in the world and places, for a thigh of length 1."""
    return posed(0, local, OFFSETS / np.linalg.norm(OFFSETS[4]))


def euler(r):
    e2 = -np.arcsin(np.clip(r[..., 0, 2], -1, 1))
    c = np.cos(e2)
    return np.stack([np.arctan2(r[..., 1, 2] / c, r[..., 2, 2] / c), e2, np.arctan2(r[..., 0, 1] / c, r[..., 0, 0] / c)], -1)


def case(windows, fps, frames, error, coded):
    target, predicted = swinging(windows, frames, 0), swinging(windows, frames, error)
    joints = [j for j in MAJOR if j in coded]
    for local in target, predicted:
        local[:, :, [j for j in range(24) if j not in joints]] = np.eye(3)
    (ra, pa), (rb, pb) = world(target), world(predicted)
    between = np.swapaxes(ra, -1, -2) @ rb
    angle = np.arccos(np.clip((np.trace(between, axis1=-2, axis2=-1) - 1) / 2, -1, 1))[:, :, joints].mean(-1)
    apart = np.linalg.norm(pa - pb, axis=-1)[:, :, joints]
    ea, eb = (euler(x[:, :, joints]).reshape(windows, frames, -1) for x in (target, predicted))
    moving = ea.reshape(windows * frames, -1).std(0) >= 1e-4
    difference = (ea - eb)[:, :, moving]
    around = np.arctan2(np.sin(difference), np.cos(difference))
    correct = (apart[..., None] <= RADII).mean(2)
    rows = []
    for ms in 100, 200, 300, 400:
        n, at_60 = round(ms / 1000 * fps), round(ms / 1000 * 60)
        used = 6 if at_60 < 6 else 7 if at_60 < 12 else 8 if at_60 < 18 else 9
        total = lambda x: float(x[:, :n].mean(0).sum() * 60 / fps)
        curve = correct[:, :n].mean((0, 1))[:used]
        rows.append({"ms": ms, "frames": n, "euler": total(np.linalg.norm(difference, axis=-1)),
                     "euler_fixed": total(np.linalg.norm(around, axis=-1)), "angle": total(angle),
                     "position": total(apart.mean(-1)),
                     "auc": float(np.trapezoid(curve, RADII[:used]) / (RADII[used - 1] - RADII[0]))})
    return {"windows": windows, "fps": fps, "frames": frames, "error": error, "coded": coded,
            "moving": int(moving.sum()), "figures": rows}


THIRTEEN = [0, 1, 2, 4, 5, 7, 8, 16, 17, 18, 19, 20, 21]
cases = [case(3, 60, 24, 0.1, list(range(24))), case(4, 60, 24, 1.2, THIRTEEN), case(5, 20, 8, 0.02, THIRTEEN)]
head = {"script": "scripts/reference/prediction.py", "seed": None, "python": sys.version.split()[0],
        "numpy": np.__version__, "scipy": scipy.__version__}
json.dump({**head, "cases": cases}, sys.stdout, indent=1)
print()
