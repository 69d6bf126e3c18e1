#!/bin/sh
# Whether Blender, three.js and Khronos's validator read what `convert --for` writes, joints within 0.1 mm.
#
#     scripts/importers/check.sh WORK FILE..        FILE: a motion file of any kind
#
# WORK keeps what is installed from PyPI and npm. Variables: BPY ("4.2.0 4.5.15 5.0.1": Blender versions; Python 3.11),
# KINELM, PYTHON with numpy.
set -eu
call="the call is: $0 WORK FILE.."
work=${1:?$call}
shift
. "$(dirname "$0")/install.sh"

failed=0
check() { # program's output, of which file
    "$python" "$here/compare.py" "$work/own.npz" "$work/theirs.json" 0.1 || failed=1
}
for file in "$@"; do
    for kind in blender.bvh blender.glb three.bvh three.glb unreal.glb; do
        out=$work/$(basename "${file%.*}").$kind
        "$kinelm" convert "$file" "$out" --for "${kind%.*}" --fps 30 --force --quiet
        "$kinelm" convert "$out" "$work/own.npz" --positions --force --quiet
        echo "$out"
        if [ "${kind%.*}" = blender ]; then
            for version in $versions; do
                "$work/bpy-$version/bin/python" "$here/blender.py" "$out" 30 "$work/theirs.json" > "$work/blender.log" 2>&1 ||
                    { cat "$work/blender.log"; failed=1; continue; }
                check
            done
        else
            (cd "$work" && node "$here/three.mjs" "$out" 30 "$work/theirs.json") && check
        fi
    done
done
exit $failed
