"""Dances of a flat run through kinelm generate, measured as dance.py does: flat_dance.py RUN."""
import json, subprocess, sys
from pathlib import Path
import numpy as np
from dance import *
run = sys.argv[1]; draws, total = 2, 420
sal, thr, _ = real()
floors = {json.loads(l)["name"]: json.loads(l)["floor_m"] for l in open(HERE / "c/cmu-dance/clips.jsonl")}
lows = [np.percentile(positions(x)[:, ANK, 1].min(1), 5) for _, x in sal]
names = ["pelvis","left_hip","right_hip","spine1","left_knee","right_knee","spine2","left_ankle","right_ankle","spine3","left_foot","right_foot","neck","left_collar","right_collar","head","left_shoulder","right_shoulder","left_elbow","right_elbow","left_wrist","right_wrist"]
out = HERE / run / "dances"; out.mkdir(exist_ok=True); res = {}
def make(tag, extra, length):
    rows = {}
    for T, p in SETTINGS:
        for k, (name, x) in enumerate(sal):
            f = out / f"{tag}-{name.replace('/', '_')}-{T}-{p}.bvh"
            subprocess.run(["./kinelm", "generate", "--run", run, "--prompt", f"data/cmu-dance/{name}.bvh", "--fps-source", "60", "--skip", "10", "--from-frame", "20",
                "--frames", str(length), "--temperature", str(T), "--top-p", str(p), "--variations", str(draws), "--uncoded-joints", "training", "--out", str(f), "--seed", str(7 + k), "--threads", "1", "--force", "--quiet", *extra], check=True, cwd=HERE)
            for d in range(1, draws + 1):
                g = f.with_name(f.stem + f"-{d}.bvh"); z = g.with_suffix(".npz")
                subprocess.run(["./kinelm", "convert", str(g), str(z), "--positions", "--quiet", "--up", "y"], cwd=HERE, check=False)
                a = np.load(z); P = a["positions"][:, [list(a["joints"]).index(n) for n in names]].astype(float)
                P[..., 1] -= floors[name]
                if d == 1 and T == .9 and p == .95:
                    e = np.abs(P[:20] - positions(x[:20])).max(); print(name, len(P), "prompt differs", e)
                rows.setdefault((T, p), []).append(measures(P[20:], lows[k], thr, FREE_J if extra else NINE))
        r = {**mean(rows[T, p]), "each": rows[T, p]}; res[f"{tag} {T} {p}"] = r; print(show(f"{tag} {T} {p}", r), flush=True)
make("free", [], total)
make("given", ["--joints", "root,right_arm"], min(total, min(len(x) for _, x in sal)))
d = HERE / "r" / Path(run).name; d.mkdir(parents=True, exist_ok=True)
(d / "dance.json").write_text(json.dumps(res, indent=1))
