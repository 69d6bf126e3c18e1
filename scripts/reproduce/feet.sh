#!/bin/sh
# Foot lock on rigs whose toes are end sites: how deep they are in the floor, and what locking costs; the tables of "Ends of
# toes" in docs/results/two-level.md.
#
#     scripts/reproduce/feet.sh DATA OUT
#
# DATA as ../shared/data/unpack.sh leaves it. What is there is not made again. Variables: KINELM, PYTHON (python3, without
# packages), FPS (of the dances; the clip's rate), JOINTS (given), RUN (a run folder; the ready model).
set -eu
call="the call is: $0 DATA OUT"
data=$(realpath "${1:?$call}")/cmu-dance out=${2:?$call}
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm} python=${PYTHON:-python3}
mkdir -p "$out"
cd "$out"
for clip in salsa/03 salsa/07 salsa/11 salsa/18 salsa/22 salsa/26 indian/13 indian/15; do
    case $clip in salsa/*) rate=60 ;; *) rate=120 ;; esac
    name=$(echo "$clip" | tr / -)
    for feet in off lock; do
        [ -e "$name-$feet.bvh" ] || "$kinelm" generate ${RUN:+--run "$RUN"} --prompt "$data/$clip.bvh" \
            --fps-source $rate --fps "${FPS:-$rate}" --skip 10 --joints "${JOINTS:-root,torso,right_arm}" --rig prompt \
            --seconds 12 --feet $feet --out "$name-$feet.bvh" --quiet
    done
    floor=$("$kinelm" inspect --json --skip 10 "$data/$clip.bvh" |
        $python -c 'import json, sys; print(json.load(sys.stdin)["floor_m"])')
    $python "$here/scripts/reproduce/feet.py" toes "$data/$clip.bvh" 10 "$floor" "$name-off.bvh" "$name-lock.bvh"
done

# the same body on SMPL's rig, whose toes are joints
[ -e salsa-03-smpl.bvh ] || "$kinelm" convert salsa-03-off.bvh salsa-03-smpl.bvh --onto smpl --quiet
for rig in off smpl; do
    for minutes in 1 4 16; do
        long=long-$rig-$minutes.bvh
        $python "$here/scripts/reproduce/feet.py" repeat "salsa-03-$rig.bvh" "$long" $((60 * minutes))
        echo "$rig, $minutes minutes: reading and writing, then with foot lock"
        for feet in "--cutoff 10" "--cutoff 10 --feet"; do
            (time -p "$kinelm" filter "$long" --out filtered.bvh --force --quiet $feet) 2>&1 | grep user
        done
    done
done
