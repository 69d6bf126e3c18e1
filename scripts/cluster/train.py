"""Trains kinelm's model with PyTorch on one or many processes, on the corpus folder and training file that kinelm takes.

    torchrun --nproc-per-node 8 scripts/cluster/train.py --config FILE --from BEGIN --corpus CORPUS --out OUT --bf16
    accelerate launch --num-processes 8 scripts/cluster/train.py ...        the same: both set the same variables
    python scripts/cluster/train.py ...                                     one process

BEGIN is a folder that `kinelm export --format kinelm` wrote, or a run (of `kinelm pretrain --steps 0` for a new one): it has
the tokenizer, the labels and the first weights. OUT becomes such a folder too, for `kinelm import`; with `--resume` a run goes
on from OUT's last checkpoint. Windows, their order, labels hidden, masks, positions and losses are kinelm's; of the training
file `[augment]` and `sample_every` are left to kinelm, and dropout draws other numbers.
"""
import argparse
import contextlib
import json
import math
import os
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import torch
import torch.distributed as dist
from torch.nn.parallel import DistributedDataParallel

import streams
import windows
from folder import Checkpoints, Model, weights_of
from model import Config, Gpt

TRAIN = {  # the defaults of [train]
    "batch": 8, "accumulate": 1, "steps": 1000, "learning_rate": 2e-4, "schedule": "cosine", "warmup": 100, "final_share": 0.1,
    "betas": [0.9, 0.95], "epsilon": 1e-8, "weight_decay": 0.1, "clip_norm": 1.0, "seed": 1, "eval_every": 250,
    "eval_windows": 128, "checkpoint_every": 250, "keep": 2, "patience": 0, "ema": 0.0, "conditions": [], "label_dropout": 0.1,
    "loss": "cross_entropy", "ordinal_width": 0.75, "sample_every": 0,
}


def options():
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--config", required=True, help="the training TOML")
    p.add_argument("--from", dest="begin", required=True, help="an exported folder or a run: tokenizer, labels, first weights")
    p.add_argument("--corpus", help="the corpus folder, over the file's")
    p.add_argument("--out", required=True, help="the folder to make")
    p.add_argument("--fresh", action="store_true", help="first weights of [model] and the seed, not those of --from")
    p.add_argument("--steps", type=int, help="steps in all, over the file's")
    p.add_argument("--seed", type=int, help="over the file's")
    p.add_argument("--order", help="windows in the order that `kinelm corpus order` wrote (.npy or .npz)")
    p.add_argument("--micro", type=int, default=0, help="windows that a process holds at a time; 0: all of its own")
    p.add_argument("--resume", action="store_true", help="go on from the last checkpoint in --out")
    p.add_argument("--bf16", action="store_true", help="compute in bfloat16 where that is safe; weights stay f32")
    p.add_argument("--device", choices=["auto", "cpu", "cuda"], default="auto")
    p.add_argument("--threads", type=int, default=0, help="of a process on the CPU; 0: its share of the cores")
    p.add_argument("--hf", help="also write a GPT2LMHeadModel folder here, where GPT-2 can express the model")
    return p.parse_args()


def main():
    o = options()
    place = Place(o)
    try:
        Trainer(o, place).train()
    finally:
        place.leave()


class Place:
    """Which process this is, and where it computes; torchrun and accelerate set the variables."""

    def __init__(self, o):
        self.rank, self.world, local = (int(os.environ.get(n, d)) for n, d in [("RANK", 0), ("WORLD_SIZE", 1), ("LOCAL_RANK", 0)])
        cuda = o.device == "cuda" or (o.device == "auto" and torch.cuda.is_available())
        self.device = torch.device("cuda", local) if cuda else torch.device("cpu")
        if cuda:
            torch.cuda.set_device(self.device)
        else:
            near = int(os.environ.get("LOCAL_WORLD_SIZE", self.world))
            torch.set_num_threads(o.threads or max(1, (os.cpu_count() or 1) // near))
        if self.world > 1:
            dist.init_process_group("nccl" if cuda else "gloo", device_id=self.device if cuda else None)

    def sum(self, *numbers):
        """Sums over all processes."""
        t = torch.tensor(numbers, dtype=torch.float64, device=self.device)
        if self.world > 1:
            dist.all_reduce(t)
        return t.tolist()

    def leave(self):
        if dist.is_initialized():
            dist.destroy_process_group()


def settings(o, model):
    """[train] and [model] of the file: unknown keys are refused, [model] has to be the beginning's unless it is fresh."""
    path = Path(o.config)
    file = tomllib.loads(path.read_text())
    for table, known in [("train", TRAIN), ("model", Config.__dataclass_fields__)]:
        for key in file.get(table, {}):
            if key not in known:
                raise SystemExit(f"{path}: [{table}] has `{key}`; expected one of {', '.join(known)}")
    if any(file.get("augment", {}).values()):
        raise SystemExit(f"{path}: [augment] is on; only `kinelm pretrain` augments: switch it off or train there")
    train = TRAIN | file.get("train", {})
    train |= {key: value for key, value in [("steps", o.steps), ("seed", o.seed)] if value is not None}
    if sorted(train["conditions"]) != sorted(model.conditions):
        raise SystemExit(f"{path}: conditions {train['conditions']}; {o.begin} was made with {model.conditions}")
    if "model" in file:
        config = Config(**file["model"]).resolved(model.tokens)
        alike = {**vars(config), "dropout": 0} == {**vars(model.config), "dropout": 0}
        if not alike and not o.fresh:
            raise SystemExit(f"{path}: [model] is another than that of {o.begin}; give --fresh to begin with its own weights")
        model.config = config
    corpus = o.corpus or (file.get("corpus") and path.parent / file["corpus"])
    if not corpus:
        raise SystemExit("no corpus; give one by --corpus or in the training file")
    return train, windows.Corpus(corpus)


def rate(train, step):
    """The learning rate of the update behind `step` others."""
    most, warmup = train["learning_rate"], train["warmup"]
    if step < warmup:
        return most * (step + 1) / warmup
    if train["schedule"] == "constant":
        return most
    done = min((step - warmup) / max(train["steps"] - warmup - 1, 1), 1.0)
    return most * (train["final_share"] + (1 - train["final_share"]) * 0.5 * (1 + math.cos(math.pi * done)))


class Trainer:
    def __init__(self, o, place):
        self.o, self.place, self.about = o, place, Model.read(o.begin)
        self.train_keys, self.corpus = settings(o, self.about)
        t = self.train_keys
        own = json.loads(self.about.tokenizer)
        if self.corpus.manifest["vocabulary"] != len(own["model"]["vocab"]) - len(own["decoder"]["kinelm"]["conditioning"]):
            raise SystemExit(f"{self.corpus.folder} was made with another tokenizer than {o.begin}")
        self.conditions = windows.Conditions(self.about.conditions, own)
        order = read_order(o.order, t) if o.order else None
        self.windows = windows.Windows(self.corpus, self.conditions, self.about.config, self.about.tokens, t, order)
        if self.windows.rows < place.world:
            raise SystemExit(f"{self.windows.rows} windows a step for {place.world} processes; expected one each at least")
        self.model = self.first().to(place.device)
        self.optimizer = torch.optim.AdamW(self.model.groups(t["weight_decay"]), lr=0.0, betas=tuple(t["betas"]), eps=t["epsilon"])
        self.checkpoints, self.out = Checkpoints(o.out), Path(o.out)
        self.state = {"step": 0, "tokens": 0, "best": None, "since_best": 0, "seed": t["seed"]}
        self.average = {n: p.detach().clone() for n, p in self.model.named_parameters()} if t["ema"] else None
        self.begin()
        gpu = [place.device.index] if place.device.type == "cuda" else None
        self.shared = DistributedDataParallel(self.model, device_ids=gpu) if place.world > 1 else self.model

    def first(self):
        """The model before its first step: that of --from, or with --fresh the one `kinelm pretrain` would begin with."""
        if not self.o.fresh:
            return self.about.build()
        model = Gpt(self.about.config, self.about.tokens)
        with torch.no_grad():
            for name, p in model.named_parameters():
                if p.dim() == 2:
                    residual = name.endswith(("attention.out.weight", "mlp.down.weight"))
                    sd = 0.02 / math.sqrt(2 * self.about.config.layers) if residual else 0.02
                    p.copy_(torch.from_numpy(streams.normal(self.train_keys["seed"], name, p.numel(), sd)).view_as(p))
        return model

    def begin(self):
        """A new folder, or where the last checkpoint stands."""
        steps = self.checkpoints.steps()
        if not self.o.resume:
            if steps:
                raise SystemExit(f"{self.out} has checkpoints; go on with --resume, or give another --out")
            self.out.mkdir(parents=True, exist_ok=True)
            return
        if not steps:
            raise SystemExit(f"{self.out} has no checkpoint to go on from")
        weights, moments, state = self.checkpoints.read(steps[-1])
        if state["seed"] != self.train_keys["seed"]:
            raise SystemExit(f"seed {self.train_keys['seed']}; the run was begun with {state['seed']}")
        self.model.load_state_dict(weights)
        for name, p in self.model.named_parameters():
            self.optimizer.state[p] = {"step": torch.tensor(float(state["step"])),
                                       "exp_avg": moments[f"first.{name}"].to(p.device), "exp_avg_sq": moments[f"second.{name}"].to(p.device)}
            if self.average:
                self.average[name] = moments[f"ema.{name}"].to(p.device)
        self.state = state

    def train(self):
        t, state = self.train_keys, self.state
        every = lambda n: n > 0 and state["step"] % n == 0
        while state["step"] < t["steps"]:
            self.step()
            last, best = state["step"] == t["steps"], False
            if last or every(t["eval_every"]):
                best = self.measure()
                last |= 0 < t["patience"] <= state["since_best"]
            if best or last or every(t["checkpoint_every"]):
                self.save()
            if last:
                break
        if self.place.rank == 0:
            final = self.averaged()
            self.about.write(self.out, final, state["step"])
            if self.o.hf:
                self.about.write_hf(self.o.hf, final, state["step"])
            print(f"{self.out}: {state['step']} steps and {state['tokens']} tokens in all", file=sys.stderr)

    def step(self):
        """One update, by the mean over all targets of all processes that count."""
        t, place, begun, step = self.train_keys, self.place, time.time(), self.state["step"]
        pad = self.about.tokens.pad
        inputs, targets = (torch.from_numpy(x) for x in self.windows.batch(step, range(place.rank, self.windows.rows, place.world)))
        (counted,) = place.sum(int((targets != pad).sum()))
        self.model.train()
        torch.manual_seed(int(streams.u64s(t["seed"], "dropout of a process", step, 1, place.rank)[0]) >> 1)
        size = self.o.micro or len(inputs)
        pieces = list(zip(inputs.split(size), targets.split(size)))
        self.optimizer.zero_grad(set_to_none=True)
        nats, wrong = 0.0, 0
        for i, (x, y) in enumerate(pieces):
            x, y = x.to(place.device), y.to(place.device)
            # gradients are added up here, and averaged over processes with the last piece
            alone = self.shared.no_sync() if place.world > 1 and i + 1 < len(pieces) else contextlib.nullcontext()
            with alone:
                with torch.autocast(place.device.type, torch.bfloat16, enabled=self.o.bf16):
                    logits = self.shared(x)
                found = self.model.nats(logits, y)
                goal = self.model.ordinal(logits, y, t["ordinal_width"]) if t["loss"] == "ordinal" else found
                (goal.sum() * (place.world / counted)).backward()
            nats += found.detach().sum()
            wrong += (self.model.uncounted(x) & (y != pad)).sum()
        nats, wrong = place.sum(float(nats), float(wrong))
        if wrong:
            raise SystemExit(f"step {step + 1}: {wrong:.0f} targets are told from a token that is no bin; make them pad")
        norm = float(torch.nn.utils.get_total_norm([p.grad for p in self.model.parameters()]))
        if not math.isfinite(nats) or not math.isfinite(norm):
            rows = self.windows.where(step, range(self.windows.rows))
            clips = ", ".join(f"{self.corpus.clips[c]['name']} from token {first}" for c, first, *_ in rows)
            raise SystemExit(f"step {step + 1}: loss {nats / counted}, gradient's norm {norm} on {clips}; try a lower learning rate")
        if t["clip_norm"]:
            share = min(1.0, t["clip_norm"] / (norm + 1e-6))
            for p in self.model.parameters():
                p.grad.mul_(share)
        for group in self.optimizer.param_groups:
            group["lr"] = rate(t, step)
        self.optimizer.step()
        self.update_average()
        self.state["step"] += 1
        self.state["tokens"] += int(counted)
        loss, per_frame = nats / counted, self.corpus.tokens_per_frame("train") / math.log(2)
        self.log("train", step=step + 1, loss=loss, bits_per_frame=loss * per_frame, rate=rate(t, step), gradient_norm=norm,
                 tokens=self.state["tokens"], tokens_per_second=counted / (time.time() - begun))

    def update_average(self):
        if self.average:
            for name, p in self.model.named_parameters():
                self.average[name].lerp_(p.detach(), 1 - self.train_keys["ema"])

    def averaged(self):
        """The model that is measured and exported: with `ema`, the average's weights."""
        if not self.average:
            return self.model
        model = Gpt(self.about.config, self.about.tokens).to(self.place.device)
        model.load_state_dict(self.average)
        return model

    def measure(self):
        """Bits a frame of the validation clips; whether it was never better."""
        found = likelihood(self.averaged(), self.corpus, self.conditions, self.about, self.train_keys["eval_windows"], self.place)
        if found is None:
            return False
        best = self.state["best"] is None or found["bits_per_frame"] < self.state["best"]["bits_per_frame"]
        self.state["since_best"] = 0 if best else self.state["since_best"] + 1
        if best:
            self.state["best"] = {"step": self.state["step"], "bits_per_frame": found["bits_per_frame"]}
        self.log("valid", step=self.state["step"], **found)
        return best

    def save(self):
        if self.place.rank == 0:
            moments = {}
            for name, p in self.model.named_parameters():
                for kind, theirs in [("first", "exp_avg"), ("second", "exp_avg_sq")]:
                    moments[f"{kind}.{name}"] = self.optimizer.state[p][theirs].cpu()
                if self.average:
                    moments[f"ema.{name}"] = self.average[name].cpu()
            self.checkpoints.write(self.state["step"], self.model, moments, self.state)
            self.checkpoints.prune(self.train_keys["keep"], self.state["best"] and self.state["best"]["step"])

    def log(self, kind, **figures):
        if self.place.rank == 0:
            with open(self.out / "metrics.jsonl", "a") as file:
                file.write(json.dumps({"schema": 1, "kind": kind, **figures}) + "\n")
            if kind == "valid" or figures["step"] % 10 == 0:
                print(kind, " ".join(f"{k} {v:.5g}" for k, v in figures.items()), file=sys.stderr)


@torch.no_grad()
def likelihood(model, corpus, conditions, about, most, place, split="valid"):
    """Bits a frame on a split's clips, as `kinelm evaluate likelihood`; None where there is none. `most` 0: all windows."""
    tokens, config = about.tokens, about.config
    every = [(c, *w) for c in corpus.split(split) for w in windows.eval_windows(corpus.words(c), windows.room(config, tokens))]
    taken = every if not most or most >= len(every) else [every[i * len(every) // most] for i in range(most)]
    if not taken:
        return None
    extra = tokens.front - (0 if config.kind == "masked" else 1)
    length = max(w[2] for w in taken) + extra
    model.eval()
    nats = count = frames = 0
    mine = list(range(place.rank, len(taken), place.world))
    size = max(1, 16384 // length)
    for some in (mine[i : i + size] for i in range(0, len(mine), size)):
        pairs = []
        for number in some:
            clip, start, n, scored = taken[number]
            front, ids = conditions.front(corpus.clips[clip]["labels"], tokens.bos), corpus.ids(clip, start, start + n)
            x, y = windows.causal(ids, front, tokens.pad, length)
            y[: tokens.front - 1 + scored] = tokens.pad
            pairs.append((x, y))
            count += n - scored
            frames += scored_frames(corpus, clip, start + scored, start + n)
        x, y = (torch.from_numpy(np.stack(side)).to(place.device) for side in zip(*pairs))
        nats += float(model.nats(model(x), y).double().sum())
    nats, count, frames = place.sum(nats, count, frames)
    return {"bits_per_frame": nats / math.log(2) / frames, "nats_per_token": nats / count, "tokens": int(count),
            "frames": round(frames), "windows": len(taken), "all_windows": len(every)}


def scored_frames(corpus, clip, first, end):
    """Frames of some tokens; those of a word that is scored in part are shared out over its tokens."""
    words, total = corpus.words(clip), 0.0
    from_word, to_word = np.searchsorted(words, first, "right") - 1, np.searchsorted(words, end, "left")
    for w in range(from_word, to_word):
        share = (min(end, words[w + 1]) - max(first, words[w])) / (words[w + 1] - words[w])
        total += float(corpus.frames(clip, w + 1) - corpus.frames(clip, w)) * share
    return total


def read_order(path, train):
    """(steps, rows, 3): clip, first token, number of tokens."""
    found = np.load(path)
    if not isinstance(found, np.ndarray):
        found = found[found.files[0]]
    wanted = (train["batch"] * train["accumulate"], 3)
    if found.ndim != 3 or found.shape[1:] != wanted or len(found) < train["steps"]:
        raise SystemExit(f"{path}: an order of shape {found.shape}; expected {train['steps']} steps or more of {wanted}")
    return found


if __name__ == "__main__":
    main()
