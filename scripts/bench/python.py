"""What a call of the Python package costs: processor seconds, medians of nine rounds, and the range. How fast it reads and codes
beside other packages, peers.sh says.

    PYTHONPATH=target/python python scripts/bench/python.py

- import: a process that imports kinelm, over one that doesn't. call: a property of a clip.
"""

import resource
import statistics
import subprocess
import sys
import time

import numpy as np

import kinelm

ROUNDS = 9


def child_seconds(code):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def told(name, all, unit, what):
    print(f"{name:28}{statistics.median(all) * unit:10.3g} {what} ({min(all) * unit:.3g} to {max(all) * unit:.3g})")


clip = kinelm.Clip(["root"], [None], np.zeros((1, 3)), np.zeros((2, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (2, 1, 1)), 20.0)
imported, call = [], []
for _ in range(ROUNDS):
    imported.append(child_seconds("import kinelm") - child_seconds("pass"))
    start = time.process_time()
    for _ in range(10000):
        clip.fps
    call.append((time.process_time() - start) / 10000)
told("import", imported, 1e3, "ms")
told("call", call, 1e6, "us")
