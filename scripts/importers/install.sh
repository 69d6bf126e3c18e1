# Read by check.sh, onto.sh and vrm.sh, with WORK in $work: installs the importers there, and sets here, kinelm and python.
here=$(cd "$(dirname "$0")" && pwd)
kinelm=${KINELM:-$here/../../target/release/kinelm} python=${PYTHON:-python3}
versions=${BPY-4.2.0 4.5.15 5.0.1}
. "$here/bpy.sh"
# core and loaders of one version
[ -d "$work/node_modules/@babylonjs" ] && [ -d "$work/node_modules/@pixiv" ] ||
    (cd "$work" && npm install --silent three@0.187.0 gltf-validator @babylonjs/core@9.28.0 @babylonjs/loaders@9.28.0 \
        @pixiv/three-vrm@3.5.5 @pixiv/three-vrm-animation@3.5.5)
