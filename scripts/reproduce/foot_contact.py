#!/usr/bin/env python3
"""Physical foot contact (PFC) of recordings as they are, low-passed to 20 frames a second, and coded: docs/referee.md.

    python3 scripts/reproduce/foot_contact.py FILE.. [--tokenizer ready|FILE] [--fps-source 60] [--skip 10]

Needs numpy and scipy; KINELM names the program (target/release/kinelm). Places come from `convert --positions`, the score from
scripts/reference/foot_contact.py; its splines are of places, kinelm's of rotations.
"""
import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts/reference"))
from foot_contact import FPS, pfc, splined  # noqa: E402

KINELM = os.environ.get("KINELM", ROOT / "target/release/kinelm")


def kinelm(*words, out=None):
    subprocess.run([KINELM, *map(str, words), "--quiet"], check=True, stdout=out)


def scores(path, names=None):
    """-> the joints' names, the score from every first frame"""
    file = np.load(path)
    joints = [str(name) for name in file["joints"]]
    places, fps = file["positions"].astype(float), float(file["fps"])
    places = places[:, [joints.index(name) for name in names or joints]]
    if fps % FPS:
        return joints, [pfc(splined(places, fps))]
    step = int(fps // FPS)
    return joints, [pfc(places[phase::step]) for phase in range(step)]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("files", nargs="+")
    parser.add_argument("--tokenizer", default="ready")
    parser.add_argument("--fps-source", type=float)
    parser.add_argument("--skip", type=int, default=0)
    args = parser.parse_args()
    read = ["--skip", args.skip] + (["--fps-source", args.fps_source] if args.fps_source else [])
    for file in args.files:
        with tempfile.TemporaryDirectory() as work:
            work = Path(work)
            own, slow, coded = (work / f"{name}.npz" for name in ("own", "slow", "coded"))
            kinelm("convert", file, own, "--positions", "--onto", "smpl", *read)
            kinelm("convert", file, slow, "--positions", "--onto", "smpl", "--fps", 20, *read)
            with open(work / "words.txt", "wb") as words:
                kinelm("tokenizer", "text", file, "--tokenizer", args.tokenizer, *read, out=words)
            kinelm("tokenizer", "decode", work / "words.txt", work / "coded.bvh", "--tokenizer", args.tokenizer)
            kinelm("convert", work / "coded.bvh", coded, "--positions")
            names, as_recorded = scores(own)
            rows = [as_recorded, scores(slow)[1], scores(coded, names)[1]]
        told = [f"{np.mean(row):.2f}" + (f" ({min(row):.2f}-{max(row):.2f})" if len(row) > 1 else "") for row in rows]
        print(f"{file}: as recorded {told[0]}, low-passed to 20 {told[1]}, coded {told[2]}")


if __name__ == "__main__":
    main()
