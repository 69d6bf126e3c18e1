"""Fill in the middle: the frames after a gap stand before it in the trunk, at their true positions. fim.py tune NAME f=.."""
import sys, ast
from ahead import *


class Fim(Ahead):
    def hidden(s, x, seg, pos, goal=None, back=None):
        # back (N, 2): rows of the frame before and the one before that, -1: missing
        if back is None:
            i = torch.arange(len(x)); back = torch.stack([torch.where(pos >= l, i - l, -1) for l in (1, 2)], 1)
        at = lambda b: torch.where((b >= 0)[:, None], x[b.clamp(min=0)], MISS)
        p1, p2 = at(back[:, 0]), at(back[:, 1])
        h = s.trunk_in(p1, p2, pos); zg = None
        if goal is not None and s.kind:
            tg, zg = s.goal_in(p1, *goal); h = h + tg
        if s.training and s.drop: h = F.dropout(h, s.drop)
        ok = (seg[:, None] == seg[None]) & torch.ones(len(x), len(x), dtype=torch.bool).tril()
        h = h[None]
        for b in s.trunk:
            q, k, v = b.heads(h); a = F.scaled_dot_product_attention(q, k, v, attn_mask=ok[None, None]); dr = lambda t: F.dropout(t, s.drop) if s.training and s.drop else t
            h = h + dr(b.out(a.transpose(1, 2).reshape(h.shape))); h = h + dr(b.down(F.gelu(b.up(b.n2(h)), approximate="tanh")))
        z = s.dec_in(x, p1, p2, s.norm(h[0]), None)
        if zg is not None: z = z + zg
        return s.decode(z, pos), p1

    drop = 0.0

    def nats(s, b, x, seg, pos, goal=None, back=None):
        y, p1 = s.hidden(x, seg, pos, goal, back)
        l, c = s.logits(y, p1); q = torch.where(p1 == MISS, 0, p1)
        tl, tc = (b[:, :K] - q[:, :K] + n - 1).clamp(0, 2 * n - 2), (b[:, K:] - q[:, K:]) % n
        first = (p1[:, 0] == MISS).nonzero()[:, 0]
        ce = lambda l, t: F.cross_entropy(l.flatten(0, 1).float(), t.flatten(), reduction="none").view(t.shape)
        l = l.index_fill(0, first, 0.0)
        out = torch.cat([ce(l, tl), ce(c, tc)], 1)
        return out.index_copy(0, first, ce(y[first] @ s.Ha.T + s.ba, b[first]))


def packf(ws, gl, fl):
    """As packg; fl: None or (s, e) of a gap inside the window that comes last. -> nats arguments and weights (N)."""
    parts, seg, pos, back, goals, m = [], [], [], [], [], 0
    for i, ((w, a), g, f) in enumerate(zip(ws, gl, fl)):
        L = len(w); o = torch.arange(L)
        if f: o = torch.cat([torch.arange(f[0]), torch.arange(f[1], L), torch.arange(*f)])
        row = torch.empty(L, dtype=torch.long); row[o] = torch.arange(L)
        bk = torch.stack([torch.where(o >= k, row[(o - k).clamp(min=0)] + m, -1) for k in (1, 2)], 1)
        if f:
            hid = lambda fr: (fr >= f[0]) & (fr < f[1])
            aft = o >= f[1]
            for k in (1, 2): bk[aft & (o - k < f[1]), k - 1] = -1
        parts.append(w[o]); seg.append(torch.full((L,), i)); pos.append(o); back.append(bk); m += L
        goals.append([t[o] for t in goal_of(w, a, [f] if f else g)])
    b = torch.cat(parts); goal = tuple(torch.cat(z) for z in zip(*goals)) if any(fl) or any(gl) else None
    return b, b, torch.cat(seg), torch.cat(pos), goal, torch.cat(back)


def draw_fim(g, L):
    """A gap inside L frames with at least 8 frames before and 2 after."""
    n_ = int(np.exp(g.uniform(np.log(2), np.log(min(61, L - 12))))); s = int(g.integers(8, L - n_ - 2)); return s, s + n_


@torch.no_grad()
def gapbits_f(m, sp, G, H=64, A=24):
    m.eval(); r = []
    for _, x, t in sp:
        w, a = x[t - H : t + G + A], x[t + G + A : t + G + A + 5]
        z = m.nats(*packf([(w, a)], [[]], [(H, H + G)]))[-G:]
        r.append(z.sum(1) / math.log(2))
    z = torch.stack(r); q = max(1, G // 4); m.train()
    return [round(float(v.mean()), 2) for v in (z, z[:, :q], z[:, -q:])]


def tune(name, **kw):
    o = dict(kind=3, seconds=400, lr=3e-3, nlr=12.0, tlr=12.0, warm=0.05, final=0.05, decay=0.1, seed=2, init="base", p=0.25, f=0.25, drop=0.2, grow=((.6, 64, 64), (1.1, 128, 128)), share=0.6) | kw
    out = HERE / "r" / name; out.mkdir(parents=True, exist_ok=True); torch.manual_seed(o["seed"])
    sets = {s: corpus(s) for s in ("cmu-dance", "bandai-1", "bandai-2")}
    m = Fim(kind=o["kind"], dlayers=2); m.drop = o["drop"]; new = ()
    sam = Sampler(sets, o["share"], o["seed"]); g = np.random.default_rng(o["seed"] + 1000)
    if o["init"]: new = m.load_state_dict(torch.load(HERE / "r" / o["init"] / "model.pt")["model"], strict=False).missing_keys
    else: m.count_init([x for p in sam.parts for x in p])
    tab = {id(p): o["tlr"] for p in (m.E, m.A, m.B, m.D, m.P, m.place)} | {id(p): o["nlr"] for k, p in m.named_parameters() if k in new or k in ("g1", "ft", "N", "Nd", "r1", "r2", "S")}
    mats = {id(q) for q in m.groups(0)[0]["params"]}; gs = {}
    for k, p in m.named_parameters():
        key = (tab.get(id(p), 1.0), o["decay"] if id(p) in mats else 0.0); gs.setdefault(key, []).append(p)
    opt = torch.optim.AdamW([{"params": v, "weight_decay": k[1], "k": k[0]} for k, v in gs.items()], lr=o["lr"], betas=(0.9, 0.99), fused=True)
    print(name, o, flush=True); start, step, Ls = cpu(), 0, []
    while (t := (cpu() - start) / o["seconds"]) < 1:
        lr = o["lr"] * min(t / o["warm"], 1) * (o["final"] + (1 - o["final"]) * 0.5 * (1 + math.cos(math.pi * t)))
        for gr in opt.param_groups: gr["lr"] = max(lr, 1e-6) * gr["k"]
        most, frames = next(x[1:] for x in o["grow"] if t < x[0])
        ws = sam.windows(frames, most, m.ahead); gl, fl = [], []
        for w, a in ws:
            u = g.random(); fim = u < o["f"] and len(w) >= 24
            fl.append(draw_fim(g, len(w)) if fim else None)
            gl.append(draw_gaps(g, len(w), len(w) + len(a)) if not fim and m.kind and u < o["f"] + o["p"] else [])
        loss = m.nats(*packf(ws, gl, fl)).mean(); loss.backward()
        torch.nn.utils.clip_grad_norm_(m.parameters(), 1.0); opt.step(); opt.zero_grad(set_to_none=True); step += 1; Ls.append(float(loss.detach()))
        if step % 200 == 0: print(step, f"{t * o['seconds']:.0f} s", f"{np.mean(Ls[-200:]) * C / math.log(2):.2f}", flush=True)
    torch.save({"model": m.state_dict(), "options": o}, out / "model.pt")
    sp = spots(); r = {"name": name, "steps": step, "plain": T.bits(m, corpus("cmu-dance")["test"])}
    for G in (10, 20, 40): r[f"gap{G}"] = gapbits(m, sp, G) if m.kind else None; r[f"fim{G}"] = gapbits_f(m, sp, G) if o["f"] else None
    (out / "test.json").write_text(json.dumps(r)); print(json.dumps(r), flush=True)


if __name__ == "__main__":
    kw = {k: ast.literal_eval(v) for k, v in (a.split("=", 1) for a in sys.argv[3:])}
    {"tune": tune}[sys.argv[1]](sys.argv[2], **kw)
