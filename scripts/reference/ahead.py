"""What frames of a gap are told of what is given behind it: crates/model/tests/golden/ahead.json, for crates/model/src/ahead.rs.

The formulas as they were studied (docs/model.md), frame by frame for gaps in which all characters are free. Its tokenizer is
crates/model/tests/golden/ahead_tokenizer.json: uniform bins, pelvis and left knee, heading_delta.

    python scripts/reference/ahead.py
"""

import json
from pathlib import Path

import numpy as np

GOLDEN = Path(__file__).parents[2] / "crates/model/tests/golden"
TOKENIZER = json.loads((GOLDEN / "ahead_tokenizer.json").read_text())["decoder"]["kinelm"]
LINES = TOKENIZER["fitted"]["translation"]
WIDTH, ZERO = (np.array([line[key] for line in LINES]) for key in ("width", "zero"))
BINS = TOKENIZER["config"]["scheme"]["bins"]
STEPS, CLAMPED = [0, 2, 3], 3
SEED, FRAMES, CHARACTERS = 3, 90, 9
GAPS = [(1, 12), (13, 70), (75, 77), (80, 89)]


def turned(vector, by):
    """A vector turned by a rotation vector: Rodrigues."""
    angle = np.linalg.norm(by)
    axis = by / angle if angle > 1e-12 else by
    cross = np.cross(axis, vector)
    return vector * np.cos(angle) + cross * np.sin(angle) + axis * np.dot(axis, vector) * (1 - np.cos(angle))


def stands(codes):
    """x, z, turn and heading behind every frame."""
    x = z = turn = heading = 0.0
    out = []
    for word in codes:
        step = (word[:3] - ZERO) * WIDTH
        cos, sin = np.cos(heading), np.sin(heading)
        x, z = x + cos * step[0] + sin * step[2], z - sin * step[0] + cos * step[2]
        angles = (word[3:6] - BINS // 2) * 2 * np.pi / BINS
        turn += angles[0]
        ahead = turned(np.array([0.0, 0.0, 1.0]), np.array([angles[1], 0.0, angles[2]]))
        heading = turn + np.arctan2(ahead[0], ahead[2])
        out.append((x, z, turn, heading))
    return out


def wrapped(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def told(codes, stand, frame, end):
    """Numbers and rows of a frame of a gap behind which frame `end` is given."""
    before, left = codes[frame - 1], end - frame + 1
    (x, z, turn, heading), (to_x, to_z, to_turn, _) = stand[frame - 1], stand[end]
    cos, sin = np.cos(heading), np.sin(heading)
    dx, dz = cos * (to_x - x) - sin * (to_z - z), sin * (to_x - x) + cos * (to_z - z)
    dt = wrapped(to_turn - turn)
    root = [dx, dz, np.cos(dt), np.sin(dt), 1 / left, 10 * dx / left, 10 * dz / left, 10 * dt / left]
    goal, far = codes[end].copy(), np.full(CHARACTERS, left)
    goal[0], goal[2] = (np.round(ZERO[i] + d / left / WIDTH[i]) for i, d in ((0, dx), (2, dz)))
    goal[3] = np.round(BINS // 2 + dt / left * BINS / (2 * np.pi))
    far[STEPS] = 1
    goal[:CLAMPED] = goal[:CLAMPED].clip(0, BINS - 1)
    d = goal - before
    d[CLAMPED:] = (d[CLAMPED:] + BINS // 2) % BINS - BINS // 2
    a = d * np.where(np.arange(CHARACTERS) < CLAMPED, 0.01, 2 * np.pi / BINS)
    bucket = np.eye(16)[min(int(2 * np.log2(left)), 15)]
    numbers = np.concatenate([np.sin(a), 1 - np.cos(a), a, 8 * a / far, root, bucket])
    rows = [np.where(np.arange(CHARACTERS) < CLAMPED, k + 2 * BINS - 1, k % BINS) for k in (d, np.round(d / far).astype(int))]
    return {"frame": frame, "numbers": numbers.round(7).tolist(), "rows": [row.tolist() for row in rows]}


def main():
    rng = np.random.default_rng(SEED)
    walk = np.cumsum(rng.integers(-2, 3, (FRAMES, CHARACTERS)), 0) + BINS // 2
    codes = np.concatenate([walk[:, :CLAMPED].clip(0, BINS - 1), walk[:, CLAMPED:] % BINS], 1)
    codes[:, STEPS] = np.clip(BINS // 2 + rng.integers(-3, 4, (FRAMES, 3)), 0, BINS - 1)
    # one who lies on his face has no heading
    codes[:, 4:6] = codes[:, 4:6].clip(BINS // 2 - 6, BINS // 2 + 6)
    stand = stands(codes)
    frames = [told(codes, stand, frame, end) for begin, end in GAPS for frame in range(begin, end)]
    made = {"script": "scripts/reference/ahead.py", "numpy": np.__version__, "seed": SEED}
    golden = {"made": made, "codes": codes.tolist(), "gaps": GAPS, "frames": frames}
    (GOLDEN / "ahead.json").write_text(json.dumps(golden))


if __name__ == "__main__":
    main()
