"""crates/motion/tests/golden/features.json and crates/evaluate/tests/golden/frechet.json, the two arguments: kinetic and geometric features of a motion made of sines, in numpy, and a
Fréchet distance by scipy."""
import json, sys
import numpy as np

names = "root lhip rhip belly lknee rknee spine2 lankle rankle chest ltoes rtoes neck lcollar rcollar head lshoulder rshoulder lelbow relbow lwrist rwrist lhand rhand".split()
J = {n: i for i, n in enumerate(names)}


def motion(F, fps):
    t = np.arange(F)[:, None, None] / fps
    j, c = np.arange(24)[None, :, None], np.arange(3)[None, None]
    base = np.stack([0.6 * np.sin(1.7 * np.arange(24) + 0.3), np.linspace(1.6, 0.05, 24) + 0.3 * np.cos(2.9 * np.arange(24)), 0.4 * np.cos(1.1 * np.arange(24))], -1)
    return base + 0.35 * np.sin(2 * np.pi * (0.4 + 0.07 * j + 0.11 * c) * t + 0.9 * j + 1.3 * c) + np.array([0.3, 0, 0.2]) * t


def kinetic(p, dt, compat):
    F = len(p); out = []
    for j in range(p.shape[1]):
        d1 = {i: p[i, j] - p[i - 1, j] for i in range(1, F)}
        if compat: d2 = {i: ((p[i + 1, j] - p[i, j]) / dt - (p[i, j] - p[i - 1, j] / dt)) / dt for i in range(1, F - 1)}
        else: d2 = {i: (p[i + 1, j] - 2 * p[i, j] + p[i - 1, j]) / dt**2 for i in range(1, F - 1)}
        mean = lambda d, i: np.mean([d[k] for k in range(i - 2, i + 3) if k in d] or [np.zeros(3)], axis=0)
        v = np.array([mean(d1, i) / dt for i in range(1, F)]); a = np.array([mean(d2, i) for i in range(1, F)])
        out += [np.mean(v[:, 0] ** 2 + v[:, 2] ** 2), np.mean(v[:, 1] ** 2), np.mean(np.linalg.norm(a, axis=-1))]
    return np.array(out) if compat else np.log(np.array(out) + 1e-3)


def geometric(p, hl, sw, hw, tau, compat):
    q = {n: p[1:, i] for n, i in J.items()}; u = {n: (p[1:, i] - p[:-1, i]) / tau for n, i in J.items()}
    dot = lambda x, n: (x * n).sum(-1) / np.linalg.norm(n, axis=-1)
    Y = np.array([0, 1.0, 0]); low = p[1:, :, 1].min(1)
    nmove = lambda a, b, c, j, th: dot(u[j] - u[a], np.cross(q[c] - q[a], q[b] - q[a])) > th
    move = lambda a, b, j, th: dot(u[j] - u[a], q[b] - q[a]) > th
    plane = lambda a, b, c, j, th: dot(q[j] - q[a], np.cross(q[c] - q[a], q[b] - q[a])) > th
    nplane = lambda n, a, j, th: dot(q[j] - q[a], n) > th
    def angle(x, y, lo, hi):
        x = np.broadcast_to(x, y.shape) if np.ndim(x) < np.ndim(y) else x; y = np.broadcast_to(y, x.shape)
        d = np.degrees(np.arccos(np.clip((x * y).sum(-1) / np.linalg.norm(x, axis=-1) / np.linalg.norm(y, axis=-1), -1, 1))); return (lo < d) & (d < hi)
    fast = lambda j, th: np.linalg.norm(u[j], axis=-1) > th
    spine = q["chest"] - q["belly"]
    if compat: five = [move("belly", "chest", "chest", 1.8 * hl)] * 2 + [move("lwrist", "rwrist", "rwrist", 1.4 * hl), move("rwrist", "root", "lwrist", 1.4 * hl), move("lwrist", "root", "rwrist", 1.4 * hl)]
    else: five = [dot(u[w] - u["chest"], spine) > 1.8 * hl for w in ("rwrist", "lwrist")] + [-dot(u["rwrist"] - u["lwrist"], q["rwrist"] - q["lwrist"]) > 1.4 * hl] + [-dot(u[w] - u["root"], q[w] - q["root"]) > 1.4 * hl for w in ("rwrist", "lwrist")]
    body = q["root"] - q["neck"]
    f = [nmove("neck", "rhip", "lhip", "rwrist", 1.8 * hl), nmove("neck", "lhip", "rhip", "lwrist", 1.8 * hl),
         nplane(q["neck"] - q["chest"], "neck", "rwrist", 0.2 * hl), nplane(q["neck"] - q["chest"], "neck", "lwrist", 0.2 * hl), five[0], five[1],
         angle(q["rshoulder"] - q["relbow"], q["rwrist"] - q["relbow"], 0, 110), angle(q["lshoulder"] - q["lelbow"], q["lwrist"] - q["lelbow"], 0, 110),
         nplane(q["rshoulder"] - q["lshoulder"], "lwrist", "rwrist", 2.5 * sw), five[2], five[3], five[4], fast("rwrist", 2.5 * hl), fast("lwrist", 2.5 * hl),
         plane("root", "lhip", "ltoes", "rankle", 0.38 * hl), plane("root", "rhip", "rtoes", "lankle", 0.38 * hl),
         q["rankle"][:, 1] - low > 1.2 * hl, q["lankle"][:, 1] - low > 1.2 * hl, nplane(q["rhip"] - q["lhip"], "lankle", "rankle", 2.1 * hw),
         angle(q["rhip"] - q["rknee"], q["rankle"] - q["rknee"], 0, 110), angle(q["lhip"] - q["lknee"], q["lankle"] - q["lknee"], 0, 110),
         fast("rankle", 2.5 * hl), fast("lankle", 2.5 * hl),
         angle(body, q["relbow"] - q["rshoulder"], 25, 180), angle(body, q["lelbow"] - q["lshoulder"], 25, 180),
         angle(body, q["rknee"] - q["rhip"], 50, 180), angle(body, q["lknee"] - q["lhip"], 50, 180),
         plane("rankle", "neck", "lankle", "root", 0.5 * hl), angle(body, np.broadcast_to(Y, body.shape), 70, 110),
         low - q["rwrist"][:, 1] > -1.2 * hl, low - q["lwrist"][:, 1] > -1.2 * hl, fast("root", 2.3 * hl)]
    return np.array([x.mean() for x in f])


if __name__ == "__main__":
    p = motion(150, 60.0)
    out = {"frames": 150, "fps": 60.0, "places": p.reshape(150, -1).round(9).tolist(),
           "lengths": [0.26, 0.34, 0.18]}
    p = np.array(out["places"]).reshape(150, 24, 3)
    out |= {"kinetic_compat": kinetic(p, 1 / 60, True).tolist(), "kinetic_fixed": kinetic(p, 1 / 60, False).tolist(),
            "geometric_compat": geometric(p, 0.2568381, 0.3908483, 0.1192471, 1 / 120, True).tolist(),
            "geometric_fixed": geometric(p, 0.26, 0.34, 0.18, 1 / 60, False).tolist()}
    json.dump(out, open(sys.argv[1], "w"))
    # Fréchet distance of two sets of vectors, by scipy's square root of a matrix
    from scipy.linalg import sqrtm
    g = np.random.default_rng(5); A = g.normal(size=(40, 6)); B = A @ (np.eye(6) + 0.2 * g.normal(size=(6, 6))) + 0.3 * g.normal(size=6) + 0.5 * g.normal(size=(40, 6))
    m, s = A.mean(0), A.std(0) + 1e-10; a, b = (A - m) / s, (B - m) / s
    Sa, Sb = np.cov(a.T), np.cov(b.T)
    out = {"real": A.tolist(), "dances": B.tolist(), "frechet": float(((a.mean(0) - b.mean(0)) ** 2).sum() + np.trace(Sa + Sb - 2 * sqrtm(Sa @ Sb).real)),
            "diversity": float(np.mean([np.linalg.norm(b[i] - b[j]) for i in range(40) for j in range(i)]))}
    json.dump(out, open(sys.argv[2], "w"))
