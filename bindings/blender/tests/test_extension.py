"""The extension as a user installs it, in Blender as a module: every job on armatures that are made here.

    BLENDER_USER_RESOURCES=EMPTY_FOLDER KINELM_ZIP=kinelm.zip python test_extension.py

check.sh runs it in each version of Blender.
"""

import importlib
import os
import sys
import tempfile
import unittest
from pathlib import Path

import bpy
import numpy as np
import rigs

HALF = 0.5e-4  # metres: half of the 0.1 mm that bones may be off
FIELDS = ("co", "handle_left", "handle_right", "interpolation", "easing", "handle_left_type", "handle_right_type", "type",
          "amplitude", "back", "period")


def setUpModule():
    global kinelm, jobs, actions, armature, Refused
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.extensions.package_install_files(filepath=os.environ["KINELM_ZIP"], repo="user_default", enable_on_install=True)
    kinelm = importlib.import_module("kinelm")
    jobs, actions, armature = (importlib.import_module(f"bl_ext.user_default.kinelm.{name}")
                               for name in ("jobs", "actions", "armature"))
    Refused = armature.Refused
    print("Blender", bpy.app.version_string, "kinelm", kinelm.__version__, kinelm.__file__)


def curves_of(obj, action=None):
    action = action or obj.animation_data.action
    slots = getattr(action, "slots", [None])
    return {(curve.data_path, curve.array_index): curve for curve in actions.bag(action, slots[0]).fcurves}


def raw(key):
    return tuple(tuple(v) if hasattr(v, "__len__") and not isinstance(v, str) else v for v in (getattr(key, f) for f in FIELDS))


def snapshot(obj, action=None):
    """Every key of every curve with all of its properties, and the values in each frame from 1 to 120."""
    return {name: ([raw(key) for key in curve.keyframe_points], [curve.evaluate(frame) for frame in range(1, 121)])
            for name, curve in curves_of(obj, action).items()}


def heads(obj, frames, bones):
    """(F, J, 3) heads of bones in the world as Blender evaluates them, metres, y up."""
    at = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        at.append([obj.matrix_world @ obj.pose.bones[bone].head for bone in bones])
    x, y, z = np.moveaxis(np.array(at), -1, 0)
    return np.stack([x, z, -y], -1)


def select(obj, *bones):
    for bone in obj.pose.bones:
        for of in (bone, bone.bone):
            if hasattr(of, "select"):
                of.select = bone.name in bones


class Extension(unittest.TestCase):
    def setUp(self):
        for of in (bpy.data.objects, bpy.data.armatures, bpy.data.actions):
            for block in list(of):
                of.remove(block)
        self.scene = bpy.context.scene
        self.scene.render.fps, self.scene.frame_start, self.scene.frame_end = 24, 1, 96
        self.scene.use_preview_range = False
        settings = self.scene.kinelm
        for name in ("count", "seed", "given", "feet", "labels", "seconds", "run", "name", "steps"):
            settings.property_unset(name)
        settings.count, settings.seconds = 1, 4.0

    def dancing(self, kind="plain", **options):
        """An armature that dances for four seconds."""
        obj = rigs.rigify() if kind == "rigify" else rigs.person(kind, **options)
        jobs.Job(jobs.dance(obj, 1, 4.0, {"genre": "salsa"}, seed=3)).run()
        return obj

    def sparse(self, kind="plain"):
        """The same with a key every ten frames, as an animator sets them: Bezier segments, handles of all kinds."""
        obj = self.dancing(kind)
        rig, action = armature.Rig(obj), obj.animation_data.action
        poses = jobs.Job(rig.read(range(1, 96))).run()
        bases = jobs.Job(rig.bases(poses, poses.clip, 0, 94)).run()
        actions.assign(obj, None)
        bpy.data.actions.remove(action)
        for n, bone in enumerate(obj.pose.bones):
            bone.rotation_mode = ("QUATERNION", "XYZ", "AXIS_ANGLE", "ZXY")[n % 4]
        for frame in [*range(1, 95, 10)]:
            for name, basis in zip(rig.bones, bases[frame - 1]):
                bone = obj.pose.bones[name]
                bone.matrix_basis = basis if name == rig.bones[0] else basis.to_3x3().to_4x4()
                paths = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}
                bone.keyframe_insert(paths.get(bone.rotation_mode, "rotation_euler"), frame=frame)
                if name == rig.bones[0]:
                    bone.keyframe_insert("location", frame=frame)
        kinds, shapes = ("FREE", "AUTO", "VECTOR", "ALIGNED", "AUTO_CLAMPED"), ("BEZIER", "CONSTANT", "LINEAR", "BOUNCE")
        for n, curve in enumerate(curves_of(obj).values()):
            for m, key in enumerate(curve.keyframe_points):
                key.handle_left_type = key.handle_right_type = kinds[(n + m) % 5]
                key.interpolation = shapes[(n + m) % 7 if (n + m) % 7 < 4 else 0]
            curve.update()
        return obj

    def assert_outside_as_it_was(self, before, after, first, last):
        for name, (keys, values) in before.items():
            self.assertIn(name, after)
            new_keys, new_values = after[name]
            new = {key[0][0]: key for key in new_keys}
            for key in keys:
                if not first <= key[0][0] <= last:
                    self.assertEqual(new[key[0][0]], key, name)
            for frame in range(1, 121):
                if not first <= frame <= last:
                    self.assertEqual(new_values[frame - 1], values[frame - 1], (name, frame))

    def changed(self, before, after):
        return {name[0].split('"')[1] for name in after if name not in before or before[name] != after[name]}

    # jobs
    def test_a_dance_from_nothing_on_each_kind_of_armature(self):
        for kind, options in [("plain", {}), ("mixamo", {"scale": 100}), ("unreal", {}), ("character creator", {}),
                              ("rigify", {})]:
            with self.subTest(kind):
                self.setUp()
                obj = rigs.rigify() if kind == "rigify" else rigs.person(kind, **options)
                obj.location, obj.rotation_euler = (2, -1, 0.5), (0, 0, 0.7)
                bpy.context.view_layer.update()
                rig = armature.Rig(obj)
                # as high as the lowest joint stands at rest
                stands = min((obj.matrix_world @ obj.data.bones[bone].head_local).z for bone in rig.bones)
                self.assertGreater(stands, 0.51)
                made = jobs.Job(jobs.dance(obj, 11, 4.0, {"genre": "salsa"}, seed=3)).run()
                self.assertEqual([made[0]], [obj.animation_data.action])
                clip = kinelm.Model.ready().generate(rig.rest_clip(), rig="prompt", seconds=4.0, labels={"genre": "salsa"}, seed=3)
                self.assertEqual(made[0].curve_frame_range[:], (11, 10 + len(clip)))
                want, got = clip.positions() + [0, stands, 0], heads(obj, range(11, 11 + len(clip)), rig.bones)
                got = got - got[0, 0] * [1, 0, 1] + want[0, 0] * [1, 0, 1]
                far = np.abs(got - want).max()
                print(f"  {kind}: {far * 1000:.4f} mm at most, root {rig.bones[0]}, {len(rig.bones)} bones")
                self.assertLess(far, HALF if kind != "rigify" else 1e-3)
                self.assertGreater(np.ptp(want[:, 0], axis=0).max(), 0.05)

    def test_selected_bones_in_a_range(self):
        for kind, arm, bones in [("plain", "dense", ["arm.L", "forearm.L"]), ("plain", "sparse", ["arm.L", "forearm.L"]),
                                 ("mixamo", "sparse", ["mixamorig:Hips", "mixamorig:LeftUpLeg", "mixamorig:LeftLeg"])]:
            with self.subTest(f"{kind} {arm}"):
                self.setUp()
                obj = self.dancing(kind) if arm == "dense" else self.sparse(kind)
                action, before = obj.animation_data.action, snapshot(obj)
                name = action.name
                rig = armature.Rig(obj)
                poses = jobs.Job(rig.read(range(*(round(f) + n for n, f in enumerate(action.curve_frame_range))))).run()
                made = jobs.Job(jobs.edit(obj, bones, 33, 56, seed=5)).run()
                self.assertEqual((snapshot(obj, action), action.name), (before, name), "the action itself is as it was")
                after = snapshot(obj, made[0])
                self.assert_outside_as_it_was(before, after, 33, 56)
                self.assertLessEqual(self.changed(before, after), set(bones))
                self.assertTrue(self.changed(before, after))
                smpl = [smpl for smpl, of in rig.smpl.items() if of in bones]
                clip = kinelm.Model.ready().generate(poses.clip, free=[f"{','.join(smpl)}@32f:56f"], seed=5)
                far = np.abs(heads(obj, poses.frames, rig.bones) - clip.positions()).max()
                print(f"  {kind} {arm}: {far * 1000:.4f} mm at most")
                self.assertLess(far, HALF)

    def test_the_selected_bones_are_given(self):
        obj = self.dancing()
        before = snapshot(obj)
        made = jobs.Job(jobs.edit(obj, ["hips", "arm.R", "forearm.R", "hand.R"], 33, 56, given=True)).run()
        after = snapshot(obj, made[0])
        self.assert_outside_as_it_was(before, after, 33, 56)
        self.assertFalse({"hips", "arm.R", "forearm.R", "hand.R"} & self.changed(before, after))
        self.assertIn("thigh.L", self.changed(before, after))

    def test_between_selected_keys(self):
        obj = self.sparse()
        for curve in curves_of(obj).values():
            for key in curve.keyframe_points:
                key.select_control_point = key.co[0] in (31, 61)
        before = snapshot(obj)
        made = jobs.Job(jobs.between(obj)).run()
        after = snapshot(obj, made[0])
        self.assert_outside_as_it_was(before, after, 32, 60)
        self.assertIn("chest", self.changed(before, after))

    def test_a_loop(self):
        obj = self.dancing()
        before = snapshot(obj)
        jobs.Job(jobs.loop(obj, 1, 96)).run()
        # the last key is held after it
        self.assert_outside_as_it_was(before, snapshot(obj), 40, 120)
        at = heads(obj, [1, 2, 95, 96], ["hips", "hand.L", "foot.R", "head"])
        steps = np.linalg.norm(np.diff(at[[2, 3, 0, 1]], axis=0), axis=-1)
        self.assertLess(steps[1].max(), 0.15, "the last frame leads to the first")

    def test_feet(self):
        obj = self.dancing()
        before = snapshot(obj)
        # it slides: its path is pushed along from frame to frame
        for (path, index), curve in curves_of(obj).items():
            if path.endswith('"hips"].location') and index == 0:
                for key in curve.keyframe_points:
                    key.co[1] += 0.004 * key.co[0]
        rig = armature.Rig(obj)
        slid = heads(obj, range(1, 97), ["foot.L", "foot.R"])
        jobs.Job(jobs.lock_feet(obj, 25, 72)).run()
        self.assertLessEqual(self.changed(before, snapshot(obj)) - {"hips"},
                             {f"{name}.{side}" for name in ("thigh", "shin", "foot", "toe") for side in "LR"})
        locked = heads(obj, range(1, 97), ["foot.L", "foot.R"])
        np.testing.assert_array_equal(locked[:24], slid[:24])
        np.testing.assert_array_equal(locked[72:], slid[72:])

        def standing(at):  # how far feet move a frame where they are low
            speeds = np.linalg.norm(np.diff(at[24:72], axis=0)[..., [0, 2]], axis=-1)
            return np.median(speeds[at[25:72, :, 1] < np.quantile(at[24:72, :, 1], 0.4)])
        self.assertLess(standing(locked), standing(slid))
        self.assertTrue(rig)

    def test_variations(self):
        obj = self.dancing()
        bpy.ops.kinelm.choose(what="ACCEPT")
        source, settings = obj.animation_data.action, self.scene.kinelm
        select(obj, "arm.L", "forearm.L")
        settings.count, self.scene.use_preview_range = 4, True
        self.scene.frame_preview_start, self.scene.frame_preview_end = 33, 56
        self.assertFalse(bpy.ops.kinelm.choose.poll())
        self.assertEqual(bpy.ops.kinelm.run(task="EDIT"), {"FINISHED"})
        names = [f"{source.name} kinelm {n}" for n in range(1, 5)]
        self.assertEqual(obj.animation_data.action.name, names[0])
        shapes = {str(snapshot(obj, bpy.data.actions[name])) for name in names}
        self.assertEqual(len(shapes), 4, "four different ones")
        for name in [*names[1:], names[0], names[1]]:
            bpy.ops.kinelm.choose(what="NEXT")
            self.assertEqual(obj.animation_data.action.name, name)
        bpy.ops.kinelm.choose(what="ACCEPT")
        self.assertEqual({action.name for action in bpy.data.actions}, {source.name, names[1]})
        self.assertFalse(bpy.ops.kinelm.choose.poll())
        actions.assign(obj, source)
        bpy.ops.kinelm.run(task="EDIT")
        bpy.ops.kinelm.choose(what="REJECT")
        self.assertEqual(obj.animation_data.action, source)
        self.assertEqual({action.name for action in bpy.data.actions}, {source.name, names[1]})

    def test_tasks_of_the_panel(self):
        obj = rigs.person()
        self.assertEqual(bpy.ops.kinelm.run(task="DANCE"), {"FINISHED"})
        self.assertEqual(obj.animation_data.action.name, "plain kinelm")
        bpy.ops.kinelm.choose(what="ACCEPT")
        for task in ("LOOP", "LOCK_FEET"):
            self.assertEqual(bpy.ops.kinelm.run(task=task), {"FINISHED"})
        settings = self.scene.kinelm
        settings.steps, settings.name = 2, Path(tempfile.mkdtemp()).name
        self.assertEqual(bpy.ops.kinelm.run(task="TUNE"), {"FINISHED"})
        self.assertTrue((Path(settings.run) / "config.toml").is_file())
        self.assertEqual(bpy.ops.kinelm.run(task="DANCE"), {"FINISHED"})

    def test_it_can_be_stopped_at_every_step(self):
        obj = self.dancing()
        action, before = obj.animation_data.action, snapshot(obj)
        self.scene.frame_set(7)
        with tempfile.TemporaryDirectory() as folder:
            for stop_at in (0.0, 0.1, 0.3, 0.6, 0.95):
                for steps in (jobs.edit(obj, ["arm.L"], 33, 56, count=2), jobs.dance(obj, 1, 4.0, {}, count=2),
                              jobs.tune(obj, Path(folder) / f"{stop_at}", 500)):
                    job = jobs.Job(steps)
                    while job.progress <= stop_at:
                        self.assertTrue(job.step())
                        if "tune" in steps.__name__ and stop_at > 0.2 and job.progress >= 0.2:
                            break
                    job.cancel()
                    self.assertEqual((obj.animation_data.action, self.scene.frame_current), (action, 7))
                    self.assertEqual(list(bpy.data.actions), [action])
        self.assertEqual(snapshot(obj), before)

    # refusals
    def refuses(self, text, steps):
        with self.assertRaisesRegex(Refused, text):
            jobs.Job(steps()).run()

    def test_refusals(self):
        obj = rigs.person()
        self.refuses("has no action", lambda: jobs.edit(obj, ["arm.L"], 1, 9))
        obj = self.dancing()
        self.refuses("none of the selected bones", lambda: jobs.edit(obj, ["finger.L"], 33, 56))
        self.refuses("frames 200 to 300", lambda: jobs.edit(obj, ["arm.L"], 200, 300))
        self.refuses("expected two with frames between", lambda: jobs.between(obj))
        curve = next(iter(curves_of(obj).values()))
        curve.modifiers.new("NOISE")
        self.refuses("modifier NOISE", lambda: jobs.edit(obj, ["hips"], 33, 56))
        target = obj.pose.bones["shin.L"].constraints.new("IK")
        target.chain_count = 2
        self.refuses(r'the constraint "IK" \(IK\) of shin.L moves shin.L', lambda: jobs.edit(obj, ["arm.L"], 33, 56))
        target.mute = True
        jobs.Job(jobs.edit(obj, ["arm.L"], 33, 56)).run()
        for bone, rig in [("c_traj", "Auto-Rig Pro"), ("Ctrl_Hips", "Mixamo control rig")]:
            other = rigs.person("mixamo")
            other.data.bones["mixamorig:HeadTop_End" if "mixamorig:HeadTop_End" in other.data.bones else "mixamorig:Head"].name = bone
            self.refuses(rig, lambda: jobs.dance(other, 1, 1.0, {}))
        other.scale = (1, 2, 1)
        bpy.context.view_layer.update()
        other.data.bones["Ctrl_Hips"].name = "mixamorig:Head"
        self.refuses("scaled by", lambda: jobs.dance(other, 1, 1.0, {}))
        with self.assertRaisesRegex(RuntimeError, "labels are 'salsa'; expected pairs"):
            self.scene.kinelm.labels = "salsa"
            bpy.ops.kinelm.run(task="DANCE")

    def test_rigify(self):
        obj = rigs.rigify(fk=False)
        self.refuses("is Rigify, and IK_FK of upper_arm_parent.L is 0", lambda: jobs.dance(obj, 1, 1.0, {}))
        self.setUp()
        obj = self.dancing("rigify")
        self.scene.frame_set(1)
        before = snapshot(obj)
        rig = armature.Rig(obj)
        poses = jobs.Job(rig.read(range(1, 97))).run()
        made = jobs.Job(jobs.edit(obj, ["upper_arm_fk.L", "forearm_fk.L", "hand_fk.L"], 33, 56, seed=5)).run()
        after = snapshot(obj, made[0])
        self.assert_outside_as_it_was(before, after, 33, 56)
        self.assertEqual(self.changed(before, after), {"upper_arm_fk.L", "forearm_fk.L", "hand_fk.L"})
        clip = kinelm.Model.ready().generate(poses.clip, free=["left_shoulder,left_elbow,left_wrist@32f:56f"], seed=5)
        far = np.abs(heads(obj, poses.frames, rig.bones) - clip.positions()).max()
        print(f"  rigify: {far * 1000:.4f} mm at most")
        for bone in ("upper_arm", "thigh"):
            obj.pose.bones[f"{bone}_parent.L"]["IK_FK"] = 0.0
            obj.pose.bones[f"{bone}_parent.L"].keyframe_insert('["IK_FK"]', frame=50)
        self.refuses("is Rigify, and IK_FK of", lambda: jobs.edit(obj, ["upper_arm_fk.L"], 33, 56))

    # what 4.4 brought
    @unittest.skipIf(bpy.app.version < (4, 4), "slots came with 4.4")
    def test_slots(self):
        obj, other = self.dancing(), rigs.person("mixamo")
        action = obj.animation_data.action
        slot = action.slots.new("OBJECT", "other")
        bag = actions.bag(action, slot, other)
        curve = bag.fcurves.new("location", index=0)
        curve.keyframe_points.add(2)
        curve.keyframe_points.foreach_set("co", [1, 1, 90, 5])
        actions.assign(other, action, slot.identifier)
        made = jobs.Job(jobs.edit(obj, ["arm.L"], 33, 56)).run()[0]
        self.assertEqual(obj.animation_data.action_slot.identifier, action.slots[0].identifier)
        self.assertEqual([s.identifier for s in made.slots], [s.identifier for s in action.slots])
        copied = actions.bag(made, made.slots[1]).fcurves
        self.assertEqual([[raw(k) for k in c.keyframe_points] for c in copied],
                         [[raw(k) for k in c.keyframe_points] for c in bag.fcurves])
        self.assertEqual(other.animation_data.action, action)


if __name__ == "__main__":
    ended = unittest.main(verbosity=2, exit=False).result
    # bpy 4.5 may wait for ever in its own destructors
    sys.stdout.flush()
    os._exit(not ended.wasSuccessful())
