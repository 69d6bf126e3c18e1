"""L2 distances and NPSS of arrays by a formula, in crates/motion/tests/golden/in_between.json.

    pip install numpy==2.4.6
    python scripts/reference/in_between.py > crates/motion/tests/golden/in_between.json

Definitions: docs/measures.md, "Gaps". x[t, d] = sin(0.3 t (d + 1) + d + phase) / (d + 1); phase 0.4 beside 0.
"""
import json

import numpy as np


def array(frames, width, phase):
    t, d = np.meshgrid(np.arange(frames), np.arange(width), indexing="ij")
    return np.sin(0.3 * t * (d + 1) + d + phase) / (d + 1)


def npss(found, wanted):
    power = [np.fft.fft(x, axis=0).real ** 2 for x in (found, wanted)]
    shares = [np.cumsum(p / p.sum(0), axis=0) for p in power]
    moved = np.abs(shares[0] - shares[1]).sum(0)
    return np.average(moved, weights=power[1].sum(0))


cases = []
for frames, width in [(5, 2), (20, 7), (31, 12)]:
    a, b = array(frames, width, 0.4), array(frames, width, 0.0)
    distance = np.linalg.norm(a - b, axis=1).mean()
    cases.append({"frames": frames, "width": width, "distance": float(distance), "npss": float(npss(a, b))})
print(json.dumps(cases, indent=1))
