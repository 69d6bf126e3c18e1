#!/bin/sh
# The tables of docs/results/interpolation.md: two dances and what lies between, by DCT, PCA and STFT, over twelve pairs of
# each set, and how many blends of the test salsas shake, at five times.
#
#     sh ../shared/data/unpack.sh DATA && scripts/reproduce/interpolation.sh DATA ../shared/data/splits OUT
#
# Whatever is done is kept: called again, it goes on where it stood. OUT/results.jsonl has a line a blend, OUT/table.md the
# tables. KINELM names the program (target/release/kinelm).
set -eu
here=$(cd "$(dirname "$0")/../.." && pwd)
[ $# -eq 3 ] || { sed -n '2,8s/^# *//p' "$0" >&2; exit 2; }
kinelm=${KINELM:-$here/target/release/kinelm}
fail() { echo "interpolation.sh: $*" >&2; exit 1; }
[ -x "$kinelm" ] || fail "$kinelm is not there; build it with cargo build --release, or name it by KINELM"
[ -d "$1" ] || fail "$1 is not there; unpack the motion with sh ../shared/data/unpack.sh DATA"
mkdir -p "$3/clips" "$3/blends"
python3 "$here/scripts/reproduce/interpolation.py" "$kinelm" "$1" "$2" "$3"
cat "$3/table.md"
