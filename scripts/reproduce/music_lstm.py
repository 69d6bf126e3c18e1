#!/usr/bin/env python3
"""What music-lstm.sh needs besides kinelm.

    music_lstm.py assign SPLITS.csv MUSIC > LABELS.csv     music for the clips of two genres
    music_lstm.py table OUT                                the tables of docs/results/music-lstm.md

Music is assigned, not danced to. The pieces of MUSIC stand in the order of their names, without those under a minute;
every fourth is kept unseen, for validation and test clips. Of the others, as of the unseen, every second is salsa's,
the rest indian's. A genre's clips take its pieces in turn, each a stretch of its own that begins 5 s into the piece, or
where the last clip on it ended.
"""
import csv, json, pathlib, sys, wave

GENRES = ["salsa", "indian"]
START, LEAST = 5.0, 60.0
ROWS = ["mse", "mse-numbers", "mse-compat-audio", "teacher-0", "effort-compat", "effort", "every-4-compat", "every-4"]


def seconds(path):
    with wave.open(str(path)) as sound:
        return sound.getnframes() / sound.getframerate()


def assign(splits, music):
    lengths = {p.stem: seconds(p) for p in sorted(pathlib.Path(music).glob("*.wav"))}
    pieces = [name for name, length in lengths.items() if length >= LEAST]
    unseen, heard = pieces[3::4], [p for i, p in enumerate(pieces) if i % 4 != 3]
    album = {(genre, new): some[i::2] for i, genre in enumerate(GENRES) for new, some in [(False, heard), (True, unseen)]}
    used, turn = dict.fromkeys(pieces, START), dict.fromkeys(album, 0)
    rows = list(csv.DictReader(open(splits)))
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow([*rows[0], "music", "music_from"])
    for row in rows:
        if row["genre"] not in GENRES:
            continue
        key = row["genre"], row["split"] != "train"
        # no clip of cmu-dance is longer than 50 s
        names = [p for p in album[key] if used[p] + 50 < lengths[p]] or sys.exit(f"{row['clip']}: no music is left")
        piece = names[turn[key] % len(names)]
        turn[key] += 1
        out.writerow([*row.values(), piece, used[piece]])
        used[piece] += 50


def line(*cells):
    print("| " + " | ".join(str(c) for c in cells) + " |")


def mean(x, digits, unit=""):
    low, high = x["over_takes"]
    return f"{x['mean']:.{digits}f}{unit} ({low:.{digits}f} to {high:.{digits}f})"


def table(out):
    found = [(name, json.loads(p.read_text())) for name in ROWS for p in [pathlib.Path(out) / f"{name}.json"] if p.exists()]
    real = {row["split"]: row["metrics"] for row in found[0][1]["rows"] if row["music"].startswith("none")}
    print("\nDegrees to the true rotations: training music, the same clips to other music, what a dance changes with it; unseen\n")
    line("row", "training", "other music", "worse by", "changed by", "mean pose", "unseen", "changed by", "mean pose")
    line(*["---"] * 9)
    rows = lambda report: {(r["split"], r["music"]): r["metrics"] for r in report["rows"]}
    for name, report in found:
        r = rows(report)
        own, other = r["train", "the clips' own"], r["train", "other clips'"]
        new, strange = r["test", "the clips' own"], r["test", "other clips'"]
        line(name, mean(own["degrees"], 1), mean(other["degrees"], 1), mean(other["worse_degrees"], 1),
             mean(other["from_own_degrees"], 1), f"{own['mean_pose_degrees']['mean']:.1f}", mean(new["degrees"], 1),
             mean(strange["from_own_degrees"], 1), f"{new['mean_pose_degrees']['mean']:.1f}")
    for split, music in [("train", "the clips' own"), ("test", "the clips' own")]:
        print(f"\n{split}: over the true dances ({real[split]['speed_rad_s']:.2f} rad/s, "
              f"{real[split]['hip_flips_per_minute']['mean']:.1f} hip flips a minute, still "
              f"{100 * real[split]['still']['mean']:.1f} %)\n")
        line("row", "speed", "jitter", "jitter, filtered", "hip flips a minute", "still")
        line(*["---"] * 6)
        for name, report in found:
            g = rows(report)[split, music]
            line(name, mean(g["speed_ratio"], 2), mean(g["jitter_ratio"], 2), mean(g["filtered_jitter_ratio"], 2),
                 mean(g["hip_flips_per_minute"], 1), f"{100 * g['still']['mean']:.0f} %")
    print("\nA long dance to unseen music\n")
    line("row", "updates", "frames", "freezes", "still", "rad/s", "hip flips a minute", "frames a second")
    line(*["---"] * 8)
    for name, report in found:
        g = report["long"]
        freezes = "no" if g["freezes_at_s"] is None else f"at {g['freezes_at_s']:.0f} s"
        line(name, report["step"], g["frames"], freezes, f"{100 * g['still']:.1f} %", f"{g['speed_rad_s']:.2f}",
             f"{g['hip_flips_per_minute']:.1f}", f"{g['frames_per_second']:.0f}")


{"assign": assign, "table": table}[sys.argv[1]](*sys.argv[2:])
