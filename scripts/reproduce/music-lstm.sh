#!/bin/sh
# The tables of docs/results/music-lstm.md: the music-to-dance dissertation's system on the salsas and Indian dances of
# cmu-dance, with pieces of Debian's openttd-openmsx (GPL-2) laid beside, rendered by fluidsynth.
#
#     apt-get install openttd-openmsx fluidsynth timgm6mb-soundfont
#     scripts/reproduce/music-lstm.sh DATA SPLITS OUT
#
# DATA and SPLITS as ../shared/data/unpack.sh leaves them. What is there is not made again, and a run that was stopped goes
# on. Variables: STEPS of every run (the configuration's, 3000), SEED (1), CONFIG (small), FRAMES of the long dance (12000),
# ROWS (all), THREADS (1), KINELM.
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=${1:?$call} splits=${2:?$call} out=${3:?$call}
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm}
threads="--threads ${THREADS:-1} --quiet"
midi=${MIDI:-/usr/share/games/openttd/baseset/openmsx} font=${FONT:-/usr/share/sounds/sf2/TimGM6mb.sf2}
mkdir -p "$out/music"
for piece in "$midi"/*.mid; do
    wav=$out/music/$(basename "$piece" .mid).wav
    [ -e "$wav" ] || {
        fluidsynth -ni -q -r 22050 -g 0.5 -T wav -F "$out/music/new" "$font" "$piece"
        mv "$out/music/new" "$wav"
    }
done
python3 "$here/scripts/reproduce/music_lstm.py" assign "$splits/cmu-dance.csv" "$out/music" > "$out/labels.csv"

# NAME OPTIONS.. : a run and its figures
row() {
    name=$1
    shift
    case " ${ROWS:-$name} " in *" $name "*) ;; *) return 0 ;; esac
    run=$out/$name
    if [ ! -e "$run.done" ]; then
        if [ -e "$run/config.toml" ]; then
            "$kinelm" music-lstm resume "$run" ${STEPS:+--steps "$STEPS"} $threads
        else
            "$kinelm" music-lstm train "$data/cmu-dance" --labels "$out/labels.csv" --music "$out/music" \
                --config "${CONFIG:-small}" ${STEPS:+--set "steps=$STEPS"} --set "seed=${SEED:-1}" --run "$run" "$@" $threads
        fi
        touch "$run.done"
    fi
    [ -e "$run.json" ] || {
        "$kinelm" music-lstm evaluate --run "$run" --frames "${FRAMES:-12000}" --json $threads > "$run.new"
        mv "$run.new" "$run.json"
    }
}

row mse
row every-4 --set effort=corrected
row every-4-compat --set effort=compat
row effort-compat --set pose=none --set effort=compat --set effort_every=1
row effort --set pose=none --set effort=corrected --set effort_every=1
row mse-compat-audio --set audio=compat
row teacher-0 --set teacher=0
row mse-numbers --set pose=compat
python3 "$here/scripts/reproduce/music_lstm.py" table "$out"
