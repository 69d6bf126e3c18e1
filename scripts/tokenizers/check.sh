#!/bin/sh
# Whether the oldest and the newest release of Hugging Face's tokenizers give the ids and texts of
# tokenizer/tests/golden/tokenizer_ids.json, which another release made.
#
#     scripts/tokenizers/check.sh WORK
#
# WORK keeps what is installed from PyPI. Variables: VERSIONS ("0.13.3 1.0.0rc3"); PYTHON (python3.11, for which all of them
# have a wheel).
set -eu
call="the call is: $0 WORK"
work=${1:?$call}
here=$(cd "$(dirname "$0")" && pwd) root=$(cd "$(dirname "$0")/../.." && pwd)
mkdir -p "$work"
work=$(cd "$work" && pwd)
# as the tests have built it
cargo build --release --locked --quiet --manifest-path "$root/Cargo.toml" --workspace --example golden_tokenizer
for kind in plain merged; do
    "${CARGO_TARGET_DIR:-$root/target}/release/examples/golden_tokenizer" $kind > "$work/$kind.json"
done
for version in ${VERSIONS-0.13.3 1.0.0rc3}; do
    [ -e "$work/$version/done" ] || {
        "${PYTHON:-python3.11}" -m venv "$work/$version"
        "$work/$version/bin/pip" install --quiet --only-binary :all: "tokenizers==$version"
        touch "$work/$version/done"
    }
    "$work/$version/bin/python" "$here/load.py" "$root/tokenizer/tests/golden/tokenizer_ids.json" \
        "$work/plain.json" "$work/merged.json"
done
