#!/usr/bin/env python3
"""The trial behind docs/results/lapped.md: which transform over time and over the joints takes the fewest bits.

    for f in DATA/bandai-2/*.bvh; do kinelm convert "$f" "npz/$(basename "$f" .bvh).npz" --fps 30 -q; done
    python3 lapped_trial.py npz SPLITS/bandai-2.csv [--hops 16 30] [--target 7.0]

Codes the open channels alone (pelvis tilt x z, rotation vectors of joints 1 to 23, height): steps of one size after the
joint transform, static tables a coefficient fitted on every second training clip and measured on every fourth test clip. The
place on the ground and the turn are the original's. Prints bits a frame and border jerk ratio at one MPJPE, between two
steps in a straight line. numpy 2.4, scipy 1.17; nothing is random but the poses of the metric (seed 0).
"""
import argparse, csv, os
import numpy as np
from scipy.fft import dct, idct

from smpl import OFFSETS, PARENTS


# ---------------------------------------------------------------- rotations, (w, x, y, z)
def from_vector(v):
    a = np.linalg.norm(v, axis=-1, keepdims=True)
    k = np.where(a < 1e-4, .5 - a * a / 48, np.sin(a / 2) / np.where(a < 1e-9, 1, a))
    return np.concatenate([np.cos(a / 2), k * v], -1)

def to_vector(q):
    q = np.where(q[..., :1] < 0, -q, q)
    s = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    return np.where(s < 1e-8, 2 * q[..., 1:], q[..., 1:] * 2 * np.arctan2(s, q[..., :1]) / np.where(s < 1e-8, 1, s))

def multiply(a, b):
    aw, ax, ay, az = np.moveaxis(a, -1, 0); bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack([aw*bw - ax*bx - ay*by - az*bz, aw*bx + ax*bw + ay*bz - az*by,
                     aw*by - ax*bz + ay*bw + az*bx, aw*bz + ax*by - ay*bx + az*bw], -1)

def about_y(a):
    return np.stack([np.cos(a / 2), 0 * a, np.sin(a / 2), 0 * a], -1)

def matrix(q):
    w, x, y, z = np.moveaxis(q, -1, 0)
    return np.stack([1-2*(y*y+z*z), 2*(x*y-w*z), 2*(x*z+w*y), 2*(x*y+w*z), 1-2*(x*x+z*z), 2*(y*z-w*x),
                     2*(x*z-w*y), 2*(y*z+w*x), 1-2*(x*x+y*y)], -1).reshape(q.shape[:-1] + (3, 3))

def continuous(v):
    """Of all vectors of a rotation the one nearest to that of the frame before."""
    v = v.copy()
    for t in range(1, len(v)):
        a = np.linalg.norm(v[t], axis=-1, keepdims=True)
        axis = v[t] / np.where(a > 1e-9, a, 1)
        turns = np.round(((v[t - 1] * axis).sum(-1, keepdims=True) - a) / (2 * np.pi))
        v[t] = np.where(a > 1e-9, axis * (a + 2 * np.pi * turns), v[t])
    return v


# ---------------------------------------------------------------- clips
def load(path):
    """An AMASS file -> open channels (T, 72), turn (T), place on the ground (T, 2)."""
    z = np.load(path); T = len(z["poses"])
    v = np.concatenate([z["poses"][:, :69], z["poses"][:, 111:114]], 1).reshape(T, 24, 3)
    q = from_vector(v); s = np.sqrt(.5)
    q[:, 0] = multiply(np.tile([s, -s, 0, 0], (T, 1)), q[:, 0])               # z up to y up
    turn = np.unwrap(2 * np.arctan2(q[:, 0, 2], q[:, 0, 0]))
    q[:, 0] = multiply(about_y(-turn), q[:, 0])
    v, t = continuous(to_vector(q)), z["trans"]
    return np.concatenate([v[:, 0, [0, 2]], v[:, 1:].reshape(T, 69), t[:, 2:]], 1), turn, np.stack([t[:, 0], -t[:, 1]], 1)

def positions(open_, turn, ground):
    T = len(open_); v = np.zeros((T, 24, 3))
    v[:, 0, [0, 2]], v[:, 1:] = open_[:, :2], open_[:, 2:71].reshape(T, 23, 3)
    q = from_vector(v); q[:, 0] = multiply(about_y(turn), q[:, 0])
    L = matrix(q); G, P = [L[:, 0]], [np.stack([ground[:, 0], open_[:, 71], ground[:, 1]], -1)]
    for j in range(1, 24):
        p = PARENTS[j]
        P.append(P[p] + G[p] @ OFFSETS[j]); G.append(G[p] @ L[:, j])
    return np.stack(P, 1)


# ---------------------------------------------------------------- over time
class Tiles:
    """DCT-II tiles; with `lapped` a filter across each border (Tran, Liang and Tu 2003, type-II fast LOT)."""
    def __init__(self, hop, lapped):
        self.hop, self.half = hop, hop // 2 if lapped else 0
        m = self.half
        if m:
            J, I = np.eye(m)[::-1], np.eye(m)
            V = J @ dct(I, type=2, norm="ortho", axis=0).T @ dct(I, type=4, norm="ortho", axis=0) @ J
            B = np.block([[I, J], [J, -I]])
            self.P = .5 * B @ np.block([[I, 0 * I], [0 * I, V]]) @ B

    def at_borders(self, x, P):
        for b in range(self.hop, len(x), self.hop):
            x[b - self.half:b + self.half] = P @ x[b - self.half:b + self.half]

    def forward(self, x):
        x = x.copy()
        if self.half: self.at_borders(x, self.P)
        return dct(x.reshape(-1, self.hop, x.shape[1]), type=2, norm="ortho", axis=1)

    def inverse(self, c):
        x = idct(c, type=2, norm="ortho", axis=1).reshape(-1, c.shape[2])
        if self.half: self.at_borders(x, self.P.T)
        return x

def padded(x, hop):
    return np.concatenate([x, np.repeat(x[-1:], -len(x) % hop, 0)])


# ---------------------------------------------------------------- over the joints
def metric(X, tip=.02, n=1500, small=1e-5):
    """Mean over poses and joints of what two channels' units move, square metres."""
    X = X[np.random.default_rng(0).choice(len(X), min(n, len(X)), False)]
    zero, ground = np.zeros(len(X)), np.zeros((len(X), 2))
    at = positions(X, zero, ground)
    J = np.stack([(positions(X + small * np.eye(72)[k], zero, ground) - at) / small for k in range(72)], -1)
    floor = np.full(72, tip ** 2 / 24); floor[71] = 0
    return np.einsum("njak,njal->kl", J, J, optimize=True) / len(X) / 24 + np.diag(floor)

def mixes(X, mean):
    """name -> matrices (72, 72) from channels to components and back."""
    P = np.zeros((24, 3)); hanging = [[] for _ in range(24)]
    for j in range(1, 24):
        P[j] = P[PARENTS[j]] + OFFSETS[j]
        k = j
        while PARENTS[k] >= 0: k = PARENTS[k]; hanging[k].append(j)
    arms = [max(.02, np.sqrt(np.mean([((P[k] - P[j]) ** 2).sum() for k in h])) if h else 0) for j, h in enumerate(hanging)]
    lever = np.concatenate([[arms[0]] * 2, np.repeat(arms[1:], 3), [1]])
    M = metric(X); w, U = np.linalg.eigh(M)
    S, unS = (U * np.sqrt(w)) @ U.T, (U / np.sqrt(w)) @ U.T
    B = np.linalg.eigh(np.cov(((X - mean) @ S).T))[1][:, ::-1]
    acting = np.sqrt(np.diag(M))
    return {"lever arms": (np.diag(lever), np.diag(1 / lever)), "arms as they act": (np.diag(acting), np.diag(1 / acting)),
            "klt": (S @ B, B.T @ unS)}


# ---------------------------------------------------------------- cost and loss
def table_bits(train, test, suffix=12):
    """Static tables a coefficient: add-one counts of what training had, an escape with `suffix` bits for the rest."""
    train, test = train.reshape(len(train), -1), test.reshape(len(test), -1); bits = 0.
    for k in range(train.shape[1]):
        u, n = np.unique(train[:, k], return_counts=True); total = n.sum() + len(u) + 1
        i = np.minimum(np.searchsorted(u, test[:, k]), len(u) - 1)
        bits += np.where(u[i] == test[:, k], -np.log2((n[i] + 1) / total), np.log2(total) + suffix).sum()
    return bits

def run(tiles, mix, mean, step, zero, train, test):
    A, back = mix
    numbers = lambda c: tiles.forward(padded((c[0] - mean) @ A, tiles.hop)) / step
    rounded = lambda y: (np.sign(y) * np.floor(np.abs(y) + 1 - zero)).astype(int)
    Q = [rounded(numbers(c)) for c in test]
    bits = table_bits(np.concatenate([rounded(numbers(c)) for c in train]), np.concatenate(Q))
    error, frames, jerk = 0., sum(len(c[0]) for c in test), {k: [[], []] for k in "od"}
    for q, (x, turn, ground) in zip(Q, test):
        original = positions(x, turn, ground)
        decoded = positions(mean + tiles.inverse(q * step)[:len(x)] @ back, turn, ground)
        error += np.linalg.norm(original - decoded, axis=-1).mean(1).sum()
        for key, p in (("o", original), ("d", decoded)):
            j = np.linalg.norm(p[3:] - 3 * p[2:-1] + 3 * p[1:-2] - p[:-3], axis=-1).mean(1)
            t = np.arange(len(j)) % tiles.hop
            touches = (t >= tiles.hop - 3) & (np.arange(len(j)) // tiles.hop < (len(x) - 1) // tiles.hop)
            jerk[key][0].append(j[touches]); jerk[key][1].append(j[~touches])
    ratio = {k: np.concatenate(a).mean() / np.concatenate(b).mean() for k, (a, b) in jerk.items()}
    return np.array([bits / frames, error / frames * 1000, ratio["d"] / ratio["o"]])

def main():
    a = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    a.add_argument("npz"); a.add_argument("splits")
    a.add_argument("--hops", type=int, nargs="*", default=[16, 30]); a.add_argument("--target", type=float, default=7.0)
    a.add_argument("--zero", type=float, default=.5, help="numbers below so many steps are zero")
    a = a.parse_args()
    with open(a.splits, newline="") as f: rows = list(csv.DictReader(f))
    clips = lambda split, every: [load(os.path.join(a.npz, r["clip"] + ".npz")) for r in rows if r["split"] == split][::every]
    train, test = clips("train", 2), clips("test", 4)
    X = np.concatenate([c[0] for c in train]); mean = X.mean(0)
    for name, mix in mixes(X, mean).items():
        low, high = (.020, .035) if name == "lever arms" else (.0085, .0125)
        for lapped in (False, True):
            for hop in a.hops:
                r = [run(Tiles(hop, lapped), mix, mean, s, a.zero, train, test) for s in (low, high)]
                s = (a.target - r[0][1]) / (r[1][1] - r[0][1]); at = r[0] + s * (r[1] - r[0])
                print(f"{name:18s} {'lapped' if lapped else 'dct':6s} hop {hop:3d}  {at[0]:6.2f} bits/frame at {a.target} mm "
                      f"({r[0][1]:.1f} to {r[1][1]:.1f})  border jerk {at[2]:.2f}", flush=True)

if __name__ == "__main__":
    main()
