#!/usr/bin/env python3
"""Golden figures for crates/spectral/src/filter: what scipy's butter and filtfilt make of a few series.

    pip install numpy==2.4.6 scipy==1.17.1   (the versions used are in the file's header)
    python3 scripts/reference/filter.py > crates/spectral/tests/golden/filter.json

Series come from numpy's generator, rounded to six decimals before anything is done with them. Two series: the shortest that
the padding of the highest order allows, and a longer one. `filtfilt` in its default form (odd padding of
3 max(len(a), len(b)) numbers); where the polynomials lose digits (a high order far below half the rate) `sosfiltfilt`
stands beside it, which pads as much.
"""
import json
import platform

import numpy
import scipy
from scipy.signal import butter, filtfilt, sosfiltfilt

SEED = 14
random = numpy.random.default_rng(SEED)
# a slow wave, a fast one and a drift, under noise
t = numpy.arange(90) / 60
long = numpy.sin(2 * numpy.pi * 1.3 * t) + 0.3 * numpy.sin(2 * numpy.pi * 11 * t + 0.4) + 2 * t
series = [numpy.round(x, 6) for x in (random.normal(size=28), long + 0.1 * random.normal(size=90))]

cases = []
for order in (1, 2, 3, 4, 5, 6, 8):
    for cutoff, fps in ((7.0, 60.0), (1.5, 60.0), (14.0, 30.0), (0.4, 120.0)):
        for i, x in enumerate(series):
            # polynomials of a high order with all roots near 1 lose digits: the sections don't
            sections = order > 3 and cutoff / fps < 0.02 or order > 6 and cutoff / fps < 0.03
            if sections:
                y = sosfiltfilt(butter(order, cutoff, fs=fps, output="sos"), x)
            else:
                b, a = butter(order, cutoff, fs=fps)
                y = filtfilt(b, a, x) if len(x) > 3 * len(a) else None
            if y is None:
                continue
            cases.append({
                "order": order, "cutoff_hz": cutoff, "fps": fps, "series": i,
                "of": "sosfiltfilt" if sections else "filtfilt",
                # a spread of them says as much as all
                "at": list(range(0, len(x), 1 if i == 0 else 4)),
                "output": y[:: 1 if i == 0 else 4].tolist(),
            })

versions = {"python": platform.python_version(), "numpy": numpy.__version__, "scipy": scipy.__version__}
head = {"script": "scripts/reference/filter.py", "versions": versions, "seed": SEED}
print(json.dumps(head | {"series": [x.tolist() for x in series], "cases": cases}))
