"""Actions: their curves in every version of Blender, and new keys in some frames of them.

Until 4.3 an action has the curves of one object; since 4.4 it has slots, one per object, and the curves of a slot are in a
channelbag of a strip of a layer. Of both this needs `fcurves` and `groups`, and calls them a bag.
"""

import bpy
import numpy as np
from mathutils import Euler, Quaternion

from .armature import Refused

# the properties of a key: numbers each, type; enums are numbers to foreach_get
FIELDS = {
    "co": (2, np.float32), "handle_left": (2, np.float32), "handle_right": (2, np.float32), "interpolation": (1, np.int32),
    "easing": (1, np.int32), "handle_left_type": (1, np.int32), "handle_right_type": (1, np.int32), "type": (1, np.int32),
    "amplitude": (1, np.float32), "back": (1, np.float32), "period": (1, np.float32),
    "select_control_point": (1, bool), "select_left_handle": (1, bool), "select_right_handle": (1, bool)}
LINEAR, AUTO_CLAMPED = 1, 4


def bag(action, slot, obj=None):
    """The curves of a slot, None where it has none; with an object they, and its slot, are made. Before 4.4 the action."""
    if not hasattr(action, "layers"):
        return action
    layers = action.layers
    if len(layers) > 1 or any(len(layer.strips) > 1 for layer in layers):
        raise Refused(f"{action.name} has {len(layers)} layers, or several strips in one; expected one of each: merge them")
    if not obj:
        return layers[0].strips[0].channelbag(slot) if slot and layers and layers[0].strips else None
    layer = layers[0] if layers else layers.new("Layer")
    strip = layer.strips[0] if layer.strips else layer.strips.new(type="KEYFRAME")
    return strip.channelbag(slot or action.slots.new(obj.id_type, obj.name), ensure=True)


def slot_of(obj):
    """The slot of an object's action, None before 4.4."""
    return getattr(obj.animation_data, "action_slot", None)


def action_of(obj):
    """The action that can be edited, with the frames that it spans."""
    data = obj.animation_data
    if not data or not data.action:
        raise Refused(f"{obj.name} has no action; expected one that moves it: choose it in the action editor")
    if data.use_tweak_mode:
        raise Refused(f"a strip of {obj.name} is tweaked in the NLA editor; expected its own action: leave tweak mode (Tab)")
    if hasattr(data, "action_slot") and not data.action_slot:
        raise Refused(f"{data.action.name} has no slot for {obj.name}; choose one beside the action's name")
    first, last = (round(frame) for frame in data.action.curve_frame_range)
    return data.action, first, last


def moves(action, slot, bones, frames):
    """Whether a slot of an action moves some of these bones, for so many frames."""
    first, last = action.curve_frame_range
    paths = tuple(f'pose.bones["{bpy.utils.escape_identifier(bone)}"]' for bone in bones)
    return last - first >= frames and any(curve.data_path.startswith(paths) for curve in getattr(bag(action, slot), "fcurves", ()))


def assign(obj, action, identifier=None):
    """Makes an action an object's, with the slot of that identifier or its only one."""
    data = obj.animation_data or obj.animation_data_create()
    data.action = action
    if action and hasattr(action, "slots"):
        data.action_slot = next((s for s in action.slots if s.identifier == identifier), action.slots[0])


def keys_of(curve):
    """The keys of a curve, as an array per property."""
    keys = {}
    for name, (width, kind) in FIELDS.items():
        keys[name] = np.zeros(len(curve.keyframe_points) * width, kind)
        curve.keyframe_points.foreach_get(name, keys[name])
        keys[name] = keys[name].reshape(-1, width)
    return keys


def _new_keys(frames, values):
    """Linear keys; their handles are where Blender puts those of straight lines."""
    count, third = len(frames), np.array([1 / 3, 0], np.float32)
    keys = {name: np.zeros((count, width), kind) for name, (width, kind) in FIELDS.items()}
    keys["co"] = np.stack([frames, values], 1).astype(np.float32)
    keys["handle_left"], keys["handle_right"] = keys["co"] - third, keys["co"] + third
    keys["interpolation"][:] = LINEAR
    keys["handle_left_type"][:] = keys["handle_right_type"][:] = AUTO_CLAMPED
    return keys


def splice(curve, first, values, span, before):
    """Puts a key with a new value into every frame from `first`, and leaves all other keys as they are, bit for bit.

    A segment of the curve that reaches into the new frames from outside has a key in each of its other frames, with the value
    that it had there, so that these move as before. `span`: first and last frame of the action, None of a new one. `before`:
    the value of a curve without keys.
    """
    if len(curve.sampled_points):
        raise Refused(f"{curve.data_path} is baked to samples; expected keys: unbake it (Key, Samples to Keys)")
    active = next((m for m in curve.modifiers if m.active and not m.mute), None)
    if active:
        raise Refused(f"{curve.data_path}[{curve.array_index}] has the modifier {active.type}, which would move new keys, "
                      "too; mute it or bake the action")
    own, last = keys_of(curve), first + len(values) - 1
    at = own["co"][:, 0]
    held = []
    if span:
        left, right = at[at < first], at[at > last]
        if first > span[0]:
            held += range(int(np.floor(left.max())) + 1 if len(left) else first - 1, first)
        if last < span[1]:
            held += range(last + 1, int(np.ceil(right.min())) if len(right) else last + 2)
    kept = [curve.evaluate(frame) if len(at) else before for frame in held]
    made = _new_keys(np.array([*range(first, last + 1), *held]), np.array([*values, *kept]))
    outside = (at < first) | (at > last)
    merged = {name: np.concatenate([own[name][outside], made[name]]) for name in FIELDS}
    order = np.argsort(merged["co"][:, 0], kind="stable")
    points = curve.keyframe_points
    points.clear()
    points.add(len(order))
    for name in FIELDS:
        points.foreach_set(name, merged[name][order].ravel())
    # no update(): it would compute the handles of the neighbours anew


ROTATIONS = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}


def _rotations(bone, bases, before):
    """The values (F, C) of a bone's rotation property that turn it as matrices do, going on from `before`."""
    values = [basis.to_quaternion() for basis in bases]
    if bone.rotation_mode not in ROTATIONS:
        before = Euler(before, bone.rotation_mode)
        for n, q in enumerate(values):
            before = values[n] = q.to_euler(bone.rotation_mode, before)
        return np.array(values)
    before = Quaternion(before) if bone.rotation_mode == "QUATERNION" else Quaternion(before[1:], before[0])
    for q in values:
        # q and -q are one rotation; keys must not jump between them
        if q.dot(before) < 0:
            q.negate()
        before = q
    values = np.array(values)
    if bone.rotation_mode == "QUATERNION":
        return values
    # not q.angle, whose arc cosine is off by hundredths of a degree for small angles
    length = np.linalg.norm(values[:, 1:], axis=1)
    axes = np.where(length[:, None] > 0, values[:, 1:] / np.maximum(length, 1e-30)[:, None], [0, 1, 0])
    return np.column_stack([2 * np.arctan2(length, values[:, 0]), axes])


def key_bone(curves, bone, first, bases, moves, span):
    """Keys a bone's rotation in frames from `first`, and its location where it `moves`."""
    for name in [ROTATIONS.get(bone.rotation_mode, "rotation_euler"), *(["location"] if moves else [])]:
        data_path = f'pose.bones["{bpy.utils.escape_identifier(bone.name)}"].{name}'
        own = [curves.fcurves.find(data_path, index=index) for index in range(len(getattr(bone, name)))]
        before = [curve.evaluate(first - 1) if curve else value for curve, value in zip(own, getattr(bone, name))]
        locations = name == "location"
        values = np.array([basis.translation for basis in bases]) if locations else _rotations(bone, bases, before)
        for index, curve in enumerate(own):
            if not curve:
                curve = curves.fcurves.new(data_path, index=index)
                curve.group = curves.groups.get(bone.name) or curves.groups.new(bone.name)
            splice(curve, first, values[:, index], span, before[index])


def selected_key_frames(action, slot):
    """The frames of an action that have a selected key, in order."""
    keys = (key for curve in getattr(bag(action, slot), "fcurves", ()) for key in curve.keyframe_points)
    return sorted({round(key.co[0]) for key in keys if key.select_control_point})
