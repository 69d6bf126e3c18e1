#!/bin/sh
# The thesis's table 4.6 on the test dances of cmu-dance: trained on them alone, trained on all three sets, and from there on
# cmu-dance at two learning rates. All read one tokenizer, so the bits compare.
#
#     sh ../shared/data/unpack.sh DATA && scripts/reproduce/pretraining.sh DATA ../shared/data/splits OUT
#
# FORM=thesis (default: ours) trains the thesis's model. STEPS is for the trainings from nothing, TUNE (a third of it) for
# the tuning; common.sh has the other variables. The best checkpoint on the validation clips counts.
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=${1:?$call} splits=${2:?$call} out=${3:?$call}
. "$(dirname "$0")/common.sh"
form=${FORM:-ours} all=$steps tune=${TUNE:-$((steps / 3))}
case $form in
ours) keys="" ;;
thesis) keys='model.positions="absolute" model.previous_frame=false model.head="absolute"' ;;
*) fail "FORM=$form; expected ours or thesis" ;;
esac

# one call reads all three, so that what differs stands in the labels
awk -v OFS=, 'NR == 1 { print $0, "skip" } NR > 1 { print $0, 10 }' "$splits/cmu-dance.csv" > "$out/cmu-dance.csv"
tokenizer all "$data/cmu-dance" "$data/bandai-1" "$data/bandai-2" \
    --labels "$out/cmu-dance.csv" --labels "$splits/bandai-1.csv" --labels "$splits/bandai-2.csv" --joints 13 --fps 20
for set in cmu-dance bandai-1 bandai-2; do corpus "$set" "$set" all; done
at=$out/corpora

configured "$out/runs/first.toml" "train.eval_every=$((all / 10 + 1))" $keys
for rate in 2e-4 1e-4; do
    configured "$out/runs/tune_$rate.toml" "train.learning_rate=$rate" \
        "train.warmup=$((tune / 10))" "train.eval_every=$((tune / 10 + 1))" $keys
done
for seed in $seeds; do
    steps=$all
    training pretrain scratch "$seed" --config "$out/runs/first.toml" --corpus "$at/cmu-dance"
    measured scratch cmu-dance "$seed"
    training pretrain pretrained "$seed" --config "$out/runs/first.toml" \
        --corpus "$at/cmu-dance=1" --corpus "$at/bandai-1=1" --corpus "$at/bandai-2=2"
    measured pretrained cmu-dance "$seed"
    steps=$tune
    for rate in 2e-4 1e-4; do
        training finetune "tuned_$rate" "$seed" --from "$out/runs/pretrained-$seed" \
            --config "$out/runs/tune_$rate.toml" --corpus "$at/cmu-dance"
        measured "tuned_$rate" cmu-dance "$seed"
    done
done
steps=$all
table "Pre-training, $form, then $tune of tuning"
