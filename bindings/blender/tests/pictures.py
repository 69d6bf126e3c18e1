"""The pictures of docs/blender.md, by Workbench.

    BLENDER_USER_RESOURCES=EMPTY_FOLDER KINELM_ZIP=kinelm.zip python pictures.py OUT

The character is the body of capsules that a GLB of kinelm's has. Writes OUT/blender-dance.png and
OUT/blender-variations.png; those in docs have a palette of 40 colours. Needs OpenGL; without a display, Mesa's EGL.
"""

import importlib
import os
import sys
import tempfile
from pathlib import Path

import bpy

out = Path(sys.argv[1])
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.extensions.package_install_files(filepath=os.environ["KINELM_ZIP"], repo="user_default", enable_on_install=True)
jobs, actions = (importlib.import_module(f"bl_ext.user_default.kinelm.{name}") for name in ("jobs", "actions"))
if "io_scene_gltf2" not in bpy.context.preferences.addons:
    bpy.ops.preferences.addon_enable(module="io_scene_gltf2")
scene = bpy.context.scene
scene.render.fps = 24
with tempfile.TemporaryDirectory() as folder:
    hero = f"{folder}/hero.glb"
    importlib.import_module("kinelm").Model.ready().generate(seconds=1).write(hero)
    bpy.ops.import_scene.gltf(filepath=hero)
obj = next(o for o in bpy.data.objects if o.type == "ARMATURE")
meshes = [o for o in bpy.data.objects if o.type == "MESH" and o.find_armature()]
for other in [o for o in bpy.data.objects if o.type == "MESH" and not o.find_armature()]:
    bpy.data.objects.remove(other)  # the importer's shapes of bones

camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
camera.data.type, camera.data.ortho_scale = "ORTHO", 6.0
camera.location, camera.rotation_euler = (0, -12, 2.35), (1.44, 0, 0)
scene.collection.objects.link(camera)
bpy.ops.mesh.primitive_plane_add(size=60)
floor = bpy.context.object
scene.camera = camera
scene.render.engine, scene.render.resolution_x, scene.render.resolution_y = "BLENDER_WORKBENCH", 800, 300
shading = scene.display.shading
shading.light, shading.color_type, shading.show_shadows = "STUDIO", "OBJECT", True
scene.view_settings.view_transform = "Standard"
floor.color = (0.9, 0.9, 0.9, 1)
scene.world = bpy.data.worlds.new("world")
scene.world.color = (0.9, 0.9, 0.9)
scene.render.image_settings.color_mode, scene.render.image_settings.compression = "RGB", 100


def still(place, color):
    """The character as it stands, as a mesh that stays."""
    graph = bpy.context.evaluated_depsgraph_get()
    for mesh in meshes:
        copy = bpy.data.objects.new("still", bpy.data.meshes.new_from_object(mesh.evaluated_get(graph)))
        copy.matrix_world = mesh.matrix_world
        copy.location.x += place
        copy.color = (*color, 1)
        scene.collection.objects.link(copy)


def picture(name):
    for mesh in meshes:
        mesh.hide_render = True
    scene.render.filepath = str(out / name)
    bpy.ops.render.render(write_still=True)
    for copy in [o for o in bpy.data.objects if o.name.startswith("still")]:
        bpy.data.objects.remove(copy)


made = jobs.Job(jobs.dance(obj, 1, 6.0, {"genre": "salsa"}, seed=4, look_ahead=4)).run()
hips = obj.pose.bones["pelvis"]
for n, frame in enumerate((12, 40, 68, 96, 124)):
    scene.frame_set(frame)
    at = (obj.matrix_world @ hips.head).x
    still(1.15 * (n - 2) - at, (0.62, 0.5, 0.44))
picture("blender-dance.png")

arm = [f"right_{name}" for name in ("collar", "shoulder", "elbow", "wrist")]
variations = jobs.Job(jobs.edit(obj, arm, 2, 49, count=4, seed=2)).run()
for n, action in enumerate([made[0], *variations]):
    actions.assign(obj, action)
    scene.frame_set(22)
    at = (obj.matrix_world @ hips.head).x
    still(1.15 * (n - 2) - at, (0.62, 0.5, 0.44) if n == 0 else (0.9, 0.55, 0.2))
picture("blender-variations.png")
sys.stdout.flush()
os._exit(0)
