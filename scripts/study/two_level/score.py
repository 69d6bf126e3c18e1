"""score.py: measures of the saved draws r/*/gapG[tag].npy and of the baselines; closing correction; writes table rows."""
import sys, math, json
from math import comb
import numpy as np
from ahead import *
H = 64
con = lambda q: q * np.array([1, -1, -1, -1.0])


def qlog(q):
    q = np.where(q[..., :1] < 0, -q, q); s = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True); a = 2 * np.arctan2(s, q[..., :1])
    return q[..., 1:] * np.where(s > 1e-9, a / np.maximum(s, 1e-9), 2.0)


MP = np.array(TOK["mean_pose"], float).reshape(-1, 4)[:9, [3, 0, 1, 2]]


def fk(p, turn, tilt, q12):
    sh = p.shape[:-1]; q = np.zeros((*sh, 22, 4)); q[..., [j for j in range(22) if j not in CODED], :] = MP
    q[..., CODED[1:], :] = q12; q[..., 0, :] = qmul(np.stack([np.cos(turn / 2), 0 * turn, np.sin(turn / 2), 0 * turn], -1), tilt)
    P, Gq = np.zeros((*sh, 22, 3)), np.zeros((*sh, 22, 4))
    for j in range(22):
        if PAR[j] < 0: P[..., j, :], Gq[..., j, :] = p, q[..., j, :]
        else:
            P[..., j, :] = P[..., PAR[j], :] + qrot(Gq[..., PAR[j], :], np.array(OFF[j], float)); Gq[..., j, :] = qmul(Gq[..., PAR[j], :], q[..., j, :])
    return P


def smooth(G):
    u = np.arange(1, G + 2) / (G + 1); return 3 * u * u - 2 * u**3  # frames s .. s+G


def correct(st, tr, G, way="bend"):
    """Drawn state over H+G+1 frames (gaps, draws, ..) with its free frame e = H+G; tr truth's (gaps, 1, ..). -> corrected state of the gap, closing differences."""
    p, turn, _, tilt, q = (a.copy() for a in st); e = H + G; w = smooth(G); gap = slice(H, e + 1)
    dturn = wrap(tr[1][..., e] - turn[..., e]); dq = qlog(qmul(tr[4][..., e, :, :], con(q[..., e, :, :]))); dt = qlog(qmul(tr[3][..., e, :], con(tilt[..., e, :])))
    dp0 = tr[0][..., e, :] - p[..., e, :]
    if "bend" in way:  # the path's steps turn with the heading's correction; what is left over is spread too
        a = np.concatenate([np.zeros(1), w[:-1]]) * dturn[..., None]; stp = p[..., H : e + 1, :] - p[..., H - 1 : e, :]; co, si = np.cos(a), np.sin(a)
        x = co * stp[..., 0] + si * stp[..., 2]; z = -si * stp[..., 0] + co * stp[..., 2]
        p[..., gap, 0] = p[..., H - 1, None, 0] + np.cumsum(x, -1); p[..., gap, 2] = p[..., H - 1, None, 2] + np.cumsum(z, -1)
    dp = tr[0][..., e, :] - p[..., e, :]
    p[..., gap, :] += w[:, None] * dp[..., None, :]; turn[..., gap] += w * dturn[..., None]
    q[..., gap, :, :] = qmul(qvec(w[:, None, None] * dq[..., None, :, :]), q[..., gap, :, :]); tilt[..., gap, :] = qmul(qvec(w[:, None] * dt[..., None, :]), tilt[..., gap, :])
    if "vel" in way:
        L = min(G, 8); u = np.clip((np.arange(1, G + 2) - (G + 1 - L)) / L, 0, 1); v = (u**3 - u**2) * L  # slope 1 a frame at the end, 0 in value there
        dv = lambda now, before, nxt: qlog(qmul(qmul(nxt, con(now)), con(qmul(now, con(before)))))
        vp = (tr[0][..., e + 1, :] - tr[0][..., e, :]) - (p[..., e, :] - p[..., e - 1, :]); p[..., gap, :] += v[:, None] * vp[..., None, :]
        vt = wrap(tr[1][..., e + 1] - tr[1][..., e]) - (turn[..., e] - turn[..., e - 1]); turn[..., gap] += v * vt[..., None]
        for a, i in ((q, 4), (tilt, 3)):
            x = (slice(None),) if i == 4 else (); now, before, nxt = a[(..., e, *x, slice(None))], a[(..., e - 1, *x, slice(None))], tr[i][(..., e + 1, *x, slice(None))]
            k = dv(now, before, nxt); vv = v[:, None, None] if i == 4 else v[:, None]; kk = k[..., None, :, :] if i == 4 else k[..., None, :]
            a[(..., gap, *x, slice(None))] = qmul(qvec(vv * kk), a[(..., gap, *x, slice(None))])
    ang = np.concatenate([np.linalg.norm(dq, axis=-1), np.linalg.norm(dt, axis=-1)[..., None]], -1).mean(-1)
    return (p, turn, None, tilt, q), {"dist": np.linalg.norm(dp0[..., [0, 2]], axis=-1) * 100, "height": np.abs(dp0[..., 1]) * 100, "turn": np.abs(np.degrees(dturn)), "joints": np.degrees(ang)}


def bo(v, k):  # expected best of k of the draws (.., D), without putting back
    v = np.sort(v, -1); D = v.shape[-1]; c = np.array([comb(D - 1 - i, k - 1) if D - 1 - i >= k - 1 else 0 for i in range(D)]) / comb(D, k); return v @ c


def measures(P, Tp, G):
    """P (gaps, draws, H+G+1+3, 22, 3) with the truth outside; Tp (gaps, 1, ..)."""
    e = H + G; mid = [H + G // 2 - 1, H + G // 2]; d = np.linalg.norm(P - Tp, axis=-1); r = np.linalg.norm(P - P[..., :1, :] - Tp + Tp[..., :1, :], axis=-1)
    sp = lambda X, a, b: np.linalg.norm(np.diff(X[:, :, a:b][..., CODED, :], axis=2), axis=-1).mean((2, 3)) * 20
    jk = lambda X: np.linalg.norm(np.diff(X[:, :, e - 3 : e + 3][..., CODED, :], 3, axis=2), axis=-1).mean((2, 3)) * 8000
    gj = lambda X: np.linalg.norm(np.diff(X[:, :, H:e][..., CODED, :], 3, axis=2), axis=-1).mean((2, 3)) * 8000
    return {"mid": d[:, :, mid].mean((2, 3)) * 100, "midroot": r[:, :, mid].mean((2, 3)) * 100, "all": d[:, :, H:e].mean((2, 3)) * 100, "border": sp(P, e - 1, e + 1), "borderT": sp(Tp, e - 1, e + 1),
            "jerk": jk(P), "jerkT": jk(Tp), "gj": gj(P), "gjT": gj(Tp), "speed": sp(P, H, e), "speedT": sp(Tp, H, e)}


def truth(sp, G):
    x = np.stack([x[s - H : s + G + 4] for _, x, s in sp])[:, None]; return x, state(x)


def draws(sp, G, name, tag="", way="bend"):
    x, tr = truth(sp, G); g = np.load(HERE / "r" / name / f"gap{G}{tag}.npy").astype(np.int64); D = g.shape[1]
    st = state(np.concatenate([np.repeat(x[:, :, :H], D, 1), g], 2)); raw = fk(st[0][:, :, -1], st[1][:, :, -1], st[3][:, :, -1], st[4][:, :, -1]); Tp = fk(tr[0], tr[1], tr[3], tr[4])
    pos = np.linalg.norm(raw - Tp[:, :, H + G], axis=-1).mean(-1) * 100  # closing as the distance of joints
    c, cl = correct(st, tr, G, way); P = np.concatenate([fk(c[0], c[1], c[3], c[4])[:, :, : H + G], np.repeat(Tp[:, :, H + G :], D, 1)], 2)
    cl["sum"] = np.radians(cl["joints"]) + np.radians(cl["turn"]) + (cl["dist"] + cl["height"]) / 100; cl["pos"] = pos
    return measures(P, Tp, G), cl


def baseline(sp, G, kind):
    x, tr = truth(sp, G); Tp = fk(tr[0], tr[1], tr[3], tr[4]); p, turn, _, tilt, q = (a.copy() for a in tr); e = H + G
    for i, f in enumerate(range(H, e)):
        u = (i + 1) / (G + 1) if kind == "slerp" else 0.0
        p[:, :, f] = tr[0][:, :, H - 1] * (1 - u) + tr[0][:, :, e] * u; sl = lambda a, b: qmul(qvec(u * qlog(qmul(b, con(a)))), a)
        tilt[:, :, f], q[:, :, f] = sl(tr[3][:, :, H - 1], tr[3][:, :, e]), sl(tr[4][:, :, H - 1], tr[4][:, :, e]); turn[:, :, f] = tr[1][:, :, H - 1] + u * wrap(tr[1][:, :, e] - tr[1][:, :, H - 1])
    return measures(fk(p, turn, tilt, q), Tp, G)


def pick(m, i): return {k: np.take_along_axis(v, i, 1) if v.shape[1] > 1 else v for k, v in m.items()}


def row(name, m, cl=None, k=10, base=None):
    D = m["mid"].shape[1]; R = lambda a: a["mid"].mean(1)
    s = f"| {name} | {m['mid'].mean():.2f} | {bo(m['mid'], k).mean():.2f} | " if D >= k else f"| {name} | {m['mid'].mean():.2f} | - | "
    s += f"{m['midroot'].mean():.2f} | " + (f"{bo(m['midroot'], k).mean():.2f} | " if D >= k else "- | ") + f"{m['all'].mean():.2f} | "
    if base is not None:
        d = m["mid"].mean(1) - base["mid"].mean(1); s += f"{d.mean():+.2f} ±{d.std(ddof=1) / np.sqrt(len(d)):.2f} | "
    else: s += "| "
    s += f"{m['border'].mean() / m['borderT'].mean():.2f} | {m['jerk'].mean() / m['jerkT'].mean():.2f} | {m['gj'].mean() / m['gjT'].mean():.2f} | {m['speed'].mean() / m['speedT'].mean():.2f} | "
    if cl: s += f"{np.median(cl['dist']):.1f}, {np.percentile(cl['dist'], 90):.1f} | {np.median(cl['turn']):.1f}, {np.percentile(cl['turn'], 90):.1f} | {cl['joints'].mean():.1f} | {100 * ((cl['dist'] < 10) & (cl['turn'] < 10)).mean():.0f} % |"
    else: s += "| | | |"
    return s


HEAD = "| method | mid, 1 draw | mid, best of 10 | mid root, 1 draw | root, best of 10 | whole gap, 1 draw | minus slerp (mid) | border speed / real | border jerk / real | gap jerk / real | gap speed / real | closing cm: median, 90 % | closing deg | joints deg | <10 cm and <10 deg |\n|" + "---|" * 15


def table(G, names, tag="", way="bend"):
    sp = spots(); print(f"\n### G = {G}, {len(sp)} gaps, {way}\n{HEAD}"); sl = baseline(sp, G, "slerp"); print(row("slerp", sl)); print(row("hold", baseline(sp, G, "hold"), base=sl))
    for nm in names:
        nm, tg = (nm.split(":") + [tag])[:2]
        try: m, cl = draws(sp, G, nm, tg, way)
        except FileNotFoundError: continue
        D = m["mid"].shape[1]; print(row(f"{nm}{tg}, {D} draws", m, cl, base=sl), flush=True)
        for key in ("sum", "pos"):
            i = cl[key].argmin(1)[:, None]; print(row(f"{nm}{tg}, kept of {D} by {key}", pick(m, i), pick(cl, i), base=sl))
        if D >= 40:
            i = cl["pos"].reshape(len(sp), D // 4, 4).argmin(2) + np.arange(D // 4) * 4; print(row(f"{nm}{tg}, {D // 4} times kept of 4", pick(m, i), pick(cl, i), base=sl))


if __name__ == "__main__":
    way = "bend"
    if sys.argv[1] in ("bend", "add", "bendvel"): way = sys.argv.pop(1)
    for G in (10, 20, 40): table(G, sys.argv[1:], way=way)
