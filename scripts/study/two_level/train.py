"""Trains a row of the study for CPU seconds and measures it: train.py NAME [key=value ..]; corpora in c/, results in r/NAME."""
import ast, json, math, os, resource, sys, time
from pathlib import Path
import numpy as np
import torch
from model import C, K, MISS, TwoLevel, n
torch.set_num_threads(1)
HERE = Path(__file__).parent
cpu = lambda: (lambda r: r.ru_utime + r.ru_stime)(resource.getrusage(resource.RUSAGE_SELF))


def corpus(name):
    """{split: [(clip, codes (F, 42) int64)]}."""
    f = HERE / "c" / name
    t, out = np.fromfile(f / "tokens.u16", "<u2"), {"train": [], "valid": [], "test": []}
    for l in open(f / "clips.jsonl"):
        c = json.loads(l)
        w = t[c["offset"] : c["offset"] + c["tokens"]].reshape(-1, 43).astype(np.int64)
        assert (w[:, 42] == 5).all() and w[:, :42].min() >= 6
        out[c["split"]].append((c["name"], torch.from_numpy(w[:, :42] - 6)))
    return out


class Sampler:
    def __init__(s, sets, share, seed):
        s.g = np.random.default_rng(seed)
        s.parts = [[x for _, x in sets["cmu-dance"]["train"]], [x for b in ("bandai-1", "bandai-2") for _, x in sets[b]["train"]]]
        s.w = [np.array([len(x) for x in p]) / sum(len(x) for x in p) for p in s.parts]
        s.share = share

    def windows(s, frames, most, ahead):
        """Windows of at most `most` frames that add up to `frames`: [(codes, codes ahead)]."""
        out, left = [], frames
        while left:
            i = 0 if s.g.random() < s.share else 1
            x = s.parts[i][s.g.choice(len(s.w[i]), p=s.w[i])]
            F = min(most, len(x), left)
            a = s.g.integers(len(x) - F + 1)
            out.append((x[a : a + F], x[a + F : a + F + ahead]))
            left -= F
        return out


RIGHT = [0, 1, 2, 3, 4, 5] + [3 + 3 * j + i for j in (8, 10, 12) for i in range(3)]  # root, right arm (17 19 21)


def given_mask(g, kind_p):
    """Given characters (C) bool of a window: none, joints (root with its translation)."""
    if g.random() < kind_p:
        return None
    for _ in range(100):
        m = g.random(13) < g.uniform(0, 0.95)
        if g.random() < 0.1:
            m[:] = False; m[[0, 8, 10, 12]] = True
        if m.any() and not m.all():
            return torch.from_numpy(np.concatenate([[m[0]] * 3, np.repeat(m, 3)]))


def gap_mask(g, w, a):
    """All given but a gap of 2.. frames, log-uniform, of which a frame at least is in the window: (F + ahead, C)."""
    F, T = len(w), len(w) + len(a)
    n_ = int(np.exp(g.uniform(np.log(2), np.log(max(3, min(60, T - 2))))))
    at = int(g.integers(1 - n_, F))
    m = torch.ones(T, C, dtype=torch.bool); m[max(0, at) : at + n_] = False
    return m


def noisy(g, x, sd, given=None):
    d = torch.from_numpy(np.rint(g.normal(0, sd, x.shape)).astype(np.int64))
    if given is not None:
        d[:, given] = 0
    y = x + d
    return torch.cat([y[:, :K].clamp(0, n - 1), y[:, K:] % n], 1)


def pack(ws, givens=None, seen=None):
    b = torch.cat([w for w, _ in ws]); x = b if seen is None else torch.cat(seen)
    seg = torch.cat([torch.full((len(w),), i) for i, (w, _) in enumerate(ws)])
    pos = torch.cat([torch.arange(len(w)) for w, _ in ws])
    track = None
    if givens is not None and any(g is not None for g in givens):
        rows, ts, tp, at, on, m = [], [], [], [], [], 0
        for i, ((w, a), g) in enumerate(zip(ws, givens)):
            t = torch.cat([w, a])
            on.append(torch.full((len(w), 1), float(g is not None)))
            if g is None:  # skips the track
                at.append(torch.zeros(len(w), dtype=torch.long)); continue
            rows.append(torch.where(g if g.dim() == 2 else g[None], t, MISS))
            ts.append(torch.full((len(t),), i)); tp.append(torch.arange(len(t)))
            at.append(torch.arange(m, m + len(w))); m += len(t)
        track = tuple(torch.cat(z) for z in (rows, ts, tp, at, on))
        code, far = torch.full((len(b), C), MISS), torch.zeros(len(b), dtype=torch.long); m = 0
        for (w, a), g in zip(ws, givens):
            if g is not None and g.dim() == 2:
                t, f = torch.cat([w, a]), (~g[:, 0]).nonzero()[:, 0]
                end = int(f[-1]) + 1
                if end < len(t):
                    f = f[f < len(w)]; code[m + f] = t[end]; far[m + f] = end - f
            m += len(w)
        track += (code, far)
    return b, x, seg, pos, track


def eval_windows(F, most):
    """(start, end, first scored) of a clip: windows of `most`, half a window further each, the last ends with the clip."""
    s = done = 0
    while done < F:
        e = min(F, s + most)
        yield s, e, done
        done = e
        s = min(s + most // 2, max(0, F - most))


@torch.no_grad()
def bits(model, clips, given=None, use_track=True, most=None):
    """Exact bits/frame of the clips; with `given`, of the free characters. -> dict"""
    model.eval()
    most = most or model.frames
    tot, cnt, early, nearly, first, causal = 0.0, 0, 0.0, 0, 0.0, 0.0
    rfree = torch.ones(C, dtype=torch.bool); rfree[RIGHT] = False
    free = torch.ones(C, dtype=torch.bool) if given is None else ~given
    for _, x in clips:
        for s, e, d in eval_windows(len(x), most):
            w = [(x[s:e], x[e : e + model.ahead])]
            nat = model.nats(*pack(w, [given] if given is not None and use_track else None))[d - s :]
            causal += float(nat[:, rfree].double().sum()); nat = nat[:, free].sum(1).double()
            tot += float(nat.sum()); cnt += len(nat)
            if s == 0:
                m = min(64, len(nat)); early += float(nat[:m].sum()); nearly += m; first += float(nat[0])
    model.train()
    l2 = math.log(2)
    return {"bits": tot / l2 / cnt, "frames": cnt, "frames0_63": early / l2 / nearly, "rest": (tot - early) / l2 / max(1, cnt - nearly),
            "frame0": first / l2 / len(clips), "free_root_right_arm": causal / l2 / cnt}


def main():
    name = sys.argv[1]
    o = dict(seconds=480, lr=1e-3, warm=0.05, final=0.05, decay=0.1, seed=1, share=0.6, step=128, grow=0, most=128, noise=0.0,
             noise_share=0.7, off=1.0, none=0.45, count_init=1, ema=0.0, model={}, quick=0, tlr=1.0, tsd=0.02, init="", gap=0.0)
    for a in sys.argv[2:]:
        k, v = a.split("=", 1)
        v = ast.literal_eval(v)
        if k.startswith("m."): o["model"][k[2:]] = v
        else: assert k in o, k; o[k] = v
    out = HERE / "r" / name; out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(o["seed"]); torch.set_float32_matmul_precision("highest")
    sets = {s: corpus(s) for s in ("cmu-dance", "bandai-1", "bandai-2")}
    model = TwoLevel(**o["model"])
    sam = Sampler(sets, o["share"], o["seed"]); g = np.random.default_rng(o["seed"] + 1000)
    if o["init"]:
        new = model.load_state_dict(torch.load(HERE / "r" / o["init"] / "model.pt")["model"], strict=False); print(len(new.missing_keys), "new tensors"); assert not new.unexpected_keys
    elif o["count_init"]:
        model.count_init([x for p in sam.parts for x in p])
    tables = [model.E, model.A, model.B, model.D, model.P, model.place]
    with torch.no_grad():
        for p in tables if not o["init"] else []: p.mul_(o["tsd"] / 0.02)
    gs = model.groups(o["decay"]); ids = {id(p) for p in tables}
    for gr in gs: gr["k"] = 1.0
    gs[1]["params"] = [p for p in gs[1]["params"] if id(p) not in ids]; gs.append({"params": tables, "weight_decay": 0.0, "k": o["tlr"]})
    opt = torch.optim.AdamW(gs, lr=o["lr"], betas=(0.9, 0.95), fused=True)
    params = sum(p.numel() for p in model.parameters())
    print(name, o, f"{params / 1e6:.2f} M", flush=True)
    start, wall, step, losses, spent, nextm, total = cpu(), time.time(), 0, [], 0.0, 0.5, 0
    log = open(out / "log.jsonl", "w")
    while True:
        t = (cpu() - start - spent) / o["seconds"]
        if t >= 1: break
        lr = o["lr"] * min(t / o["warm"], 1) * (o["final"] + (1 - o["final"]) * 0.5 * (1 + math.cos(math.pi * t)))
        for gr in opt.param_groups: gr["lr"] = max(lr, 1e-6) * gr["k"]
        most = o["most"]
        frames = o["step"]
        if o["grow"]:  # (until this share of the time, longest window, frames a step), ..
            most, frames = next(g[1:] for g in o["grow"] if t < g[0])
        ws = sam.windows(frames, most, model.ahead); total += frames
        givens = [gap_mask(g, w, a) if g.random() < o["gap"] else given_mask(g, o["none"]) for w, a in ws] if model.track else None
        seen = None
        if o["noise"] and t < o["off"]:
            gv = givens or [None] * len(ws)
            seen = [noisy(g, w, g.uniform(0, o["noise"]), m) if g.random() < o["noise_share"] else w for (w, _), m in zip(ws, gv)]
        nat = model.nats(*pack(ws, givens, seen))
        if givens is not None:
            sc = torch.cat([(torch.ones(C) if m is None else (~(m[: len(w)] if m.dim() == 2 else m)).float()).expand(len(w), C) for (w, _), m in zip(ws, givens)])
            loss = (nat * sc).sum() / sc.sum()
        else:
            loss = nat.mean()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        opt.step(); opt.zero_grad(set_to_none=True)
        step += 1; losses.append(float(loss.detach()))
        if step % 50 == 0:
            m = float(np.mean(losses[-50:])) * C / math.log(2)
            log.write(json.dumps({"step": step, "cpu": t * o["seconds"], "train_bits": m, "lr": lr}) + "\n"); log.flush()
            if step % 200 == 0: print(step, f"{t * o['seconds']:.0f} s", f"{m:.1f}", flush=True)
        if t >= nextm:
            c = cpu(); v = bits(model, sets["cmu-dance"]["valid"]); spent += cpu() - c; nextm += 0.25
            print(f"valid at {t:.2f}: {v['bits']:.2f}", flush=True); log.write(json.dumps({"valid": v, "t": t}) + "\n")
    res = {"name": name, "options": o, "params": params, "steps": step, "frames": total, "cpu": cpu() - start - spent,
           "wall": time.time() - wall, "train_bits_last100": float(np.mean(losses[-100:])) * C / math.log(2)}
    torch.save({"model": model.state_dict(), "options": o}, out / "model.pt")
    te = sets["cmu-dance"]["test"]
    res["test"] = bits(model, te)
    if not o["quick"]: res["bandai2"] = bits(model, sets["bandai-2"]["test"][::12])
    gm = torch.zeros(C, dtype=torch.bool); gm[RIGHT] = True
    if o["quick"]: print(name, res["steps"], res["test"]); return
    res["free_no_track"] = res["test"]["free_root_right_arm"]
    if model.track: res["free_track"] = bits(model, te, gm, True)["bits"]
    (out / "result.json").write_text(json.dumps(res, indent=1))
    print(json.dumps(res), flush=True)


def load(name):
    z = torch.load(HERE / "r" / name / "model.pt")
    m = TwoLevel(**z["options"]["model"]); m.load_state_dict(z["model"])
    return m.eval()


if __name__ == "__main__":
    main()
