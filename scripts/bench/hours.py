#!/usr/bin/env python3
"""What hours of motion cost: python3 scripts/bench/hours.py PROGRAM DATA [--hours 1,10,100] [--out FILE]

Makes that many hours of AMASS files (npz, SMPL+H, 30 frames a second, a minute each) out of the clips in DATA: pieces of
them, turned about the vertical and with a slow wave on every joint, so that no two are alike. Then fits a tokenizer,
tokenizes, opens the corpus, trains 20 steps, measures, builds an index of movements and searches it. Prints a table in
Markdown: seconds, peak MB and MB on the disk of each, and by what power of the hours the seconds grow.

`--linked N` goes on with N times the last hours, the same files under N names each: tokens and index alone, of as many
clips, without the disk for their files.

Needs Python 3.9 or newer and numpy, and 100 MB an hour in the folder for temporary files, 30 a linked one.
"""

import argparse
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np

FPS = 30
SECONDS = 60


def run(call, folder):
    """Seconds and peak MB of a call."""
    begun, peak = time.monotonic(), 0
    with open(folder / "said", "w+") as said:
        process = subprocess.Popen([str(word) for word in call], cwd=folder, stdout=subprocess.DEVNULL, stderr=said)
        # what the system counts for a child that has ended includes this interpreter, which it was forked from
        while process.poll() is None:
            time.sleep(0.02)
            try:
                status = pathlib.Path(f"/proc/{process.pid}/status").read_text()
                peak = max(peak, int(status.split("VmHWM:")[1].split()[0]) / 1024)
            except (IndexError, OSError):
                pass
        seconds = time.monotonic() - begun
        said.seek(0)
        if process.returncode:
            sys.exit(f"hours.py: {' '.join(map(str, call))}: {said.read()[-800:]}")
    return seconds, peak


def megabytes(path):
    files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
    return sum(file.stat().st_size for file in files) / 1e6


def turned(vectors, angle):
    """Rotation vectors (F, 3) turned by an angle about z, which is up in AMASS."""
    half = np.linalg.norm(vectors, axis=1, keepdims=True) / 2
    w, xyz = np.cos(half[:, 0]), vectors * (np.sinc(half / np.pi) / 2)
    c, s = math.cos(angle / 2), math.sin(angle / 2)
    x, y, z = xyz.T
    w, x, y, z = c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w
    sign = np.where(w < 0, -1, 1)
    size = np.sqrt(x * x + y * y + z * z)
    angle = 2 * np.arctan2(size, np.abs(w))
    scale = np.where(size > 1e-9, angle / np.maximum(size, 1e-9), 2.0) * sign
    return np.stack([x, y, z], axis=1) * scale[:, None]


def make(clips, folder, hours, seed):
    """Writes `hours` of clips of a minute."""
    rng = np.random.default_rng(seed)
    folder.mkdir()
    frames = FPS * SECONDS
    t = np.arange(frames)[:, None] / FPS
    for n in range(round(hours * 3600 / SECONDS)):
        poses, trans = clips[rng.integers(len(clips))]
        # there and back again, from somewhere on
        at = (np.arange(frames) + rng.integers(len(poses))) % (2 * len(poses) - 2)
        at = np.minimum(at, 2 * len(poses) - 2 - at)
        poses, trans = poses[at].copy(), trans[at].copy()
        wave = 0.05 * np.sin(2 * math.pi * (rng.uniform(0.1, 0.5, poses.shape[1]) * t + rng.uniform(0, 1, poses.shape[1])))
        poses[:, 3:66] += wave[:, 3:66].astype(np.float32)
        angle = rng.uniform(0, 2 * math.pi)
        poses[:, :3] = turned(poses[:, :3].astype(np.float64), angle)
        c, s = math.cos(angle), math.sin(angle)
        trans = trans @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]], np.float32)
        np.savez(folder / f"{n:05}.npz", poses=poses, trans=trans, mocap_framerate=float(FPS), gender="neutral", betas=np.zeros(16))
    return folder


def link(data, folder, times):
    """The files of `data` under as many names each."""
    folder.mkdir()
    for n in range(times):
        for file in data.iterdir():
            (folder / f"{n}-{file.name}").hardlink_to(file)
    return folder


def carry_out(program, steps, place, hours):
    """Seconds, peak MB and MB on the disk of each step."""
    figures = {}
    for name, call, out in steps:
        seconds, peak = run([program, *call, "--quiet"], place)
        figures[name] = (seconds, peak, megabytes(place / out) if out else None)
        print(f"{hours:g} h, {name}: {seconds:.1f} s, {peak:.0f} MB", file=sys.stderr, flush=True)
    return figures


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program")
    parser.add_argument("data", help="motion files, or a folder of them")
    parser.add_argument("--hours", default="1,10,100")
    parser.add_argument("--linked", type=int, default=0, help="how many times the last hours tokens and index are made of, too")
    parser.add_argument("--config", default="tiny", help="what is trained")
    parser.add_argument("--out", help="a JSON file for programs")
    args = parser.parse_args()
    program = pathlib.Path(args.program).resolve()
    all_hours = [float(hours) for hours in args.hours.split(",")]
    found = {}
    with tempfile.TemporaryDirectory(prefix="kinelm-hours-") as top:
        top = pathlib.Path(top)
        run([program, "convert", pathlib.Path(args.data).resolve(), top / "base", "--format", "npz", "--fps", FPS, "--quiet"], top)
        clips = []
        for file in sorted((top / "base").rglob("*.npz")):
            clip = np.load(file, allow_pickle=False)
            clips.append((clip["poses"].astype(np.float32), clip["trans"].astype(np.float32)))
        clips = [clip for clip in clips if len(clip[0]) > 10 * FPS]
        for hours in all_hours:
            place = top / f"h{hours:g}"
            place.mkdir()
            data = make(clips, place / "data", hours, int(hours))
            whole = [
                ("fit", ["tokenizer", "fit", data, "--out", "tokenizer.json"], "tokenizer.json"),
                ("tokenize", ["tokenize", data, "--tokenizer", "tokenizer.json", "--out", "corpus"], "corpus"),
                ("open and count", ["corpus", "stats", "corpus", "--json"], None),
                ("20 steps", ["pretrain", "--config", args.config, "--corpus", "corpus", "--run", "run", "--steps", "20"], "run"),
                ("measure, 64 windows", ["evaluate", "likelihood", "--run", "run", "--corpus", "corpus", "--split", "train", "--windows", "64"], None),
                ("build an index", ["query", "build", data, "--out", "index"], "index"),
                ("find", ["query", "find", data / "00000.npz", "--index", "index", "--at", "3", "--json"], None),
            ]
            found[hours] = carry_out(program, whole, place, hours)
            found[hours]["motion files"] = (None, None, megabytes(data))
            if hours == all_hours[-1] and args.linked:
                names = link(data, place / "linked", args.linked)
                alone = [
                    ("tokenize", ["tokenize", names, "--tokenizer", "tokenizer.json", "--out", "corpus-linked"], "corpus-linked"),
                    ("open and count", ["corpus", "stats", "corpus-linked", "--json"], None),
                    ("build an index", ["query", "build", names, "--out", "index-linked"], "index-linked"),
                    ("find", ["query", "find", data / "00000.npz", "--index", "index-linked", "--at", "3", "--json"], None),
                ]
                found[hours * args.linked] = carry_out(program, alone, place, hours * args.linked)
            subprocess.run(["rm", "-r", str(place)], check=True)
    if args.out:
        pathlib.Path(args.out).write_text(json.dumps(found, indent=1))
    show = lambda x, digits: "" if x is None else f"{x:,.{digits}f}"
    print("| | " + " | ".join(f"{hours:g} h: s, peak MB, MB on disk" for hours in found) + " | seconds grow as hours to the |")
    print("|---|" + "--:|" * (len(found) + 1))
    for name in ["motion files"] + [name for name in found[all_hours[0]] if name != "motion files"]:
        cells = []
        for figures in found.values():
            seconds, peak, disk = figures.get(name, (None, None, None))
            cells.append(", ".join(part or "-" for part in (show(seconds, 1), show(peak, 0), show(disk, 1 if disk and disk < 10 else 0))))
        timed = [(hours, figures[name][0]) for hours, figures in found.items() if name in figures and figures[name][0] is not None]
        (least, first), (most, last) = (timed[0], timed[-1]) if timed else ((1, 1), (1, 1))
        power = "" if least == most else f"{math.log(last / first) / math.log(most / least):.2f}"
        print(f"| {name} | " + " | ".join(cells) + f" | {power} |")


if __name__ == "__main__":
    main()
