#!/bin/sh
# What looking ahead does to dances: the table "Looking ahead" of docs/results/two-level.md. Twelve dances of a minute by
# themselves and of each genre, and two of 20 s that go on from the first second of each of the six held-out salsas.
#
#     scripts/reproduce/look_ahead.sh RUN CORPUS DATA OUT
#
# RUN: a two-level run, with genres or without; CORPUS: cmu-dance as its tokenizer codes it. DATA as ../shared/data/unpack.sh
# leaves it. What is there is not made again. Variables: AHEAD ("1 8"), GUIDANCE (2), SEED (5), THREADS (2), KINELM, PYTHON.
set -eu
call="the call is: $0 RUN CORPUS DATA OUT"
run=${1:?$call} corpus=${2:?$call} data=${3:?$call}/cmu-dance/salsa out=${4:?$call}
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm} python=${PYTHON:-python3}
threads="--threads ${THREADS:-2} --quiet"
genres=$(grep -q '^conditions = .*"genre"' "$run/config.toml" && echo "salsa indian martial" || true)

# NAME ARGS..: dances, measured
measured() {
    name=$1
    shift
    [ -e "$out/$name.json" ] || {
        "$kinelm" evaluate dance "$out/$name"/*.bvh --real "$corpus" --json $threads > "$out/$name.new"
        mv "$out/$name.new" "$out/$name.json"
    }
}
for ahead in ${AHEAD:-1 8}; do
    for genre in free $genres; do
        mkdir -p "$out/$genre-$ahead"
        label=""
        [ $genre = free ] || label="--label genre=$genre --guidance ${GUIDANCE:-2}"
        [ -e "$out/$genre-$ahead/d-12.bvh" ] || "$kinelm" generate --run "$run" --fps 20 --seconds 60 --variations 12 --seed "${SEED:-5}" \
            --lead-in train --look-ahead $ahead $label --out "$out/$genre-$ahead/d.bvh" $threads
        measured $genre-$ahead
    done
    mkdir -p "$out/salsas-$ahead"
    for take in 03 07 11 18 22 26; do
        [ -e "$out/salsas-$ahead/$take-2.bvh" ] || "$kinelm" generate --run "$run" --fps 20 --prompt "$data/$take.bvh" --fps-source 60 \
            --skip 10 --from-frame 20 --frames 420 --variations 2 --seed "${SEED:-5}" --look-ahead $ahead \
            --out "$out/salsas-$ahead/$take.bvh" $threads
    done
    measured salsas-$ahead
done
"$python" - "$out" <<'PYTHON'
import json, sys
from pathlib import Path

out = Path(sys.argv[1])
keys = [("outside %", "outside_share", 100, 1), ("kicks %", "kick_share", 100, 1), ("snaps/min", "snaps_per_min", 1, 1),
        ("fastest m/s", "fastest_m_s", 1, 1), ("speed cm/s", "speed_cm_s", 1, 1), ("jitter m/s³", "jitter_m_s3", 1, 0),
        ("floating %", "floating_share", 100, 1), ("skate cm/s", "skate_cm_s", 1, 1)]
print("| dances | " + " | ".join(key[0] for key in keys) + " | knee, elbow |")
print("|---" * (len(keys) + 2) + "|")
seen = False
for path in sorted(out.glob("*-*.json"), key=lambda path: (path.stem.split("-")[0], int(path.stem.split("-")[1]))):
    groups = {group["name"]: group for group in json.loads(path.read_text())["groups"]}
    for name in ([] if seen else ["train", "valid"]) + ["dances"]:
        group = groups[name]
        cells = ["n/a" if group[key] is None else f"{scale * group[key]:.{digits}f}" for _, key, scale, digits in keys]
        print(f"| {path.stem if name == 'dances' else 'real, ' + name} | " + " | ".join(cells)
              + " | " + ", ".join(f"{bend:.0f}" for bend in group["bends_deg"]) + " |")
    seen = True
PYTHON
