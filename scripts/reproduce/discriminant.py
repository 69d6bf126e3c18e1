#!/usr/bin/env python3
"""How long the windows of the clip's discriminant should be: discriminant.py CORPUS, bandai-2 as classification.sh leaves it in OUT/held-out.

Each style of the train split in turn is left out: a discriminant is fitted to the train clips of the others, each also in a mirror,
and names the content of that style's train and validation clips. The styles of the test split are read only for the last column.
Features and classifier as in docs/classification.md; needs numpy and scikit-learn.
"""
import json
import sys
from pathlib import Path

import numpy as np
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

SIDES = {1: 2, 4: 5, 7: 8, 10: 11, 13: 14, 16: 17, 18: 19, 20: 21, 22: 23}  # SMPL's
SIDES |= {b: a for a, b in SIDES.items()}

folder = Path(sys.argv[1])
manifest = json.loads((folder / "corpus.json").read_text())
about = json.loads((folder / "tokenizer.json").read_text())["decoder"]["kinelm"]
joints, scheme, fps = about["config"]["joints"], about["fitted"]["translation"], about["config"]["fps"]
tokens = np.fromfile(folder / "tokens.u16", "<u2").astype(float)
clips = [json.loads(line) for line in (folder / "clips.jsonl").read_text().splitlines()]
swapped = [joints.index(SIDES.get(j, j)) for j in joints]


def motion(clip):
    """The root's steps (F, 3) in metres a second and the joints' rotation vectors (F, J, 3)."""
    words = tokens[clip["offset"] : clip["offset"] + clip["tokens"]].reshape(-1, manifest["tokens_per_word"]) - 6
    steps = np.stack([(words[:, i] - s["zero"]) * s["width"] * fps for i, s in enumerate(scheme)], 1)
    angles = np.unwrap((words[:, 3:-1] - 180) * np.pi / 180, axis=0)
    return steps, angles.reshape(len(words), -1, 3)


for each in clips:
    each["motion"] = motion(each)


def features(steps, angles, size):
    """Of each window of `size` frames, half of that apart."""
    channels = np.concatenate([angles.reshape(len(steps), -1), steps], 1)
    last = max(0, len(channels) - size)
    windows = [channels[at : at + size] for at in [*range(0, last, max(1, size // 2)), last]]
    moved = lambda w: np.abs(np.diff(w, axis=0)).mean(0) if len(w) > 1 else 0 * w[0]
    return [np.stack([w.mean(0), w.std(0), moved(w)], 1).ravel() for w in windows]


def right(train, asked, size):
    """How many of the clips `asked` are named right by a discriminant of the clips `train`."""
    rows, names = [], []
    for clip in train:
        (steps, angles), name = clip["motion"], clip["labels"]["content"]
        other = "-".join({"left": "right", "right": "left"}.get(word, word) for word in name.split("-"))
        mirrored = steps * [-1, 1, 1], angles[:, swapped] * [1, -1, -1]
        for seen, class_ in [((steps, angles), name), (mirrored, other)]:
            found = features(*seen, size)
            rows += found
            names += [class_] * len(found)
    lda = LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto")
    model = make_pipeline(StandardScaler(), PCA(64, random_state=0), lda).fit(rows, names)
    log_p = lambda clip: model.predict_log_proba(features(*clip["motion"], size)).clip(-50).sum(0)
    return sum(model.classes_[log_p(clip).argmax()] == clip["labels"]["content"] for clip in asked)


train = [c for c in clips if c["split"] == "train"]
known = [c for c in clips if c["split"] != "test"]
test = [c for c in clips if c["split"] == "test"]
styles = sorted({c["labels"]["style"] for c in train})
print(f"| seconds | {' | '.join(styles)} | all | test |\n|{'---|' * (len(styles) + 3)}")
for size in [11, 22, 25, 27, 30, 33, 36, 40, 50]:
    cells, hits, all_asked = [], 0, 0
    for style in styles:
        asked = [c for c in known if c["labels"]["style"] == style]
        found = right([c for c in train if c["labels"]["style"] != style], asked, size)
        cells, hits, all_asked = cells + [f"{100 * found / len(asked):.1f}"], hits + found, all_asked + len(asked)
    cells += [f"{100 * hits / all_asked:.1f}", f"{100 * right(train, test, size) / len(test):.1f}"]
    print(f"| {size / fps:.1f} | {' | '.join(cells)} |", flush=True)
