#!/bin/sh
# The tables of docs/results/query.md: unpacks the shared motion, asks for every window of both sets with `kinelm query evaluate`, and
# leaves the Markdown tables in OUT/tables.md and all figures in OUT/*.json.
#
#   scripts/reproduce/query.sh [OUT] [-- what every evaluation is given beside, such as --run RUN or --no-dc]
#
# OUT is target/query unless given. What is there is kept. Needs Rust, tar, xz and the shared data beside the checkout.
set -eu
cd "$(dirname "$0")/../.."
out=target/query
case ${1:-} in
--) shift ;;
"") ;;
*) out=$1 && shift && [ "${1:-}" != -- ] || shift ;;
esac
shared=../shared/data data=${DATA:-target/shared-data} kinelm=${KINELM:-target/release/kinelm}
if [ -z "${DATA:-}" ]; then
    [ -f "$shared/unpack.sh" ] || { echo "query.sh: $shared/unpack.sh is not there: the motion is not on hand" >&2; exit 1; }
    sh "$shared/unpack.sh" "$data"
fi
[ -n "${KINELM:-}" ] || cargo build --release --locked --quiet
mkdir -p "$out"
echo "processors: $(getconf _NPROCESSORS_ONLN), load: $(cut -d' ' -f1-3 /proc/loadavg 2>/dev/null || echo unknown)"
# NAME TITLE SET OPTIONS.. : tables and figures of one evaluation
measured() {
    name=$1 title=$2 set=$3
    shift 3
    [ -e "$out/$name.md" ] || {
        "$kinelm" query evaluate "$data/$set" --labels "$shared/splits/$set.csv" "$@" \
            --markdown --save "$out/$name.json" --quiet > "$out/$name.new"
        mv "$out/$name.new" "$out/$name.md"
    }
    { echo "### $title"; echo; cat "$out/$name.md"; echo; } >> "$out/tables.new"
    echo "$title: $out/$name.json"
}
: > "$out/tables.new"
measured bandai-2 "bandai-2" bandai-2 --fields content,style "$@"
measured cmu-dance "cmu-dance" cmu-dance --skip 10 --fields genre "$@"
measured salsa "cmu-dance, salsa" cmu-dance --skip 10 --only genre=salsa --fields dancer "$@"
mv "$out/tables.new" "$out/tables.md"
echo "$out/tables.md"
