#!/usr/bin/env python3
"""Reads one BVH by kinelm and by pybvh (PyPI), in turn, and prints MB/s and their ratio.

    pip install pybvh==0.9.0
    python scripts/bench/read_bvh.py FILE.bvh [path of kinelm]

kinelm's figure is `kinelm-lab read`: the number block, one core, median of 15. pybvh reads the whole file (its header is
well below 1 % of it), median of 3, in this process.
"""
import json, os, statistics, subprocess, sys, time
import pybvh

path = sys.argv[1]
kinelm = sys.argv[2] if len(sys.argv) > 2 else "target/release/kinelm"
size = os.path.getsize(path) / 1e6
ratios = []
for turn in range(5):
    line = subprocess.run([f"{kinelm}-lab", "read", path, "--json", "-q"], capture_output=True, check=True, text=True)
    ours = json.loads(line.stdout)["mb_per_s"]
    times = []
    for _ in range(3):
        start = time.perf_counter()
        pybvh.read_bvh_file(path)
        times.append(time.perf_counter() - start)
    theirs = size / statistics.median(times)
    ratios.append(ours / theirs)
    print(f"kinelm {ours:7.1f} MB/s   pybvh {theirs:6.1f} MB/s   ratio {ratios[-1]:5.1f}")
print(f"median ratio {statistics.median(ratios):.1f} ({min(ratios):.1f} to {max(ratios):.1f})")
