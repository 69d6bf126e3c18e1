#!/usr/bin/env python3
"""Golden figures for crates/evaluate/src/baselines.rs: the static floors of a small synthetic set, reckoned frame by frame.

    python3 baselines.py > ../../crates/evaluate/tests/golden/baselines.json

Needs numpy. Written from the models' definitions, without tables of distinct cases or closed-form sums: every
probability is looked up in a full table of kernels, every frame is a row of its own.
"""
import json, sys
import numpy as np

SEED, BINS, CHANNELS = 7, 24, 2
SCALES, WIDTHS, EDGES = [0.35, 0.7, 1.2, 2, 3.5, 6, 11, 20, 40], [1.0, 5.0], [1, 2, 3, 5, 9, 17]


def synthetic(rng, lengths):
    """Clips of two channels: a clamped walk with momentum and bursts, and a noisy angle that wraps."""
    clips = []
    for frames in lengths:
        walk, speed, angle, clip = rng.uniform(0, BINS), 0.0, rng.uniform(0, BINS), []
        for _ in range(frames):
            speed = 0.8 * speed + rng.normal() * (4.0 if rng.random() < 0.1 else 0.4)
            walk = min(max(walk + speed, 0.0), BINS - 0.01)
            angle = (angle + rng.normal() * 0.7) % BINS
            clip.append([int(walk), int(angle)])
        clips.append(clip)
    return clips


def kernels(centre):
    distance = np.abs(np.arange(BINS) - centre).astype(float)
    rows = [(distance == 0).astype(float)] + [np.exp(-distance / s) for s in SCALES]
    rows += [1 / (1 + (distance / w) ** 2) for w in WIDTHS] + [np.ones(BINS)]
    return [r / r.sum() for r in rows]


TABLE = [np.array(kernels(c)) for c in range(BINS)]


def fit(rows):
    """Expectation maximisation, one row of densities for every frame."""
    rows = np.array(rows)
    weights = np.ones(rows.shape[1]) / rows.shape[1]
    for _ in range(60):
        share = rows * weights
        share = (share / share.sum(axis=1, keepdims=True)).sum(axis=0) + 1e-3
        weights = share / share.sum()
    return weights


def line(x, t):
    return min(max(2 * x[t - 1] - x[t - 2], 0), BINS - 1)


def channel(train, test):
    """-> bits of all test frames, bits of the frames from the third on, both by model; weight on the extrapolation."""
    counts, steps = np.ones(BINS), np.ones(BINS)
    for x in train:
        for t in range(len(x)):
            counts[x[t]] += 1
            if t:
                steps[(x[t] - x[t - 1]) % BINS] += 1
    p0, p_step = counts / counts.sum(), steps / steps.sum()

    near = lambda x, t: TABLE[x[t - 1]][:, x[t]]
    far = lambda x, t: TABLE[line(x, t)][:, x[t]]
    both = lambda x, t: np.concatenate([near(x, t), far(x, t)])
    three = lambda x, t: np.append(both(x, t), p0[x[t]])
    late = [(x, t) for x in train for t in range(2, len(x))]
    w_near = fit([near(x, t) for x in train for t in range(1, len(x))])
    w_far, w_both = fit([far(*c) for c in late]), fit([both(*c) for c in late])
    size = lambda x, t: sum(abs(x[t - 1] - x[t - 2]) >= e for e in EDGES)
    w_three = []
    for a in range(len(EDGES) + 1):
        cases = [c for c in late if size(*c) == a]
        w_three.append(fit([three(*c) for c in (cases if len(cases) >= 200 else late)]))

    total, later = np.zeros(6), np.zeros(6)
    for x in test:
        for t in range(len(x)):
            a = p0[x[t]]
            if t == 0:
                p = np.full(6, a)
            else:
                b, c = p_step[(x[t] - x[t - 1]) % BINS], near(x, t) @ w_near
                p = np.array([a, b, c, c, c, c])
            if t >= 2:
                p[3:] = far(x, t) @ w_far, both(x, t) @ w_both, three(x, t) @ w_three[size(x, t)]
                later -= np.log2(p)
            total -= np.log2(p)
    return total, later, w_both[len(w_near):].sum()


def main():
    rng = np.random.default_rng(SEED)
    train = synthetic(rng, [300, 200, 1, 150, 2, 120, 3])
    test = synthetic(rng, [120, 1, 2, 60])
    pick = lambda clips, c: [[frame[c] for frame in clip] for clip in clips]
    results = [channel(pick(train, c), pick(test, c)) for c in range(CHANNELS)]
    frames = sum(len(x) for x in test)
    later = sum(max(len(x) - 2, 0) for x in test)
    json.dump({
        "made_by": "scripts/reference/baselines.py", "numpy": np.__version__, "python": sys.version.split()[0],
        "seed": SEED, "bins": BINS, "channels": CHANNELS,
        "train": [sum(clip, []) for clip in train], "test": [sum(clip, []) for clip in test],
        "bits_per_frame": (sum(r[0] for r in results) / frames).tolist(),
        "from_third_frame": (sum(r[1] for r in results) / later).tolist(),
        "by_channel": [[float(r[0][m] / frames) for r in results] for m in range(6)],
        "weight_on_extrapolation": [float(r[2]) for r in results],
    }, sys.stdout)
    print()


if __name__ == "__main__":
    main()
