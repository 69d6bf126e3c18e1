"""Frames a second of the tokenizer beside the same pipelines in numpy, scipy and scikit-learn, on the same made-up motion.

    pip install numpy==2.4.6 scipy==1.17.1 scikit-learn==1.9.1
    OMP_NUM_THREADS=1 python scripts/bench/tokenize_rate.py            (builds the example first; takes a minute)

Both are given quaternions of 13 joints in memory and make codes of them, and quaternions of the codes again.
- uniform: rotation vectors into 360 bins.
- dct: rotation vectors, PCA to 39 components, tiles of 60 frames under a DCT-II, the largest tenth of the coefficients
  of a tile, 360 quantile bins. Ours also codes the root in closed loop, makes vectors continuous, counts runs of zeros and
  fills all 24 joints of a clip; Python's does none of that.

One core each, so that the ratio is that of the code; beside it ours on all cores, where Python stays on one. The best of
seven runs counts.
"""

import json
import os
import subprocess
import time

import numpy as np
from scipy.fft import dct, idct
from scipy.spatial.transform import Rotation
from sklearn.decomposition import PCA

CLIPS, FRAMES, RUNS = 8, 4020, 7
JOINTS = [0, 1, 2, 4, 5, 7, 8, 16, 17, 18, 19, 20, 21]
TILE, KEEP, BINS = 60, 0.1, 360


def clip(seed):
    """(F, 13, 4) quaternions x y z w; the formula of tokenizer/examples/tokenize_rate.rs."""
    f = np.arange(FRAMES)[:, None, None]
    i = 3 * np.array(JOINTS)[None, :, None] + np.arange(3)[None, None, :]
    vectors = 0.8 * np.sin(f * 0.05 * (1.0 + i / 40.0) + i * (seed + 3))
    return Rotation.from_rotvec(vectors.reshape(-1, 3)).as_quat().reshape(FRAMES, len(JOINTS), 4)


def vectors_of(quaternions):
    return Rotation.from_quat(quaternions.reshape(-1, 4)).as_rotvec().reshape(len(quaternions), -1)


def quaternions_of(vectors):
    return Rotation.from_rotvec(vectors.reshape(-1, 3)).as_quat().reshape(len(vectors), -1, 4)


class Uniform:
    width = 2 * np.pi / BINS

    def encode(self, quaternions):
        codes = np.rint(vectors_of(quaternions) / self.width).astype(np.int64) + BINS // 2
        return (codes % BINS).astype(np.uint16)

    def decode(self, codes):
        return quaternions_of((codes.astype(np.float64) - BINS // 2) * self.width)


class Tiles:
    def __init__(self, clips):
        vectors = np.concatenate([vectors_of(q) for q in clips])
        self.pca = PCA(len(JOINTS) * 3).fit(vectors)
        kept = np.concatenate([c[m] for c, m in map(self.kept, clips)])
        self.edges = np.quantile(kept, np.arange(1, BINS) / BINS)
        code = np.searchsorted(self.edges, kept, side="right")
        self.values = np.array([np.median(kept[code == k]) for k in range(BINS)])

    def kept(self, quaternions):
        """(T, K L) coefficients, and which of them are kept."""
        components = self.pca.transform(vectors_of(quaternions)).reshape(-1, TILE, self.pca.n_components_)
        tiles = dct(components, axis=1, norm="ortho").reshape(len(components), -1)
        sizes = np.abs(tiles)
        most = int(np.ceil(KEEP * tiles.shape[1]))
        least = np.partition(sizes, -most, axis=1)[:, -most]
        return tiles, sizes >= least[:, None]

    def encode(self, quaternions):
        """(T, K L): 0 for zero, else one more than the bin."""
        tiles, kept = self.kept(quaternions)
        codes = np.zeros(tiles.shape, np.uint16)
        codes[kept] = np.searchsorted(self.edges, tiles[kept], side="right") + 1
        return codes

    def decode(self, codes):
        table = np.concatenate([[0.0], self.values])
        tiles = table[codes].reshape(len(codes), TILE, -1)
        components = idct(tiles, axis=1, norm="ortho").reshape(-1, self.pca.n_components_)
        return quaternions_of(self.pca.inverse_transform(components))


def best(work):
    def seconds():
        start = time.perf_counter()
        work()
        return time.perf_counter() - start

    return CLIPS * FRAMES / min(seconds() for _ in range(RUNS))


def ours(threads):
    command = ["cargo", "run", "--release", "--quiet", "-p", "kinelm-tokenizer", "--example", "tokenize_rate", str(threads)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def main():
    clips = [clip(seed) for seed in range(CLIPS)]
    cores = os.cpu_count()
    one, all_cores = ours(1), ours(cores)
    print(f"frames/s, {CLIPS} clips of {FRAMES} frames, 13 joints")
    print(f"{'':16}{'numpy':>12}{'kinelm':>12}{'ratio':>8}{f'on {cores} cores':>14}{'ratio':>8}")
    for name, scheme in (("uniform", Uniform()), ("dct", Tiles(clips))):
        codes = [scheme.encode(q) for q in clips]
        miss = max(np.abs((Rotation.from_quat(scheme.decode(c).reshape(-1, 4)).inv()
                           * Rotation.from_quat(q.reshape(-1, 4))).magnitude()).max() for c, q in zip(codes, clips))
        assert miss < (0.02 if name == "uniform" else 1.0), miss
        rates = {
            "encode": best(lambda: [scheme.encode(q) for q in clips]),
            "decode": best(lambda: [scheme.decode(c) for c in codes]),
        }
        for way, rate in rates.items():
            mine, many = one[name][way], all_cores[name][way]
            print(f"{name + ' ' + way:16}{rate:12,.0f}{mine:12,.0f}{mine / rate:8.1f}{many:14,.0f}{many / rate:8.1f}")


if __name__ == "__main__":
    main()
