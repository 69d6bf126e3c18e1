"""Causality, sums to one, likelihood is the chain rule, generation equals reading."""
import torch
from model import *
torch.manual_seed(0); torch.set_num_threads(1)
import train
for L, tr, four, pp in [(1, False, 0, False), (3, False, 0, False), (1, True, 8, True)]:
    m = TwoLevel(frames=16, d=32, layers=2, heads=2, e=4, dd=16, dlayers=2, dheads=2, L=L, track=tr, kd=24, klayers=1, kheads=2, ahead=4, four=four, per_place=pp, steps=tr)
    for p in m.parameters(): torch.nn.init.normal_(p, 0, 0.3)
    m = m.double()
    ws = [(torch.randint(0, n, (9, C)), torch.randint(0, n, (4, C))), (torch.randint(0, n, (5, C)), torch.randint(0, n, (0, C)))]
    giv = None
    if tr:
        gm = torch.zeros(C, dtype=torch.bool); gm[train.RIGHT] = True; giv = [gm, None]
    a = train.pack(ws, giv)
    base = m.nats(*a)
    hid = m.hidden(a[1], a[2], a[3], a[4])[0]
    for f, k in [(0, 0), (0, 7), (3, 2), (4, 41), (8, 20)]:
        w = ws[0][0].clone(); w[f, k] = (w[f, k] + 3) % n
        if tr and gm[k]: continue
        c = train.pack([(w, ws[0][1]), ws[1]], giv)
        h2 = m.hidden(c[1], c[2], c[3], c[4])[0]
        same = ((hid - h2).abs() < 1e-9).all(-1).view(-1)
        i = f * C + k
        assert same[: i + 1].all() and same[9 * C :].all(), (L, f, k, same.nonzero()[:, 0].tolist()[:5])
        assert not same[i + 1 : 9 * C].all() or (f, k) == (8, 41)
        # the same place one frame on does see it, far frames too
    if tr:  # ahead is seen by earlier frames
        t = ws[0][1].clone(); t[3, 30] = (t[3, 30] + 9) % n  # 30 = right arm? only if given
        k = train.RIGHT[-1]; t = ws[0][1].clone(); t[3, k] = (t[3, k] + 9) % n
        assert ((m.nats(*train.pack([(ws[0][0], t), ws[1]], giv)) - base)[0].abs() > 0).any()
        k = 8; t = ws[0][1].clone(); t[3, k] = (t[3, k] + 9) % n
        assert (m.nats(*train.pack([(ws[0][0], t), ws[1]], giv)) == base).all()
    # sums to one over all codes at a place: relative, clamped, absolute
    for f, k in [(0, 1), (0, 20), (5, 1), (5, 2), (6, 20)]:
        tot = 0.0
        for c in range(n):
            w = ws[0][0].clone(); w[f, k] = c
            b = train.pack([(w, ws[0][1]), ws[1]], giv if not (tr and gm[k]) else None)
            tot += float((-m.nats(*b)[f, k]).detach().exp())
            if tr and gm[k]: pass
        assert abs(tot - 1) < 1e-5, (L, f, k, tot)
    print("ok", L, tr)

# generation: forced log-probabilities equal the likelihood of a window, before and after a slide
from dance import Gen
for L, tr, four, pp in [(1, False, 0, False), (3, False, 0, False), (1, True, 8, True), (2, True, 0, True)]:
    m = TwoLevel(frames=8, d=32, layers=2, heads=2, e=4, dd=16, dlayers=2, dheads=2, L=L, track=tr, kd=24, klayers=1, kheads=2, ahead=4, four=four, per_place=pp, steps=tr)
    for p in m.parameters(): torch.nn.init.normal_(p, 0, 0.3)
    m = m.eval()
    gm = torch.zeros(C, dtype=torch.bool); gm[train.RIGHT] = True
    w = torch.randint(0, n, (2, 20, C))
    g = Gen(m, w[:, :3], 20, [1., 1.], [1., 1.], w if tr else None, gm if tr else None)
    g.begin(0)
    for f in range(3, 20):
        if f - g.start >= 8: g.begin(f - 4)
        lp = g.frame(w[:, f])
        for i in range(2):
            x = w[i, g.start : min(20, g.start + 8)]
            ref = m.nats(*train.pack([(x, w[i, g.start + 8 : g.start + 12])], [gm] if tr else None))[f - g.start]
            assert ((lp[i] + ref).abs() < 2e-4).all(), (L, tr, f, (lp[i] + ref).abs().max())
    print("generation ok", L, tr)
