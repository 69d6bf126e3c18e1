#!/bin/sh
# The extension's tests in each version of Blender, one after the other.
#
#     bindings/blender/tests/check.sh ZIP [TEST..]        ZIP: what scripts/blender.sh built for this machine
#
# Blender is its module `bpy`, installed from PyPI into WORK/bpy-VERSION. Variables: WORK (target/importers), BPY ("4.2.0
# 4.5.15 5.0.1 5.3.0"). Versions before 5.1 need Python 3.11, later ones 3.13.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
zip=$(realpath "${1:?the call is: $0 ZIP [TEST..]}")
shift
root=$here/../../..
versions=${BPY-4.2.0 4.5.15 5.0.1 5.3.0} work=${WORK:-$root/target/importers}
. "$root/scripts/importers/bpy.sh"
failed=0
for version in $versions; do
    # a user's folder of its own, as nothing may be installed there yet
    user=$(mktemp -d)
    (cd "$here" && BLENDER_USER_RESOURCES=$user KINELM_ZIP=$zip PYTHONDONTWRITEBYTECODE=1 \
        "$work/bpy-$version/bin/python" test_extension.py "$@") || failed=1
    rm -rf "$user"
done
exit $failed
