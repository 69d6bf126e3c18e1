"""Small models of two levels: loss, logits and gradients in f64, in crates/model/tests/golden/two_level.json.

pip install torch safetensors; python scripts/reference/two_level.py
The model is written out here by docs/model.md, "Two levels" and "What is ahead", one window, frame and character after the
other. Weights are formulas, rounded to f32: number i of tensor n (by the order of the names) is 0.2 sin(1.7 i + n), and 1
more in norms' weights. The file has the form that gpt_forms.py tells; cases may have
  told: {"numbers": [N P], "rows": [[N W], [N W]]}, what the N frames are told ahead; 4294967295 adds nothing.
"""
import json
import math
import sys
from pathlib import Path

import torch
from torch.nn import functional as F

sys.path.insert(0, str(Path(__file__).parents[1] / "cluster"))
from model import Tokens, build, config_of  # noqa: E402

PAD, BOS, MASK, UNK, SPACE, NONE = 0, 1, 3, 4, 5, 2**32 - 1
VOCABULARY, LAYERS, HEADS, WIDTH = 29, 2, 2, 12
SPELLS = {"layers": 2, "heads": 2, "width": 8, "character_width": 3}
STRETCHES = [(2, 6, 12, True), (1, 10, 9, False), (1, 18, 7, True), (2, 15, 11, False)]  # number, first id, bins, round
PLACES = [(first, n, goes) for number, first, n, goes in STRETCHES for _ in range(number)]
C, W = len(PLACES), len(PLACES) + 1
ROUND, CLAMPED = (max(n for _, n, goes in PLACES if goes == which) for which in (True, False))
S, R = max(ROUND, CLAMPED), ROUND + 2 * CLAMPED - 1
TOLD = 4 * C + 24
# name, frames of a window, tokens in front, windows, whether frames are told what is ahead
CASES = [("frames", 5, 1, 2, False), ("labels", 4, 3, 2, False), ("ahead", 5, 1, 2, True), ("labels, ahead", 6, 3, 3, True)]


def shapes(frames, front, ahead):
    D, d, e = WIDTH, SPELLS["width"], SPELLS["character_width"]
    all = {"frame.character": (C * (S + 1), e), "frame.position": (frames, D), "spell.last": (R + 1 + S, d),
           "spell.place": (W, d), "spell.character": (S + 1, d), "spell.step": (R + 1, d), "head": (VOCABULARY, d),
           "head.circular": (ROUND, d), "head.clamped": (2 * CLAMPED - 1, d)}
    if front > 1:
        all |= {"frame.label": (VOCABULARY, D), "spell.label": (VOCABULARY, d)}
    if ahead:
        all |= {"ahead.frame": (TOLD, D), "ahead.spell": (TOLD, d), "ahead.step": (R, d), "ahead.pace": (R, d)}
    all = {name + ".weight": shape for name, shape in all.items()}

    def linear(name, i, o):
        all[name + ".weight"], all[name + ".bias"] = (i, o), (o,)

    linear("frame.join", 2 * C * e, D)
    linear("spell.frame", D, d)
    for prefix, layers, width in (("trunk.", LAYERS, D), ("spell.", SPELLS["layers"], d)):
        for block in (f"{prefix}block.{layer:02}." for layer in range(layers)):
            for name, i, o in (("attention.qkv", 1, 3), ("attention.out", 1, 1), ("mlp.up", 1, 4), ("mlp.down", 4, 1)):
                linear(block + name, i * width, o * width)
            all |= {f"{block}norm{n}.{part}": (width,) for n in (1, 2) for part in ("weight", "bias")}
    all |= {f"{norm}.{part}": (width,) for norm, width in (("trunk.norm", D), ("norm", d)) for part in ("weight", "bias")}
    return all


def weights(shapes):
    def tensor(n, name, shape):
        i = torch.arange(math.prod(shape), dtype=torch.float64)
        x = (0.2 * torch.sin(1.7 * i + n)).float().double() + (1 if "norm" in name and name.endswith("weight") else 0)
        return x.view(shape).requires_grad_()

    return {name: tensor(n, name, shape) for n, (name, shape) in enumerate(sorted(shapes.items()))}


def linear(w, name, x):
    return x @ w[name + ".weight"] + w[name + ".bias"]


def norm(w, name, x):
    return F.layer_norm(x, x.shape[-1:], w[name + ".weight"], w[name + ".bias"], 1e-5)


def blocks(w, prefix, layers, heads, x):
    """(T, D) from (T, D): every row sees itself and those before it."""
    T, D = x.shape
    for block in (f"{prefix}block.{layer:02}." for layer in range(layers)):
        q, k, v = linear(w, block + "attention.qkv", norm(w, block + "norm1", x)).view(T, 3, heads, -1).permute(1, 2, 0, 3)
        scores = q @ k.mT / (D // heads) ** 0.5 + torch.full((T, T), -torch.inf, dtype=x.dtype).triu(1)
        x = x + linear(w, block + "attention.out", (scores.softmax(-1) @ v).transpose(0, 1).reshape(T, D))
        x = x + linear(w, block + "mlp.down", F.gelu(linear(w, block + "mlp.up", norm(w, block + "norm2", x)), approximate="tanh"))
    return x


def step(place, d):
    return d % PLACES[place][1] if PLACES[place][2] else ROUND + CLAMPED - 1 + d


def logits(w, ids, front, told):
    """(T, V) of the ids of a window, whose F frames are `told` numbers (F, P) and rows (F, W) and (F, W), or nothing."""
    stream = ids[front - 1 :]
    frames = len(stream) // W

    def bin(frame, place):
        at = 1 + frame * W + place
        if frame < 0 or place >= C or at >= len(stream):
            return None
        b = stream[at] - PLACES[place][0]
        return b if 0 <= b < PLACES[place][1] else None

    def or_missing(b):
        return S if b is None else b

    rows = []
    for f in range(frames):
        seen = [place * (S + 1) + or_missing(bin(f - back, place)) for back in (1, 2) for place in range(C)]
        x = linear(w, "frame.join", w["frame.character.weight"][seen].flatten()) + w["frame.position.weight"][f]
        x = x + sum(w["frame.label.weight"][label] for label in ids[1:front])
        rows.append(x + told[0][f] @ w["ahead.frame.weight"] if told else x)
    trunk = linear(w, "spell.frame", norm(w, "trunk.norm", blocks(w, "trunk.", LAYERS, HEADS, torch.stack(rows))))
    spelt = [torch.zeros(front - 1, SPELLS["width"], dtype=trunk.dtype)]
    for f in range(frames):
        rows = []
        for place in range(W):
            now, then = (bin(f - back, place - 1) if place else None for back in (0, 1))
            last = R if now is None else R + 1 + now if then is None else step(place - 1, now - then)
            a, b = bin(f - 1, place), bin(f - 2, place)
            steps = R if a is None or b is None else step(place, a - b)
            x = trunk[f] + w["spell.last.weight"][last] + w["spell.place.weight"][place]
            x = x + w["spell.character.weight"][or_missing(a)] + w["spell.step.weight"][steps]
            x = x + sum(w["spell.label.weight"][label] for label in ids[1:front])
            if told:
                x = x + told[0][f] @ w["ahead.spell.weight"]
                for name, of_frame in (("step", told[1]), ("pace", told[2])):
                    if of_frame[f][place] != NONE:
                        x = x + w[f"ahead.{name}.weight"][of_frame[f][place]]
            rows.append(x)
        spelt.append(blocks(w, "spell.", SPELLS["layers"], SPELLS["heads"], torch.stack(rows)))
    h = norm(w, "norm", torch.cat(spelt))
    out = []
    for t, x in enumerate(h, 1 - front):
        before = bin(t // W - 1, t % W)
        if t < W or before is None:
            out.append(w["head.weight"] @ x)
            continue
        first, n, goes = PLACES[t % W]
        table = w["head.circular.weight"] if goes else w["head.clamped.weight"]
        row = [(j - before) % n if goes else j - before + CLAMPED - 1 for j in range(n)]
        left, right = (torch.full((n,), -torch.inf, dtype=x.dtype) for n in (first, VOCABULARY - first - n))
        out.append(torch.cat([left, table[row] @ x, right]))
    return torch.stack(out)


def window(frames, front, row, last):
    """Ids and targets; the last window ends a frame and a half early, the second has a place that is dropped."""
    shown = frames * W - (W + W // 2 if row == last else 0)
    word = lambda t: PLACES[t % W][0] + (7 * t + t * t // 5 + 4 * row) % PLACES[t % W][1] if t % W < C else SPACE
    ids = [word(t) for t in range(shown)]
    targets = ids[:]
    if row == 1:
        for t in range(W + 1, shown, W):
            ids[t], targets[t] = MASK, PAD
    padding = [PAD] * (frames * W - shown)
    # labels that differ from window to window; the last has one that is hidden
    ids = [BOS, UNK if row == last else VOCABULARY - 2, VOCABULARY - 1 - row][:front] + ids + padding
    return ids[:-1], [PAD] * (front - 1) + targets + padding


def short(x):
    return None if torch.isinf(x) else float(f"{float(x):.9g}")


def sampled(gradient):
    g = gradient.flatten()
    places = sorted({int(g.abs().argmax()), *range(0, len(g), max(1, len(g) // 5))})
    return {"largest": short(g.abs().max()), "places": places, "numbers": [short(g[i]) for i in places]}


def run(name, frames, front, batch, ahead):
    w = weights(shapes(frames, front, ahead))
    windows = [window(frames, front, row, batch - 1) for row in range(batch)]
    told = [None] * batch
    if ahead:
        # two of three frames are told something
        n = torch.arange(batch * frames * TOLD, dtype=torch.float64)
        numbers = (0.5 * torch.sin(0.3 * n)).float().double().view(batch, frames, TOLD)
        numbers[:, 1::3] = 0
        row = lambda i, f, k: NONE if f % 3 == 1 or k == C or (i + f + k) % 4 == 0 else (5 * f + 3 * k + 7 * i) % R
        tables = [[[[row(i + b, f, k) for k in range(W)] for f in range(frames)] for b in range(batch)] for i in (0, 1)]
        told = list(zip(numbers, *tables))
    found = [logits(w, ids, front, told) for (ids, _), told in zip(windows, told)]
    targets = torch.tensor([t for _, targets in windows for t in targets])
    loss = F.cross_entropy(torch.cat(found), targets, ignore_index=PAD)
    loss.backward()
    T = len(windows[0][0])
    # of the front, of the first frame, of a later one, of a space, of a window's end
    rows = [(b, front - 1 + t) for b in range(batch) for t in (0, 3, W + 2, W + 4, 2 * W - 1, 3 * W)]
    case = {
        "name": name,
        "model": {"architecture": "two_level", "kind": "causal", "layers": LAYERS, "heads": HEADS, "width": WIDTH,
                  "context": T, "positions": "frame_joint", "dropout": 0.0, "tied_head": False, "previous_frame": True,
                  "head": "relative", "window": frames, "decoder": SPELLS, "goal": ahead},
        "tokens": {"vocabulary": VOCABULARY, "word": W, "front": front, "pad": PAD, "bos": BOS, "space": SPACE,
                   "places": [{"number": n, "kind": {"first": f, "count": c, "circular": r}} for n, f, c, r in STRETCHES]},
        "inputs": [ids for ids, _ in windows], "targets": [targets for _, targets in windows],
        "rows": [[b, i, [short(x) for x in found[b][i].detach()]] for b, i in [(0, 0), *rows]],
        "loss": short(loss.detach()), "gradients": {name: sampled(p.grad) for name, p in sorted(w.items())}, "ordinal": None,
    }
    if ahead:
        flat = lambda table: [row for window in table for frame in window for row in frame]
        case["told"] = {"numbers": [short(x) for x in numbers.flatten()], "rows": [flat(table) for table in tables]}
    return case


def clusters(case):
    """How far the model of scripts/cluster is from a case: logits, loss, gradients by a tensor's largest number."""
    model = build(config_of(case["model"]), Tokens(**case["tokens"])).double()
    own = weights({name: p.shape for name, p in model.named_parameters()})
    model.load_state_dict({name: x.detach() for name, x in own.items()})
    inputs, targets = (torch.tensor(case[name]) for name in ("inputs", "targets"))
    logits, loss = model(inputs), model(inputs, targets).sum() / (targets != PAD).sum()
    loss.backward()
    far = [float(loss.detach()) - case["loss"]]
    for b, i, row in case["rows"]:
        found = logits[b, i].detach()
        assert [x is None for x in row] == torch.isinf(found).tolist(), (case["name"], b, i)
        far += [float(x) - y for x, y in zip(found, row) if y is not None]
    for name, p in model.named_parameters():
        wanted, g = case["gradients"][name], p.grad.flatten()
        far += [(float(g[i]) - y) / max(wanted["largest"], 1e-9) for i, y in zip(wanted["places"], wanted["numbers"])]
    return max(map(abs, far))


def main():
    torch.set_num_threads(1)
    made = {"script": "scripts/reference/two_level.py", "versions": {"torch": torch.__version__}, "seed": None}
    golden = made | {"cases": [run(*case) for case in CASES]}
    text = json.dumps(golden, separators=(",", ":")).replace('{"name"', '\n{"name"')
    (Path(__file__).parents[2] / "crates/model/tests/golden/two_level.json").write_text(text + "\n")
    for case in golden["cases"]:
        off = None if case["model"]["goal"] else clusters(case)
        told = "" if off is None else f", scripts/cluster {off:.1e} off"
        print(f"{case['name']}: {sum(t != PAD for w in case['targets'] for t in w)} targets, loss {case['loss']}{told}")
        assert off is None or off < 1e-7


if __name__ == "__main__":
    main()
