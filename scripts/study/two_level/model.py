"""Two-level model of docs/model.md in PyTorch: frames N packed from windows, characters C=42, codes 0..n-1 (n=360).

A batch is packed: `b` (N, C) codes as told (targets), `x` (N, C) codes as seen (noisy or the same), `seg` (N) window, `pos` (N)
frame of its window. Places 0..2 are clamped (root x y z), 3..41 angles."""
import math
import torch
from torch import nn
from torch.nn import functional as F

C, n, K = 42, 360, 3  # characters, bins, clamped places (the first ones)
MISS = n


def lin(i, o, sd=0.02):
    l = nn.Linear(i, o)
    nn.init.normal_(l.weight, 0, sd), nn.init.zeros_(l.bias)
    return l


def table(*s, sd=0.02):
    return nn.Parameter(sd * torch.randn(*s))


class Block(nn.Module):
    def __init__(s, d, heads, layers):
        super().__init__()
        r = 0.02 / math.sqrt(2 * layers)
        s.h, s.n1, s.n2 = heads, nn.LayerNorm(d), nn.LayerNorm(d)
        s.qkv, s.out, s.up, s.down = lin(d, 3 * d), lin(d, d, r), lin(d, 4 * d), lin(4 * d, d, r)

    def heads(s, x):
        B, T, D = x.shape
        return s.qkv(s.n1(x)).view(B, T, 3, s.h, D // s.h).permute(2, 0, 3, 1, 4)  # 3 x (B, H, T, d)

    def close(s, x, a):
        x = x + s.out(a.transpose(1, 2).reshape(x.shape))
        return x + s.down(F.gelu(s.up(s.n2(x)), approximate="tanh"))

    def forward(s, x, mask=None, causal=False):
        q, k, v = s.heads(x)
        return s.close(x, F.scaled_dot_product_attention(q, k, v, attn_mask=mask, is_causal=causal))


def diff(a, b):
    """Rows of the table of steps (..., C) -> circular 0..n-1, clamped n..n+2n-2; codes a, b (..., C) without missing."""
    d = a - b
    return torch.cat([d[..., :K] + (n - 1) + n, d[..., K:] % n], -1)


STEPS = n + 2 * n - 1  # 1079: rows of circular, then clamped steps; 1079 = missing / begin; abs codes behind in D


class TwoLevel(nn.Module):
    def __init__(s, frames=128, d=256, layers=6, heads=8, e=24, dd=128, dlayers=3, dheads=4, L=1, track=False,
                 kd=192, klayers=3, kheads=6, ahead=64, per_place=False, four=0, steps=False, nxt=False):
        super().__init__()
        s.frames, s.L, s.ahead, s.dd, s.per_place = frames, L, ahead, dd, per_place
        s.E, s.W1, s.W2, s.P = table(C, n + 1, e), lin(C * e, d), lin(C * e, d), table(frames, d)
        s.trunk = nn.ModuleList(Block(d, heads, layers) for _ in range(layers))
        s.norm, s.U = nn.LayerNorm(d), lin(d, dd)
        p = C if per_place else 1
        s.A, s.B, s.D = table(p, n + 1, dd), table(p, STEPS + 1, dd), table(p, STEPS + 1 + n, dd)
        s.place = table(C, dd)
        s.four = four
        if four:  # smooth beginnings of the tables: Fourier features of the angle / of the step, mapped; learned beside
            a = torch.arange(n) * 2 * math.pi / n
            k = torch.arange(1, four + 1)
            s.register_buffer("phi", torch.cat([torch.cat([torch.cos(a[:, None] * k), torch.sin(a[:, None] * k)], 1),
                                                torch.zeros(1, 2 * four)]), persistent=False)
            s.EM, s.AM = table(C, 2 * four, e, sd=0.02), table(C, 2 * four, dd, sd=0.02)
        s.dec = nn.ModuleList(Block(dd, dheads, dlayers) for _ in range(dlayers))
        s.dnorm = nn.LayerNorm(dd)
        s.Hc, s.Hl, s.Ha = table(n, dd), table(2 * n - 1, dd), table(n, dd)
        s.bc, s.bl, s.ba = (nn.Parameter(torch.zeros(*z)) for z in [(C - K, n), (K, 2 * n - 1), (C, n)])
        if L > 1:
            s.band = nn.ParameterList(nn.Parameter(torch.zeros(dheads, L)) for _ in range(dlayers))
        s.track = track
        s.nxt = nxt
        if nxt:  # from the frame before to the next given frame of the place, and how far that is
            s.N, s.Nd = table(1, STEPS + 1, dd), table(16, dd)
        if track:
            s.steps = steps
            if steps:
                s.T2 = table(C, STEPS + 1, e)  # steps of given characters
            s.T, s.G, s.Q = table(C, n + 1, e), lin(C * e, kd), table(frames + ahead, kd)
            s.tr = nn.ModuleList(Block(kd, kheads, klayers) for _ in range(klayers))
            s.tn, s.ts, s.td = nn.LayerNorm(kd), lin(kd, d), lin(kd, dd)

    # ---- parts
    def rows(s, T, code):  # (N, C) codes of per-place tables (C, n+1, e) -> (N, C, e)
        off = torch.arange(C) * T.shape[1]
        return F.embedding(code + off, T.flatten(0, 1))

    def emb(s, code):
        x = s.rows(s.E, code)
        if s.four:
            x = x + torch.einsum("nck,cke->nce", s.phi[code], s.EM)
        return x.flatten(1)

    def look(s, T, idx):
        return s.rows(T, idx) if s.per_place else F.embedding(idx, T[0])

    def trunk_in(s, p1, p2, pos):
        return s.W1(s.emb(p1)) + s.W2(s.emb(p2)) + s.P[pos]

    def dec_in(s, x, p1, p2, h, df):
        """Decoder inputs (N, C, dd): characters as seen x, one and two frames before (n: missing), trunk (N, d), track."""
        first, second = (p1[:, 0] == MISS)[:, None], (p2[:, 0] == MISS)[:, None]
        y = torch.where(first, 0, p1)
        step = torch.where(first, STEPS + 1 + x, diff(x, y))
        step = F.pad(step[:, :-1], (1, 0), value=STEPS)
        vel = torch.where(second, STEPS, diff(y, torch.where(second, 0, p2)))
        a = s.look(s.A, p1)
        if s.four:
            a = a + torch.einsum("nck,cke->nce", s.phi[p1], s.AM)
        z = s.look(s.D, step) + s.place + a + s.look(s.B, vel)
        u = s.U(h) if df is None else s.U(h) + df
        return z + u[:, None]

    def track_out(s, codes, seg, pos):
        """codes (M, C): given or n; packed rows of windows and what lies ahead -> (M, kd)."""
        x = s.rows(s.T, codes)
        if s.steps:
            y = F.pad(codes, (0, 0, 1, 0), value=MISS)[:-1]
            ok = (codes != MISS) & (y != MISS) & (pos > 0)[:, None]
            x = x + s.rows(s.T2, torch.where(ok, diff(codes, torch.where(ok, y, codes)), STEPS))
        x = s.G(x.flatten(1)) + s.Q[pos]
        same = (seg[:, None] == seg[None])[None, None]
        x = x[None]
        for b in s.tr:
            x = b(x, same)
        return s.tn(x[0])

    def band_mask(s, pos):
        """0 or -inf (N, 1, C, L C): keys go from L-1 frames back to this one; frames before the window are out."""
        L = s.L
        m = torch.zeros(len(pos), 1, C, L, C)
        m[:, :, :, L - 1] = torch.full((C, C), -torch.inf).triu(1)
        for l in range(1, L):
            m[pos < l, :, :, L - 1 - l] = -torch.inf
        return m.flatten(3)

    def decode(s, z, pos, keep=None):
        """z (N, C, dd), frames in the order of their windows -> (N, C, dd); `keep` collects k, v of the last L-1 frames."""
        mask = s.band_mask(pos) if s.L > 1 else None
        for i, b in enumerate(s.dec):
            if s.L == 1:
                z = b(z, causal=True)
                continue
            q, k, v = b.heads(z)  # (N, H, C, d)
            shift = lambda t, l: F.pad(t, (0, 0, 0, 0, 0, 0, l, 0))[: len(t)]
            K_, V_ = (torch.cat([shift(t, l) for l in range(s.L - 1, 0, -1)] + [t], 2) for t in (k, v))
            w = (q / math.sqrt(q.shape[-1])) @ K_.transpose(-1, -2) + mask + s.band[i].flip(1).repeat_interleave(C, 1)[None, :, None]
            a = torch.softmax(w, -1) @ V_
            z = b.close(z, a)
            if keep is not None:
                keep.append((k, v))
        return s.dnorm(z)

    def logits(s, y, p1):
        """Relative logits: clamped (N, K, 2n-1) with what is out of range masked, circular (N, C-K, n)."""
        l = y[:, :K] @ s.Hl.T + s.bl
        v = p1[:, :K, None].clamp(max=n - 1) + torch.arange(2 * n - 1) - (n - 1)
        return l.masked_fill((v < 0) | (v >= n), -torch.inf), y[:, K:] @ s.Hc.T + s.bc

    def hidden(s, x, seg, pos, track=None):
        """Packed codes as seen -> decoder's y (N, C, dd), p1 (N, C)."""
        up = lambda l: torch.where((pos >= l)[:, None], F.pad(x, (0, 0, l, 0))[: len(x)], MISS)
        p1, p2 = up(1), up(2)
        h = s.trunk_in(p1, p2, pos)
        df = None
        if track is not None:
            o = s.track_out(*track[:3])[track[3]]
            h, df = h + track[4] * s.ts(o), track[4] * s.td(o)
        ok = (seg[:, None] == seg[None]) & torch.ones(len(x), len(x), dtype=torch.bool).tril()
        h = h[None]
        for b in s.trunk:
            h = b(h, ok[None, None])
        z = s.dec_in(x, p1, p2, s.norm(h[0]), df)
        if s.nxt and track is not None:
            code, far = track[5], track[6]  # (N, C) or MISS; (N) frames
            ok = (code != MISS) & (p1 != MISS)
            y = torch.where(ok, p1, 0)
            z = z + ok[..., None] * (F.embedding(diff(torch.where(ok, code, 0), y), s.N[0]) + s.Nd[(2 * far.float().clamp(min=1).log2()).long().clamp(max=15)][:, None])
        return s.decode(z, pos), p1

    def nats(s, b, x, seg, pos, track=None):
        """-ln p (N, C) of every character."""
        y, p1 = s.hidden(x, seg, pos, track)
        l, c = s.logits(y, p1)
        q = torch.where(p1 == MISS, 0, p1)
        tl = (b[:, :K] - q[:, :K] + n - 1)
        tc = (b[:, K:] - q[:, K:]) % n
        first = (pos == 0).nonzero()[:, 0]
        ce = lambda l, t: F.cross_entropy(l.flatten(0, 1).float(), t.flatten(), reduction="none").view(t.shape)
        l = l.index_fill(0, first, 0.0)
        out = torch.cat([ce(l, tl), ce(c, tc)], 1)
        return out.index_copy(0, first, ce(y[first] @ s.Ha.T + s.ba, b[first]))

    @torch.no_grad()
    def count_init(s, clips):
        """Biases of the heads begin at ln of the add-half counts of steps and first codes."""
        st = torch.cat([c[1:] - c[:-1] for c in clips])
        for k in range(C):
            if k < K:
                h = torch.bincount(st[:, k] + n - 1, minlength=2 * n - 1).float() + 0.5
                s.bl[k] = (h / h.sum()).log()
            else:
                h = torch.bincount(st[:, k] % n, minlength=n).float() + 0.5
                s.bc[k - K] = (h / h.sum()).log()
            h = torch.bincount(torch.cat([c[::16, k] for c in clips]), minlength=n).float() + 0.5
            s.ba[k] = (h / h.sum()).log()

    def groups(s, decay):
        mats = [p for m in s.modules() if isinstance(m, nn.Linear) for p in [m.weight]] + [s.Hc, s.Hl, s.Ha]
        ids = {id(p) for p in mats}
        return [{"params": mats, "weight_decay": decay},
                {"params": [p for p in s.parameters() if id(p) not in ids], "weight_decay": 0.0}]
