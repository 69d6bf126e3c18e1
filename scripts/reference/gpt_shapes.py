"""Losses and gradients of small GPTs of many shapes and masks in PyTorch, in crates/train/tests/golden/gpt_shapes.json.

pip install torch; python scripts/reference/gpt_shapes.py
Weights, ids and masks are formulas of their place, which the test repeats, so the file holds results only: of every
gradient its largest number and some others.
"""
import json
from pathlib import Path

import torch
from torch.nn import functional as F

PAD = 0
# batch, tokens, layers, heads, width, vocabulary, tied head, mask
CASES = [
    (2, 9, 2, 2, 16, 11, True, "causal"),
    (1, 1, 1, 1, 8, 9, True, "causal"),
    (3, 1, 2, 2, 12, 30, False, "full"),
    (1, 67, 1, 1, 24, 40, True, "causal"),
    (2, 130, 1, 4, 32, 50, False, "causal"),
    (1, 257, 1, 2, 48, 33, True, "causal"),
    (3, 31, 2, 3, 21, 37, True, "full"),
    (2, 50, 1, 2, 20, 23, True, "additive"),
    (1, 100, 2, 5, 40, 70, False, "additive"),
]


def numbers(count, tensor):
    i = torch.arange(count, dtype=torch.float64)
    return (0.2 * torch.sin(1.7 * i + tensor)).float()


def ids(count, step, vocabulary):
    return (1 + (torch.arange(count) * step + 3) % (vocabulary - 1)).long()


def mask_of(kind, T):
    q, k = torch.arange(T)[:, None], torch.arange(T)[None, :]
    if kind == "causal":
        return torch.where(k > q, -torch.inf, 0.0)
    if kind == "full":
        return torch.zeros(T, T)
    # every seventh query sees nothing, some keys are hidden, some only weaker
    mask = torch.where((q * 5 + k * 3) % 4 == 0, -torch.inf, torch.where((q + k) % 3 == 0, -0.7, 0.0))
    return torch.where(q % 7 == 2, -torch.inf, mask)


def attention(qkv, mask, heads):
    B, T, D3 = qkv.shape
    d = D3 // 3 // heads
    q, k, v = qkv.view(B, T, 3, heads, d).permute(2, 0, 3, 1, 4)
    blind = torch.isinf(mask).all(-1, keepdim=True)
    scores = q @ k.transpose(-1, -2) / d**0.5 + torch.where(blind, 0.0, mask)
    weights = torch.where(blind, 0.0, scores.softmax(-1))
    return (weights @ v).transpose(1, 2).reshape(B, T, D3 // 3)


def run(B, T, L, H, D, V, tied, kind):
    shapes = {"token.weight": (V, D), "position.absolute.weight": (max(T, 6), D), "norm.weight": (D,), "norm.bias": (D,)}
    if not tied:
        shapes["head.weight"] = (V, D)
    for l in range(L):
        b = f"block.{l:02}."
        for norm in ["norm1", "norm2"]:
            shapes |= {b + norm + ".weight": (D,), b + norm + ".bias": (D,)}
        for name, i, o in [("attention.qkv", D, 3 * D), ("attention.out", D, D), ("mlp.up", D, 4 * D), ("mlp.down", 4 * D, D)]:
            shapes |= {f"{b}{name}.weight": (i, o), f"{b}{name}.bias": (o,)}
    w = {}
    for tensor, name in enumerate(sorted(shapes)):
        x = numbers(torch.Size(shapes[name]).numel(), tensor).view(shapes[name])
        w[name] = (x + 1 if "norm" in name and name.endswith("weight") else x).requires_grad_()
    inputs, targets = ids(B * T, 7, V).view(B, T), ids(B * T, 5, V)
    targets[2::5] = PAD
    mask = mask_of(kind, T)

    x = w["token.weight"][inputs] + w["position.absolute.weight"][:T]
    norm = lambda x, name: F.layer_norm(x, (D,), w[name + ".weight"], w[name + ".bias"], 1e-5)
    linear = lambda x, name: x @ w[name + ".weight"] + w[name + ".bias"]
    for l in range(L):
        b = f"block.{l:02}."
        x = x + linear(attention(linear(norm(x, b + "norm1"), b + "attention.qkv"), mask, H), b + "attention.out")
        x = x + linear(F.gelu(linear(norm(x, b + "norm2"), b + "mlp.up"), approximate="tanh"), b + "mlp.down")
    logits = norm(x, "norm") @ w["token.weight" if tied else "head.weight"].T
    loss = F.cross_entropy(logits.flatten(0, 1), targets, ignore_index=PAD)
    loss.backward()
    gradients = {}
    for name, p in sorted(w.items()):
        g = p.grad.flatten()
        places = sorted({int(g.abs().argmax()), *range(0, len(g), max(1, len(g) // 6))})
        gradients[name] = {"largest": float(g.abs().max()), "places": places, "numbers": [float(g[i]) for i in places]}
    model = {"batch": B, "tokens": T, "layers": L, "heads": H, "width": D, "vocabulary": V, "tied_head": tied, "mask": kind}
    return {"model": model, "loss": loss.item(), "gradients": gradients}


torch.set_num_threads(1)
golden = {
    "script": "scripts/reference/gpt_shapes.py",
    "versions": {"torch": torch.__version__},
    "seed": None,
    "cases": [run(*case) for case in CASES],
}
path = Path(__file__).resolve().parents[2] / "crates/train/tests/golden/gpt_shapes.json"
path.write_text(json.dumps(golden) + "\n")
