#!/bin/sh
# The tables of docs/results/tokenization.md: unpacks the shared motion, runs `kinelm tokenizer study` on both sets with the thirteen
# joints and with all 24, and leaves the Markdown tables in OUT/tables.md.
#
#   scripts/reproduce/tokenization.sh [OUT] [-- what every study is given beside, such as --schemes FILE or --force]
#
# OUT is target/tokenization unless given. A study that was interrupted goes on where it stood. Needs Rust, tar, xz and the
# shared data beside the checkout.
set -eu
cd "$(dirname "$0")/../.."
out=target/tokenization
case ${1:-} in
--) shift ;;
"") ;;
*) out=$1 && shift && [ "${1:-}" != -- ] || shift ;;
esac
shared=../shared/data
[ -f "$shared/unpack.sh" ] || { echo "tokenization.sh: $shared/unpack.sh is not there: the motion is not on hand" >&2; exit 1; }
sh "$shared/unpack.sh" target/shared-data
cargo build --release --locked --quiet
mkdir -p "$out"
echo "processors: $(getconf _NPROCESSORS_ONLN), load: $(cut -d' ' -f1-3 /proc/loadavg 2>/dev/null || echo unknown)"
: > "$out/tables.new"
study() {
    set=$1 joints=$2
    shift 2
    target/release/kinelm tokenizer study "target/shared-data/$set" --labels "$shared/splits/$set.csv" \
        --joints "$joints" --out "$out/$set-$joints" "$@" > /dev/null
    { echo "# $set, $joints joints"; tail -n +2 "$out/$set-$joints/study.md"; echo; } >> "$out/tables.new"
    echo "$set, $joints joints: $out/$set-$joints"
}
for joints in 13 24; do
    study cmu-dance "$joints" --skip 10 "$@"
    study bandai-2 "$joints" "$@"
done
mv "$out/tables.new" "$out/tables.md"
echo "$out/tables.md"
