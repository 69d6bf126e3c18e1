#!/usr/bin/env python3
"""The tables of a folder that aclstm.sh filled: aclstm.py OUT. Means and deviations over runs; one run has no deviation."""
import json, pathlib, statistics, sys

ROWS = ["positional-5", "euler-5", "quaternion-5", "quaternion-30", "quaternion-45", "compat", "header-rate", "euler-YXZ", "gpt"]


def spread(values, digits, unit=""):
    values = list(values)
    if not values:
        return ""
    mean = f"{statistics.mean(values):.{digits}f}"
    return mean + (f" ± {statistics.stdev(values):.{digits}f}" if len(values) > 1 else "") + unit


def line(*cells):
    print("| " + " | ".join(str(c) for c in cells) + " |")


def table(title, head, rows):
    print(f"\n{title}\n")
    line(*head)
    line(*["---"] * len(head))
    for row in rows:
        line(*row)


def main():
    out = pathlib.Path(sys.argv[1])
    found = {}
    for name in ROWS:
        files = [p for p in sorted(out.glob(f"{name}-[0-9]*.json")) if not p.name.endswith(".kinelm.json")]
        reports = [json.loads(p.read_text()) for p in files]
        if reports:
            found[name] = reports
    lengths = [row["seed_frames"] for row in next(iter(found.values()))[0]["rows"]]
    runs = lambda n: f"{len(found[n])} run{'s' * (len(found[n]) > 1)}"
    # dances of something else are measured in the form of a network that had updates, they had none of them
    updates = lambda n: "" if "dances" in found[n][0] else f"{found[n][0]['step']} updates, "
    name = lambda n: f"{n} ({updates(n)}{runs(n)})"
    of_length = lambda n, length: [row["metrics"] for report in found[n] for row in report["rows"] if row["seed_frames"] == length]
    of = lambda n, i, pick: [pick(metrics) for metrics in of_length(n, lengths[i])]
    loss = lambda n: [spread(of(n, i, lambda g: g["loss"]["mean"]), 4) for i in range(len(lengths))]
    held = lambda n, key, digits: f"{found[n][0]['rows'][0]['figures'][key]['mean']:.{digits}f}"
    seeds = [f"seed {n}" for n in lengths]

    def freezes(n, i, span):
        times = of(n, i, lambda g: g[span]["pose"]["median_time_to_freeze_s"])
        return ", ".join("not" if t is None else f"{t:.1f} s" for t in times)

    percent = lambda values, digits: spread((100 * x for x in values), digits, " %")
    last = lengths.index(max(lengths))
    table(f"Seeds of {lengths[last]} frames, means and deviations over runs",
          ["row", "own loss", "cm", "degrees", "still, short", "never", "freezes at", "still, long", "cm/s", "flips"],
          [[name(n), spread(of(n, last, lambda g: g["loss"]["mean"]), 4), spread(of(n, last, lambda g: g["root_cm"]["mean"]), 1),
            spread(of(n, last, lambda g: g["degrees"]["mean"]), 1), percent(of(n, last, lambda g: g["short"]["still"]["mean"]), 0),
            percent(of(n, last, lambda g: g["short"]["never"]["mean"]), 0), freezes(n, last, "short"),
            percent(of(n, last, lambda g: g["long"]["still"]["mean"]), 0),
            spread(of(n, last, lambda g: g["short"]["speed_cm_s"]), 0), percent(of(n, last, lambda g: g["flips"]["mean"]), 2)]
           for n in found])
    table("Own loss of the next 20 frames", ["row", *seeds, "last frame held"],
          [[name(n), *loss(n), held(n, "still_loss", 4)] for n in found])
    for key, digits, unit in [("root_cm", 2, "cm, hips in one place"), ("degrees", 2, "degrees, local rotations")]:
        cell = lambda n, i: spread(of(n, i, lambda g: g[key]["mean"]), digits)
        table(f"The next 20 frames, {unit}", ["row", *seeds, "last frame held"],
              [[name(n), *(cell(n, i) for i in range(len(lengths))), held(n, f"still_{key}", digits)] for n in found])
    for span in ["short", "long"]:
        frames = next(iter(found.values()))[0]["rows"][0]["metrics"][span]["frames"]
        still = lambda n, i: percent(of(n, i, lambda g: g[span]["still"]["mean"]), 0)
        never = lambda n, i: percent(of(n, i, lambda g: g[span]["never"]["mean"]), 0)
        table(f"Over {frames} frames, hip held: frames that stand still; dances that never freeze; median time to freeze",
              ["row", *(f"{s} still" for s in seeds), *(f"{s} never" for s in seeds), *(f"{s} median" for s in seeds)],
              [[name(n), *(still(n, i) for i in range(len(lengths))), *(never(n, i) for i in range(len(lengths))),
                *(freezes(n, i, span) for i in range(len(lengths)))] for n in found])
    flips = lambda n, i: percent(of(n, i, lambda g: g["flips"]["mean"]), 2)
    speed = lambda n, i: spread(of(n, i, lambda g: g["short"]["speed_cm_s"]), 0)
    table("Steps of 400 with a flip; speed, cm/s", ["row", *(f"{s} flips" for s in seeds), *(f"{s} speed" for s in seeds)],
          [[name(n), *(flips(n, i) for i in range(len(lengths))), *(speed(n, i) for i in range(len(lengths)))] for n in found])
    real = next(iter(found.values()))[0]
    share = lambda x: f"{100 * x:.1f} %"
    print(f"\nReal {real['split']} clips: still {share(real['real']['still']['mean'])}, never freeze "
          f"{share(real['real']['never']['mean'])}, {real['real']['speed_cm_s']:.0f} cm/s, flips {100 * real['real_flips']:.2f} %; "
          f"{real['seeds']} seeds of {real['takes']} takes; thresholds {real['thresholds_cm_s']} cm/s")


main()
