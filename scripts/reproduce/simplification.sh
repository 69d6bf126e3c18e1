#!/bin/sh
# The thesis's table 4.5: 13 or 24 joints, 20 or 60 frames a second on cmu-dance; 10 or 30 on bandai-2, which has 30. Bits a
# frame compare rows of one rate, bits a second rows of one set of joints.
#
#     sh ../shared/data/unpack.sh DATA && scripts/reproduce/simplification.sh DATA ../shared/data/splits OUT
#
# FORM=thesis (default: ours) trains the thesis's model: a position a place, plain inputs and head. common.sh has the other
# variables. All cells have one context in tokens, as there: the more tokens a second, the less time a window shows.
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=${1:?$call} splits=${2:?$call} out=${3:?$call}
. "$(dirname "$0")/common.sh"
form=${FORM:-ours}
case $form in
ours) keys="" ;;
thesis) keys='model.positions="absolute" model.previous_frame=false model.head="absolute"' ;;
*) fail "FORM=$form; expected ours or thesis" ;;
esac

cell() {
    set=$1 joints=$2 fps=$3 name=$1_$2_joints_$3_fps
    tokenizer "$name" "$data/$set" --labels "$splits/$set.csv" $(read_as "$set") --joints "$joints" --fps "$fps"
    corpus "$name" "$set" "$name"
    configured "$out/runs/$name.toml" $keys
    for seed in $seeds; do
        training pretrain "$name" "$seed" --config "$out/runs/$name.toml" --corpus "$out/corpora/$name"
        measured "$name" "$name" "$seed"
    done
}
for joints in 13 24; do
    for fps in 20 60; do cell cmu-dance "$joints" "$fps"; done
done
for joints in 13 24; do
    for fps in 10 30; do cell bandai-2 "$joints" "$fps"; done
done
table "Joints and rates, $form"
