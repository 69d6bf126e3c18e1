"""Training files, and what is asked for on the command line over them."""
import math
import tomllib
from pathlib import Path

import numpy as np

import windows
from model import config_of

TRAIN = {  # the defaults of [train]
    "batch": 8, "accumulate": 1, "steps": 1000, "learning_rate": 2e-4, "schedule": "cosine", "warmup": 100,
    "final_share": 0.1, "betas": [0.9, 0.95], "epsilon": 1e-8, "weight_decay": 0.1, "clip_norm": 1.0, "seed": 1,
    "eval_every": 250, "eval_windows": 128, "checkpoint_every": 250, "keep": 2, "patience": 0, "ema": 0.0,
    "conditions": [], "label_dropout": 0.1, "loss": "cross_entropy", "ordinal_width": 0.75, "sample_every": 0,
    "precision": "f32", "table_rate": 1.0, "gaps": 0.0, "stages": [],
}


def settings(o, model):
    """[train] and [model] of the file: unknown keys are refused, [model] has to be the beginning's unless it is fresh."""
    path = Path(o.config)
    file = tomllib.loads(path.read_text())
    for key in file.get("train", {}):
        if key not in TRAIN:
            raise SystemExit(f"{path}: [train] has `{key}`; expected one of {', '.join(TRAIN)}")
    if any(file.get("augment", {}).values()):
        found = f"{path}: [augment] is on; only `kinelm pretrain` augments"
        raise SystemExit(f"{found}: switch it off or train there (docs/cluster.md tells how to train on mirrored clips)")
    train = TRAIN | file.get("train", {})
    train |= {key: value for key, value in [("steps", o.steps), ("seed", o.seed)] if value is not None}
    if sorted(train["conditions"]) != sorted(model.conditions):
        raise SystemExit(f"{path}: conditions {train['conditions']}; {o.begin} was made with {model.conditions}")
    if train["gaps"]:
        raise SystemExit(f"{path}: train.gaps; only `kinelm pretrain` and `finetune` teach goal conditioning: leave it out")
    if "model" in file:
        try:
            config = config_of(file["model"]).resolved(model.tokens)
        except ValueError as e:
            raise SystemExit(f"{path}: {e}")
        alike = {**vars(config), "dropout": 0} == {**vars(model.config), "dropout": 0}
        if not alike and not o.fresh:
            found = f"{path}: [model] is another than that of {o.begin}"
            raise SystemExit(f"{found}; give --fresh to begin with its own weights")
        model.config = config
    parts = [weighted(text) for text in o.corpus or []]
    if not parts:
        asked = file.get("corpora", []) or ([{"path": file["corpus"]}] if "corpus" in file else [])
        parts = [(path.parent / c["path"], c.get("weight", 1.0)) for c in asked]
    if not parts:
        raise SystemExit("no corpus; give one by --corpus or in the training file")
    return train, [(windows.Corpus(folder), weight) for folder, weight in parts]


def weighted(text):
    """A folder, or FOLDER=WEIGHT."""
    folder, sign, weight = text.rpartition("=")
    try:
        return (folder, float(weight)) if sign else (text, 1.0)
    except ValueError:
        return text, 1.0


def rate(train, step):
    """The learning rate of the update behind `step` others."""
    most, warmup = train["learning_rate"], train["warmup"]
    if step < warmup:
        return most * (step + 1) / warmup
    if train["schedule"] == "constant":
        return most
    done = min((step - warmup) / max(train["steps"] - warmup - 1, 1), 1.0)
    return most * (train["final_share"] + (1 - train["final_share"]) * 0.5 * (1 + math.cos(math.pi * done)))


def read_order(path, train):
    """(steps, rows, 3): clip, first token, number of tokens."""
    found = np.load(path)
    if not isinstance(found, np.ndarray):
        found = found[found.files[0]]
    wanted = (train["batch"] * train["accumulate"], 3)
    if found.ndim != 3 or found.shape[1:] != wanted or len(found) < train["steps"]:
        raise SystemExit(f"{path}: an order of shape {found.shape}; expected {train['steps']} steps or more of {wanted}")
    return found
