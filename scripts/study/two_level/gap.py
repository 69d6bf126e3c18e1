"""Bits of the frames of 20-frame gaps in the test clips, all else given: with the track and without. gap.py NAME [NAME without track]"""
import sys, math, json, torch
from train import *
torch.set_num_threads(1)
m = load(sys.argv[1]); G = 20
rows = {"track": [], "blind": []} | ({sys.argv[2]: []} if len(sys.argv) > 2 else {})
other = load(sys.argv[2]) if len(sys.argv) > 2 else None
with torch.no_grad():
    for name, x in corpus("cmu-dance")["test"]:
        for s in range(0, len(x) - 128 - 8, 64):
            w, a = x[s : s + 128], x[s + 128 : s + 192]
            g = torch.ones(len(w) + len(a), C, dtype=torch.bool); g[64 : 64 + G] = False
            for k in rows:
                mm = other if k not in ("track", "blind") else m
                rows[k].append(mm.nats(*pack([(w, a)], [g] if k == "track" else None))[64 : 64 + G].sum(1) / math.log(2))
for k, v in rows.items():
    z = torch.stack(v); print(k, len(v), "bits/frame of the gap", round(float(z.mean()), 2), "by fifths", [round(float(z[:, i : i + 4].mean()), 1) for i in range(0, G, 4)], flush=True)
