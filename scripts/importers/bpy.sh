# Read with WORK in $work and $versions: installs Blender there as a module, bpy-VERSION for each. Those before 5.1 are for
# Python 3.11, later ones for 3.13.
mkdir -p "$work"
work=$(cd "$work" && pwd)
for version in $versions; do
    [ -d "$work/bpy-$version" ] || {
        case $version in 4.* | 5.0.*) of=3.11 ;; *) of=3.13 ;; esac
        "python$of" -m venv "$work/bpy-$version"
        "$work/bpy-$version/bin/pip" install --quiet "bpy==$version"
    }
done
