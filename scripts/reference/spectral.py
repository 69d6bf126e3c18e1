"""Golden numbers: what scipy and scikit-learn make of windows of series.

    pip install numpy==2.4.6 scipy==1.17.1 scikit-learn==1.9.1   (the versions used are in the file's header)
    python scripts/reference/spectral.py > crates/spectral/tests/golden/spectral.json

Inputs come from numpy's generator, rounded to three decimals before anything is done with them.
"""

import json
import sys

import numpy
import scipy
import sklearn
from scipy.fft import dct
from scipy.signal import get_window, stft
from sklearn.decomposition import PCA

SEED = 14
N, KEEP = 128, 16
random = numpy.random.default_rng(SEED)


def series(count):
    """Sums of waves, each with less power than the one before, and a little noise."""
    t = (numpy.arange(N) + 0.5) / N
    waves = numpy.stack([numpy.cos(numpy.pi * t * (k + 0.3)) / (1 + 0.4 * k) for k in range(24)])
    return numpy.round(random.normal(size=(count, 24)) @ waves + 0.05 * random.normal(size=(count, N)) + 0.2, 3)


def stft_case(x, window, hop):
    hann = get_window("hann", window, fftbins=True)
    _, _, z = stft(x, window=hann, nperseg=window, noverlap=window - hop, boundary=None, padded=False)
    z = z.T * hann.sum()  # scipy divides by the sum of the window
    return {
        "window": window,
        "hop": hop,
        "input": x.tolist(),
        "real": z.real.ravel().tolist(),
        "imaginary": z.imag.ravel().tolist(),
        "magnitudes": numpy.abs(z).ravel().tolist(),
    }


def dct_case(x):
    return {"input": x.tolist(), "low": dct(x, type=2, norm="ortho")[:KEEP].tolist()}


def pca_case(x):
    p = PCA(KEEP, svd_solver="full").fit(x)
    return {
        "length": N,
        "data": x.ravel().tolist(),
        "mean": p.mean_.tolist(),
        "components": p.components_.ravel().tolist(),
        "explained_variance": p.explained_variance_.tolist(),
        "first": p.transform(x[:1])[0].tolist(),
    }


one, other = series(2)
json.dump(
    {
        "script": "scripts/reference/spectral.py",
        "versions": {
            "python": sys.version.split()[0],
            "numpy": numpy.__version__,
            "scipy": scipy.__version__,
            "scikit-learn": sklearn.__version__,
        },
        "seed": SEED,
        "stft": [stft_case(one, 16, 8), stft_case(other[:100], 8, 3)],
        "dct": [dct_case(one), dct_case(other)],
        "pca": pca_case(series(40)),
    },
    sys.stdout,
)
print()
