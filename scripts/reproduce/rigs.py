"""A contact sheet of scripts/reproduce/rigs.sh: of each file its own rig, SMPL, and the dance, at one moment, from ahead.

    python scripts/reproduce/rigs.py OUT SHEET.png        # numpy, matplotlib
"""
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

MOMENT_S, COLUMNS = 3.0, 4
FOLDERS = (("files", "#555555"), ("smpl", "#1f77b4"), ("dances", "#d95f02"))


def figure(path):
    """Places (N, 3) at the moment, about the first joint that moves, and parents."""
    read = np.load(path)
    f = min(round(MOMENT_S * float(read["fps"])), len(read["positions"]) - 1)
    # seen from ahead and the side
    turn = np.radians(50)
    at = read["positions"][f] @ [[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]]
    low, high = at.min(0), at.max(0)
    return at - [(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2], read["parents"]


def main():
    out, sheet = Path(sys.argv[1]), sys.argv[2]
    names = sorted(path.stem for path in (out / "dances").glob("*.npz"))
    rows = -(-len(names) // COLUMNS)
    drawn, axes = plt.subplots(rows, COLUMNS, figsize=(3.4 * COLUMNS, 1.9 * rows), dpi=90)
    for axis in axes.flat:
        axis.axis("off")
    for name, axis in zip(names, axes.flat):
        scale = None
        for place, (folder, colour) in enumerate(FOLDERS):
            at, parents = figure(out / folder / f"{name}.npz")
            # every figure as high as it is, whatever the rig's unit or size
            scale = np.ptp(at[:, 1]) or 1.0
            at = at * (1.7 / scale)
            for joint, parent in enumerate(parents):
                if parent >= 0:
                    x, y = at[[joint, parent], 0] + 2.0 * place, at[[joint, parent], 1]
                    axis.plot(x, y, color=colour, linewidth=1.0, solid_capstyle="round")
        axis.set_title(name, fontsize=9)
        axis.set_xlim(-1.1, 5.1)
        axis.set_ylim(-0.1, 2.0)
        axis.set_aspect("equal")
    drawn.tight_layout()
    drawn.savefig(sheet, metadata={"Software": None})


main()
