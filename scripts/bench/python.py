"""The Python package beside numpy, scipy and pybvh, on one core, in turn.

    pip install numpy scipy pybvh==0.9.0
    RAYON_NUM_THREADS=1 OMP_NUM_THREADS=1 PYTHONPATH=target/python python scripts/bench/python.py FILE.bvh

- encode: `Tokenizer.encode` of a clip in memory, 13 joints, 360 bins, against rotation vectors and bins of the same joints by
  scipy and numpy (tokenize_rate.py). Ours also codes the root in closed loop.
- read: `Clip.read` of a file against `pybvh.read_bvh_file`.
- import: a process that imports kinelm, over one that doesn't. call: a property of a clip.
Seconds of the processor: medians of nine rounds, and the range.
"""

import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pybvh

import kinelm
from tokenize_rate import FRAMES, JOINTS, Uniform, clip as quaternions_of_seed

ROUNDS = 9


def seconds(work, times=1):
    start = time.process_time()
    for _ in range(times):
        work()
    return (time.process_time() - start) / times


def child_seconds(code):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def told(name, ours, theirs=None, unit=1, what="s"):
    middle = statistics.median(ours) * unit
    text = f"{name:28}{middle:10.3g} {what} ({min(ours) * unit:.3g} to {max(ours) * unit:.3g})"
    if theirs:
        ratios = [b / a for a, b in zip(ours, theirs)]
        text += f"   ratio {statistics.median(ratios):.1f} ({min(ratios):.1f} to {max(ratios):.1f})"
    print(text)


def of_seed(seed, like):
    """A clip of 24 joints that turn as tokenize_rate.py's."""
    turns = np.zeros((FRAMES, 24, 4))
    turns[:, :, 3] = 1
    turns[:, JOINTS] = quaternions_of_seed(seed)
    root = np.tile([0.0, 0.9, 0.0], (FRAMES, 1))
    return kinelm.Clip(like.joints, like.parents, like.offsets, root, turns, 20.0)


path = Path(sys.argv[1])
smpl = kinelm.Clip.read(path).retarget("smpl")
clips = [of_seed(seed, smpl) for seed in range(4)]
arrays = [quaternions_of_seed(seed) for seed in range(4)]
tokenizer, numpy_way = kinelm.Tokenizer.fit(clips, joints="13"), Uniform()
encode, read, imported, call = [], [], [], []
for _ in range(ROUNDS):
    encode.append((seconds(lambda: [tokenizer.encode(clip, floor=0.0) for clip in clips]), seconds(lambda: [numpy_way.encode(a) for a in arrays])))
    read.append((seconds(lambda: kinelm.Clip.read(path)), seconds(lambda: pybvh.read_bvh_file(path))))
    imported.append(child_seconds("import kinelm") - child_seconds("pass"))
    call.append(seconds(lambda: clips[0].fps, 10000))
told("encode, a frame", *zip(*encode), 1e6 / (len(clips) * FRAMES), "us")
told("read", *zip(*read), 1e3, "ms")
told("import", imported, None, 1e3, "ms")
told("call", call, None, 1e6, "us")
