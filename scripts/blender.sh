#!/bin/sh
# Builds the extension for Blender: a zip for each platform that there is a wheel for, by Blender's own `extension build`.
#
#     scripts/blender.sh OUT [WHEEL..]        WHEEL: what scripts/release.sh built; without one, one of this checkout
#
# Needs Python 3.11. Blender is its module `bpy`, installed from PyPI into WORK/bpy-VERSION as scripts/importers does.
# Variables: WORK (target/importers), BLENDER_BUILD (4.5.15: the version that builds).
set -eu
fail() {
    echo "blender.sh: $1" >&2
    exit 1
}
[ $# -ge 1 ] || fail "the call is: scripts/blender.sh OUT [WHEEL..]"
out=$(realpath -m "$1")
shift
for wheel; do
    case $wheel in *.whl) [ -f "$wheel" ] || fail "$wheel is not there" ;; *) fail "$wheel; expected a .whl" ;; esac
done
root=$(realpath "$(dirname "$0")/..")
target=$(realpath -m "${CARGO_TARGET_DIR:-$root/target}")
stage=$target/blender
rm -rf "$stage"
mkdir -p "$stage/wheels" "$out"
if [ $# = 0 ]; then
    [ -x "$target/release-tools/bin/python" ] || python3 -m venv "$target/release-tools"
    "$target/release-tools/bin/pip" install --quiet maturin==1.16.0
    CARGO_TARGET_DIR=$target "$target/release-tools/bin/maturin" build --release --locked --compatibility linux \
        --manifest-path "$root/bindings/python/Cargo.toml" --out "$stage/wheels"
else
    cp "$@" "$stage/wheels/"
fi

versions=${BLENDER_BUILD:-4.5.15} work=${WORK:-$target/importers}
. "$root/scripts/importers/bpy.sh"
python=$work/bpy-$versions/bin/python
build=$(echo "$work/bpy-$versions"/lib/python3*/site-packages/bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py)

cp -r "$root/bindings/blender/extension" "$stage/extension"
rm -rf "$stage/extension/__pycache__"
cp -r "$stage/wheels" "$stage/extension/wheels"
"$python" - "$stage/extension" "$(sed -n 's/^version = "\(.*\)"/\1/p' "$root/Cargo.toml" | head -1)" <<'PYTHON'
import pathlib, sys
folder = pathlib.Path(sys.argv[1])
kinds = {"manylinux": "linux", "linux": "linux", "macosx": "macos", "win": "windows"}
wheels = sorted(wheel.name for wheel in (folder / "wheels").glob("*.whl"))
platforms = set()
for wheel in wheels:
    tag = wheel.removesuffix(".whl").rsplit("-", 1)[1]
    system = next(kinds[kind] for kind in kinds if tag.startswith(kind))
    platforms.add(system + ("-arm64" if tag.endswith(("arm64", "aarch64")) else "-x64"))
manifest = folder / "blender_manifest.toml"
text = manifest.read_text().replace('version = "0.0.0"', f'version = "{sys.argv[2]}"')
text = text.replace("platforms = []", f"platforms = {sorted(platforms)}".replace("'", '"'))
text = text.replace("wheels = []", f"wheels = {['./wheels/' + wheel for wheel in wheels]}".replace("'", '"'))
manifest.write_text(text)
PYTHON
"$python" "$build" validate "$stage/extension"
"$python" "$build" build --split-platforms --source-dir "$stage/extension" --output-dir "$out"
ls -l "$out"
