"""Joint positions as Blender has them after its import of a BVH or GLB, with the defaults of its importers.

    pip install bpy==4.2.0                          # Python 3.11; also 4.5.15 and 5.0.1
    python scripts/importers/blender.py dance.bvh FPS positions.json [ANIMATION]

Of a character with ANIMATION, that action. Writes {"frames": [{joint: [x, y, z]}]} in metres, y up.
"""

import json
import os
import sys

import bpy

source, fps, target, *animation = sys.argv[1:]
fps = float(fps)
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps = round(fps)
if source.endswith(".bvh"):
    if not hasattr(bpy.ops.import_anim, "bvh") or "io_anim_bvh" not in bpy.context.preferences.addons:
        bpy.ops.preferences.addon_enable(module="io_anim_bvh")
    bpy.ops.import_anim.bvh(filepath=source)
else:
    if "io_scene_gltf2" not in bpy.context.preferences.addons:
        bpy.ops.preferences.addon_enable(module="io_scene_gltf2")
    bpy.ops.import_scene.gltf(filepath=source)
armature = next(o for o in bpy.context.scene.objects if o.type == "ARMATURE")
if animation:
    # its own action per object, or a slot of one for all (from 4.4)
    action = next(a for a in bpy.data.actions if a.name.split("_" + armature.name)[0] == animation[0])
    for track in armature.animation_data.nla_tracks:
        track.mute = True
    armature.animation_data.action = action
    if hasattr(armature.animation_data, "action_suitable_slots"):
        armature.animation_data.action_slot = armature.animation_data.action_suitable_slots[0]
begin, end = armature.animation_data.action.frame_range
frames = []
for f in range(round(begin), round(end) + 1):
    scene.frame_set(f)
    heads = {bone.name: armature.matrix_world @ bone.head for bone in armature.pose.bones}
    # Blender's z is up and its -y ahead
    frames.append({name: [p.x, p.z, -p.y] for name, p in heads.items()})
with open(target, "w") as out:
    json.dump({"program": f"Blender {bpy.app.version_string}", "frames": frames}, out)
sys.stdout.flush()
os._exit(0)  # bpy's own shutdown may crash
