#!/usr/bin/env python3
"""The same GPT in PyTorch, at its best on a CPU: one JSON line a measurement, with the fields of `kinelm-lab --json`.

    torch_gpt.py train   --config tiny [--batch B --context T] [--compile] [--bf16] [--threads N] [--repeats R]
    torch_gpt.py train   --config two-level       two levels: scripts/cluster/two_level.py, its loss without a logit an id
    torch_gpt.py decode  --config thesis-26m --context 1000 [--streams S]
    torch_gpt.py prefill --config thesis-26m --context 1000

Pre-norm GPT-2 with learned positions, biases and a tied head. Training: fused AdamW, scaled_dot_product_attention, the
gradient's norm clipped at 1, gradients set to None; with --bf16 forward and loss under autocast. Decoding: a KV cache allocated once, inference mode, greedy. Needs
torch and Python 3.11; `run.sh` beside this file makes an environment for it.
"""
import argparse, json, pathlib, statistics, sys, time, tomllib

import torch
from torch import nn
from torch.nn import functional as F

ROOT = pathlib.Path(__file__).resolve().parents[2]
CONFIGS = ROOT / "configs" / "train"
BATCH = {"tiny": 8, "small": 2, "thesis-26m": 1}  # as kinelm-lab train


class Block(nn.Module):
    def __init__(self, width, heads):
        super().__init__()
        self.heads = heads
        self.norm1, self.norm2 = nn.LayerNorm(width), nn.LayerNorm(width)
        self.qkv, self.out = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.up, self.down = nn.Linear(width, 4 * width), nn.Linear(4 * width, width)

    def forward(self, x, cache=None, first=0):
        B, T, D = x.shape
        qkv = self.qkv(self.norm1(x)).view(B, T, 3, self.heads, D // self.heads)
        q, k, v = qkv.permute(2, 0, 3, 1, 4)
        if cache is not None:
            cache[0][:, :, first : first + T], cache[1][:, :, first : first + T] = k, v
            if first:  # a single token sees everything that is cached
                k, v = cache[0][:, :, : first + T], cache[1][:, :, : first + T]
        a = F.scaled_dot_product_attention(q, k, v, is_causal=T > 1)
        x = x + self.out(a.transpose(1, 2).reshape(B, T, D))
        return x + self.down(F.gelu(self.up(self.norm2(x)), approximate="tanh"))


class GPT(nn.Module):
    def __init__(self, layers, heads, width, vocabulary, context):
        super().__init__()
        self.token, self.position = nn.Embedding(vocabulary, width), nn.Embedding(context, width)
        self.blocks = nn.ModuleList(Block(width, heads) for _ in range(layers))
        self.norm = nn.LayerNorm(width)
        for name, p in self.named_parameters():
            if p.dim() == 2:
                residual = name.endswith(("out.weight", "down.weight"))
                nn.init.normal_(p, std=0.02 / (2 * layers) ** 0.5 if residual else 0.02)
            elif name.endswith("bias"):
                nn.init.zeros_(p)

    def embed(self, ids, first=0):
        return self.token(ids) + self.position.weight[first : first + ids.shape[1]]

    def forward(self, ids, targets):
        x = self.embed(ids)
        for block in self.blocks:
            x = block(x)
        logits = F.linear(self.norm(x), self.token.weight)
        return F.cross_entropy(logits.flatten(0, 1), targets.flatten())

    def next(self, ids, caches, first):
        """Logits of what follows the last of `ids`, which stand at `first` and on."""
        x = self.embed(ids, first)
        for block, cache in zip(self.blocks, caches):
            x = block(x, cache, first)
        return F.linear(self.norm(x[:, -1:]), self.token.weight)


class TwoLevels(nn.Module):
    """The tokens are those of `kinelm-lab`: 13 joints, all places of the same bins."""

    def __init__(self, table, vocabulary):
        super().__init__()
        sys.path.insert(0, str(ROOT / "scripts" / "cluster"))
        from model import Tokens, build, config_of

        kind = lambda circular: {"first": 6, "count": vocabulary - 6, "circular": circular}
        places = [{"number": n, "kind": kind(circular)} for n, circular in ((3, False), (39, True))]
        tokens = Tokens(vocabulary, 43, 0, 1, 5, places=places)
        self.model = build(config_of({**table, "dropout": 0.0}), tokens)
        self.context = self.model.config.context

    def forward(self, ids, targets):
        return self.model(ids, targets).mean()


def peak_rss_mb():
    """The most memory this process ever held, 10^6 bytes; not getrusage's, which a process inherits."""
    try:
        lines = open("/proc/self/status").read().splitlines()
    except OSError:
        return None
    return next(int(l.split()[1]) * 1024 // 10**6 for l in lines if l.startswith("VmHWM"))


def seconds(warm_up, repeats, work):
    taken = []
    for turn in range(warm_up + repeats):
        start = time.perf_counter()
        work()
        taken.append(time.perf_counter() - start)
    return taken[warm_up:], taken[0]


def train(model, args, table):
    decays, others = [], []
    for name, p in model.named_parameters():
        (decays if p.dim() == 2 and "block" in name else others).append(p)
    groups = [{"params": decays, "weight_decay": 0.1}, {"params": others, "weight_decay": 0.0}]
    optimizer = torch.optim.AdamW(groups, lr=1e-3, betas=(0.9, 0.95), fused=True)
    loss_of = torch.compile(model) if args.compile else model
    ids = torch.randint(6, args.vocabulary, (args.batch, args.context + 1))
    inputs, targets = ids[:, :-1].contiguous(), ids[:, 1:].contiguous()

    def step():
        with torch.autocast("cpu", torch.bfloat16, enabled=args.bf16):
            loss = loss_of(inputs, targets)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 1.0, foreach=True)
        optimizer.step()
        return loss.item()

    repeats = args.repeats or 10
    return args.batch * args.context, *seconds(3, repeats, step)


def decode(model, args, table):
    heads, size = table["heads"], table["width"] // table["heads"]
    ids = torch.randint(6, args.vocabulary, (args.streams, args.context))
    cache = lambda: torch.zeros(args.streams, heads, args.context, size)
    caches = [(cache(), cache()) for _ in model.blocks]
    # as kinelm-lab decode: a timing is the last tokens of the context, one by one
    steps = min(32, args.context // 2)
    first = args.context - steps
    with torch.inference_mode():
        if args.mode == "prefill":
            work = lambda: model.next(ids, caches, 0).argmax(-1)
            return args.streams * args.context, *seconds(1, args.repeats or 10, work)
        before = model.next(ids[:, :first], caches, 0).argmax(-1)

        def work():
            token = before
            for place in range(first, args.context):
                token = model.next(token, caches, place).argmax(-1)

        return args.streams * steps, *seconds(1, args.repeats or 10, work)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mode", choices=["train", "decode", "prefill"])
    parser.add_argument("--config", default="tiny", help="tiny, small, thesis-26m, or a training TOML")
    parser.add_argument("--batch", type=int)
    parser.add_argument("--context", type=int, help="tokens; the configuration's if not given")
    parser.add_argument("--vocabulary", type=int, default=400)
    parser.add_argument("--streams", type=int, default=1)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--repeats", type=int)
    parser.add_argument("--compile", action="store_true")
    parser.add_argument("--bf16", action="store_true", help="train under autocast to bf16")
    args = parser.parse_args()
    path = pathlib.Path(args.config)
    path = path if path.suffix == ".toml" else CONFIGS / f"{args.config}.toml"
    table = tomllib.loads(path.read_text())["model"]
    args.batch = args.batch or BATCH.get(path.stem, 1)
    if args.threads:
        torch.set_num_threads(args.threads)
    torch.manual_seed(1)
    at_start = peak_rss_mb()
    if table.get("architecture") == "two_level":
        if args.mode != "train" or args.context:
            parser.error("two levels are timed in training, with the window of their configuration")
        model = TwoLevels(table, args.vocabulary)
        args.context = model.context
    else:
        args.context = args.context or table["context"]
        model = GPT(table["layers"], table["heads"], table["width"], args.vocabulary, args.context)
    amount, taken, first = (train if args.mode == "train" else decode)(model, args, table)
    rates = [amount / s for s in taken]
    line = {
        "schema": 1,
        "what": args.mode,
        "config": path.stem,
        "tokens_per_s": round(statistics.median(rates), 3),
        "spread": [round(min(rates), 3), round(max(rates), 3)],
        "peak_rss_mb": peak_rss_mb(),
        "rss_at_start_mb": at_start,
        "threads": torch.get_num_threads(),
        "context": args.context,
        "form": f"torch {torch.__version__}" + (" compiled" if args.compile else "") + (" bf16" if args.bf16 else ""),
        "parameters": sum(p.numel() for p in model.parameters()),
        "first_step_s": round(first, 3),
    }
    line |= {"batch": args.batch} if args.mode == "train" else {"streams": args.streams}
    print(json.dumps(line))


if __name__ == "__main__":
    main()
