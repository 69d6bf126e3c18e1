"""A movement through Blender to FBX: makes crates/motion/tests/golden/blender_dance.fbx.

    pip install bpy==4.2.0      # Python 3.11
    python scripts/reference/fbx.py crates/motion/tests/golden

The first 16 frames of blender_dance_y_up.bvh in metres, on an armature with a mesh of a vertex a bone, so that the file
has a bind pose, as those of characters have.
"""

import sys
from pathlib import Path

import bpy

FRAMES = 16
folder = Path(sys.argv[1])
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_anim.bvh(filepath=str(folder / "blender_dance_y_up.bvh"), axis_forward="-Z", axis_up="Y", global_scale=0.01,
                        update_scene_fps=True)
armature = bpy.context.object
bones = armature.data.bones
mesh = bpy.data.meshes.new("body")
mesh.from_pydata([bone.head_local for bone in bones], [], [(0, 1, 2)])
body = bpy.data.objects.new("body", mesh)
bpy.context.collection.objects.link(body)
body.parent = armature
body.modifiers.new("armature", "ARMATURE").object = armature
for i, bone in enumerate(bones):
    body.vertex_groups.new(name=bone.name).add([i], 1.0, "REPLACE")
bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, FRAMES
bpy.ops.export_scene.fbx(filepath=str(folder / "blender_dance.fbx"), object_types={"ARMATURE", "MESH"}, add_leaf_bones=False,
                         bake_anim_use_nla_strips=False, bake_anim_use_all_actions=False, bake_anim_simplify_factor=0)
