"""The figures of a reproduction as JSON lines and as a table: table.py OUT TITLE writes OUT/results.jsonl and OUT/table.md.

Reads OUT/cells.txt (a cell and its corpus a line), OUT/results/CELL-SEED.json, OUT/floors/CORPUS.json.
"""
import json
import sys
from pathlib import Path

out, title = Path(sys.argv[1]), sys.argv[2]
cells = [line.split("\t") for line in (out / "cells.txt").read_text().splitlines()]
FLOORS = {"a_order0": "order 0", "b_delta": "difference to the frame before", "c_prev": "around the frame before"}


def spread(numbers, digits):
    mean = sum(numbers) / len(numbers)
    around = f" ({min(numbers):.{digits}f} to {max(numbers):.{digits}f})" if len(numbers) > 1 else ""
    return f"{mean:.{digits}f}{around}"


lines, rows = [], []
for cell, corpus in cells:
    found = []
    for path in sorted((out / "results").glob(f"{cell}-*.json")):
        seed = path.stem.removeprefix(f"{cell}-")
        if seed.isdigit():
            figures = json.loads(path.read_text())
            keep = ["bits_per_frame", "bits_per_s", "nats_per_token", "tokens", "frames", "checkpoint"]
            found.append({"schema": 1, "cell": cell, "corpus": corpus, "seed": int(seed)} | {k: figures[k] for k in keep})
    lines += found
    if found:
        of = lambda key: [f[key] for f in found]
        pseudo = ", pseudo" if cell.startswith("masked") else ""
        rows.append(f"| {cell.replace('_', ' ')} | {corpus} | {spread(of('nats_per_token'), 3)} | "
                    f"{spread(of('bits_per_frame'), 2)}{pseudo} | {spread(of('bits_per_s'), 0)} | {len(found)} |")
floors = []
for corpus in dict.fromkeys(corpus for _, corpus in cells):
    bits = json.loads((out / "floors" / f"{corpus}.json").read_text())["bits_per_frame"]
    best = min(bits, key=bits.get)
    lines.append({"schema": 1, "floors": corpus, "best": best, "bits_per_frame": bits})
    known = " | ".join(f"{bits[key]:.2f}" if key in bits else "" for key in FLOORS)
    floors.append(f"| {corpus} | {known} | {bits[best]:.2f} ({best}) |")
table = ["| | corpus | loss, nats a token | bits/frame | bits/s | seeds |", "|---|---|---|---|---|---|", *rows]
beside = [f"| static models, bits/frame | {' | '.join(FLOORS.values())} | the best of all |", "|---|---|---|---|---|", *floors]
said = [f"# {title}", "Test clips; mean (lowest to highest) over the seeds.", "\n".join(table), "\n".join(beside)]
text = "\n\n".join(said) + "\n"
(out / "results.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
(out / "table.md").write_text(text)
print(text)
