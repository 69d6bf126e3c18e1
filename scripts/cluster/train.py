"""Trains kinelm's model with PyTorch on one or many processes, on the corpus folder and training file that kinelm takes.

    torchrun --nproc-per-node 8 scripts/cluster/train.py --config FILE --from BEGIN --corpus CORPUS --out OUT --bf16
    accelerate launch --multi_gpu --num_processes 8 scripts/cluster/train.py ..   the same: it sets the same variables
    python scripts/cluster/train.py ..                                           one process

BEGIN is a folder that `kinelm export --format kinelm` wrote, or a run (of `kinelm pretrain --steps 0` for a new one): it
has the tokenizer, the labels and the first weights. OUT becomes such a folder too, for `kinelm import`; with `--resume` a
run goes on from OUT's last checkpoint. Windows, their order, labels hidden, masks, positions and losses are kinelm's; of
the training file `[augment]`, `sample_every`, goal conditioning and music are left to kinelm, and dropout draws other numbers.
"""
import argparse
import contextlib
import json
import math
import os
import sys
import time
from pathlib import Path

import torch
import torch.distributed as dist
from torch.nn.parallel import DistributedDataParallel

import streams
import windows
from answers import loss
from folder import Checkpoints, Model, write_whole
from measure import likelihood
from model import build
from settings import rate, read_order, settings

def options():
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--config", required=True, help="the training TOML")
    p.add_argument("--from", dest="begin", required=True, help="an exported folder or a run")
    p.add_argument("--corpus", action="append", help="a corpus folder, or FOLDER=WEIGHT; over the file's")
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
        number = lambda name, default: int(os.environ.get(name, default))
        self.rank, self.world, local = number("RANK", 0), number("WORLD_SIZE", 1), number("LOCAL_RANK", 0)
        cuda = o.device == "cuda" or (o.device == "auto" and torch.cuda.is_available())
        self.device = torch.device("cuda", local) if cuda else torch.device("cpu")
        if cuda:
            torch.cuda.set_device(self.device)
        else:
            near = number("LOCAL_WORLD_SIZE", self.world)
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


class Trainer:
    def __init__(self, o, place):
        self.o, self.place, self.about = o, place, Model.read(o.begin)
        self.keys, self.parts = t, _ = settings(o, self.about)
        own = json.loads(self.about.tokenizer)
        ids = len(own["model"]["vocab"]) - len(own["decoder"]["kinelm"]["conditioning"])
        for corpus, _ in self.parts:
            word = None if self.about.tokens.varying else self.about.tokens.word
            if (corpus.manifest["vocabulary"], corpus.word) != (ids, word):
                raise SystemExit(f"{corpus.folder} was made with another tokenizer than {o.begin}")
        frames, tokens = (sum(w * c.count("train", what) for c, w in self.parts) for what in ("frames", "tokens"))
        self.bits = tokens / max(1, frames) / math.log(2)  # bits a frame of a nat a token
        self.conditions = windows.Conditions(self.about.conditions, own)
        order = read_order(o.order, t) if o.order else None
        self.windows = windows.Stages(self.parts, self.conditions, self.about.config, self.about.tokens, t, order)
        if self.windows.fewest < place.world:
            found = f"{self.windows.fewest} windows a step for {place.world} processes"
            raise SystemExit(f"{found}; expected one each at least: raise train.batch, and that of every stage")
        self.model = self.first().to(place.device)
        groups = self.model.groups(t["weight_decay"], t["table_rate"])
        self.optimizer = torch.optim.AdamW(groups, lr=0.0, betas=tuple(t["betas"]), eps=t["epsilon"])
        self.checkpoints, self.out = Checkpoints(o.out), Path(o.out)
        self.state = {"step": 0, "tokens": 0, "best": None, "seed": t["seed"]}
        self.average = {n: p.detach().clone() for n, p in self.model.named_parameters()} if t["ema"] else None
        self.begin()
        gpu = [place.device.index] if place.device.type == "cuda" else None
        self.shared = DistributedDataParallel(self.model, device_ids=gpu) if place.world > 1 else self.model

    def first(self):
        """The model before its first step: that of --from, or with --fresh the one `kinelm pretrain` would begin with."""
        if not self.o.fresh:
            return self.about.build()
        model = build(self.about.config, self.about.tokens)
        # what is forecast belongs to the data
        model.load_state_dict(self.about.forecast(), strict=False)
        with torch.no_grad():
            for name, p in model.named_parameters():
                if p.dim() == 2:
                    sd = model.deviation(name)
                    p.copy_(torch.from_numpy(streams.normal(self.keys["seed"], name, p.numel(), sd)).view_as(p))
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
        if state["seed"] != self.keys["seed"]:
            raise SystemExit(f"seed {self.keys['seed']}; the run was begun with {state['seed']}")
        self.model.load_state_dict(weights)
        for name, p in self.model.named_parameters():
            first, second = (moments[f"{kind}.{name}"].to(p.device) for kind in ("first", "second"))
            step = torch.tensor(float(state["step"]))
            self.optimizer.state[p] = {"step": step, "exp_avg": first, "exp_avg_sq": second}
            if self.average:
                self.average[name] = moments[f"ema.{name}"].to(p.device)
        self.state = state
        if self.place.rank == 0:  # figures of steps that are done again
            lines = (self.out / "metrics.jsonl").read_text().splitlines()
            kept = [line for line in lines if line.endswith("}") and json.loads(line)["step"] <= state["step"]]
            write_whole(self.out / "metrics.jsonl", "".join(line + "\n" for line in kept).encode())

    def train(self):
        t, state = self.keys, self.state
        every = lambda n: n > 0 and state["step"] % n == 0
        while state["step"] < t["steps"]:
            self.step()
            last, best = state["step"] == t["steps"], False
            if last or every(t["eval_every"]):
                best = self.measure()
                last |= 0 < t["patience"] <= self.since_best()
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
        t, place, begun, step = self.keys, self.place, time.time(), self.state["step"]
        pad = self.about.tokens.pad
        now = self.windows.at(step)
        own = range(place.rank, now.rows, place.world)
        inputs, targets = map(torch.from_numpy, now.batch(step, own))
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
                    found = self.shared(x, None if t["loss"] == "ordinal" else y)
                goal = found
                if t["loss"] == "ordinal":
                    found, goal = loss(found, y, pad), self.model.ordinal(found, y, t["ordinal_width"])
                (goal.sum() * (place.world / counted)).backward()
            nats += found.detach().sum()
            wrong += (self.model.uncounted(x) & (y != pad)).sum()
        nats, wrong = place.sum(float(nats), float(wrong))
        if wrong:
            raise SystemExit(f"step {step + 1}: {wrong:.0f} targets a frame behind a token that is no bin")
        norm = float(torch.nn.utils.get_total_norm([p.grad for p in self.model.parameters()]))
        if not math.isfinite(nats) or not math.isfinite(norm):
            rows = now.where(step, range(now.rows))
            clips = ", ".join(f"{c.clips[clip]['name']} from token {first}" for c, clip, first, *_ in rows)
            found = f"step {step + 1}: loss {nats / counted}, gradient's norm {norm}"
            raise SystemExit(f"{found} on {clips}; try a lower learning rate")
        if t["clip_norm"]:
            share = min(1.0, t["clip_norm"] / (norm + 1e-6))
            for p in self.model.parameters():
                p.grad.mul_(share)
        for group in self.optimizer.param_groups:
            group["lr"] = rate(t, step) * group["times"]
        self.optimizer.step()
        self.update_average()
        self.state["step"] += 1
        self.state["tokens"] += int(counted)
        mean = nats / counted
        self.log("train", step=step + 1, loss=mean, bits_per_frame=mean * self.bits, rate=rate(t, step),
                 gradient_norm=norm, tokens=self.state["tokens"], tokens_per_second=counted / (time.time() - begun))

    def update_average(self):
        """The mean of the weights after all updates, each worth `ema` of the next one (crates/train/src/average.rs)."""
        if self.average:
            decay = self.keys["ema"]
            share = (1 - decay) / (1 - decay ** (self.state["step"] + 1))
            for name, p in self.model.named_parameters():
                self.average[name].lerp_(p.detach(), share)

    def averaged(self):
        """The model that is measured and exported: with `ema`, the average's weights."""
        if not self.average:
            return self.model
        model = build(self.about.config, self.about.tokens).to(self.place.device)
        model.load_state_dict({**self.model.state_dict(), **self.average})
        return model

    def measure(self):
        """Bits a frame of the validation clips; whether it was never better."""
        most = self.keys["eval_windows"]
        found = likelihood(self.averaged(), self.parts, self.conditions, self.about, most, self.place)
        if found is None:
            return False
        best = self.state["best"] is None or found["bits_per_frame"] < self.state["best"]["bits_per_frame"]
        if best:
            self.state["best"] = {"step": self.state["step"], "bits_per_frame": found["bits_per_frame"]}
        self.log("valid", step=self.state["step"], **found)
        return best

    def since_best(self):
        """Measurements since the best one."""
        every = max(1, self.keys["eval_every"])
        return self.state["step"] // every - self.state["best"]["step"] // every if self.state["best"] else 0

    def save(self):
        if self.place.rank == 0:
            moments = {}
            for name, p in self.model.named_parameters():
                for kind, theirs in [("first", "exp_avg"), ("second", "exp_avg_sq")]:
                    moments[f"{kind}.{name}"] = self.optimizer.state[p][theirs].cpu()
                if self.average:
                    moments[f"ema.{name}"] = self.average[name].cpu()
            self.checkpoints.write(self.state["step"], self.model, moments, self.state)
            self.checkpoints.prune(self.keys["keep"], self.state["best"] and self.state["best"]["step"])

    def log(self, kind, **figures):
        if self.place.rank == 0:
            with open(self.out / "metrics.jsonl", "a") as file:
                file.write(json.dumps({"schema": 1, "kind": kind, **figures}) + "\n")
            if kind == "valid" or figures["step"] % 10 == 0:
                print(kind, " ".join(f"{k} {v:.5g}" for k, v in figures.items()), file=sys.stderr)


if __name__ == "__main__":
    main()
