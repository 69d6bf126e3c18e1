"""Tables of classification.sh: classification.py OUT SEEDS writes OUT/table.md from OUT/results/TASK_BEGIN_SHARE-SEED.json."""
import json
import sys
from collections import defaultdict
from pathlib import Path

out, seeds = Path(sys.argv[1]), sys.argv[2].split()
cells = defaultdict(list)
for path in sorted((out / "results").glob("*.json")):
    cell, seed = path.stem.rsplit("-", 1)
    if seed in seeds and path.stat().st_size:
        cells[tuple(cell.split("_"))].append(json.loads(path.read_text()))


def spread(numbers):
    """The mean, and the lowest and highest of several, in per cent."""
    mean = f"{100 * sum(numbers) / len(numbers):.1f}"
    return mean if len(numbers) < 2 else f"{mean} ({100 * min(numbers):.1f} to {100 * max(numbers):.1f})"


def interval(share, count):
    """Wilson's, 95 %, for the mean of the seeds over so many clips."""
    z2 = 1.959964**2
    middle, half = share + z2 / (2 * count), (z2 * (share * (1 - share) / count + z2 / (4 * count**2))) ** 0.5
    return [(middle - half) / (1 + z2 / count), (middle + half) / (1 + z2 / count)]


def rows(found, name, field):
    return [row for one in found for row in one["rows"] if (row["name"], row["field"]) == (name, field)]


def table(task, field):
    ours = cells[task, "pretrained", "1"]
    train, test = ours[0]["clips"]
    lines = [f"### {task}: {field}", "", f"{train} training clips, {test} test clips.", "",
             "| | clips right, % | 95 % | balanced % | macro F1 % | calibration error | windows right, % | seeds |",
             "|---|---|---|---|---|---|---|---|"]
    plain = [row["name"] for row in ours[0]["rows"] if row["field"] == field and not row["name"].startswith("class tokens")]
    asked = [("pretrained", name, name) for name in plain]
    asked += [("scratch", "class tokens", "class tokens, from nothing"), ("pretrained", "class tokens", "class tokens, pre-trained"),
              ("pretrained", "class tokens and LDA", "**class tokens, pre-trained, and LDA**")]
    for begin, name, label in asked:
        found = rows(cells[task, begin, "1"], name, field)
        if not found:
            continue
        of_clips = [row["clips"] for row in found]
        low, high = interval(sum(c["accuracy"] for c in of_clips) / len(found), of_clips[0]["count"])
        of = lambda key: spread([c[key] for c in of_clips])
        error = sum(c["calibration_error"] for c in of_clips) / len(found)
        windows = spread([row["windows"]["accuracy"] for row in found]) if found[0]["windows"] else ""
        lines.append(f"| {label} | {of('accuracy')} | {100 * low:.1f} to {100 * high:.1f} | {of('balanced_accuracy')} | "
                     f"{of('macro_f1')} | {error:.3f} | {windows} | {len(found) if 'class tokens' in name else ''} |")
    return lines + [""]


def curve(task, field):
    shares = sorted({float(share) for t, _, share in cells if t == task})
    if len(shares) < 2:
        return []
    lines = [f"### {task}: {field}, by the share of the labels", "", "Clips right, %.", "",
             "| share | training clips | LDA | nearest spectra | class tokens, from nothing | class tokens, pre-trained | and LDA | seeds |",
             "|---|---|---|---|---|---|---|---|"]
    for share in shares:
        of_share = lambda begin: next((v for (t, b, s), v in cells.items() if (t, b, float(s)) == (task, begin, share)), [])
        ours, nothing = of_share("pretrained"), of_share("scratch")
        if not ours:
            continue
        of = lambda found, name: spread([row["clips"]["accuracy"] for row in rows(found, name, field)] or [float("nan")])
        lines.append(f"| {100 * share:g} % | {ours[0]['clips'][0]} | {of(ours, 'LDA')} | {of(ours, 'nearest spectra')} | "
                     f"{of(nothing, 'class tokens')} | {of(ours, 'class tokens')} | {of(ours, 'class tokens and LDA')} | {len(ours)} |")
    return lines + [""]


text = []
for task in ["by-number", "held-out", "genre", "dancer"]:
    ours = cells.get((task, "pretrained", "1"), [])
    for field in dict.fromkeys(row["field"] for one in ours[:1] for row in one["rows"]):
        text += table(task, field) + curve(task, field)
(out / "table.md").write_text("\n".join(text))
print("\n".join(text))
