#!/bin/sh
# Whether a dance on a character comes back right from Khronos's validator, three.js, Babylon.js and Blender: nothing new to
# complain of, joints within 0.1 mm, vertices with their bones.
#
#     scripts/importers/onto.sh WORK DANCE HERO..       DANCE: a motion file; HERO: a .glb or .vrm with a mesh
#
# WORK keeps what is installed from PyPI and npm. Variables: BPY ("4.2.0 4.5.15 5.0.1": Blender versions; Python 3.11),
# KINELM, PYTHON with numpy. character.py makes heroes.
set -eu
call="the call is: $0 WORK DANCE HERO.."
work=${1:?$call} dance=${2:?$call}
shift 2
. "$(dirname "$0")/install.sh"

failed=0
check() {
    "$python" "$here/compare.py" "$work/own.npz" "$work/theirs.json" 0.1 || failed=1
}
for hero in "$@"; do
    out=$work/onto.glb
    echo "$hero"
    "$kinelm" convert "$dance" "$out" --onto "$hero" --fps 30 --force --quiet
    "$kinelm" convert "$out" "$work/own.npz" --take onto --positions --force --quiet
    (cd "$work" && node "$here/three.mjs" "$out" 30 "$work/theirs.json" onto "$hero") || failed=1
    check
    (cd "$work" && node "$here/babylon.mjs" "$out" 30 "$work/theirs.json" onto) || failed=1
    check
    for version in $versions; do
        "$work/bpy-$version/bin/python" "$here/blender.py" "$out" 30 "$work/theirs.json" onto > "$work/blender.log" 2>&1 ||
            { cat "$work/blender.log"; failed=1; continue; }
        check
    done
done
exit $failed
