#!/bin/sh
# Rigs as they come: each file onto SMPL, and a dance after its root, torso and right arm on its own rig, without a flag; the
# contact sheet of docs/results/recognition.md.
#
#     scripts/reproduce/rigs.sh RUN DANCE OUT FILE..
#
# RUN: a two-level run. DANCE: a motion file that is put on the rigs of crates/motion/tests/rigs (synthetic). FILE: real files
# beside them. Variables: RIGS (those drawn), KINELM, PYTHON with numpy and matplotlib.
set -eu
call="the call is: $0 RUN DANCE OUT FILE.."
run=${1:?$call} dance=${2:?$call} out=${3:?$call}
shift 3
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm} python=${PYTHON:-python3}
rigs=${RIGS:-xsens_mvn optitrack vicon rokoko perception_neuron mocopi iclone_cc daz_genesis9 mmd ue4_mannequin ue5_manny \
    unity_humanoid valve_biped biped_3dsmax humanik lafan1}
mkdir -p "$out/files" "$out/smpl" "$out/dances"
[ -e "$out/rigs/lafan1.bvh" ] ||
    (cd "$here" && cargo run --release --quiet -p kinelm-motion --example on_rigs -- "$dance" "$out/rigs" > /dev/null)
for rig in $rigs; do
    cp "$out/rigs/$rig.bvh" "$out/files/"
done
for file in "$@"; do
    cp "$file" "$out/files/"
    # an AMC needs its skeleton
    case $file in *.amc) cp "$(dirname "$file")"/*.asf "$out/files/" ;; esac
done
failed=0
for file in "$out"/files/*; do
    name=$(basename "${file%.*}")
    case $file in *.asf) continue ;; esac
    "$kinelm" convert "$file" "$out/smpl/$name.bvh" --onto smpl --force --quiet &&
        "$kinelm" generate --run "$run" --fps 20 --prompt "$file" --joints root,torso,right_arm --rig prompt --seed 1 --threads 1 \
            --out "$out/dances/$name.bvh" --force --quiet || { echo "$file: failed"; failed=1; continue; }
    for of in "$file" "$out/smpl/$name.bvh" "$out/dances/$name.bvh"; do
        "$kinelm" convert "$of" "$out/$(basename "$(dirname "$of")")/$name.npz" --positions --fps 20 --force --quiet
    done
done
"$python" "$here/scripts/reproduce/rigs.py" "$out" "$here/docs/results/rigs.png"
exit $failed
