"""Goal ahead: model with zero-beginning goal inputs, gaps, batched sampler, tuning. ahead.py tune NAME kind=.. | gen NAME G.. """
import sys, math, json, time, ast
import numpy as np, torch
from model import *
from model import Block
import train as T
from train import corpus, Sampler, cpu, HERE
from dance import TOK, qmul, qrot, qvec, OFF, PAR, CODED
torch.set_num_threads(1)
W_, Z_ = (np.array([t[k] for t in TOK["fitted"]["translation"]], float) for k in ("width", "zero"))
STEP_PLACES = [0, 2, 3]


def bucket(left): return (2 * left.float().clamp(min=1).log2()).long().clamp(max=15)


class Ahead(TwoLevel):
    def __init__(s, kind=0, **o):
        super().__init__(**o)
        s.kind, d, dd = kind, s.P.shape[1], s.dd
        z = lambda *a: nn.Parameter(torch.zeros(*a))
        if kind >= 1:
            s.g1, s.ft, s.N, s.Nd = z(d, 4 * C), z(16, d), z(STEPS + 1, dd), z(16, dd)
        if kind >= 2: s.r1, s.r2 = z(d, 8), z(dd, 8)
        if kind >= 3: s.S = z(STEPS + 1, dd)

    def goal_in(s, p1, on, code, left, root, need):
        """p1 (N,C); on (N) bool; code (N,C) next given or MISS; left (N) frames from f-1 to it; root (N,8); need (N,3) mean codes needed."""
        on = on & (p1[:, 0] != MISS); y = torch.where(on[:, None], p1, 0)
        g = code.clone(); l = left[:, None].expand(-1, C).clone()
        if s.kind >= 3: g[:, STEP_PLACES] = need.round().long(); g[:, :K] = g[:, :K].clamp(0, n - 1); g[:, 3] %= n; l[:, STEP_PLACES] = 1.0
        ok = on[:, None] & (code != MISS)
        if s.kind >= 3: ok = on[:, None] & ((code != MISS) | torch.tensor([c in STEP_PLACES for c in range(C)]))
        g = torch.where(ok, g, y)
        d = (g - y).float(); d = torch.cat([d[:, :K], (d[:, K:] + n // 2) % n - n // 2], 1)
        a = d * torch.cat([torch.full((K,), 0.01), torch.full((C - K,), 2 * math.pi / n)])
        ft = torch.cat([torch.sin(a), 1 - torch.cos(a), a, 8 * a / l], 1)
        b = bucket(left); o = on[:, None].float()
        t = (ft @ s.g1.T + s.ft[b]) * o
        z = F.embedding(diff(g, y), s.N) * ok[..., None] + (s.Nd[b] * o)[:, None]
        if s.kind >= 3:
            r = (d / l).round().long()
            z = z + F.embedding(torch.cat([r[:, :K] + 2 * n - 1, r[:, K:] % n], 1), s.S) * ok[..., None]
        if s.kind >= 2:
            t = t + (root @ s.r1.T) * o; z = z + ((root @ s.r2.T) * o)[:, None]
        return t, z

    def hidden(s, x, seg, pos, goal=None):
        up = lambda l: torch.where((pos >= l)[:, None], F.pad(x, (0, 0, l, 0))[: len(x)], MISS)
        p1, p2 = up(1), up(2)
        h = s.trunk_in(p1, p2, pos); zg = None
        if goal is not None and s.kind:
            tg, zg = s.goal_in(p1, *goal); h = h + tg
        ok = (seg[:, None] == seg[None]) & torch.ones(len(x), len(x), dtype=torch.bool).tril()
        h = h[None]
        for b in s.trunk: h = b(h, ok[None, None])
        z = s.dec_in(x, p1, p2, s.norm(h[0]), None)
        if zg is not None: z = z + zg
        return s.decode(z, pos), p1


def state(codes):
    """(.., F, 42) -> p (.., F, 3), turn, head (.., F), root tilt quaternion, other 12 quaternions."""
    c = np.asarray(codes); rot = (c[..., 3:].reshape(*c.shape[:-1], 13, 3) - n // 2) * (2 * np.pi / n)
    turn = np.cumsum(rot[..., 0, 0], -1)
    tv = rot[..., 0, :].copy(); tv = np.stack([tv[..., 1], 0 * turn, tv[..., 2]], -1); tilt = qvec(tv)
    f = qrot(tilt, np.broadcast_to(np.array([0, 0, 1.0]), tv.shape)); head = turn + np.arctan2(f[..., 0], f[..., 2])
    st = (c[..., :3] - Z_) * W_
    h = np.concatenate([0 * head[..., :1], head[..., :-1]], -1); co, si = np.cos(h), np.sin(h)
    x = np.cumsum(co * st[..., 0] + si * st[..., 2], -1); z = np.cumsum(-si * st[..., 0] + co * st[..., 2], -1)
    return np.stack([x, st[..., 1] + TOK["fitted"]["first_height"], z], -1), turn, head, tilt, qvec(rot[..., 1:, :])


wrap = lambda a: (a + np.pi) % (2 * np.pi) - np.pi


def numbers(p, turn, head, pe, te, left):
    """What is still to go: from (p, turn, head) of frame f-1 to (pe, te), `left` frames -> root (.., 8), need (.., 3)."""
    D = pe - p; co, si = np.cos(head), np.sin(head)
    lx, lz = co * D[..., 0] - si * D[..., 2], si * D[..., 0] + co * D[..., 2]
    t = wrap(te - turn)
    r = np.stack([lx, lz, np.cos(t), np.sin(t), 1 / left, 10 * lx / left, 10 * lz / left, 10 * t / left], -1)
    need = np.stack([Z_[0] + lx / left / W_[0], Z_[2] + lz / left / W_[2], n // 2 + t / left * (n / 2 / np.pi)], -1)
    return r.astype(np.float32), need.astype(np.float32)


def goal_codes(t, e):
    """(C) next given codes at frame e of t: steps of x, z, heading are known from the frame behind it."""
    g = t[e].clone(); g[STEP_PLACES] = t[e + 1, STEP_PLACES] if e + 1 < len(t) else MISS
    return g


def goal_of(w, a, gaps):
    """Goal of a window w (ahead a) with gaps [(s, e)]."""
    t = torch.cat([w, a]); L = len(w)
    on, code, left = np.zeros(L, bool), torch.full((L, C), MISS), np.ones(L, np.float32)
    root, need = np.zeros((L, 8), np.float32), np.zeros((L, 3), np.float32)
    p, turn, head, _, _ = state(t.numpy())
    for s, e in gaps:
        f = np.arange(s, min(e, L)); l = (e - f + 1).astype(np.float32)
        on[f] = True; code[f] = goal_codes(t, e); left[f] = l
        root[f], need[f] = numbers(p[f - 1], turn[f - 1], head[f - 1], p[e], turn[e], l)
    return torch.from_numpy(on), code, torch.from_numpy(left), torch.from_numpy(root), torch.from_numpy(need)


def draw_gaps(g, L, Tn):
    out, at = [], 0
    while True:
        s = at + int(np.exp(g.uniform(0, np.log(40)))); e = s + int(np.exp(g.uniform(np.log(2), np.log(61))))
        if s >= L or e >= Tn: return out
        out.append((s, e)); at = e


def packg(ws, gl):
    b, x, seg, pos, _ = T.pack(ws)
    off = lambda w: goal_of(*w, [])
    if all(not g for g in gl): return b, x, seg, pos, None
    gs = [goal_of(*w, g) for w, g in zip(ws, gl)]
    return b, x, seg, pos, tuple(torch.cat(z) for z in zip(*gs))


def spots(split="test", want=60, H=64, most=40):
    """[(clip, codes, s)] spread evenly over the clips."""
    cl = corpus("cmu-dance")[split]; cl = [(a, x) for a, x in cl if len(x) >= H + most + 8]
    tot = sum(len(x) - H - most - 4 for _, x in cl); out = []
    for a, x in cl:
        r = len(x) - H - most - 4; k = max(1, round(want * r / tot))
        out += [(a, x, H + int((i + .5) * r / k)) for i in range(k)]
    return out


@torch.no_grad()
def gapbits(m, sp, G, H=64):
    """bits/frame of the gap's frames, all else given; first/last quarter; goal hidden too."""
    m.eval(); r = []
    for _, x, s in sp:
        w, a = x[s - H : s + G + 1], x[s + G + 1 : s + G + 5]
        r.append(m.nats(*packg([(w, a)], [[(H, H + G)] if m.kind else []]))[H : H + G].sum(1) / math.log(2))
    z = torch.stack(r); q = max(1, G // 4); m.train()
    return [round(float(v.mean()), 2) for v in (z, z[:, :q], z[:, -q:])]


class GapGen:
    def __init__(s, m, sp, G, draws, seed=7, H=64, temp=1.0, topp=0.95):
        s.m, s.G, s.H, s.draws, s.temp, s.topp = m, G, H, draws, temp, topp
        s.g = torch.Generator().manual_seed(seed)
        s.x = torch.stack([x[t - H : t + G + 2] for _, x, t in sp])  # truth
        p, turn, head, _, _ = state(s.x.numpy()); e = H + G; rep = lambda a: np.repeat(a, draws, 0)
        s.p, s.turn, s.head = rep(p[:, H - 1]), rep(turn[:, H - 1]), rep(head[:, H - 1]); s.pe, s.te = rep(p[:, e]), rep(turn[:, e])
        s.code = torch.stack([goal_codes(t, e) for t in s.x]).repeat_interleave(draws, 0)

    @torch.no_grad()
    def run(s, pf=0, tau=0.05, guide=0.0, ramp=0):
        m, H, G = s.m, s.H, s.G; m.eval(); hist = s.x[:, :H]; B = len(hist); M = B * s.draws
        pp = F.pad(hist, (0, 0, 2, 0), value=MISS); pos = torch.arange(H)
        h = torch.stack([m.trunk_in(pp[i, 1 : H + 1], pp[i, :H], pos) for i in range(B)])
        kv = []
        for b in m.trunk:
            q, k, v = b.heads(h); h = b.close(h, F.scaled_dot_product_attention(q, k, v, is_causal=True))
            c = torch.empty(2, M, k.shape[1], H + G + 1, k.shape[3]); c[0, :, :, :H] = k.repeat_interleave(s.draws, 0); c[1, :, :, :H] = v.repeat_interleave(s.draws, 0); kv.append(c)
        two = (lambda t: torch.cat([t, t])) if guide else (lambda t: t)
        if guide: kv = [torch.cat([c, c], 1) for c in kv]
        s.out = torch.zeros(M, G + 1, C, dtype=torch.long); p1 = hist[:, -1].repeat_interleave(s.draws, 0); p2 = hist[:, -2].repeat_interleave(s.draws, 0)
        mix = (lambda l: (lambda a, b: b + wg * (a - b))(l[:M].log_softmax(-1), l[M:].log_softmax(-1))) if guide else (lambda l: l)
        for i in range(G + 1):
            f = H + i; wg = guide if not ramp or G - i <= ramp else 1.0
            h = m.trunk_in(two(p1), two(p2), torch.full((M * (2 if guide else 1),), f)); zg = None
            if m.kind and i < G:
                l = np.full(M, G - i + 1, np.float32); r, nd = numbers(s.p, s.turn, s.head, s.pe, s.te, l)
                tw = lambda a: two(torch.from_numpy(a))
                on = torch.ones(len(h), dtype=torch.bool); on[M:] = False
                tg, zg = m.goal_in(two(p1), on, two(s.code), tw(l), tw(r), tw(nd)); h = h + tg
            h = h[:, None]
            for b, c in zip(m.trunk, kv):
                q, k, v = b.heads(h); c[0, :, :, f : f + 1] = k; c[1, :, :, f : f + 1] = v
                h = b.close(h, F.scaled_dot_product_attention(q, c[0, :, :, : f + 1], c[1, :, :, : f + 1]))
            u = m.U(m.norm(h[:, 0]))
            base = m.place + two(F.embedding(p1, m.A[0]) + F.embedding(diff(p1, p2), m.B[0])) + u[:, None]
            if zg is not None: base = base + zg
            x = torch.zeros(M, C, dtype=torch.long); dc = [torch.empty(2, len(h), b.h, C, m.dd // b.h) for b in m.dec]; row = torch.full((M,), STEPS)
            for c in range(C):
                z = (base[:, c] + two(F.embedding(row, m.D[0])))[:, None]
                for b, ca in zip(m.dec, dc):
                    q, k, v = b.heads(z); ca[0, :, :, c : c + 1] = k; ca[1, :, :, c : c + 1] = v
                    z = b.close(z, F.scaled_dot_product_attention(q, ca[0, :, :, : c + 1], ca[1, :, :, : c + 1]))
                y = m.dnorm(z[:, 0])
                if c < K:
                    l = mix(y @ m.Hl.T + m.bl[c]); v = p1[:, c, None] + torch.arange(2 * n - 1) - (n - 1); l = l.masked_fill((v < 0) | (v >= n), -torch.inf)
                else: l = mix(y @ m.Hc.T + m.bc[c - K])
                q, o = torch.softmax(l / s.temp, -1).sort(-1, descending=True); cs = q.cumsum(-1)
                last = ((cs - q) < s.topp).sum(-1, keepdim=True) - 1
                r = torch.rand(M, 1, generator=s.g) * cs.gather(1, last)
                d = o.gather(1, torch.minimum(torch.searchsorted(cs, r), last))[:, 0]
                if c < K: x[:, c] = p1[:, c] + d - (n - 1); row = d + n
                else: x[:, c] = (p1[:, c] + d) % n; row = d
            s.out[:, i] = x; s.step(x); p2, p1 = p1, x
            if pf and i < G - 1 and (i + 1) % pf == 0:
                w = -s.dist(p1, G - i) ; w = w.reshape(B, s.draws); w = np.exp((w - w.max(1, keepdims=True)) / tau); w /= w.sum(1, keepdims=True)
                rn = torch.rand(B, generator=s.g).numpy(); idx = np.stack([np.searchsorted(np.cumsum(w[k]), (np.arange(s.draws) + rn[k]) / s.draws).clip(max=s.draws - 1) for k in range(B)])
                idx = (idx + np.arange(B)[:, None] * s.draws).ravel(); ti = torch.from_numpy(idx)
                for c in kv: c[:, :, :, H : f + 1] = c[:, ti, :, H : f + 1]
                s.out, p1, p2 = s.out[ti], p1[ti], p2[ti]; s.p, s.turn, s.head = s.p[idx], s.turn[idx], s.head[idx]
        return s.out.view(B, s.draws, G + 1, C)

    def step(s, x):
        c = x.numpy(); st = (c[:, :3] - Z_) * W_; rot = (c[:, 3:6] - n // 2) * (2 * np.pi / n); co, si = np.cos(s.head), np.sin(s.head)
        s.p = np.stack([s.p[:, 0] + co * st[:, 0] + si * st[:, 2], st[:, 1] + TOK["fitted"]["first_height"], s.p[:, 2] - si * st[:, 0] + co * st[:, 2]], -1)
        s.turn = s.turn + rot[:, 0]; tilt = qvec(np.stack([rot[:, 1], 0 * rot[:, 0], rot[:, 2]], -1))
        f = qrot(tilt, np.broadcast_to(np.array([0, 0, 1.0]), (len(c), 3))); s.head = s.turn + np.arctan2(f[:, 0], f[:, 2])

    def dist(s, p1, left):
        """Speed still needed (a frame): mean joint angle (code differences), root distance and turn, over the frames left."""
        d = ((s.code[:, 6:] - p1[:, 6:] + n // 2) % n - n // 2).numpy() * (2 * np.pi / n); d = np.linalg.norm(d.reshape(len(d), 12, 3), axis=-1).mean(1)
        return (d + np.linalg.norm((s.pe - s.p)[:, [0, 2]], axis=-1) + np.abs(wrap(s.te - s.turn))) / left


def load(name):
    z = torch.load(HERE / "r" / name / "model.pt"); o = dict(z["options"]["model"]); k = o.pop("kind", 0)
    m = Ahead(kind=k, **o); m.load_state_dict(z["model"]); return m.eval()


def tune(name, **kw):
    o = dict(kind=1, seconds=300, lr=3e-4, nlr=3.0, tlr=3.0, warm=0.05, final=0.05, decay=0.1, seed=2, init="base", p=0.5, grow=((.6, 64, 64), (1.1, 128, 128)), share=0.6, quick=0) | kw
    out = HERE / "r" / name; out.mkdir(parents=True, exist_ok=True); torch.manual_seed(o["seed"])
    sets = {s: corpus(s) for s in ("cmu-dance", "bandai-1", "bandai-2")}
    m = Ahead(kind=o["kind"], dlayers=2); new = m.load_state_dict(torch.load(HERE / "r" / o["init"] / "model.pt")["model"], strict=False); assert not new.unexpected_keys
    sam = Sampler(sets, o["share"], o["seed"]); g = np.random.default_rng(o["seed"] + 1000)
    tab = {id(p): o["tlr"] for p in (m.E, m.A, m.B, m.D, m.P, m.place)} | {id(p): o["nlr"] for k, p in m.named_parameters() if k in new.missing_keys}
    mats = {id(q) for q in m.groups(0)[0]["params"]}
    gs = {}
    for k, p in m.named_parameters():
        key = (tab.get(id(p), 1.0), o["decay"] if id(p) in mats else 0.0); gs.setdefault(key, []).append(p)
    opt = torch.optim.AdamW([{"params": v, "weight_decay": k[1], "k": k[0]} for k, v in gs.items()], lr=o["lr"], betas=(0.9, 0.95), fused=True)
    print(name, o, "new", new.missing_keys, flush=True); start, step, L = cpu(), 0, []
    while (t := (cpu() - start) / o["seconds"]) < 1:
        lr = o["lr"] * min(t / o["warm"], 1) * (o["final"] + (1 - o["final"]) * 0.5 * (1 + math.cos(math.pi * t)))
        for gr in opt.param_groups: gr["lr"] = max(lr, 1e-6) * gr["k"]
        most, frames = next(x[1:] for x in o["grow"] if t < x[0])
        ws = sam.windows(frames, most, m.ahead)
        gl = [draw_gaps(g, len(w), len(w) + len(a)) if m.kind and g.random() < o["p"] else [] for w, a in ws]
        loss = m.nats(*packg(ws, gl)).mean(); loss.backward()
        torch.nn.utils.clip_grad_norm_(m.parameters(), 1.0); opt.step(); opt.zero_grad(set_to_none=True); step += 1; L.append(float(loss.detach()))
        if step % 200 == 0: print(step, f"{t * o['seconds']:.0f} s", f"{np.mean(L[-200:]) * C / math.log(2):.2f}", flush=True)
    torch.save({"model": m.state_dict(), "options": {"model": {"dlayers": 2, "kind": o["kind"]}, **o}}, out / "model.pt")
    report(m, name, step, "valid" if o["quick"] else "test", out)


def report(m, name, step, split, out):
    sp = spots(split); r = {"name": name, "steps": step, "split": split, "plain": T.bits(m, corpus("cmu-dance")[split]) if split == "test" else None}
    for G in (10, 20, 40): r[f"gap{G}"] = gapbits(m, sp, G)
    (out / f"{split}.json").write_text(json.dumps(r)); print(json.dumps(r), flush=True)


def gen(name, draws, Gs, tag="", **kw):
    m = load(name); sp = spots()
    run = {k: kw.pop(k) for k in ("pf", "tau", "guide", "ramp") if k in kw}
    for G in Gs:
        t = cpu(); x = GapGen(m, sp, G, draws, **kw).run(**run); np.save(HERE / "r" / name / f"gap{G}{tag}.npy", x.numpy().astype(np.int16)); print(name, G, tag, len(sp), "gaps", draws, "draws", f"{cpu() - t:.0f} CPU s", flush=True)


if __name__ == "__main__":
    kw = {k: ast.literal_eval(v) for k, v in (a.split("=", 1) for a in sys.argv[3:])}
    if sys.argv[1] == "tune": tune(sys.argv[2], **kw)
    if sys.argv[1] == "gen": gen(sys.argv[2], kw.pop("draws", 16), kw.pop("G", (10, 20, 40)), **kw)
    if sys.argv[1] == "report": report(load(sys.argv[2]), sys.argv[2], 0, "test", HERE / "r" / sys.argv[2])
