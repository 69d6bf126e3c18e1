"""Golden numbers: what scipy and scikit-learn make of a few small series.

    pip install numpy==2.4.6 scipy==1.17.1 scikit-learn==1.9.1   (the versions used are in the file's header)
    python scripts/reference/transforms.py > tokenizer/tests/golden/transforms.json

Inputs come from numpy's generator, rounded to six decimals before anything is done with them.
"""

import json
import sys

import numpy
import scipy
import sklearn
from scipy.fft import dct
from sklearn.decomposition import PCA, FastICA

SEED = 12
random = numpy.random.default_rng(SEED)


def six(x):
    return numpy.round(x, 6)


def dct_case(n):
    x = six(random.normal(size=n))
    return {"input": x.tolist(), "output": dct(x, type=2, norm="ortho").tolist()}


def pca_case(data):
    data = six(data)
    p = PCA(svd_solver="full").fit(data)
    return {
        "channels": data.shape[1],
        "data": data.ravel().tolist(),
        "mean": p.mean_.tolist(),
        "components": p.components_.ravel().tolist(),
        "explained_variance": p.explained_variance_.tolist(),
    }


def ica_case():
    """Four sources, none of them a bell curve, in five channels."""
    n = 600
    t = numpy.arange(n)
    sources = numpy.stack(
        [
            numpy.sin(0.11 * t),
            numpy.sign(numpy.sin(0.047 * t + 1.0)),
            (0.023 * t) % 2.0 - 1.0,
            random.laplace(size=n),
        ]
    )
    mixing = random.normal(size=(5, 4))
    data = six((mixing @ sources).T + random.normal(size=5))
    ica = FastICA(4, algorithm="parallel", fun="logcosh", whiten="unit-variance", random_state=SEED, tol=1e-8, max_iter=1000)
    found = ica.fit_transform(data)
    assert ica.n_iter_ < 1000
    return {"channels": 5, "data": data.ravel().tolist(), "sources": six(found.T).tolist()}


correlated = random.normal(size=(40, 6)) @ random.normal(size=(6, 6)) + random.normal(size=6)
constant = random.normal(size=(30, 4)) * [1.0, 5.0, 0.0, 0.3] + [0.0, 2.0, 3.0, -1.0]
few_rows = random.normal(size=(4, 9))
json.dump(
    {
        "script": "scripts/reference/transforms.py",
        "versions": {
            "python": sys.version.split()[0],
            "numpy": numpy.__version__,
            "scipy": scipy.__version__,
            "scikit-learn": sklearn.__version__,
        },
        "seed": SEED,
        "dct": [dct_case(n) for n in (1, 2, 15, 16, 30, 60, 97, 120)],
        "pca": [pca_case(data) for data in (correlated, constant, few_rows)],
        "ica": ica_case(),
    },
    sys.stdout,
)
print()
