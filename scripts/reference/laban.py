#!/usr/bin/env python3
"""Golden figures for crates/motion/src/metric/laban.rs: proxies of Laban's Effort and Shape of a dancing body, by numpy.

    python3 laban.py > ../../crates/motion/tests/golden/laban.json

Needs numpy. The definitions are those of docs/measures.md, "Laban". Differences are sums of shifted arrays, the volume of a
hull is that of the cones from its middle to the facets found by trying all planes through three points. No randomness: the
body is sines that the test writes down again.
"""
import itertools, json, sys
import numpy as np

from smpl import posed

FPS, SIGMA, REACH, WINDOW, HOP = 30, 1.5, 6, 30, 15
ENDS = [15, 20, 21, 7, 8]


def matrices(vectors):
    """Rotation vectors (.., 3) -> matrices, by Rodrigues' formula."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vectors, -1, 0)
    o = np.zeros_like(x)
    k = np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], -2)
    return np.eye(3) + np.sinc(angle / np.pi) * k + 0.5 * np.sinc(angle / 2 / np.pi) ** 2 * (k @ k)


def dancing(frames):
    """-> root (F, 3), matrices (F, 24, 3, 3)."""
    t = np.arange(frames) / FPS
    root = np.stack([0.3 * np.sin(3.1 * t), 0.95 + 0.05 * np.cos(7.3 * t), 0.2 * t + 0.02 * np.sin(11 * t)], axis=1)
    t, j, i = t[:, None, None], np.arange(24)[None, :, None], np.arange(3)[None, None, :]
    return root, matrices(0.3 * np.sin((2.9 + 0.31 * j) * t + 1.3 * i + j) + 0.05 * np.sin(17 * t + 0.9 * j + 2.1 * i))


def hull(points):
    """The volume of the convex hull of some points in general position."""
    middle, volume = points.mean(0), 0.0
    for face in itertools.combinations(range(len(points)), 3):
        a, b, c = points[list(face)]
        normal = np.cross(b - a, c - a)
        side = [(points[i] - a) @ normal for i in range(len(points)) if i not in face]
        if all(s > 0 for s in side) or all(s < 0 for s in side):
            volume += abs((middle - a) @ normal) / 6
    return volume


def box(p):
    """(F, 24, 3) -> (F) volumes of boxes along the heading."""
    across = p[:, 1] - p[:, 2] + p[:, 16] - p[:, 17]
    forward = np.cross(across, [0, 1, 0])[:, [0, 2]]
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    ahead = (p[..., [0, 2]] * forward[:, None]).sum(-1)
    aside = p[..., 0] * forward[:, None, 1] - p[..., 2] * forward[:, None, 0]
    return np.ptp(ahead, axis=1) * np.ptp(aside, axis=1) * np.ptp(p[..., 1], axis=1)


def case(frames):
    root, local = dancing(frames)
    steps = np.swapaxes(local[:-1], -1, -2) @ local[1:]
    angle = np.arccos(np.clip((np.trace(steps, axis1=-2, axis2=-1) - 1) / 2, -1, 1))
    kernel = np.exp(-0.5 * (np.arange(-REACH, REACH + 1) / SIGMA) ** 2)
    p = np.apply_along_axis(np.convolve, 0, posed(root, local)[1], kernel / kernel.sum(), "valid")
    middle, ends = p[2:-2], p[:, ENDS]
    size = lambda x: np.linalg.norm(x, axis=-1).mean(1)
    v = (((ends[3:-1] - ends[1:-3]) * FPS / 2) ** 2).sum(-1).mean(1)
    a = size(ends[3:-1] - 2 * ends[2:-2] + ends[1:-3]) * FPS ** 2
    j = size(ends[4:] - 2 * ends[3:-1] + 2 * ends[1:-3] - ends[:-4]) * FPS ** 3 / 2
    windows = [slice(f, f + WINDOW) for f in range(0, len(middle) - WINDOW + 1, HOP)]
    step = [np.diff(middle[w][:, ENDS], axis=0) for w in windows]
    space = [(np.linalg.norm(s.sum(0), axis=-1) / np.linalg.norm(s, axis=-1).sum(0)).mean() for s in step]
    mean = lambda x: float(np.mean(x))
    return {"frames": frames, "weight": mean([v[w].max() for w in windows]), "time": mean([a[w].mean() for w in windows]),
            "flow": mean([j[w].mean() for w in windows]), "space": mean(space),
            "volume": mean([hull(points) for points in middle[:, ENDS]]), "box": mean(box(middle)),
            "angular": mean(angle.sum(1) * FPS)}


def main():
    head = {"script": "scripts/reference/laban.py", "seed": None, "python": sys.version.split()[0], "numpy": np.__version__}
    json.dump({**head, "cases": [case(frames) for frames in [46, 100, 301]]}, sys.stdout, indent=1)
    print()


if __name__ == "__main__":
    main()
