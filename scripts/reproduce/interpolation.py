"""Blends of pairs of dances as JSON lines and as tables: interpolation.py KINELM DATA SPLITS OUT (see interpolation.sh).

Pairs of the tables of ways, by a rule that knows nothing of their motion: test clips in the order of the SHA-256 of
`A B`, the first twelve whose takes differ, no clip in more than three of them. In bandai-2 both have the same content in
different styles. Windows of 128 frames at 60 a second from 2 s on (cmu-dance, its first ten frames left out) or from the
beginning (bandai-2).

Pairs of the table of times: any two of the six test salsas, either being the first, at five times.
"""
import csv
import hashlib
import json
import statistics
import subprocess
import sys
from itertools import permutations, product
from pathlib import Path

kinelm, data, splits, out = sys.argv[1], *map(Path, sys.argv[2:5])
PAIRS = 12
FRAMES, RATE, SKIP = 128, 60, 10
# the way, and what it is called in the table
WAYS = {
    "DCT 16 (to 3.5 Hz)": ["--transform", "dct"],
    "DCT 16, closed form": ["--transform", "dct", "--amount", "0.5"],
    "DCT 32 (to 7.3 Hz)": ["--transform", "dct", "--keep", "32"],
    "DCT, all 128, closed form": ["--transform", "dct", "--keep", "128", "--amount", "0.5"],
    "PCA 16": ["--transform", "pca"],
    "STFT": ["--transform", "stft"],
    "DCT 16, all the way": ["--transform", "dct", "--strength", "1"],
    "PCA 16, all the way": ["--transform", "pca", "--strength", "1"],
    "STFT, all the way": ["--transform", "stft", "--strength", "1"],
}
COORDINATES = ["relative", "vectors"]
TIMES = [2, 5, 7, 11, 13]
SETS = {
    "cmu-dance": {"at": 2, "alike": lambda a, b: a["take"] != b["take"]},
    "bandai-2": {"at": 0, "alike": lambda a, b: a["content"] == b["content"] and a["style"] != b["style"]},
}


def call(*arguments):
    done = subprocess.run([kinelm, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"kinelm {' '.join(map(str, arguments))}: {done.stderr}")
    return done.stdout


def frames(path):
    with open(path, errors="replace") as lines:
        return next(int(line.split()[-1]) for line in lines if line.startswith("Frames"))


def tests(name):
    return [row for row in csv.DictReader(open(splits / f"{name}.csv")) if row["split"] == "test"]


def pairs(name):
    # 128 frames at 60 a second, and the places between them
    rows = [row for row in tests(name) if name != "bandai-2" or frames(data / name / f"{row['clip']}.bvh") >= 66]
    order = lambda pair: hashlib.sha256(f"{pair[0]['clip']} {pair[1]['clip']}".encode()).hexdigest()
    chosen, used = [], {}
    for a, b in sorted((p for p in permutations(rows, 2) if SETS[name]["alike"](*p)), key=order):
        if len(chosen) < PAIRS and max(used.get(a["clip"], 0), used.get(b["clip"], 0)) < 3:
            chosen.append((a, b))
            for row in (a, b):
                used[row["clip"]] = used.get(row["clip"], 0) + 1
    return chosen


def at_its_rate(name, row):
    """A clip at 60 frames a second: of cmu-dance at the rate that it was taken with, without its first ten frames."""
    if name != "cmu-dance":
        return data / name / f"{row['clip']}.bvh"
    to = out / "clips" / f"{name}-{row['clip'].replace('/', '-')}.bvh"
    if not to.exists():
        source = data / name / f"{row['clip']}.bvh"
        call("convert", source, to, "--skip", SKIP, "--fps-source", row["fps"], "--fps", RATE, "-q")
    return to


def blend(name, a, b, at, way, coordinates):
    """What kinelm measures of one blend, kept in OUT/blends."""
    options = [*WAYS[way], "--coordinates", coordinates]
    key = hashlib.sha256(f"{name} {a['clip']} {b['clip']} {at} {options}".encode()).hexdigest()[:16]
    kept = out / "blends" / f"{key}.json"
    if not kept.exists():
        files = [at_its_rate(name, a), at_its_rate(name, b)]
        window = ["--at-a", at, "--at-b", at, "--keep-rest"]
        to = out / "blends" / f"{key}.bvh"
        kept.write_text(call("interpolate", *files, "--out", to, *window, *options, "--json", "-q", "--force"))
    figures = json.loads(kept.read_text())
    lines[key] = {"schema": 1, "set": name, "a": a["clip"], "b": b["clip"], "at_s": at, "row": way} | {
        k: figures[k] for k in ("coordinates", "stft", "own", "jitter", "jitter_ratio", "is_between", "is_smooth")}
    return figures


def spread(numbers, digits=3):
    return f"{statistics.mean(numbers):.{digits}f} ({min(numbers):.{digits}f} to {max(numbers):.{digits}f})"


def by_time():
    """How many blends of the test salsas shake, and how many are between, by way and time."""
    salsas = [row for row in tests("cmu-dance") if row["genre"] == "salsa"]
    pairs = list(permutations(salsas, 2))
    table = [f"### Test salsas, {len(pairs)} pairs at each time", "",
             "| | from | above 1.1 | above 1.25 | median | highest | between |", "|---|---|--:|--:|--:|--:|--:|"]
    for coordinates, way in product(COORDINATES, ["DCT 16 (to 3.5 Hz)", "PCA 16"]):
        for at in TIMES:
            found = [blend("cmu-dance", a, b, at, way, coordinates) for a, b in pairs]
            ratios = [f["jitter_ratio"] for f in found]
            above = lambda bound: sum(ratio > bound for ratio in ratios)
            table.append(f"| {way}, {coordinates} | {at} s | {above(1.1)} | {above(1.25)} | "
                         f"{statistics.median_low(ratios):.2f} | {max(ratios):.2f} | {sum(f['is_between'] for f in found)} |")
    return "\n".join(table) + "\n"


def by_way(name, coordinates):
    """The means of every way over twelve pairs, and the cosines of each pair."""
    found = {way: [blend(name, a, b, SETS[name]["at"], way, coordinates) for a, b in pairs(name)] for way in WAYS}
    table = [f"### {name}, {PAIRS} pairs, {coordinates}", "",
             "| | A-B | A-C | C-B | jitter of C over the larger of A's and B's | between | calm |", "|---|---|---|---|---|---|---|"]
    for way, all in found.items():
        of = lambda key: spread([f["stft"][key] for f in all])
        yes = lambda key: f"{sum(f[key] for f in all)}/{len(all)}"
        ratio = spread([f["jitter_ratio"] for f in all], 2)
        table.append(f"| {way} | {of('a_b')} | {of('a_c')} | {of('c_b')} | {ratio} | {yes('is_between')} | {yes('is_smooth')} |")
    table += ["", "| pair | A-B | DCT 16: A-C | C-B | PCA 16: A-C | C-B | STFT: A-C | C-B |", "|---|---|---|---|---|---|---|---|"]
    for i, (a, b) in enumerate(pairs(name)):
        ways = [found[way][i]["stft"] for way in ("DCT 16 (to 3.5 Hz)", "PCA 16", "STFT")]
        cells = " | ".join(f"{w['a_c']:.3f} | {w['c_b']:.3f}" for w in ways)
        short = lambda row: row["clip"].removeprefix("dataset-2_")
        table.append(f"| {short(a)}, {short(b)} | {ways[0]['a_b']:.3f} | {cells} |")
    return "\n".join(table) + "\n"


lines = {}
tables = [by_time(), *(by_way(name, coordinates) for coordinates, name in product(COORDINATES, SETS))]
(out / "results.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines.values()))
(out / "table.md").write_text(f"{call('--version').strip()}\n\n" + "\n".join(tables))
