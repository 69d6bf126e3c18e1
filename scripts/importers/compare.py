"""How far joints are from where kinelm has them, in a program that imported them. Needs numpy.

    python scripts/importers/compare.py positions.npz positions.json LIMIT_MM [--floor | --hips first.npz]

positions.npz: `kinelm convert FILE positions.npz --positions`. Exits with 1 above the limit. `--floor`: a height that is the same
in all frames is none of the distance, as a VRM animation has the floor at 0. `--hips`: of a VRM animation that another avatar
plays than the one of first.npz; its hips must be where those are, by `ratio` of positions.json, and joints are compared as
they are from the hips.
"""

import argparse
import json
import sys

import numpy as np

args = argparse.ArgumentParser()
args.add_argument("ours")
args.add_argument("theirs")
args.add_argument("limit", type=float)
args.add_argument("--floor", action="store_true")
args.add_argument("--hips")
args = args.parse_args()
ours, theirs = np.load(args.ours), json.load(open(args.theirs))
at, names = ours["positions"], [str(name) for name in ours["joints"]]
frames = theirs["frames"]
shared = [name for name in names if name in frames[0]]
count = min(len(frames), len(at))
ours = at[:count, [names.index(name) for name in shared]]
played = np.array([[frame[name] for name in shared] for frame in frames[:count]])
how, wrong = "", False
if args.floor:
    floor = (ours - played)[0, 0, 1]
    ours = ours - [0, floor, 0]
    how = f", raised by {-1000 * floor:.2f} mm"
if args.hips:
    first, hips = np.load(args.hips), shared.index(theirs["hips"])
    path = first["positions"][:count, [str(name) for name in first["joints"]].index(theirs["hips"])]
    path = path - [0, path[0, 1] - played[0, hips, 1] / theirs["ratio"], 0]
    off = 1000 * np.linalg.norm(played[:, hips] - theirs["ratio"] * path, axis=1).max()
    how, wrong = f", hips {theirs['ratio']:.4f} times as high within {off:.4f} mm, others from the hips", off > 0.1
    ours, played = ours - ours[:, [hips]], played - played[:, [hips]]
far = 1000 * np.linalg.norm(ours - played, axis=2).max()
print(f"{theirs['program']}: {len(frames)} of {len(at)} frames, {len(shared)} of {len(frames[0])} joints by name, "
      f"{far:.4f} mm at most{how}")
sys.exit(bool(far > args.limit or wrong or len(shared) < len(frames[0]) or abs(len(frames) - len(at)) > 1))
