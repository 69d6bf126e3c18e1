"""Tables of classification.sh: classification.py OUT SEEDS writes OUT/table.md from OUT/results/CELL_BEGIN_SHARE-SEED.json."""
import json
import sys
from collections import defaultdict
from pathlib import Path

out, seeds = Path(sys.argv[1]), sys.argv[2].split()
cells = defaultdict(list)
for path in sorted((out / "results").glob("*.json")):
    name, seed = path.stem.rsplit("-", 1)
    if seed in seeds:
        cells[name].append(json.loads(path.read_text()))


def spread(numbers):
    mean = 100 * sum(numbers) / len(numbers)
    if min(numbers) == max(numbers):
        return f"{mean:.1f}"
    return f"{mean:.1f} ({100 * min(numbers):.1f} to {100 * max(numbers):.1f})"


def figures(found, name, field):
    return [row["clips"] for one in found for row in one["rows"] if row["name"] == name and row["field"] == field]


VECTORS = "LDA of the model's vectors"
text = []
for task in ["by-number", "held-out", "genre", "dancer"]:
    whole = cells.get(f"{task}_pretrained_1")
    if not whole:
        continue
    for field in dict.fromkeys(row["field"] for row in whole[0]["rows"]):
        names = list(dict.fromkeys(row["name"] for row in whole[0]["rows"]))
        clips = whole[0]["clips"]
        text += [f"## {task}: {field}", f"{clips[0]} train clips, {clips[1]} test clips; by clip; mean over {len(whole)} seeds (lowest to highest).", ""]
        text += ["| | accuracy % | 95 % of the first | balanced % | macro F1 % | calibration error |", "|---|---|---|---|---|---|"]
        for begin, label in [("pretrained", ", pre-trained"), ("scratch", ", from nothing")]:
            found = cells.get(f"{task}_{begin}_1", [])
            for name in names:
                own = name == "class tokens"
                rows = figures(found, name, field)
                if not rows or (begin == "scratch" and not own):
                    continue
                low, high = rows[0]["accuracy_95"]
                of = lambda key: spread([row[key] for row in rows])
                error = sum(row["calibration_error"] for row in rows) / len(rows)
                text.append(f"| {name}{label if own else ''} | {of('accuracy')} | {100 * low:.1f} to {100 * high:.1f} | "
                            f"{of('balanced_accuracy')} | {of('macro_f1')} | {error:.3f} |")
        shares = sorted({float(c.rsplit("_", 1)[1]) for c in cells if c.startswith(f"{task}_")})
        if len(shares) > 1:
            text += ["", f"Accuracy % by the share of the labels ({field}):", "", "| share | clips | pre-trained | from nothing | LDA | LDA of the model's vectors |", "|---|---|---|---|---|---|"]
            for share in shares:
                find = lambda begin: next((v for k, v in cells.items() if k.startswith(f"{task}_{begin}_") and float(k.rsplit("_", 1)[1]) == share), [])
                ours, nothing = find("pretrained"), find("scratch")
                of = lambda found, name: spread([row["accuracy"] for row in figures(found, name, field)]) if found else ""
                many = ours[0]["clips"][0] if ours else ""
                text.append(f"| {100 * share:g} % | {many} | {of(ours, 'class tokens')} | {of(nothing, 'class tokens')} | "
                            f"{of(ours, 'LDA')} | {of(ours, VECTORS)} |")
        text.append("")
(out / "table.md").write_text("\n".join(text))
print("\n".join(text))
