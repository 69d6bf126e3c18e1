"""final.py WAY name[:tag] ..: compact final tables, with the medoid of the draws and slerp with speeds matched at both borders."""
from score import *
import sys


def slerpv(sp, G):
    x, tr = truth(sp, G); Tp = fk(tr[0], tr[1], tr[3], tr[4]); p, turn, _, tilt, q = (a.copy() for a in tr); e = H + G; L = min(G, 8); T1 = G + 1
    i = np.arange(1, G + 1); a = np.clip(i / L, 0, 1); b = np.clip((i - (T1 - L)) / L, 0, 1); A = (a**3 - 2 * a**2 + a) * L; B = (b**3 - b**2) * L; u = i / T1
    dp = tr[0][:, :, e] - tr[0][:, :, H - 1]; dt = wrap(tr[1][:, :, e] - tr[1][:, :, H - 1]); g = slice(H, e)
    v0, v1 = tr[0][:, :, H - 1] - tr[0][:, :, H - 2] - dp / T1, tr[0][:, :, e + 1] - tr[0][:, :, e] - dp / T1
    p[:, :, g] = tr[0][:, :, H - 1, None] + u[:, None] * dp[:, :, None] + A[:, None] * v0[:, :, None] + B[:, None] * v1[:, :, None]
    w0, w1 = wrap(tr[1][:, :, H - 1] - tr[1][:, :, H - 2]) - dt / T1, wrap(tr[1][:, :, e + 1] - tr[1][:, :, e]) - dt / T1
    turn[:, :, g] = tr[1][:, :, H - 1, None] + u * dt[..., None] + A * w0[..., None] + B * w1[..., None]
    for k in (3, 4):
        Q = tr[k]; ax = (lambda f: Q[:, :, f]); d = qlog(qmul(ax(e), con(ax(H - 1)))); r0 = qlog(qmul(ax(H - 1), con(ax(H - 2)))) - d / T1; r1 = qlog(qmul(ax(e + 1), con(ax(e)))) - d / T1
        out = q if k == 4 else tilt
        for n_ in range(G): out[:, :, H + n_] = qmul(qvec(u[n_] * d + A[n_] * r0 + B[n_] * r1), ax(H - 1))
    return measures(fk(p, turn, tilt, q), Tp, G)


def draws2(sp, G, name, tag, way):
    m, cl = draws(sp, G, name, tag, way)
    x, tr = truth(sp, G); g = np.load(HERE / "r" / name / f"gap{G}{tag}.npy").astype(np.int64); D = g.shape[1]
    c, _ = correct(state(np.concatenate([np.repeat(x[:, :, :H], D, 1), g], 2)), tr, G, way); P = fk(c[0], c[1], c[3], c[4])[:, :, H : H + G]
    d = np.stack([np.stack([np.linalg.norm(P[k, a] - P[k], axis=-1).mean((1, 2)) for a in range(D)]) for k in range(len(P))]).sum(2)  # (gaps, D)
    return m, cl, d


way = sys.argv[1]; sp = spots()
for G in (10, 20, 40):
    print(f"\n### G = {G}, {len(sp)} gaps, {way}\n{HEAD}"); sl = baseline(sp, G, "slerp"); print(row("slerp, lerp", sl)); print(row("slerp, speeds matched at both borders", slerpv(sp, G), base=sl)); print(row("hold", baseline(sp, G, "hold"), base=sl))
    for nm in sys.argv[2:]:
        nm, tg = (nm.split(":") + [""])[:2]
        if not (HERE / "r" / nm / f"gap{G}{tg}.npy").exists(): continue
        m, cl, md = draws2(sp, G, nm, tg, way); D = m["mid"].shape[1]; print(row(f"{nm}{tg}, {D} draws", m, cl, base=sl))
        for key in ("sum", "pos"):
            i = cl[key].argmin(1)[:, None]; print(row(f"{nm}{tg}, kept of {D} by {key}", pick(m, i), pick(cl, i), base=sl))
        i = cl["pos"].reshape(len(sp), D // 4, 4).argmin(2) + np.arange(D // 4) * 4; print(row(f"{nm}{tg}, kept of 4 by pos", pick(m, i), pick(cl, i), base=sl))
        i = md.argmin(1)[:, None]; print(row(f"{nm}{tg}, medoid of {D}", pick(m, i), pick(cl, i), base=sl), flush=True)
