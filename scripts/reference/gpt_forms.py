"""Small models of every form: loss, logits and gradients in f64, in crates/model/tests/golden/gpt_forms.json.

pip install torch numpy; python scripts/reference/gpt_forms.py
The model is scripts/cluster/model.py. Weights are formulas as in gpt_shapes.py, rounded to f32: number i of tensor n (by the
order of the names) is 0.2 sin(1.7 i + n), and 1 more in norms' weights. Each of "cases":
  name, model ([model] as resolved, without dropout), tokens (TokenLayout),
  inputs, targets: (batch, T) ids, T may be shorter than the context; pad (0) targets don't count,
  rows: [[b, i, [V logits]], ..], null for minus infinity,
  loss: mean -ln p of the targets that count,
  gradients: of that loss, by tensor: its largest number, places in the flat tensor and the numbers there,
  ordinal: null, or {"width", "gradients"}: those of the mean ordinal loss, whose reported loss is `loss` again.
"""
import json
import sys
from pathlib import Path

import torch

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts/cluster"))
from model import Config, Gpt, Tokens  # noqa: E402

PAD, BOS, MASK, UNK, SPACE = 0, 1, 3, 4, 5
STRETCHES = {  # of bins that share no ids, share some, share all
    "mixed": [(2, 6, 12, True), (1, 10, 9, False), (1, 18, 7, True), (2, 15, 11, False)],
    "circular": [(3, 6, 15, True), (2, 8, 9, True)],
    "clamped": [(1, 6, 8, False), (2, 6, 13, False)],
    "alike": [(2, 6, 16, False), (3, 6, 16, True)],
    "varying": [], "merged": [],
}
WORD = {"varying": 4, "merged": 5} | {name: 1 + sum(s[0] for s in all) for name, all in STRETCHES.items() if all}
# name, kind, positions, previous frame, head, tied, layout, front, (batch, T, context), width of the ordinal loss
CASES = [
    ("plain", "causal", "absolute", False, "absolute", True, "merged", 1, (2, 21, 21), None),
    ("frame_joint behind a front", "causal", "frame_joint", False, "absolute", False, "alike", 3, (2, 27, 31), 0.75),
    ("rope", "causal", "rope", False, "absolute", True, "mixed", 1, (2, 26, 26), 0.75),
    ("rope behind a front", "causal", "rope", False, "absolute", True, "mixed", 3, (1, 26, 26), None),
    ("previous frame", "causal", "absolute", True, "absolute", True, "mixed", 3, (2, 34, 34), None),
    ("previous frame alone in front", "causal", "frame_joint", True, "absolute", False, "alike", 1, (2, 22, 22), None),
    ("relative", "causal", "frame_joint", False, "relative", True, "mixed", 1, (2, 29, 29), 0.75),
    ("relative, untied", "causal", "absolute", False, "relative", False, "alike", 3, (2, 30, 30), 1.1),
    ("previous frame, relative", "causal", "frame_joint", True, "relative", True, "alike", 1, (2, 26, 26), 0.75),
    ("all behind a front", "causal", "rope", True, "relative", False, "mixed", 3, (2, 37, 40), 0.75),
    ("all circular", "causal", "rope", True, "relative", True, "circular", 1, (2, 26, 26), 0.75),
    ("all clamped", "causal", "absolute", True, "relative", True, "clamped", 3, (2, 18, 18), 0.75),
    ("masked", "masked", "absolute", False, "absolute", True, "alike", 1, (2, 25, 25), 0.75),
    ("masked behind a front", "masked", "frame_joint", False, "absolute", False, "mixed", 3, (2, 31, 31), None),
    ("masked rope", "masked", "rope", False, "absolute", True, "mixed", 3, (2, 24, 24), None),
    ("varying behind a front", "causal", "frame_joint", False, "absolute", True, "varying", 3, (2, 19, 19), None),
    ("varying rope", "causal", "rope", False, "absolute", True, "varying", 1, (2, 20, 24), None),
    ("varying masked rope", "masked", "rope", False, "absolute", True, "varying", 3, (2, 22, 22), None),
]


def numbers(count, tensor):
    i = torch.arange(count, dtype=torch.float64)
    return (0.2 * torch.sin(1.7 * i + tensor)).float().double()


def words(tokens, count, row):
    """`count` word tokens of one window, places kept where words have one length."""
    kinds, W = tokens.place_ids(), tokens.word
    if tokens.varying:  # words of 1 to 6 tokens, some longer than the tables know
        ids = [6 + (7 * k + k * k // 3 + 5 * row) % (tokens.vocabulary - 6) for k in range(count)]
        return [SPACE if k % 9 in (1 + row, 3, 8) else id for k, id in enumerate(ids)]
    bins = lambda k: kinds[k % W] if kinds else (6, tokens.vocabulary - 6, False)
    return [SPACE if k % W == W - 1 else bins(k)[0] + (7 * k + k * k // 5 + 4 * row) % bins(k)[1] for k in range(count)]


def window(model, length, row):
    """Inputs and targets of one window; the second has an end and, for causal models, a dropped place."""
    t, K = model.tokens, model.tokens.front
    front = [BOS, UNK, t.vocabulary - 1][:K]
    masked = model.config.kind == "masked"
    room = length - K + (0 if masked else 1)
    shown = room - 4 if row == 1 else room
    ids = words(t, shown, row)
    if masked:
        chosen = [k % 5 == (2 + row) or k == 1 for k in range(shown)]
        seen = [MASK if c and k != 1 else id for k, (c, id) in enumerate(zip(chosen, ids))]
        targets = [PAD] * K + [id if c else PAD for c, id in zip(chosen, ids)]
        return front + seen + [PAD] * (room - shown), targets + [PAD] * (room - shown)
    targets = list(ids)
    if row == 1 and not t.varying:  # as a window with a dropped joint: neither it nor what is told from it counts
        for k in range(t.word + 1, shown, t.word):
            ids[k], targets[k] = MASK, PAD
    pads = [PAD] * (room - shown)
    return (front + ids + pads)[:length], [PAD] * (K - 1) + targets + pads


def sampled(model, loss):
    model.zero_grad()
    loss.backward(retain_graph=True)
    gradients = {}
    for name, p in sorted(model.named_parameters()):
        g = p.grad.flatten()
        places = sorted({int(g.abs().argmax()), *range(0, len(g), max(1, len(g) // 5))})
        numbers = [short(g[i]) for i in places]
        gradients[name] = {"largest": short(g.abs().max()), "places": places, "numbers": numbers}
    return gradients


def short(x):
    return None if torch.isinf(x) else float(f"{float(x):.9g}")


def run(name, kind, positions, previous, head, tied, layout, front, size, width):
    batch, length, context = size
    places = [{"number": n, "kind": {"first": f, "count": c, "circular": r}} for n, f, c, r in STRETCHES[layout]]
    tokens = {"vocabulary": 29, "word": WORD[layout], "varying": layout == "varying", "front": front,
              "pad": PAD, "bos": BOS, "space": SPACE, "places": places}
    shape = {"kind": kind, "layers": 2, "heads": 2, "width": 12, "context": context, "positions": positions,
             "dropout": 0.0, "tied_head": tied, "previous_frame": previous, "head": head}
    model = Gpt(Config(**shape), Tokens(**tokens)).double()
    with torch.no_grad():
        for tensor, (n, p) in enumerate(sorted(model.named_parameters())):
            p.copy_(numbers(p.numel(), tensor).view(p.shape) + (1 if "norm" in n and n.endswith("weight") else 0))
    windows = [window(model, length, row) for row in range(batch)]
    inputs, targets = (torch.tensor([w[i] for w in windows]) for i in (0, 1))
    assert inputs.shape == targets.shape == (batch, length)
    logits, uncounted = model(inputs), model.uncounted(inputs)
    counted = int((targets != PAD).sum())
    loss = model(inputs, targets).sum() / counted
    assert torch.isfinite(loss) and not (uncounted & (targets != PAD)).any()
    W = tokens["word"]
    asked = [i for i in sorted({front - 1, front - 1 + W, front + W, front + 2 * W - 1, length - 1}) if i < length]
    asked = [(b, i) for b in range(batch) for i in asked if not uncounted[b, i]]
    ordinal = None
    if width is not None:
        mean = model.ordinal(logits, targets, width).sum() / counted
        ordinal = {"width": width, "gradients": sampled(model, mean)}
    return {
        "name": name, "model": shape, "tokens": tokens, "inputs": inputs.tolist(), "targets": targets.tolist(),
        "rows": [[b, i, [short(x) for x in logits[b, i].detach()]] for b, i in asked],
        "loss": short(loss.detach()), "gradients": sampled(model, loss), "ordinal": ordinal,
    }


torch.set_num_threads(1)
golden = {
    "script": "scripts/reference/gpt_forms.py",
    "versions": {"torch": torch.__version__},
    "seed": None,
    "cases": [run(*case) for case in CASES],
}
text = json.dumps(golden, separators=(",", ":")).replace('{"name"', '\n{"name"')
(ROOT / "crates/model/tests/golden/gpt_forms.json").write_text(text + "\n")
for c in golden["cases"]:
    print(f"{c['name']}: {sum(t != PAD for w in c['targets'] for t in w)} targets, loss {c['loss']}")
