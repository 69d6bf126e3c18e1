#!/usr/bin/env python3
"""Golden scores for crates/motion/src/metric/contact.rs: physical foot contact of a dancing body, by numpy and scipy.

    python3 foot_contact.py > ../../crates/motion/tests/golden/foot_contact.json

Needs numpy and scipy. The definition is EDGE's (Tseng, Castellon, Liu 2023, section 4.1 and its code), always at 30 frames a
second: of n times that rate every n-th frame from each of the first n on, of other rates natural cubic splines of the pelvis's
place and of the components of each joint's quaternion. No randomness: the body is sines that the test writes down again.
"""
import json, sys
import numpy as np
import scipy
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from smpl import posed

FPS = 30
ANKLES, BALLS = [7, 8], [10, 11]
CASES = [(20, 100), (24, 97), (25, 60), (29.97, 90), (30, 120), (50, 151), (60, 200), (90, 301), (120, 500), (130, 400)]


def dancing(frames, fps):
    """-> root (F, 3), quaternions (F, 24, 4)."""
    t = np.arange(frames) / fps
    root = np.stack([0.3 * np.sin(3.1 * t), 0.95 + 0.05 * np.cos(7.3 * t), 0.2 * t + 0.02 * np.sin(11 * t)], axis=1)
    t, j, i = t[:, None, None], np.arange(24)[None, :, None], np.arange(3)[None, None, :]
    vectors = 0.3 * np.sin((2.9 + 0.31 * j) * t + 1.3 * i + j) + 0.05 * np.sin(17 * t + 0.9 * j + 2.1 * i)
    return root, Rotation.from_rotvec(vectors.reshape(-1, 3)).as_quat().reshape(frames, 24, 4)


def splined(values, fps):
    frames = len(values)
    times = np.arange(int((frames - 1) * FPS / fps + 1e-9) + 1) / FPS
    return CubicSpline(np.arange(frames) / fps, values, bc_type="natural")(times)


def pfc(positions):
    """(F, 24, 3) at 30 frames a second, y up."""
    acceleration = np.diff(positions[:, 0], n=2, axis=0) * FPS ** 2
    acceleration[:, 1] = acceleration[:, 1].clip(min=0)
    size = np.linalg.norm(acceleration, axis=1)
    steps = np.linalg.norm(np.diff(positions[1:, :, [0, 2]], axis=0), axis=-1)
    left, right = np.minimum(steps[:, ANKLES], steps[:, BALLS]).T
    return 1e4 * (size / size.max() * left * right).mean()


def case(fps, frames):
    root, quaternions = dancing(frames, fps)
    if fps % FPS:
        signs = np.cumprod(np.sign((quaternions[1:] * quaternions[:-1]).sum(-1, keepdims=True)), axis=0)
        quaternions[1:] *= signs
        root, quaternions = splined(root, fps), splined(quaternions, fps)
        fps = FPS
    local = Rotation.from_quat(quaternions.reshape(-1, 4)).as_matrix().reshape(len(root), 24, 3, 3)
    _, positions = posed(root, local)
    return [pfc(positions[phase :: fps // FPS]) for phase in range(fps // FPS)]


def main():
    cases = []
    for fps, frames in CASES:
        phases = case(fps, frames)
        cases.append({"fps": fps, "frames": frames, "phases": phases, "mean": np.mean(phases)})
    head = {"script": "scripts/reference/foot_contact.py", "seed": None, "python": sys.version.split()[0],
            "numpy": np.__version__, "scipy": scipy.__version__}
    json.dump({**head, "cases": cases}, sys.stdout, indent=1)
    print()


if __name__ == "__main__":
    main()
