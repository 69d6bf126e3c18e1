"""Golden bins: what numpy makes of quantile and uniform bins.

    pip install numpy==2.4.6        (the version used is in the file's header)
    python scripts/reference/bins.py > tokenizer/tests/golden/bins.json

Quantile bins: edges by numpy.quantile (linear), equal ones merged, those at the least value left out, codes by
numpy.searchsorted(side="right"), values by numpy.median; a bin without training values has its middle.
Uniform bins of angles over a full turn: with an edge at 0 by searchsorted in linspace, centred on 0 by rint.
"""

import json
import sys

import numpy as np

SEED = 12
rng = np.random.default_rng(SEED)


def quantile(name, training, bins):
    training = np.round(training, 12)
    edges = np.unique(np.quantile(training, np.arange(1, bins) / bins))
    edges = edges[edges > training.min()]
    codes = np.searchsorted(edges, training, side="right")
    medians = []
    for k in range(len(edges) + 1):
        inside = training[codes == k]
        medians.append(np.median(inside) if len(inside) else (edges[k - 1] + edges[k]) / 2)
    spread = max(float(np.ptp(training)), 1.0)
    values = np.round(training.min() - 0.2 * spread + 1.4 * spread * rng.random(60), 12)
    values = np.concatenate([values, training[:20]])
    return {
        "name": name,
        "bins": bins,
        "training": training.tolist(),
        "edges": edges.tolist(),
        "medians": [float(m) for m in medians],
        "values": values.tolist(),
        "codes": np.searchsorted(edges, values, side="right").tolist(),
    }


def uniform(bins):
    axes = rng.normal(size=(40, 3))
    vectors = axes / np.linalg.norm(axes, axis=1, keepdims=True) * (3.0 * rng.random((40, 1)))
    if bins < 100:
        vectors *= 0.5  # away from half a turn, where the other vector of a rotation comes in
    edges = np.linspace(-np.pi, np.pi, bins + 1)
    width = 2 * np.pi / bins
    codes = [
        {
            "edge": np.searchsorted(edges[1:-1], v, side="right").tolist(),
            "centred": ((np.rint(v / width).astype(int) + bins // 2) % bins).tolist(),
        }
        for v in vectors
    ]
    return {"bins": bins, "vectors": vectors.tolist(), "codes": codes}


cases = [
    quantile("normal", rng.normal(size=500), 60),
    quantile("mostly zero", np.where(rng.random(400) < 0.8, 0.0, rng.normal(size=400)), 36),
    quantile("few values", rng.integers(0, 5, 300) / 8, 24),
    quantile("fewer values than bins", rng.normal(size=7), 20),
    quantile("one value", np.full(50, 0.125), 10),
    quantile("two bins", rng.exponential(size=101), 2),
]
header = {
    "script": "scripts/reference/bins.py",
    "versions": {"python": sys.version.split()[0], "numpy": np.__version__},
    "seed": SEED,
}
json.dump({**header, "quantile": cases, "uniform": [uniform(n) for n in (360, 361, 60, 1080)]}, sys.stdout)
print()
