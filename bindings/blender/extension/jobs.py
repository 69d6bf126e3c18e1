"""The jobs: generators that yield how much is done, 0 to 1, so that Blender can draw and the user can stop them."""

import threading
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path

import bpy
import kinelm
import numpy as np

from . import actions
from .armature import Poses, Refused, Rig, fps_of


class Job:
    """A job that is done step by step."""

    def __init__(self, steps):
        self.steps, self.progress, self.result = steps, 0.0, None

    def step(self):
        """Works for a moment. False: it is done, and its result is there."""
        try:
            self.progress = next(self.steps)
        except StopIteration as end:
            self.progress, self.result = 1.0, end.value
            return False
        return True

    def cancel(self):  # nothing of it is left
        self.steps.close()

    def run(self):
        while self.step():
            pass
        return self.result


def part(steps, begin, end):
    """Steps that are a part of a job, from one share of it to another; returns their result."""
    job = Job(steps)
    try:
        while job.step():
            yield begin + (end - begin) * job.progress
    finally:
        job.cancel()
    return job.result


def in_background(work):
    """Work in a thread, given a callback that keeps how much is done and stops the work with the job."""
    stop, done = threading.Event(), {"share": 0.0}

    def callback(said):
        share = said.get("frames", said.get("step", 0)) / max(said.get("of", said.get("steps", 0)), 1)
        done["share"] = min(max(done["share"], share), 1.0)
        return not stop.is_set()

    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(work, callback)
        try:
            while not future.done():
                wait([future], 0.01)
                yield done["share"]
        finally:
            stop.set()
    return future.result()


def model_of(run):
    """kinelm's own model, or that of a run folder."""
    return kinelm.Model.open(bpy.path.abspath(run)) if run else kinelm.Model.ready()


def _new_actions(rig, poses, clips, name, source, span):
    """An action for each clip, the first one assigned: a copy of the source with keys where the clip differs from what was
    read, or without a source one of its own."""
    obj, made = rig.obj, []
    identifier = actions.slot_of(obj).identifier if source and actions.slot_of(obj) else None
    try:
        for n, clip in enumerate(clips):
            if source:
                turned, moved = rig.changed(poses, clip)
            else:
                turned, moved = np.ones(clip.rotations.shape[:2], bool), np.ones(len(clip), bool)
            turned[:, 0] |= moved
            frames = np.flatnonzero(turned.any(1))
            begin, end = (frames[0], frames[-1]) if len(frames) else (0, -1)
            bases = yield from part(rig.bases(poses, clip, begin, end), n / len(clips), (n + 1) / len(clips))
            action = source.copy() if source else bpy.data.actions.new(name)
            made.append(action)
            action.name = f"{name} {n + 1}" if len(clips) > 1 else name
            action.use_fake_user = True
            action["kinelm_set"] = made[0].name
            if source:
                action["kinelm_source"] = source
            slot = next((s for s in getattr(action, "slots", []) if s.identifier == identifier), None)
            curves = actions.bag(action, slot, obj)
            for j, bone in enumerate(rig.bones):
                frames = np.flatnonzero(turned[:, j])
                if len(frames):
                    keys = [bases[frame - begin][j] for frame in range(frames[0], frames[-1] + 1)]
                    first = poses.frames[0] + int(frames[0])
                    actions.key_bone(curves, obj.pose.bones[bone], first, keys, j == 0 and moved.any(), span)
    except BaseException:
        for action in made:
            bpy.data.actions.remove(action)
        raise
    actions.assign(obj, made[0], identifier)
    return made


def _of_action(obj, first, last, work):
    """A job on frames of an object's action: `work(rig, poses, first, last, callback)` returns clips."""
    action, begin, end = actions.action_of(obj)
    asked, (first, last) = f"{first} to {last}", (max(first, begin), min(last, end))
    if last <= first:
        raise Refused(f"frames {asked} of {action.name}, which spans {begin} to {end}; expected two or more of these")
    rig = Rig(obj)
    poses = yield from part(rig.read(range(begin, end + 1)), 0, 0.2)
    clips = yield from part(in_background(lambda callback: work(rig, poses, first - begin, last - begin, callback)), 0.2, 0.9)
    return (yield from part(_new_actions(rig, poses, clips, f"{action.name} kinelm", action, (begin, end)), 0.9, 1))


def _joints(rig, bones):
    """SMPL's names of bones, as kinelm's spans take them."""
    ids = {"head": "15"}  # "head" is a group with the neck, too
    joints = [ids.get(smpl, smpl) for smpl, name in rig.smpl.items() if rig.bones[rig.names.index(name)] in bones]
    if not joints:
        known = ", ".join(rig.bones[rig.names.index(name)] for name in rig.smpl.values())
        raise Refused(f"none of the selected bones ({', '.join(sorted(bones)) or 'none'}) is one that kinelm moves; "
                      f"expected some of {known}")
    return joints


def edit(obj, bones, first, last, count=1, given=False, run="", **options):
    """Selected bones made anew in some frames, or `given` while all others are."""
    def work(rig, poses, begin, end, callback):
        joints = _joints(rig, set(rig.bones) - set(bones) if given else bones)
        spans = [f"{','.join(joints)}@{begin}f:{end + 1}f"]
        return model_of(run).variations(count, poses.clip, free=spans, callback=callback, **options)
    return _of_action(obj, first, last, work)


def between(obj, count=1, run="", **options):
    """The frames between selected keys made anew."""
    action, begin, _ = actions.action_of(obj)
    keys = actions.selected_key_frames(action, actions.slot_of(obj))
    gaps = [(a, b) for a, b in zip(keys, keys[1:]) if b - a > 1]
    if not gaps:
        raise Refused(f"selected keys of {action.name} are in frames {keys}; expected two with frames between them: select "
                      "key poses in the dope sheet")

    def work(rig, poses, _first, _last, callback):
        spans = [f"all@{a + 1 - begin}f:{b - begin}f" for a, b in gaps]
        return model_of(run).variations(count, poses.clip, free=spans, callback=callback, **options)
    return _of_action(obj, keys[0], keys[-1], work)


def loop(obj, first, last, count=1, run="", **options):
    """The end of some frames leads to their beginning."""
    def work(rig, poses, begin, end, callback):
        clips = model_of(run).variations(count, poses.clip.slice(begin, end + 1), loop=True, callback=callback, **options)
        return [_within(poses.clip, clip, begin) for clip in clips]
    return _of_action(obj, first, last, work)


def lock_feet(obj, first, last):
    """Feet that stand in some frames stay where they stand."""
    def work(rig, poses, begin, end, callback):
        return [_within(poses.clip, poses.clip.slice(begin, end + 1).lock_feet(), begin)]
    return _of_action(obj, first, last, work)


def _within(clip, new, begin):
    """A clip with frames from `begin` on replaced."""
    rotations, root = clip.rotations, clip.root
    rotations[begin:begin + len(new)], root[begin:begin + len(new)] = new.rotations, new.root
    return kinelm.Clip(clip.joints, clip.parents, clip.offsets, root, rotations, clip.fps)


def dance(obj, first, seconds, labels, count=1, run="", **options):
    """A dance from nothing, where the armature stands, as an action of its own."""
    rig = Rig(obj)
    data = obj.animation_data or obj.animation_data_create()
    before, identifier = data.action, getattr(actions.slot_of(obj), "identifier", None)
    if data.use_tweak_mode:
        actions.action_of(obj)  # says how to leave it
    data.action = None  # nothing moves what the dance doesn't
    try:
        here = yield from part(rig.read([bpy.context.scene.frame_current]), 0, 0.1)
        clips = yield from part(in_background(lambda callback: model_of(run).variations(
            count, rig.rest_clip(), rig="prompt", seconds=seconds, labels=labels, callback=callback, **options)), 0.1, 0.9)
        at = here.clip.root[0] * [1, 0, 1] + [0, rig.floor(), 0]
        clips = [kinelm.Clip(c.joints, c.parents, c.offsets, c.root - c.root[0] * [1, 0, 1] + at, c.rotations, c.fps)
                 for c in clips]
        frames = range(first, first + len(clips[0]))
        poses = Poses(here.clip, frames, np.repeat(here.objects, len(frames), 0), here.above * len(frames))
        made = yield from part(_new_actions(rig, poses, clips, f"{obj.name} kinelm", None, None), 0.9, 1)
    except BaseException:
        actions.assign(obj, before, identifier)
        raise
    for action in made if before else []:
        action["kinelm_source"] = before
    return made


def tune(obj, folder, steps=None):
    """Teaches kinelm's model the actions of this file that move the armature; returns the run folder."""
    rig, folder = Rig(obj), Path(folder)
    if folder.exists():
        raise Refused(f"{folder} is there; expected a new folder: choose another name")
    data = obj.animation_data or obj.animation_data_create()
    before, identifier = data.action, getattr(actions.slot_of(obj), "identifier", None)
    takes = [(action, slot) for action in bpy.data.actions for slot in getattr(action, "slots", [None])
             if actions.moves(action, slot, rig.bones, fps_of(bpy.context.scene))]
    if not takes:
        raise Refused(f"no action of this file moves {obj.name} for a second; expected its dances: append or import them")
    clips = []
    try:
        for n, (action, slot) in enumerate(takes):
            actions.assign(obj, action, getattr(slot, "identifier", None))
            _, first, last = actions.action_of(obj)
            poses = yield from part(rig.read(range(first, last + 1)), 0.2 * n / len(takes), 0.2 * (n + 1) / len(takes))
            clips.append(poses.clip)
    finally:
        actions.assign(obj, before, identifier)

    def work(callback):
        (folder / "clips").mkdir(parents=True)
        for n, clip in enumerate(clips):
            clip.write(folder / "clips" / f"{n}.json")
        model = kinelm.Model.ready()
        tokenizer = kinelm.Tokenizer.load(Path(model.run) / "tokenizer.json")
        corpus = kinelm.Corpus.build(folder / "clips", folder / "corpus", tokenizer=tokenizer)
        more = {} if steps is None else {"steps": steps}
        return kinelm.finetune(model, corpus.path, folder / "run", callback=callback, **more).run
    return (yield from part(in_background(work), 0.2, 1))
