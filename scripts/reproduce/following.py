"""The tables of following.sh: following.py OUT"""

import json
import pathlib
import re
import sys

out = pathlib.Path(sys.argv[1])
tempi = ["90", "110", "130"]


def row(name, kept):
    legs = kept["legs"]
    z = legs["z"] or [float("nan")] * 2
    cells = [f"{legs['found'][i]:.3f} | {legs['shifted'][i]:.3f} | {z[i]:.1f}" for i in (0, 1)]
    return f"| {name} | {kept['dances']} | {' | '.join(cells)} | {100 * kept['in_tempo']:.0f} % |"


print("| | dances | BA_motion | shifted | z | BA_music | shifted | z | in tempo |")
print("|---|--:|--:|--:|--:|--:|--:|--:|--:|")
by_tempo = []
for told in ["beats", "features", "both", "none", "transfer", "beats-pieces", "features-pieces", "both-pieces"]:
    path = out / f"{told}.json"
    if not path.exists():
        continue
    report = json.loads(path.read_text())
    rows = {kept["name"]: kept for kept in report["beats"]}
    if not by_tempo:
        print(row("the real test dances, coded", rows["test"]))
    what = f"told {told}"
    if told == "transfer":
        what = "told beats, after a second of another dance"
    if told.endswith("-pieces"):
        what = f"told {told.removesuffix('-pieces')}, music of another kind"
    names = {"dances": what, "the same against other music": "against other music"}
    for name in ["dances", "the same against other music", "the same, half a beat off"]:
        print(row(names.get(name, "half a beat off"), rows[name]))
    cells = []
    for bpm in tempi:
        own = [kept for name, kept in rows.items() if re.search(rf"-{bpm}(-\d)?(\.bvh)?$", name)]
        cells.append(f"{sum(kept['in_tempo'] for kept in own):.0f} of {len(own)}")
    if not told.endswith("-pieces"):
        by_tempo.append(f"| {what} | {' | '.join(cells)} |")
print("\n| in tempo at | " + " | ".join(tempi) + " |")
print("|---|--:|--:|--:|")
print("\n".join(by_tempo))
print("\n| told | bits/frame | hidden |\n|---|--:|--:|")
for told in ["beats", "features", "both"]:
    bits = [out / f"bits-{told}-{conditions}.json" for conditions in ("labels", "none")]
    if all(path.exists() for path in bits):
        found = [json.loads(path.read_text()) for path in bits]
        print(f"| {told} | " + " | ".join(f"{b['bits_per_frame']:.2f}" for b in found) + " |")
