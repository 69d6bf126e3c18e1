"""An armature's bones as the joints of a clip, and back."""

from collections import namedtuple

import bpy
import kinelm
import numpy as np
from mathutils import Euler, Matrix, Quaternion

# from Blender's world, z up, to kinelm's, y up: a figure that looks along -y then looks along +z
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
# a bone that only these rigs have
CONTROL_RIGS = {
    "c_root_master.x": "Auto-Rig Pro", "c_traj": "Auto-Rig Pro", "Ctrl_Hips": "the Mixamo control rig",
    "Ctrl_Master": "the Mixamo control rig", "左足ＩＫ": "an MMD rig", "足ＩＫ.L": "an MMD rig"}
# Rigify's FK controls by the names of its meta-rig, each with its parent there. Bones of a limb are read and keyed while
# IK is off; `torso` carries what hips and legs hang from.
RIGIFY = {"spine": ("torso", None), "spine.002": ("spine_fk.002", "spine"), "spine.003": ("spine_fk.003", "spine.002"),
          "spine.004": ("neck", "spine.003"), "spine.006": ("head", "spine.004")}
for _side in ("L", "R"):
    for _chain in (["spine.003", "shoulder", "upper_arm", "forearm", "hand"], ["spine", "thigh", "shin", "foot", "toe"]):
        for _above, _name in zip(_chain, _chain[1:]):
            _parent = _above if _above.startswith("spine") else f"{_above}.{_side}"
            _control = _name if _name == "shoulder" else f"{_name}_fk"
            RIGIFY[f"{_name}.{_side}"] = (f"{_control}.{_side}", _parent)
IK_SWITCHES = [f"{limb}_parent.{side}" for limb in ("upper_arm", "thigh") for side in ("L", "R")]
SAME = 1e-6  # angles and lengths that float32 can't tell from equal ones


def to_matrices(q):
    """Rotations (.., 3, 3) of unit quaternions (.., 4) in kinelm's order, x, y, z, w."""
    flat = [Quaternion((w, x, y, z)).to_matrix() for x, y, z, w in q.reshape(-1, 4)]
    return np.array(flat, float).reshape(*q.shape[:-1], 3, 3)


def to_quaternions(m):
    """Quaternions (.., 4) in kinelm's order of rotations (.., 3, 3)."""
    q = np.array([Matrix(of).to_quaternion() for of in m.reshape(-1, 3, 3)], float).reshape(*m.shape[:-2], 4)
    return q[..., [1, 2, 3, 0]] / np.linalg.norm(q, axis=-1, keepdims=True)


def without_scale(m):
    """The rotations of matrices (.., 4, 4) or (.., 3, 3) with scale."""
    m = m[..., :3, :3]
    return m / np.linalg.norm(m, axis=-2, keepdims=True)


class Refused(Exception):
    """What can't be done, why, and what to do."""


# what was read of an armature: a clip, its frames, and per frame the matrices of its object and of the root's parent
Poses = namedtuple("Poses", "clip frames objects above")


class Rig:
    """The bones of an armature that kinelm moves: J joints, parents first."""

    def __init__(self, obj):
        bones = obj.data.bones
        for bone, rig in CONTROL_RIGS.items():
            if bone in bones:
                raise Refused(f"{obj.name} is {rig} (bone {bone}), whose controls kinelm doesn't know; bake its action to "
                              "the deforming bones and select that armature")
        self.obj = obj
        self.is_rigify = "torso" in bones and any(bone.name.startswith("ORG-") for bone in bones)
        if self.is_rigify:
            self._take({name: control for name, (control, _) in RIGIFY.items() if control in bones})
            self.check_fk(obj)
        else:
            # the tree that most bones are in; handles and targets are others
            tops = [bone for bone in bones if not bone.parent]
            top = max(tops, key=lambda bone: len(bone.children_recursive), default=None)
            self._take({bone.name: bone.name for bone in [top, *top.children_recursive]} if top else {})
        try:
            self.smpl = self.rest_clip().humanoid()
        except kinelm.Error as e:
            raise Refused(f"{obj.name}: {e}") from e
        if not self.is_rigify:
            # one joint of a clip has a path: the lowest bone that carries legs and trunk
            trunk = [bones[self.smpl[name]] for name in ("left_hip", "right_hip", "spine1", "neck") if name in self.smpl]
            chains = [[*reversed(bone.parent_recursive), bone] for bone in [bones[self.smpl["pelvis"]], *trunk]]
            shared = [level[0] for level in zip(*chains) if all(bone == level[0] for bone in level)]
            self._take({bone.name: bone.name for bone in [shared[-1], *shared[-1].children_recursive]})
            self._check_constraints()

    def _take(self, joints):
        """Makes these the joints: {name: bone}, parents first."""
        bones, self.names, self.bones = self.obj.data.bones, list(joints), list(joints.values())
        parent = (lambda name: RIGIFY[name][1]) if self.is_rigify else (lambda name: getattr(bones[name].parent, "name", None))
        above = [parent(name) for name in self.names]
        self.parents = [self.names.index(name) if name in joints else None for name in above]
        rest = np.array([bones[bone].matrix_local for bone in self.bones], float).reshape(-1, 4, 4)
        self.rest, self.heads = without_scale(rest), rest[:, :3, 3]
        # of the object only the axes that it was imported on: a character may face anywhere
        world = np.array(self.obj.matrix_world, float)
        scales = np.linalg.norm(world[:3, :3], axis=0)
        if scales.max() > 1.001 * scales.min() or np.linalg.det(world[:3, :3]) <= 0:
            raise Refused(f"{self.obj.name} is scaled by {np.round(scales, 3)} or mirrored; expected one factor above 0: apply it")
        self.unit = bpy.context.scene.unit_settings.scale_length
        self.scale = scales.mean() * self.unit
        quarters = np.round(np.array(self.obj.matrix_world.to_euler()) / (np.pi / 2))
        self.axes = Y_UP @ np.array(Euler(quarters * np.pi / 2).to_matrix(), float)

    def _check_constraints(self):
        """Refuses constraints that move a joint of the body, which keys then don't."""
        for pose in self.obj.pose.bones:
            for constraint in pose.constraints:
                if constraint.mute or constraint.influence == 0:
                    continue
                reach = [pose]
                if constraint.type in ("IK", "SPLINE_IK"):
                    whole = [*(reach if getattr(constraint, "use_tail", True) else []), *pose.parent_recursive]
                    reach = whole[:constraint.chain_count or None]
                moved = {bone.name for bone in reach} & set(self.smpl.values())
                if moved:
                    raise Refused(f'{self.obj.name}: the constraint "{constraint.name}" ({constraint.type}) of {pose.name} moves '
                                  f"{min(moved)}; expected a plain FK armature or Rigify with IK off: mute it, or bake its action")

    @staticmethod
    def check_fk(obj):
        """Refuses a Rigify limb that is on IK, or on its way."""
        for name in IK_SWITCHES:
            bone = obj.pose.bones.get(name)
            if bone and bone.get("IK_FK", 1.0) != 1.0:
                raise Refused(f"{obj.name} is Rigify, and IK_FK of {name} is {bone['IK_FK']:g} in frame "
                              f"{bpy.context.scene.frame_current}; expected 1, FK: snap FK to IK, then switch IK off")

    def _clip(self, root, rotations, fps):
        places = self.scale * self.heads @ self.axes.T
        offsets = np.array([at if p is None else at - places[p] for at, p in zip(places, self.parents)])
        return kinelm.Clip(self.names, self.parents, offsets, np.ascontiguousarray(root), rotations, fps)

    def rest_clip(self):
        """Two frames of the rest pose."""
        root = np.tile(self.scale * self.axes @ self.heads[0] if len(self.heads) else np.zeros(3), (2, 1))
        rotations = np.tile([0.0, 0.0, 0.0, 1.0], (2, len(self.names), 1))
        return self._clip(root, rotations, fps_of(bpy.context.scene))

    def floor(self):
        """How high the lowest joint of the body is at rest, where the object stands, metres: dances have it on their floor."""
        return self.obj.matrix_world.translation.z * self.unit + (self.scale * self.heads @ self.axes.T)[:, 1].min()

    def read(self, frames):
        """The poses in some frames. Yields how much of it is done; a generator, as are all that take long."""
        scene, poses, objects, above = bpy.context.scene, [], [], []
        current = scene.frame_current, scene.frame_subframe
        parent = self.obj.data.bones[self.bones[0]].parent
        try:
            for n, frame in enumerate(frames):
                scene.frame_set(frame)
                obj = self.obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
                if self.is_rigify:
                    self.check_fk(obj)
                poses.append(np.array([obj.pose.bones[bone].matrix for bone in self.bones]))
                above.append(obj.pose.bones[parent.name].matrix.copy() if parent else Matrix())
                objects.append(np.array(obj.matrix_world))
                yield (n + 1) / len(frames)
        finally:
            scene.frame_set(current[0], subframe=current[1])
        poses, objects = np.array(poses, float), np.array(objects, float)
        turns = Y_UP @ without_scale(objects)[:, None] @ without_scale(poses)
        world = turns @ np.swapaxes(self.axes @ self.rest, -1, -2)
        local = world.copy()
        for j, p in enumerate(self.parents):
            if p is not None:
                local[:, j] = np.swapaxes(world[:, p], -1, -2) @ world[:, j]
        root = np.einsum("fab,fb->fa", objects, poses[:, 0, :, 3])[:, :3] * self.unit @ Y_UP.T
        clip = self._clip(root, to_quaternions(local), fps_of(scene))
        return Poses(clip, list(frames), objects, above)

    def changed(self, poses, clip):
        """(F, J) rotations of a clip that differ from those that were read, and (F) places of the root."""
        before, after = poses.clip.rotations, clip.rotations
        rotations = np.minimum(np.abs(before - after).max(-1), np.abs(before + after).max(-1)) > SAME
        if self.is_rigify:
            # a limb may follow its parent only in part, so what is below a change has new keys
            for j, p in enumerate(self.parents):
                if p is not None:
                    rotations[:, j] |= rotations[:, p]
        return rotations, np.abs(poses.clip.root - clip.root).max(-1) > SAME

    def bases(self, poses, clip, first, last):
        """For each of some frames of a clip a list of the matrices (4, 4) that bones have relative to their rest pose, as
        they are keyed."""
        bones, some = self.obj.data.bones, slice(first, last + 1)
        world = to_matrices(clip.rotations[some])
        for j, p in enumerate(self.parents):
            if p is not None:
                world[:, j] = world[:, p] @ world[:, j]
        inverse = np.linalg.inv(poses.objects[some])
        places = np.einsum("fab,fb->fa", inverse[:, :3, :3], clip.root[some] @ Y_UP / self.unit) + inverse[:, :3, 3]
        posed = np.tile(np.eye(4), (*world.shape[:2], 1, 1))
        posed[..., :3, :3] = without_scale(inverse)[:, None] @ Y_UP.T @ world @ self.axes @ self.rest
        posed[:, 0, :3, 3] = places
        if self.is_rigify:
            return (yield from self._posed_bases(poses.frames[some], posed))
        all_bases = []
        for n, above in enumerate(poses.above[some]):
            matrices, bases = [Matrix(m) for m in posed[n]], []
            for bone, matrix, p in zip((bones[name] for name in self.bones), matrices, self.parents):
                keywords = {"invert": True}
                if bone.parent:
                    keywords |= {"parent_matrix": above if p is None else matrices[p],
                                 "parent_matrix_local": bone.parent.matrix_local}
                bases.append(bone.convert_local_to_pose(matrix, bone.matrix_local, **keywords))
            all_bases.append(bases)
            yield (n + 1) / len(posed)
        return all_bases

    def _posed_bases(self, frames, posed):
        """Bases of controls that hang from others by constraints: posed level by level, as Blender evaluates them."""
        scene, controls = bpy.context.scene, [self.obj.pose.bones[name] for name in self.bones]
        current, own, depths = scene.frame_current, [control.matrix_basis.copy() for control in controls], []
        for p in self.parents:
            depths.append(0 if p is None else depths[p] + 1)
        all_bases = []
        try:
            for n, frame in enumerate(frames):
                scene.frame_set(frame)
                for depth in range(max(depths) + 1):
                    for j in (j for j, d in enumerate(depths) if d == depth):
                        at = posed[n, j].copy()
                        if j:
                            at[:3, 3] = np.array(controls[j].matrix)[:3, 3]
                        controls[j].matrix = Matrix(at)
                    bpy.context.view_layer.update()
                all_bases.append([control.matrix_basis.copy() for control in controls])
                yield (n + 1) / len(frames)
        finally:
            for control, basis in zip(controls, own):
                control.matrix_basis = basis
            scene.frame_set(current)
        return all_bases


def fps_of(scene):
    """Frames per second of a scene."""
    return scene.render.fps / scene.render.fps_base
