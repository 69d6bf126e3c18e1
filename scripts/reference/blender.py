"""A dance through Blender and back: makes motion/tests/golden/blender_y_up.bvh, and from it blender_z_up.bvh.

    pip install bpy==4.2.0      # Python 3.11; 4.5 does too
    python scripts/reference/blender.py motion/tests/golden

The first file is a made-up movement on SMPL's joints, y up, in centimetres, 30 frames at 60 frames a second. Blender
imports it with its defaults (axis_forward -Z, axis_up Y, the scene's rate from the file) and exports it with its
defaults; its exporter writes z up. Prints the scene's rate as Blender has it.
"""

import math
import sys
from pathlib import Path

FRAMES, FPS = 30, 60
# name, parent, offset in cm: a body that stands along y and faces z
JOINTS = [
    ("pelvis", None, (0, 0, 0)),
    ("left_hip", "pelvis", (7, -9, 0)), ("left_knee", "left_hip", (3, -38, 1)), ("left_ankle", "left_knee", (-1, -41, -4)),
    ("left_foot", "left_ankle", (3, -6, 12)),
    ("right_hip", "pelvis", (-7, -9, 0)), ("right_knee", "right_hip", (-3, -38, 1)),
    ("right_ankle", "right_knee", (1, -41, -4)), ("right_foot", "right_ankle", (-3, -6, 12)),
    ("spine1", "pelvis", (0, 11, -2)), ("spine2", "spine1", (0, 14, 1)), ("spine3", "spine2", (0, 6, 1)),
    ("neck", "spine3", (0, 21, -3)), ("head", "neck", (0, 9, 5)),
    ("left_collar", "spine3", (7, 12, -2)), ("left_shoulder", "left_collar", (12, 5, -1)),
    ("left_elbow", "left_shoulder", (25, -1, -2)), ("left_wrist", "left_elbow", (25, 1, 0)),
    ("right_collar", "spine3", (-7, 12, -2)), ("right_shoulder", "right_collar", (-12, 5, -1)),
    ("right_elbow", "right_shoulder", (-25, -1, -2)), ("right_wrist", "right_elbow", (-25, 1, 0)),
]


def made_up():
    """The text of the y-up file."""
    lines, names = ["HIERARCHY"], [name for name, _, _ in JOINTS]

    def write(name, offset, depth):
        pad = "  " * depth
        lines.append(f"{pad}{'JOINT' if depth else 'ROOT'} {name}\n{pad}{{")
        lines.append("{}  OFFSET {:.6f} {:.6f} {:.6f}".format(pad, *offset))
        place = "" if depth else "Xposition Yposition Zposition "
        lines.append(f"{pad}  CHANNELS {3 if depth else 6} {place}Zrotation Xrotation Yrotation")
        children = [(n, o) for n, parent, o in JOINTS if parent == name]
        for child, o in children:
            write(child, o, depth + 1)
        if not children:
            lines.append("{}  End Site\n{}  {{\n{}    OFFSET {:.6f} {:.6f} {:.6f}\n{}  }}".format(
                pad, pad, pad, *(0.3 * x for x in offset), pad))
        order.append(name)
        lines.append(pad + "}")

    order = []
    write("pelvis", (0, 0, 0), 0)
    lines += ["MOTION", f"Frames: {FRAMES}", "Frame Time: {:.10f}".format(1 / FPS)]
    hierarchy = [line.split()[-1] for line in "\n".join(lines).splitlines() if line.split()[:1] in (["ROOT"], ["JOINT"])]
    for f in range(FRAMES):
        t = f / FPS
        row = [40 * math.sin(3 * t), 97 + 3 * math.cos(9 * t), -30 * t]
        for name in hierarchy:
            k = 1 + names.index(name)
            size = 60 if name == "pelvis" else 25
            row += [size * math.sin(k + 4 * t), 0.4 * size * math.cos(2 * k + 6 * t), size * math.sin(3 * k - 5 * t)]
        lines.append(" ".join(f"{x:.6f}" for x in row))
    return "\n".join(lines) + "\n"


def through_blender(source, target):
    import bpy

    bpy.ops.preferences.addon_enable(module="io_anim_bvh")
    bpy.ops.import_anim.bvh(filepath=str(source), axis_forward="-Z", axis_up="Y", update_scene_fps=True)
    render = bpy.context.scene.render
    print(f"Blender {bpy.app.version_string}: {render.fps} / {render.fps_base} frames per second")
    assert render.fps == FPS and render.fps_base == 1.0
    bpy.ops.export_anim.bvh(filepath=str(target), frame_start=1, frame_end=FRAMES)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    source = folder / "blender_y_up.bvh"
    source.write_text(made_up(), newline="\n")
    through_blender(source, folder / "blender_z_up.bvh")
