"""Dances of a model and their measures: dance.py NAME [given]. 13 joints decoded as kinelm does, on its neutral skeleton."""
import json, math, sys, time
from pathlib import Path
import numpy as np
import torch
from model import *
from train import HERE, RIGHT, corpus, load

OFF = {0: (0, 0, 0), 1: (.09, -.08, 0), 2: (-.09, -.08, 0), 3: (0, .12, 0), 4: (0, -.41, 0), 5: (0, -.41, 0), 6: (0, .13, 0), 7: (0, -.42, -.03),
       8: (0, -.42, -.03), 9: (0, .06, 0), 10: (0, -.06, .13), 11: (0, -.06, .13), 12: (0, .21, -.02), 13: (.07, .12, -.01), 14: (-.07, .12, -.01),
       15: (0, .09, .03), 16: (.11, .03, 0), 17: (-.11, .03, 0), 18: (.26, 0, 0), 19: (-.26, 0, 0), 20: (.25, 0, 0), 21: (-.25, 0, 0)}
PAR = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19]
CODED = [0, 1, 2, 4, 5, 7, 8, 16, 17, 18, 19, 20, 21]
TOK = json.load(open(HERE / "c/tok.json"))["decoder"]["kinelm"]


def qmul(a, b):
    w, x, y, z = np.moveaxis(a, -1, 0); W, X, Y, Z = np.moveaxis(b, -1, 0)
    return np.stack([w*W - x*X - y*Y - z*Z, w*X + x*W + y*Z - z*Y, w*Y - x*Z + y*W + z*X, w*Z + x*Y - y*X + z*W], -1)


def qrot(q, v):
    u, w = q[..., 1:], q[..., :1]
    t = 2 * np.cross(u, v)
    return v + w * t + np.cross(u, t)


def qvec(v):
    a = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(a / 2), np.where(a > 1e-9, np.sin(a / 2) / np.maximum(a, 1e-9), 0.5) * v], -1)


def positions(codes):
    """(F, 42) -> joint positions (F, 22, 3), metres."""
    codes = np.asarray(codes); F = len(codes); fit = TOK["fitted"]
    rot = (codes[:, 3:].reshape(F, 13, 3) - n // 2) * (2 * np.pi / n)
    turn = np.cumsum(rot[:, 0, 0])
    ry = np.stack([np.cos(turn / 2), 0 * turn, np.sin(turn / 2), 0 * turn], -1)
    tilt = qvec(np.stack([rot[:, 0, 1], 0 * turn, rot[:, 0, 2]], -1))
    q = np.zeros((F, 22, 4)); q[..., 0] = 1
    mp = np.array(TOK["mean_pose"], float).reshape(-1, 4)
    others = [j for j in range(22) if j not in CODED]
    for j, m in zip(others, mp): q[:, j] = m[[3, 0, 1, 2]]
    q[:, CODED] = qvec(rot); q[:, 0] = qmul(ry, tilt)
    width, zero, offs = (np.array([t[k] for t in fit["translation"]], float) for k in ("width", "zero", "offset"))
    step = (codes[:, :3] - zero) * width
    fwd = qrot(q[:, 0], np.array([0, 0, 1.0])); head = np.arctan2(fwd[:, 0], fwd[:, 2])
    p = np.zeros((F, 3)); x = z = h = 0.0
    for f in range(F):
        c, s = math.cos(h), math.sin(h)
        x += c * step[f, 0] + s * step[f, 2]; z += -s * step[f, 0] + c * step[f, 2]
        p[f] = x, step[f, 1] + TOK["fitted"]["first_height"], z; h = head[f]
    P, G = np.zeros((F, 22, 3)), np.zeros((F, 22, 4))
    for j in range(22):
        if PAR[j] < 0: P[:, j], G[:, j] = p, q[:, j]
        else:
            P[:, j] = P[:, PAR[j]] + qrot(G[:, PAR[j]], np.array(OFF[j], float)); G[:, j] = qmul(G[:, PAR[j]], q[:, j])
    return P


LEGS, NINE, ANK = [4, 5, 7, 8], [0, 4, 5, 7, 8, 18, 19, 20, 21], [7, 8]
FREE_J = [4, 5, 7, 8, 18, 20]  # with root and right arm given: knees, ankles, left elbow, wrist


def energy(P):  # m/s, mean over joints, 0.5 s mean
    e = np.linalg.norm(np.diff(P[:, CODED], axis=0), axis=-1).mean(1) * 20
    return np.convolve(e, np.ones(10) / 10, "valid")


def measures(P, low, thr, joints=NINE):
    """low: height of the real clip's lowest ankle (5th percentile); thr: freezing threshold."""
    v = np.linalg.norm(np.diff(P, axis=0), axis=-1) * 20
    j = np.linalg.norm(np.diff(P[:, joints], 3, axis=0), axis=-1) * 8000
    h = P[:, ANK, 1] < low + 0.05
    both = h[1:] & h[:-1]
    hs = np.linalg.norm(np.diff(P[:, ANK][..., [0, 2]], axis=0), axis=-1) * 2000
    E = energy(P); fr = E < thr
    k = len(fr)
    while k and fr[k - 1]: k -= 1
    u = energy(P[len(P) // 2:])
    return {"freeze": fr.mean(), "ends_frozen": float(len(fr) - k >= 20), "time": k / 20 if len(fr) - k >= 20 else np.inf, "legs": v[:, LEGS].mean(),
            "legs_end": v[-200:, LEGS].mean(), "jerk": j.mean(), "skate": hs[both].mean() if both.any() else np.nan, "low_share": both.mean(),
            "pelvis_min": P[:, 0, 1].min(), "pelvis_max": P[:, 0, 1].max(), "pelvis_1": np.percentile(P[:, 0, 1], 1), "pelvis_99": np.percentile(P[:, 0, 1], 99),
            "under": float((P[:, 0, 1] < 0.6).mean())}


class Gen:
    """M dances side by side. `known` (M, F, C) codes and `mask` (C) of given characters, or None."""

    def __init__(s, m, prompt, total, temp, topp, known=None, mask=None, seed=0, use_track=True):
        s.m, s.x, s.total, s.g = m, prompt.clone(), total, torch.Generator().manual_seed(seed)
        s.temp, s.topp, s.known, s.mask = torch.tensor(temp), torch.tensor(topp), known, mask
        s.use_track = use_track and known is not None and m.track

    @torch.no_grad()
    def begin(s, start):
        """Reads frames start.. anew: trunk caches; with a band the decoder's rows of the last frames."""
        m, M = s.m, len(s.x)
        s.start, w = start, s.x[:, start:]
        s.ts = s.td = None
        if s.use_track:
            end = min(s.total, start + m.frames + m.ahead)
            t = s.known[:, start:end]; t = torch.where(s.mask, t, MISS)
            o = []
            for i in range(M):
                o.append(m.track_out(t[i], torch.zeros(len(t[i])), torch.arange(len(t[i]))))
            o = torch.stack(o); s.ts, s.td = m.ts(o), m.td(o)
        s.cache = [[[], []] for _ in m.trunk]
        f = w.shape[1]
        p = F.pad(w, (0, 0, 2, 0), value=MISS)  # frames -2, -1, 0 .. f-1
        pos = torch.arange(f)
        if f:
            h = torch.stack([m.trunk_in(p[i, 1 : f + 1], p[i, :f], pos) for i in range(M)])
            if s.ts is not None: h = h + s.ts[:, :f]
            for i, b in enumerate(m.trunk):
                q, k, v = b.heads(h)
                s.cache[i] = [k, v]
                h = b.close(h, F.scaled_dot_product_attention(q, k, v, is_causal=True))
            h = m.norm(h)
            if m.L > 1:
                s.keep = [[[], []] for _ in m.dec]
                for i in range(M):
                    kept = []
                    m.decode(m.dec_in(w[i], p[i, 1 : f + 1], p[i, :f], h[i], s.td[i, :f] if s.td is not None else None), pos, kept)
                    for j, (k, v) in enumerate(kept):
                        s.keep[j][0].append(k[-(m.L - 1):]); s.keep[j][1].append(v[-(m.L - 1):])
                s.keep = [[torch.stack(z) for z in kv] for kv in s.keep]  # (M, L-1, H, C, d)

    @torch.no_grad()
    def frame(s, force=None):
        """One more frame; `force` (M, C): takes these and returns their log-probabilities."""
        m, M = s.m, len(s.x)
        f = s.x.shape[1] - s.start
        at = s.x.shape[1]
        p1 = s.x[:, -1]; p2 = s.x[:, -2] if f > 1 else torch.full_like(p1, MISS)
        h = m.trunk_in(p1, p2, torch.full((M,), f))
        if s.ts is not None: h = h + s.ts[:, f]
        h = h[:, None]
        for i, b in enumerate(m.trunk):
            q, k, v = b.heads(h)
            s.cache[i] = [torch.cat([a, z], 2) for a, z in zip(s.cache[i], (k, v))]
            h = b.close(h, F.scaled_dot_product_attention(q, *s.cache[i]))
        u = m.U(m.norm(h[:, 0]))
        if s.td is not None: u = u + s.td[:, f]
        x = torch.zeros(M, C, dtype=torch.long); lp = torch.zeros(M, C)
        caches = [[[], []] for _ in m.dec]
        z0 = None
        base = m.dec_in(x, p1, p2, m.norm(h[:, 0]), s.td[:, f] if s.td is not None else None)  # all but D of this frame's
        for c in range(C):
            if c == 0: z = base[:, 0]
            else:
                full = diff(x, p1)[:, c - 1]
                t = m.D[c if m.per_place else 0]
                t0 = torch.where(torch.tensor(c - 1 < K), (0 - p1[:, c - 1]) + (n - 1) + n, (0 - p1[:, c - 1]) % n)
                z = base[:, c] - t[t0] + t[full]
            z = z[:, None]
            for i, b in enumerate(m.dec):
                q, k, v = b.heads(z)
                caches[i][0].append(k); caches[i][1].append(v)
                k, v = (torch.cat(t, 2) for t in caches[i])
                if m.L > 1:
                    back = torch.tensor([f >= l for l in range(m.L - 1, 0, -1)])
                    bias = m.band[i][:, torch.arange(m.L - 1, 0, -1)]
                    have = s.keep[i][0].shape[1]
                    bias = bias[:, -have:]
                    bias = torch.cat([bias[:, :, None].expand(-1, -1, C).flatten(1), m.band[i][:, :1].expand(-1, c + 1)], 1)
                    fl = lambda t: t.permute(0, 2, 1, 3, 4).flatten(2, 3)
                    k, v = torch.cat([fl(s.keep[i][0]), k], 2), torch.cat([fl(s.keep[i][1]), v], 2)
                    a = torch.softmax(q @ k.transpose(-1, -2) / math.sqrt(q.shape[-1]) + bias[None, :, None], -1) @ v
                else:
                    a = F.scaled_dot_product_attention(q, k, v)
                z = b.close(z, a)
            y = m.dnorm(z[:, 0])
            if c < K:
                l = y @ m.Hl.T + m.bl[c]
                v = p1[:, c, None] + torch.arange(2 * n - 1) - (n - 1)
                l = l.masked_fill((v < 0) | (v >= n), -torch.inf)
            else:
                l = y @ m.Hc.T + m.bc[c - K]
            if force is not None:
                d = force[:, c] - p1[:, c]
                d = d + n - 1 if c < K else d % n
                lp[:, c] = l.log_softmax(-1).gather(1, d[:, None])[:, 0]
                x[:, c] = force[:, c]
            elif s.mask is not None and s.mask[c]:
                x[:, c] = s.known[:, at, c]
            else:
                d = sample(l, s.temp, s.topp, s.g)
                x[:, c] = p1[:, c] + d - (n - 1) if c < K else (p1[:, c] + d) % n
        if m.L > 1:
            for i in range(len(m.dec)):
                for j in (0, 1):
                    s.keep[i][j] = torch.cat([s.keep[i][j], torch.cat(caches[i][j], 2)[:, None]], 1)[:, -(m.L - 1):]
        s.x = torch.cat([s.x, x[:, None]], 1)
        return lp

    def run(s):
        s.begin(0)
        while s.x.shape[1] < s.total:
            if s.x.shape[1] - s.start >= s.m.frames:
                s.begin(s.x.shape[1] - s.m.frames // 2)
            s.frame()
        return s.x


def sample(l, temp, topp, g):
    p = torch.softmax(l / temp[:, None], -1)
    q, i = p.sort(-1, descending=True)
    q = torch.where(q.cumsum(-1) - q < topp[:, None], q, 0.0)
    return i.gather(1, torch.multinomial(q / q.sum(-1, keepdim=True), 1, generator=g))[:, 0]


def real():
    """Held-out salsas and the freezing threshold over training salsas."""
    c = corpus("cmu-dance")
    sal = [(a, x) for a, x in c["test"] if a.startswith("salsa")]
    thr = float(np.percentile(np.concatenate([energy(positions(x)) for a, x in c["train"]]), 1))
    tr = np.concatenate([positions(x)[:, 0, 1] for a, x in c["train"] if a.startswith("salsa")])
    return sal, thr, (float(tr.min()), float(tr.max()))


SETTINGS = [(0.9, 0.95), (0.9, 1.0), (1.0, 0.95), (1.0, 1.0)]


def mean(rows):
    r = {k: float(np.nanmean([x[k] for x in rows])) for k in rows[0] if k != "time"}
    r["pelvis_min"], r["pelvis_max"] = min(x["pelvis_min"] for x in rows), max(x["pelvis_max"] for x in rows)
    r["n"] = len(rows); r["skate_sd"] = float(np.nanstd([x["skate"] for x in rows])); r["jerk_sd"] = float(np.std([x["jerk"] for x in rows]))
    r["legs_sd"] = float(np.std([x["legs"] for x in rows])); return r


def show(name, r):
    return (f"| {name} | {r['n']} | {100 * r['freeze']:.0f} / {100 * r['ends_frozen']:.0f} | {r['legs']:.2f} ±{r['legs_sd']:.2f} (end {r['legs_end']:.2f}) | {r['jerk']:.0f} ±{r['jerk_sd']:.0f} | "
            f"{r['skate']:.0f} ({100 * r['low_share']:.0f} %) | {r['pelvis_1']:.2f}-{r['pelvis_99']:.2f}, {r['pelvis_min']:.2f}-{r['pelvis_max']:.2f} | {100 * r['under']:.1f} |")


def main(name, total=420, draws=1):
    torch.set_num_threads(1)
    m = load(name); sal, thr, pel = real(); t0 = time.time()
    print(f"threshold {thr:.3f} m/s, train salsa pelvis {pel}")
    lows = [np.percentile(positions(x)[:, ANK, 1].min(1), 5) for _, x in sal]
    res = {}
    def group(label, x, idx, joints=NINE):
        rows = [measures(positions(x[i][20:]), lows[k], thr, joints) for i, k in enumerate(idx)]
        res[label] = {**mean(rows), "each": rows}; print(show(label, res[label]), flush=True)
    group("real", [x[:total] for _, x in sal], range(len(sal)))
    jobs = [(k, T, p) for T, p in SETTINGS for k in range(len(sal)) for _ in range(draws)]
    prompt = torch.stack([sal[k][1][:20] for k, _, _ in jobs])
    x = Gen(m, prompt, total, [T for _, T, _ in jobs], [p for _, _, p in jobs], seed=7).run()
    np.save(HERE / "r" / name / "free.npy", x.numpy().astype(np.int16))
    for T, p in SETTINGS:
        s = [i for i, j in enumerate(jobs) if j[1:] == (T, p)]
        group(f"free {T} {p}", x[s], [jobs[i][0] for i in s])
    if len(sys.argv) > 2:
        gm = torch.zeros(C, dtype=torch.bool); gm[RIGHT] = True
        group("real, free joints", [x[:total] for _, x in sal], range(len(sal)), FREE_J)
        jobs = [(k, T, p) for T, p in SETTINGS[:1] + SETTINGS[3:] for k in range(len(sal)) for _ in range(draws)]
        total = min(total, min(len(x) for _, x in sal))
        known = torch.stack([sal[k][1][:total] for k, _, _ in jobs]); prompt = known[:, :20]
        for tr in ([True, False] if m.track else [False]):
            x = Gen(m, prompt, total, [T for _, T, _ in jobs], [p for _, _, p in jobs], known, gm, seed=7, use_track=tr).run()
            for T, p in SETTINGS[:1] + SETTINGS[3:]:
                s = [i for i, j in enumerate(jobs) if j[1:] == (T, p)]
                group(f"given {'track' if tr else 'blind'} {T} {p}", x[s], [jobs[i][0] for i in s], FREE_J)
    (HERE / "r" / name / "dance.json").write_text(json.dumps(res, indent=1))
    print(f"{time.time() - t0:.0f} s")


if __name__ == "__main__":
    main(sys.argv[1])
