"""Label fidelity: conditions.py CORPUS FIELD DANCES, two corpora of one tokenizer with uniform bins, words of one length.

LDA with Ledoit-Wolf shrinkage on the features of docs/classification.md (mean, sd and mean absolute first difference of every channel,
standardised, PCA to 64) of windows of 2 s, each second; the pelvis's rotation and way are left out, for a dance may face and
go anywhere. A clip's class is that of its summed log-probabilities. Real test clips stand beside.
"""
import json
import sys
from pathlib import Path

import numpy as np
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

corpus, field, dances = Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3])


def clips(folder):
    told = json.loads((folder / "corpus.json").read_text())
    tokens = np.fromfile(folder / "tokens.u16", "<u2").astype(int)
    for line in (folder / "clips.jsonl").read_text().splitlines():
        clip = json.loads(line)
        words = tokens[clip["offset"] : clip["offset"] + clip["tokens"]].reshape(-1, told["tokens_per_word"])
        yield clip, words


def features(words, fps):
    size = 2 * fps
    channels = words[:, 6:-1].astype(float)  # behind the pelvis's way and rotation, before the space
    channels = (channels - channels[0] + 180) % 360 - 180 + channels[0]  # no jump at half a turn
    windows = [channels[at : at + size] for at in range(0, len(channels) - size + 1, fps)]
    return [np.concatenate([w.mean(0), w.std(0), np.abs(np.diff(w, axis=0)).mean(0)]) for w in windows]


fps = 20
train = [(clip, features(words, fps)) for clip, words in clips(corpus)]
seen = [(f, c["labels"][field]) for c, fs in train if c["split"] == "train" for f in fs]
model = make_pipeline(StandardScaler(), PCA(64, random_state=0), LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto"))
model.fit([f for f, _ in seen], [label for _, label in seen])
labels = list(model.classes_)


def named(found):
    return labels[int(model.predict_log_proba(found).sum(0).argmax())]


def interval(hits, n):
    """Wilson's, 95 %."""
    z, p = 1.96, hits / n
    middle, half = p + z * z / (2 * n), z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return [100 * (middle - half) / (1 + z * z / n), 100 * (middle + half) / (1 + z * z / n)]


def row(name, pairs):
    hits = sum(asked == got for asked, got in pairs)
    low, high = interval(hits, len(pairs))
    asked = " | ".join(
        f"{sum(a == label == g for a, g in pairs)} of {sum(a == label for a, _ in pairs)}" for label in labels
    )
    print(f"| {name} | {hits} of {len(pairs)} | {100 * hits / len(pairs):.0f} ({low:.0f} to {high:.0f}) | {asked} |")


print(f"| | as asked | % (95 %) | {' | '.join(labels)} |")
print("|---|---|---|" + "---|" * len(labels))
for split in ["valid", "test"]:
    row(f"real, {split}", [(c["labels"][field], named(fs)) for c, fs in train if c["split"] == split and fs])
made = [(clip["labels"], named(features(words, fps))) for clip, words in clips(dances)]
for key in sorted({(m["kind"], m["guidance"]) for m, _ in made}):
    row(f"{key[0]}, guidance {key[1]}", [(m["label"], got) for m, got in made if (m["kind"], m["guidance"]) == key])
