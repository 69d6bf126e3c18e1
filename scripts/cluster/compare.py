"""Are the losses of two trainings the same? Compares their metrics.jsonl: compare.py RUN OUT [STEPS].

Losses to 1e-4 nats, measurements to 1e-3 bits a frame; exits 1 otherwise.
"""
import json
import sys
from pathlib import Path

LOSS, BITS = 1e-4, 1e-3


def figures(folder, kind, name):
    lines = [json.loads(line) for line in (Path(folder) / "metrics.jsonl").read_text().splitlines()]
    return {line["step"]: line[name] for line in lines if line["kind"] == kind}


def furthest(kind, name):
    a, b = (figures(folder, kind, name) for folder in sys.argv[1:3])
    steps = sorted(a.keys() & b.keys())
    return len(steps), max((abs(a[s] - b[s]) for s in steps), default=float("inf"))


wanted = int(sys.argv[3]) if len(sys.argv) > 3 else 10
(steps, loss), (measured, bits) = furthest("train", "loss"), furthest("valid", "bits_per_frame")
print(f"{steps} losses within {loss:.1e} nats, {measured} measurements within {bits:.1e} bits/frame")
if steps < wanted or loss > LOSS or bits > BITS:
    sys.exit(f"compare.py: expected {wanted} losses within {LOSS} and measurements within {BITS}")
