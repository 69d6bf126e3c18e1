#!/bin/sh
# The tests of the Python package, or those that are named, on the library that `cargo build --release --workspace` left. Needs
# Python 3.10 and numpy, which it puts into a virtual environment if it isn't there.
set -eu
cd "$(dirname "$0")/.."
target=$(realpath "${CARGO_TARGET_DIR:-target}")
place=$target/python
rm -rf "$place/kinelm"
mkdir -p "$place"
cp -r bindings/python/kinelm "$place/kinelm"
cp "$target/release/lib_kinelm.so" "$place/kinelm/_kinelm.abi3.so"
python=${PYTHON:-python3}
"$python" -c 'import numpy' 2>/dev/null || {
    { [ -e "$place/venv/bin/python" ] || python3 -m venv "$place/venv"; } && "$place/venv/bin/pip" install --quiet numpy || {
        echo "SKIPPED the Python package: no numpy, and none could be installed"
        exit 0
    }
    python=$place/venv/bin/python
}
cd bindings/python/tests
[ $# -gt 0 ] || set -- discover
PYTHONPATH=$place "$python" -m unittest "$@" --verbose
