#!/bin/sh
# Whether a dance as a VRM animation comes back right from three-vrm, on the avatar that it was made for and on others: joints
# within 0.1 mm, and nothing that Khronos's validator complains of.
#
#     scripts/importers/vrm.sh WORK DANCE AVATAR..      DANCE: a motion file; AVATAR: a .vrm
#
# WORK keeps what is installed from npm. Variables: KINELM, PYTHON with numpy. character.py makes avatars. On another avatar,
# its hips must be where those of the first are, by the ratio of how high both are at rest; how far joints are from those of
# kinelm's own dance on it, hips on hips, is printed, and held to 0.1 mm only with TWIN=1: where both stand alike in the T-pose.
set -eu
call="the call is: $0 WORK DANCE AVATAR.."
work=${1:?$call} dance=${2:?$call}
shift 2
BPY=
. "$(dirname "$0")/install.sh"

failed=0 dance=$(realpath "$dance") limit=${TWIN:+0.1}
own() { "$kinelm" convert "$dance" "$1" --onto "$2" --fps 30 --positions --force --quiet; }
check() { # what kinelm has, how it is compared
    "$python" "$here/compare.py" "$1" "$work/theirs.json" "$2" "$3" ${4:+"$4"} || failed=1
}
for avatar in "$@"; do
    "$kinelm" convert "$dance" "$work/x.vrma" --onto "$avatar" --fps 30 --force --quiet
    own "$work/own.npz" "$avatar"
    for player in "$@"; do
        echo "for $(basename "$avatar"), on $(basename "$player")"
        player=$(realpath "$player")
        (cd "$work" && node "$here/vrm.mjs" x.vrma 30 theirs.json "$player") || { failed=1; continue; }
        if [ "$player" = "$(realpath "$avatar")" ]; then
            check "$work/own.npz" 0.1 --floor
        else
            own "$work/player.npz" "$player"
            check "$work/player.npz" "${limit:-inf}" --hips "$work/own.npz"
        fi
    done
done
exit $failed
