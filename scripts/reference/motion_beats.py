"""crates/motion/tests/golden/beats.json: minima of a made-up speed as scipy finds them, for crates/motion/src/metric/beat.rs.

    python scripts/reference/motion_beats.py
"""
import json
from pathlib import Path

import numpy as np
import scipy
from scipy.ndimage import gaussian_filter1d
from scipy.signal import argrelextrema
from scipy.special import erf

SEED = 7
OUT = Path(__file__).parents[2] / "crates/motion/tests/golden/beats.json"


def minima(x, order):
    return argrelextrema(x, np.less, order=order)[0].tolist()


rng = np.random.default_rng(SEED)
t = np.arange(240) / 60
speed = np.round(1 + 0.5 * np.cos(2 * np.pi * 1.9 * t) + 0.3 * np.sin(2 * np.pi * 0.7 * t) + rng.normal(0, 0.1, len(t)), 6)
smooth = gaussian_filter1d(speed, 5)
made = {"script": "scripts/reference/motion_beats.py", "scipy": scipy.__version__, "seed": SEED}
golden = {
    "made": made, "speed": speed.tolist(), "smooth": smooth.tolist(),
    "compat_a": minima(speed, 10), "compat_b": minima(smooth, 1), "fixed": minima(smooth, 10),
    "erf": erf([0.0, 0.1, 0.5, 1.0, 2.0, 4.0]).tolist(),
}
OUT.write_text(json.dumps(golden) + "\n")
