#!/bin/sh
# The thesis's table 4.4: causal and masked, with a vector for each place of the window and with frame and joint. Beside
# them ours: turning by frames (rope), and the previous frame as an input and in the head, with each kind of positions.
#
#     sh ../shared/data/unpack.sh DATA && scripts/reproduce/positions.sh DATA ../shared/data/splits OUT
#
# SET names the data (bandai-2; cmu-dance and bandai-1 do as well); common.sh has the other variables. The masked figures are
# no likelihood and stand beside the causal ones in name alone.
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=${1:?$call} splits=${2:?$call} out=${3:?$call}
. "$(dirname "$0")/common.sh"
set=${SET:-bandai-2}

tokenizer "$set" "$data/$set" --labels "$splits/$set.csv" $(read_as "$set") --joints 13 --fps 20
corpus "$set" "$set" "$set"

cell() {
    name=$1
    shift
    configured "$out/runs/$name.toml" "$@"
    for seed in $seeds; do
        training pretrain "$name" "$seed" --config "$out/runs/$name.toml" --corpus "$out/corpora/$set"
        measured "$name" "$set" "$seed"
    done
}
plain="model.previous_frame=false model.head=\"absolute\""
for kind in causal masked; do
    for positions in absolute frame_joint rope; do
        cell "${kind}_$positions" "model.kind=\"$kind\"" "model.positions=\"$positions\"" $plain
    done
done
for positions in absolute frame_joint rope; do
    cell "ours_$positions" model.kind=\"causal\" "model.positions=\"$positions\"" \
        model.previous_frame=true model.head=\"relative\"
done
alone="model.kind=\"causal\" model.positions=\"frame_joint\""
cell ours_input_alone $alone model.previous_frame=true model.head=\"absolute\"
cell ours_head_alone $alone model.previous_frame=false model.head=\"relative\"
table "Positions, $set"
