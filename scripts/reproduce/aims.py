#!/usr/bin/env python3
"""The table of a folder that aims.sh filled: aims.py OUT CORPUS LABELS.csv. A mean over dances, and the least and the largest
mean of a take. Genres by the discriminant of conditions.py, of the free joints alone."""
import csv, itertools, json, pathlib, statistics, sys

import numpy as np
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "reference"))
from features import geometric

SMPL = ("pelvis left_hip right_hip spine1 left_knee right_knee spine2 left_ankle right_ankle spine3 left_foot right_foot neck left_collar "
        "right_collar head left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist left_hand right_hand").split()
GIVEN = [0, 14, 17, 19, 21]  # root and right arm, of the 18 joints
# the neutral body's upper arm, shoulders and hips, metres
LENGTHS = (0.26, 0.36, 0.18)

out, corpus = map(pathlib.Path, sys.argv[1:3])
take_of = {row["clip"].split("/")[-1]: row["take"] for row in csv.DictReader(open(sys.argv[3])) if "salsa" in row["clip"]}
take = lambda name: take_of[pathlib.Path(name).stem.split("-")[0]]


def reports(dances):
    found = json.loads((out / f"{dances}.json").read_text())
    return {g["name"]: g for g in found["groups"] if g["name"].endswith(".bvh")}, dict(found["prompted"]), found["joints"]


def places(path):
    """(F, J, 3) where the joints are, and frames a second."""
    file = np.load(path, allow_pickle=True)
    names = [str(name) for name in file["joints"]]
    return file["positions"][:, [names.index(joint) for joint in SMPL]], float(file["fps"])


def shares(path):
    joints, fps = places(path)
    return geometric(joints, *LENGTHS, 1 / fps, False)


def free_places(path):
    """(F, J, 3) where the free joints are about the pelvis; the given root turns them alike."""
    joints, _ = places(path)
    free = [i for i, joint in enumerate(SMPL) if i not in GIVEN and joint != "right_hand"]
    return (joints - joints[:, :1])[:, free]


def apart_cm(one, other):
    frames = min(len(one), len(other))
    return 100 * np.linalg.norm(one[:frames] - other[:frames], axis=2).mean()


def clips(folder):
    told = json.loads((folder / "corpus.json").read_text())
    tokens = np.fromfile(folder / "tokens.u16", "<u2").astype(int)
    for line in (folder / "clips.jsonl").read_text().splitlines():
        clip = json.loads(line)
        yield clip, tokens[clip["offset"] :][: clip["tokens"]].reshape(-1, told["tokens_per_word"])


def features(words, columns, fps=20):
    size, channels = 2 * fps, words[:, columns].astype(float)
    channels = (channels - channels[0] + 180) % 360 - 180 + channels[0]  # no jump at half a turn
    windows = [channels[at : at + size] for at in range(0, len(channels) - size + 1, fps)]
    return [np.concatenate([w.mean(0), w.std(0), np.abs(np.diff(w, axis=0)).mean(0)]) for w in windows]


def by_take(values):
    """The mean over dances, and the range of the takes' means, of (name, value)."""
    takes = {}
    for name, value in values:
        takes.setdefault(take(name), []).append(value)
    means = [statistics.mean(of) for of in takes.values()]
    return f"{statistics.mean(v for _, v in values):.2f} ({min(means):.2f} to {max(means):.2f})"


real, _, joints = reports("real")
real = {pathlib.Path(name).stem: group for name, group in real.items()}
columns = [3 + 3 * joints.index(joint) + c for joint in joints if joint not in GIVEN for c in range(3)]
train = [(features(words, columns), clip) for clip, words in clips(corpus)]
seen = [(window, clip["labels"]["genre"]) for windows, clip in train if clip["split"] == "train" for window in windows]
genre = make_pipeline(StandardScaler(), PCA(64, random_state=0), LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto"))
genre.fit([window for window, _ in seen], [label for _, label in seen])
named = lambda windows: genre.classes_[genre.predict_log_proba(windows).sum(0).argmax()]
share_of = {path.stem: shares(path) for path in sorted((out / "real").glob("*.npz"))}
of_takes = {}
for name, share in share_of.items():
    of_takes.setdefault(take(name), []).append(share)
of_takes = {name: np.mean(all, 0) for name, all in of_takes.items()}
between = np.mean([np.abs(own - np.mean([of_takes[t] for t in of_takes if t != name], 0)).mean() for name, own in of_takes.items()])
salsas = [(named(windows), clip) for windows, clip in train if clip["split"] == "test" and clip["labels"]["genre"] == "salsa"]
print(f"real takes: geometric shares {between:.4f} apart; {sum(g == 'salsa' for g, _ in salsas)} of {len(salsas)} test salsas named salsa")
# shares of frames, by number as scripts/reference/features.py lists them
bent = lambda dances, n: f"{np.mean([shares(p)[n] for p in (out / dances).glob('*.npz')]):.2f} (prompts {np.mean([s[n] for s in share_of.values()]):.2f})"
for dances in ["lock", "off"]:
    groups, prompted, _ = reports(dances)
    of = lambda name: real[pathlib.Path(name).stem.split("-")[0]]
    over = lambda key: [(name, g[key] / of(name)[key]) for name, g in groups.items()]
    together = np.abs(np.mean([shares(p) for p in (out / dances).glob("*.npz")], 0) - np.mean(list(share_of.values()), 0)).mean()
    called = [named(features(words, columns)) for _, words in clips(out / "words" / dances)]
    free = {path.stem: free_places(path) for path in (out / dances).glob("*.npz")}
    from_real = [apart_cm(own, free_places(out / "real" / f"{name.split('-')[0]}.npz")) for name, own in free.items()]
    variations = [apart_cm(free[a], free[b]) for a, b in itertools.combinations(sorted(free), 2) if a.split("-")[0] == b.split("-")[0]]
    rows = {
        "share of steps that slide, over the prompt's": by_take(over("skate_share")),
        "skating, cm/s over the prompt's": by_take(over("skate_cm_s")),
        "frames in the floor, points above the prompt's": by_take([(n, 100 * (g["penetration_share"] - of(n)["penetration_share"])) for n, g in groups.items()]),
        "floating, points above the prompt's": by_take([(n, 100 * (g["floating_share"] - of(n)["floating_share"])) for n, g in groups.items()]),
        "jerk of free joints over the prompt's": by_take([(n, p["free_jitter"]) for n, p in prompted.items()]),
        "dances that stand still in the end": sum(g["world"]["never"] < 1 for g in groups.values()),
        "geometric shares from real, over real takes'": f"{together / between:.2f}",
        "left elbow bent by 70 degrees and more": bent(dances, 7),
        "left upper arm 25 degrees from the trunk": bent(dances, 24),
        "free joints from the real dance's, cm": f"{np.mean(from_real):.2f}",
        "variations apart, cm": f"{np.mean(variations):.2f}",
        "named salsa": f"{called.count('salsa')} of {len(called)}",
    }
    print(f"\n{dances}")
    for what, value in rows.items():
        print(f"  {what:<50} {value}")
