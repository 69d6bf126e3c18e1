"""The operators: a task as a job, and a choice among its variations."""

import time
from pathlib import Path

import bpy
import kinelm
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from . import actions, jobs
from .armature import Refused

TASKS = [
    ("EDIT", "Selected Bones", "Make the selected bones anew in these frames"),
    ("BETWEEN", "Between Selected Keys", "Make the frames between selected keys anew"),
    ("LOOP", "Loop", "Make the end of these frames lead to their beginning"),
    ("DANCE", "New Dance", "Make a dance from nothing, in an action of its own"),
    ("LOCK_FEET", "Lock Feet", "Hold feet where they stand in these frames"),
    ("TUNE", "Learn This File's Actions", "Teach a model of your own the actions that move this armature")]


class Settings(bpy.types.PropertyGroup):
    """What the panel asks for; stored in the scene."""

    count: IntProperty(name="Variations", default=4, min=1, max=16, description="Actions to choose from")
    seed: IntProperty(name="Seed", default=1, min=0, description="The same seed gives the same dance")
    given: BoolProperty(name="Keep Them", description="Keep the selected bones, and make all others anew")
    feet: BoolProperty(name="Lock Feet", default=True, description="Hold feet that stand where legs are new")
    labels: StringProperty(name="Labels", default="genre=salsa", description="Such as genre=salsa; several with commas")
    seconds: FloatProperty(name="Seconds", default=10.0, min=0.5, max=3600.0, description="Length of a new dance")
    run: StringProperty(name="Model", subtype="DIR_PATH", description="The folder of your own model; empty: kinelm's")
    name: StringProperty(name="Name", default="mine", description="The name of the model that learns")
    steps: IntProperty(name="Steps", default=0, min=0, description="Training steps; 0: as many as tuning usually takes")
    progress: FloatProperty(default=-1.0, options={"HIDDEN", "SKIP_SAVE"})


def frames_of(scene):
    """The preview range, or the scene's frames."""
    preview = scene.frame_preview_start, scene.frame_preview_end
    return preview if scene.use_preview_range else (scene.frame_start, scene.frame_end)


def selected_bones(obj):
    """Names of the selected bones, in any mode; until 4.5 the armature has the selection, since 5.0 its pose."""
    return {bone.name for bone in obj.pose.bones if getattr(bone, "select", None) or getattr(bone.bone, "select", False)}


def labels_of(text):
    """{"genre": "salsa"} of "genre=salsa"."""
    parts = [part.partition("=") for part in text.split(",") if part.strip()]
    wrong = [key for key, equals, value in parts if not (equals and value.strip())]
    if wrong:
        raise Refused(f"labels are {text!r}; expected pairs such as genre=salsa, with commas between them")
    return {key.strip(): value.strip() for key, _, value in parts}


def job_of(task, context):
    """The job of a task with the panel's settings."""
    obj, scene = context.object, context.scene
    settings = scene.kinelm
    if obj is None or obj.type != "ARMATURE":
        raise Refused(f"{obj.name if obj else 'nothing'} is active; expected an armature: click one of its bones")
    frames = frames_of(scene)
    options = {"count": settings.count, "seed": settings.seed, "run": settings.run, "lock_feet": settings.feet}
    begin = {
        "EDIT": lambda: jobs.edit(obj, selected_bones(obj), *frames, given=settings.given, **options),
        "BETWEEN": lambda: jobs.between(obj, **options),
        "LOOP": lambda: jobs.loop(obj, *frames, **options),
        "DANCE": lambda: jobs.dance(obj, frames[0], settings.seconds, labels_of(settings.labels), **options),
        "LOCK_FEET": lambda: jobs.lock_feet(obj, *frames),
        "TUNE": lambda: jobs.tune(obj, models_folder() / settings.name, settings.steps or None)}
    return jobs.Job(begin[task]())


def models_folder():
    """Where your own models are: in the extension's own folder of the user's."""
    return Path(bpy.utils.extension_path_user(__package__, path="models", create=True))


class KINELM_OT_run(bpy.types.Operator):
    """Let kinelm make something new of the armature's action; Esc stops it"""

    bl_idname = "kinelm.run"
    bl_label = "kinelm"
    bl_options = {"REGISTER", "UNDO"}
    task: EnumProperty(items=TASKS)

    @classmethod
    def description(cls, context, properties):
        return next(text for name, _, text in TASKS if name == properties.task)

    def execute(self, context):
        return self._go(context, lambda: self._done(context, job_of(self.task, context).run()))

    # the modal shell: what a job does is in jobs.py
    def invoke(self, context, event):
        return self._go(context, lambda: self._begin(context))

    def modal(self, context, event):
        if event.type == "ESC":
            self.job.cancel()
            return self._end(context, {"CANCELLED"})
        if event.type != "TIMER":  # nothing may change the action meanwhile
            return {"RUNNING_MODAL"}
        answer = self._go(context, lambda: self._step(context))
        return answer if answer == {"RUNNING_MODAL"} else self._end(context, answer)

    def _begin(self, context):
        self.job = job_of(self.task, context)
        self.timer = context.window_manager.event_timer_add(0.02, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def _step(self, context):
        going, until = True, time.monotonic() + 0.02
        while going and time.monotonic() < until:
            going = self.job.step()
        self._show(context, self.job.progress)
        return {"RUNNING_MODAL"} if going else self._done(context, self.job.result)

    def _end(self, context, answer):
        context.window_manager.event_timer_remove(self.timer)
        self._show(context, -1.0)
        return answer

    def _show(self, context, progress):
        context.scene.kinelm.progress = progress
        for area in context.screen.areas:
            area.tag_redraw()

    def _done(self, context, result):
        if self.task == "TUNE":
            context.scene.kinelm.run = str(result)
            self.report({"INFO"}, f"learned: {result} is the model now")
        else:
            self.report({"INFO"}, ", ".join(action.name for action in result))
        return {"FINISHED"}

    def _go(self, context, work):
        try:
            return work()
        except (Refused, kinelm.Error) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}


def variations(obj):
    """The actions that stand beside an object's action as its variations, and which of them it is."""
    current = obj and obj.animation_data and obj.animation_data.action
    name = current and current.get("kinelm_set")
    found = [action for action in bpy.data.actions if name and action.get("kinelm_set") == name]
    return found, found.index(current) if found else 0


class KINELM_OT_choose(bpy.types.Operator):
    """Choose among the variations"""

    bl_idname = "kinelm.choose"
    bl_label = "Choose"
    bl_options = {"REGISTER", "UNDO"}
    what: EnumProperty(items=[
        ("NEXT", "Next", "The next variation"), ("ACCEPT", "Accept", "Keep this variation and delete the others"),
        ("REJECT", "Reject", "Delete all variations and go back to the action they were made of")])

    @classmethod
    def poll(cls, context):
        return bool(variations(context.object)[0])

    def execute(self, context):
        obj = context.object
        found, at = variations(obj)
        chosen = {"NEXT": found[(at + 1) % len(found)], "ACCEPT": found[at], "REJECT": found[at].get("kinelm_source")}[self.what]
        actions.assign(obj, chosen, getattr(actions.slot_of(obj), "identifier", None))
        if self.what == "ACCEPT":
            for name in ("kinelm_set", "kinelm_source"):
                chosen.pop(name, None)
        for action in found if self.what != "NEXT" else []:
            if action != chosen:
                bpy.data.actions.remove(action)
        return {"FINISHED"}


CLASSES = [Settings, KINELM_OT_run, KINELM_OT_choose]
