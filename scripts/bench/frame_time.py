#!/usr/bin/env python3
"""Where the time of a sampled frame goes: python3 scripts/bench/frame_time.py PROGRAM [--streams N] [--threads N]

Samples dances of a two-level model with random weights (`kinelm-lab decode --config two-level`) under `perf record`, once
with f32 and once with int8 weights and caches, and prints a table in Markdown: percent of the time by part, and frames a second as
measured under perf.

Needs Python 3.9 or newer and perf (Debian: apt-get install linux-perf).
"""

import argparse
import collections
import json
import pathlib
import subprocess
import sys
import tempfile

# the first that any function of a stack of calls has in its name
PARTS = [
    ("sampling::", "sampling rules"),
    ("random::stream", "random numbers"),
    ("decode::attention::", "attention"),
    ("Head::logits", "head"),
    ("decode::matrix::", "products"),
    ("decode::bytes::", "products"),
    ("decode::weights::", "products"),
    ("decode::stack::", "norms, GELU, sums"),
    ("TwoLevelDecoder", "embeddings, and rows put together"),
    ("generate::sampler::", "grammar and windows"),
]
IN_TRUNK = ["attention", "products", "norms, GELU, sums"]


def part(stack):
    name = next((name for word, name in PARTS if any(word in call for call in stack)), "other")
    if name in IN_TRUNK:
        name += ", trunk" if any("pass_trunk" in call for call in stack) else ", frame decoder"
    return name


def measure(program, weights, args):
    """Percent by part, and frames a second."""
    with tempfile.TemporaryDirectory() as folder:
        data = pathlib.Path(folder) / "perf.data"
        bench = [f"{program}-lab", "decode", "--config", "two-level", "--weights", weights, "--kv", weights, "--frames", str(args.frames)]
        bench += ["--repeats", "3", "--streams", str(args.streams), "--threads", str(args.threads), "--json"]
        record = ["perf", "record", "--quiet", "--freq", "199", "--call-graph", "dwarf,8192", "--output", data, "--"]
        done = subprocess.run([*record, *bench], capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"frame_time.py: {' '.join(map(str, record + bench))}: {done.stderr[-400:]}")
        lines = [json.loads(line) for line in done.stdout.splitlines()]
        rate = next(line["frames_per_s"] for line in lines if line["what"] == "generate")
        script = ["perf", "script", "--input", data, "--fields", "ip,sym"]
        text = subprocess.run(script, capture_output=True, text=True, check=True).stdout
    counts = collections.Counter()
    for block in text.strip().split("\n\n"):
        stack = [line.split(None, 1)[-1] for line in block.splitlines() if line.strip()]
        # reading alone and the set-up are measured by others
        if any("sampler::" in call for call in stack):
            counts[part(stack)] += 1
    total = counts.total()
    print(f"{weights}: {total} samples", file=sys.stderr)
    return {name: 100 * count / total for name, count in counts.items()}, rate


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program")
    parser.add_argument("--frames", type=int, default=2000)
    parser.add_argument("--streams", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    found = [measure(args.program, weights, args) for weights in ("f32", "int8")]
    print("| percent of the time | f32 | int8 |\n|---|--:|--:|")
    names = sorted({name for parts, _ in found for name in parts}, key=lambda name: -found[0][0].get(name, 0))
    for name in names:
        print(f"| {name} | " + " | ".join(f"{parts.get(name, 0):.1f}" for parts, _ in found) + " |")
    print("| frames/s | " + " | ".join(f"{rate:.0f}" for _, rate in found) + " |")


if __name__ == "__main__":
    main()
