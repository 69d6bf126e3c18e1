"""Movements through Blender and back: makes the files blender_*.bvh of crates/motion/tests/golden.

    pip install bpy==4.2.0      # Python 3.11; brings numpy; 4.5.15 writes the same bytes
    python scripts/reference/blender.py crates/motion/tests/golden

Two made-up movements on SMPL's joints, y up, in centimetres. The first tumbles: every joint turns every way, the body
stands nowhere. The second dances: upright, six steps of a walk that turns through half a circle, feet flat on the floor
y = 0 while they stand. Blender imports each NAME_y_up.bvh with its defaults (axis_forward -Z, axis_up Y, the scene's
rate from the file) and exports it with its defaults as NAME_z_up.bvh; its exporter writes z up. Prints the scene's rate
as Blender has it.
"""

import math
import sys
from pathlib import Path

import bpy
import numpy as np

# name, parent, offset in cm: a body that stands along y and faces z, its pelvis 96.1 cm above the tips of its feet
JOINTS = [
    ("pelvis", None, (0, 0, 0)),
    ("left_hip", "pelvis", (7, -9, 0)), ("left_knee", "left_hip", (3, -38, 1)),
    ("left_ankle", "left_knee", (-1, -41, -4)), ("left_foot", "left_ankle", (3, -6, 12)),
    ("right_hip", "pelvis", (-7, -9, 0)), ("right_knee", "right_hip", (-3, -38, 1)),
    ("right_ankle", "right_knee", (1, -41, -4)), ("right_foot", "right_ankle", (-3, -6, 12)),
    ("spine1", "pelvis", (0, 11, -2)), ("spine2", "spine1", (0, 14, 1)), ("spine3", "spine2", (0, 6, 1)),
    ("neck", "spine3", (0, 21, -3)), ("head", "neck", (0, 9, 5)),
    ("left_collar", "spine3", (7, 12, -2)), ("left_shoulder", "left_collar", (12, 5, -1)),
    ("left_elbow", "left_shoulder", (25, -1, -2)), ("left_wrist", "left_elbow", (25, 1, 0)),
    ("right_collar", "spine3", (-7, 12, -2)), ("right_shoulder", "right_collar", (-12, 5, -1)),
    ("right_elbow", "right_shoulder", (-25, -1, -2)), ("right_wrist", "right_elbow", (-25, 1, 0)),
]
NAMES = [name for name, _, _ in JOINTS]
OFFSETS = {name: np.array(offset, float) for name, _, offset in JOINTS}
TIP = 0.35  # an end site's offset, as a part of its joint's
ANKLE = 6 * (1 + TIP)  # how high an ankle is above a foot that stands


def text(rows, fps, digits):
    """A y-up file: `rows` of the pelvis's place and of Z, X, Y rotations in degrees, joints in the order of JOINTS."""
    lines = ["HIERARCHY"]

    def write(name, depth):
        pad = "  " * depth
        lines.append(f"{pad}{'JOINT' if depth else 'ROOT'} {name}\n{pad}{{")
        lines.append("{}  OFFSET {:.6f} {:.6f} {:.6f}".format(pad, *OFFSETS[name]))
        place = "" if depth else "Xposition Yposition Zposition "
        lines.append(f"{pad}  CHANNELS {3 if depth else 6} {place}Zrotation Xrotation Yrotation")
        children = [child for child, parent, _ in JOINTS if parent == name]
        for child in children:
            write(child, depth + 1)
        if not children:
            lines.append("{}  End Site\n{}  {{\n{}    OFFSET {:.6f} {:.6f} {:.6f}\n{}  }}".format(
                pad, pad, pad, *(TIP * OFFSETS[name]), pad))
        lines.append(pad + "}")

    write("pelvis", 0)
    lines += ["MOTION", f"Frames: {len(rows)}", "Frame Time: {:.10f}".format(1 / fps)]
    lines += [" ".join(f"{x:.{digits}f}" for x in row) for row in rows]
    return "\n".join(lines) + "\n"


def tumble(t):
    """A row in which every joint turns every way."""
    row = [40 * math.sin(3 * t), 97 + 3 * math.cos(9 * t), -30 * t]
    for k, name in enumerate(NAMES, 1):
        size = 60 if name == "pelvis" else 25
        row += [size * math.sin(k + 4 * t), 0.4 * size * math.cos(2 * k + 6 * t), size * math.sin(3 * k - 5 * t)]
    return row


BEAT_S = 0.5  # a step a beat
STRIDE, TURN = 18, 30  # cm and degrees from one mark on the floor to the next; the dance begins with a heading of 40


def turn(axis, degrees):
    """The rotation about x, y or z as a matrix."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    m = np.eye(3)
    m[i, i], m[i, j], m[j, i], m[j, j] = c, -s, s, c
    return m


def turns(**degrees):
    """Turns about axes, multiplied in the order in which they are written."""
    m = np.eye(3)
    for axis, angle in degrees.items():
        m = m @ turn(axis, angle)
    return m


def degrees_zxy(m):
    """The Z, X, Y rotations of a matrix."""
    angles = math.atan2(-m[0, 1], m[1, 1]), math.asin(max(-1.0, min(1.0, m[2, 1]))), math.atan2(-m[2, 0], m[2, 2])
    return [math.degrees(a) for a in angles]


def shortest(a, b):
    """The rotation by the shortest way from the direction of `a` to that of `b`."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    x, y, z = np.cross(a, b)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + cross + cross @ cross / (1 + a @ b)


def foot(side, t):
    """Place of a standing or stepping ankle, heading in degrees, and how far its step is up, 0 to 1; left is side 1."""

    def at(mark):
        headings = [40 + TURN * m for m in range(mark + 1)]
        centre = sum((turn("y", h) @ [0, 0, STRIDE] for h in headings[1:]), np.zeros(3))
        return centre + turn("y", headings[-1]) @ [10 * side, ANKLE, 0], headings[-1]

    step, phase = divmod(t / BEAT_S, 1)
    step = int(step)
    if (step % 2 == 0) != (side == 1):  # the other foot steps
        return *at(step), 0.0
    # both stand before and after
    s = max(0.0, min(1.0, (phase - 0.15) / 0.7))
    (a, ha), (b, hb) = at(max(step - 1, 0)), at(step + 1)
    part, up = s**3 * (10 - 15 * s + 6 * s * s), math.sin(math.pi * s) ** 2
    return a + part * (b - a) + [0, 8 * up, 0], ha + part * (hb - ha), up


def leg(local, name, pelvis, place, t):
    """Sets a leg's rotations so that its foot is where `foot` says."""
    ankle, heading, up = foot(1 if name == "left" else -1, t)
    thigh, shin = OFFSETS[f"{name}_knee"], OFFSETS[f"{name}_ankle"]
    reach = ankle - place - pelvis @ OFFSETS[f"{name}_hip"]
    low, high = 0.0, 150.0
    assert np.linalg.norm(thigh + shin) > np.linalg.norm(reach), "a step too long"
    for _ in range(60):
        bend = (low + high) / 2
        far = np.linalg.norm(thigh + turn("x", bend) @ shin) > np.linalg.norm(reach)
        low, high = (bend, high) if far else (low, bend)
    knee = turn("x", bend)
    ahead = turn("y", heading)
    hip = shortest(ahead @ (thigh + knee @ shin), reach) @ ahead
    # a foot that steps hangs down, its toes less
    local[f"{name}_hip"], local[f"{name}_knee"] = pelvis.T @ hip, knee
    local[f"{name}_ankle"] = (hip @ knee).T @ ahead @ turn("x", 25 * up)
    local[f"{name}_foot"] = turn("x", -15 * up)


def dance(t):
    """A row of a body that dances upright."""
    slow, quick = 2 * math.pi * t / (2 * BEAT_S), 2 * math.pi * t / BEAT_S
    sway, nod = math.sin(slow), math.sin(quick)
    (left, left_heading, _), (right, right_heading, _) = foot(1, t), foot(-1, t)
    heading = (left_heading + right_heading) / 2
    # over the foot that stands, down between steps, a crouch in the middle
    crouch = 7 * math.exp(-((t - 1.6) / 0.35) ** 2)
    place = (left + right) / 2 + turn("y", heading) @ [-2.5 * sway, 0, 3]
    place[1] = 90.5 + 1.2 * math.cos(quick) - crouch
    pelvis = turns(y=heading, x=5 + 4 * nod + crouch, z=4 * sway)

    local = {"pelvis": pelvis}
    for name in ("left", "right"):
        leg(local, name, pelvis, place, t)
    local |= {
        "spine1": turns(y=7 * sway, x=2 * nod), "spine2": turns(y=7 * sway, z=-4 * sway),
        "spine3": turns(x=-3 - 3 * nod), "neck": turns(y=-12 * math.cos(slow), x=4 * nod),
        "head": turns(y=-15 * math.cos(slow), z=6 * sway),
    }
    # one arm as the other half a bar later, mirrored; from hanging to above the head
    for name, side, s in (("left", 1, slow), ("right", -1, slow + 2.2)):
        local[f"{name}_collar"] = turns(z=side * 8 * math.sin(s))
        local[f"{name}_shoulder"] = turns(y=-side * (25 + 20 * math.cos(s)), z=side * (65 * math.sin(s) - 10))
        local[f"{name}_elbow"] = turns(y=-side * (50 + 40 * math.cos(s + 0.7)), x=20 * math.sin(s))
        local[f"{name}_wrist"] = turns(z=side * 25 * math.cos(2 * s), y=15 * math.sin(s))
    return [*place, *(angle for name in NAMES for angle in degrees_zxy(local[name]))]


def through_blender(source, target, frames, fps):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_enable(module="io_anim_bvh")
    bpy.ops.import_anim.bvh(filepath=str(source), axis_forward="-Z", axis_up="Y", update_scene_fps=True)
    render = bpy.context.scene.render
    print(f"Blender {bpy.app.version_string}: {render.fps} / {render.fps_base} frames per second")
    assert render.fps == fps and render.fps_base == 1.0
    bpy.ops.export_anim.bvh(filepath=str(target), frame_start=1, frame_end=frames)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    # the dance's angles have fewer digits, so that its files stay small
    for name, row, frames, fps, digits in (("blender", tumble, 30, 60, 6), ("blender_dance", dance, 64, 20, 4)):
        source = folder / f"{name}_y_up.bvh"
        source.write_text(text([row(f / fps) for f in range(frames)], fps, digits), newline="\n")
        through_blender(source, folder / f"{name}_z_up.bvh", frames, fps)
