#!/usr/bin/env python3
"""Does `kinelm compare` know the same movement again? Pairs of bandai-2 of one content and style against pairs of two contents.

    scripts/reproduce/compare.py DATA SPLITS [PAIRS] [KINELM]

DATA and SPLITS as ../shared/data/unpack.sh leaves them (target/shared-data, ../shared/data/splits). PAIRS clips (300) are drawn
with seed 1; each is compared with another of its content and style and with one of another content. Prints the area under the
curve of the distance and of the cosine, with the middle 95 % of 2000 resamples of the clips. Needs Python alone.
"""
import bisect, csv, json, random, subprocess, sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path


def area(same, other):
    """The share of (same, other) pairs in which same is nearer; ties are halves."""
    other = sorted(other)
    count = lambda x: len(other) - (bisect.bisect_left(other, x) + bisect.bisect_right(other, x)) / 2
    return sum(map(count, same)) / (len(same) * len(other))


def main():
    data, splits = Path(sys.argv[1]), Path(sys.argv[2])
    pairs = int(sys.argv[3]) if len(sys.argv) > 3 else 300
    kinelm = sys.argv[4] if len(sys.argv) > 4 else "target/release/kinelm"
    rows = list(csv.DictReader((splits / "bandai-2.csv").open()))
    rng = random.Random(1)
    drawn = []
    for row in rng.sample(rows, pairs):
        same = [r for r in rows if r["content"] == row["content"] and r["style"] == row["style"] and r is not row]
        other = [r for r in rows if r["content"] != row["content"]]
        drawn.append((row, rng.choice(same), rng.choice(other)))
    path = lambda row: str((data / "bandai-2" / row["clip"]).with_suffix(".bvh"))

    def compared(pair):
        call = [kinelm, "compare", *map(path, pair), "--json", "--quiet", "--threads", "1"]
        return json.loads(subprocess.run(call, check=True, capture_output=True).stdout)

    calls = [(row, to) for row, same, other in drawn for to in (same, other)]
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(compared, calls))
    for name, nearness in [("distance_cm", 1), ("cosine", -1)]:
        both = [(a[name], b[name]) for a, b in zip(found[::2], found[1::2])]
        both = [(nearness * a, nearness * b) for a, b in both if a is not None and b is not None]
        resamples = sorted(area(*zip(*rng.choices(both, k=len(both)))) for _ in range(2000))
        low, high = resamples[50], resamples[1950]
        print(f"{name}: area {area(*zip(*both)):.3f} ({low:.3f} to {high:.3f}), {len(both)} pairs of each kind")
    for kind, reports in [("same", found[::2]), ("other", found[1::2])]:
        cm = sorted(report["distance_cm"] for report in reports)
        print(f"{kind}: median {cm[len(cm) // 2]:.1f} cm, mirrored nearer in {sum(r['mirrored'] for r in reports)} of {len(cm)}")


main()
