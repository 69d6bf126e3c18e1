"""How far joints are from where kinelm has them, in a program that imported them. Needs numpy.

    python scripts/importers/compare.py positions.npz positions.json LIMIT_MM

positions.npz: `kinelm convert FILE positions.npz --positions`. Exits with 1 above the limit.
"""

import json
import sys

import numpy as np

ours, theirs = np.load(sys.argv[1]), json.load(open(sys.argv[2]))
at, names = ours["positions"], [str(name) for name in ours["joints"]]
frames = theirs["frames"]
shared = [name for name in names if name in frames[0]]
count = min(len(frames), len(at))
far = max(np.linalg.norm(at[f][names.index(name)] - frames[f][name]) for f in range(count) for name in shared)
print(f"{theirs['program']}: {len(frames)} of {len(at)} frames, {len(shared)} of {len(frames[0])} joints by name, "
      f"{1000 * far:.4f} mm at most")
sys.exit(far * 1000 > float(sys.argv[3]) or len(shared) < len(frames[0]) or abs(len(frames) - len(at)) > 1)
